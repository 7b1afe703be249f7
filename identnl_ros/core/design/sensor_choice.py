# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Which sensors of a planned run matter, and which can be spared together."""

from collections.abc import Iterable
from dataclasses import dataclass

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.design.sensor_information import SensorInformation
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray

# Growth of the largest relative error that sparing sensors may cost: a run 21 % longer makes
# up for it.
TOLERATED_GROWTH = 0.1


@dataclass(frozen=True)
class SensorImportance:
    """
    What would be lost without one sensor.

    Parameters
    ----------
    channel : int
        Of the layout.
    growth : float
        Of the largest relative error without this sensor alone [-]; infinite: a parameter
        would not be identifiable any more.
    essential : bool
        That growth is more than is tolerated.
    spared : bool
        One of those that may be left out together.

    """

    channel: int
    growth: float
    essential: bool
    spared: bool


def sensor_importances(
    model: Model, sensors: SensorInformation, tolerated: float = TOLERATED_GROWTH
) -> tuple[SensorImportance, ...]:
    """
    Rank sensors, and find many that can be spared together.

    Those to be spared are found one by one, each time the one that is missed least: a good
    choice, not proven to be the best.

    Parameters
    ----------
    model : Model
        The values expected.
    sensors : SensorInformation
    tolerated : float
        Growth of the largest relative error [-].

    Returns
    -------
    tuple of SensorImportance
        The most important first.

    """
    values = np.abs(model.values[list(model.estimated)])
    whole = sensors.together()
    free = whole.solve().free
    judged = _Judge(values, free, _deviations(whole))
    kept = list(range(len(sensors.channels)))
    growths = judged.growths(sensors.without_each(kept))
    alone = growths
    while len(kept) > 1 and growths.min() <= tolerated:
        del kept[int(np.argmin(growths))]
        growths = judged.growths(sensors.without_each(kept))
    found = [
        SensorImportance(channel, float(growth), bool(growth > tolerated), i not in kept)
        for i, (channel, growth) in enumerate(zip(sensors.channels, alone, strict=True))
    ]
    return tuple(sorted(found, key=lambda one: -one.growth))


@dataclass(frozen=True)
class _Judge:
    """Compares choices of sensors with all of them."""

    values: NDArray[np.float64]
    free: NDArray[np.bool_]
    deviations: NDArray[np.float64]

    def growths(self, choices: Iterable[Information]) -> NDArray[np.float64]:
        """Growth of the largest relative error; infinite if anything is not identifiable."""
        # A parameter with the value 0 has no relative error; it counts if there is no other.
        scale = np.where(self.values > 0, self.values, np.inf)
        if not np.isfinite(scale[~self.free]).any():
            scale = self.deviations
        worst = np.max(self.deviations / scale, initial=0.0, where=~self.free)
        found = []
        for information in choices:
            deviations = _deviations(information)
            lost = np.isnan(deviations[~self.free]).any()
            errors = np.nan_to_num(deviations / scale)
            now = np.max(errors, initial=0.0, where=~self.free)
            found.append(np.inf if lost else now / worst - 1 if worst > 0 else 0.0)
        return np.array(found)


def _deviations(information: Information) -> NDArray[np.float64]:
    """Smallest standard deviations, NaN for what is not identifiable, shape (n,)."""
    solution = information.solve()
    return np.where(solution.free, np.nan, np.sqrt(np.diag(solution.inverse)))
