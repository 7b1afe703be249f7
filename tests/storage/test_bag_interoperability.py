# Copyright 2026 The identnl_ros developers
# SPDX-License-Identifier: Apache-2.0
"""Bags mean the same to this package, to other libraries and to ROS itself."""

from contextlib import suppress
import json
import os
from pathlib import Path
import struct
import subprocess
import sys

from identnl_ros.core.errors import DataError
from identnl_ros.core.estimation.estimate import CombinationEstimate, EstimateStatus
from identnl_ros.core.measurement.blocks import SampleBlock
from identnl_ros.storage.bag_reader import open_bag, read_estimates
from identnl_ros.storage.bag_writer import BagWriter
from identnl_ros.storage.cdr import MessageDecoder
from identnl_ros.storage.message_reading import block_position
from identnl_ros.storage.message_types import (
    definition_text,
    encode_block,
    encode_description,
    ESTIMATES,
    package_definitions,
    SAMPLE_BLOCK,
    STAND_DESCRIPTION,
    type_hash,
    typestore,
)
import numpy as np
import pytest
import yaml

from tests.storage.bag_examples import (
    assert_same_block,
    blocks,
    description,
    LAYOUT,
    ROWS,
    START_NS,
    STREAM,
    write_bag,
)


def plain(value):
    """Turn a decoded message into lists and numbers, whoever decoded it."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if not hasattr(value, '__dict__'):
        return value
    return {name: plain(item) for name, item in vars(value).items() if not name.startswith('__')}


def test_decoder_agrees_with_rosbags_on_all_types():
    header = typestore().types['std_msgs/msg/Header'](
        stamp=typestore().types['builtin_interfaces/msg/Time'](sec=5, nanosec=6), frame_id='frame'
    )
    for name in package_definitions():
        message = example_message(name, header)
        for little in (True, False):
            data = typestore().serialize_cdr(message, name, little_endian=little)
            expected = typestore().deserialize_cdr(data, name)
            found = MessageDecoder(name, definition_text(name)).decode(data)
            assert plain(found) == plain(expected), name


def example_message(name, header):
    """Fill a message of any own type with numbers that tell fields apart."""
    store = typestore()
    counter = iter(range(3, 1000))

    def fill(kind):
        if kind.endswith('[]'):
            numbers = {name: np.dtype(name) for name in ('float64', 'uint8', 'uint16', 'uint32')}
            base = kind[:-2]
            if base in numbers:
                return np.arange(next(counter), dtype=numbers[base])
            return [fill(base) for _ in range(3)]
        if kind == 'std_msgs/Header':
            return header
        if kind in ('string', 'bool'):
            return 'x' * next(counter) if kind == 'string' else True
        if kind.startswith(('uint', 'int')):
            return next(counter)
        if kind == 'float64':
            return next(counter) / 7
        package, *_, base = kind.split('/') if '/' in kind else ('identnl_msgs', kind)
        return make(f'{package}/msg/{base}')

    def make(type_name):
        text, _ = store.generate_msgdef(type_name, ros_version=2)
        lines = [line.split() for line in text.split('=' * 80)[0].splitlines() if '=' not in line]
        return store.types[type_name](**{line[1]: fill(line[0]) for line in lines})

    return make(name)


def test_big_endian_block_is_read():
    data = typestore().serialize_cdr(
        typestore().deserialize_cdr(encode_block(blocks(1)[0]), SAMPLE_BLOCK),
        SAMPLE_BLOCK,
        little_endian=False,
    )
    found = MessageDecoder(SAMPLE_BLOCK, definition_text(SAMPLE_BLOCK)).decode(data)
    np.testing.assert_array_equal(found.samples, blocks(1)[0].samples.ravel())


@pytest.mark.parametrize('little_endian', [True, False])
@pytest.mark.parametrize('frame', ['', 'a', 'machine', 'machine_', 'machine_fr'])
@pytest.mark.parametrize('rows', [0, 1, ROWS])
def test_position_of_a_block_is_found_without_decoding_it(little_endian, frame, rows):
    for block in blocks(3)[1:]:
        message = typestore().deserialize_cdr(encode_block(block), SAMPLE_BLOCK)
        message.header.frame_id = frame
        message.samples = message.samples[: rows * 4]
        data = bytes(typestore().serialize_cdr(message, SAMPLE_BLOCK, little_endian=little_endian))
        expected = (STREAM, block.first_index, block.first_index + rows, block.last)
        assert block_position(data) == expected
        assert block_position(memoryview(data)) == expected
        for cut in range(len(data)):
            if data[cut:].strip(b'\0') or len(data) - cut > 8:
                with pytest.raises(DataError, match='it is damaged'):
                    block_position(data[:cut])


@pytest.mark.parametrize('line', ['uint8 A=', 'uint8 A=x', 'uint8[9999999999999999999999] a'])
def test_damaged_definition_is_an_error_in_a_sentence(line):
    with pytest.raises(DataError, match='damaged'):
        MessageDecoder('a/msg/B', line + '\n').decode(b'\0\1\0\0' + bytes(8))


def test_position_of_a_damaged_block_is_an_error_or_a_number():
    original = encode_block(blocks(1)[0])
    for position in range(len(original)):
        for bit in range(8):
            data = bytearray(original)
            data[position] ^= 1 << bit
            with suppress(DataError):
                stream, first, following, last = block_position(bytes(data))
                assert 0 <= stream < 2**64
                assert 0 <= first <= following
                assert last in (True, False)


def test_bag_with_another_version_of_the_message_is_read(tmp_path):
    """Fields were added, one was moved and one narrowed since the bag was made."""
    from mcap.writer import Writer

    sections = definition_text(SAMPLE_BLOCK).split('=' * 80 + '\n')
    other = '\n'.join(
        [
            'string<=10 operator "none # here"',
            'float32[2] spare',
            'uint8 CHANNEL_OK=0',
            'std_msgs/Header header',
            'uint8[] channel_status',
            'uint64 stream_id',
            'uint64 first_sample_index',
            'float64 sample_rate',
            'uint16 channel_count',
            'float64[] samples',
            'bool last_block',
            'int32[<=3] later',
            '',
        ]
    )
    block = blocks(1)[0]
    samples = block.samples.tobytes()
    body = struct.pack('<I3sx2f', 3, b'me\0', 1, 2)
    body += struct.pack('<iII1sxxx', 9, 5, 1, b'\0')
    body += struct.pack('<I4s', 4, bytes(4))
    body += bytes(-len(body) % 8) + struct.pack('<QQdHxxI', STREAM, 0, 100.0, 4, ROWS * 4)
    body += bytes(-len(body) % 8) + samples + struct.pack('<?xxxIi', True, 1, 7)
    stand = encode_description(description())
    path = tmp_path / 'a.mcap'
    with path.open('wb') as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start('ros2')
        for kind, text, data in (
            (STAND_DESCRIPTION, definition_text(STAND_DESCRIPTION), stand),
            (SAMPLE_BLOCK, ('=' * 80 + '\n').join([other, *sections[1:]]), b'\0\1\0\0' + body),
        ):
            schema = writer.register_schema(kind, 'ros2msg', text.encode())
            writer.add_message(writer.register_channel(f'/{kind}', 'cdr', schema), 1, data, 1)
        writer.finish()
    bag = open_bag(path)
    (found,) = bag.blocks()
    assert bag.problems == []
    expected = SampleBlock(
        STREAM, 9_000_000_005, 0, 100.0, block.samples, np.zeros(4, np.uint8), True
    )
    assert_same_block(found, expected)


@pytest.mark.parametrize('name', ['a.mcap', 'folder'])
def test_rosbags_reads_what_was_written(tmp_path, name):
    from rosbags.highlevel import AnyReader

    expected = write_bag(tmp_path / name)
    with AnyReader([tmp_path / name]) as reader:
        found = [
            (connection.topic, reader.deserialize(data, connection.msgtype), time)
            for connection, time, data in reader.messages()
        ]
        digests = {connection.msgtype: connection.digest for connection in reader.connections}
        (qos,) = next(
            connection.ext.offered_qos_profiles
            for connection in reader.connections
            if connection.msgtype == STAND_DESCRIPTION
        )
    assert qos.durability.name == 'TRANSIENT_LOCAL'
    assert qos.reliability.name == 'RELIABLE'
    assert len(found) == 1 + len(expected)
    topic, message, time = found[0]
    assert (topic, time) == ('/stand/stand_description', START_NS)
    assert [channel.name for channel in message.channels] == [s.name for s in LAYOUT.sensors]
    assert message.channels[1].gain == 8000
    for (_, message, time), block in zip(found[1:], expected, strict=True):
        assert message.samples.tobytes() == block.samples.tobytes()
        assert time == block.stamp_ns
        assert message.first_sample_index == block.first_index
    if name == 'folder':
        assert digests[SAMPLE_BLOCK] == type_hash(SAMPLE_BLOCK)


def test_mcap_library_verifies_all_check_sums(tmp_path):
    from mcap.reader import make_reader, NonSeekingReader

    expected = write_bag(tmp_path / 'a.mcap')
    with (tmp_path / 'a.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == 'ros2'
        summary = reader.get_summary()
        assert summary.statistics.message_count == 21
        messages = list(reader.iter_messages())
    for schema, channel, message in messages:
        assert schema.encoding == 'ros2msg'
        assert channel.message_encoding == 'cdr'
        assert channel.metadata['topic_type_hash'] == type_hash(schema.name)
        (qos,) = yaml.safe_load(channel.metadata['offered_qos_profiles'])
        latched = schema.name == STAND_DESCRIPTION
        assert qos['durability'] == ('transient_local' if latched else 'volatile')
        assert message.log_time == message.publish_time
    assert [message.data for _, _, message in messages[1:]] == [
        encode_block(block) for block in expected
    ]
    with (tmp_path / 'a.mcap').open('rb') as stream:
        assert len(list(NonSeekingReader(stream, validate_crcs=True).iter_messages())) == 21


def test_schema_carries_units_and_all_dependencies(tmp_path):
    text = definition_text(STAND_DESCRIPTION)
    assert text.startswith('# Copyright')
    assert 'recorded unit per SI unit' in text
    for name in (
        'std_msgs/Header',
        'builtin_interfaces/Time',
        'identnl_msgs/ChannelDescription',
        'geometry_msgs/Point',
    ):
        assert '=' * 80 + f'\nMSG: {name}\n' in text


def test_metadata_of_a_folder_is_that_of_rosbag2(tmp_path):
    write_bag(tmp_path / 'folder', 20)
    text = (tmp_path / 'folder' / 'metadata.yaml').read_text()
    content = yaml.safe_load(text)['rosbag2_bagfile_information']
    assert content['version'] == 9
    assert content['storage_identifier'] == 'mcap'
    assert content['relative_file_paths'] == ['folder_0.mcap']
    assert content['message_count'] == 21
    assert content['starting_time'] == {'nanoseconds_since_epoch': START_NS}
    assert content['duration']['nanoseconds'] == blocks(20)[-1].stamp_ns - START_NS
    counts = {
        topic['topic_metadata']['type']: topic['message_count']
        for topic in content['topics_with_message_count']
    }
    assert counts == {STAND_DESCRIPTION: 1, SAMPLE_BLOCK: 20}
    assert '&id' not in text


def test_recorded_messages_of_other_packages_are_kept_as_they_are(tmp_path):
    from rosbags.highlevel import AnyReader

    data = b'\0\1\0\0\6\0\0\0hello\0'
    empty_array = b'\0\1\0\0' + struct.pack('<iII1sxxxI', 1, 2, 1, b'\0', 0)
    with BagWriter(tmp_path / 'live', keep_partial=True) as writer:
        writer.write_raw('/chatter', 'std_msgs/msg/String', data, 5)
        writer.write_raw('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', empty_array, 6)
    with AnyReader([tmp_path / 'live']) as reader:
        found = {
            connection.topic: reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }
    assert found['/chatter'].data == 'hello'
    assert found['/diagnostics'].status == []


def test_estimates_come_back(tmp_path):
    types = typestore().types
    header = typestore().types['std_msgs/msg/Header'](
        stamp=types['builtin_interfaces/msg/Time'](sec=1, nanosec=2), frame_id='machine'
    )
    parameter = types['identnl_msgs/msg/ParameterEstimate'](
        name='slideway_6.normal_stiffness',
        symbol='a_n',
        unit='N/m^2',
        value=1.5e9,
        standard_deviation=2e6,
        lower=1.4e9,
        upper=1.6e9,
        status=3,
        note='noisy',
    )
    message = types[ESTIMATES](
        header=header,
        stand='mill',
        stream_id=7,
        estimator='pointwise',
        parameters=[parameter],
        covariance=np.array([4e12]),
        samples_used=100,
        samples_rejected=3,
        last_sample_index=102,
        residual=0.25,
        condition_number=3.0,
        combinations=[
            types['identnl_msgs/msg/DeterminedCombination'](
                in_words='a + b', value=3.0, standard_deviation=0.5
            )
        ],
        notes=['a remark'],
        stream_ended=True,
    )
    with BagWriter(tmp_path / 'a.mcap') as writer:
        data = typestore().serialize_cdr(message, ESTIMATES)
        writer.write_raw('/stand/estimates', ESTIMATES, data, 5)
        writer.write_raw('/stand/estimates', ESTIMATES, data[:50], 6)
    (found,) = read_estimates(tmp_path / 'a.mcap')
    assert (found.topic, found.stand, found.stamp_ns) == ('/stand/estimates', 'mill', 10**9 + 2)
    assert found.stream_ended
    (one,) = found.estimate.parameters
    assert (one.name, one.value) == ('slideway_6.normal_stiffness', 1.5e9)
    assert one.status is EstimateStatus.NOISE_LIMITED
    assert found.estimate.covariance.tolist() == [[4e12]]
    assert (found.estimate.samples, found.estimate.rejected_samples) == (100, 3)
    assert (one.lower, one.upper) == (1.4e9, 1.6e9)
    assert found.estimate.combinations == (CombinationEstimate('a + b', 3.0, 0.5),)


def test_reading_imports_no_other_bag_library(tmp_path):
    write_bag(tmp_path / 'a.mcap')
    code = (
        'import sys\n'
        'from identnl_ros.storage.bag_reader import open_bag\n'
        f'assert len(list(open_bag({str(tmp_path / "a.mcap")!r}).blocks())) == 20\n'
        'print(sorted({"rosbags", "sqlite3", "yaml"} & set(sys.modules)))\n'
    )
    result = run_python(code)
    assert result.strip() == '[]'


def run_python(code, **options):
    result = subprocess.run(
        [sys.executable, '-c', code],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=Path(__file__).parents[2],
        check=False,
        **options,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.ros
def test_ros_reads_and_writes_the_same_messages(tmp_path):
    pytest.importorskip('identnl_msgs.msg')
    block = blocks(2)[1]
    (tmp_path / 'block').write_bytes(encode_block(block))
    (tmp_path / 'description').write_bytes(encode_description(description()))
    code = (
        'import json, sys\n'
        'from pathlib import Path\n'
        'from identnl_msgs.msg import SampleBlock, StandDescription\n'
        'from rclpy.serialization import deserialize_message, serialize_message\n'
        f'folder = Path({str(tmp_path)!r})\n'
        'block = deserialize_message((folder / "block").read_bytes(), SampleBlock)\n'
        'stand = deserialize_message((folder / "description").read_bytes(), StandDescription)\n'
        '(folder / "block").write_bytes(serialize_message(block))\n'
        '(folder / "description").write_bytes(serialize_message(stand))\n'
        'channel = stand.channels[1]\n'
        'print(json.dumps([block.samples.tobytes().hex(), list(block.channel_status),\n'
        '    block.stream_id, block.first_sample_index, block.last_block,\n'
        '    block.header.stamp.sec, block.header.stamp.nanosec, stand.stand,\n'
        '    stand.machine_file, channel.name, channel.kind, channel.unit, channel.gain,\n'
        '    channel.direction.z, channel.reference_body, channel.column]))\n'
    )
    found = json.loads(run_python(code).splitlines()[-1])
    assert found == [
        block.samples.tobytes().hex(),
        [0, 1, 0, 0],
        STREAM,
        ROWS,
        True,
        *divmod(block.stamp_ns, 10**9),
        'mill_2',
        description().machine_text,
        'knee_probe',
        2,
        'm',
        8000.0,
        -1.0,
        'bed',
        'ch 7',
    ]
    with BagWriter(tmp_path / 'a.mcap') as writer:
        writer.write_raw('/d', STAND_DESCRIPTION, (tmp_path / 'description').read_bytes(), 1)
        writer.write_raw('/s', SAMPLE_BLOCK, (tmp_path / 'block').read_bytes(), 2)
    bag = open_bag(tmp_path / 'a.mcap')
    assert_same_block(next(bag.blocks()), block)
    assert bag.description.layout.sensors[1].column == 'ch 7'


@pytest.mark.ros
def test_type_hashes_are_those_that_ros_computed():
    prefixes = [*filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(':')), sys.prefix]
    folders = [Path(prefix) / 'share' / 'identnl_msgs' / 'msg' for prefix in prefixes]
    folder = next((folder for folder in folders if folder.is_dir()), None)
    if folder is None:
        pytest.skip('identnl_msgs is not installed')
    for name in package_definitions():
        description = json.loads((folder / f'{name.split("/")[-1]}.json').read_text())
        hashes = {entry['type_name']: entry['hash_string'] for entry in description['type_hashes']}
        assert hashes[name] == type_hash(name)
