# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""A saved factor keeps its extended precision; files that lack it are read as before."""

from dataclasses import replace

from identnl_ros.core.algebra.information import Information
from identnl_ros.core.errors import DataError
from identnl_ros.core.pointwise.identifier_state import IdentifierState
from identnl_ros.core.pointwise.noise_bias import SlopeSums
from identnl_ros.core.pointwise.scatter import Scatter
from identnl_ros.storage.state_file import load_state, save_state
import numpy as np
import pytest


def state_of(information):
    size = information.size
    return IdentifierState(
        information,
        Scatter.empty(size),
        SlopeSums(samples=0, sums=np.zeros(1), products=np.zeros((1, 1))),
        None,
        np.zeros((size + 1, size + 1)),
        np.zeros((0, 4, 1)),
        0,
        0,
        tuple(f'k{i}' for i in range(size)),
        frozenset(),
        False,
        None,
        0,
    )


def regression():
    generator = np.random.default_rng(0)
    regressor = generator.standard_normal((50, 4))
    return Information.empty(4).with_rows(regressor, generator.standard_normal(50))


def test_factor_and_fraction_of_rows_survive_to_the_last_bit(tmp_path):
    information = regression().discounted(0.9)
    save_state(tmp_path / 'a.npz', state_of(information))
    loaded = load_state(tmp_path / 'a.npz').information
    np.testing.assert_array_equal(loaded.extended, information.extended)
    assert type(loaded.rows) is float
    assert loaded.rows == information.rows


def test_file_without_extended_precision_is_read(tmp_path):
    information = replace(regression(), tail=None)
    save_state(tmp_path / 'a.npz', state_of(information))
    with np.load(tmp_path / 'a.npz') as archive:
        assert not any('tail' in name for name in archive.files)
        assert all(
            archive[name].dtype.itemsize <= 8 or archive[name].dtype.kind == 'U'
            for name in archive.files
        )
    loaded = load_state(tmp_path / 'a.npz').information
    assert loaded.tail is None
    np.testing.assert_array_equal(loaded.factor, information.factor)


def test_damaged_tail_is_refused(tmp_path):
    save_state(tmp_path / 'a.npz', state_of(regression()))
    with np.load(tmp_path / 'a.npz') as archive:
        content = dict(archive)
    content['information.tail'] = np.zeros((2, 2))
    np.savez(tmp_path / 'a.npz', **content)
    with pytest.raises(DataError, match='damaged'):
        load_state(tmp_path / 'a.npz')
