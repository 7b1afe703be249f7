# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What of the bags could not be used, and why."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field

from identnl_ros.core.quality.common_faults import told_once
from identnl_ros.core.quality.condition import Condition, EXCLUDING
from identnl_ros.core.quality.monitor import QualitySummary

AFTER_END = (
    '{} blocks come after one that says it is the last of its stream, and were left out; let the '
    'source begin a new stream, or mark the last block only'
)


@dataclass
class Losses:
    """
    What of the bags could not be used.

    Parameters
    ----------
    samples : int
        Missing between the blocks, by their running index.
    blocks : int
        Repeated, late or from another source.
    after_end : int
        Blocks after the one that ends the stream.
    readings : dict of str to int
        Samples left out, by channel.
    causes : dict of str to dict of str to int
        The same by channel and cause; a sample may have several, but counts as lost only where
        it has no other.
    channels : dict of str to None
        Names of all channels of the bags, in order.
    findings : list of str
        What else is wrong with channels, in sentences.
    voted_out : dict of str to tuple of str
        Sensors left out because they contradict others, and these.
    degradation : list of str
        What sensors that were lost or ignored have cost, in sentences.
    problems : list of str
        Damage found in the bags, in sentences.
    tell, doing : callable
        Take sentences for the user at once, and what is being done.

    """

    samples: int = 0
    blocks: int = 0
    after_end: int = 0
    readings: dict[str, int] = field(default_factory=dict)
    causes: dict[str, dict[str, int]] = field(default_factory=dict)
    channels: dict[str, None] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    voted_out: dict[str, tuple[str, ...]] = field(default_factory=dict)
    degradation: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    tell: Callable[[str], None] = lambda _: None
    doing: Callable[[str], None] = lambda _: None

    def add(self, summary: QualitySummary, without: Collection[str] = ()) -> None:
        """
        Count what of a stream has been left out.

        Parameters
        ----------
        summary : QualitySummary
        without : collection of str
            Sensors that are not used, of which nothing is said.

        """
        self.samples += summary.lost_samples
        self.blocks += summary.repeated_blocks - summary.blocks_after_end + summary.foreign_blocks
        self.after_end += summary.blocks_after_end
        for channel in summary.channels:
            self.channels[channel.name] = None
            if channel.name in without or not channel.excluded:
                continue
            self.readings[channel.name] = self.readings.get(channel.name, 0) + channel.excluded
            for cause, count in channel.causes.items():
                counts = self.causes.setdefault(channel.name, {})
                counts[cause.in_words] = counts.get(cause.in_words, 0) + count
        self.findings += [
            one.sentence
            for one in summary.findings
            if not one.condition & (EXCLUDING | Condition.GAP) and one.channel not in without
        ]

    def remarks(self) -> list[str]:
        """
        Tell the user what could not be used and what is wrong with the rest.

        Returns
        -------
        list of str
            In sentences; empty: nothing.

        """
        remarks = [
            *self.problems,
            *told_once(
                (
                    (name, f'{count} samples left out ({_counted(self.causes[name])})')
                    for name, count in self.readings.items()
                ),
                self.channels,
            ),
            *self.findings,
            *self.degradation,
        ]
        if self.samples:
            remarks.append(f'{self.samples} samples are missing between the blocks')
        if self.blocks:
            remarks.append(f'{self.blocks} blocks were repeated, late or foreign')
        if self.after_end:
            remarks.append(AFTER_END.format(self.after_end))
        return remarks


def _counted(causes: dict[str, int]) -> str:
    return ', '.join(f'{count} {cause}' for cause, count in causes.items())
