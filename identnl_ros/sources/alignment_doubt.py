# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether estimates suffer from sources that are not aligned well enough."""

from collections.abc import Sequence

from identnl_ros.core.estimation.estimate import Estimate, NORMAL_QUANTILE
from identnl_ros.core.mechanics.model import Model
from identnl_ros.core.synchronisation.damping_cost import damped_modes, damping_cost
from identnl_ros.storage.alignment_record import AlignedSource
import numpy as np
from numpy.typing import NDArray

# Of a parameter, to find by how much it changes the damping of a mode [-].
STEP = 1e-4


def alignment_doubts(
    sources: Sequence[AlignedSource], model: Model, estimate: Estimate
) -> list[str]:
    """
    Tell which sources may be so late that damping is not in its interval.

    Those that the motion has aligned are left out: what their noise leaves unknown of the delay
    is as small beside what it leaves unknown of the parameters.

    Parameters
    ----------
    sources : sequence of AlignedSource
    model : Model
    estimate : Estimate

    Returns
    -------
    list of str
        In sentences; empty: what the delays cost is less than the estimates' 95 % intervals.

    """
    late = [one for one in sources if one.deviation > 0 and not one.by_motion]
    values, known = _values(model, estimate)
    frequencies, ratios = damped_modes(model.with_values(values)) if late else (np.empty(0),) * 2
    if not frequencies.size:
        values, known = model.values, np.zeros(len(model.values), dtype=bool)
        frequencies, ratios = damped_modes(model) if late else (np.empty(0),) * 2
    if not frequencies.size:
        return []
    interval = NORMAL_QUANTILE * _deviations(model, values, known, estimate, ratios) / ratios
    sentences = []
    for one in late:
        bound = NORMAL_QUANTILE * one.deviation
        cost = np.abs(damping_cost(bound, frequencies, ratios))
        worst = int(np.argmax(np.where(cost > interval, cost, 0.0)))
        if cost[worst] > interval[worst]:
            sentences.append(
                f'{one.name}: a delay of {bound * 1e6:.3g} us against the other files of the run '
                f'may remain ({", ".join(one.channels)}); it changes the damping of the mode at '
                f'{frequencies[worst]:.4g} Hz by up to {_share(float(cost[worst]))}, while its '
                f'interval is +-{_share(float(interval[worst]))}'
            )
    return sentences


def _share(value: float) -> str:
    return f'{value:.2g} times' if value >= 10 else f'{100 * value:.2g} %'


def _values(model: Model, estimate: Estimate) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Values of all parameters, estimated ones where there are, and which those are."""
    found = {one.name: one.value for one in estimate.parameters if np.isfinite(one.value)}
    values = model.values.copy()
    known = np.zeros(len(values), dtype=bool)
    for place, parameter in enumerate(model.parameters):
        if parameter.name in found:
            values[place], known[place] = found[parameter.name], True
    return values, known


def _deviations(
    model: Model,
    values: NDArray[np.float64],
    known: NDArray[np.bool_],
    estimate: Estimate,
    ratios: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Find the standard deviations of the modes' damping ratios."""
    names = [one.name for one in estimate.parameters]
    places = np.flatnonzero(known)
    rows = [names.index(model.parameters[place].name) for place in places]
    covariance = estimate.covariance[np.ix_(rows, rows)]
    slopes = np.zeros((len(ratios), len(places)))
    for column, place in enumerate(places):
        step = STEP * abs(values[place]) or STEP
        moved = values.copy()
        moved[place] += step
        _, other = damped_modes(model.with_values(moved))
        if len(other) == len(ratios):
            slopes[:, column] = (other - ratios) / step
    spread = np.einsum('mi,ij,mj->m', slopes, np.nan_to_num(covariance), slopes)
    return np.asarray(np.sqrt(np.clip(spread, 0.0, None)))
