# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Machines that cannot exist are refused, by name."""

from dataclasses import replace

from identnl_ros.core.errors import MachineError
from identnl_ros.core.mechanics.machine import Body, ConstantForce, ExcitationPoint, Machine
import numpy as np
import pytest

from tests.core.machines import known, ORIGIN, skew_machine, X

SOUND = Body('bed', known(5.0), ORIGIN, np.diag([2.0, 3.0, 4.0]))


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({'mass': known(0.0)}, 'mass is 0'),
        ({'mass': known(-1.0)}, 'mass is -1'),
        ({'mass': known(np.inf)}, 'mass is inf'),
        ({'inertia': np.diag([1.0, 1.0, 2.1])}, 'sum of the others'),
        ({'inertia': np.diag([1.0, 1.0, -1.0])}, 'positive definite'),
        ({'inertia': np.diag([1.0, 1.0, np.nan])}, 'finite'),
        ({'inertia': np.eye(3) + np.triu(np.full((3, 3), 0.1), 1)}, 'symmetric'),
        ({'inertia': None}, 'inertia is missing'),
        ({'centre_of_mass': np.array([0.0, np.nan, 0.0])}, 'centre_of_mass'),
        ({'degrees_of_freedom': ('yaw',)}, 'yaw'),
        ({'degrees_of_freedom': ()}, 'at least one'),
        ({'degrees_of_freedom': ('rotation_1', 'rotation_1')}, 'once'),
    ],
)
def test_body_that_cannot_exist_is_refused(changes, says):
    with pytest.raises(MachineError, match=f'body bed.*{says}'):
        replace(SOUND, **changes)


def test_ground_is_no_body():
    with pytest.raises(MachineError, match='ground'):
        replace(SOUND, name='ground')


def test_thin_rod_and_flat_plate_are_bodies():
    replace(SOUND, inertia=np.diag([1e-6, 1.0, 1.0]))
    replace(SOUND, inertia=np.diag([1.0, 1.0, 2.0]))


@pytest.mark.parametrize(
    ('changes', 'says'),
    [
        ({'bodies': ()}, 'no bodies'),
        ({'gravity': np.array([0.0, np.inf, 0.0])}, 'gravity'),
        ({'excitations': (ExcitationPoint('rail', 'bed', ORIGIN, X),)}, 'two parts.*rail'),
        ({'excitations': (ExcitationPoint('e', 'tower', ORIGIN, X),)}, 'excitation e.*tower'),
        ({'excitations': (ExcitationPoint('e', 'bed', ORIGIN, X, 'bed'),)}, 'both ends'),
        ({'forces': (ConstantForce('f', 'tower', ORIGIN, X, known(1.0)),)}, 'force f.*tower'),
    ],
)
def test_parts_that_do_not_fit_together_are_refused(changes, says):
    with pytest.raises(MachineError, match=says):
        replace(skew_machine(), **changes)


def test_joint_on_no_body_is_refused():
    machine = skew_machine()
    with pytest.raises(MachineError, match=r'joint pad_0.*bed.*no body'):
        Machine('half', machine.bodies[1:], machine.joints)


@pytest.mark.parametrize(
    'arguments',
    [
        {'direction': np.zeros(3)},
        {'point': np.array([np.nan, 0, 0])},
        {'reaction_point': np.array([0, 0, np.inf])},
        {'amplitude': 0.0},
        {'frequency': -1.0},
        {'frequency': float('nan')},
        {'band': (5.0, 4.0)},
        {'band': (0.0, 4.0)},
        {'band': (1.0, float('nan'))},
    ],
)
def test_impossible_exciters_are_refused(arguments):
    with pytest.raises(MachineError, match='excitation shaker'):
        replace(ExcitationPoint('shaker', 'bed', ORIGIN, X), **arguments)
