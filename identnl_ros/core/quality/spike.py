# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Spikes: one to three samples that their neighbours on both sides contradict."""

from functools import cache

from identnl_ros.core.quality.condition import Condition
from identnl_ros.core.quality.mark import Mark
from identnl_ros.core.quality.residual_scale import GAIN, median_of_valid, PAIR_GAIN
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

# Samples on either side of a suspect, and coefficients of the polynomial through them: smooth
# motion up to 6 % of the sample rate leaves a thousandth of its amplitude.
HALF_WIDTH = 16
COEFFICIENTS = 12
FREEDOM = 2 * HALF_WIDTH + 1 - COEFFICIENTS
_MEDIAN_REST = float(chi2.median(FREEDOM))
# Differences of so many standard deviations make a suspect.
SUSPECT = 5.0
NEIGHBOURS = 3
# Windows before the suspect that tell what the polynomial usually leaves.
REFERENCES = 7
LEAST_REFERENCES = 3
# By the number of samples left out: where they are, the least distance from the polynomial, in
# standard deviations of its fit. Noise reaches 6.7 once in 1000 h; wider ones must not be blows.
PATTERNS = {
    count: tuple(
        tuple(range(start, start + count))
        for start in range(1 - count - NEIGHBOURS, NEIGHBOURS + 1)
    )
    for count in (1, 2, 3)
}
_ALL_PATTERNS = tuple(one for patterns in PATTERNS.values() for one in patterns)
LEAST = {1: 7.5, 2: 12.0, 3: 35.0}
# The rest must look like the windows before, and be small against the spike: a half-sine blow
# of five samples leaves a sixth of its energy when its three largest samples are left out.
REST_DEVIATIONS = 6.0
REST_SHARE = {1: 0.15, 2: 0.15, 3: 0.03}
# A step with a kink, as of friction, contact or a cut peak, must explain less: of a
# spike it leaves a fifth and more of the energy, of a step or kink nothing.
STEPS = range(-5, 7)
STEP_SHARE = 0.05
HISTORY = HALF_WIDTH + REFERENCES * (2 * HALF_WIDTH + 1)


def find_spikes(
    samples: NDArray[np.float64],
    differences: NDArray[np.float64],
    first_row: int,
    next_row: int,
    scale: NDArray[np.float64],
    floor: NDArray[np.float64],
    base_index: int,
) -> list[Mark]:
    """
    Find spikes in a stretch.

    Statistic: the drop of the sum of squares about a polynomial through the 33 samples around
    when one, two or three neighbouring samples are left out, over the variance of the noise:
    the larger of `floor` and what tenth differences and the polynomial left just before. The
    rest must be noise: blows last longer than three samples, kinks and steps leave more.

    Smallest spike found in 99 % of the cases: see docs/data_quality.md. Blows must last five
    samples or more. Not judged: samples less than 16 samples from a missing one, another spike
    or the end of a run, and the first 115 of a run.

    Parameters
    ----------
    samples : ndarray, shape (n_rows, n_channels)
        NaN: no valid sample.
    differences : ndarray, shape (n_rows, n_channels)
        Tenth differences centred at the rows; NaN where there is none.
    first_row, next_row : int
        Rows judged.
    scale, floor : ndarray, shape (n_channels,)
        Standard deviation of the residual just before, and its least value; NaN: not known.
    base_index : int
        Running index of row 0.

    Returns
    -------
    list of Mark

    """
    known = np.fmax(scale, floor)
    low = max(first_row - NEIGHBOURS, 0)
    near = differences[low : next_row + NEIGHBOURS + 1]
    single = np.abs(near[:-1]) / GAIN
    pair = np.abs(near[:-1] + near[1:]) / PAIR_GAIN
    with np.errstate(invalid='ignore'):
        suspicious = np.fmax(single, pair) > SUSPECT * known
    begin = first_row - low
    rows, channels = np.nonzero(suspicious[begin : begin + next_row - first_row])
    if not rows.size:
        return []
    rows, channels = _peaks(np.fmax(single, pair), rows + begin, channels)
    rows += low
    inside = (rows >= HALF_WIDTH) & (rows + HALF_WIDTH < len(samples))
    return _judge(samples, rows[inside], channels[inside], known, base_index)


def _peaks(
    score: NDArray[np.float64], rows: NDArray[np.intp], channels: NDArray[np.intp]
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Keep the suspects that stand out most among their neighbours."""
    best = np.ones(rows.size, dtype=bool)
    own = score[rows, channels]
    for shift in range(-NEIGHBOURS, NEIGHBOURS + 1):
        if shift:
            other = rows + shift
            within = (other >= 0) & (other < len(score))
            value = score[np.where(within, other, rows), channels]
            # Of equals the first one.
            lower = (value < own) | ~within | np.isnan(value)
            best &= lower if shift < 0 else lower | (value == own)
    return rows[best], channels[best]


def _judge(
    samples: NDArray[np.float64],
    rows: NDArray[np.intp],
    channels: NDArray[np.intp],
    known: NDArray[np.float64],
    base_index: int,
) -> list[Mark]:
    if not rows.size:
        return []
    around = np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    width = around.size
    windows = samples[rows + around[:, np.newaxis], channels]
    earlier = []
    for step in range(1, REFERENCES + 1):
        at = rows - step * width + around[:, np.newaxis]
        there = (at >= 0).all(axis=0)
        earlier.append(_rest(np.where(there, samples[np.maximum(at, 0), channels], np.nan), ()))
    references = np.array(earlier)
    usual = median_of_valid(references) / _MEDIAN_REST
    variance = np.fmax(known[channels] ** 2, usual)
    judged = np.isfinite(windows).all(axis=0) & (
        np.isfinite(references).sum(axis=0) >= LEAST_REFERENCES
    )
    found = _explanations(windows, np.where(judged, variance, np.nan))
    marks = []
    for suspect in np.flatnonzero(found >= 0):
        pattern = _ALL_PATTERNS[found[suspect]]
        channel, row = int(channels[suspect]), int(rows[suspect])
        size = _distance(windows[:, suspect], pattern)
        first = base_index + row + pattern[0]
        marks.append(Mark(channel, Condition.SPIKE, first, first + len(pattern), size))
    return marks


def _explanations(windows: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.intp]:
    """Find the fewest samples that, left out, leave noise; -1: none do, or not judged."""
    whole = _rest(windows, ())
    kinked = np.min([_rest(windows, (), step) for step in STEPS], axis=0)
    found = np.full(variance.size, -1)
    number = 0
    for count, patterns in PATTERNS.items():
        rests = np.array([_rest(windows, pattern) for pattern in patterns])
        rest = rests.min(axis=0)
        drop = whole - rest
        freedom = FREEDOM - count
        excess = rest - freedom * variance
        explained = (
            (drop > LEAST[count] ** 2 * variance)
            & (excess < REST_DEVIATIONS * np.sqrt(2 * freedom) * variance)
            & (excess < REST_SHARE[count] * drop)
            & (rest + STEP_SHARE * drop < kinked)
        )
        found = np.where(explained & (found < 0), number + rests.argmin(axis=0), found)
        number += len(patterns)
    return found


def _rest(
    windows: NDArray[np.float64], left_out: tuple[int, ...], step: int | None = None
) -> NDArray[np.float64]:
    """Sum of squares about the polynomial, without some samples, or with a step and kink."""
    centred = windows - windows[HALF_WIDTH]
    return np.asarray(((_complement(left_out, step) @ centred) ** 2).sum(axis=0))


def _distance(window: NDArray[np.float64], left_out: tuple[int, ...]) -> float:
    """Largest distance of the samples left out from the polynomial through the others."""
    columns = [HALF_WIDTH + offset for offset in left_out]
    keep = np.setdiff1d(np.arange(window.size), columns)
    base = _polynomials()
    centred = window - window[HALF_WIDTH]
    fit = base @ np.linalg.lstsq(base[keep], centred[keep], rcond=None)[0]
    return float(np.abs(centred - fit)[columns].max())


@cache
def _complement(left_out: tuple[int, ...], step: int | None) -> NDArray[np.float64]:
    """Orthonormal rows that see neither polynomials nor what else is taken out."""
    offsets = np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
    columns = [_polynomials(), *((offsets == offset)[:, np.newaxis] for offset in left_out)]
    if step is not None:
        later = offsets >= step
        columns.append(np.column_stack((later, later * (offsets - step) / HALF_WIDTH)))
    seen = np.hstack(columns)
    full, _ = np.linalg.qr(seen, mode='complete')
    return np.ascontiguousarray(full[:, seen.shape[1] :].T)


@cache
def _polynomials() -> NDArray[np.float64]:
    place = np.linspace(-1.0, 1.0, 2 * HALF_WIDTH + 1)
    return np.asarray(np.polynomial.legendre.legvander(place, COEFFICIENTS - 1))
