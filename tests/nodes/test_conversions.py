# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0

"""Messages hold every bit of the core's values, and damaged ones are refused in a sentence."""

from dataclasses import fields, replace

from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import (
    CombinationEstimate,
    Estimate,
    EstimateStatus,
    ParameterEstimate,
)
from identnl_ros.core.measurement.blocks import LARGEST_INDEX, MotionBlock, SampleBlock
import numpy as np
import pytest

pytestmark = pytest.mark.ros

SPECIAL = (np.nan, np.inf, -np.inf, -0.0, 5e-324, np.finfo(float).max)


@pytest.fixture
def conversions():
    import identnl_ros.nodes.conversions as module

    return module


@pytest.fixture(params=range(5))
def random(request):
    return np.random.default_rng(request.param)


def numbers(random, *shape):
    """Bit patterns of all kinds, NaN with payloads among them."""
    values = np.frombuffer(random.bytes(8 * int(np.prod(shape))), np.float64).copy()
    values[: len(SPECIAL)] = SPECIAL[: len(values)]
    return values.reshape(shape)


def over_the_wire(message):
    from rclpy.serialization import deserialize_message, serialize_message

    return deserialize_message(serialize_message(message), type(message))


def sample_block(random, channels=7, samples=13):
    return SampleBlock(
        stream_id=int(random.integers(2**64, dtype=np.uint64)),
        stamp_ns=int(random.integers(2**60)),
        first_index=int(random.integers(LARGEST_INDEX)),
        sample_rate=float(random.uniform(1, 1e6)),
        samples=numbers(random, samples, channels),
        channel_status=random.integers(0, 4, channels).astype(np.uint8),
        last=bool(random.integers(2)),
    )


def motion_block(random, coordinates=5, samples=11):
    tables = {}
    for name in ('displacement', 'velocity', 'acceleration', 'force'):
        tables[name] = numbers(random, samples, coordinates)
        tables[f'{name}_covariance'] = numbers(random, coordinates, coordinates)
    name = 'displacement_acceleration_covariance'
    tables[name] = numbers(random, coordinates, coordinates)
    return MotionBlock(
        stream_id=int(random.integers(2**64, dtype=np.uint64)),
        stamp_ns=int(random.integers(2**60)),
        first_index=int(random.integers(LARGEST_INDEX)),
        sample_rate=float(random.uniform(1, 1e6)),
        coordinates=tuple(f'body.translation_{i}' for i in range(coordinates)),
        **tables,
        noise_estimated=bool(random.integers(2)),
        velocity_derived=bool(random.integers(2)),
        acceleration_derived=bool(random.integers(2)),
        last=bool(random.integers(2)),
    )


def assert_same(found, expected):
    for field in fields(expected):
        value, wanted = getattr(found, field.name), getattr(expected, field.name)
        if isinstance(wanted, np.ndarray):
            assert value.dtype == wanted.dtype
            assert value.shape == wanted.shape
            assert value.tobytes() == wanted.tobytes()
        else:
            assert value == wanted


def test_block_of_samples_returns_to_the_last_bit(conversions, random):
    block = sample_block(random)
    message = over_the_wire(conversions.block_to_message(block))
    assert_same(conversions.block_from_message(message), block)


def test_block_of_motion_returns_to_the_last_bit(conversions, random):
    block = motion_block(random)
    message = over_the_wire(conversions.motion_to_message(block))
    assert_same(conversions.motion_from_message(message), block)


def test_estimate_returns_to_the_last_bit(random):
    from identnl_ros.nodes.estimate_conversion import estimate_from_message, estimate_to_message

    values = numbers(random, len(EstimateStatus), 2)
    estimate = Estimate(
        estimator='pointwise',
        parameters=tuple(
            ParameterEstimate(f'joint.p{i}', 'a', 'N/m', float(v), float(s), status, 'why')
            for i, (status, (v, s)) in enumerate(zip(EstimateStatus, values, strict=True))
        ),
        covariance=numbers(random, len(values), len(values)),
        samples=2**40,
        rejected_samples=3,
        residual=float('nan'),
        condition_number=float('inf'),
        combinations=(CombinationEstimate('a + b', 3.0, 0.5),),
        notes=('one', 'two'),
    )
    message = estimate_to_message(
        estimate, stand='s', stream_id=2**64 - 1, stamp=5, last_index=9, stream_ended=True
    )
    found = estimate_from_message(over_the_wire(message))
    assert found.covariance.tobytes() == estimate.covariance.tobytes()
    for parameter, expected in zip(found.parameters, estimate.parameters, strict=True):
        for name in ('value', 'standard_deviation'):
            pair = np.array([getattr(parameter, name), getattr(expected, name)])
            assert pair[:1].tobytes() == pair[1:].tobytes()
        assert parameter.status is expected.status


def test_description_returns_to_the_last_bit(description):
    from identnl_ros.nodes.description_conversion import description_to_message
    from identnl_ros.storage.message_reading import description_from_message

    found = description_from_message(over_the_wire(description_to_message(description)))
    for sensor, expected in zip(found.layout.sensors, description.layout.sensors, strict=True):
        for field in fields(expected):
            value, wanted = getattr(sensor, field.name), getattr(expected, field.name)
            if isinstance(wanted, np.ndarray):
                assert value.tobytes() == wanted.tobytes()
            elif isinstance(wanted, float) and field.name != 'dropout_probability':
                assert np.array_equal(value, wanted, equal_nan=True)
            elif field.name != 'dropout_probability':
                assert value == wanted
    assert found.machine_text == description.machine_text
    assert found.stream_id == description.stream_id


@pytest.mark.parametrize(
    ('field', 'value', 'words'),
    [
        ('channel_count', 6, 'whole rows of 6 channels'),
        ('channel_count', 0, 'whole rows of 0 channels'),
        ('channel_status', [0], '1 channel states'),
        ('sample_rate', 0.0, 'sample rate'),
        ('sample_rate', float('nan'), 'sample rate'),
    ],
)
def test_damaged_block_of_samples_is_refused(conversions, field, value, words):
    message = conversions.block_to_message(sample_block(np.random.default_rng(0)))
    setattr(message, field, value)
    with pytest.raises(DataError, match=words):
        conversions.block_from_message(message)


@pytest.mark.parametrize(
    ('field', 'value', 'words'),
    [
        ('displacement', [0.0], 'numbers of displacement'),
        ('velocity', [0.0] * 5, 'velocity is'),
        ('generalised_force_covariance', [0.0] * 5, 'covariance of force'),
        ('coordinates', [], 'no coordinates'),
    ],
)
def test_damaged_block_of_motion_is_refused(conversions, field, value, words):
    message = conversions.motion_to_message(motion_block(np.random.default_rng(0)))
    setattr(message, field, value)
    with pytest.raises(DataError, match=words):
        conversions.motion_from_message(message)


@pytest.mark.parametrize('stamp', [-1, 2**31 * 10**9])
def test_time_that_no_message_can_hold_is_refused(conversions, stamp):
    with pytest.raises(DataError, match='ROS messages cannot hold'):
        conversions.block_to_message(
            replace(sample_block(np.random.default_rng(0)), stamp_ns=stamp)
        )
