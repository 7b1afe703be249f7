# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Pictures and tables of a diagnosis say what it found, of joints and of sensors."""

from dataclasses import replace
from io import BytesIO, StringIO

from identnl_ros.core.discrepancy.checked_diagnosis import CheckedDiagnosis
from identnl_ros.core.discrepancy.description import Description
from identnl_ros.core.discrepancy.diagnosis import Diagnosis, Verdict
from identnl_ros.core.discrepancy.effect import Hypothesis
from identnl_ros.core.discrepancy.held_out import held_out_error
from identnl_ros.core.discrepancy.hidden_effect import choose_place
from identnl_ros.core.discrepancy.library import EFFECTS
from identnl_ros.core.discrepancy.named_effect import NamedEffect
from identnl_ros.core.discrepancy.rereading import reread
from identnl_ros.core.discrepancy.selection import Finding
from identnl_ros.core.discrepancy.settled_model import settled
from identnl_ros.core.measurement.measured_record import MeasuredRecord
from identnl_ros.core.mechanics.assembly import assemble
from identnl_ros.core.simulation.stand import SimulatedStand
from identnl_ros.reports.diagnosis_plots import diagnosis_plots
from identnl_ros.reports.diagnosis_tables import diagnosis_markdown, sheets, show_diagnosis
from identnl_ros.reports.plot_style import prefixed
from identnl_ros.reports.splitting_test import splitting_test
from matplotlib.image import imread
import numpy as np
import pytest
from rich.console import Console

from tests.core.test_diagnosis import signals, small_machine
from tests.reference_machines import complete_layout

RATE = 4000.0
BY_NAME = {effect.name: effect for effect in EFFECTS}


def hypothesis(believed, name, place, inner=None):
    (chosen,) = choose_place(BY_NAME[name], believed, place)
    return Hypothesis(chosen.effect, chosen.place, inner or {})


@pytest.fixture(scope='module')
def believed():
    machine = small_machine()
    return Description(machine, complete_layout(machine, 10e-9, 0.01, 2e-6))


def checked(believed, missing, size, rivals=()):
    """Tell what a diagnosis would that knows the truth."""
    truth = missing.applied(believed, size)
    stand = SimulatedStand(
        assemble(truth.machine), truth.layout, signals(), RATE, 7, 1,
        declared_layout=believed.layout,
    )  # fmt: skip
    record = MeasuredRecord(believed.layout, RATE, stand.read(2000).samples[976:])
    models, errors = [], []
    for one in (believed, truth):
        own = reread(record, one.layout)
        models.append(settled(one, assemble(one.machine), own, held=True))
        errors.append(held_out_error(one, models[-1].model, own))
    named = NamedEffect(Finding(missing, size, 0.01 * size, 1e4, 1e-9, rivals), size, 0.01 * size)
    detectable = {missing.effect.name: (missing.place.label, size / 50, 'N')}
    diagnosis = Diagnosis(Verdict.EXPLAINED, (named,), (), models[0], models[1], detectable)
    return CheckedDiagnosis(diagnosis, believed.machine, 1024, 1024, RATE, *errors, ())


@pytest.fixture(scope='module')
def friction(believed):
    inner = {'transition_velocity': 2e-4}
    missing = hypothesis(believed, 'coulomb_friction', 'rail.axis_2', inner)
    rival = hypothesis(believed, 'quadratic_damping', 'rail.axis_2')
    return checked(believed, missing, 2.0, (rival,))


def pictures(result):
    return {name: imread(BytesIO(content)) for name, _, content in diagnosis_plots(result)}


def test_friction_is_drawn_four_times(friction):
    found = pictures(friction)
    assert list(found) == ['residual.png', 'restoring_force.png', 'spectra.png', 'traces.png']
    for picture in found.values():
        height, width, _ = picture.shape
        assert 200 < height < 2000
        assert 600 < width < 2000
        # Something is drawn, black on white.
        shades = picture[:, :, :3].mean(axis=2)
        assert shades.min() < 0.1
        assert 0.5 < (shades > 0.99).mean() < 0.99


def test_faulty_sensor_is_drawn(believed):
    missing = hypothesis(believed, 'swapped_polarity', 'table_displacement_1x')
    assert len(pictures(checked(believed, missing, 1.0))) == 4


def test_tables_say_what_is_missing_and_how_to_split_it_from_another(friction):
    stream = StringIO()
    show_diagnosis(friction, Console(file=stream, width=200))
    text = stream.getvalue()
    assert 'Coulomb friction' in text
    assert 'rail, along its axis 2' in text
    assert '0.2 ± 0.002 daN' in text
    assert 'quadratic damping (rail, along its axis 2)' in text
    assert 'excite with half and with twice the force' in text
    assert 'displacement [µm]' in text


def test_table_of_held_out_errors_falls_to_the_noise(friction):
    found = {sheet.title: sheet for sheet in sheets(friction)}
    for row in found['Error on held-out data, root mean square'].rows:
        before, after, noise = (float(cell) for cell in row[1:])
        assert after == pytest.approx(noise, rel=0.15)
        assert before > 1.2 * noise


def test_markdown_has_tables_and_pictures(friction):
    text = ''.join(diagnosis_markdown(friction, {'residual.png': 'What is left'}))
    assert '![What is left](residual.png)' in text
    assert '| Coulomb friction | rail, along its axis 2 | force 0.2 ± 0.002 daN |' in text


def test_what_splits_two_effects_changes_what_their_forces_depend_on(believed):
    def split(*labels):
        return splitting_test(*(hypothesis(believed, *one) for one in labels))

    mass, friction = ('added_mass', 'table'), ('coulomb_friction', 'rail.axis_1')
    assert 'point' in split(friction, ('coulomb_friction', 'rail.axis_2'))
    assert 'force' in split(friction, ('viscous_damping', 'rail.axis_1'))
    assert 'table_velocity_2z' in split(mass, ('sensor_gain', 'table_velocity_2z'))


@pytest.mark.parametrize(
    ('unit', 'largest', 'expected'),
    [('m', 3e-6, 'µm'), ('N', 800.0, 'N'), ('N', 4e3, 'kN'), ('m', 0.0, 'm'), ('m', 1e-12, 'nm')],
)
def test_prefix_gives_numbers_that_can_be_read(unit, largest, expected):
    assert prefixed(unit, np.array([-largest, 0.0])).name == expected


def test_unexplained_difference_is_drawn_without_a_model_after(friction):
    diagnosis = replace(
        friction.diagnosis, verdict=Verdict.UNEXPLAINED, named=(), after=friction.diagnosis.before
    )
    unexplained = replace(friction, diagnosis=diagnosis, after=friction.before)
    assert len(pictures(unexplained)) == 4
    assert [sheet.title for sheet in sheets(unexplained)] == [
        'Error on held-out data, root mean square',
        'Smallest sizes that this record would have shown',
    ]
