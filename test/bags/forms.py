"""Recordings in forms that the package reads but does not write."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import CompressionType, IndexType, Writer
from rosbags import rosbag1, rosbag2
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

from scara_kinetostatic.bags.decoding import JOINT_STATE, WRENCH_STAMPED, joint_state_messages, wrench_messages
from scara_kinetostatic.bags.writer import BagWriter
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

STORE = get_typestore(Stores.ROS2_JAZZY)
T0 = 1_700_000_000_123_456_789
CELL = Cell(PAPER_NOMINAL, PAPER_DISCS)


def assert_same(left: Streams, right: Streams) -> None:
    """Both hold the same samples, to the last bit."""
    np.testing.assert_array_equal(left.joints.stamp, right.joints.stamp)
    np.testing.assert_array_equal(left.joints.position, right.joints.position)
    np.testing.assert_array_equal(left.wrench.stamp, right.wrench.stamp)
    np.testing.assert_array_equal(left.wrench.force, right.wrench.force)


def count(read: Streams) -> int:
    """Number of samples of both topics."""
    return len(read.joints.stamp) + len(read.wrench.stamp)


def spoil(path: Path, at: int | bytes, new: bytes | None = None, beside: int = 0) -> None:
    """Overwrite bytes of a file at a place, or `beside` where it has these bytes; by default all bits of one flip."""
    content = bytearray(path.read_bytes())
    place = (content.index(at) if isinstance(at, bytes) else at % len(content)) + beside
    new = bytes([content[place] ^ 0xFF]) if new is None else new
    content[place : place + len(new)] = new
    path.write_bytes(content)


class Message(NamedTuple):
    topic: str
    msgtype: str
    log_time: int
    payload: bytes


def make_streams(joints: int = 300, wrenches: int = 340, seed: int = 0) -> Streams:
    """Joint states at 80 Hz, wrenches at 98 Hz, any values."""
    rng = np.random.default_rng(seed)
    return Streams(
        'made up',
        JointStream(T0 + np.arange(joints) * 12_500_000, rng.uniform(-3, 3, (joints, 2))),
        WrenchStream(T0 + 777 + np.arange(wrenches) * 10_204_081, rng.normal(0, 20, (wrenches, 2))),
    )


def joint_messages(streams: Streams, lag: int = 0, names: tuple[str, str] = CELL.joint_names) -> list[Message]:
    joints = streams.joints
    payloads = joint_state_messages(joints.stamp, joints.position, names)
    times = (joints.stamp + lag).tolist()
    return [Message('/joint_states', JOINT_STATE, t, p) for t, p in zip(times, payloads, strict=True)]


def force_messages(streams: Streams, lag: int = 0, frame_id: str = 'base') -> list[Message]:
    wrench = streams.wrench
    payloads = wrench_messages(wrench.stamp, wrench.force, frame_id)
    times = (wrench.stamp + lag).tolist()
    return [Message('/wrench', WRENCH_STAMPED, t, p) for t, p in zip(times, payloads, strict=True)]


def joint_state(stamp: int, names: list[str], position: list[float], frame_id: str = 'x', rest: int = 0) -> Message:
    """A joint state as the serialiser of `rosbags` writes it, with velocities and efforts."""
    time = STORE.types['builtin_interfaces/msg/Time'](sec=stamp // 10**9, nanosec=stamp % 10**9)
    header = STORE.types['std_msgs/msg/Header'](stamp=time, frame_id=frame_id)
    position, velocity, effort = np.array(position, dtype=float), np.arange(rest, dtype=float), np.zeros(rest)
    message = STORE.types[JOINT_STATE](header, names, position, velocity, effort)
    return Message('/joint_states', JOINT_STATE, stamp, bytes(STORE.serialize_cdr(message, JOINT_STATE)))


def record(bag: BagWriter, items: list[Message]) -> None:
    """Joint states and wrenches as the collector writes them."""
    for item in items:
        (bag.write_joint_state if item.topic == '/joint_states' else bag.write_wrench)(item.payload, item.log_time)


def messages(streams: Streams) -> list[Message]:
    """All messages in the order of time."""
    return sorted([*joint_messages(streams), *force_messages(streams)], key=lambda item: item.log_time)


def write_mcap(
    path: Path,
    items: list[Message],
    *,
    compression: CompressionType = CompressionType.NONE,
    encoding: str = 'cdr',
    chunk_size: int = 8192,
    finish: bool = True,
    **options: Any,
) -> None:
    """An MCAP file as some other recorder might write it; without its end where `finish` is false."""
    with path.open('wb') as stream:
        writer = Writer(stream, compression=compression, chunk_size=chunk_size, **options)
        writer.start('ros2', 'another recorder')
        ids: dict[str, int] = {}
        for item in items:
            if item.topic not in ids:
                schema = writer.register_schema(item.msgtype, 'ros2msg', b'')
                ids[item.topic] = writer.register_channel(item.topic, encoding, schema)
            writer.add_message(ids[item.topic], item.log_time, item.payload, item.log_time)
        if finish:
            writer.finish()


def write_rosbag2(
    path: Path,
    items: list[Message],
    *,
    storage: StoragePlugin = StoragePlugin.MCAP,
    mode: CompressionMode = CompressionMode.NONE,
) -> None:
    """A rosbag2 folder, by `rosbags`."""
    writer = rosbag2.Writer(path, version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for item in items:
            if item.topic not in connections:
                connections[item.topic] = writer.add_connection(item.topic, item.msgtype, typestore=STORE)
            writer.write(connections[item.topic], item.log_time, item.payload)


def write_sqlite(path: Path, items: list[Message], mode: CompressionMode = CompressionMode.NONE) -> Path:
    """A rosbag2 folder with a database, whose path is returned, as it is where nothing is compressed."""
    write_rosbag2(path, items, storage=StoragePlugin.SQLITE3, mode=mode)
    return path / f'{path.name}.db3'


def write_ros1(path: Path, items: list[Message], compression: rosbag1.Writer.CompressionFormat | None = None) -> None:
    """A bag of ROS 1, by `rosbags`."""
    writer, ros1 = rosbag1.Writer(path), get_typestore(Stores.ROS1_NOETIC)
    writer.chunk_threshold = 1 << 14
    if compression:
        writer.set_compression(compression)
    with writer:
        kinds = dict(item[:2] for item in items)
        connections = {topic: writer.add_connection(topic, kind, typestore=ros1) for topic, kind in kinds.items()}
        for item in items:
            writer.write(connections[item.topic], item.log_time, STORE.cdr_to_ros1(item.payload, item.msgtype))


def write_split(path: Path, parts: list[list[Message]]) -> None:
    """A rosbag2 folder of several MCAP files, old metadata with paths that name the folder."""
    path.mkdir()
    names = [f'part_{number}.mcap' for number in range(len(parts))]
    for name, items in zip(names, parts, strict=True):
        write_mcap(path / name, items)
    lines = ['rosbag2_bagfile_information:', '  version: 4', '  storage_identifier: mcap', '  relative_file_paths:']
    lines += [f'    - {path.name}/{name}' for name in names]
    (path / 'metadata.yaml').write_text('\n'.join([*lines, '  topics_with_message_count: []\n']))


NO_INDEX = {
    'index_types': IndexType.NONE,
    **dict.fromkeys(('use_statistics', 'repeat_channels', 'repeat_schemas', 'use_summary_offsets'), False),
}
