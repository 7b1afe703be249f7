# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""What data could not contradict: errors of ordinary size that would pass for other parameters."""

from collections.abc import Sequence
from dataclasses import dataclass

from identnl_ros.core.estimation.estimate import Estimate, NORMAL_QUANTILE
from identnl_ros.core.estimation.score_tests import ScoreTest
from identnl_ros.core.mechanics.model import Model
import numpy as np

MOST_TOLD = 4


@dataclass(frozen=True)
class UnseenError:
    """
    An error of ordinary size that would not be seen, and would matter.

    Parameters
    ----------
    test : ScoreTest
    size : float
        Of the error [SI].
    parameter : str
        Name of the one that it would change most.
    change : float
        Of that parameter, as a share of its value.

    """

    test: ScoreTest
    size: float
    parameter: str
    change: float


def unseen_errors(
    tests: Sequence[ScoreTest], estimate: Estimate, model: Model, rate: float
) -> list[UnseenError]:
    """
    Find errors that would change a parameter beyond its interval and stay below the tests' limit.

    Parameters
    ----------
    tests : sequence of ScoreTest
    estimate : Estimate
        Its parameters are the unknowns of the tests.
    model : Model
    rate : float
        Of false alarms of all tests together.

    Returns
    -------
    list of UnseenError
        The worst first.

    """
    values = np.array([one.value for one in estimate.parameters])
    reach = NORMAL_QUANTILE * np.array([one.standard_deviation for one in estimate.parameters])
    seen = sum(np.isfinite(one.deviation) for one in tests)
    limits = [
        one.critical(rate / seen) * one.deviation if np.isfinite(one.deviation) else np.inf
        for one in tests
    ]
    found = []
    for one, limit in zip(tests, limits, strict=True):
        size = one.alternative.ordinary(model)
        if not size < limit:
            continue
        change = np.abs(one.effect * size)
        # NaN where a parameter is not determined: not larger than anything.
        matters = (change > reach) & (values != 0)
        if matters.any():
            shares = np.where(matters, change / np.abs(np.where(values != 0, values, 1.0)), 0.0)
            worst = int(np.argmax(shares))
            name = estimate.parameters[worst].name
            found.append(UnseenError(one, size, name, float(shares[worst])))
    return sorted(found, key=lambda error: -error.change)


def unseen_note(errors: Sequence[UnseenError], model: Model) -> str:
    """
    Say what would not be seen.

    Parameters
    ----------
    errors : sequence of UnseenError
        The worst first.
    model : Model

    Returns
    -------
    str
        A sentence; empty: nothing of the kind.

    """
    if not errors:
        return ''
    told = [
        f'{one.test.alternative.in_words(model, one.size)} (it would change {one.parameter} by '
        f'{100 * one.change:.2g} %)'
        for one in errors[:MOST_TOLD]
    ]
    if len(errors) > MOST_TOLD:
        told.append(f'{len(errors) - MOST_TOLD} more')
    listed = ', '.join(told[:-1]) + (' or ' if told[1:] else '') + told[-1]
    advice = 'Excite more frequencies to have them tested.'
    if all(model.parameters[index].estimated for index, _ in model.mass_vectors):
        advice += ' No mass is known: the scale of all results is that of the force.'
    return (
        f'Nothing in these data would contradict {listed}: the intervals hold if these are right. '
        f'{advice}'
    )
