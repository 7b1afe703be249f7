# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Recorded tables become bags that can be identified."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

SILVERBOX = Path(__file__).resolve().parents[3] / 'shared/data/silverbox/SNLS80mV.csv'


@pytest.fixture
def table(tmp_path):
    """Write a Duffing oscillator, integrated by scipy, as a digital voltmeter would."""
    rate = 1e7 / 2**14
    time = np.arange(8000) / rate
    mass, damping, stiffness, cubic = 5.2e-6, 2.3e-4, 0.966, 4.0
    phases = np.random.default_rng(1).uniform(0, 2 * np.pi, 90)
    frequencies = np.arange(1, 91)

    def force(t):
        return 0.006 * np.sin(2 * np.pi * np.multiply.outer(t, frequencies) + phases).sum(-1)

    def slope(t, state):
        x, v = state
        return v, (force(t) - damping * v - stiffness * x - cubic * x**3) / mass

    motion = solve_ivp(
        slope, (0, time[-1]), (0, 0), 'LSODA', time, rtol=1e-10, atol=1e-12, max_step=1e-3
    ).y[0]
    path = tmp_path / 'table.csv'
    np.savetxt(
        path, np.column_stack((force(time), motion)), fmt='%.9g', delimiter=',',
        header='V1,V2', comments='',
    )  # fmt: skip
    return path, {'mass.mass': mass, 'spring.damping': damping, 'spring.stiffness': stiffness,
                  'spring.cubic_stiffness': cubic}  # fmt: skip


def test_oscillator_is_identified_from_force_and_displacement_alone(
    document, table, config, tmp_path
):
    path, truth = table
    bag = tmp_path / 'table.mcap'
    made = document('import', path, '--layout', config / 'oscillator_layout.yaml', '--out', bag)
    assert made['samples'] == 8000
    # Cubic forces reach three times the highest frequency, near half the sample rate, where
    # no difference of displacements is exact.
    for estimator in ('weak', 'pointwise'):
        found = document(
            'identify', bag, '--machine', config / 'oscillator.yaml', '--estimator', estimator
        )
        values = {parameter['name']: parameter['value'] for parameter in found['parameters']}
        for name, value in truth.items():
            assert values[name] == pytest.approx(value, rel=1e-2)
    assert any('acceleration is not (fully) measured' in note for note in found['notes'])
    assert any('noise' in note for note in found['notes'])


def test_bag_without_a_machine_asks_for_one(identnl, table, config, tmp_path):
    bag = tmp_path / 'table.mcap'
    identnl('import', table[0], '--layout', config / 'oscillator_layout.yaml', '--out', bag)
    result = identnl('identify', bag)
    assert result.exit_code == 2
    assert '--machine' in result.stderr


def test_sensors_without_stated_noise_are_told_in_one_line(identnl, table, config, tmp_path):
    layout = config / 'oscillator_layout.yaml'
    result = identnl('import', table[0], '--layout', layout, '--out', tmp_path / 'a.mcap')
    lines = [line for line in result.stderr.splitlines() if 'does not state the noise' in line]
    assert len(lines) == 1
    assert lines[0].count(', ') == 1


def write_timed(path, name, rate):
    times = np.arange(2000) / rate
    rows = np.random.default_rng(1).standard_normal((2000, 2))
    np.savetxt(
        path, np.column_stack((times, rows, np.full(2000, 21.5))), fmt='%.9f', delimiter=';',
        header=f'{name};V1;V2;Temperatur [degC]', comments='',
    )  # fmt: skip
    return path


@pytest.mark.parametrize('name', ['Zeit [s]', 'time', 'Kanal 0'])
def test_time_of_twice_the_rate_does_not_make_a_bag(identnl, config, tmp_path, name):
    path = write_timed(tmp_path / 'a.csv', name, 2e7 / 2**14)
    out = tmp_path / 'a.mcap'
    arguments = ('import', path, '--layout', config / 'oscillator_layout.yaml', '--out', out)
    result = identnl(*arguments)
    assert result.exit_code == 2
    assert '610.351562 Hz' in result.stderr
    assert not out.exists()
    result = identnl(*arguments, '--ignore-column', name)
    assert result.exit_code == 0
    assert f'columns that no sensor reads: {name}, Temperatur [degC]' in result.stdout


def test_columns_that_nobody_reads_are_told(identnl, document, config, tmp_path):
    path = write_timed(tmp_path / 'a.csv', 'Zeit [s]', 1e7 / 2**14)
    layout = config / 'oscillator_layout.yaml'
    result = identnl('import', path, '--layout', layout, '--out', tmp_path / 'a.mcap')
    lines = result.stdout.splitlines()
    assert lines[1:3] == [
        'time checked by: Zeit [s]', 'columns that no sensor reads: Temperatur [degC]'
    ]  # fmt: skip
    made = document('import', path, '--layout', layout, '--out', tmp_path / 'b.mcap')
    assert made['time_columns'] == ['Zeit [s]']
    assert made['unused_columns'] == ['Temperatur [degC]']


def test_import_without_a_machine_says_what_identify_will_need(identnl, table, config, tmp_path):
    layout, machine = config / 'oscillator_layout.yaml', config / 'oscillator.yaml'
    bag = tmp_path / 'a.mcap'
    result = identnl('import', table[0], '--layout', layout, '--out', bag)
    told = [line for line in result.stdout.splitlines() if '--machine' in line]
    assert told == [f'no machine file is in it: identnl identify {bag} needs --machine FILE']
    arguments = ('import', table[0], '--layout', layout)
    result = identnl(*arguments, '--out', tmp_path / 'b.mcap', '--machine', machine)
    assert '--machine' not in result.stdout
    result = identnl(*arguments, '--out', tmp_path / 'c.mcap', '--json')
    assert '--machine' not in result.stdout + result.stderr


@pytest.mark.skipif(not SILVERBOX.exists(), reason=f'no measured record at {SILVERBOX}')
def test_measured_oscillator_hardens(document, config, tmp_path):
    bag = tmp_path / 'silverbox.mcap'
    document('import', SILVERBOX, '--layout', config / 'oscillator_layout.yaml', '--out', bag)
    found = document('identify', bag, '--machine', config / 'oscillator.yaml')
    values = {parameter['name']: parameter['value'] for parameter in found['parameters']}
    assert values['spring.cubic_stiffness'] > 0
    assert values['mass.mass'] > 0
    assert values['spring.damping'] > 0
    resonance = np.sqrt(values['spring.stiffness'] / values['mass.mass']) / (2 * np.pi)
    assert 60 < resonance < 80
    assert any('acceleration is not (fully) measured' in note for note in found['notes'])
