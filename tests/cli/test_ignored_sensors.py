# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sensors that an identification is told not to use."""

import pytest


@pytest.mark.parametrize('estimator', ['weak', 'pointwise', 'likelihood'])
def test_estimate_without_a_sensor_comes_from_the_others(document, bags, estimator):
    arguments = 'identify', bags / 'knee_column_sine.mcap', '--estimator', estimator
    found = document(*arguments, '--without', 'knee_s1x')
    (cost,) = [one for one in found['problems'] if 'ignored' in one]
    assert 'knee_s1x' in cost
    for parameter in found['parameters']:
        assert parameter['value'] == pytest.approx(parameter['true_value'], rel=1e-6)


def test_wrong_or_needed_sensor_is_refused_in_words(identnl, bags):
    bag = bags / 'knee_column_sine.mcap'
    for name, words in (
        ('front_lef', 'did you mean front_left'),
        ('force', 'no force sensor measures'),
    ):
        for estimator in ('weak', 'likelihood'):
            result = identnl('identify', bag, '--without', name, '--estimator', estimator)
            assert result.exit_code == 2
            assert words in result.stderr
