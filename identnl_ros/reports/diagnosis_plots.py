# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as pictures: what is left of forces and readings, before and after."""

from collections.abc import Iterator
from io import BytesIO

from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis
from identnl_ros.core.discrepancy.effect import Place
from identnl_ros.core.discrepancy.effects.joint_element import joint_places
from identnl_ros.core.discrepancy.held_out import HeldOutError
from identnl_ros.core.discrepancy.restoring_force import residual_along, restoring_force
from identnl_ros.core.measurement.layout import SensorKind
from identnl_ros.reports.plot_style import (
    AFTER,
    BEFORE,
    figure,
    finish,
    MEASURED,
    NOISE,
    prefixed,
)  # fmt: skip
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

Reals = NDArray[np.float64]

MOST_BARS = 16
MOST_JOINTS = 4
MOST_POINTS = 4000
MOST_CHANNELS = 3
# Periods of its strongest frequency in the window that is shown of a channel.
PERIODS = 4
SHORTEST_WINDOW, LONGEST_WINDOW = 40, 600  # samples
SEGMENT = 1024


def diagnosis_plots(result: CheckedDiagnosis) -> Iterator[tuple[str, str, bytes]]:
    """
    Draw a diagnosis.

    Parameters
    ----------
    result : CheckedDiagnosis

    Yields
    ------
    name : str
        Of the file.
    words : str
        What is seen.
    content : bytes
        A PNG picture.

    """
    shares = _shares(result)
    drawn = [
        ('residual.png', 'Unexplained force per joint direction', _residual(result, shares)),
        (
            'restoring_force.png',
            'Restoring forces, reconstructed from the measurement',
            _restoring_forces(result, shares),
        ),
        ('spectra.png', 'Spectra of what the model leaves of the readings', _spectra(result)),
        ('traces.png', 'Channels that changed most', _traces(result)),
    ]
    for name, words, picture in drawn:
        if picture is not None:
            content = BytesIO()
            picture.savefig(content, format='png')
            yield name, words, content.getvalue()


def _shares(result: CheckedDiagnosis) -> dict[Place, tuple[float, float, float]]:
    """Before, after and noise of every joint direction in which something moves, largest first."""
    diagnosis = result.diagnosis
    shares = {}
    for place in joint_places(diagnosis.before.description):
        before, _ = residual_along(diagnosis.before.model, result.before.force, place)
        after, noise = residual_along(diagnosis.after.model, result.after.force, place)
        if noise > 0:
            shares[place] = before, after, noise
    return dict(sorted(shares.items(), key=lambda one: -one[1][0]))


def _residual(
    result: CheckedDiagnosis, shares: dict[Place, tuple[float, float, float]]
) -> Figure | None:
    if not shares:
        return None
    places = list(shares)[:MOST_BARS]
    picture, ((axes,),) = figure(1, 1, width=8.0, height=1.2 + 0.32 * len(places))
    height = np.arange(len(places))[::-1]
    before, after, noise = (100 * np.array([shares[one] for one in places])).T
    if _changed(result):
        axes.barh(height + 0.2, before, 0.36, label='model before', **BEFORE.bar)
        axes.barh(height - 0.2, after, 0.36, label='model after', **AFTER.bar)
    else:
        axes.barh(height, before, 0.5, label='model', **BEFORE.bar)
    axes.plot(noise, height, '|', markersize=12, label='sensor noise alone', **NOISE.mark)
    axes.set_yticks(height, [one.words for one in places])
    axes.set_ylim(-0.8, len(places) - 0.2)
    axes.set_xlabel('unexplained force, % of the exciters')
    return finish(picture)


def _restoring_forces(
    result: CheckedDiagnosis, shares: dict[Place, tuple[float, float, float]]
) -> Figure | None:
    chosen = _chosen(result, shares)
    if not chosen:
        return None
    picture, table = figure(len(chosen), 2, width=9.0, height=3.4 * len(chosen))
    for place, (left, right) in zip(chosen, table, strict=True):
        _restoring_force(result, place, left, right)
    return finish(picture)


def _chosen(
    result: CheckedDiagnosis, shares: dict[Place, tuple[float, float, float]]
) -> list[Place]:
    """Joint directions of the effects that are named, and the one with the largest residual."""
    chosen = []
    for named in result.diagnosis.named:
        place = named.hypothesis.place
        own = [one for one in shares if one.part == place.part and place.axis in (0, one.axis)]
        chosen += own[:1]
    chosen += list(shares)[:1]
    return list(dict.fromkeys(chosen))[:MOST_JOINTS]


def _restoring_force(result: CheckedDiagnosis, place: Place, left: Axes, right: Axes) -> None:
    diagnosis = result.diagnosis
    before = restoring_force(diagnosis.before.model, result.before.force, place)
    after = restoring_force(diagnosis.after.model, result.after.force, place)
    every = slice(None, None, -(-len(after.rate) // MOST_POINTS))
    turning = place.axis > 3
    force_unit, length_unit = ('N m', 'rad') if turning else ('N', 'm')
    halves = (
        (left, 'deformation', after.deformation, after.elastic, before.deformation,
         before.elastic, length_unit, 'elastic force'),
        (right, 'rate of deformation', after.rate, after.damping, before.rate, before.damping,
         f'{length_unit}/s', 'damping and friction force'),
    )  # fmt: skip
    for axes, across, place_after, law, place_before, law_before, unit, what in halves:
        along = prefixed(unit, place_after)
        up = prefixed(force_unit, law + after.missing)
        measured = place_after[every] / along.size, (law + after.missing)[every] / up.size
        axes.plot(*measured, '.', label='measured', **MEASURED.dots)
        if _changed(result):
            drawn = place_before[every] / along.size, law_before[every] / up.size
            axes.plot(*drawn, '.', label='model before', **BEFORE.dots)
        drawn = place_after[every] / along.size, law[every] / up.size
        axes.plot(*drawn, '.', label='model after' if _changed(result) else 'model', **AFTER.dots)
        axes.set_xlabel(f'{across} [{along.name}]')
        axes.set_ylabel(f'{what} [{up.name}]')
    left.set_title(place.words, loc='left')


def _spectra(result: CheckedDiagnosis) -> Figure:
    kinds = list(dict.fromkeys(result.after.kinds[name] for name in result.after.channels))
    picture, table = figure(len(kinds), 1, width=8.0, height=2.8 * len(kinds))
    rate = result.sample_rate
    for kind, (axes,) in zip(kinds, table, strict=True):
        lines = [('model after' if _changed(result) else 'model', result.after, AFTER)]
        if _changed(result):
            lines.insert(0, ('model before', result.before, BEFORE))
        found = [(words, style, *_density(error, kind, rate)) for words, error, style in lines]
        sizes = [one[1] for name, one in result.after.channels.items()
                 if result.after.kinds[name] is kind]  # fmt: skip
        noise = float(np.sqrt(2 * np.mean(np.square(sizes)) / rate))
        unit = prefixed(kind.unit.replace('^2', '²'), np.array([one[3].max() for one in found]))
        for words, style, frequencies, density in found:
            axes.loglog(frequencies, density / unit.size, label=words, **style.line)
        axes.axhline(noise / unit.size, label='sensor noise', **NOISE.line)
        axes.set_title(kind.value, loc='left')
        axes.set_ylabel(f'residual [{unit.name}/√Hz]')
        axes.set_xlabel('frequency [Hz]')
    return finish(picture)


def _density(error: HeldOutError, kind: SensorKind, rate: float) -> tuple[Reals, Reals]:
    """Amplitude spectral density of the residuals, root mean square over the sensors."""
    own = [name for name in error.channels if error.kinds[name] is kind]
    residual = np.array([error.measured[name] - error.simulated[name] for name in own])
    residual = np.nan_to_num(residual)
    frequencies, power = welch(residual, rate, nperseg=min(SEGMENT, residual.shape[1]))
    density = np.sqrt(power.mean(axis=0))
    return frequencies[1:], np.maximum(density[1:], np.finfo(np.float64).tiny)


def _traces(result: CheckedDiagnosis) -> Figure:
    before, after = result.before, result.after
    changes = {
        name: ((before.channels[name][0] if _changed(result) else 0.0) - size) / noise
        for name, (size, noise, _) in after.channels.items()
    }
    chosen = sorted(changes, key=lambda name: -abs(changes[name]))[:MOST_CHANNELS]
    picture, table = figure(len(chosen), 2, width=10.0, height=2.6 * len(chosen))
    for name, (left, right) in zip(chosen, table, strict=True):
        _trace(result, name, left, right)
    return finish(picture)


def _trace(result: CheckedDiagnosis, name: str, left: Axes, right: Axes) -> None:
    before, after = result.before, result.after
    part = _window(before.measured[name], before.simulated[name])
    measured, reread = before.measured[name][part], after.measured[name][part]
    unit = prefixed(after.kinds[name].unit.replace('^2', '²'), measured)
    time = 1e3 * before.time[part]
    lines = [('measured', measured, MEASURED)]
    if not np.allclose(measured, reread, equal_nan=True):
        lines.append(('measured, sensor corrected', reread, NOISE))
    if _changed(result):
        lines.append(('model before', before.simulated[name][part], BEFORE))
    lines.append(
        ('model after' if _changed(result) else 'model', after.simulated[name][part], AFTER)
    )
    for words, series, style in lines:
        left.plot(time[: len(series)], series / unit.size, label=words, **style.line)
    left.set_title(name, loc='left')
    left.set_ylabel(f'{after.kinds[name].value} [{unit.name}]')
    errors = [('model after' if _changed(result) else 'model', after, AFTER)]
    if _changed(result):
        errors.insert(0, ('model before', before, BEFORE))
    left_over = [(words, (one.measured[name] - one.simulated[name])[part], style)
                 for words, one, style in errors]  # fmt: skip
    unit = prefixed(
        after.kinds[name].unit.replace('^2', '²'), np.concatenate([one[1] for one in left_over])
    )
    for words, error, style in left_over:
        right.plot(time[: len(error)], error / unit.size, label=words, **style.line)
    right.set_ylabel(f'measured less model [{unit.name}]')
    for axes in (left, right):
        axes.set_xlabel('time [ms]')


def _window(measured: Reals, simulated: Reals) -> slice:
    """Find a stretch of some periods in which the error is largest."""
    count = len(measured)
    signal = np.nan_to_num(measured)
    power = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(count))) ** 2
    period = count / max(int(np.argmax(power[1:])) + 1, 1)
    length = min(max(round(PERIODS * period), SHORTEST_WINDOW), LONGEST_WINDOW, count)
    squares = np.cumsum(np.pad(np.nan_to_num(measured - simulated) ** 2, (1, 0)))
    first = int(np.argmax(squares[length:] - squares[:-length]))
    return slice(first, first + length)


def _changed(result: CheckedDiagnosis) -> bool:
    return result.after is not result.before
