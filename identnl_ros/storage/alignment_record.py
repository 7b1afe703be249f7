# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How well the sources of a bag are aligned, kept in the bag."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
import json
from math import isfinite

from identnl_ros.storage.bag_reader import Bag
from identnl_ros.storage.bag_writer import BagWriter

NAME = 'identnl.alignment'


@dataclass(frozen=True)
class AlignedSource:
    """
    A source of the samples of a bag.

    Parameters
    ----------
    name : str
    channels : tuple of str
        Names of the sensors.
    deviation : float
        Standard deviation of its delay against the first source [s].
    by_motion : bool
        The motion that redundant sensors saw tells the delay.

    """

    name: str
    channels: tuple[str, ...]
    deviation: float
    by_motion: bool


def write_alignment(writer: BagWriter, sources: Sequence[AlignedSource]) -> None:
    """
    Keep in a bag how well its sources are aligned.

    Parameters
    ----------
    writer : BagWriter
    sources : sequence of AlignedSource

    Raises
    ------
    DataError
        If it cannot be written.

    """
    writer.write_metadata(NAME, {'sources': json.dumps([asdict(one) for one in sources])})


def read_alignment(bag: Bag) -> tuple[tuple[AlignedSource, ...], str]:
    """
    Find how well the sources of a bag are aligned.

    Parameters
    ----------
    bag : Bag

    Returns
    -------
    sources : tuple of AlignedSource
        None: the bag is of one source, or does not say.
    problem : str
        What is wrong with the record; empty: nothing.

    """
    metadata = bag.metadata(NAME)
    if metadata is None:
        return (), ''
    try:
        sources = tuple(
            AlignedSource(
                str(one['name']),
                tuple(one['channels']),
                float(one['deviation']),
                bool(one['by_motion']),
            )
            for one in json.loads(metadata['sources'])
        )
    except (KeyError, TypeError, ValueError):
        sources = ()
    if not sources or not all(isfinite(one.deviation) for one in sources):
        return (), f'{bag.path}: what it says of the alignment of its sources is damaged'
    return sources, ''
