# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Identification from a bag: the nodes' code without the nodes."""

from dataclasses import dataclass
from pathlib import Path

from identnl_ros.core.assembly import assemble
from identnl_ros.core.errors import DataError, IdentnlError
from identnl_ros.core.estimate import Estimate
from identnl_ros.core.identifier import Identifier, identifier_for
from identnl_ros.core.machine import Machine
from identnl_ros.core.model import Model
from identnl_ros.core.transform import MotionTransform
from identnl_ros.storage.bag_reader import Bag, open_bag
from identnl_ros.storage.machine_file import load_machine, read_machine


@dataclass(frozen=True)
class BagIdentification:
    """
    Result of identifying a bag.

    Parameters
    ----------
    machine : Machine
    estimate : Estimate
    lost_samples : int
        Missing between the blocks, by their running index.
    unusable_blocks : int
        Repeated, late or from another source.
    readings_missing : dict of str to int
        Samples without a valid reading, by channel.
    problems : tuple of str
        Damage found in the bag, in sentences.

    """

    machine: Machine
    estimate: Estimate
    lost_samples: int
    unusable_blocks: int
    readings_missing: dict[str, int]
    problems: tuple[str, ...]


def machine_of_bag(bag: Bag, machine_path: Path | None = None) -> Machine:
    """
    Find the machine that a bag's samples are to be understood with.

    Parameters
    ----------
    bag : Bag
    machine_path : Path or None
        A machine file; None: the one that the bag carries.

    Returns
    -------
    Machine

    Raises
    ------
    IdentnlError
        If the file is unsound, or the bag carries none.

    """
    if machine_path is not None:
        return load_machine(machine_path).machine
    text = bag.description.machine_text
    if not text:
        raise DataError(
            f'{bag.path}: the bag does not say which machine it was recorded on; '
            'give its machine file with --machine'
        )
    return read_machine(text, f'machine file in {bag.path}')


def identify_bag(
    path: Path, machine_path: Path | None = None, estimator: str = 'weak'
) -> BagIdentification:
    """
    Identify a machine from all samples of a bag.

    Parameters
    ----------
    path : Path
    machine_path : Path or None
        A machine file; None: the one that the bag carries.
    estimator : str
        ``weak`` or ``pointwise``.

    Returns
    -------
    BagIdentification

    Raises
    ------
    IdentnlError
        If bag or machine file cannot be used, or they do not fit each other.

    """
    bag = open_bag(path)
    model = assemble(machine_of_bag(bag, machine_path))
    identifier = identifier_for(model, estimator)
    transforms = [
        _identify_stream(bag, stream.stream_id, model, identifier) for stream in bag.streams
    ]
    if identifier.samples + identifier.rejected == 0:
        raise DataError(
            f'{path}: the bag is too short; no sample has the neighbours that its derivatives need'
        )
    missing: dict[str, int] = {}
    for transform in transforms:
        for name, count in transform.counts.samples_without_reading.items():
            missing[name] = missing.get(name, 0) + count
    followers = [transform.follower for transform in transforms]
    return BagIdentification(
        machine=model.machine,
        estimate=identifier.estimate(),
        lost_samples=sum(follower.lost_samples for follower in followers),
        unusable_blocks=sum(
            follower.repeated_blocks + follower.foreign_blocks for follower in followers
        ),
        readings_missing=missing,
        problems=tuple(bag.problems),
    )


def _identify_stream(
    bag: Bag, stream_id: int, model: Model, identifier: Identifier
) -> MotionTransform:
    description = next(stream for stream in bag.streams if stream.stream_id == stream_id)
    try:
        transform = MotionTransform(model, description.layout, description.sample_rate)
    except IdentnlError as error:
        raise type(error)(
            f'{bag.path} does not fit machine {model.machine.name}: {error}'
        ) from None
    for block in bag.blocks(stream_id):
        motion = transform.add(block)
        if motion is not None:
            identifier.add(motion)
    identifier.end_stream()
    return transform
