# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Stamps against index and rate: what clocks do is nothing, what they do not is told."""

from dataclasses import replace

from identnl_ros.core.quality.stamp_check import StampCheck
import numpy as np
import pytest

from tests.core.machines import blocks_of

RATE = 5000.0
COUNT = 600


def findings(late, lost=(), repeated=()):
    """Judge blocks whose stamps are late by so much [s]."""
    blocks = blocks_of(np.zeros((50 * COUNT, 1)), RATE, [50] * (COUNT - 1))
    assert len(blocks) == COUNT
    moved = [
        replace(block, stamp_ns=round((block.first_index / RATE + 100 + one) * 1e9))
        for block, one in zip(blocks, late, strict=True)
    ]
    kept = [block for i, block in enumerate(moved) if i not in lost]
    kept += [moved[i] for i in repeated]
    check = StampCheck(RATE)
    assert list(check.watched(kept)) == kept
    return check.findings()


TIME = np.arange(COUNT) * 50 / RATE


@pytest.mark.parametrize('seed', range(20))
def test_jitter_late_arrivals_and_the_skew_of_crystals_are_no_problem(seed):
    generator = np.random.default_rng(seed)
    late = 1e-4 * generator.choice([-1, 1]) * TIME + generator.normal(0, 5e-4, COUNT)
    late += (generator.random(COUNT) < 0.05) * generator.exponential(2e-2, COUNT)
    assert findings(late).problems == ()


def test_exact_stamps_lost_and_repeated_blocks_and_bursts_are_no_problem():
    assert findings(np.zeros(COUNT)).problems == ()
    assert findings(np.zeros(COUNT), lost=range(100, 160), repeated=[30, 31]).problems == ()
    # Five blocks come together, with the stamp of the last.
    assert findings((4 - np.arange(COUNT) % 5) * 50 / RATE).problems == ()


@pytest.mark.parametrize('jitter', [0.0, 5e-4])
@pytest.mark.parametrize('skew', [1e-3, -1e-2, 0.1])
def test_another_rate_is_told(skew, jitter):
    late = skew * TIME + np.random.default_rng(1).normal(0, jitter, COUNT)
    found = findings(late)
    assert found.skew == pytest.approx(skew, abs=1e-4)
    (problem,) = found.problems
    assert f'come at {RATE / (1 + found.skew):.6g} Hz, the bag says 5000 Hz' in problem


@pytest.mark.parametrize('jitter', [0.0, 1e-3])
@pytest.mark.parametrize('step', [0.3, -1.0])
def test_a_jump_of_the_stamps_is_told_with_its_place(step, jitter):
    late = step * (np.arange(COUNT) >= 350) + np.random.default_rng(1).normal(0, jitter, COUNT)
    found = findings(late)
    assert found.skew == 0
    (problem,) = found.problems
    assert 'at sample 17500, 3.5 s after the begin: samples are lost' in problem
    size = float(problem.split('jump by ')[1].split(' ')[0])
    assert size == pytest.approx(step, abs=3 * jitter + 1e-9)


def test_stamps_that_run_backwards_are_told():
    (problem,) = findings(-2 * TIME).problems
    assert 'run backwards' in problem
