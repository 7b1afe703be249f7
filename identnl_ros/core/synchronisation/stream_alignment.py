# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sources with clocks of their own on one sample grid, as they sample, for hours."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.blocks import NANOSECONDS
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.alignment import channel_places, LATENCY
from identnl_ros.core.synchronisation.common_begin import common_begin, LOOKAHEAD
from identnl_ros.core.synchronisation.motion_delay import noise_on_grid
from identnl_ros.core.synchronisation.source_alignment import (
    SourceAligner,
    SourceAlignment,
    UPDATE,
)
from identnl_ros.core.synchronisation.source_stream import (
    LONGEST_BUFFER,
    LONGEST_GAP,
    SourceStream,
)
from identnl_ros.core.synchronisation.stream_source import StreamSource
import numpy as np
from numpy.typing import NDArray

SETTLING = 2.0  # [s]
# A source without samples for so long does not hold up the others any more [s].
SILENCE = 0.5
# Samples are given at once for so long [s].
EPOCH = 0.1


@dataclass(frozen=True)
class AlignedSamples:
    """
    Consecutive samples of all sensors on the grid.

    Parameters
    ----------
    first_index : int
        Running index on the grid, from 0; it jumps where no source had a sample.
    stamp_ns : int
        Host time of the first sample, by the stamps of the reference source [ns].
    samples : ndarray, shape (n_samples, n_sensors)
        In the order of the layout, SI; NaN where there is no valid sample.

    """

    first_index: int
    stamp_ns: int
    samples: NDArray[np.float64] = field(repr=False)


class StreamAlignment:
    """
    Bring blocks of several sources on one grid, in memory that does not grow.

    The grid is that of the first source which samples, the reference: where it has the rate of
    the grid, its samples pass unchanged. The others are interpolated where the stamps, and the
    motion that redundant sensors saw, tell the samples of the grid to lie. What is learned later
    moves them slowly, by their rate, so that time never jumps. The result depends on what the
    sources sampled and stamped, not on the order in which their blocks arrive, as long as none
    is late by more than `silence`.

    Parameters
    ----------
    layout : Layout
    sources : sequence of StreamSource
        Each sensor of the layout in exactly one of them.
    sample_rate : float
        Of the grid [Hz].
    model : Model or None
        None: stamps alone align. With values for all parameters: warnings tell what is lost of
        the damping.
    settling : float
        All sources are observed for so long before any sample is given [s].
    silence : float
        A source without samples for so long, or for two of the longest blocks, is without
        readings [s].
    latency : float
        Standard deviation of the unknown difference between the mean latencies of the stamps of
        two sources [s].

    Raises
    ------
    DataError
        If channels are missing or twice there, or a number is out of its range.

    """

    def __init__(
        self,
        layout: Layout,
        sources: Sequence[StreamSource],
        sample_rate: float,
        model: Model | None = None,
        *,
        settling: float = SETTLING,
        silence: float = SILENCE,
        latency: float = LATENCY,
    ) -> None:
        for name, value in (
            ('sample rate', sample_rate), ('settling', settling), ('silence', silence),
        ):  # fmt: skip
            if not (np.isfinite(value) and value > 0):
                raise DataError(f'alignment: {name} is {value}, expected a positive number')
        if settling > LONGEST_BUFFER / 3:
            raise DataError(
                f'alignment: settling is {settling} s, expected at most {LONGEST_BUFFER / 3:g} s'
            )
        places = channel_places(layout, sources)
        self._rate = sample_rate
        self._count = len(layout.sensors)
        # One source has nothing to be aligned with.
        self._settling, self._silence = settling if len(sources) > 1 else EPOCH, silence
        self._streams = [
            SourceStream(one, sample_rate, own) for one, own in zip(sources, places, strict=True)
        ]
        own_rates = np.empty(len(layout.sensors))
        for stream in self._streams:
            own_rates[stream.places] = stream.rate
        self.layout = noise_on_grid(layout, own_rates.tolist(), sample_rate)
        """With the noise that one sample has on the grid; known before the first one."""
        self._remarks: list[str] = []
        self._aligner = SourceAligner(
            layout, self._streams, sample_rate, model, latency, self._remarks.append
        )
        self._epoch = max(1, round(EPOCH * sample_rate))
        self._next = 0  # point of the grid
        self._started = False
        self._base = 0  # index of point 0
        self._given: tuple[int, int] | None = None  # index and host time after the last sample
        self._updated = 0  # point of the last update
        self._whole = 0  # since when the same sources have samples
        self._interval = settling  # to the next update [s]
        self._ahead: set[int] = set()
        for stream in self._streams:
            if stream.rate < 0.999 * sample_rate:
                self._remarks.append(
                    f'{stream.source.name}: samples at {stream.rate:g} Hz, the grid at '
                    f'{sample_rate:g} Hz; it shows nothing above {stream.rate / 2:g} Hz, no noise '
                    'either, for which the quality or the model may be doubted; that does not '
                    f'happen with a sample_rate of {stream.rate:g} Hz'
                )

    def add(
        self, source: int, first_index: int, stamp_ns: int, samples: NDArray[np.float64]
    ) -> None:
        """
        Take a block.

        Parameters
        ----------
        source : int
            Which of the sources.
        first_index : int
            Running number of the first sample by the source's clock; a jump: samples are lost;
            a step back: the source has begun anew.
        stamp_ns : int
            Its host time, or its arrival's [ns].
        samples : ndarray, shape (n_samples, n_channels)
            SI; NaN where there is no valid sample.

        Raises
        ------
        DataError
            If the shape does not fit.

        """
        stream = self._streams[source]
        if samples.ndim != 2 or samples.shape[1] != len(stream.places):
            raise DataError(
                f'source {stream.source.name}: samples have the shape {samples.shape}, expected '
                f'one column for each of its {len(stream.places)} channels'
            )
        if len(samples) and not stream.add(first_index, stamp_ns, samples):
            self._remarks.append(
                f'{stream.source.name}: began anew with sample {first_index}; it is aligned anew'
            )

    def take(self) -> list[AlignedSamples]:
        """
        Give the samples that are complete.

        Returns
        -------
        list of AlignedSamples

        Raises
        ------
        DataError
            If the sources do not overlap.

        """
        return self._taken(final=False)

    def end(self) -> list[AlignedSamples]:
        """
        Give what is left; nothing follows.

        Returns
        -------
        list of AlignedSamples

        Raises
        ------
        DataError
            If the sources do not overlap.

        """
        return self._taken(final=True)

    def remarks(self) -> tuple[str, ...]:
        """
        Give the sentences for the user that are new.

        Returns
        -------
        tuple of str

        """
        found = tuple(self._remarks)
        self._remarks.clear()
        return found

    @property
    def state(self) -> tuple[SourceAlignment, ...]:
        """How every source is aligned now."""
        return self._aligner.state

    @property
    def places(self) -> tuple[float, ...]:
        """Where the next point of the grid lies among the samples of each source; or NaN."""
        lines = (one.line for one in self._streams)
        return tuple(float(one.at(self._next)) if one else float('nan') for one in lines)

    def _taken(self, final: bool) -> list[AlignedSamples]:
        result: list[AlignedSamples] = []
        while True:
            if not self._started:
                self._begin_anew()
                if not self._start(final):
                    return result
            if not self._ready(self._next + self._epoch, final):
                return result
            result.extend(self._pass(final))

    def _begin_anew(self) -> None:
        for stream in self._streams:
            if stream.later:
                stream.begin_anew()

    def _start(self, final: bool) -> bool:
        found = common_begin(self._streams, self._settling, final, self._remarks.append)
        if found is not None:
            self._lay_grid(found.sources, found.begin_ns, found.end_ns)
        return found is not None

    def _lay_grid(self, present: Sequence[SourceStream], begin_ns: int, end_ns: int) -> None:
        reference = self._aligner.lay_grid(present[0], begin_ns, len(present) == 1)
        begin = (
            reference.clock.host_time(float(reference.line.at(0))) if reference.line else begin_ns
        )
        if self._given is not None:
            index, host_ns = self._given
            self._base = index + max(1, round((begin - host_ns) / NANOSECONDS * self._rate))
        points = max(1, round((end_ns - begin) / NANOSECONDS * self._rate))
        self._started, self._next = True, 0
        self._updated = 0
        # What the sources are aligned by now is not looked at again.
        self._whole = points
        self._interval = points / self._rate + self._settling
        for one in present[1:]:
            self._aligner.join(one, 0, (0, points))
        for one in self._streams:
            one.silent = one not in present
            if one.silent:
                self._remarks.append(f'{one.source.name}: has sent nothing; going on without it')

    def _ready(self, end: int, final: bool) -> bool:
        """Tell whether all that is to come before a point has come."""
        running = [one for one in self._streams if one.line is not None]
        reach = [one.line.point_of(one.end) for one in running if one.line is not None]
        if not running:
            self._started = False
            return bool(final and any(one.began for one in self._streams)) and self._start(final)
        if final:
            return max(reach) > self._next
        host_ns = self._aligner.host_time(end)
        limit = max(self._silence, 2 * max(one.longest_block for one in self._streams))
        for one in self._streams:
            if one.line is not None:
                needed = float(one.line.at(end)) + one.needed_after(one.line)
                needed += LOOKAHEAD * one.rate
                complete = one.end >= needed or bool(one.later)
            else:
                newest = one.clock.stamps[-1][1] if one.clock.stamps else None
                complete = newest is None or newest >= host_ns + round(LOOKAHEAD * NANOSECONDS)
            if not complete and max(reach) < end + limit * self._rate:
                return False
        return max(reach) > self._next

    def _pass(self, final: bool) -> list[AlignedSamples]:
        """Give one epoch."""
        begin, end = self._next, self._next + self._epoch
        self._follow_stamps(end, final)
        if not any(one.line is not None for one in self._streams):
            self._started = False
            return []
        for one in self._streams:
            if one.line is None:
                self._try_to_join(one, begin)
        points = np.arange(begin, end, dtype=np.float64)
        samples = np.full((len(points), self._count), np.nan)
        for one in self._streams:
            if one.line is not None:
                self._note_silence(one, begin, final)
                samples[:, one.places] = one.read(points, self._aligner.slewed(one, begin, end))
        stamp = self._aligner.host_time(begin)
        self._next = end
        self._given = self._base + end, self._aligner.host_time(end)
        for one in self._streams:
            if one.line is not None:
                keep = one.line.at(end - (max(self._settling, UPDATE) + EPOCH) * self._rate)
                if one.later and one.line.point_of(one.end) <= end:
                    self._aligner.dismiss(one)
                    one.begin_anew()
                else:
                    one.forget(int(keep) - one.needed_after(one.line))
        if end - self._updated >= self._interval * self._rate:
            self._aligner.update(end, self._updated, self._whole)
            self._updated, self._interval, self._whole = end, UPDATE, end
        known = np.flatnonzero(np.isfinite(samples).any(axis=1))
        if not known.size:
            return []
        if final:
            samples = samples[: known[-1] + 1]
        return [AlignedSamples(self._base + begin, stamp, samples)]

    def _follow_stamps(self, end: int, final: bool) -> None:
        host_ns = self._aligner.host_time(end) + round(LOOKAHEAD * NANOSECONDS)
        for one in self._streams:
            if one.line is not None:
                taken = one.clock.feed(float(one.line.at(end)) + LOOKAHEAD * one.rate)
                self._aligner.note_stamps(one, taken)
            elif one.clock.stamps:
                one.clock.feed(before_ns=host_ns)
            step = one.clock.step()
            if step is None:
                continue
            text = (
                f'{one.source.name}: its stamps jump near sample {step.index}: samples are lost, '
                'or a clock was set; it is aligned anew'
            )
            if one.line is not None:
                given = self._next - one.line.point_of(step.index)
                if given > 0:
                    text += f'; {int(given)} samples that were given since may be misplaced'
                self._aligner.dismiss(one)
            one.restart(step.index)
            self._remarks.append(text)

    def _try_to_join(self, one: SourceStream, now: int) -> None:
        if one.clock.followed < self._settling:
            return
        place = one.clock.place_at(self._aligner.host_time(now))
        far = LONGEST_GAP * one.rate
        number = self._streams.index(one)
        if not one.begin - far < place < one.end + far:
            if number not in self._ahead:
                self._remarks.append(
                    f'{one.source.name}: its stamps are '
                    f'{abs(place - one.end) / one.rate:.3g} s away from those of the others; it '
                    'stays without readings. Set the clocks of the hosts'
                )
            self._ahead.add(number)
            return
        self._ahead.discard(number)
        if not one.begin <= place <= one.end:
            return
        self._aligner.join(one, now, (now - round(self._settling * self._rate), now))
        self._remarks.append(f'{one.source.name}: is aligned and has readings again')
        one.silent = False
        self._look_soon(now)

    def _note_silence(self, one: SourceStream, begin: int, final: bool) -> None:
        assert one.line is not None
        if one.lost:
            self._remarks.append(f'{one.source.name}: {one.lost} samples lost')
            one.lost = 0
        if final:
            return
        silent = one.line.point_of(one.end) <= begin
        if silent and not one.silent and not one.later:
            self._remarks.append(
                f'{one.source.name}: no samples; its channels are without readings until it is '
                'back'
            )
            self._aligner.hand_over(one)
        if one.silent and not silent:
            self._remarks.append(f'{one.source.name}: is back')
            self._look_soon(begin)
        one.silent = silent

    def _look_soon(self, now: int) -> None:
        """Compare the motion as soon as there is enough of it since a source is back."""
        self._whole = now
        self._interval = (now - self._updated) / self._rate + self._settling
