# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Faults that several channels have in common, told once."""

from collections.abc import Collection, Iterable

from identnl_ros.core.quality.condition import Finding
from identnl_ros.core.quality.mark import ALL_CHANNELS


def told_once(faults: Iterable[tuple[str, str]], channels: Collection[str]) -> list[str]:
    """
    Put faults into sentences, one for all channels of which the same is to be said.

    Parameters
    ----------
    faults : iterable of (str, str)
        Name of a channel, and what is wrong with it.
    channels : collection of str
        Names of all that there are.

    Returns
    -------
    list of str
        In the order in which they come first, each beginning with the names.

    """
    names: dict[str, list[str]] = {}
    for name, what in faults:
        names.setdefault(what, []).append(name)
    return [
        f'{ALL_CHANNELS if 1 < len(channels) == len(same) else ", ".join(same)}: {what}'
        for what, same in names.items()
    ]


def fault_of(finding: Finding) -> tuple[str, str]:
    """
    Take the channel's name off the sentence of a finding.

    Parameters
    ----------
    finding : Finding

    Returns
    -------
    tuple of str
        The names that the sentence begins with, and the rest.

    """
    name, _, what = finding.sentence.partition(': ')
    return name, what
