# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Two sources with clocks of their own become one record that identifies as if they had one."""

from dataclasses import replace
from pathlib import Path

from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.measurement.layout import Layout, SensorKind
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.modes import modes
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.core.synchronisation.alignment import align, SourceRecord
from identnl_ros.storage.layout_file import load_layout
from identnl_ros.storage.machine_file import load_machine
import numpy as np
import pytest

from tests.core.machines import deviations_of, truth_of, values_of
from tests.core.weak_runs import identifier_of, statuses

CONFIG = Path(__file__).resolve().parents[2] / 'config'
RATE = 1e4
COUNT, SETTLING = 5000, 500
SKEW, OFFSET, JITTER = 40e-6, 3e-3, 5e-4
EPOCH = 1_700_000_000_000_000_000
BLOCK = 100
SIGNAL = multisine(1000.0, (5.0, 300.0), 0.5, np.random.default_rng(1))
MODEL = assemble(load_machine(CONFIG / 'knee_column.yaml').machine)
LAYOUT = Layout(tuple(
    sensor for sensor in load_layout(CONFIG / 'knee_column_layout.yaml').layout.sensors
    if sensor.kind is not SensorKind.VELOCITY
))  # fmt: skip
PROBES = LAYOUT.of_kind(SensorKind.DISPLACEMENT)
OTHERS = tuple(sorted({*range(len(LAYOUT.sensors))} - {*PROBES}))


@pytest.fixture(scope='module')
def readings():
    """Read perfect sensors: the probes at the stand's rate, the others late and too slowly."""
    quiet = LAYOUT.with_noise_times(0.0)
    slow = RATE / (1 + SKEW)
    # So many samples and a known delay of the readings begin OFFSET after the probes.
    begin = SETTLING + 31
    delay = begin / slow - SETTLING / RATE - OFFSET
    assert 0 <= delay < 2 / RATE
    delayed = Layout(tuple(replace(sensor, delay=delay) for sensor in quiet.sensors))
    return tuple(
        SimulatedStand(MODEL, layout, (SIGNAL,), rate, 1, 1).read(COUNT + first).samples[first:]
        for layout, rate, first in ((quiet, RATE, SETTLING), (delayed, slow, begin))
    )


def sources_of(readings, seed, motion=1.0):
    """Sample with noise, and stamp blocks with jitter."""
    generator = np.random.default_rng(seed)
    noise = np.array([sensor.noise for sensor in LAYOUT.sensors])
    sources = []
    for name, own, samples, offset, skew in (
        ('probes', PROBES, readings[0], 0.0, 0.0),
        ('others', OTHERS, readings[1], OFFSET, SKEW),
    ):
        stamped = np.arange(0, COUNT, BLOCK)
        time = offset + stamped / RATE * (1 + skew) + generator.normal(0, JITTER, len(stamped))
        own_noise = noise[list(own)] * generator.standard_normal((COUNT, len(own)))
        sources.append(
            SourceRecord(
                name,
                tuple(LAYOUT.sensors[i].name for i in own),
                RATE,
                motion * samples[:, list(own)] + own_noise,
                stamped,
                EPOCH + np.round(time * 1e9).astype(np.int64),
            )
        )
    return sources


def misalignment(alignment):
    """Error of the second source's time at every sample of the record [s]."""
    index = np.arange(float(COUNT))
    truth = (index / RATE - OFFSET) / (1 + SKEW) * RATE
    return (alignment.grids[1].place(index) - truth) / RATE


@pytest.fixture(scope='module')
def aligned(readings):
    return align(MODEL, LAYOUT, sources_of(readings, 0))


def test_sources_are_aligned_to_less_than_a_microsecond(aligned):
    error = np.sqrt(np.mean(misalignment(aligned) ** 2))
    deviation = aligned.remaining.deviation_over_record[1]
    assert error < 1e-6
    assert error < 3.5 * deviation
    assert deviation < 2e-7
    first, second = aligned.clocks
    apart = second.offset - first.offset + (second.origin_ns - first.origin_ns) / 1e9
    assert abs(apart - OFFSET) > 20 * error  # what the stamps alone give
    assert not aligned.warnings(modes(MODEL, static_equilibrium(MODEL)))


def test_identification_of_the_aligned_record_has_the_damping_in_its_intervals(aligned):
    record = aligned.record
    valid = np.flatnonzero(np.isfinite(record.samples).all(axis=1))
    samples = record.samples[valid[0] : valid[-1] + 1]
    assert len(samples) > COUNT - 200
    found = identifier_of(samples, MODEL, LAYOUT, rate=RATE).estimate()
    assert statuses(found) == {EstimateStatus.OK}
    scores = np.abs(values_of(found) - truth_of(MODEL)) / deviations_of(found)
    assert np.all(scores < 3.3)
    # 95 % intervals of 16 parameters: at most three outside, with a probability of 0.7 %.
    assert (scores > 1.96).sum() <= 3


def test_sources_without_motion_are_aligned_by_their_stamps_and_warned_of(readings):
    still = tuple(0 * samples for samples in readings)
    found = align(MODEL, LAYOUT, sources_of(still, 1))
    error = np.sqrt(np.mean(misalignment(found) ** 2))
    deviation = found.remaining.deviation_over_record[1]
    assert 1e-3 < deviation < 1.2e-3
    assert error < 3 * deviation
    (text,) = found.warnings(modes(MODEL, static_equilibrium(MODEL)))
    assert text.startswith('others: a delay of')
    assert 'changes the damping' in text


def test_channels_and_stamps_are_checked(readings):
    first, second = sources_of(readings, 0)
    with pytest.raises(DataError, match='expected every sensor of the layout in one source'):
        align(MODEL, LAYOUT, (first,))
    stamps = second.stamps_ns.copy()
    stamps[40:] += 50_000_000
    with pytest.raises(DataError, match='samples lost; cut the record there'):
        align(MODEL, LAYOUT, (first, replace(second, stamps_ns=stamps)))
    with pytest.raises(DataError, match='samples in common with the'):
        align(MODEL, LAYOUT, (first, replace(second, stamps_ns=second.stamps_ns + 10**10)))
    with pytest.raises(DataError, match='one column for each'):
        replace(second, channels=second.channels[1:])
    with pytest.raises(DataError, match='stamped samples but'):
        replace(second, stamped=second.stamped[1:])
