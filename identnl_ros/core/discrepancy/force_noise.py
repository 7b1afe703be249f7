# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""
Noise of the measured force, as the machine passes it on to the sensors.

It drives the simulation and not the machine, so it shows in all channels at once, with a spectrum
of its own. Per spectral line it is a few directions in the space of the channels; rows are
weighted so that noise of force and sensors together is white.
"""

from dataclasses import dataclass

from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.simulation.tangent_response import LinearisedEquations
import numpy as np
from numpy.typing import NDArray
from scipy import fft

Reals = NDArray[np.float64]
Lines = NDArray[np.complexfloating]


@dataclass(frozen=True)
class Whitening:
    """
    Weights of spectral lines: one less ``directions shrink directions^H``.

    Parameters
    ----------
    directions : ndarray, shape (n_channels, n_lines, n_exciters)
        Complex, orthonormal at every line.
    shrink : ndarray, shape (n_lines, n_exciters)
        Between 0 and 1.

    """

    directions: Lines
    shrink: Reals

    def apply(self, lines: Lines) -> Lines:
        """
        Weight spectra.

        Parameters
        ----------
        lines : ndarray, shape (n_columns, n_channels, n_lines)

        Returns
        -------
        ndarray
            The same array.

        """
        own = self.directions.astype(lines.dtype, copy=False)
        for exciter in range(own.shape[2]):
            direction = own[:, :, exciter]
            part = np.einsum('vl,cvl->cl', direction.conj(), lines)
            part *= self.shrink[:, exciter].astype(part.real.dtype)
            lines -= direction * part[:, np.newaxis]
        return lines


def whitening(
    equations: LinearisedEquations,
    layout: Layout,
    of_motion: Reals,
    frequencies: Reals,
) -> Whitening | None:
    """
    Find the weights that make noise of force and sensors white.

    Parameters
    ----------
    equations : LinearisedEquations
        Along the motion; their mean counts.
    layout : Layout
    of_motion : ndarray, shape (3, n_channels, n_coordinates)
        Channels per unit of displacement, velocity, acceleration.
    frequencies : ndarray, shape (n_lines,)
        [Hz].

    Returns
    -------
    Whitening or None
        None: no noise of force is stated.

    """
    model = equations.model
    noise = noise_of_force(model, layout)
    if not noise.any():
        return None
    motion = _frequency_response(equations, frequencies, model.excitation_directions.T * noise)
    rate = 2j * np.pi * frequencies[:, np.newaxis, np.newaxis]
    response = sum((of_motion[order] @ (rate**order * motion)) for order in range(3))
    left, sizes, _ = np.linalg.svd(response, full_matrices=False)
    return Whitening(np.ascontiguousarray(left.transpose(1, 0, 2)), 1 - 1 / np.sqrt(1 + sizes**2))


def _frequency_response(
    equations: LinearisedEquations, frequencies: Reals, forces: Reals
) -> NDArray[np.complex128]:
    """Respond to harmonic forces; displacement, (n_lines, n_coordinates, n_forces)."""
    model, slopes = equations.model, equations.slopes
    rate = 2j * np.pi * frequencies[:, np.newaxis, np.newaxis]
    damping = slopes.damping + (slopes.rate_lines.T * slopes.rate.mean(axis=0)) @ slopes.rate_lines
    stiffness = (model.lines.T * slopes.stiffness.mean(axis=0)) @ model.lines
    dynamic = np.diag(model.mass_diagonal()) * rate**2 + damping * rate + stiffness
    return np.asarray(np.linalg.solve(dynamic, forces[None].astype(np.complex128)))


def spectral_lines(table: NDArray[np.floating]) -> Lines:
    """
    Transform real channels so that inner products of spectra are those of the channels.

    Parameters
    ----------
    table : ndarray, shape (..., n_samples)

    Returns
    -------
    ndarray, shape (..., n_lines)
        Complex, of the same precision.

    """
    lines: Lines = fft.rfft(table, axis=-1, norm='ortho')
    lines[..., 1:] *= np.sqrt(2.0)
    if table.shape[-1] % 2 == 0:
        lines[..., -1] /= np.sqrt(2.0)
    return lines


def noise_of_force(model: Model, layout: Layout) -> Reals:
    """
    Find the noise of the exciters' forces as measured; what is stated only.

    Parameters
    ----------
    model : Model
    layout : Layout

    Returns
    -------
    ndarray, shape (n_excitations,)
        Standard deviation [N]; 0 where it is not stated.

    """
    result = []
    for point in model.machine.excitations:
        own = [one.noise for one in layout.sensors if one.excitation == point.name]
        known = np.array([one for one in own if one > 0])
        # The force itself may change from sample to sample: its noise does not show in that.
        stated = len(known) == len(own) > 0
        result.append(float((known**-2.0).sum() ** -0.5) if stated else 0.0)
    return np.array(result)
