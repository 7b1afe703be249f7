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
# it is of second order only, and so is that of a hysteretic state where it turns. That of
# quadratic damping at its turn is of third, and small beside that of steep damping where the rate
# changes slowly.
TRANSITION_SHARE = 0.15
KINK_SHARE = 30.0
TURN_SHARE = 8.0
STEEP_SHARE = 10.0


def sharpest_rate(
    model: Model,
    displacements: Reals,
    velocities: Reals,
    interval: float,
    hidden: Reals | None = None,
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
    hidden : ndarray, shape (n_states, n_hidden), or None
        Hysteretic states passed; None: they may have been at their limits.

    Returns
    -------
    float
        [rad/s]; 0 for a machine whose laws have no sharp bends.

    """
    inverse_mass = 1 / model.mass_diagonal()
    columns = model.hidden_columns
    rates = [0.0]
    for index, term in enumerate(model.terms):
        if term.law.kind not in _RATES:
            continue
        line = model.lines[term.line]
        coefficient = abs(model.parameters[term.parameter].value * term.factor)
        pull = float(coefficient * (line**2 @ inverse_mass))
        if index in columns and hidden is not None:
            # The slope bends at a turn by as much as it has faded.
            largest = np.abs(hidden[:, columns[index]]).max(initial=0.0)
            pull *= min(1.0, float(largest / term.law.limit)) ** term.law.exponent
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
    """Return the rate of the turn, or the steepest damping over the mass if that is less."""
    fastest = float(np.abs(rate).max(initial=0.0))
    if fastest == 0.0:
        return 0.0
    acceleration = float(np.abs(np.diff(rate)).max(initial=0.0)) / interval
    # Damping times step times the square of how far the rate changes in a step: what an
    # integration step across the turn leaves, relative to the rate.
    turn = np.cbrt(pull * acceleration**2 / fastest)
    return float(min(TURN_SHARE * turn, STEEP_SHARE * 2 * pull * fastest))


_RATES = {
    LawKind.COULOMB: _friction,
    LawKind.STRIBECK: _friction,
    LawKind.BACKLASH: _kink,
    LawKind.BILINEAR: _kink,
    LawKind.QUADRATIC_DAMPING: _quadratic,
    LawKind.HYSTERESIS: _hysteresis,
}
