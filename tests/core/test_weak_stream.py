# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The weak identifier on long streams: forgetting, bounded memory, several layouts, restarts."""

from dataclasses import replace
import pickle

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.weak.response_search import CHUNK
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
from identnl_ros.storage.state_file import load_state, save_state
import numpy as np
import pytest

from tests.core.machines import (
    blocks_of,
    deviations_of,
    line_layout,
    motion_of,
    oscillator,
    truth_of,
    unknown,
    values_of,
)
from tests.core.weak_runs import (
    A,
    D,
    exact,
    F,
    feed,
    forgetful,
    identifier_of,
    LAYOUT,
    MULTISINE,
    NOISE,
    noisy,
    OSCILLATOR,
    RATE,
    SETTLING,
    SINE,
    statuses,
)

OK, DOUBT = EstimateStatus.OK, EstimateStatus.MODEL_IN_DOUBT
TRUTH = truth_of(OSCILLATOR)
STIFFNESS = 0
LINEAR = assemble(oscillator(None, unknown(4e5), unknown(200.0)))
# Integration steps per sample; their error is far below the noise.
STEPS = 4


def machine_with(stiffness):
    """Return the oscillator with another stiffness."""
    return assemble(oscillator(None, unknown(stiffness), unknown(200.0), None, unknown(5e15)))


def changing(share, count):
    """
    Integrate the oscillator while its stiffness changes, by Runge and Kutta's method.

    `share` gives the stiffness at all times [s] over the original one.
    """
    half = 0.5 / (STEPS * RATE)
    count += SETTLING
    force = MULTISINE.on_grid(0.0, half, 2 * STEPS * count + 1)
    stiffness = 4e5 * share(half * np.arange(len(force)))

    def rate(x, v, i):
        return v, (force[i] - 200.0 * v - (stiffness[i] + 5e15 * x * x) * x) / 10.0

    x = v = 0.0
    samples = np.empty((count, 3))
    for sample in range(count):
        samples[sample] = force[2 * STEPS * sample], x, rate(x, v, 2 * STEPS * sample)[1]
        for i in range(2 * STEPS * sample, 2 * STEPS * (sample + 1), 2):
            a = rate(x, v, i)
            b = rate(x + half * a[0], v + half * a[1], i + 1)
            c = rate(x + half * b[0], v + half * b[1], i + 1)
            d = rate(x + 2 * half * c[0], v + 2 * half * c[1], i + 2)
            x += half / 3 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
            v += half / 3 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
    return samples[SETTLING:]


def step_of(size):
    return lambda time: 1 + size * (time > 3.0)


def drift_of(size):
    return lambda time: 1 + size * np.clip((time - 2.0) / 2.0, 0, 1)


# --- forgetting -------------------------------------------------------------------------------


def assert_follows(found, size):
    changed = TRUTH * np.array([1 + size, 1, 1])
    assert statuses(found) == {OK}
    assert np.all(np.abs(values_of(found) - changed) < 4 * deviations_of(found))
    assert abs(values_of(found) - TRUTH)[STIFFNESS] > 40 * deviations_of(found)[STIFFNESS]


@pytest.mark.parametrize(
    ('change', 'size'),
    [(step_of, 0.01), (step_of, -0.02), (step_of, 0.2), (drift_of, 0.01)],
    ids=['1 %', '-2 %', '20 %', 'drift of 1 %'],
)
def test_forgetting_follows_a_stiffness_that_changes(change, size):
    samples = noisy(changing(change(size), 11000))
    found = identifier_of(samples, sizes=[500] * 21, memory=0.3).estimate()
    assert_follows(found, size)


@pytest.mark.parametrize('size', [0.01, 0.025])
def test_forgetting_follows_a_change_between_two_streams(size):
    identifier = identifier_of(noisy(exact(count=4000)), sizes=[500] * 7, memory=0.5)
    changed = machine_with((1 + size) * 4e5)
    feed(identifier, noisy(exact(changed, count=8000), seed=2), stream_id=2, sizes=[500] * 15)
    assert_follows(identifier.estimate(), size)


def test_model_is_in_doubt_while_its_machine_changes():
    samples = noisy(changing(drift_of(0.02), 8000))
    identifier = WeakIdentifier(forgetful(OSCILLATOR), 0.3)
    during, before = set(), set()
    blocks = blocks_of(samples, RATE, [800] * 9, last=False)
    for number, motion in enumerate(motion_of(OSCILLATOR, LAYOUT, blocks)):
        identifier.add(motion)
        time = ((number + 1) * 800 + SETTLING) / RATE
        if identifier.samples > 2500:
            seen = before if time < 2.0 else during if 2.5 < time < 4.0 else set()
            seen |= statuses(identifier.estimate())
    assert before == {OK}
    assert during == {DOUBT}


def test_model_is_in_doubt_while_its_machine_creeps():
    # In a chunk the stiffness changes by a few of its standard errors from this chunk alone.
    samples = noisy(changing(lambda time: 1 + 1e-3 * time, 8000))
    found = identifier_of(samples, sizes=[500] * 15, memory=2.0).estimate()
    assert statuses(found) == {DOUBT}


def test_change_is_not_believed_without_memory():
    samples = noisy(changing(step_of(0.01), 8000))
    assert OK not in statuses(identifier_of(samples).estimate())


MEMORY = 0.5
RUNS = 20


def weights():
    """Sum of the weights of all samples, and of their squares; a chunk counts alike."""
    share = np.exp(-CHUNK / (RATE * MEMORY))
    return CHUNK / (1 - share), CHUNK / (1 - share**2)


def test_standard_errors_are_those_of_the_data_that_still_count():
    samples = exact(LINEAR, signal=SINE, count=6000)
    length = round(weights()[0])
    whole = identifier_of(noisy(samples[:length]), LINEAR).estimate()
    found = identifier_of(noisy(samples), LINEAR, memory=MEMORY).estimate()
    np.testing.assert_allclose(deviations_of(found), deviations_of(whole), rtol=0.15)


def test_of_a_machine_that_does_not_change_intervals_hold_with_room_for_slow_change():
    samples = exact(LINEAR, count=4000)
    scores, doubts = [], 0
    for seed in range(RUNS):
        found = identifier_of(noisy(samples, seed=seed), LINEAR, memory=MEMORY).estimate()
        doubts += DOUBT in statuses(found)
        scores.append((values_of(found) - truth_of(LINEAR)) / deviations_of(found))
    total, squares = weights()
    scores = np.array(scores)
    # Errors of a weighted mean of data with equal noise, over those that old data have if their
    # noise is thought to have grown.
    expected = np.sqrt(squares / total)
    assert np.sqrt((scores**2).mean()) == pytest.approx(expected, rel=0.3)
    assert (np.abs(scores) < 1.96).mean() > 0.95
    assert doubts <= 2


def test_very_long_memory_is_like_none():
    samples = noisy(exact(count=6000))
    with_memory, without = (identifier_of(samples, memory=one).estimate() for one in (1e6, None))
    assert statuses(with_memory) == {OK}
    deviations = deviations_of(without)
    np.testing.assert_allclose(deviations_of(with_memory), deviations, rtol=0.02)
    assert np.all(np.abs(values_of(with_memory) - values_of(without)) < 0.2 * deviations)


def test_samples_that_leave_no_doubt_without_noise_are_followed_too():
    layout = line_layout(kinds=(D, A), noise=0.0)
    found = identifier_of(exact(count=5000), layout=layout, memory=0.3).estimate()
    assert statuses(found) == {OK}
    np.testing.assert_allclose(values_of(found), TRUTH, rtol=1e-9)


@pytest.mark.parametrize('memory', [1e-6, 0.3])
def test_wrong_layout_is_doubted_however_short_the_memory(memory):
    samples = noisy(exact(LINEAR, count=5000))
    samples[:, 2] *= 1.02
    found = identifier_of(samples, LINEAR, sizes=[1000] * 5, memory=memory).estimate()
    assert OK not in statuses(found)


# --- memory that does not grow ----------------------------------------------------------------


def sizes_along(samples, model, layout, memory, length):
    """Bytes that an identifier takes after every so many samples."""
    identifier = WeakIdentifier(forgetful(model), memory)
    sizes = []
    for motion in motion_of(model, layout, blocks_of(samples, RATE, [length] * 100)):
        identifier.add(motion)
        sizes.append(len(pickle.dumps(identifier)))
    return sizes


@pytest.mark.parametrize(('memory', 'parts'), [(0.3, 2), (None, 4)])
@pytest.mark.parametrize('fault', ['none', 'gaps', 'silence'])
def test_memory_does_not_grow_along_a_stream(memory, parts, fault):
    samples = np.tile(noisy(exact(LINEAR, signal=SINE, count=10000)), (parts, 1))
    if fault == 'gaps':
        samples[::1700, 0] = np.nan
    elif fault == 'silence':
        samples[4000:, 1] = np.nan
    sizes = sizes_along(samples, LINEAR, LAYOUT, memory, 5000)
    # Samples are kept up to a number that depends on the memory, then fewer.
    assert max(sizes[-2:]) < 1.05 * max(sizes[:-2])


def test_memory_does_not_grow_where_nothing_can_be_learned():
    noise = noisy(np.zeros((60000, 3)))
    noise[::300, 0] = np.nan
    sizes = sizes_along(noise, LINEAR, LAYOUT, None, 5000)
    assert max(sizes[-3:]) < 1.1 * max(sizes[6:9])


# --- several streams --------------------------------------------------------------------------

FEWER = line_layout(kinds=(D,), noise={**NOISE, D: 4e-8})
OTHER_RATE = 3000.0


def stream_of(layout, rate, seed, count):
    return noisy(exact(LINEAR, layout, count=count, rate=rate), layout, seed), layout, rate


@pytest.mark.parametrize('memory', [None, 3.0])
@pytest.mark.parametrize('fewer_first', [False, True])
def test_streams_of_other_sensors_and_rate_add_up(memory, fewer_first):
    # Whole chunks: what a pass over an earlier stream leaves out at its end would tell something.
    streams = [stream_of(LAYOUT, RATE, 4, 3132), stream_of(FEWER, OTHER_RATE, 5, 5697)]
    if fewer_first:
        streams.reverse()
    identifier = WeakIdentifier(forgetful(LINEAR), memory)
    alone = []
    for number, (samples, layout, rate) in enumerate(streams):
        feed(identifier, samples, LINEAR, layout, rate=rate, stream_id=number)
        alone.append(identifier_of(samples, LINEAR, layout, rate=rate, memory=memory).estimate())
    found = identifier.estimate()
    truth = truth_of(LINEAR)
    assert statuses(found) == {OK}
    assert found.samples == sum(one.samples for one in alone)
    assert np.all(np.abs(values_of(found) - truth) < 4 * deviations_of(found))
    # What was learned from the first stream counts less after the second one.
    forgotten = [1.0, 1.0]
    if memory is not None:
        forgotten[0] = np.exp(-len(streams[1][0]) / (streams[1][2] * memory))
    information = sum(
        weight / deviations_of(one) ** 2 for weight, one in zip(forgotten, alone, strict=True)
    )
    np.testing.assert_allclose(deviations_of(found), information**-0.5, rtol=0.15)


# --- saving -----------------------------------------------------------------------------------


def restored(identifier, path, memory=None):
    save_state(path / 'state.npz', identifier.state)
    other = WeakIdentifier(forgetful(OSCILLATOR), memory)
    other.restore(load_state(path / 'state.npz'))
    return other


def test_doubt_survives_saving(tmp_path):
    samples = noisy(exact(count=4000))
    samples[:, 2] *= 1.02
    identifier = identifier_of(samples)
    other = restored(identifier, tmp_path)
    assert statuses(other.estimate()) == {DOUBT}
    assert other.estimate().notes[0] == identifier.estimate().notes[0]
    feed(other, noisy(exact(count=2400), seed=2), stream_id=2)
    assert statuses(other.estimate()) == {DOUBT}


def test_doubt_of_a_machine_that_is_changing_survives_saving_and_ends(tmp_path):
    identifier = WeakIdentifier(forgetful(OSCILLATOR), 0.3)
    feed(identifier, noisy(changing(drift_of(0.02), 6500)), sizes=[500] * 13)
    other = restored(identifier, tmp_path, 0.3)
    assert statuses(identifier.estimate()) == statuses(other.estimate()) == {DOUBT}
    changed = machine_with(1.02 * 4e5)
    feed(other, noisy(exact(changed, count=6000), seed=2), stream_id=2, sizes=[500] * 11)
    assert_follows(other.estimate(), 0.02)


def test_what_force_noise_adds_survives_saving(tmp_path):
    layout = line_layout(kinds=(D, A), noise={**NOISE, F: 0.02})
    samples = noisy(exact(count=4000), layout)
    identifier = identifier_of(samples, layout=layout)
    exact_force = replace(layout, sensors=LAYOUT.sensors)
    less = identifier_of(samples, layout=exact_force).estimate()
    found = restored(identifier, tmp_path).estimate()
    np.testing.assert_array_equal(deviations_of(found), deviations_of(identifier.estimate()))
    assert np.all(deviations_of(found) > 1.02 * deviations_of(less))
