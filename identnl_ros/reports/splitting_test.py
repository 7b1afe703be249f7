# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Which further test would tell two effects apart that one record does not tell apart."""

from identnl_ros.core.discrepancy.effect import Hypothesis, SensorFault

# Their forces grow with the acceleration; those of joints do not.
_INERTIAL = {'added_mass', 'added_inertia', 'shifted_centre_of_mass'}


def splitting_test(first: Hypothesis, second: Hypothesis) -> str:
    """
    Say which record would split two effects.

    Parameters
    ----------
    first, second : Hypothesis

    Returns
    -------
    str
        An instruction.

    """
    for one in (first, second):
        if isinstance(one.effect, SensorFault):
            return f'put another sensor beside {one.place.part}'
    if first.place != second.place:
        return 'excite at another point or in another direction'
    if (first.effect.name in _INERTIAL) != (second.effect.name in _INERTIAL):
        return 'excite over a wider band of frequencies'
    return 'excite with half and with twice the force'
