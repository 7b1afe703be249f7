# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Small streams for the tests of bags."""

from pathlib import Path

from identnl_ros.core.measurement.blocks import SampleBlock, stamp_after
from identnl_ros.core.measurement.layout import Layout, Sensor, SensorKind
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.message_types import (
    definition_text,
    encode_block,
    encode_description,
    SAMPLE_BLOCK,
    STAND_DESCRIPTION,
    type_hash,
)
from identnl_ros.storage.stand_description import StandDescription
import numpy as np

STREAM = 2**63 + 12_345
RATE = 12_800.0
START_NS = 1_700_000_000_123_456_789
ROWS = 40

LAYOUT = Layout(
    (
        Sensor('shaker', SensorKind.FORCE, excitation='table', delay=1e-4, noise=0.5),
        Sensor(
            'knee_probe',
            SensorKind.DISPLACEMENT,
            body='knee',
            reference_body='bed',
            point=np.array([0.1, -0.2, 0.3]),
            direction=np.array([0.0, 0.0, -1.0]),
            column='ch 7',
            recorded_unit='V',
            gain=8000.0,
            offset=-0.25,
            noise=1e-8,
        ),
        Sensor('akzelerometer_µ', SensorKind.ACCELERATION, body='table'),
        Sensor('geophone', SensorKind.VELOCITY, body='table'),
    ),
    stand='mill_2',
    sample_rate=RATE,
)


def description(stream_id: int = STREAM, layout: Layout = LAYOUT) -> StandDescription:
    """Describe a stream of the example."""
    return StandDescription(
        stand=layout.stand,
        stream_id=stream_id,
        sample_rate=RATE,
        layout=layout,
        machine_text='machine: knee-type mill\n# Größe: 2\n',
        layout_text='stand: mill_2\n',
        stamp_ns=START_NS,
    )


def blocks(count: int, stream_id: int = STREAM, seed: int = 1) -> list[SampleBlock]:
    """Make consecutive blocks, the second with a missing sample, the last marked so."""
    rng = np.random.default_rng(seed)
    made = []
    for index in range(count):
        samples = rng.standard_normal((ROWS, len(LAYOUT.sensors))) * [100, 1e-6, 3, 0.1]
        status = np.zeros(len(LAYOUT.sensors), np.uint8)
        if index == 1:
            samples[3, 1] = np.nan
            status[1] = 1
        made.append(
            SampleBlock(
                stream_id=stream_id,
                stamp_ns=stamp_after(START_NS, index * ROWS, RATE),
                first_index=index * ROWS,
                sample_rate=RATE,
                samples=samples,
                channel_status=status,
                last=index == count - 1,
            )
        )
    return made


def write_bag(path: Path, count: int = 20, **options: bool) -> list[SampleBlock]:
    """Write a bag of one stream."""
    made = blocks(count)
    with BagWriter(path, **options) as writer:
        writer.write_description(description())
        for block in made:
            writer.write_block(block)
    return made


def write_small_chunks(path: Path, count: int = 20, **options: object) -> list[SampleBlock]:
    """Write a bag with a chunk for every second block, as a recorder does that flushes."""
    made = blocks(count)
    with BagWriter(path, **options) as writer:
        writer.write_description(description())
        for block in made:
            writer.write_block(block)
            if block.first_index // ROWS % 2:
                writer.flush()
    return made


def write_with_rosbags(path: Path, plugin: str, **options: object) -> list[SampleBlock]:
    """Write a bag folder with another library."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    made = blocks(5)
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[plugin])
    if 'compression' in options:
        writer.set_compression(
            CompressionMode[str(options['compression'])], CompressionFormat.ZSTD
        )
    with writer:
        topics = {
            kind: writer.add_connection(
                topic, kind, msgdef=definition_text(kind), rihs01=type_hash(kind)
            )
            for topic, kind in (('/d', STAND_DESCRIPTION), ('/s', SAMPLE_BLOCK))
        }
        writer.write(topics[STAND_DESCRIPTION], START_NS, encode_description(description()))
        for block in made:
            writer.write(topics[SAMPLE_BLOCK], block.stamp_ns, encode_block(block))
    return made


def assert_same_block(found: SampleBlock, expected: SampleBlock) -> None:
    """Compare two blocks bit for bit."""
    assert found.samples.tobytes() == expected.samples.tobytes()
    assert found.samples.shape == expected.samples.shape
    assert found.channel_status.tolist() == expected.channel_status.tolist()
    for name in ('stream_id', 'stamp_ns', 'first_index', 'sample_rate', 'last'):
        assert getattr(found, name) == getattr(expected, name)
