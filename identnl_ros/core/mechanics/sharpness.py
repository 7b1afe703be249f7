# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""How fast a motion passes the sharp bends of force laws, which its integration must resolve."""

from identnl_ros.core.mechanics.laws import LawKind
from identnl_ros.core.mechanics.model import Model, Term
import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]

# What the passage of a bend counts as, compared with an eigenvalue of the machine. The step of
# friction is smooth: few integration steps resolve it. A kink is not: the error of a step across
# it is of second order only, and so is that of a hysteretic state where it turns; that of
# quadratic damping at its turn is of third.
TRANSITION_SHARE = 0.15
KINK_SHARE = 30.0
TURN_SHARE = 10.0


def sharpest_rate(
    model: Model,
    displacements: Reals,
    velocities: Reals,
    interval: float,
) -> float:
    """
    Evaluate the rate that integration steps have to keep up with beside the eigenvalues.

    Parameters
    ----------
    model : Model
        All values known.
    displacements, velocities : ndarray, shape (n_states, n_coordinates)
        States passed, in time order.
    interval : float
        Between the states [s].

    Returns
    -------
    float
        [rad/s]; 0 for a machine whose laws have no sharp bends.

    """
    inverse_mass = 1 / model.mass_diagonal()
    rates = [0.0]
    for term in model.terms:
        if term.law.kind not in _RATES:
            continue
        line = model.lines[term.line]
        coefficient = abs(model.parameters[term.parameter].value * term.factor)
        pull = float(coefficient * (line**2 @ inverse_mass))
        rates.append(
            _RATES[term.law.kind](term, displacements @ line, velocities @ line, interval, pull)
        )
    return max(rates)


def _friction(term: Term, deformation: Reals, rate: Reals, interval: float, pull: float) -> float:
    """Return how fast the rate passes its transition; the eigenvalues know of its slope."""
    acceleration = np.abs(np.diff(rate)).max(initial=0.0) / interval
    width = term.law.transition
    if term.law.kind is LawKind.STRIBECK:
        width = min(width, term.law.fading)
    return TRANSITION_SHARE * float(acceleration) / width


def _kink(term: Term, deformation: Reals, rate: Reals, interval: float, pull: float) -> float:
    """Return the frequency of the spring that acts on one side of the kink, if that is passed."""
    if deformation.size == 0:
        return 0.0
    margin = interval * float(np.abs(rate).max(initial=0.0))
    low, high = float(deformation.min()) - margin, float(deformation.max()) + margin
    kinks = (term.law.gap, -term.law.gap)[: 2 if term.law.kind is LawKind.BACKLASH else 1]
    return KINK_SHARE * float(np.sqrt(pull)) if any(low < kink < high for kink in kinks) else 0.0


def _hysteresis(
    term: Term, deformation: Reals, rate: Reals, interval: float, pull: float
) -> float:
    """Return the rate at which the state approaches its limit, or its turns count."""
    fading = term.law.exponent * float(np.abs(rate).max(initial=0.0)) / term.law.limit
    return max(fading, KINK_SHARE * float(np.sqrt(pull)) if fading > 0 else 0.0)


def _quadratic(term: Term, deformation: Reals, rate: Reals, interval: float, pull: float) -> float:
    """Return the steepest damping, relative to the mass."""
    return TURN_SHARE * 2 * pull * float(np.abs(rate).max(initial=0.0))


_RATES = {
    LawKind.COULOMB: _friction,
    LawKind.STRIBECK: _friction,
    LawKind.BACKLASH: _kink,
    LawKind.BILINEAR: _kink,
    LawKind.QUADRATIC_DAMPING: _quadratic,
    LawKind.HYSTERESIS: _hysteresis,
}
