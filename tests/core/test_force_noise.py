# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Noise of the measured force: what it adds to errors, and where that cannot be told."""

from identnl_ros.core.estimation.estimate import EstimateStatus
from identnl_ros.core.estimation.identifier import identifier_for
from identnl_ros.core.measurement.transform import MotionTransform
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.sources.simulated import Excitation, SimulatedSource, TestRun
from identnl_ros.storage.layout_file import read_layout
from identnl_ros.storage.machine_file import read_machine
import numpy as np
import pytest

# A carriage on a base, shaken; the slideway's preload is 2 um.
MACHINE = """
machine: cross_slide
bodies:
  base:
    mass: 450 kg
    centre_of_mass: [0, 0, 200 mm]
    degrees_of_freedom: [translation_1, translation_2, translation_3]
  carriage:
    mass: 120 kg
    centre_of_mass: [0, 0, 500 mm]
    degrees_of_freedom: [translation_1, translation_2, translation_3]
joints:
  feet:
    kind: pad
    body: base
    to: ground
    point: [0, 0, 0]
    stiffness: [3 daN/um, 3 daN/um, 8 daN/um]
    damping: [8e3, 8e3, 2e4]
  guide:
    kind: slideway
    body: carriage
    to: base
    point: [0, 0, 0.4]
    normal: -z
    longitudinal: +x
    length: 400 mm
    width: 60 mm
    preload: 2 um
    normal_stiffness: {estimate: 3 daN/um^2}
    tangential_stiffness: {estimate: 6 daN/um}
    normal_damping: {estimate: 6e3 N*s/m}
    tangential_damping: {estimate: 3e3 N*s/m}
excitations:
  shaker:
    body: carriage
    point: [0, 0, 0.6]
    direction: [1, 0.5, 1]
    amplitude: AMPLITUDE
    frequency: 40 Hz
    band: [5 Hz, 300 Hz]
"""
LAYOUT = """
stand: cross_slide
sample_rate: 5 kHz
defaults:
  displacement: {unit: um, noise: 5 nm}
sensors:
  F: {kind: force, excitation: shaker, unit: daN, noise: 0.01 daN}
  base_x: {kind: displacement, body: base, point: [0, 0, 0.2], direction: +x}
  base_y: {kind: displacement, body: base, point: [0, 0, 0.2], direction: +y}
  base_z: {kind: displacement, body: base, point: [0, 0, 0.2], direction: +z}
  gap_x: {kind: displacement, body: carriage, relative_to: base, point: [0, 0, 0.4], direction: +x, noise: 2 nm}
  gap_y: {kind: displacement, body: carriage, relative_to: base, point: [0, 0, 0.4], direction: +y, noise: 2 nm}
  gap_z: {kind: displacement, body: carriage, relative_to: base, point: [0, 0, 0.4], direction: +z, noise: 2 nm}
"""  # noqa: E501


def estimate(amplitude, seconds, seed):
    machine = read_machine(MACHINE.replace('AMPLITUDE', amplitude), 'test')
    layout = read_layout(LAYOUT, 'test')
    run = TestRun(Excitation.MULTISINE, seconds, 5000.0, seed=seed)
    source = SimulatedSource(machine, layout, run)
    model = assemble(machine)
    transform = MotionTransform(model, layout, 5000.0)
    identifier = identifier_for(model, 'weak')
    for motion in map(transform.add, source.blocks()):
        if motion is not None:
            identifier.add(motion)
    return identifier.estimate(), source.truth


def deviations(found, truth):
    return [(one.value - truth[one.name]) / one.standard_deviation for one in found.parameters]


def test_intervals_hold_while_the_contact_stays_closed():
    found, truth = estimate('5 daN', 1.5, 1)
    assert all(one.status is EstimateStatus.OK for one in found.parameters)
    assert np.abs(deviations(found, truth)).max() < 4


# Four times the preload opens the contact now and then. Seen among seeds 1 to 6: estimates 30 and
# 53 standard deviations off (seed 1), noise of the force that grows 30-fold (seed 6).
@pytest.mark.parametrize(('seed', 'seconds'), [(1, 6.0), (6, 3.0)])
def test_estimates_from_a_motion_that_is_unstable_for_a_while_are_doubted(seed, seconds):
    found, _ = estimate('20 daN', seconds, seed)
    assert all(one.status is EstimateStatus.MODEL_IN_DOUBT for one in found.parameters)
    grows = any('Noise of the measured force grows for a while' in note for note in found.notes)
    assert grows == (seed == 6)
