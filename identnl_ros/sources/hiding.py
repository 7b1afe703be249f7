# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What `simulate --hide` means: an effect, a place, a size."""

from collections.abc import Sequence

from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Effect, SensorFault
from identnl_ros.core.discrepancy.hidden_effect import choose_place, HiddenEffect, relative_size
from identnl_ros.core.discrepancy.library import EFFECTS
from identnl_ros.core.errors import DataError
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.sources.hidden_force import FORCES, hidden_force, HiddenForce
from identnl_ros.storage.quantities import Quantity
import numpy as np

# Size of an effect of the machine that is not told: of the exciters' strength.
DEFAULT_SHARE = 0.05
# Sizes of sensor faults that are not told, SI.
DEFAULT_SIZES = {
    'sensor_gain': 0.05,
    'sensor_delay': 100e-6,
    'delay_of_kind': 100e-6,
    'wrong_direction': 0.1,
}
WHOLE = 1.0
# Times its noise: an offset that is not told.
DEFAULT_OFFSET = 20.0


def hidden(
    text: str,
    description: Description,
    signals: tuple[Signal, ...],
    sample_rate: float,
    generator: np.random.Generator,
    effects: Sequence[Effect] = EFFECTS,
) -> HiddenEffect | HiddenForce:
    """
    Find out what is to be hidden.

    Parameters
    ----------
    text : str
        ``EFFECT[:location][:size]``; a size is a number with a unit, or in percent of the
        exciters' strength. A place that is not told is drawn.
    description : Description
        Of the stand without it.
    signals : tuple of Signal
        What the exciters do.
    sample_rate : float
        [Hz].
    generator : numpy.random.Generator
        Draws the place.
    effects : sequence of Effect

    Returns
    -------
    HiddenEffect or HiddenForce
        The latter: something that no effect of the library is.

    Raises
    ------
    DataError
        If there is no such effect or place, or the size cannot be read.

    """
    name, _, rest = text.partition(':')
    place, _, size = rest.partition(':')
    found = {effect.name: effect for effect in effects}
    if name in FORCES:
        exciters = description.machine.excitations
        whole = max((one.amplitude for one in exciters), default=1.0)
        amplitude = whole * _share(size) if _is_share(size) else _number(size, 'N', whole)
        return hidden_force(name, place, amplitude, description, generator)
    if name not in found:
        raise DataError(f'--hide {text}: no effect is called "{name}"; expected one of '
                        f'{", ".join(sorted((*found, *FORCES)))}')  # fmt: skip
    choices = choose_place(found[name], description, place)
    hypothesis = choices[int(generator.integers(len(choices)))]
    effect = hypothesis.effect
    if isinstance(effect, SensorFault):
        default = DEFAULT_SIZES.get(name, WHOLE)
        if name == 'sensor_offset':
            default = DEFAULT_OFFSET * description.sensor(hypothesis.place.part).noise
        return HiddenEffect(hypothesis, _number(size, effect.unit(hypothesis.place), default))
    hypothesis, whole = relative_size(description, hypothesis, signals, sample_rate)
    if _is_share(size):
        return HiddenEffect(hypothesis, _share(size) * whole)
    return HiddenEffect(hypothesis, _number(size, effect.unit(hypothesis.place), whole))


def _is_share(text: str) -> bool:
    return not text or text.strip().endswith('%')


def _share(text: str) -> float:
    if not text:
        return DEFAULT_SHARE
    try:
        return float(text.strip().rstrip('%')) / 100
    except ValueError:
        raise DataError(f'--hide: "{text}" is no share; expected e.g. 5%') from None


def _number(text: str, unit: str, default: float) -> float:
    if not text:
        return default
    try:
        return float(text)
    except ValueError:
        pass
    try:
        quantity = '' if unit == '1' else unit.replace(' ', '*')
        return Quantity(quantity, f'a size in {unit}').number(text)
    except ValueError as error:
        raise DataError(f'--hide: {error}') from None
