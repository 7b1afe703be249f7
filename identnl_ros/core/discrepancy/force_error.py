# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""The force that the equations of motion of a model leave unexplained along a measured motion."""

from dataclasses import dataclass

from identnl_ros.core.discrepancy.comparison import Comparison
from identnl_ros.core.discrepancy.features import left_hand_side
from identnl_ros.core.discrepancy.force_noise import noise_of_force
from identnl_ros.core.discrepancy.measured_motion import MeasuredMotion
from identnl_ros.core.discrepancy.nominal_motion import NominalMotion
from identnl_ros.core.mechanics.hidden_states import hidden_motion
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# A force that may be missing, over that of the exciters. Where it is known better than that it is
# taken as it is; where noise alone would look like more, little of the noise gets through.
SHARE = 0.1


@dataclass(frozen=True)
class ForceError:
    """
    Force that a model leaves unexplained, without the ends of the record.

    Parameters
    ----------
    time : ndarray, shape (n_samples,)
        Since the begin of the stream [s].
    motion : NominalMotion
        As measured, with little noise.
    unexplained : ndarray, shape (n_samples, n_coordinates)
        Force of the exciters less what the equations of motion need along the measured motion,
        less its mean [N, N m].
    noise : ndarray, the same shape
        The same of readings of this model with the sensors' noise alone.
    masses : ndarray, shape (n_coordinates,)
        Masses and moments of inertia [kg, kg m^2].
    strength : float
        Of the exciters, see `strength`.

    """

    time: Reals
    motion: NominalMotion
    unexplained: Reals
    noise: Reals
    masses: Reals
    strength: float

    @property
    def relative(self) -> float:
        """Strength of what is unexplained over that of the exciters [-]."""
        return strength(self.unexplained, self.masses) / self.strength

    @property
    def noise_floor(self) -> float:
        """The same of the sensors' noise [-]."""
        return strength(self.noise, self.masses) / self.strength


def strength(force: Reals, masses: Reals) -> float:
    """
    Measure a generalised force.

    Parameters
    ----------
    force : ndarray, shape (n_samples, n_coordinates)
        [N, N m].
    masses : ndarray, shape (n_coordinates,)
        [kg, kg m^2].

    Returns
    -------
    float
        Root mean square over time and coordinates, each over the root of its mass or moment of
        inertia [N/kg^0.5].

    """
    return float(np.sqrt(np.mean(force**2 / masses)))


def force_error(comparison: Comparison, seed: int = 0) -> ForceError:
    """
    Evaluate the equations of motion along the measured motion.

    Parameters
    ----------
    comparison : Comparison
        Of a record with a model, simulated from its initial state.
    seed : int
        Of the draw of noise.

    Returns
    -------
    ForceError

    """
    model = comparison.model
    masses = model.mass_diagonal()
    count = len(comparison.measured)

    def needed(motion: NominalMotion) -> Reals:
        displacement, velocity = motion.displacement[:count], motion.velocity[:count]
        hidden = hidden_motion(model, displacement, velocity, comparison.state.hidden)
        return left_hand_side(
            model, displacement, velocity, motion.acceleration[:count], comparison.time[:count],
            hidden,
        )  # fmt: skip

    # The simulation solves the equations of motion: what they need along it is the exciters'.
    exciters = needed(comparison.simulated)
    whole = strength(exciters, masses)
    measured = MeasuredMotion(comparison, SHARE * whole)
    error, valid = comparison.simulated_error()
    generator = np.random.default_rng(seed)
    noise = generator.standard_normal(error.shape) * comparison.deviation
    cells = generator.standard_normal((count, len(model.excitation_directions)))
    of_force = noise_of_force(model, comparison.description.layout)
    noise += measured.readings((cells * of_force) @ model.excitation_directions)
    motions = [measured.along(np.where(valid, one, 0.0)) for one in (error, noise)]
    inner = measured.whole
    forces = [(exciters - needed(motion))[inner] for motion in motions]
    own = motions[0]
    return ForceError(
        comparison.time[:-1][inner],
        NominalMotion(own.displacement[inner], own.velocity[inner], own.acceleration[inner]),
        forces[0] - forces[0].mean(axis=0), forces[1] - forces[1].mean(axis=0), masses, whole,
    )  # fmt: skip
