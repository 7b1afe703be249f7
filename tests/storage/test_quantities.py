# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Units as people write them, against SI values worked out by hand."""

import math

from identnl_ros.core.mechanics.coefficients import Tie
from identnl_ros.storage.quantities import coefficients, convert, direction, Quantity
import numpy as np
import pytest

MASS = Quantity('kg', 'a mass such as "900 kg"')


@pytest.mark.parametrize(
    ('text', 'unit', 'expected'),
    [
        ('900', 'kg', 900.0),
        ('900 kg', 'kg', 900.0),
        ('0.9 t', 'kg', 900.0),
        ('900000 g', 'kg', 900.0),
        ('380 daN/um^2', 'N/m^2', 3.8e15),  # 3800 N / 1e-12 m^2
        ('380 daN/µm^2', 'N/m^2', 3.8e15),  # micro sign
        ('380 daN/μm²', 'N/m^2', 3.8e15),  # Greek mu, superscript
        ('380 daN/um**2', 'N/m^2', 3.8e15),
        ('15 daN/um', 'N/m', 1.5e8),
        ('100 daN', 'N', 1000.0),
        ('2 N/um^1.5', 'N/m^1.5', 2e9),  # (1e6)^1.5
        ('0.6 um', 'm', 6e-7),
        ('-20 mm', 'm', -0.02),
        ('1 inch', 'm', 0.0254),
        ('+.5e-1 km', 'm', 50.0),
        ('8e3 N*s/m', 'N*s/m', 8000.0),
        ('8 N s/mm', 'N*s/m', 8000.0),
        ('3 kN*m/rad', 'N*m', 3000.0),
        ('2 N*m/degree', 'N*m', 2 * 180 / math.pi),
        ('190 kg m^2', 'kg*m^2', 190.0),
        ('10 kHz', 'Hz', 1e4),
        ('25 us', 's', 2.5e-5),
        ('10 mV/(m/s^2)', 'V/(m/s^2)', 0.01),
        ('98.0665 mV/g_0', 'V/(m/s^2)', 0.01),  # g_0 = 9.80665 m/s^2
        ('5 %', '', 0.05),
    ],
)
def test_text_with_unit_becomes_the_si_number_worked_out_by_hand(text, unit, expected):
    found = Quantity(unit, 'x').number(text)

    assert found == pytest.approx(expected, rel=1e-14)


def test_decimal_units_convert_without_rounding_error():
    assert Quantity('N/m^2', 'x').number('380 daN/um^2') == 3.8e15
    assert Quantity('m', 'x').number('0.6 um') == 6e-7


@pytest.mark.parametrize(
    ('value', 'number', 'estimated'),
    [
        ('900 kg', 900.0, False),
        ({'known': '900 kg'}, 900.0, False),
        ({'estimate': '0.9 t'}, 900.0, True),
        ({'estimate': '900'}, 900.0, True),
        ('estimate', math.nan, True),
    ],
)
def test_coefficient_is_known_or_to_be_estimated(value, number, estimated):
    found = MASS.coefficient(value)

    assert found.value == pytest.approx(number, nan_ok=True)
    assert found.estimated is estimated


@pytest.mark.parametrize(
    ('value', 'tie'),
    [
        ({'same_as': 'knee.mass'}, Tie('knee.mass')),
        ({'same_as': 'knee.mass', 'times': '1.2'}, Tie('knee.mass', 1.2)),
        (
            {'same_as': 'side-way_6.stiffness_1', 'times': '5 %'},
            Tie('side-way_6.stiffness_1', 0.05),
        ),
    ],
)
def test_coefficient_may_follow_another_one(value, tie):
    found = MASS.coefficient(value)

    assert found.tie == tie
    assert not found.estimated
    assert math.isnan(found.value)
    with pytest.raises(ValueError, match='must be known and cannot be tied'):
        MASS.number(value)


def test_search_needs_a_start_where_it_says_so():
    assert MASS.coefficient_with_start({'estimate': '2'}).value == 2.0
    with pytest.raises(ValueError, match='needs a start'):
        MASS.coefficient_with_start('estimate')


@pytest.mark.parametrize('value', ['estimate', {'estimate': '900 kg'}])
def test_number_that_must_be_known_cannot_be_estimated(value):
    with pytest.raises(ValueError, match='must be known and cannot be estimated'):
        MASS.number(value)


@pytest.mark.parametrize(
    'value',
    [
        '',
        'abc',
        'true',
        'nan',
        '.inf',
        '1e999',
        '1e308 Gg',
        '900 m',
        '900 kgg',
        '900 kg kg',
        '9,5 kg',
        '900 degC',
        '900 dB',
        '900 ((',
        '9**9',
        '٣ kg',
        '900 kg^-',
        ['900 kg'],
        {},
        {'guess': '900 kg'},
        {'known': '1', 'estimate': '2'},
        {'estimate': {'estimate': '1'}},
    ],
)
def test_what_is_no_mass_is_refused_with_words_of_what_is_expected(value):
    with pytest.raises(ValueError, match=r'^found .* expected a mass such as "900 kg"'):
        MASS.coefficient(value)


@pytest.mark.parametrize(
    'text',
    ['1 9**9**9**9', '1 m**999999999', '1 m^9^9^9^9^9', '1 ' + 'm*' * 1000, '1 km^99*km^99'],
)
@pytest.mark.timeout(5)
def test_absurd_powers_are_refused_and_not_computed(text):
    with pytest.raises(ValueError, match='no known unit'):
        Quantity('m', 'x').number(text)


@pytest.mark.parametrize('text', ['251 rad/s', '2400 rpm', '14400 degree/s'])
def test_angular_velocity_is_no_frequency(text):
    with pytest.raises(ValueError, match='angular velocity'):
        Quantity('Hz', 'x').number(text)


def test_vector_and_matrix_convert_every_item():
    length = Quantity('m', 'x')

    np.testing.assert_array_equal(length.vector(['300 mm', '-1', '2e6 um']), [0.3, -1.0, 2.0])
    np.testing.assert_array_equal(
        length.matrix([['1', '2', '3'], ['4', '5', '6'], ['7', '8', '9 m']]),
        np.arange(1.0, 10.0).reshape(3, 3),
    )


@pytest.mark.parametrize('value', ['1', ['1', '2'], ['1', '2', 'x'], [['1'], '2', '3']])
def test_wrong_vectors_are_refused(value):
    with pytest.raises(ValueError, match='found'):
        Quantity('m', 'x').vector(value)


def test_every_place_of_a_list_has_its_own_unit():
    found = coefficients(
        ['1 N/um', {'estimate': '2 N*m/rad'}], (Quantity('N/m', 'x'), Quantity('N*m', 'y'))
    )

    assert [one.value for one in found] == [1e6, 2.0]
    assert [one.estimated for one in found] == [False, True]


def test_error_in_a_list_tells_which_number():
    with pytest.raises(ValueError, match='number 2: found "3 kg"'):
        coefficients(['1', '3 kg'], 2 * (Quantity('N/m', 'a stiffness'),))


@pytest.mark.parametrize(
    ('value', 'expected'),
    [
        ('+x', [1, 0, 0]),
        ('y', [0, 1, 0]),
        ('-z', [0, 0, -1]),
        (['1', '-2.5', '0'], [1, -2.5, 0]),
    ],
)
def test_direction_is_an_axis_or_three_numbers(value, expected):
    np.testing.assert_array_equal(direction(value), expected)


@pytest.mark.parametrize('value', ['up', '+w', '', ['1', '2'], ['1 m', '0', '0']])
def test_wrong_directions_are_refused(value):
    with pytest.raises(ValueError, match='found'):
        direction(value)


def test_conversion_within_one_unit_returns_the_same_bits():
    assert convert(0.1 + 0.2, 'm', 'metre') == 0.1 + 0.2
