# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether the stamps of blocks agree with their running index and the sample rate."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise

from identnl_ros.core.measurement.blocks import NANOSECONDS, SampleBlock
from identnl_ros.core.measurement.continuity import StreamFollower
import numpy as np
from numpy.typing import NDArray

# Crystals of cheap devices and hosts that are set slowly differ by less [-].
LARGEST_SKEW = 200e-6
# Of a rate or a step, in standard deviations.
SIGNIFICANT = 5.0
# Blocks on either side that tell whether a jump lasts: longer than the stalls of a host.
NEIGHBOURS = 32
# Blocks of which a rate is worth something.
FEWEST_BLOCKS = 8
# Median of the absolute values of a normal distribution.
NORMAL_MAD = 0.6745


@dataclass(frozen=True)
class StampFindings:
    """
    What the stamps of a stream tell of its time.

    Parameters
    ----------
    skew : float
        By which the samples come more slowly than the rate says; 0: nothing beyond what clocks
        have [-].
    problems : tuple of str
        In sentences.

    """

    skew: float = 0.0
    problems: tuple[str, ...] = ()


class StampCheck:
    """
    Collect the stamps of a stream, and judge them.

    Two numbers are kept of every block.

    Parameters
    ----------
    sample_rate : float
        [Hz].

    """

    def __init__(self, sample_rate: float) -> None:
        self._rate = sample_rate
        self._follower = StreamFollower()
        self._index: list[int] = []
        self._stamps: list[int] = []

    def watched(self, blocks: Iterable[SampleBlock]) -> Iterator[SampleBlock]:
        """
        Look at blocks as they pass.

        Parameters
        ----------
        blocks : iterable of SampleBlock

        Yields
        ------
        SampleBlock

        """
        for block in blocks:
            arrival = self._follower.accept(
                block.stream_id, block.first_index, block.next_index, block.last
            )
            if arrival.usable and len(block.samples):
                self._index.append(block.first_index)
                self._stamps.append(block.stamp_ns)
            yield block

    def findings(self) -> StampFindings:
        """
        Judge all that has come.

        Returns
        -------
        StampFindings

        """
        if len(self._index) < 3:
            return StampFindings()
        index = np.array(self._index, dtype=np.int64)
        stamps = np.array(self._stamps, dtype=np.int64)
        time = (index - index[0]) / self._rate
        late = (stamps - stamps[0]) / NANOSECONDS - time
        pieces = _pieces(time, late, 1 / self._rate)
        problems = []
        steps = _steps(time, late, pieces)
        if steps:
            at, step = max(steps, key=lambda one: abs(one[1]))
            others = f', and at {len(steps) - 1} other places' if len(steps) > 1 else ''
            problems.append(
                f'the stamps jump by {step:.4g} s against the running index at sample '
                f'{index[at]}, {time[at]:.4g} s after the begin{others}: samples are lost that '
                'the index does not count, or a clock was set; check the source'
            )
        skew, deviation = _skew(time, late, pieces)
        if abs(skew) < LARGEST_SKEW + SIGNIFICANT * deviation:
            return StampFindings(0.0, tuple(problems))
        if skew <= -1:
            problems.append('the stamps run backwards; check the source')
        else:
            problems.append(
                f'by the stamps the samples come at {self._rate / (1 + skew):.6g} Hz, the bag '
                f'says {self._rate:.6g} Hz ({100 * abs(skew):.2g} % off): frequencies and all '
                'that follows from them are wrong by as much, if the stamps are right; correct '
                'the sample rate, or the clock of the stamps'
            )
        return StampFindings(skew, tuple(problems))


def _pieces(
    time: NDArray[np.float64], late: NDArray[np.float64], interval: float
) -> list[tuple[int, int]]:
    """Divide at jumps that last and are beyond jitter and half an interval."""
    straight = late - _usual(time, late) * time
    jumps = np.diff(straight)
    jitter = float(np.median(np.abs(jumps))) / NORMAL_MAD
    limit = max(SIGNIFICANT * jitter, interval / 2)
    edges = [0]
    fewest = max(2, min(NEIGHBOURS // 2 + 1, len(time) // 4))
    for at in np.flatnonzero(np.abs(jumps) > limit) + 1:
        before = straight[max(edges[-1], at - NEIGHBOURS) : at]
        after = straight[at : at + NEIGHBOURS]
        if min(len(before), len(after)) < fewest:
            continue
        if abs(np.median(after) - np.median(before)) > limit:
            edges.append(int(at))
    return list(zip(edges, [*edges[1:], len(time)], strict=True))


def _usual(time: NDArray[np.float64], late: NDArray[np.float64]) -> float:
    """Slope over some blocks, whatever single jumps and blocks that come in bursts."""
    apart = min(NEIGHBOURS, max(1, len(time) // 8))
    return float(np.median((late[apart:] - late[:-apart]) / (time[apart:] - time[:-apart])))


def _steps(
    time: NDArray[np.float64], late: NDArray[np.float64], pieces: list[tuple[int, int]]
) -> list[tuple[int, float]]:
    """Where pieces begin, and by how much they are later than those before."""
    straight = late - _usual(time, late) * time
    found = []
    for (begin, at), (_, end) in pairwise(pieces):
        before = straight[max(begin, at - NEIGHBOURS) : at]
        after = straight[at : min(end, at + NEIGHBOURS)]
        found.append((at, float(np.median(after) - np.median(before))))
    return found


def _skew(
    time: NDArray[np.float64], late: NDArray[np.float64], pieces: list[tuple[int, int]]
) -> tuple[float, float]:
    """Slope within the pieces, by the median of distant pairs, and its standard deviation."""
    slopes, weights, scatter = [], [], []
    for begin, end in pieces:
        if end - begin < FEWEST_BLOCKS:
            continue
        half = (end - begin) // 2
        apart = time[begin + half : begin + 2 * half] - time[begin : begin + half]
        pairs = (late[begin + half : begin + 2 * half] - late[begin : begin + half]) / apart
        slope = float(np.median(pairs))
        slopes.append(slope)
        # Late arrivals come in bursts: as if a quarter of the pairs were independent.
        spread = float(np.median(np.abs(pairs - slope))) / NORMAL_MAD
        scatter.append(spread * np.sqrt(np.pi / 2 / max(half / 4, 1)))
        weights.append(float(time[end - 1] - time[begin]))
    if not slopes:
        return 0.0, np.inf
    best = int(np.argmax(weights))
    return slopes[best], scatter[best]
