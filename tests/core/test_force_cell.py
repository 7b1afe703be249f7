# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Force cells on known masses: gain, delay and front mass with intervals that hold."""

from identnl_ros.core.calibration.findings import Property
from identnl_ros.core.calibration.force_cell import (
    calibrate_force_cell,
    KnownMass,
    ShakenMass,
)
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.machine import Body, ExcitationPoint, Machine
from identnl_ros.core.simulation.excitation import multisine
from identnl_ros.core.simulation.stand import SimulatedStand
import numpy as np
import pytest

from tests.core.calibration_runs import (
    assert_intervals_hold,
    changed,
    COUNT,
    DELAY,
    found_of,
    GAIN,
    RATE,
    record,
)
from tests.core.machines import known, ORIGIN, X
from tests.core.weak_runs import A, F

FRONT = Property.FRONT_MASS
RUNS = 40
GAIN_FACTOR, MASS_IN_FRONT, LATE = 1.05, 0.2, 30e-6
LAYOUT = Layout(
    (
        Sensor('cell', F, excitation='exciter', noise=0.1),
        Sensor('up', A, 'block', noise=0.05),
        Sensor('down', A, 'block', noise=0.05),
    )
)
TIME = np.arange(COUNT) / RATE
LINES = np.arange(10, 200, 10.0)


def acceleration(delay=0.0):
    return 2 * np.sin(2 * np.pi * np.outer(TIME - delay, LINES) + LINES).sum(axis=1)


NOW, BEFORE = acceleration(), acceleration(LATE)


def shaken(mass, seed, true=None, reads=1.0, layout=LAYOUT, gain=GAIN_FACTOR, **named):
    """Shake a mass; of two accelerometers that read the same factor, one is upside down."""
    force = gain * ((mass if true is None else true) + MASS_IN_FRONT) * BEFORE
    clean = np.stack((force, reads * NOW, -reads * NOW), axis=1)
    known_mass = KnownMass('cell', mass, ('up', 'down'), **named)
    return ShakenMass(known_mass, [record(clean, layout, seed)], layout)


def scores_of(runs, truth):
    """Errors over standard errors, by property."""
    scores = {what: [] for what in truth}
    for findings in runs:
        assert not findings.doubts
        found = found_of(findings, 'cell')
        for what, right in truth.items():
            scores[what].append((found[what].value - right) / found[what].standard_error)
    return scores


def test_a_known_mass_gives_gain_and_delay_with_the_front_mass_of_the_layout():
    layout = changed(LAYOUT, 'cell', front_mass=MASS_IN_FRONT)
    runs = [calibrate_force_cell([shaken(5.0, seed, layout=layout)]) for seed in range(RUNS)]
    scores = scores_of(runs, {GAIN: GAIN_FACTOR, DELAY: LATE})
    for found in scores.values():
        assert_intervals_hold(found)
    assert FRONT not in found_of(runs[0], 'cell')


def test_two_masses_tell_gain_and_front_mass_over_drawn_masses_and_accelerometers():
    runs = []
    for seed in range(RUNS):
        own, other, ring = np.random.default_rng(seed).standard_normal(3)
        # The shaker's table reads both accelerometers' standard wrong by the same factor.
        reads = 1 - 0.01 * ring
        masses = [
            shaken(mass, 2 * seed + i, mass * (1 + error * drawn), reads,
                   relative_error=error, standard=name)
            for i, (mass, error, drawn, name) in enumerate(
                ((5.0, 0.004, own, ''), (1.0, 0.004, other, ''))
            )
        ]  # fmt: skip
        errors = {name: {'table': 0.01} for name in ('up', 'down')}
        runs.append(calibrate_force_cell(masses, gain_errors=errors))
    scores = scores_of(runs, {GAIN: GAIN_FACTOR, FRONT: MASS_IN_FRONT, DELAY: LATE})
    for found in scores.values():
        assert_intervals_hold(found)
    # A line through two points, by hand: d gain / gain = (5 e1 - 1 e2) / 4 and the table.
    gain, front = (found_of(runs[0], 'cell')[what] for what in (GAIN, FRONT))
    of_records = [share for name, share in gain.shares.items() if name.startswith('record')]
    assert np.linalg.norm(of_records) < 0.1 * gain.standard_error
    by_hand = np.linalg.norm([5 * 0.004 / 4, 1 * 0.004 / 4, 0.01])
    assert gain.standard_error / gain.value == pytest.approx(by_hand, rel=0.05)
    # The table's error is in all readings alike: the front mass is free of it.
    assert abs(front.shares['table']) < 1e-3 * MASS_IN_FRONT


def test_masses_of_one_scale_have_its_error_in_common():
    findings = calibrate_force_cell([
        shaken(mass, seed, relative_error=0.01, standard='scale')
        for seed, mass in enumerate((5.0, 1.0))
    ])  # fmt: skip
    found = found_of(findings, 'cell')
    # All masses are wrong by one factor: so is the gain, the other way round, and the front mass.
    assert found[GAIN].shares['scale'] == pytest.approx(0.01 * GAIN_FACTOR, rel=0.02)
    assert found[FRONT].shares['scale'] == pytest.approx(-0.01 * MASS_IN_FRONT, rel=0.05)


def test_the_cell_shaken_alone_tells_its_front_mass_by_a_trusted_gain():
    runs = []
    for seed in range(RUNS):
        drawn = np.random.default_rng(seed).standard_normal()
        # The layout states a gain that is too high by 2 % for one standard deviation.
        alone = shaken(0.0, seed, gain=1 / (1 + 0.02 * drawn))
        runs.append(calibrate_force_cell([alone], gain_errors={'cell': {'maker': 0.02}}))
    scores = scores_of(runs, {FRONT: MASS_IN_FRONT, DELAY: LATE})
    for found in scores.values():
        assert_intervals_hold(found)
    front = found_of(runs[0], 'cell')[FRONT]
    assert front.shares['maker'] == pytest.approx(-0.02 * front.value)
    assert GAIN not in found_of(runs[0], 'cell')
    told = calibrate_force_cell([shaken(0.0, 1)])
    assert any('uncertainty of its gain is not given' in one for one in told.remarks)


def test_the_cell_alone_and_one_mass_tell_both():
    runs = [
        calibrate_force_cell([shaken(0.0, 2 * seed), shaken(5.0, 2 * seed + 1)])
        for seed in range(RUNS)
    ]
    scores = scores_of(runs, {GAIN: GAIN_FACTOR, FRONT: MASS_IN_FRONT, DELAY: LATE})
    for found in scores.values():
        assert_intervals_hold(found)


def test_masses_that_do_not_agree_are_in_doubt():
    masses = (0.0, 2.0, 5.0)
    right = calibrate_force_cell([shaken(mass, i) for i, mass in enumerate(masses)])
    assert not right.doubts
    wrong = calibrate_force_cell([
        shaken(mass, i, true=2.1 if mass == 2.0 else mass) for i, mass in enumerate(masses)
    ])  # fmt: skip
    assert 'the masses do not agree with one another' in wrong.doubts[0]


def test_a_front_mass_below_zero_is_not_believed():
    # 5 kg and 1 kg that are in truth 4.7 and 0.7: as if 0.1 kg were missing in front.
    findings = calibrate_force_cell([
        shaken(mass, i, true=mass - 0.3, relative_error=error)
        for i, (mass, error) in enumerate(((5.0, 0.0), (1.0, 0.0)))
    ])  # fmt: skip
    assert 'its front mass comes out as -0.1' in findings.doubts[0]
    assert FRONT not in found_of(findings, 'cell')
    wide = calibrate_force_cell([
        shaken(mass, i, true=mass - 0.3, relative_error=error)
        for i, (mass, error) in enumerate(((5.0, 0.05), (1.0, 0.2)))
    ])  # fmt: skip
    assert not wide.doubts
    assert 'not to be told from 0' in wide.undetermined[0].reason


def test_the_simulated_stand_reads_what_the_calibration_finds():
    """Masses driven by the integrator through a cell with a mass in front."""
    shaken_masses = []
    actual = changed(LAYOUT, 'cell', gain=GAIN_FACTOR, front_mass=MASS_IN_FRONT, delay=LATE)
    for i, mass in enumerate((5.0, 0.4)):
        body = Body('block', known(mass), ORIGIN, None, ('translation_1',))
        exciter = ExcitationPoint('exciter', 'block', ORIGIN, X)
        model = assemble(Machine('hung', (body,), (), (exciter,)))
        signal = multisine(8.0 * mass, (10.0, 150.0), 0.6, np.random.default_rng(2))
        stand = SimulatedStand(model, actual, (signal,), RATE, i, 1, declared_layout=LAYOUT)
        samples = stand.read(COUNT).samples
        shaken_masses.append(
            ShakenMass(
                KnownMass('cell', mass, ('up', 'down')),
                [MeasuredRecord(LAYOUT, RATE, samples)],
                LAYOUT,
            )
        )
    findings = calibrate_force_cell(shaken_masses)
    assert not findings.doubts
    found = found_of(findings, 'cell')
    for what, right in ((GAIN, GAIN_FACTOR), (FRONT, MASS_IN_FRONT), (DELAY, LATE)):
        assert abs(found[what].value - right) < 4 * found[what].standard_error, what
    assert found[FRONT].standard_error < 0.01 * MASS_IN_FRONT
