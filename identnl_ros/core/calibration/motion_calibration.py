# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Gains, directions and delays of sensors against trusted ones, from rigid-body motion."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from identnl_ros.core.calibration.cross_spectra import cross_spectra, CrossSpectra
from identnl_ros.core.calibration.determinability import (
    LARGEST_ERROR,
    TOGETHER,
    told_combinations,
    too_uncertain,
    weak_parameters,
)
from identnl_ros.core.calibration.findings import Calibrated, Findings, Property, Undetermined
from identnl_ros.core.calibration.motion_likelihood import (
    ANGLES,
    DELAY,
    FIRST_ANGLE,
    GAIN,
    Likelihood,
    motion_likelihood,
    Parameter,
    SECOND_ANGLE,
    SensorState,
)
from identnl_ros.core.calibration.reference_gains import reference_gains, ReferenceGains
from identnl_ros.core.errors import DataError
from identnl_ros.core.measurement.layout import Layout, Sensor
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.measurement.observation import sensor_matrix
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.stand import MOTION_KINDS
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

ALL = frozenset({Property.GAIN, Property.DIRECTION, Property.DELAY})
MOST_STEPS = 30
# The readings are moved by the delays found and looked at again.
MOST_ROUNDS = 4
# A step below this share of a standard error ends the search.
ENOUGH = 1e-2
# Relative; a stated noise is taken as known to this.
STATED_NOISE = 0.1
# Standard deviations of the sum of squares that are allowed.
ALLOWED = 4.0

_WHAT = {
    GAIN: Property.GAIN,
    FIRST_ANGLE: Property.DIRECTION,
    SECOND_ANGLE: Property.DIRECTION,
    DELAY: Property.DELAY,
}


@dataclass
class _Fit:
    """The search: what is free, what not and why."""

    layout: Layout
    free: list[Parameter]
    hold_angles: bool
    references: ReferenceGains
    fixed: dict[Parameter, str] = field(default_factory=dict)
    lost: dict[Parameter, str] = field(default_factory=dict)
    covariance: Reals = field(default_factory=lambda: np.zeros((0, 0)))
    shares: Reals = field(default_factory=lambda: np.zeros((0, 0)))
    delay_unit: float = 1.0


@dataclass(frozen=True)
class _Settings:
    """What `calibrate_motion` was asked."""

    model: Model
    records: Iterable[MeasuredRecord]
    layout: Layout
    references: Collection[str]
    properties: Collection[Property]
    noise_uncertainty: float
    known_gains: Collection[str]
    gain_errors: Mapping[str, Mapping[str, float]]


def calibrate_motion(
    model: Model,
    records: Iterable[MeasuredRecord],
    layout: Layout,
    references: Collection[str],
    properties: Collection[Property] = ALL,
    noise_uncertainty: float = STATED_NOISE,
    known_gains: Collection[str] = (),
    gain_errors: Mapping[str, Mapping[str, float]] | None = None,
) -> Findings:
    """
    Estimate gains, directions and delays by maximum likelihood.

    Every reading is that of a rigid body's point. At every frequency the motion of the bodies
    is eliminated; gains, directions and delays maximise the likelihood of what is left under
    white sensor noise, by Gauss-Newton on cross-spectra. There is no prior but that of the
    references' gains, where their uncertainty is given: they are normally distributed.

    Parameters
    ----------
    model : Model
        Only its geometry matters.
    records : iterable of MeasuredRecord
        Iterated over several times; of `layout`, by whose gains the samples are SI.
    layout : Layout
        With the noise of the sensors where it is known.
    references : collection of str
        Sensors that are right.
    properties : collection of Property
        Of gain, direction, delay: what to estimate.
    noise_uncertainty : float
        Relative uncertainty of the noise, for the test whether all sensors agree.
    known_gains : collection of str
        Sensors whose gains are right.
    gain_errors : mapping of str to mapping of str to float
        Of references and known gains: how much the gain is too high, over it, for one standard
        deviation of each thing that it is uncertain by (see `Calibrated.shares`). Others are
        taken as exact.

    Returns
    -------
    Findings

    Raises
    ------
    DataError
        If there is no motion, or nothing to compare.

    """
    settings = _Settings(
        model, records, layout, references, properties, noise_uncertainty, known_gains,
        gain_errors or {},
    )  # fmt: skip
    fit, findings = _fitted(settings, hold_angles=False)
    if any(which in ANGLES for _, which in fit.lost) and not findings.doubts:
        # Where the machine moves too little to tell all, directions as stated tell the gains.
        _, held = _fitted(settings, hold_angles=True)
        if not held.doubts:
            return held
    return findings


def across(direction: Reals) -> Reals:
    """
    Two directions across another one, each as near to an axis of the machine as can be.

    Parameters
    ----------
    direction : ndarray, shape (3,)
        Of length 1.

    Returns
    -------
    ndarray, shape (2, 3)

    """
    first, second = np.delete(np.eye(3), int(np.argmax(np.abs(direction))), axis=0)
    first = first - direction * (direction @ first)
    first /= np.linalg.norm(first)
    second = second - direction * (direction @ second) - first * (first @ second)
    return np.stack((first, second / np.linalg.norm(second)))


def _fitted(asked: _Settings, hold_angles: bool) -> tuple[_Fit, Findings]:
    """Maximise the likelihood, with undetermined angles held as stated or left to themselves."""
    sensors = asked.layout.sensors
    state = _start(asked.model, asked.layout)
    free = [
        (channel, which)
        for channel, sensor in enumerate(sensors)
        if sensor.kind in MOTION_KINDS and sensor.name not in asked.references
        for which, what in _WHAT.items()
        if what in asked.properties and not (which == GAIN and sensor.name in asked.known_gains)
    ]
    trusted = {*asked.references, *asked.known_gains}
    fit = _Fit(
        asked.layout, free, hold_angles, reference_gains(asked.layout, trusted, asked.gain_errors)
    )
    taken_out = np.zeros(len(sensors))
    for _ in range(MOST_ROUNDS):
        spectra = [one.moving() for one in cross_spectra(asked.model, asked.records, taken_out)]
        _check(spectra, asked.layout)
        likelihood = _search(spectra, state, fit)
        moved = state.delays.copy()
        taken_out += moved
        state.delays[:] = 0.0
        errors = _errors(fit, DELAY, len(sensors))
        if np.all(np.abs(moved) <= np.where(errors > 0, 0.1 * errors, np.inf)):
            break
    state.delays[:] = taken_out
    agreement = _agreement(likelihood, asked.layout, asked.noise_uncertainty)
    return fit, replace(
        agreement,
        remarks=(*agreement.remarks, *fit.references.remarks),
        calibrated=tuple(_calibrated(fit, state)),
        undetermined=tuple(_undetermined(fit)),
    )


def _start(model: Model, layout: Layout) -> SensorState:
    """Begin with what the layout says."""
    sensors = layout.sensors
    points = np.zeros((len(sensors), 3, len(model.coordinates)))
    for i, sensor in enumerate(sensors):
        if sensor.kind in MOTION_KINDS:
            points[i] = sensor_matrix(model, _along_axes(sensor))
    directions = np.array([sensor.direction for sensor in sensors])
    axes = np.array([across(one) for one in directions])
    size = len(sensors)
    return SensorState(np.ones(size), directions, np.zeros(size), axes, points)


def _along_axes(sensor: Sensor) -> tuple[Sensor, ...]:
    return tuple(replace(sensor, direction=axis) for axis in np.eye(3))


def _check(spectra: Sequence[CrossSpectra], layout: Layout) -> None:
    if not any(len(one.frequencies) for one in spectra):
        raise DataError(
            'motion: no motion stands out of the noise, so that it tells nothing; excite the '
            'machine'
        )
    used = {channel for one in spectra for channel in one.channels.tolist()}
    silent = [layout.sensors[i].name for i in sorted(used) if layout.sensors[i].noise == 0]
    if silent:
        raise DataError(
            f'sensor {silent[0]}: the layout states no noise, so that errors cannot be told; '
            'state its noise, or give a quiet record'
        )


def _search(spectra: Sequence[CrossSpectra], state: SensorState, fit: _Fit) -> Likelihood:
    """Gauss-Newton, leaving out what the data do not tell."""
    power = sum(np.einsum('fcc,fc->f', one.sums, 1 / one.variance).real.sum() for one in spectra)
    squares = sum(
        float(one.frequencies**2 @ np.einsum('fcc,fc->f', one.sums, 1 / one.variance).real)
        for one in spectra
    )
    fit.delay_unit = float(np.sqrt(power / squares))
    start = [array.copy() for array in (state.gains, state.directions, state.delays)]
    references = fit.references
    for _ in range(MOST_STEPS):
        parameters = [*fit.free, *references.parameters]
        whole = motion_likelihood(spectra, state, parameters, fit.delay_unit)
        found = whole.first(len(fit.free))
        if weak := weak_parameters(found, state, fit.free):
            _fix(fit, state, weak, start)
            continue
        told, together = told_combinations(found)
        angles = [i for i in together if fit.free[i][1] in ANGLES]
        if angles and fit.hold_angles:
            _fix(fit, state, dict.fromkeys(angles, TOGETHER), start)
            continue
        fit.lost = {fit.free[i]: TOGETHER for i in together}
        step, covariance, shares = references.step(whole, told)
        units = np.array([fit.delay_unit if one[1] == DELAY else 1.0 for one in fit.free])
        # Of what is not told, rounding leaves a variance of either sign.
        errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        fit.covariance = covariance * np.outer(units, units)
        fit.shares = shares * units[:, np.newaxis]
        state.moved(fit.free, step[: len(units)] * units)
        references.moved(state, step[len(units) :])
        if np.all(np.abs(step[: len(units)]) <= ENOUGH * np.maximum(errors, 1e-9)):
            large = {
                i: too_uncertain(fit.free[i], float(error * units[i]))
                for i, error in enumerate(errors)
                if error > LARGEST_ERROR and i not in together
            }
            if not large:
                return motion_likelihood(spectra, state, fit.free, fit.delay_unit)
            _fix(fit, state, large, start)
    raise DataError(
        'motion: the search for gains, directions and delays does not converge; check points, '
        'directions and columns of the sensors, and what "identnl diagnose" says'
    )


def _fix(fit: _Fit, state: SensorState, reasons: dict[int, str], start: list[Reals]) -> None:
    """Take parameters out of the search and put their sensors back to the start."""
    for index, reason in reasons.items():
        channel, which = fit.free[index]
        fit.fixed[channel, which] = reason
        if which in ANGLES:
            # The other angle begins again too.
            state.directions[channel] = start[1][channel]
        else:
            array = 0 if which == GAIN else 2
            (state.gains, state.directions, state.delays)[array][channel] = start[array][channel]
    fit.free = [one for i, one in enumerate(fit.free) if i not in reasons]


def _errors(fit: _Fit, which: int, sensors: int) -> Reals:
    """Give standard errors of one number of every sensor; 0: not estimated."""
    errors = np.zeros(sensors)
    for i, one in enumerate(fit.free):
        if one[1] == which and one not in fit.lost:
            errors[one[0]] = np.sqrt(fit.covariance[i, i])
    return errors


def _calibrated(fit: _Fit, state: SensorState) -> Iterable[Calibrated]:
    for i, parameter in enumerate(fit.free):
        if parameter in fit.lost:
            continue
        channel, which = parameter
        sensor = fit.layout.sensors[channel]
        shares = dict(zip(fit.references.names, fit.shares[i].tolist(), strict=True))
        error = float(np.sqrt(fit.covariance[i, i] + fit.shares[i] @ fit.shares[i]))
        if which == GAIN:
            value = sensor.gain * float(state.gains[channel])
            found = sensor.gain, value, abs(sensor.gain) * error
            shares = {name: sensor.gain * share for name, share in shares.items()}
        elif which == DELAY:
            found = sensor.delay, sensor.delay + float(state.delays[channel]), error
        else:
            axis = state.axes[channel, which - 1]
            direction = state.directions[channel]
            angle = float(np.arctan2(direction @ axis, direction @ sensor.direction))
            yield Calibrated(sensor.name, Property.DIRECTION, 0.0, angle, error, axis, shares)
            continue
        yield Calibrated(sensor.name, _WHAT[which], *found, shares=shares)


def _undetermined(fit: _Fit) -> Iterable[Undetermined]:
    told = {}
    for (channel, which), reason in sorted((fit.fixed | fit.lost).items()):
        sensor, what = fit.layout.sensors[channel], _WHAT[which]
        towards = ''
        if what is Property.DIRECTION:
            axis = across(sensor.direction)[which - 1]
            largest = int(np.argmax(np.abs(axis)))
            towards = f'towards {"xyz"[largest]}: '
        told[channel, which] = Undetermined(sensor.name, what, towards + reason)
    return told.values()


def _agreement(found: Likelihood, layout: Layout, noise_uncertainty: float) -> Findings:
    """Say whether the sensors agree once they are corrected."""
    if found.expected < 1:
        return Findings(remarks=('Too few sensors measure the same motion to test the result.',))
    ratio = found.cost / found.expected
    limit = (1 + noise_uncertainty) ** 2 + ALLOWED * found.uncertainty
    sentence = (
        f'What no rigid motion explains is {np.sqrt(ratio):.3g} times what the noise explains '
        f'(up to {np.sqrt(limit):.3g} is allowed).'
    )
    if ratio <= limit:
        return Findings(remarks=(sentence,))
    told = found.channel_expected > 0
    by_channel = np.where(told, found.channel_cost, 0) / np.where(told, found.channel_expected, 1)
    worst = [layout.sensors[i].name for i in np.argsort(-by_channel)[:3] if by_channel[i] > limit]
    return Findings(
        doubts=(
            f'{sentence} Gains, directions and delays do not make the sensors agree: something '
            f'else is wrong, most at {", ".join(worst)}: a point, a body, a column, the noise, '
            'a reference that is not right, or a body that bends.',
        )
    )
