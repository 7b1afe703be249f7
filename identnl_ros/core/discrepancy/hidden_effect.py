# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Hide an effect in a simulated stand, of a size that can be told in advance."""

from dataclasses import dataclass

from identnl_ros.core.discrepancy.circumstances import Course, Scale
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Effect, Hypothesis, SensorFault
from identnl_ros.core.discrepancy.features import Features
from identnl_ros.core.errors import DataError
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.mechanics.equilibrium import static_equilibrium
from identnl_ros.core.mechanics.kinematics import joint_deformation
from identnl_ros.core.simulation.excitation import Signal
from identnl_ros.core.simulation.simulation import Simulation, steps_per_sample
import numpy as np

# Run of the machine without the effect, to see how large it would be [s].
TRIAL = 0.4
# Of a periodic force: times the middle of the exciters' band.
FREQUENCY = 1.618


@dataclass(frozen=True)
class HiddenEffect:
    """
    An effect that the simulated stand has and its description has not.

    Parameters
    ----------
    hypothesis : Hypothesis
    size : float
        [SI].

    """

    hypothesis: Hypothesis
    size: float

    def truth(self, description: Description) -> Description:
        """
        Describe the stand as it is.

        Parameters
        ----------
        description : Description
            As others are told.

        Returns
        -------
        Description

        """
        return self.hypothesis.applied(description, self.size)


def choose_place(effect: Effect, description: Description, label: str) -> 'list[Hypothesis]':
    """
    Find the places that a label means.

    Parameters
    ----------
    effect : Effect
    description : Description
    label : str
        E.g. ``slideway_8.axis_2``; empty: anywhere.

    Returns
    -------
    list of Hypothesis
        Without inner parameters.

    Raises
    ------
    DataError
        If the effect cannot be there.

    """
    places = effect.places(description)
    chosen = [place for place in places if not label or place.label == label]
    if not chosen:
        some = ', '.join(place.label for place in places[:8])
        raise DataError(
            f'{effect.name} cannot be at "{label}"; expected one of {some}'
            f'{" ..." if len(places) > 8 else ""}'
        )
    return [Hypothesis(effect, place) for place in chosen]


def relative_size(
    description: Description,
    hypothesis: Hypothesis,
    signals: tuple[Signal, ...],
    sample_rate: float,
    generator: np.random.Generator | None = None,
) -> tuple[Hypothesis, float]:
    """
    Find the size at which an effect is as strong as the exciters, and its inner parameters.

    Strength: root mean square over time of the generalised force, each component over the root of
    its mass or moment of inertia.

    Parameters
    ----------
    description : Description
    hypothesis : Hypothesis
        Of the machine, not of a sensor.
    signals : tuple of Signal
    sample_rate : float
        [Hz].
    generator : numpy.random.Generator or None
        Draws the inner parameters; None: ordinary ones.

    Returns
    -------
    Hypothesis
        With inner parameters that the motion shows.
    float
        [SI].

    Raises
    ------
    DataError
        If the effect does nothing in this motion.

    """
    assert not isinstance(hypothesis.effect, SensorFault)
    model = assemble(description.machine)
    rest = static_equilibrium(model)
    interval = 1 / sample_rate
    steps = steps_per_sample(model, rest[np.newaxis], interval)
    trial = Simulation(model, signals, interval, rest, np.zeros_like(rest), steps)
    count = round(TRIAL * sample_rate)
    displacement, velocity, acceleration = (one[0] for one in trial.advance(count))
    deformation, rate = {}, {}
    for joint in model.machine.joints:
        rows = joint_deformation(model.machine, model.coordinates, joint)
        for axis in range(6):
            key = joint.name, axis + 1
            deformation[key] = float(np.abs(displacement @ rows[axis]).max())
            rate[key] = float(np.abs(velocity @ rows[axis]).max())
    band = model.machine.excitations[0].band
    # Of a periodic force: one that no exciter of this machine is likely to have.
    frequencies = (float(np.sqrt(band[0] * band[1])) * FREQUENCY,)
    effect, place = hypothesis.effect, hypothesis.place
    variants = effect.variants(description, place, Scale(deformation, rate, frequencies))
    number = len(variants) // 2 if generator is None else int(generator.integers(len(variants)))
    chosen = Hypothesis(effect, place, variants[number])
    driven = np.column_stack([one.on_grid(0.0, interval, count) for one in signals])
    course = Course(
        description, model, np.arange(float(count)) * interval, displacement, velocity,
        acceleration, driven,
    )  # fmt: skip
    forces = Features(course, [chosen]).forces([0], 0, count)[:, :, 0]
    masses = model.mass_diagonal()
    strength = float(np.sqrt(np.mean((forces - forces.mean(axis=0)) ** 2 / masses)))
    whole = float(np.sqrt(np.mean((driven @ model.excitation_directions) ** 2 / masses)))
    if not strength > 0:
        strength = float(np.sqrt(np.mean(forces**2 / masses)))
    if not strength > 0:
        raise DataError(f'{effect.name} at {place.label} does nothing in this motion')
    return chosen, whole / strength
