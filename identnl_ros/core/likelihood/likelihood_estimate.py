# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Maximum-likelihood estimates of records, started from weak-form ones where that is possible."""

from collections.abc import Sequence

from identnl_ros.core.errors import LayoutError
from identnl_ros.core.estimation.estimate import Estimate
from identnl_ros.core.estimation.force_noise import force_noise_effect, ForceNoise
from identnl_ros.core.estimation.judged_estimate import judged_estimate, Verdict, verdict_on
from identnl_ros.core.estimation.residual_statistics import ResidualStatistics
from identnl_ros.core.estimation.unknowns import require_unknowns
from identnl_ros.core.likelihood.likelihood import fit_likelihood, LikelihoodFit
from identnl_ros.core.likelihood.likelihood_point import LikelihoodSettings
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.core.measurement.measured_record import MeasuredRecord, standard_deviations
from identnl_ros.core.measurement.observation import observe_force, sensor_matrix
from identnl_ros.core.measurement.sensor_unknown import SensorUnknown
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.model import Model, Parameter
from identnl_ros.core.weak.recursion import LONGEST_FORCE_STUDY
from identnl_ros.core.weak.weak_identifier import WeakIdentifier
from identnl_ros.core.weak.weighting_function import bandwidth, weighting_function_for
import numpy as np

_ORDERS = {SensorKind.DISPLACEMENT: 0, SensorKind.VELOCITY: 1, SensorKind.ACCELERATION: 2}


def likelihood_estimate(
    model: Model,
    records: Sequence[MeasuredRecord],
    sensor_unknowns: tuple[SensorUnknown, ...] = (),
) -> Estimate:
    """
    Estimate by maximum likelihood.

    Parameters
    ----------
    model : Model
        Where the sensors see every motion of the bodies and no force depends on time, unknown
        coefficients need no value; else the search starts from the values given here.
    records : sequence of MeasuredRecord
    sensor_unknowns : tuple of SensorUnknown
        Offsets, gains and delays to be estimated too.

    Returns
    -------
    Estimate
        Unknowns of the machine, then of the sensors.

    Raises
    ------
    IdentnlError
        If records, layouts and machine do not fit each other, or there is no start.

    """
    require_unknowns(model)
    # The weak estimator does not take forces that depend on time.
    start = None if model.time_dependent else _weak_start(model, records)
    settings = LikelihoodSettings(pieces=start is None, keep_residuals=True)
    fit = fit_likelihood(start or model, records, sensor_unknowns, settings)
    return _judged(fit, records, sensor_unknowns)


def _weak_start(model: Model, records: Sequence[MeasuredRecord]) -> Model | None:
    """Identify from the motion of the bodies; None where the sensors do not see all of it."""
    identifier = WeakIdentifier(model)
    for number, record in enumerate(records, start=1):
        try:
            transform = MotionTransform(model, record.layout, record.sample_rate)
        except LayoutError:
            return None
        channels = record.samples.shape[1]
        status = np.zeros(channels, np.uint8)
        motion = transform.add(
            SampleBlock(
                number,
                0,
                record.first_index,
                record.sample_rate,
                record.samples,
                status,
                last=True,
            )
        )
        if motion is not None:
            identifier.add(motion)
        identifier.end_stream()
    found = identifier.simulated_model()
    return found if found is not None and np.isfinite(found.values).all() else None


def _judged(
    fit: LikelihoodFit,
    records: Sequence[MeasuredRecord],
    sensor_unknowns: tuple[SensorUnknown, ...],
) -> Estimate:
    model = fit.model
    unknowns = [model.parameters[i] for i in model.estimated]
    unknowns += [_sensor_parameter(one, records) for one in sensor_unknowns]
    fitted = len(unknowns) + sum(state.size for state in fit.initial_states)
    variance = fit.chi_squared / max(fit.degrees_of_freedom, 1)
    average = _average(records[0])
    statistics = _statistics(fit, average)
    force_noise = _force_noise(fit, records[0], average)
    perfect = all(np.nanmax(standard_deviations(record)) == 0 for record in records)
    exact = Verdict(variance, '', '')
    verdict = exact if perfect else verdict_on(statistics, fitted, force_noise)
    samples = sum(int(np.isfinite(one).any(axis=1).sum()) for one in fit.residuals)
    remarks = []
    if not fit.noise_known and not perfect:
        remarks.append(
            "The layout does not state every sensor's noise: it is estimated from the fastest "
            'changes of the samples.'
        )
    return judged_estimate(
        'likelihood',
        unknowns,
        np.concatenate((fit.values, fit.sensor_values)),
        fit.solution,
        verdict,
        samples,
        sum(len(record.samples) for record in records) - samples,
        residual=float(np.sqrt(variance)),
        force_noise=force_noise,
        failure='' if fit.converged else fit.reason,
        remarks=remarks,
    )


def _average(record: MeasuredRecord) -> int:
    """Choose how many samples of the residual to average: few beside the motion's periods."""
    noise = standard_deviations(record)
    kind = next(one for one in _ORDERS if record.layout.of_kind(one))
    channels = list(record.layout.of_kind(kind))
    white = record.samples[:, channels] / np.where(noise[channels] > 0, noise[channels], 1.0)
    frequency = bandwidth(white, record.sample_rate, _ORDERS[kind])
    return weighting_function_for(frequency, record.sample_rate).stride


def _statistics(fit: LikelihoodFit, average: int) -> ResidualStatistics:
    """Gather the residuals of all records whose channels are the first one's."""
    statistics = ResidualStatistics(fit.residuals[0].shape[1], average)
    for residuals in fit.residuals:
        statistics.restart()
        if residuals.shape[1] == statistics.channels:
            statistics.add(residuals)
    return statistics


def _force_noise(fit: LikelihoodFit, record: MeasuredRecord, average: int) -> ForceNoise:
    """Study the effect of force noise on the first record."""
    model, layout = fit.model, record.layout
    noise = standard_deviations(record)
    if not np.all(noise > 0):
        return ForceNoise.none(len(model.estimated))
    whitening = []
    for kind, order in _ORDERS.items():
        channels = list(layout.of_kind(kind))
        if channels:
            rows = sensor_matrix(model, tuple(layout.sensors[i] for i in channels))
            whitening.append((order, rows / noise[channels][:, np.newaxis]))
    observed = observe_force(model, layout)
    to_exciters = np.linalg.pinv(model.excitation_directions)
    # Of the exciters, from the cells: the way over the coordinates weighs several cells.
    exciters = to_exciters.T @ observed.matrix
    first = fit.first_samples[0]
    force = record.samples[first:, list(observed.channels)] @ exciters.T
    force = force[:LONGEST_FORCE_STUDY]
    covariance = (exciters * noise[list(observed.channels)] ** 2) @ exciters.T
    displacement, velocity = fit.initial_states[0]
    return force_noise_effect(
        model,
        whitening,
        force[np.isfinite(force).all(axis=1)],
        covariance,
        record.sample_rate,
        (displacement, velocity),
        average,
        (record.first_index + first) / record.sample_rate,
    )


def _sensor_parameter(unknown: SensorUnknown, records: Sequence[MeasuredRecord]) -> Parameter:
    sensors = {sensor.name: sensor for record in records for sensor in record.layout.sensors}
    unit = unknown.quantity.unit_of(sensors[unknown.sensors[0]].kind)
    return Parameter(unknown.label, unknown.quantity.symbol, unit, float('nan'), True)
