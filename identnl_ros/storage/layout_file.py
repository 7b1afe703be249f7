# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The layout file: the sensors of a stand as YAML."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.mechanics.joints import GROUND
from identnl_ros.core.mechanics.machine import STANDARD_GRAVITY
from identnl_ros.storage.quantities import (
    convert,
    Direction,
    Frequency,
    Gravity,
    Position,
    Quantity,
    same_dimension,
    shown,
    UnitError,
)
from identnl_ros.storage.triaxial_sensors import with_single_axes
from identnl_ros.storage.yaml_reading import (
    Document,
    KeyProblem,
    KIND,
    located,
    Name,
    parse,
    read_text,
    StrictModel,
    together,
    with_kind,
)
import numpy as np
from pydantic import BeforeValidator, Field, PlainValidator

Value = TypeVar('Value')

_TIME = Quantity('s', 'a time such as "25 us"')
_MASS = Quantity('kg', 'a mass such as "35 g"')
_PROBABILITY = Quantity('', 'a probability such as 0.001')
# What is measured, an example of a small amount, an example of a gain.
_WORDS = {
    SensorKind.FORCE: ('a force', '0.2 N', '1 V/N'),
    SensorKind.DISPLACEMENT: ('a length', '10 nm', '0.08 V/um'),
    SensorKind.VELOCITY: ('a velocity', '2 um/s', '0.5 V/(mm/s)'),
    SensorKind.ACCELERATION: ('an acceleration', '0.01 m/s^2', '10 mV/(m/s^2)'),
}


def _yes_or_no(value: object) -> bool:
    if value not in ('true', 'false'):
        raise ValueError(f'found {shown(value)}, expected true or false')
    return value == 'true'


YesOrNo = Annotated[bool, PlainValidator(_yes_or_no)]


class _Quality(StrictModel):
    """How a channel records; texts, because their units depend on each other."""

    unit: str = ''
    gain: str = ''
    offset: str = '0'
    drift: str = '0'
    delay: str = '0'
    noise: str = ''
    resolution: str = '0'
    dropout_probability: str = '0'
    full_scale: str = ''


class _AccelerationQuality(_Quality):
    reads_gravity: YesOrNo = False


class _Defaults(StrictModel):
    force: _Quality = _Quality()
    displacement: _Quality = _Quality()
    velocity: _Quality = _Quality()
    acceleration: _AccelerationQuality = _AccelerationQuality()


_KEYS_OF_DEFAULTS = {
    kind: tuple(type(field.default).model_fields) for kind, field in _Defaults.model_fields.items()
}


class _Channel(_Quality):
    """Keys of every sensor."""

    column: str = ''

    def _quality(self, kind: SensorKind) -> dict[str, Any]:
        """Fields of a `Sensor` that do not depend on where it is."""
        unit = _checked('unit', lambda: _recorded_unit(self.unit, kind))
        gain = _checked('gain', lambda: _gain(self.gain, unit, kind))
        offset = Quantity(unit, f'a recorded value such as "0.1 {unit}"')
        per_second = f'({unit})/s'
        drift = Quantity(per_second, f'a rate of the recorded value such as "0.1 {per_second}"')
        return {
            'kind': kind,
            'column': self.column,
            'recorded_unit': unit,
            'gain': gain,
            'offset': _checked('offset', lambda: offset.number(self.offset)),
            'drift': _checked('drift', lambda: drift.number(self.drift)),
            'delay': _checked('delay', lambda: _TIME.number(self.delay)),
            'noise': _checked('noise', lambda: _noise(self.noise, unit, gain, kind)),
            'resolution': _checked(
                'resolution', lambda: _amount(self.resolution, unit, gain, kind)
            ),
            'dropout_probability': _checked(
                'dropout_probability', lambda: _PROBABILITY.number(self.dropout_probability)
            ),
            'full_scale': _checked(
                'full_scale', lambda: _full_scale(self.full_scale, unit, gain, kind)
            ),
        }


class _ForceSensor(_Channel):
    kind: Literal['force']
    excitation: Name
    front_mass: Annotated[float, PlainValidator(_MASS.number)] = 0.0

    def build(self, name: str) -> Sensor:
        return Sensor(
            name,
            excitation=self.excitation,
            front_mass=self.front_mass,
            **self._quality(SensorKind.FORCE),
        )


class _Accelerometer(_Channel, _AccelerationQuality):
    kind: Literal['acceleration']
    body: Name
    point: Position
    direction: Direction

    def build(self, name: str) -> Sensor:
        return Sensor(
            name,
            body=self.body,
            point=self.point,
            direction=self.direction,
            reads_gravity=self.reads_gravity,
            **self._quality(SensorKind.ACCELERATION),
        )


class _Probe(_Channel):
    kind: Literal['displacement', 'velocity']
    body: Name
    relative_to: Name = GROUND
    point: Position
    direction: Direction

    def build(self, name: str) -> Sensor:
        return Sensor(
            name,
            body=self.body,
            reference_body='' if self.relative_to == GROUND else self.relative_to,
            point=self.point,
            direction=self.direction,
            **self._quality(SensorKind(self.kind)),
        )


# Keys that may differ among the axes of a triaxial sensor.
_OF_AXIS = (*_Channel.model_fields, 'reads_gravity', 'direction')

_AnySensor = _ForceSensor | _Probe | _Accelerometer


class _Layout(StrictModel):
    stand: Name = 'stand'
    sample_rate: Frequency | None = None
    gravity: Gravity = Field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    defaults: _Defaults = _Defaults()
    sensors: dict[
        Name,
        Annotated[_AnySensor, Field(discriminator=KIND), BeforeValidator(with_kind)],
    ]


@dataclass(frozen=True)
class LayoutFile:
    """
    A sensor layout and the text it was read from.

    Parameters
    ----------
    path : Path
    text : str
        Whole content; bags carry it, so that they stay readable when the file changes.
    layout : Layout

    """

    path: Path
    text: str
    layout: Layout


def load_layout(path: str | Path) -> LayoutFile:
    """
    Read a layout file.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    LayoutFile

    Raises
    ------
    LayoutError
        If the file cannot be read or does not describe sensors; names file, line and key.

    """
    path = Path(path)
    text = read_text(path, LayoutError)
    return LayoutFile(path, text, read_layout(text, str(path)))


def read_layout(text: str, where: str) -> Layout:
    """
    Read a layout from the text of a layout file.

    Parameters
    ----------
    text : str
    where : str
        Where the text comes from, for errors.

    Returns
    -------
    Layout

    Raises
    ------
    LayoutError
        If the text does not describe sensors; names `where`, line and key of every problem,
        each in a line of its own.

    """
    document = with_single_axes(parse(text, where, LayoutError), _OF_AXIS)
    document = _with_defaults(document)
    model = document.validated(_Layout)
    sensors = []
    errors: dict[str, LayoutError] = {}
    for name, entry in model.sensors.items():
        try:
            sensors.append(_sensor(name, entry, document))
        except LayoutError as error:
            # A wrong default is told once.
            errors.setdefault(str(error).replace(f'.{name}.', '.'), error)
    if errors:
        raise together(list(errors.values()))
    with located(document, {}):
        return Layout(tuple(sensors), model.stand, model.sample_rate, model.gravity)


def default_layout_path(machine_path: str | Path) -> Path:
    """
    Where the layout of a machine is looked for when none is named.

    Parameters
    ----------
    machine_path : str or Path
        E.g. ``knee_column.yaml``.

    Returns
    -------
    Path
        Beside it, e.g. ``knee_column_layout.yaml``.

    """
    path = Path(machine_path)
    return path.with_name(f'{path.stem}_layout.yaml')


def _sensor(name: str, entry: _AnySensor, document: Document) -> Sensor:
    try:
        with located(document, {'sensor': 'sensors'}):
            return entry.build(name)
    except KeyProblem as problem:
        path = ('sensors', name, problem.key)
        raise document.problem(path, str(problem)) from None


def _with_defaults(document: Document) -> Document:
    """Copy the defaults of its kind into every sensor; errors keep pointing at the default."""
    defaults, sensors = (_mapping(document.data.get(key)) for key in ('defaults', 'sensors'))
    lines = dict(document.lines)
    filled = {}
    for name, sensor in sensors.items():
        kind = str(_mapping(sensor).get(KIND))
        allowed = _KEYS_OF_DEFAULTS.get(kind, ())
        added = {
            key: value
            for key, value in _mapping(defaults.get(kind)).items()
            if key in allowed and key not in sensor
        }
        for key in added:
            lines['sensors', name, key] = lines['defaults', kind, key]
        filled[name] = {**sensor, **added} if added else sensor
    data = {**document.data, 'sensors': filled} if sensors else document.data
    return replace(document, data=data, lines=lines)


def _mapping(data: object) -> dict[str, Any]:
    """Return the data if they are a mapping; else nothing, validation will complain."""
    return data if isinstance(data, dict) else {}


def _checked(key: str, read: Callable[[], Value]) -> Value:
    """Name the key in the error."""
    try:
        return read()
    except ValueError as error:
        raise KeyProblem(key, str(error)) from None


def _recorded_unit(text: str, kind: SensorKind) -> str:
    unit = text.strip() or kind.unit
    try:
        is_mass = same_dimension(unit, 'kg')
    except UnitError:
        raise ValueError(
            f'found {shown(text)}, which is no known unit; expected that of the recorded '
            f'numbers, e.g. "{kind.unit}" or "V" ("count" for steps of a converter)'
        ) from None
    if is_mass and kind is SensorKind.ACCELERATION:
        raise ValueError(f'found {shown(text)}, which is a mass; gravity is written "g_0"')
    return unit


def _gain(text: str, unit: str, kind: SensorKind) -> float:
    """Find recorded unit per SI unit; where `unit` tells it, the file has a mere correction."""
    if same_dimension(unit, kind.unit):
        correction = Quantity('', f'a plain factor such as 0.98, for the unit is "{unit}"')
        return convert(1.0, kind.unit, unit) * correction.number(text or '1')
    measured, _, example = _WORDS[kind]
    expected = f'a gain from {measured} to "{unit}", with its unit, such as "{example}"'
    if _is_bare(text):
        raise ValueError(f'found {shown(text)}, expected {expected}')
    return Quantity(f'({unit})/({kind.unit})', expected).number(text)


def _noise(text: str, unit: str, gain: float, kind: SensorKind) -> float:
    """Not stated: not known, which differs from 0."""
    return _amount(text, unit, gain, kind) if text else float('nan')


def _amount(text: str, unit: str, gain: float, kind: SensorKind) -> float:
    """In the unit of the quantity, or in the recorded unit through the gain; SI."""
    measured, example, _ = _WORDS[kind]
    expected = f'{measured} such as "{example}", or a value in "{unit}"'
    try:
        return Quantity(kind.unit, expected).number(text)
    except ValueError as error:
        try:
            return Quantity(unit, expected).number(text) / abs(gain)
        except ValueError:
            raise error from None


def _full_scale(text: str, unit: str, gain: float, kind: SensorKind) -> float:
    """In the recorded unit, or in the unit of the quantity through the gain; recorded unit."""
    if not text:
        return float('nan')
    measured, example, _ = _WORDS[kind]
    expected = f'a recorded value such as "10 {unit}", or {measured} such as "{example}"'
    try:
        return Quantity(unit, expected).number(text)
    except ValueError:
        return Quantity(kind.unit, expected).number(text) * abs(gain)


def _is_bare(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
