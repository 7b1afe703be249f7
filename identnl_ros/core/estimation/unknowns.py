# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What every identifier asks of the machine and of the motion it is given."""

from identnl_ros.core.errors import DataError, MachineError
from identnl_ros.core.estimation.estimate import Estimate, EstimateStatus, ParameterEstimate
from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.core.mechanics.model import Model
import numpy as np


def require_unknowns(model: Model) -> None:
    """
    Refuse a machine with nothing to identify, or with gaps in what is known.

    Parameters
    ----------
    model : Model

    Raises
    ------
    DataError
        If the machine has no unknown parameter, or a known one has no value.

    """
    if not model.estimated:
        raise DataError(
            f'machine {model.machine.name}: no parameter is marked "estimate"; '
            'there is nothing to identify'
        )
    for parameter in model.parameters:
        if not parameter.estimated and np.isnan(parameter.value):
            raise DataError(f'{parameter.name}: known but without a value')


def require_no_time(model: Model, estimator: str) -> None:
    """
    Refuse a machine whose forces depend on time.

    Parameters
    ----------
    model : Model
    estimator : str
        That cannot take it.

    Raises
    ------
    MachineError
        If a force is periodic or a stiffness drifts.

    """
    if model.time_dependent:
        raise MachineError(
            f'machine {model.machine.name}: it has a periodic force or a stiffness that drifts, '
            f'which the {estimator} estimator does not take; use the likelihood estimator'
        )


def require_same_unknowns(expected: tuple[str, ...], found: tuple[str, ...]) -> None:
    """
    Refuse a saved state of other unknowns.

    Parameters
    ----------
    expected, found : tuple of str
        Names.

    Raises
    ------
    DataError
        If they differ.

    """
    if found != expected:
        differing = ', '.join(sorted(set(expected) ^ set(found))) or 'the order'
        raise DataError(
            'the saved state belongs to another machine or other unknowns '
            f'(differing: {differing})'
        )


def require_coordinates(model: Model, block: MotionBlock) -> None:
    """
    Refuse motion of another machine.

    Parameters
    ----------
    model : Model
    block : MotionBlock

    Raises
    ------
    DataError
        If the block's coordinates are not the machine's.

    """
    if block.coordinates != model.coordinate_names:
        raise DataError(
            f'motion block {block.first_index}: its coordinates are not those of machine '
            f'{model.machine.name}; do transform and identifier use the same machine file?'
        )


def nothing_yet(model: Model, estimator: str, samples: int, rejected: int, note: str) -> Estimate:
    """
    Make the estimate of an identifier that knows nothing.

    Parameters
    ----------
    model : Model
    estimator : str
    samples, rejected : int
        Instants used and left out.
    note : str
        Why, for people.

    Returns
    -------
    Estimate

    """
    unknowns = [model.parameters[i] for i in model.estimated]
    return Estimate(
        estimator,
        tuple(
            ParameterEstimate(
                one.name,
                one.symbol,
                one.unit,
                float('nan'),
                float('nan'),
                EstimateStatus.UNKNOWN,
                note,
            )
            for one in unknowns
        ),
        np.full((len(unknowns),) * 2, np.nan),
        samples,
        rejected,
        float('nan'),
        float('nan'),
    )
