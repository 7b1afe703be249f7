# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The streaming identifiers: motion blocks in, estimates out; nodes and offline use these."""

from typing import Protocol

from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import Estimate
from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.core.measurement.continuity import StreamFollower
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.pointwise.identifier_state import IdentifierState
from identnl_ros.core.pointwise.pointwise_identifier import PointwiseIdentifier
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
from identnl_ros.core.weak.weak_state import WeakState

ESTIMATORS = ('weak', 'pointwise')


class Identifier(Protocol):
    """What every streaming identifier can do."""

    follower: StreamFollower

    @property
    def estimator(self) -> str:
        """Name of the method."""
        ...

    @property
    def samples(self) -> int:
        """Instants used so far."""
        ...

    @property
    def rejected(self) -> int:
        """Instants left out so far."""
        ...

    def add(self, block: MotionBlock) -> bool:
        """Accumulate one block; False where it is not new data of the stream."""
        ...

    def estimate(self) -> Estimate:
        """Solve for the parameters with all data so far."""
        ...

    def reset(self) -> None:
        """Forget all data, and which stream they came from."""
        ...

    @property
    def state(self) -> IdentifierState | WeakState:
        """All that has been learned, to be saved."""
        ...

    def restore(self, state: object) -> None:
        """Continue from a saved state of the same estimator."""
        ...

    def end_stream(self) -> None:
        """Expect another stream next: the present one has ended, marked so or not."""
        ...


def identifier_for(
    model: Model, estimator: str = 'weak', memory: float | None = None
) -> Identifier:
    """
    Make an identifier.

    Parameters
    ----------
    model : Model
    estimator : str
        ``weak``: survives sensor noise. ``pointwise``: Berczynski et al. (2010), for clean data.
    memory : float or None
        Time after which what was learned counts 1/e as much [s]; None: all counts alike. Of the
        weak estimator only.

    Returns
    -------
    Identifier

    Raises
    ------
    DataError
        If there is no such estimator, or it cannot identify this machine.

    """
    if estimator == 'weak':
        return WeakIdentifier(model, memory)
    if estimator != 'pointwise':
        raise DataError(f'estimator "{estimator}": expected one of {", ".join(ESTIMATORS)}')
    if memory is not None:
        raise DataError('the pointwise estimator forgets nothing; leave memory out')
    return PointwiseIdentifier(model)
