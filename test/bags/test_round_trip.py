"""Every form of one recording gives back the same samples, to the last bit."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from bags.forms import (
    CELL,
    NO_INDEX,
    Message,
    assert_same,
    force_messages,
    joint_messages,
    make_streams,
    messages,
    write_mcap,
    write_ros1,
    write_rosbag2,
    write_split,
    write_sqlite,
)
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import CompressionMode

from scara_kinetostatic.bags.decoding import DISCARD_TOPIC, STRING, string_message
from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.model.cell import Cell, Noise, SensorFrame
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.detection import DISCARDED, find_touches
from scara_kinetostatic.touches.streams import Streams

OWN = {'folder': {}, 'folder zstd': {'compression': 'zstd'}, 'bare.mcap': {}, 'bare zstd.mcap': {'compression': 'zstd'}}


@pytest.mark.parametrize('name', OWN)
@pytest.mark.parametrize('with_cell', [True, False])
def test_own_forms(name, with_cell, tmp_path, cell, streams):
    """With or without the cell description, in a place with an odd name, and the bare files of a folder."""
    path = tmp_path / 'a folder #1?x=%41&ü' / name
    write_streams(path, streams, cell, with_cell=with_cell, **OWN[name])
    read = read_streams(path, cell)
    assert_same(read, streams)
    assert read.warnings == ()
    assert read.source == str(path)
    assert not (read.joints.position.flags.writeable or read.wrench.stamp.flags.writeable)
    assert embedded_cell(path) == (cell if with_cell else None)
    for file in path.glob('*.mcap'):
        assert_same(read_streams(file, cell), streams)


def bare_sqlite(path: Path, streams: Streams) -> None:
    write_sqlite(path.with_name('folder'), messages(streams)).rename(path)


def reindexed(path: Path, streams: Streams) -> None:
    """With the metadata that `ros2 bag reindex` writes where it does not know the storage."""
    write_rosbag2(path, messages(streams))
    metadata = path / 'metadata.yaml'
    known = 'storage_identifier: mcap'
    assert known in metadata.read_text()
    metadata.write_text(metadata.read_text().replace(known, "storage_identifier: ''"))


Form = Callable[[Path, Streams], None]
OTHERS: dict[str, Form] = {
    'no storage identifier': reindexed,
    'zstd by message, mcap': lambda p, s: write_rosbag2(p, messages(s), mode=CompressionMode.MESSAGE),
    'sqlite': lambda p, s: write_sqlite(p, messages(s)),
    'bare sqlite': bare_sqlite,
    'zstd by message, sqlite': lambda p, s: write_sqlite(p, messages(s), CompressionMode.MESSAGE),
    'zstd by file, sqlite': lambda p, s: write_sqlite(p, messages(s), CompressionMode.FILE),
    'ROS 1': lambda p, s: write_ros1(p, messages(s)),
    'ROS 1, bz2': lambda p, s: write_ros1(p, messages(s), Writer.CompressionFormat.BZ2),
    'ROS 1, lz4': lambda p, s: write_ros1(p, messages(s), Writer.CompressionFormat.LZ4),
    'zstd by file, mcap': lambda p, s: write_rosbag2(p, messages(s), mode=CompressionMode.FILE),
    'zstd by chunk': lambda p, s: write_rosbag2(p, messages(s), mode=CompressionMode.STORAGE),
    'lz4 chunks': lambda p, s: write_mcap(p, messages(s), compression=CompressionType.LZ4),
    'no chunks': lambda p, s: write_mcap(p, messages(s), use_chunking=False),
    'no index': lambda p, s: write_mcap(p, messages(s), **NO_INDEX),
    'one message a chunk': lambda p, s: write_mcap(p, messages(s), chunk_size=1),
    'topics one after the other': lambda p, s: write_mcap(p, [*force_messages(s), *joint_messages(s)]),
    'split': lambda p, s: write_split(p, [messages(s)[:100], messages(s)[100:101], [], messages(s)[101:]]),
}


@pytest.mark.parametrize('name', OTHERS)
def test_forms_of_other_recorders(name, tmp_path, cell, streams):
    """In a place with an odd name."""
    path = tmp_path / 'a folder #1?x=%41&ü' / 'bag'
    OTHERS[name](tmp_path / 'bag', streams)
    path.parent.mkdir()
    (tmp_path / 'bag').rename(path)
    read = read_streams(path, cell)
    assert_same(read, streams)
    assert read.warnings == ()
    assert embedded_cell(path) is None


def test_a_compressed_file_on_its_own(tmp_path, cell, streams):
    write_mcap(tmp_path / 'a.mcap', messages(streams))
    write_ros1(tmp_path / 'b.bag', messages(streams))
    for name in ('a.mcap', 'b.bag'):
        packed = tmp_path / f'{name}.zstd'
        packed.write_bytes(zstandard.compress((tmp_path / name).read_bytes()))
        for file in (packed, (tmp_path / name).rename(tmp_path / f'{name[0]} without suffix')):  # known by its content
            assert_same(read_streams(file, cell), streams)


def test_other_readers_open_what_is_written(tmp_path, cell, streams):
    for name in ('folder', 'folder zstd'):
        write_streams(tmp_path / name, streams, cell, **OWN[name])
        with AnyReader([tmp_path / name]) as reader:  # compares the definitions with the type hashes, too
            counts = {topic: (info.msgtype, info.msgcount) for topic, info in reader.topics.items()}
            assert counts == {
                '/cell_description': ('std_msgs/msg/String', 1),
                '/joint_states': ('sensor_msgs/msg/JointState', 300),
                '/wrench': ('geometry_msgs/msg/WrenchStamped', 340),
            }
            decoded = [(item.topic, reader.deserialize(raw, item.msgtype)) for item, _, raw in reader.messages()]
            assert decoded[0][0] == '/cell_description'
            assert reader.start_time == streams.joints.stamp[0]
            assert reader.end_time == streams.joints.stamp[-1] + 1
        positions = [message.position for topic, message in decoded if topic == '/joint_states']
        np.testing.assert_array_equal(positions, streams.joints.position)


def test_a_strict_reader_of_mcap(tmp_path, cell, streams):
    write_streams(tmp_path / 'a.mcap', streams, cell, compression='zstd')
    with (tmp_path / 'a.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary, found = reader.get_summary(), list(reader.iter_messages())
    assert summary is not None and summary.statistics is not None
    assert summary.statistics.message_count == len(found) == 641
    profiles = [channel.metadata['offered_qos_profiles'] for channel in summary.channels.values()]
    assert ['transient_local' in profile for profile in profiles] == [True, False, False]
    assert all(profile.startswith('- history: keep_last') for profile in profiles)
    assert [schema.encoding for schema in summary.schemas.values()] == ['ros2msg'] * 3


def test_the_frame_and_the_names_travel(tmp_path, streams):
    sensor = CELL.sensor._replace(frame=SensorFrame.TOOL, joint_states='/arm/joints', wrench='/ft')
    cell = Cell(PAPER_MEASURED, CELL.discs, ('arm_a', 'arm_b'), sensor, Noise(1e-5, 0.3))
    write_streams(tmp_path / 'bag', streams, cell)
    assert embedded_cell(tmp_path / 'bag') == cell
    assert_same(read_streams(tmp_path / 'bag', cell), streams)
    with AnyReader([tmp_path / 'bag']) as reader:
        raw = next(raw for item, _, raw in reader.messages() if item.topic == '/ft')
        assert reader.deserialize(raw, 'geometry_msgs/msg/WrenchStamped').header.frame_id == 'tool'


def test_many_messages_are_read(tmp_path, cell):
    """As many as are decoded in several blocks; `benchmark.reading` has the times."""
    streams = make_streams(25_000, 25_000)
    write_streams(tmp_path / 'a.mcap', streams, cell)
    assert_same(read_streams(tmp_path / 'a.mcap', cell), streams)


def test_touches_discarded_while_recording_are_left_out(tmp_path):
    """As the collector of earlier versions has recorded it; one of them is not in the recording."""
    streams = simulate_streams(CELL, PAPER_MEASURED, default_plan(CELL).select(np.arange(3)), seed=3)
    found = find_touches(streams, CELL)
    holds = [found.start + round(5e8 * sum(episode.hold)) for episode in found.episodes]
    said = [string_message(json.dumps({'stamp': stamp, 'received': stamp})) for stamp in (holds[1], 10**18)]
    discards = [Message(DISCARD_TOPIC, STRING, 10**18, text) for text in said]
    write_mcap(tmp_path / 'bag.mcap', [*messages(streams), *discards])
    left = find_touches(read_streams(tmp_path / 'bag.mcap', CELL), CELL)
    assert [(item.index, item.reason) for item in left.rejected] == [(1, DISCARDED)]
    assert left.warnings == ('1 touches were discarded while recording that are not found in the recording',)
