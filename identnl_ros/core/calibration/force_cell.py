# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Gain, delay and front mass of a force cell that shakes known masses, or nothing at all.

A cell reads the force on what is in front of it plus the front mass times the acceleration. Of a
mass that hangs freely on it, both together are ``gain (mass + front_mass) acceleration``: the
response in kilograms is a line over the mass, with the gain as its slope.

"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from identnl_ros.core.calibration.findings import Calibrated, Findings, Property, Undetermined
from identnl_ros.core.calibration.known_input import channel_of
from identnl_ros.core.calibration.motion_calibration import calibrate_motion, STATED_NOISE
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.coefficients import Coefficient
from identnl_ros.core.mechanics.machine import Body, Machine
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Reals = NDArray[np.float64]

# Chance that masses and readings that agree are said not to.
FALSE_ALARM = 1e-3
# Standard errors below zero from which on a front mass is wrong rather than small.
BELOW_ZERO = 3.0
# Masses that differ by less than this share are the same.
SAME = 1e-6
_MASS = 'mass'


@dataclass(frozen=True)
class KnownMass:
    """
    A mass that hangs freely on a force cell.

    Parameters
    ----------
    cell : str
    mass : float
        Without the cell's own front mass, with all else that moves in front of it [kg]; 0:
        nothing hangs there, the cell itself is shaken.
    accelerometers : tuple of str
        Trusted sensors on the mass, along the axis of the cell.
    relative_error : float
        Standard uncertainty of the mass over it.
    standard : str
        What the uncertainty comes from, which others may have in common; empty: this mass.

    """

    cell: str
    mass: float
    accelerometers: tuple[str, ...]
    relative_error: float = 0.0
    standard: str = ''


@dataclass(frozen=True)
class ShakenMass:
    """
    Records of a known mass on a force cell.

    Parameters
    ----------
    known : KnownMass
    records : iterable of MeasuredRecord
        Iterated over several times.
    layout : Layout
        By which the samples are SI.

    """

    known: KnownMass
    records: Iterable[MeasuredRecord]
    layout: Layout


@dataclass(frozen=True)
class _Response:
    """Force per acceleration of one mass [kg], by the layout's gain."""

    mass: float
    value: float
    errors: dict[str, float]
    delay: Calibrated | None
    findings: Findings


def calibrate_force_cell(
    shaken: Sequence[ShakenMass],
    noise_uncertainty: float = STATED_NOISE,
    gain_errors: Mapping[str, Mapping[str, float]] | None = None,
) -> Findings:
    """
    Find gain, delay and front mass of a force cell from masses that it shakes.

    One mass tells the gain, with the front mass that the layout states. Different masses tell
    gain and front mass; the cell shaken alone, without any mass, tells the front mass, with the
    gain that the layout states.

    Parameters
    ----------
    shaken : sequence of ShakenMass
        On one cell.
    noise_uncertainty : float
        Relative uncertainty of the noise.
    gain_errors : mapping of str to mapping of str to float
        Uncertainty of the accelerometers' gains, and of the cell's where it is trusted; see
        `calibrate_motion`.

    Returns
    -------
    Findings
        The sign of the gain is left as it is.

    Raises
    ------
    DataError
        If a sensor is none, or nothing moves.

    """
    gain_errors = gain_errors or {}
    known = [one.known for one in shaken]
    responses = [
        _response(one, i, noise_uncertainty, gain_errors) for i, one in enumerate(shaken, start=1)
    ]
    findings = sum((one.findings for one in responses), Findings())
    if any(np.isnan(one.value) for one in responses):
        return findings
    cell = shaken[0].layout.sensors[channel_of(shaken[0].layout, known[0].cell)]
    masses = np.array([one.mass for one in known])
    differ = bool(np.ptp(masses) > SAME * masses.max())
    fit = _line(responses, known, None if differ or not masses.any() else cell.front_mass)
    found: list[Calibrated] = []
    if masses.any():
        gain = {name: cell.gain * error for name, error in fit.gain_errors.items()}
        found.append(_calibrated(cell, Property.GAIN, cell.gain * fit.gain, gain))
    else:
        # What is too high in the gain as stated makes the front mass too small.
        of_gain = {
            name: -fit.front_mass * error for name, error in gain_errors.get(cell.name, {}).items()
        }
        fit = replace(fit, front_mass_errors=fit.front_mass_errors | of_gain)
    delays = [one.delay for one in responses if one.delay is not None]
    if delays:
        found.append(_mean(delays))
    undetermined = [] if delays else list(dict.fromkeys(findings.undetermined))
    doubts = list(fit.doubts)
    if differ or not masses.any():
        front = _calibrated(cell, Property.FRONT_MASS, fit.front_mass, fit.front_mass_errors)
        text = f'{front.value:.3g} +- {front.standard_error:.2g} kg'
        if front.value >= 0:
            found.append(front)
        elif front.value > -BELOW_ZERO * front.standard_error:
            reason = f'{text} is not to be told from 0'
            undetermined.append(Undetermined(cell.name, Property.FRONT_MASS, reason))
        else:
            doubts.append(
                f'{cell.name}: its front mass comes out as {text}; a mass or a gain is wrong.'
            )
    remarks = (*findings.remarks, *_remarks(cell, known, differ, gain_errors))
    return Findings(tuple(found), tuple(undetermined), remarks, (*findings.doubts, *doubts))


@dataclass(frozen=True)
class _Line:
    """Gain factor and front mass [kg], their errors by what they come from."""

    gain: float
    front_mass: float
    gain_errors: dict[str, float]
    front_mass_errors: dict[str, float]
    doubts: tuple[str, ...]


def _line(
    responses: Sequence[_Response], known: Sequence[KnownMass], front_mass: float | None
) -> _Line:
    """
    Fit ``response = gain mass + gain front_mass`` by generalised least squares.

    With a front mass the gain alone is fitted; without any mass, the front mass alone.
    """
    masses = np.array([one.mass for one in known])
    values = np.array([one.value for one in responses])
    if front_mass is not None:
        table = (masses + front_mass)[:, np.newaxis]
    elif masses.any():
        table = np.stack((masses, np.ones(len(masses))), axis=1)
    else:
        table = np.ones((len(masses), 1))
    slope = float(np.linalg.lstsq(table, values, rcond=None)[0][0])
    errors: list[dict[str, float]] = []
    for one, response in zip(known, responses, strict=True):
        of_mass = {}
        if one.relative_error and one.mass:
            name = one.standard or f'mass of {one.mass:g} kg on {one.cell}'
            of_mass[name] = slope * one.mass * one.relative_error
        errors.append(_sum(response.errors, of_mass))
    names = tuple(dict.fromkeys(name for one in errors for name in one))
    spread = np.array([[one.get(name, 0.0) for name in names] for one in errors])
    weights = np.linalg.inv(spread @ spread.T)
    solve = np.linalg.solve(table.T @ weights @ table, table.T @ weights)
    fitted = solve @ values
    of_fitted = solve @ spread
    rest = values - table @ fitted
    freedom = len(values) - len(fitted)
    doubts: tuple[str, ...] = ()
    if freedom and (cost := float(rest @ weights @ rest)) > chi2.isf(FALSE_ALARM, freedom):
        doubts = (
            f'{known[0].cell}: the masses do not agree with one another by '
            f'{np.sqrt(cost / freedom):.2g} standard errors; a mass, an accelerometer or its '
            'uncertainty is wrong.',
        )
    gain, of_gain = (fitted[0], of_fitted[0]) if masses.any() else (1.0, 0 * of_fitted[0])
    if front_mass is None:
        front_mass = float(fitted[-1] / gain)
        of_front = (of_fitted[-1] - front_mass * of_gain) / gain
    else:
        of_front = 0 * of_gain
    return _Line(
        float(gain), front_mass, dict(zip(names, of_gain.tolist(), strict=True)),
        dict(zip(names, of_front.tolist(), strict=True)), doubts,
    )  # fmt: skip


def _response(
    shaken: ShakenMass,
    number: int,
    noise_uncertainty: float,
    gain_errors: Mapping[str, Mapping[str, float]],
) -> _Response:
    """Compare force over mass with the accelerometers; both have noise."""
    known, layout = shaken.known, shaken.layout
    channels = [channel_of(layout, name) for name in (known.cell, *known.accelerometers)]
    sensors = [layout.sensors[channel] for channel in channels]
    for sensor, kind in zip(
        sensors, [SensorKind.FORCE] + [SensorKind.ACCELERATION] * (len(sensors) - 1), strict=True
    ):
        if sensor.kind is not kind:
            raise DataError(
                f'{sensor.name}: measures {sensor.kind.value}, expected a sensor of {kind.value}; '
                'a known mass goes with a force cell and accelerometers on the mass'
            )
    about = _about(shaken.records, channels)
    axial = Layout(tuple(_axial(one, 1.0 if i else about) for i, one in enumerate(sensors)))
    body = Body(_MASS, Coefficient(about), np.zeros(3), None, ('translation_1',))
    found = calibrate_motion(
        assemble(Machine(_MASS, (body,), ())),
        _Axial(shaken.records, channels, axial, about),
        axial,
        known.accelerometers,
        (Property.GAIN, Property.DELAY),
        noise_uncertainty,
        gain_errors=gain_errors,
    )
    gain = next((one for one in found.calibrated if one.what is Property.GAIN), None)
    delay = next((one for one in found.calibrated if one.what is Property.DELAY), None)
    value, errors = float('nan'), {}
    if gain is not None:
        value = about * gain.value / gain.before
        errors = {
            name if name in gain.shares else f'record {number} of {known.cell}': value * error
            for name, error in gain.relative_errors.items()
        }
    remarks = tuple(f'{known.cell} with {known.mass:g} kg: {one}' for one in found.remarks)
    return _Response(
        known.mass, value, errors, delay, replace(found, calibrated=(), remarks=remarks)
    )


def _about(records: Iterable[MeasuredRecord], channels: Sequence[int]) -> float:
    """Give force over acceleration to begin with, whichever way round they are mounted [kg]."""
    products = np.zeros(2)
    for record in records:
        force, acceleration = record.samples[:, channels[:2]].T
        valid = np.isfinite(force) & np.isfinite(acceleration)
        if not valid.any():
            continue
        force, acceleration = (
            one[valid] - one[valid].mean() for one in (force, acceleration)
        )  # fmt: skip
        products += acceleration @ force, acceleration @ acceleration
    if not products.all():
        raise DataError('known mass: force cell or accelerometer show no motion; excite the cell')
    return float(abs(products[0] / products[1]))


@dataclass(frozen=True)
class _Axial:
    """Records of the cell and the accelerometers as accelerations along one axis."""

    records: Iterable[MeasuredRecord]
    channels: Sequence[int]
    layout: Layout
    mass: float

    def __iter__(self) -> Iterator[MeasuredRecord]:
        for record in self.records:
            samples = record.samples[:, self.channels].copy()
            samples[:, 0] /= self.mass
            steady = samples - np.nanmean(samples, axis=0)
            # Which way round an accelerometer is mounted is not the question.
            turned = np.nansum(steady[:, :1] * steady, axis=0) < 0
            yield replace(record, layout=self.layout, samples=np.where(turned, -samples, samples))


def _axial(sensor: Sensor, mass: float) -> Sensor:
    return replace(
        sensor, kind=SensorKind.ACCELERATION, body=_MASS, excitation='', point=np.zeros(3),
        direction=np.array([1.0, 0.0, 0.0]), noise=sensor.noise / mass,
        resolution=sensor.resolution / mass, reads_gravity=False, front_mass=0.0,
    )  # fmt: skip


def _calibrated(
    cell: Sensor, what: Property, value: float, errors: Mapping[str, float]
) -> Calibrated:
    before = getattr(cell, what.value)
    error = float(np.linalg.norm(list(errors.values())))
    return Calibrated(cell.name, what, before, value, error, shares=errors)


def _mean(delays: Sequence[Calibrated]) -> Calibrated:
    """Weigh the delays of several records by their standard errors."""
    weights = np.array([one.standard_error for one in delays]) ** -2
    value = float(weights @ [one.value for one in delays] / weights.sum())
    return replace(delays[0], value=value, standard_error=float(weights.sum() ** -0.5), shares={})


def _sum(one: Mapping[str, float], other: Mapping[str, float]) -> dict[str, float]:
    return {name: one.get(name, 0.0) + other.get(name, 0.0) for name in (*one, *other)}


def _remarks(
    cell: Sensor,
    known: Sequence[KnownMass],
    differ: bool,
    gain_errors: Mapping[str, Mapping[str, float]],
) -> Iterator[str]:
    """Say what the standard errors do not contain, and what counts as gain."""
    exact = sorted({f'{one.mass:g} kg' for one in known if one.mass and not one.relative_error})
    if exact:
        yield (
            f'{cell.name}: the uncertainty of {", ".join(exact)} is not given; standard errors do '
            'not contain it.'
        )
    if not any(one.mass for one in known):
        if not gain_errors.get(cell.name):
            yield (
                f'{cell.name}: the uncertainty of its gain is not given; the standard error of '
                'the front mass does not contain it.'
            )
    elif not differ and not cell.front_mass:
        yield (
            f'{cell.name}: the layout states no front mass; the mass between the sensing element '
            f'and the {known[0].mass:g} kg counts as part of the gain. Another mass, or the cell '
            'shaken alone (0 kg), tells it.'
        )
