# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What a calibration finds: numbers with errors, and what the data do not tell."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

from identnl_ros.core.measurement.layout import Layout, Sensor
import numpy as np
from numpy.typing import NDArray

# Differences from the layout of more standard errors than this are worth a look.
CONSPICUOUS = 5.0


class Property(Enum):
    """A property of a sensor that can be calibrated."""

    GAIN = 'gain'
    DIRECTION = 'direction'
    DELAY = 'delay'
    OFFSET = 'offset'
    NOISE = 'noise'
    RESOLUTION = 'resolution'
    FRONT_MASS = 'front_mass'


@dataclass(frozen=True)
class Calibrated:
    """
    One number of one sensor.

    Parameters
    ----------
    sensor : str
    what : Property
    before : float
        What the layout says: gain [recorded unit per SI], offset [recorded unit], others [SI];
        NaN: nothing. A direction's angle counts from the layout's direction: 0.
    value : float
        In the same unit; of a direction the angle towards `axis` [rad].
    standard_error : float
        In the same unit; NaN: not known.
    axis : ndarray, shape (3,)
        Of a direction: the unit vector, across the layout's direction, that it leans to.
    shares : mapping of str to float
        What the uncertainty of each reference adds to the error, by the reference's name: the
        error, with its sign, for one standard deviation. They are part of the standard error,
        and what numbers have of one reference in common.

    """

    sensor: str
    what: Property
    before: float
    value: float
    standard_error: float
    axis: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    shares: Mapping[str, float] = field(default_factory=dict)

    @property
    def deviation(self) -> float:
        """Difference from the layout in standard errors; NaN: not known."""
        if not self.standard_error > 0:
            return float('nan')
        return (self.value - self.before) / self.standard_error

    @property
    def own_error(self) -> float:
        """The standard error without the references' shares."""
        of_references = sum(share**2 for share in self.shares.values())
        return float(np.sqrt(max(self.standard_error**2 - of_references, 0.0)))

    @property
    def relative_errors(self) -> dict[str, float]:
        """Errors over the value for one standard deviation, by what they come from."""
        errors = {f'record of {self.sensor}': self.own_error, **self.shares}
        return {name: error / self.value for name, error in errors.items() if error}

    @property
    def conspicuous(self) -> bool:
        """Whether the layout said something clearly different."""
        return abs(self.deviation) > CONSPICUOUS


@dataclass(frozen=True)
class Undetermined:
    """
    A property of a sensor that the data do not tell, and which stays as it is.

    Parameters
    ----------
    sensor : str
    what : Property
    reason : str
        In words.

    """

    sensor: str
    what: Property
    reason: str


@dataclass(frozen=True)
class Findings:
    """
    Result of one part of a calibration.

    Parameters
    ----------
    calibrated : tuple of Calibrated
    undetermined : tuple of Undetermined
    remarks : tuple of str
        What bears on trust, in sentences.
    doubts : tuple of str
        Why the numbers should not be used, in sentences; empty: they agree.

    """

    calibrated: tuple[Calibrated, ...] = ()
    undetermined: tuple[Undetermined, ...] = ()
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    def __add__(self, other: 'Findings') -> 'Findings':
        """Join two results."""
        return Findings(
            self.calibrated + other.calibrated,
            self.undetermined + other.undetermined,
            self.remarks + other.remarks,
            self.doubts + other.doubts,
        )


def corrected_layout(layout: Layout, calibrated: Iterable[Calibrated]) -> Layout:
    """
    Put what was found in the place of what the layout says.

    Parameters
    ----------
    layout : Layout
    calibrated : iterable of Calibrated

    Returns
    -------
    Layout

    """
    of_sensor: dict[str, list[Calibrated]] = {}
    for one in calibrated:
        of_sensor.setdefault(one.sensor, []).append(one)
    return replace(
        layout,
        sensors=tuple(_corrected(one, of_sensor.get(one.name, [])) for one in layout.sensors),
    )


def _corrected(sensor: Sensor, calibrated: list[Calibrated]) -> Sensor:
    changes: dict[str, object] = {}
    direction = sensor.direction
    for one in calibrated:
        if one.what is Property.DIRECTION:
            direction = direction + np.tan(one.value) * one.axis
            changes['direction'] = direction / np.linalg.norm(direction)
        else:
            changes[one.what.value] = one.value
    return replace(sensor, **changes) if changes else sensor  # type: ignore[arg-type]
