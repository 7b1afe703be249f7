# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Numbers as people read them."""

from identnl_ros.core.readable import readable
import pytest


@pytest.mark.parametrize(
    ('value', 'digits', 'text'),
    [
        (1.96e-3, 3, '1.96 ms'),
        (7.09e-3, 3, '7.09 ms'),
        (-3.654e-6, 3, '-3.65 us'),
        (8.94e-7, 2, '890 ns'),
        (0.99996, 3, '1 s'),
        (0.0, 3, '0 s'),
        (float('inf'), 3, 'inf s'),
    ],
)
def test_prefix_leaves_one_to_three_digits_before_the_point(value, digits, text):
    assert readable(value, 's', digits) == text
