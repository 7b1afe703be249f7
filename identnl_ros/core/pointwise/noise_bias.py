# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
What sensor noise does to a least-squares estimate whose regressor is made of measured motion.

Noise in the regressor and in the target does not average out. With ``[Phi, Y]`` the rows and
``[N, n]`` the noise in them, least squares is off by ``(Phi^T Phi)^-1 (E[N^T n] - E[N^T N] x)``,
to first order in the noise.
"""

from dataclasses import dataclass, fields

from identnl_ros.core.measurement.blocks import MotionBlock
from identnl_ros.core.mechanics.laws import LawKind
from identnl_ros.core.mechanics.model import Model
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class NoiseCovariances:
    """
    Covariances of the measured motion at one instant.

    Parameters
    ----------
    displacement, velocity, acceleration, force, displacement_acceleration :
        ndarray, shape (n_coordinates, n_coordinates). The last is the covariance of
        displacement (rows) with acceleration (columns): not zero where the acceleration is
        derived. Displacement and velocity, velocity and acceleration do not correlate, because
        the weights of a first derivative are antisymmetric.

    """

    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    force: NDArray[np.float64]
    displacement_acceleration: NDArray[np.float64]

    @classmethod
    def of(cls, block: MotionBlock) -> 'NoiseCovariances':
        """
        Take the covariances of a block.

        Parameters
        ----------
        block : MotionBlock

        Returns
        -------
        NoiseCovariances

        """
        return cls(
            block.displacement_covariance,
            block.velocity_covariance,
            block.acceleration_covariance,
            block.force_covariance,
            block.displacement_acceleration_covariance,
        )

    def moved_towards(self, other: 'NoiseCovariances', share: float) -> 'NoiseCovariances':
        """
        Average with others; exact where both are equal.

        Parameters
        ----------
        other : NoiseCovariances
        share : float
            Weight of the others, of 1 in all.

        Returns
        -------
        NoiseCovariances

        """
        pairs = ((getattr(self, one.name), getattr(other, one.name)) for one in fields(self))
        return NoiseCovariances(*(old + share * (new - old) for old, new in pairs))


@dataclass(frozen=True)
class SlopeSums:
    """
    Sums over instants of the slopes of all elastic terms.

    They are what the noise's effect needs of the motion, whatever the noise turns out to be.

    Parameters
    ----------
    products : ndarray, shape (n_elastic, n_elastic)
        Sum of products of the slopes of two terms.
    sums : ndarray, shape (n_elastic,)
        Sum of the slopes.
    samples : int
        Number of instants.

    """

    products: NDArray[np.float64]
    sums: NDArray[np.float64]
    samples: int


class NoiseBias:
    """
    Expected contribution of noise to the moments of a regression.

    Parameters
    ----------
    model : Model

    """

    def __init__(self, model: Model) -> None:
        size = len(model.estimated)
        column = {parameter: i for i, parameter in enumerate(model.estimated)}
        self._elastic = [term for term in model.terms if term.law.kind is not LawKind.VISCOUS]
        viscous = [term for term in model.terms if term.law.kind is LawKind.VISCOUS]
        self._model = model
        # Owners: the column of [Phi, Y] that a term stands in, and with what weight; known
        # terms stand in Y with their value and the other sign.
        self._owners = []
        for terms in (self._elastic, viscous):
            owner = np.zeros((len(terms), size + 1))
            for row, term in zip(owner, terms, strict=True):
                if term.parameter in column:
                    row[column[term.parameter]] = term.factor
                else:
                    row[size] = -term.factor * model.parameters[term.parameter].value
            self._owners.append(owner)
        self._lines = [
            model.lines[[term.line for term in terms]].reshape(len(terms), model.lines.shape[1])
            for terms in (self._elastic, viscous)
        ]
        # Acceleration: its diagonal factor in every column of [Phi, Y].
        self._inertia = np.zeros((size + 1, len(model.coordinates)))
        self._inertia[size] = -model.rotary_inertia
        for parameter, diagonal in model.mass_vectors:
            if parameter in column:
                self._inertia[column[parameter]] += diagonal
            else:
                self._inertia[size] -= model.parameters[parameter].value * diagonal

    def empty(self) -> SlopeSums:
        """
        Begin with no instants.

        Returns
        -------
        SlopeSums

        """
        count = len(self._elastic)
        return SlopeSums(np.zeros((count, count)), np.zeros(count), 0)

    def with_motion(self, sums: SlopeSums, displacement: NDArray[np.float64]) -> SlopeSums:
        """
        Add instants.

        Parameters
        ----------
        sums : SlopeSums
        displacement : ndarray, shape (n_samples, n_coordinates)

        Returns
        -------
        SlopeSums

        """
        slopes = np.empty((len(displacement), len(self._elastic)))
        deformation = displacement @ self._model.lines.T
        for i, term in enumerate(self._elastic):
            slope = term.law.stiffness(deformation[:, term.line])
            # A power below one is infinitely steep at a point, where no noise is small.
            slopes[:, i] = np.where(np.isfinite(slope), slope, 0.0)
        return SlopeSums(
            sums.products + slopes.T @ slopes,
            sums.sums + slopes.sum(axis=0),
            sums.samples + len(displacement),
        )

    def moments(self, sums: SlopeSums, covariances: NoiseCovariances) -> NDArray[np.float64]:
        """
        Evaluate what noise adds to ``[Phi, Y]^T [Phi, Y]``.

        Parameters
        ----------
        sums : SlopeSums
        covariances : NoiseCovariances

        Returns
        -------
        ndarray, shape (n_unknowns + 1, n_unknowns + 1)
            E[[N, n]^T [N, n]]; NaN where the noise is not known.

        """
        (elastic, viscous), (elastic_owner, viscous_owner) = self._lines, self._owners
        total = elastic_owner.T @ (
            (elastic @ elastic.T)
            * (elastic @ covariances.displacement @ elastic.T)
            * sums.products
        ) @ elastic_owner  # fmt: skip
        total += sums.samples * viscous_owner.T @ (
            (viscous @ viscous.T) * (viscous @ covariances.velocity @ viscous.T)
        ) @ viscous_owner  # fmt: skip
        total += sums.samples * (
            (self._inertia * np.diag(covariances.acceleration)) @ self._inertia.T
        )
        shared = (elastic * (elastic @ covariances.displacement_acceleration)) @ self._inertia.T
        mixed = elastic_owner.T @ (sums.sums[:, np.newaxis] * shared)
        total += mixed + mixed.T
        total[-1, -1] += sums.samples * float(np.trace(covariances.force))
        return np.asarray(total)
