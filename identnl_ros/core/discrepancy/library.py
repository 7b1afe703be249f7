# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""All effects that can be named, and the hypotheses that they make about a stand."""

from collections.abc import Mapping, Sequence

from identnl_ros.core.discrepancy.circumstances import Scale
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.effect import Effect, Hypothesis
from identnl_ros.core.discrepancy.effects.added_inertia import AddedInertia
from identnl_ros.core.discrepancy.effects.added_mass import AddedMass
from identnl_ros.core.discrepancy.effects.backlash import Backlash
from identnl_ros.core.discrepancy.effects.bilinear_stiffness import BilinearStiffness
from identnl_ros.core.discrepancy.effects.constant_force import UnknownConstantForce
from identnl_ros.core.discrepancy.effects.contact_opening import ContactOpening
from identnl_ros.core.discrepancy.effects.coulomb_friction import CoulombFriction
from identnl_ros.core.discrepancy.effects.coupled_contact import CoupledContact
from identnl_ros.core.discrepancy.effects.cubic_stiffness import CubicStiffness
from identnl_ros.core.discrepancy.effects.drifting_stiffness import DriftingStiffness
from identnl_ros.core.discrepancy.effects.force_delay import ForceDelay
from identnl_ros.core.discrepancy.effects.force_gain import ForceGain
from identnl_ros.core.discrepancy.effects.hidden_oscillator import HiddenOscillator
from identnl_ros.core.discrepancy.effects.hysteresis import Hysteresis
from identnl_ros.core.discrepancy.effects.linear_stiffness import LinearStiffness
from identnl_ros.core.discrepancy.effects.missing_joint import MissingJoint
from identnl_ros.core.discrepancy.effects.quadratic_damping import QuadraticDamping
from identnl_ros.core.discrepancy.effects.quadratic_stiffness import QuadraticStiffness
from identnl_ros.core.discrepancy.effects.sensor_drift import SensorDrift
from identnl_ros.core.discrepancy.effects.sensor_faults import (
    ExchangedChannels,
    KindDelay,
    SensorDelay,
    SensorGain,
    SensorOffset,
    SwappedPolarity,
    WrongDirection,
)
from identnl_ros.core.discrepancy.effects.shifted_centre_of_mass import ShiftedCentreOfMass
from identnl_ros.core.discrepancy.effects.stribeck_friction import StribeckFriction
from identnl_ros.core.discrepancy.effects.unmeasured_periodic_force import (
    UnmeasuredPeriodicForce,
)
from identnl_ros.core.discrepancy.effects.viscous_damping import ViscousDamping
from identnl_ros.core.discrepancy.effects.wrong_exponent import WrongExponent
from identnl_ros.core.discrepancy.effects.wrong_preload import WrongPreload

EFFECTS: tuple[Effect, ...] = (
    CoulombFriction(),
    StribeckFriction(),
    QuadraticDamping(),
    Backlash(),
    BilinearStiffness(),
    Hysteresis(),
    LinearStiffness(),
    QuadraticStiffness(),
    CubicStiffness(),
    DriftingStiffness(),
    ViscousDamping(),
    WrongExponent(),
    WrongPreload(),
    CoupledContact(),
    ContactOpening(),
    MissingJoint(),
    AddedMass(),
    AddedInertia(),
    ShiftedCentreOfMass(),
    UnknownConstantForce(),
    HiddenOscillator(),
    UnmeasuredPeriodicForce(),
    SensorGain(),
    SwappedPolarity(),
    SensorOffset(),
    SensorDrift(),
    SensorDelay(),
    KindDelay(),
    ExchangedChannels(),
    WrongDirection(),
    ForceGain(),
    ForceDelay(),
)


# A sensor that reads another one's motion deviates from its own by this many times its noise.
SUSPICIOUS = 1.5


def hypotheses_about(
    description: Description,
    scale: Scale,
    ratios: Mapping[str, float],
    effects: Sequence[Effect] = EFFECTS,
) -> tuple[Hypothesis, ...]:
    """
    List everything that may be missing.

    Parameters
    ----------
    description : Description
    scale : Scale
        Of the motion in the data: inner parameters are tried where it can show them.
    ratios : mapping of str to float
        Deviation of every sensor over its noise.
    effects : sequence of Effect

    Returns
    -------
    tuple of Hypothesis

    """
    return tuple(
        Hypothesis(effect, place, inner)
        for effect in effects
        for place in effect.places(description)
        if not effect.hidden_in(description, place)
        and not (
            place.other in ratios and min(ratios[place.part], ratios[place.other]) < SUSPICIOUS
        )
        for inner in effect.variants(description, place, scale)
    )
