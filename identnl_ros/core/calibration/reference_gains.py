# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Gains of references that are known to some uncertainty only."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

from identnl_ros.core.calibration.motion_likelihood import (
    GAIN,
    Likelihood,
    Parameter,
    SensorState,
)
from identnl_ros.core.measurement.layout import Layout
from identnl_ros.core.simulation.stand import MOTION_KINDS
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# Names in a sentence before it says how many more there are.
MOST_NAMES = 4


@dataclass
class ReferenceGains:
    """
    Gains that a fit of the motion may move within their uncertainty.

    The factor of gain *c* on what the layout says is ``1 - errors[c] @ deviations``, with
    deviations that are independent, normal and of variance 1 before the fit.

    Parameters
    ----------
    parameters : list of tuple of int
        The gains.
    names : tuple of str
        Of what they are uncertain by, e.g. a standard that several have in common.
    errors : ndarray, shape (n_parameters, n_names)
        How much a gain is too high, over it, for one standard deviation [-].
    deviations : ndarray, shape (n_names,)
        As found so far [-].
    remarks : tuple of str
        What of this the standard errors contain, in sentences.

    """

    parameters: list[Parameter]
    names: tuple[str, ...]
    errors: Reals
    deviations: Reals
    remarks: tuple[str, ...]

    def step(self, found: Likelihood, told: Reals) -> tuple[Reals, Reals, Reals]:
        """
        Make a Gauss-Newton step, with the prior of the deviations.

        Parameters
        ----------
        found : Likelihood
            By the free parameters, then by `parameters`.
        told : ndarray, shape (n_free, n_combinations)
            Combinations of the free parameters that are told, orthonormal.

        Returns
        -------
        step : ndarray, shape (n_free + n_names,)
        covariance : ndarray, shape (n_free, n_free)
            Of the free parameters' errors by the noise of the record.
        shares : ndarray, shape (n_free, n_names)
            Errors of the free parameters for one standard deviation of every name: the
            estimate's error is ``-inverse @ prior @ deviations`` (Kay 1993, section 10.6).

        """
        free, names = len(told), len(self.names)
        turn = np.zeros((len(found.score), free + names))
        turn[:free, :free] = np.eye(free)
        turn[free:, free:] = -self.errors
        information = turn.T @ (found.raw - found.surplus) @ turn
        information[free:, free:] += np.eye(names)
        score = turn.T @ found.score
        score[free:] -= self.deviations
        basis = np.zeros((free + names, told.shape[1] + names))
        basis[:free, : told.shape[1]] = told
        basis[free:, told.shape[1] :] = np.eye(names)
        inverse = basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T
        covariance = inverse @ (turn.T @ found.spread @ turn) @ inverse
        return inverse @ score, covariance[:free, :free], -inverse[:free, free:]

    def moved(self, state: SensorState, step: Reals) -> None:
        """
        Change the deviations, and the gains with them.

        Parameters
        ----------
        state : SensorState
        step : ndarray, shape (n_names,)

        """
        self.deviations = self.deviations + step
        for (channel, _), errors in zip(self.parameters, self.errors, strict=True):
            state.gains[channel] = 1.0 - errors @ self.deviations


def reference_gains(
    layout: Layout, trusted: Collection[str], gain_errors: Mapping[str, Mapping[str, float]]
) -> ReferenceGains:
    """
    Collect the references of which an uncertainty is given.

    Parameters
    ----------
    layout : Layout
    trusted : collection of str
        References, and sensors whose gains are known.
    gain_errors : mapping of str to mapping of str to float
        See `calibrate_motion`.

    Returns
    -------
    ReferenceGains

    """
    channels = [
        i
        for i, sensor in enumerate(layout.sensors)
        if sensor.kind in MOTION_KINDS and sensor.name in trusted
    ]
    of_channel = {i: gain_errors.get(layout.sensors[i].name, {}) for i in channels}
    uncertain = [i for i in channels if any(of_channel[i].values())]
    names = tuple(dict.fromkeys(name for i in uncertain for name in of_channel[i]))
    errors = np.array([[of_channel[i].get(name, 0.0) for name in names] for i in uncertain])
    exact = [layout.sensors[i].name for i in channels if i not in uncertain]
    remarks = []
    if uncertain:
        given = _listed([layout.sensors[i].name for i in uncertain])
        remarks.append(f'Standard errors contain the uncertainty of the gain of {given}.')
    if exact:
        remarks.append(
            f'The uncertainty of the gain of {_listed(exact)} is not given; standard errors do '
            'not contain it.'
        )
    return ReferenceGains(
        [(i, GAIN) for i in uncertain],
        names,
        errors.reshape(len(uncertain), len(names)),
        np.zeros(len(names)),
        tuple(remarks),
    )


def _listed(names: list[str]) -> str:
    more = len(names) - MOST_NAMES
    return ', '.join(names[:MOST_NAMES]) + (f' and {more} more' if more > 0 else '')
