# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Sentences for the user after which nothing is to be done."""


class GoodNews(str):
    """A sentence among warnings that tells of a trouble that is over."""

    __slots__ = ()
