# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Band-limited interpolation against closed form; chunks; edges and gaps."""

from identnl_ros.core.errors import DataError
from identnl_ros.core.synchronisation.resampling import (
    Grid,
    HALF_WIDTH,
    interpolate,
    reach_of,
    resample,
    Resampler,
    weights_at,
)
import numpy as np
import pytest

GRID = Grid(30.37, 1 + 40e-6)


def tones(highest, place, lowest=0.001):
    """Sum of 40 sines, RMS 1; frequencies in cycles per sample."""
    generator = np.random.default_rng(4)
    frequencies = np.linspace(lowest, highest, 40)
    phases = generator.uniform(0, 2 * np.pi, 40)
    values = np.sin(2 * np.pi * np.outer(place, frequencies) + phases).sum(axis=1) / np.sqrt(20)
    return values[:, np.newaxis]


@pytest.mark.parametrize(('highest', 'error'), [(0.1, 1e-6), (0.3, 1e-6), (0.46, 1e-6)])
def test_multisine_is_interpolated_to_the_stop_band(highest, error):
    count = 3000
    found = resample(tones(highest, np.arange(3000.0)), GRID, count)
    exact = tones(highest, GRID.place(np.arange(float(count))))
    valid = np.isfinite(found)
    assert valid.sum() > count - 30 - 2 * HALF_WIDTH - 2
    assert np.abs(found - exact)[valid].max() < error
    assert highest < Resampler(GRID, 1).passband / 2


@pytest.mark.parametrize('step', [2.5, 0.4, 1.6])
def test_rates_that_differ(step):
    grid = Grid(200.3, step)
    count = int(2500 / step)
    found = resample(tones(0.15, np.arange(3000.0)), grid, count)
    exact = tones(0.15, grid.place(np.arange(float(count))))
    valid = np.isfinite(found)
    assert valid.mean() > 0.9
    assert np.abs(found - exact)[valid].max() < 1e-6


def test_what_a_coarser_grid_cannot_carry_is_removed():
    found = resample(tones(0.45, np.arange(3000.0), 0.27), Grid(200.0, 2.5), 800)
    assert np.nanmax(np.abs(found)) < 1e-5


def test_chunks_of_any_size_give_the_whole_record():
    generator = np.random.default_rng(1)
    samples = generator.standard_normal((1500, 3))
    whole = Resampler(GRID, 3).add(samples)
    stream = Resampler(GRID, 3)
    edges = np.unique(generator.integers(0, 1500, 40))
    parts = [stream.add(part) for part in np.split(samples, edges)]
    np.testing.assert_allclose(np.concatenate(parts), whole, rtol=0, atol=1e-13)
    assert len(stream._buffer) < 3 * HALF_WIDTH + 2


@pytest.mark.parametrize('start', [-250.6, 0.0, 250.6])
def test_points_beyond_the_record_are_invalid(start):
    found = resample(np.ones((600, 1)), Grid(start, 1.0), 600)
    place = start + np.arange(600)
    inside = (place >= HALF_WIDTH) & (place <= 599 - HALF_WIDTH)
    assert np.isfinite(found[inside]).all()
    assert np.isnan(found[(place < HALF_WIDTH - 1) | (place > 600 - HALF_WIDTH)]).all()
    np.testing.assert_allclose(found[inside], 1, atol=1e-6)


def test_invalid_samples_cost_their_neighbourhood_in_their_channel_only():
    samples = np.ones((600, 2))
    samples[300, 1] = np.nan
    found = resample(samples, Grid(0.5, 1.0), 600)
    lost = np.isnan(found[HALF_WIDTH : 600 - HALF_WIDTH - 1])
    assert lost[:, 0].sum() == 0
    assert lost[:, 1].sum() == 2 * HALF_WIDTH


def test_the_own_grid_changes_nothing():
    samples = np.random.default_rng(1).standard_normal((400, 1))
    found = resample(samples, Grid(0.0, 1.0), 400)
    valid = np.isfinite(found)
    np.testing.assert_allclose(found[valid], samples[valid], atol=1e-14)


@pytest.mark.parametrize(('stretch', 'error'), [(1.0, 1e-14), (1 + 1e-4, 1e-10), (2.56, 1e-10)])
def test_weights_are_those_of_the_windowed_sinc(stretch, error):
    # Through interpolation of unit impulses at places of any kind.
    count = 4 * round(HALF_WIDTH * stretch)
    place = count / 2 + np.random.default_rng(8).random(50)
    found = interpolate(np.eye(count), place, stretch)
    half = reach_of(stretch)
    first = int(count / 2) - half + 1
    exact = weights_at(place - np.floor(place), stretch)
    np.testing.assert_allclose(found[:, first : first + 2 * half], exact, rtol=0, atol=error)
    assert exact.max() > 0.3


def test_impossible_grids_are_refused():
    with pytest.raises(DataError, match='step positive'):
        Grid(0.0, 0.0)
