"""Recordings that lack something: one line that names the file or topic and says what to do."""

from __future__ import annotations

import os
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from bags.forms import (
    CELL,
    Message,
    assert_same,
    count,
    force_messages,
    joint_messages,
    joint_state,
    messages,
    record,
    spoil,
    write_mcap,
    write_split,
)
from mcap.writer import CompressionType

from scara_kinetostatic.bags import decoding
from scara_kinetostatic.bags.decoding import JOINT_STATE, WRENCH_STAMPED, string_message
from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.bags.writer import BagWriter, write_streams
from scara_kinetostatic.errors import CellError, RecordingError
from scara_kinetostatic.model.cell import Cell, Sensor
from scara_kinetostatic.touches.streams import Streams


def refused(path: Path, cell: Cell = CELL) -> str:
    with pytest.raises(RecordingError) as caught:
        read_streams(path, cell)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert '\n' not in message
    assert caught.value.remedy
    return message


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('multi_file_mcap', 'has no topic /joint_states; it has /AAA (std_msgs/msg/String)'),
        ('empty_sqlite3', 'has no topic /joint_states; it has /rosout'),
        ('only_services.mcap', 'it has /add_two_ints/_service_event (example_interfaces/srv/AddTwoInts_Event)'),
        ('wrong_serialization_mcap', 'it has /test_topic (test_msgs/msg/BasicTypes)'),
        ('wrong_serialization_sqlite3', 'it has /array_topic (test_msgs/msg/Arrays)'),
        ('empty-file.bag', 'the file is empty'),
        ('no-messages.bag', 'has no topic /joint_states; it has nothing: record'),
        ('example-unsorted-chunks.bag', 'it has /foo (std_msgs/msg/String)'),
    ],
)
def test_recordings_of_others(data, name, expected):
    assert expected in refused(data / name)


def test_what_is_no_recording(tmp_path, cell, streams):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'zero').symlink_to('/dev/zero')
    (tmp_path / 'cell.yaml').write_text('robot: {}')
    (tmp_path / 'metadata.yaml').write_text('a: 1')
    (tmp_path / 'empty').mkdir()
    write_streams(tmp_path / 'week' / 'monday', streams, cell)
    for name, said in (
        ('nowhere', 'there is no such recording'),
        ('pipe', 'neither a file nor a folder'),
        ('zero', 'neither a file nor a folder'),
        ('empty', 'no recording in this folder; expected metadata.yaml'),
        ('week', f'did you mean {tmp_path / "week" / "monday"}?'),
        ('cell.yaml', 'not a recording; give a rosbag2 folder'),
        ('cell.yaml', 'or a touch table (.csv)'),
        ('metadata.yaml', f'give the folder {tmp_path}'),
    ):
        assert said in refused(tmp_path / name)
    with pytest.raises(RecordingError, match='no such recording'):
        embedded_cell(tmp_path / 'nowhere')
    with pytest.raises(RecordingError):
        read_streams('a\0b', CELL)


def in_namespace(space: str, items: list[Message]) -> list[Message]:
    return [item._replace(topic=space + item.topic) for item in items]


RELATIVE = Cell(CELL.nominal, CELL.discs, sensor=Sensor('joint_states', 'wrench'))


@pytest.mark.parametrize('space', ['', '/left', '/plant/left'])
def test_relative_names_are_found_in_the_namespace_of_the_recording(tmp_path, streams, space):
    """Joint states beside them in another namespace are not taken."""
    others = in_namespace('/other', joint_messages(streams))
    write_mcap(tmp_path / 'a.mcap', [*in_namespace(space, messages(streams)), *others])
    read = read_streams(tmp_path / 'a.mcap', RELATIVE)
    assert_same(read, streams)
    assert read.topics == (f'{space}/joint_states', f'{space}/wrench')
    assert not space or f'{JOINT_STATE} is on {space}/joint_states' in refused(tmp_path / 'a.mcap', CELL)


def test_relative_names_of_two_cells_are_refused(tmp_path, streams):
    """Whatever is taken would be a guess; full names say which."""
    items = [item for space in ('', '/left') for item in in_namespace(space, messages(streams))]
    write_mcap(tmp_path / 'a.mcap', sorted(items, key=lambda item: item.log_time))
    message = refused(tmp_path / 'a.mcap', RELATIVE)
    assert 'several cells: /joint_states with /wrench and /left/joint_states with /left/wrench' in message
    full = [
        Cell(CELL.nominal, CELL.discs, sensor=Sensor('/left/joint_states', name)) for name in ('wrench', '/left/wrench')
    ]
    assert 'several cells' in refused(tmp_path / 'a.mcap', full[0])
    assert_same(read_streams(tmp_path / 'a.mcap', full[1]), streams)


@pytest.mark.parametrize('cell', [CELL, RELATIVE])
def test_topics_that_were_remapped_while_recording(tmp_path, streams, cell):
    """The collector records the names as they are, and the description as it is written."""
    with BagWriter(tmp_path / 'bag', cell, log_time=0, topics=('/arm/state', '/ft')) as bag:
        record(bag, messages(streams))
    read = read_streams(tmp_path / 'bag', cell)
    assert_same(read, streams)
    assert read.topics == ('/arm/state', '/ft')
    other = Cell(CELL.nominal, CELL.discs, sensor=Sensor('/arm/state', '/wrench'))
    assert f'{WRENCH_STAMPED} is on /ft: put that into sensor.wrench' in refused(tmp_path / 'bag', other)


def of_topic(items: list[Message], name: str) -> list[Message]:
    return [item._replace(topic=name) for item in items]


SWAPPED = Cell(CELL.nominal, CELL.discs, sensor=Sensor('/wrench', '/joint_states'))
NOT_JOINTS = {'names': ('shoulder', 'elbow')}


@pytest.mark.parametrize(
    ('make', 'options', 'cell', 'said'),
    [
        (
            lambda s: [*joint_messages(s), *of_topic(force_messages(s), '/ft_sensor/wrench')], {}, CELL,
            ['has no topic /wrench', f'{WRENCH_STAMPED} is on /ft_sensor/wrench: put that into sensor.wrench'],
        ),
        (
            messages, {}, SWAPPED,
            [f'topic /wrench carries {WRENCH_STAMPED} (cdr), expected {JOINT_STATE} (cdr)', 'into sensor.joint_states'],
        ),
        (lambda s: joint_messages(s)[:1], {}, CELL, ['has no topic /wrench']),
        (
            messages, {'encoding': 'wrong_format'}, CELL,
            [f'topic /joint_states carries {JOINT_STATE} (wrong_format), expected {JOINT_STATE} (cdr)'],
        ),
        (
            lambda s: [*joint_messages(s, **NOT_JOINTS), *force_messages(s)], {}, CELL,
            ['does not have joint1 and joint2, only elbow, shoulder', 'robot.joint_names'],
        ),
        (
            lambda s: [*joint_messages(replace(s, joints=replace(s.joints, position=s.joints.position * np.nan))),
                       *force_messages(s)], {}, CELL,
            ['no message of /joint_states can be used: 300 with values that are not finite'],
        ),
    ],
)  # fmt: skip
def test_what_a_topic_lacks(tmp_path, streams, make, options, cell, said):
    write_mcap(tmp_path / 'a.mcap', make(streams), **options)
    message = refused(tmp_path / 'a.mcap', cell)
    assert all(text in message for text in said)


def test_names_that_would_disturb_a_terminal(tmp_path, streams):
    first = messages(streams)[0]
    write_mcap(tmp_path / 'a.mcap', [first._replace(topic='/x\x1b[31m\n', msgtype='a/msg/\0B')])
    assert refused(tmp_path / 'a.mcap').isprintable()
    items = joint_messages(streams, names=('\x1b[2J', '\x07'))
    write_mcap(tmp_path / 'b.mcap', [*items, *force_messages(streams)])
    assert refused(tmp_path / 'b.mcap').isprintable()


def parts(streams: Streams, late: int = 4_000_000, lag: int = 0) -> list[Message]:
    """The joint states by two publishers, with joint 1 and with joint 2 later, ns, whose clock is ahead, ns."""
    stamp, (q1, q2) = streams.joints.stamp, streams.joints.position.T
    first = [joint_state(at, ['joint1'], [q]) for at, q in zip(stamp.tolist(), q1.tolist(), strict=True)]
    angles = np.interp(stamp + late - stamp[0], stamp - stamp[0], q2).tolist()
    then = (stamp + late).tolist()
    other = [joint_state(at + lag, ['joint2', 'lift'], [q, 0.0]) for at, q in zip(then, angles, strict=True)]
    other = [item._replace(log_time=at) for item, at in zip(other, then, strict=True)]
    return sorted([*first, *other], key=lambda item: item.log_time)


def unstamped(item: Message) -> Message:
    return item._replace(payload=item.payload[:4] + bytes(8) + item.payload[12:])


@pytest.mark.parametrize('without', ['', 'joint2', 'joint'])
def test_joints_in_separate_messages_are_joined(tmp_path, cell, streams, without):
    """Where one is not stamped both are dated by their reception."""
    items = [unstamped(item) if without and without.encode() in item.payload else item for item in parts(streams)]
    write_mcap(tmp_path / 'a.mcap', sorted([*items, *force_messages(streams)], key=lambda item: item.log_time))
    read = read_streams(tmp_path / 'a.mcap', cell)
    assert bool(read.warnings) == bool(without)
    time, begun = read.joints.stamp - streams.joints.stamp[0], streams.joints.stamp - streams.joints.stamp[0]
    np.testing.assert_array_equal(time, 4_000_000 + 12_500_000 * np.arange(299))
    for column in (0, 1):
        expected = np.interp(time, begun, streams.joints.position[:, column])
        np.testing.assert_allclose(read.joints.position[:, column], expected, atol=1e-12)


def test_joints_that_cannot_be_joined(tmp_path, cell, streams):
    write_mcap(tmp_path / 'a.mcap', [*parts(streams, lag=700_000_000), *force_messages(streams)])
    assert 'where the clocks of joint1 and joint2 differ by 0.7 s, or one comes late' in refused(tmp_path / 'a.mcap')
    write_mcap(tmp_path / 'b.mcap', [*joint_messages(streams, names=('joint1', 'x')), *force_messages(streams)])
    assert 'does not have joint2, only joint1, x' in refused(tmp_path / 'b.mcap')
    begun = int(streams.joints.stamp[0])
    silent = [item for item in parts(streams) if b'joint2' not in item.payload or item.log_time < begun + 10**9]
    write_mcap(tmp_path / 'c.mcap', [*silent, *force_messages(streams)])
    (warning,) = read_streams(tmp_path / 'c.mcap', cell).warnings
    assert warning == '/joint_states: 140 messages where joint2 is silent dropped'


def test_names_and_positions_of_unlike_lengths_are_not_paired(tmp_path, cell, streams):
    begun = int(streams.joints.stamp[0])
    strange = [
        joint_state(begun + 1, ['joint1', 'joint2'], [1.0]),
        joint_state(begun + 2, ['joint1'], [1.0, 2.0]),
        joint_state(begun + 3, ['joint2', 'joint1', 'x'], [1.0, 2.0]),
        joint_state(begun + 4, ['joint1', 'joint2'], []),
    ]
    write_mcap(tmp_path / 'a.mcap', [*strange, *messages(streams)])
    read = read_streams(tmp_path / 'a.mcap', cell)
    assert_same(read, streams)
    said = ['2 names and 1 position', '1 name and 2 positions', '3 names and 2 positions', None]
    expected = [f'/joint_states: 1 message {f"with {text}" if text else "without positions"} dropped' for text in said]
    assert sorted(read.warnings) == sorted(expected)


def test_zeros_of_a_second_publisher_are_named(tmp_path, cell, streams):
    slow = streams.joints.position[:1] + 1e-3 * np.arange(len(streams.joints.stamp))[:, None]
    steady = replace(streams, joints=replace(streams.joints, position=slow))
    items = joint_messages(steady)
    zeros = [joint_state(item.log_time + 1, ['joint1', 'joint2'], [0.0, 0.0]) for item in items[::8]]
    for name, joints in (('a', [*items, *zeros]), ('b', items)):
        write_mcap(
            tmp_path / f'{name}.mcap', sorted([*joints, *force_messages(steady)], key=lambda item: item.log_time)
        )
    said = '/joint_states: the positions alternate: two publishers?'
    assert read_streams(tmp_path / 'a.mcap', cell).warnings == (said,)
    assert not read_streams(tmp_path / 'b.mcap', cell).warnings


def lost(path: Path) -> None:
    (path / 'metadata.yaml').unlink()


def rewritten(text: str) -> Callable[[Path], None]:
    return lambda path: (path / 'metadata.yaml').write_text(text) and None


@pytest.mark.parametrize(
    ('change', 'expected'),
    [
        (lost, 'metadata.yaml cannot be read (No such file or directory): all files'),
        (rewritten('rosbag2_bagfile_information: ['), 'metadata.yaml cannot be read'),
        (rewritten('rosbag2_bagfile_information: {relative_file_paths: 3}'), 'metadata.yaml cannot be read'),
        (
            rewritten('rosbag2_bagfile_information: {relative_file_paths: [a.mcap], topics_with_message_count: []}'),
            'metadata.yaml lists a.mcap, which is missing',
        ),
    ],
)
def test_spoilt_metadata(tmp_path, cell, streams, change, expected):
    """All files are read, in the order of their numbers."""
    items = messages(streams)
    write_split(tmp_path / 'bag', [items[at : at + 50] for at in range(0, len(items), 50)])
    change(tmp_path / 'bag')
    read = read_streams(tmp_path / 'bag', cell)
    assert_same(read, streams)
    assert len(read.warnings) == 1
    assert read.warnings[0].startswith(expected)


def test_one_file_of_several_is_lost(tmp_path, cell, streams):
    items = messages(streams)
    write_split(tmp_path / 'bag', [items[:200], items[200:400], items[400:]])
    (tmp_path / 'bag/part_1.mcap').unlink()
    read = read_streams(tmp_path / 'bag', cell)
    assert count(read) == 440
    assert 'lists part_1.mcap, which is missing' in read.warnings[0]
    (tmp_path / 'bag/part_1.mcap').touch()
    read = read_streams(tmp_path / 'bag', cell)
    assert count(read) == 440
    assert read.warnings == ('part_1.mcap was skipped: the file is empty',)


def test_paths_in_metadata_do_not_lead_out_of_the_folder(tmp_path, cell, streams):
    write_streams(tmp_path / 'elsewhere.mcap', streams, cell)
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag/metadata.yaml').write_text(
        'rosbag2_bagfile_information: {relative_file_paths: [../elsewhere.mcap], topics_with_message_count: []}'
    )
    assert 'no recording in this folder' in refused(tmp_path / 'bag')


def test_foreign_cell_descriptions(tmp_path, streams):
    first = messages(streams)[0]
    senseless = first._replace(
        topic='/cell_description', msgtype='std_msgs/msg/String', payload=string_message('robot: {}')
    )
    write_mcap(tmp_path / 'a.mcap', [senseless])
    with pytest.raises(CellError, match='/cell_description: the key') as caught:
        embedded_cell(tmp_path / 'a.mcap')
    assert str(tmp_path / 'a.mcap') in str(caught.value)
    write_mcap(tmp_path / 'b.mcap', [senseless._replace(payload=b'\0\1\0\0\xff\xff\0\0ab')])
    with pytest.raises(RecordingError):
        embedded_cell(tmp_path / 'b.mcap')
    write_mcap(tmp_path / 'c.mcap', [first._replace(topic='/cell_description')])
    assert embedded_cell(tmp_path / 'c.mcap') is None


def test_compression_bombs_are_refused(tmp_path, streams):
    """A chunk that claims to hold terabytes."""
    write_mcap(tmp_path / 'a.mcap', messages(streams), compression=CompressionType.ZSTD)
    spoil(tmp_path / 'a.mcap', b'\4\0\0\0zstd', (1 << 42).to_bytes(8, 'little'), -12)
    assert 'a chunk of 4398046511104 bytes, at byte' in refused(tmp_path / 'a.mcap')


def test_metadata_that_would_take_all_time(tmp_path, cell, streams):
    """By the same loader as that of a cell description, whose tests have what else it refuses."""
    head = 'a0: &a0 {x: 1}\n' + ''.join(f'a{n + 1}: &a{n + 1} {{<<: [*a{n}, *a{n}]}}\n' for n in range(40))
    write_streams(tmp_path / 'bag', streams, cell)
    metadata = tmp_path / 'bag/metadata.yaml'
    metadata.write_text(head + metadata.read_text())
    read = read_streams(tmp_path / 'bag', cell)
    assert_same(read, streams)
    (warning,) = read.warnings
    assert warning.startswith('metadata.yaml cannot be read (line 1: anchors and aliases are not allowed): ')


def test_messages_that_decompress_to_far_more_than_a_message_are_dropped(tmp_path, streams):
    items = messages(streams)
    bomb = zstandard.compress(bytes(1 << 24))
    spoilt = [zstandard.compress(item.payload) if number % 2 else bomb for number, item in enumerate(items)]
    packed = [item._replace(payload=payload) for item, payload in zip(items, spoilt, strict=True)]
    write_mcap(tmp_path / 'a.mcap', packed, compression=CompressionType.ZSTD)
    tracemalloc.start()
    read = read_streams(tmp_path / 'a.mcap', CELL)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert count(read) == len(items) // 2
    assert any(f'{CELL.sensor.wrench}: ' in warning and 'dropped' in warning for warning in read.warnings)
    assert peak < 1 << 28


def test_a_file_that_grows_without_end_when_decompressed(tmp_path, monkeypatch):
    monkeypatch.setattr(decoding, '_BYTES', 1 << 20)
    (tmp_path / 'a.db3.zstd').write_bytes(zstandard.compress(b'SQLite format 3\0' + bytes(1 << 24)))
    assert 'unpacks to more than 1048576 bytes' in refused(tmp_path / 'a.db3.zstd')
