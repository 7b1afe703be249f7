# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The sensor layout: what every channel of a stand measures, where and how well."""

from dataclasses import dataclass, field, replace
from enum import Enum

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.mechanics.machine import STANDARD_GRAVITY
import numpy as np
from numpy.typing import NDArray


class SensorKind(Enum):
    """Physical quantity a sensor measures."""

    FORCE = 'force'
    DISPLACEMENT = 'displacement'
    VELOCITY = 'velocity'
    ACCELERATION = 'acceleration'

    @property
    def unit(self) -> str:
        """SI unit of the quantity."""
        return _UNITS[self]


_UNITS = {
    SensorKind.FORCE: 'N',
    SensorKind.DISPLACEMENT: 'm',
    SensorKind.VELOCITY: 'm/s',
    SensorKind.ACCELERATION: 'm/s^2',
}

RELATIVE_KINDS = (SensorKind.DISPLACEMENT, SensorKind.VELOCITY)


@dataclass(frozen=True)
class Sensor:
    """
    One channel: a scalar measurement.

    ``recorded = gain * quantity(t - delay) + offset + noise``.

    Parameters
    ----------
    name : str
        Unique in the layout.
    kind : SensorKind
    body : str
        Body the sensor sits on; empty for a force sensor.
    point : ndarray, shape (3,)
        Measuring point, machine frame [m]; not used by a force sensor.
    direction : ndarray, shape (3,)
        Positive direction, machine frame; normalised here; not used by a force sensor.
    reference_body : str
        Body a relative probe measures against; empty: the inertial frame.
    excitation : str
        Excitation point of the machine whose force a force sensor measures.
    column : str
        Column of the recorded file or channel of the device; empty: the sensor's name.
    recorded_unit : str
        Unit of the recorded numbers, e.g. ``V``.
    gain : float
        Recorded unit per SI unit.
    offset : float
        Recorded value at zero [recorded unit].
    drift : float
        Growth of the offset since the begin of the stream [recorded unit per s].
    full_scale : float
        Recorded values of at least this size are saturated [recorded unit]; NaN: not known.
    delay : float
        The recorded value shows the quantity this long before its time stamp [s].
    noise : float
        Standard deviation of one sample, white [SI unit]; NaN: not known; 0: none.
    resolution : float
        Step of the analogue-to-digital conversion [SI unit]; 0: none.
    dropout_probability : float
        Chance that a sample is lost, used by the simulated stand [-].
    reads_gravity : bool
        Acceleration only: the sensor measures specific force, that is acceleration minus
        gravity, as an accelerometer that responds to constant acceleration does.
    front_mass : float
        Force only: mass between the sensing element and the structure, which moves with the
        structure [kg].

    Raises
    ------
    LayoutError
        If a number is out of its range or a direction is zero.

    """

    name: str
    kind: SensorKind
    body: str = ''
    point: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    direction: NDArray[np.float64] = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    reference_body: str = ''
    excitation: str = ''
    column: str = ''
    recorded_unit: str = ''
    gain: float = 1.0
    offset: float = 0.0
    drift: float = 0.0
    delay: float = 0.0
    noise: float = float('nan')
    resolution: float = 0.0
    dropout_probability: float = 0.0
    full_scale: float = float('nan')
    reads_gravity: bool = False
    front_mass: float = 0.0

    def __post_init__(self) -> None:
        """Check ranges, normalise the direction, fill in defaults."""
        where = f'sensor {self.name}'
        if self.kind is SensorKind.FORCE:
            if not self.excitation:
                raise LayoutError(
                    f'{where}: a force sensor needs the name of its excitation point '
                    '(key excitation)'
                )
        elif not self.body:
            raise LayoutError(
                f'{where}: a {self.kind.value} sensor needs the body it sits on (key body)'
            )
        if self.reference_body and self.kind not in RELATIVE_KINDS:
            raise LayoutError(
                f'{where}: only displacement and velocity can be measured against another body, '
                f'found kind {self.kind.value}'
            )
        if self.reference_body and self.reference_body == self.body:
            raise LayoutError(f'{where}: measures {self.body} against itself')
        for name in ('point', 'direction'):
            if getattr(self, name).shape != (3,) or not np.all(np.isfinite(getattr(self, name))):
                raise LayoutError(f'{where}: {name} must be three finite numbers')
        length = float(np.linalg.norm(self.direction))
        if length < 1e-12:
            raise LayoutError(f'{where}: direction is zero, expected a vector of any length')
        # A unit vector stays what it is to the last bit.
        if abs(length - 1) > 1e-15:
            object.__setattr__(self, 'direction', self.direction / length)
        if not np.isfinite(self.gain) or self.gain == 0:
            raise LayoutError(f'{where}: gain is {self.gain}, expected a finite number, not 0')
        if not np.isfinite([self.offset, self.drift, self.delay]).all():
            raise LayoutError(f'{where}: offset, drift and delay must be finite numbers')
        for name in ('noise', 'resolution'):
            if getattr(self, name) < 0 or np.isinf(getattr(self, name)):
                raise LayoutError(
                    f'{where}: {name} is {getattr(self, name)}, expected 0 or a positive number'
                )
        if not 0 <= self.dropout_probability < 1:
            raise LayoutError(
                f'{where}: dropout_probability is {self.dropout_probability}, '
                'expected at least 0 and less than 1'
            )
        if self.full_scale <= 0 or np.isinf(self.full_scale):
            raise LayoutError(
                f'{where}: full_scale is {self.full_scale}, expected a positive number'
            )
        if self.reads_gravity and self.kind is not SensorKind.ACCELERATION:
            raise LayoutError(
                f'{where}: only an accelerometer can read gravity, found kind {self.kind.value}'
            )
        if not (np.isfinite(self.front_mass) and self.front_mass >= 0):
            raise LayoutError(
                f'{where}: front_mass is {self.front_mass} kg, expected 0 or a positive number'
            )
        if self.front_mass and self.kind is not SensorKind.FORCE:
            raise LayoutError(
                f'{where}: only a force sensor has a mass in front, found kind {self.kind.value}'
            )
        object.__setattr__(self, 'column', self.column or self.name)
        object.__setattr__(self, 'recorded_unit', self.recorded_unit or self.kind.unit)

    def to_si(
        self, recorded: NDArray[np.float64], time: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """
        Convert recorded numbers to the SI unit of the quantity.

        Parameters
        ----------
        recorded : ndarray
            [recorded unit].
        time : ndarray
            The same shape, since the begin of the stream [s].

        Returns
        -------
        ndarray
            The same shape [SI unit].

        """
        return (recorded - self.offset - self.drift * time) / self.gain

    def to_recorded(
        self, quantity: NDArray[np.float64], time: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """
        Convert SI values to recorded numbers.

        Parameters
        ----------
        quantity : ndarray
            [SI unit].
        time : ndarray
            The same shape, since the begin of the stream [s].

        Returns
        -------
        ndarray
            The same shape [recorded unit].

        """
        return self.gain * quantity + self.offset + self.drift * time


@dataclass(frozen=True)
class Layout:
    """
    All sensors of a stand, in the order of the channels.

    Parameters
    ----------
    sensors : tuple of Sensor
    stand : str
        Name of the stand.
    sample_rate : float or None
        Sample rate of recorded files that do not tell it themselves [Hz].
    gravity : ndarray, shape (3,)
        Gravitational acceleration in the machine frame, for sensors that read it [m/s^2].

    Raises
    ------
    LayoutError
        If there is no sensor or two share a name.

    """

    sensors: tuple[Sensor, ...]
    stand: str = 'stand'
    sample_rate: float | None = None
    gravity: NDArray[np.float64] = field(default_factory=lambda: np.array(STANDARD_GRAVITY))

    def __post_init__(self) -> None:
        """Check what every consumer relies on."""
        if not self.sensors:
            raise LayoutError('layout: no sensors; list at least one under the key sensors')
        names = [sensor.name for sensor in self.sensors]
        for name in names:
            if names.count(name) > 1:
                raise LayoutError(f'layout: two sensors are called {name}; names must differ')
        if self.gravity.shape != (3,) or not np.isfinite(self.gravity).all():
            raise LayoutError('layout: gravity must be three finite numbers')
        if self.sample_rate is not None and not (
            np.isfinite(self.sample_rate) and self.sample_rate > 0
        ):
            raise LayoutError(
                f'layout: sample_rate is {self.sample_rate}, expected a positive number'
            )

    def of_kind(self, kind: SensorKind) -> tuple[int, ...]:
        """
        Channels that measure a quantity.

        Parameters
        ----------
        kind : SensorKind

        Returns
        -------
        tuple of int
            Indices into `sensors`.

        """
        return tuple(i for i, sensor in enumerate(self.sensors) if sensor.kind is kind)

    def with_noise_times(self, factor: float) -> 'Layout':
        """
        Copy with every stated sensor noise multiplied.

        Parameters
        ----------
        factor : float
            0 for perfect sensors.

        Returns
        -------
        Layout

        """
        return replace(
            self,
            sensors=tuple(
                replace(sensor, noise=0.0 if factor == 0 else sensor.noise * factor)
                for sensor in self.sensors
            ),
        )
