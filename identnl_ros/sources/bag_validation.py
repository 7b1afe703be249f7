# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Validation of identified parameters on a bag."""

from dataclasses import dataclass
from pathlib import Path

from identnl_ros.core.errors import DataError, IdentnlError, LayoutError, MachineError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.machine import Machine
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.validation.agreement import Agreement, StreamComparison
from identnl_ros.core.validation.validation import Traces, Validation
from identnl_ros.sources.bag_runs import BagRuns, SHORTEST_RUN
from identnl_ros.sources.losses import Losses
from identnl_ros.sources.offline import machine_of_bag
from identnl_ros.storage.bag_reader import open_bag
from identnl_ros.storage.result_file import IdentifiedParameters, listed, load_result
from identnl_ros.storage.stand_description import StandDescription
import numpy as np
from numpy.typing import NDArray

# A band this much wider than the noise makes agreement easy.
WIDE_BAND = 10.0


@dataclass(frozen=True)
class BagValidation:
    """
    Result of comparing a machine with a bag.

    Parameters
    ----------
    machine : Machine
    agreement : Agreement
    stream_ids : tuple of int
        Of its streams.
    traces : tuple of Traces or None
        Of every stream, where asked for.
    notes : tuple of str
        What bears on trust in the verdict, in sentences.
    problems : tuple of str
        Damage found in the bag, and samples left out.

    """

    machine: Machine
    agreement: Agreement
    stream_ids: tuple[int, ...]
    traces: tuple[Traces | None, ...]
    notes: tuple[str, ...]
    problems: tuple[str, ...]


def validate_bag(
    path: Path, parameters: Path, machine_path: Path | None = None, trace_samples: int = 0
) -> BagValidation:
    """
    Simulate a machine under the force measured in a bag, compare with its sensors.

    Parameters
    ----------
    path : Path
    parameters : Path
        Result of an identification.
    machine_path : Path or None
        A machine file; None: the one that the bag carries.
    trace_samples : int
        Keep so many samples of every stream's first run.

    Returns
    -------
    BagValidation

    Raises
    ------
    IdentnlError
        If a file cannot be used, or they do not fit one another.

    """
    result = load_result(parameters)
    bag = open_bag(path)
    machine = machine_of_bag(bag, machine_path)
    model, covariance = with_result(assemble(machine), result, parameters)
    notes = _notes_on(result, model, covariance)
    comparisons: list[StreamComparison] = []
    losses = Losses()
    traces, ids, problems = [], [], []
    for stream in bag.streams:
        runs = BagRuns(bag, stream)
        validation = _validated(path, model, covariance, runs, trace_samples, parameters)
        if validation is None:
            problems.append(_left_out(stream, 'no uninterrupted run is long enough'))
            continue
        comparisons.append(validation.comparison())
        losses.add(runs.monitor.summary())
        traces.append(validation.traces)
        ids.append(stream.stream_id)
        if runs.left_out:
            problems.append(
                f'{runs.left_out} samples of stream {stream.stream_id} were left out: runs '
                f'shorter than {SHORTEST_RUN} samples, or without force'
            )
    if not comparisons:
        raise DataError(
            f'{path}: no uninterrupted run of {SHORTEST_RUN} samples with a measured force in it; '
            f'there is nothing to compare with{bag.damage}'
        )
    losses.problems += bag.problems
    agreement = Agreement(tuple(comparisons))
    if not agreement.tests:
        raise DataError(f'{path}: no sensor of motion has a valid reading')
    return BagValidation(
        machine,
        agreement,
        tuple(ids),
        tuple(traces),
        (*notes, *_notes_on_band(agreement)),
        (*losses.remarks(), *problems),
    )


def with_result(
    model: Model, result: IdentifiedParameters, where: Path
) -> tuple[Model, NDArray[np.float64]]:
    """
    Give a model the values of a result.

    Parameters
    ----------
    model : Model
    result : IdentifiedParameters
    where : Path
        Of the result, for errors.

    Returns
    -------
    model : Model
    covariance : ndarray, shape (n_unknowns, n_unknowns)
        In the order of `Model.estimated`.

    Raises
    ------
    DataError
        If the parameters are not those that the machine file marks "estimate".
    MachineError
        If no machine can have such values.

    """
    unknowns = [model.parameters[i] for i in model.estimated]
    expected = [one.name for one in unknowns]
    strange = [name for name in result.names if name not in expected]
    missing = [name for name in expected if name not in result.names]
    if strange or missing:
        of = f' of machine {result.machine}' if result.machine else ''
        parts = []
        if strange:
            parts.append(f'it has {listed(strange)}, which the machine file does not estimate')
        if missing:
            parts.append(f'it lacks {listed(missing)}')
        raise DataError(
            f'{where}: a result{of} that does not fit machine {model.machine.name}: '
            f'{"; ".join(parts)}; give the machine file that it was identified with (--machine)'
        )
    order = [result.names.index(name) for name in expected]
    for one, place in zip(unknowns, order, strict=True):
        if one.unit != result.units[place]:
            raise DataError(
                f'{where}: {one.name}: found the unit {result.units[place]}, expected {one.unit}; '
                'give the machine file that it was identified with (--machine)'
            )
    try:
        moved = model.with_unknowns(result.values[order])
        moved.require_values()
    except MachineError as error:
        raise MachineError(f'{where}: {error}') from None
    return moved, result.covariance[np.ix_(order, order)]


def _validated(
    path: Path,
    model: Model,
    covariance: NDArray[np.float64],
    runs: BagRuns,
    trace_samples: int,
    parameters: Path,
) -> Validation | None:
    """Compare with all runs of a stream; None: there is none."""
    stream = runs.stream
    try:
        validation = Validation(
            model, covariance, stream.layout, stream.sample_rate, trace_samples
        )
        found = False
        for record in runs.runs():
            validation.add(record)
            found = True
    except LayoutError as error:
        raise LayoutError(f'{path} does not fit machine {model.machine.name}: {error}') from None
    except MachineError as error:
        raise MachineError(f'with the values of {parameters}: {error}') from None
    except IdentnlError as error:
        raise type(error)(f'{path}: {error}') from None
    return validation if found else None


def _left_out(stream: StandDescription, why: str) -> str:
    return f'stream {stream.stream_id} was left out: {why}'


def _notes_on(
    result: IdentifiedParameters, model: Model, covariance: NDArray[np.float64]
) -> list[str]:
    notes = []
    names = [model.parameters[i].name for i in model.estimated]
    unknown = [
        name for name, one in zip(names, np.diag(covariance), strict=True) if not np.isfinite(one)
    ]
    if unknown:
        notes.append(
            f'the uncertainty of {listed(unknown)} is not known; the band does not contain it, '
            'and these values are judged as they are'
        )
    doubtful = [
        name
        for name, status in zip(result.names, result.statuses, strict=True)
        if status == 'model_in_doubt'
    ]
    if doubtful:
        notes.append(
            f'the identification itself put the model in doubt ({listed(doubtful)}); '
            'its standard deviations, and the band with them, do not hold'
        )
    if result.machine and result.machine != model.machine.name:
        notes.append(
            f'the result is of machine {result.machine}, the bag is compared with '
            f'{model.machine.name}; their parameters have the same names'
        )
    return notes


def _notes_on_band(agreement: Agreement) -> list[str]:
    wide = [
        channel.sensor.name
        for stream in agreement.streams
        for channel in stream.channels
        if channel.band > WIDE_BAND * channel.noise > 0
    ]
    if not wide or not agreement.agrees:
        return []
    return [
        f'the parameters are so uncertain that the band is more than {WIDE_BAND:g} times the '
        f'noise of {listed(wide)}; agreement within it says little'
    ]
