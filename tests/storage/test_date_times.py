# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Dates of tables keep their nanoseconds, and are refused where their meaning is not certain."""

from datetime import datetime, timedelta

from identnl_ros.storage.formats.date_times import (
    decimals,
    instants,
    nanoseconds,
    NOT_A_TIME,
    seconds_since,
)
import numpy as np
import pytest

INSTANT = int(np.datetime64('2026-11-22T18:40:07.123456789', 'ns').astype(np.int64))


@pytest.mark.parametrize(
    'text',
    [
        '2026-11-22T18:40:07.123456789', '2026-11-22 18:40:07.123456789Z',
        '2026/11/22 18:40:07,123456789', '22.11.2026 18:40:07.123456789',
        '"2026-11-22T20:40:07.123456789+02:00"', ' 2026-11-22T17:10:07.1234567890-0130 ',
    ],
)  # fmt: skip
def test_every_form_of_an_instant_is_the_same_to_the_nanosecond(text):
    assert nanoseconds(text) == INSTANT
    assert decimals(text) == 9


@pytest.mark.parametrize(
    ('text', 'seconds', 'digits'),
    [('00:00:00', 0, 0), ('1:02:03.5', 3723.5, 1), ('23:59', 86_340, -2), ('01.01.1970', 0, -5)],
)
def test_parts_of_an_instant_are_as_exact_as_they_are_written(text, seconds, digits):
    assert nanoseconds(text) == seconds * 1e9
    assert decimals(text) == digits


@pytest.mark.parametrize(
    'text',
    [
        '', 'Z', '11/22/2026 18:40:00', '6:40:00 PM', '31.02.2026', '2026-13-01', '25:00:00',
        '2026-11-2218:40:00', '1.5', '1,5', '20261122', '22.11.26',
        '9999-01-01',
    ],
)  # fmt: skip
def test_what_is_not_certain_is_not_understood(text):
    assert nanoseconds(text) is None


def test_instants_of_python_come_back():
    generator = np.random.default_rng(1)
    epoch = datetime(1970, 1, 1)
    for microseconds in generator.integers(0, 4 * 10**15, 200).tolist():
        moment = epoch + timedelta(microseconds=microseconds)
        assert nanoseconds(moment.isoformat()) == 1000 * microseconds
        german = moment.strftime('%d.%m.%Y %H:%M:%S,%f')
        assert nanoseconds(german) == 1000 * microseconds


@pytest.mark.parametrize('kind', ['M8[us]', 'U', 'S', object])
def test_arrays_of_times_are_seconds_since_an_origin(kind):
    steps = np.arange(5) * 78_125  # of 12.8 kHz [ns]
    times = np.datetime64('2026-11-22T18:40:07', 'ns') + 1000 * steps
    texts = [str(one) for one in times]
    values = times.astype(kind) if kind == 'M8[us]' else np.array(texts, kind)
    origin = nanoseconds(texts[0])
    np.testing.assert_array_equal(instants(values), origin + 1000 * steps)
    np.testing.assert_allclose(seconds_since(values, origin), 1e-6 * steps, rtol=1e-15)


def test_missing_times_are_no_numbers():
    values = np.array(['2026-11-22', '', '2026-11-23'])
    assert instants(values)[1] == NOT_A_TIME
    found = seconds_since(values, nanoseconds('2026-11-22'))
    np.testing.assert_array_equal(found, [0, np.nan, 86_400])
    found = seconds_since(np.array(['2026-11-22', 'NaT'], 'M8[s]'), nanoseconds('2026-11-22'))
    np.testing.assert_array_equal(found, [0, np.nan])
