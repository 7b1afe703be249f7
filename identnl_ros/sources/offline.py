# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Identification from bags: the nodes' code without the nodes."""

from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from identnl_ros.core.errors import DataError, LayoutError
from identnl_ros.core.estimation.estimate import Estimate
from identnl_ros.core.estimation.force_scale import force_scale_remarks
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.likelihood.likelihood_estimate import likelihood_estimate
from identnl_ros.core.measurement.continuity import Arrival, StreamFollower
from identnl_ros.core.measurement.degradation import layout_without
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import observe_force
from identnl_ros.core.measurement.sensor_unknown import sensor_unknown
from identnl_ros.core.measurement.transform import channels_of, MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.model import Model
from identnl_ros.sources.alignment_doubt import alignment_doubts
from identnl_ros.sources.judged_stream import JudgedStream
from identnl_ros.sources.losses import Losses
from identnl_ros.sources.usable_pieces import UsablePieces
from identnl_ros.storage.alignment_record import read_alignment
from identnl_ros.storage.bag_reader import Bag, open_bag
from identnl_ros.storage.machine_file import load_machine, read_machine
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

# Shorter runs between gaps hardly say more than their own initial state.
SHORTEST_RUN = 512
# Sensors named in a sentence.
MOST_NAMES = 6


@dataclass(frozen=True)
class BagIdentification:
    """
    Result of identifying bags.

    Parameters
    ----------
    machine : Machine
    estimate : Estimate
    losses : Losses

    """

    machine: Machine
    estimate: Estimate
    losses: Losses


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


def identify_bags(
    paths: Sequence[Path],
    machine_path: Path | None = None,
    estimator: str = 'weak',
    sensor_unknowns: Sequence[str] = (),
    without: Collection[str] = (),
    tell: Callable[[str], None] = lambda _: None,
    doing: Callable[[str], None] = lambda _: None,
) -> BagIdentification:
    """
    Identify a machine from all samples of some bags.

    Parameters
    ----------
    paths : sequence of Path
        Of the same machine.
    machine_path : Path or None
        A machine file; None: the one that the first bag carries.
    estimator : str
        ``weak``, ``pointwise`` or ``likelihood``.
    sensor_unknowns : sequence of str
        For the likelihood only: what else to estimate, e.g. ``acceleration.delay``.
    without : collection of str
        Names of sensors that are not to be used.
    tell : callable
        Takes sentences for the user that are known before the search, which may be long.
    doing : callable
        Takes what is being done.

    Returns
    -------
    BagIdentification

    Raises
    ------
    IdentnlError
        If a bag or the machine file cannot be used, or they do not fit each other.

    """
    bags = [open_bag(path) for path in paths]
    model = assemble(machine_of_bag(bags[0], machine_path))
    losses = Losses(tell=tell, doing=doing)
    if estimator == 'likelihood':
        estimate = _likelihood(bags, model, sensor_unknowns, without, losses)
    else:
        if sensor_unknowns:
            raise DataError(
                f'unknown {sensor_unknowns[0]}: the {estimator} estimator takes the sensors as '
                'the layout describes them; use --estimator likelihood'
            )
        estimate = _streamed(bags, model, estimator, without, losses)
    voted_out = [_voted_out(*one) for one in losses.voted_out.items()]
    estimate = estimate.noted((*voted_out, *force_scale_remarks(model)))
    if not any(label.endswith('.delay') for label in sensor_unknowns):
        estimate = estimate.doubted(_alignment_doubts(bags, model, estimate, losses))
    for bag in bags:
        losses.problems += bag.problems
    return BagIdentification(model.machine, estimate, losses)


def _alignment_doubts(
    bags: Sequence[Bag], model: Model, estimate: Estimate, losses: Losses
) -> list[str]:
    sentences: list[str] = []
    for bag in bags:
        sources, problem = read_alignment(bag)
        losses.problems += [problem] if problem else []
        sentences += alignment_doubts(sources, model, estimate)
    return sentences


def _streamed(
    bags: Sequence[Bag], model: Model, estimator: str, without: Collection[str], losses: Losses
) -> Estimate:
    identifier = identifier_for(model, estimator)
    pieces = UsablePieces()
    contradictions: list[str] = []
    skews: list[float] = []
    for bag in bags:
        for stream in bag.streams:
            with _fitting(bag, model):
                losses.doing(f'reading and judging {bag.path.name}')
                judged = JudgedStream(bag, stream, model)
                unused = _unused(judged, model, without, losses)
                transform = MotionTransform(model, stream.layout, stream.sample_rate, unused)
            losses.doing(f'fitting {len(model.estimated)} parameters to {bag.path.name}')
            for block in judged.blocks():
                motion = transform.add(block)
                if motion is not None:
                    identifier.add(motion)
                    pieces.add(motion)
            identifier.end_stream()
            losses.add(judged.summary, unused)
            losses.problems += judged.stamps.problems
            skews.append(judged.stamps.skew)
            losses.degradation += transform.degradation
            contradictions += [one.sentence for one in judged.contradictions(unused)]
    if identifier.samples + identifier.rejected == 0:
        raise DataError(
            f'{bags[0].path}: the bag is too short; no sample has the neighbours that its '
            f'derivatives need{_damage(bags)}'
        )
    estimate = identifier.estimate()
    estimate = estimate.doubted([*contradictions, *_rate_doubts(estimate, skews)])
    return estimate.noted(pieces.remarks(estimate))


def _likelihood(
    bags: Sequence[Bag],
    model: Model,
    sensor_unknowns: Sequence[str],
    without: Collection[str],
    losses: Losses,
) -> Estimate:
    unknowns = tuple(
        sensor_unknown(label, [stream.layout for bag in bags for stream in bag.streams])
        for label in sensor_unknowns
    )
    contradictions: list[str] = []
    skews: list[float] = []
    records = [
        record
        for bag in bags
        for record in _records(bag, model, without, losses, contradictions, skews, bool(unknowns))
    ]
    if not records:
        raise DataError(
            f'{bags[0].path}: no run of samples without a gap is long enough to be simulated'
            f'{_damage(bags)}'
        )
    losses.doing(f'fitting {len(model.estimated) + len(unknowns)} parameters to all records')
    with _fitting(bags[0], model):
        estimate = likelihood_estimate(model, records, unknowns)
    estimate = estimate if unknowns else estimate.doubted(contradictions)
    return estimate.doubted(_rate_doubts(estimate, skews))


def _records(
    bag: Bag,
    model: Model,
    without: Collection[str],
    losses: Losses,
    contradictions: list[str],
    skews: list[float],
    unknowns: bool,
) -> Iterator[MeasuredRecord]:
    """Cut a bag at its gaps, and where the force is missing."""
    for stream in bag.streams:
        with _fitting(bag, model):
            losses.doing(f'reading and judging {bag.path.name}')
            # Unknown gains are there to take up what contradicts.
            judged = JudgedStream(bag, stream, model)
            unused = without if unknowns else _unused(judged, model, without, losses)
            ignored = channels_of(stream.layout, unused)
            layout = layout_without(stream.layout, ignored)
            # What is left must tell the force; more is not needed.
            observe_force(model, layout)
        losses.degradation += [f'{name}: ignored' for name in without]
        kept = [i for i in range(len(stream.layout.sensors)) if i not in ignored]
        follower = StreamFollower()
        parts: list[NDArray[np.float64]] = []
        runs: list[NDArray[np.float64]] = []
        begins: list[int] = []
        for block in judged.blocks():
            arrival = follower.accept(
                block.stream_id, block.first_index, block.next_index, block.last
            )
            if not arrival.usable:
                continue
            if arrival is not Arrival.IN_ORDER and parts:
                runs.append(np.concatenate(parts))
                parts = []
            if not parts:
                begins.append(block.first_index)
            parts.append(block.samples[:, kept])
        if parts:
            runs.append(np.concatenate(parts))
        losses.add(judged.summary, unused)
        losses.problems += judged.stamps.problems
        skews.append(judged.stamps.skew)
        contradictions += [one.sentence for one in judged.contradictions(unused)]
        forces = list(layout.of_kind(SensorKind.FORCE))
        for begin, run in zip(begins, runs, strict=True):
            missing = np.flatnonzero(~np.isfinite(run[:, forces]).all(axis=1))
            for first, end in pairwise([-1, *missing.tolist(), len(run)]):
                if end - first - 1 >= SHORTEST_RUN:
                    part = run[first + 1 : end]
                    yield MeasuredRecord(layout, stream.sample_rate, part, begin + first + 1)


def _rate_doubts(estimate: Estimate, skews: Sequence[float]) -> list[str]:
    """Doubt what a sample rate that the stamps deny changes by more than its interval."""
    # Masses and stiffnesses go with its square.
    share = 2 * max((abs(one) for one in skews), default=0.0)
    known = [one for one in estimate.parameters if np.isfinite(one.value) and one.value]
    narrow = [one.name for one in known if one.upper - one.lower < 2 * share * abs(one.value)]
    if not narrow:
        return []
    return [
        f'The stamps deny the sample rate; that changes {", ".join(narrow)} by up to '
        f'{100 * share:.2g} %, more than the intervals.'
    ]


def _unused(
    judged: JudgedStream, model: Model, without: Collection[str], losses: Losses
) -> frozenset[str]:
    """Name the sensors to do without: those given, and those that contradict the others."""
    wrong = judged.contradictions(without)
    unused = frozenset(without) | {one.channel for one in wrong}
    if not wrong:
        return frozenset(without)
    if not _sees_everything(model, judged.stream, unused):
        for one in wrong:
            losses.tell(one.sentence)
        losses.tell(
            'the other sensors do not see every motion, so all are used: the search may take '
            'long, and every estimate will be in doubt'
        )
        return frozenset(without)
    left_out = [f'{one.sentence} (left out)' for one in wrong]
    losses.findings += left_out
    losses.voted_out |= {
        one.channel: judged.believed_against(one.channel, unused) for one in wrong
    }
    for sentence in left_out:
        losses.tell(sentence)
    return unused


def _damage(bags: Sequence[Bag]) -> str:
    return ''.join(bag.damage for bag in bags)


def _voted_out(channel: str, believed: Sequence[str]) -> str:
    shown = ', '.join(believed[:MOST_NAMES])
    more = f' and {len(believed) - MOST_NAMES} more' if len(believed) > MOST_NAMES else ''
    return (
        f'{channel} was left out because {shown}{more} agree against it; if they are wrong alike, '
        'so is this estimate.'
    )


def _sees_everything(model: Model, stream: StandDescription, unused: Collection[str]) -> bool:
    try:
        MotionTransform(model, stream.layout, stream.sample_rate, unused)
    except LayoutError:
        return False
    return True


@contextmanager
def _fitting(bag: Bag, model: Model) -> Iterator[None]:
    """Say which bag and machine do not fit each other."""
    try:
        yield
    except LayoutError as error:
        raise LayoutError(
            f'{bag.path} does not fit machine {model.machine.name}: {error}'
        ) from None
