# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Whether anything but the measured force tells how large the unknowns are."""

from identnl_ros.core.mechanics.model import Model
import numpy as np

FORCE_SETS_THE_SCALE = (
    'Masses and joints are all unknown, so they scale with the force: a gain of the force cells '
    'that is 1 % off makes every inertia, stiffness and damping 1 % wrong, and no data of these '
    'sensors can show it. State a mass that is known, or check the force cells.'
)


def force_scale_remarks(model: Model) -> tuple[str, ...]:
    """
    Tell where the equations of motion are homogeneous in the unknowns.

    Then the same motion belongs to a times the force and a times all coefficients: a common gain
    of the force cells, were it an unknown too, could not be told apart from them.

    Parameters
    ----------
    model : Model

    Returns
    -------
    tuple of str
        None where an inertia, a coefficient of a joint or a load is known, or nothing acts.

    """
    owners = (
        *(term.parameter for term in model.terms),
        *(parameter for parameter, _ in model.mass_vectors),
        *(load.parameter for load in model.loads),
    )
    known = {i for i in owners if i not in model.estimated and model.parameters[i].value != 0}
    if known or np.any(model.rotary_inertia) or not len(model.excitation_directions):
        return ()
    return (FORCE_SETS_THE_SCALE,)
