"""One recording in every form that the readers know, as bytes."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from benchmark.faults.outcomes import METADATA, Form
from scara_kinetostatic.bags.decoding import joint_state_messages, ros2_types, string_message, wrench_messages
from scara_kinetostatic.bags.writer import BagWriter, channels, write_streams
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

Message = tuple[int, int, bytes]
"""Log time, number of the channel, payload."""
PIECES = 4
CELL_FILE = Path(__file__).parents[2] / 'config' / 'cell.yaml'


def short_streams() -> Streams:
    """Two seconds of random numbers, so that much of a file is structure."""
    rng = np.random.default_rng(0)
    start = 1_700_000_000_123_456_789
    joints = JointStream(start + np.arange(100) * 12_500_000, rng.uniform(-3, 3, (100, 2)))
    return Streams('made up', joints, WrenchStream(start + np.arange(110) * 10_204_081, rng.normal(0, 20, (110, 2))))


def forms(streams: Streams, cell: Cell) -> list[Form]:
    """The recording in every form."""

    def ours(name: str, protected: bool, file: str = 'bag', **options: Any) -> Form:
        return _made(name, protected, lambda path: write_streams(path, streams, cell, **options), file)

    def foreign(name: str, protected: bool, **options: Any) -> Form:
        return _made(name, protected, lambda path: _write_mcap(path, streams, cell, **options), 'bag.mcap')

    def sqlite(name: str, mode: rosbag2.CompressionMode) -> Form:
        return _made(name, False, lambda path: write_sqlite(path, streams, cell, mode), 'bag')

    folder = ours('MCAP folder', True)
    return [
        folder,
        Form('metadata of an MCAP folder', folder.root, folder.files, _file(folder, METADATA), False),
        ours('MCAP file', True, 'bag.mcap'),
        ours('MCAP folder, zstd', True, compression='zstd'),
        foreign('MCAP, lz4', True, compression=CompressionType.LZ4),
        foreign('MCAP without checksums', False, compression=CompressionType.NONE, enable_crcs=False),
        foreign('MCAP, zstd, without checksums', False, compression=CompressionType.ZSTD, enable_crcs=False),
        foreign('MCAP without chunks', False, compression=CompressionType.NONE, use_chunking=False),
        _made('folder that the collector left, killed', True, lambda path: _killed(path, streams, cell), 'bag'),
        sqlite('SQLite', rosbag2.CompressionMode.NONE),
        _bare(sqlite('SQLite', rosbag2.CompressionMode.NONE)),
        sqlite('SQLite, zstd', rosbag2.CompressionMode.FILE),
        sqlite('SQLite, each message zstd', rosbag2.CompressionMode.MESSAGE),
        _made('ROS 1', False, lambda path: write_ros1(path, streams, cell), 'bag.bag'),
        _made('ROS 1, lz4', False, lambda path: write_ros1(path, streams, cell, lz4=True), 'bag.bag'),
    ]


def _made(name: str, protected: bool, make: Callable[[Path], None], file: str) -> Form:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder) / file
        make(root)
        paths = [path for path in Path(folder).rglob('*') if path.is_file()]
        files = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(paths)}
    largest = max((path for path in files if not path.endswith(METADATA)), key=lambda path: len(files[path]))
    return Form(name, file, files, largest, protected)


def _bare(form: Form) -> Form:
    """The database alone."""
    return replace(form, name=f'{form.name} file', root=form.target, files={form.target: form.files[form.target]})


def _file(form: Form, name: str) -> str:
    return next(path for path in form.files if path.endswith(name))


def _messages(streams: Streams, cell: Cell) -> list[Message]:
    """The cell description, then all messages in the order of time."""
    joints, wrench = streams.joints, streams.wrench
    positions = joint_state_messages(joints.stamp, joints.position, cell.joint_names)
    forces = wrench_messages(wrench.stamp, wrench.force, 'base')
    items = [(stamp, 1, data) for stamp, data in zip(joints.stamp.tolist(), positions, strict=True)]
    items += [(stamp, 2, data) for stamp, data in zip(wrench.stamp.tolist(), forces, strict=True)]
    items.sort(key=lambda item: item[0])
    return [(items[0][0], 0, string_message(dump_cell(cell))), *items]


def _write_mcap(path: Path, streams: Streams, cell: Cell, **options: Any) -> None:
    with path.open('wb') as stream:
        writer = Writer(stream, chunk_size=4096, **options)
        writer.start('ros2', 'another recorder')
        ids = []
        for channel in channels(cell):
            schema = writer.register_schema(channel.msgtype, 'ros2msg', b'')
            ids.append(writer.register_channel(channel.topic, 'cdr', schema))
        for time, number, data in _messages(streams, cell):
            writer.add_message(ids[number], time, data, time)
        writer.finish()


def _killed(path: Path, streams: Streams, cell: Cell) -> None:
    """What is there when a collector was killed between two checkpoints; everything had been secured."""
    bag = BagWriter(path, cell, log_time=0)
    messages = _messages(streams, cell)[1:]
    for count, (time, number, data) in enumerate(messages, start=1):
        (bag.write_joint_state if number == 1 else bag.write_wrench)(data, time)
        if count % (len(messages) // PIECES + 1) == 0 or count == len(messages):
            bag.checkpoint()
    bag._file.discard()  # without its end


def write_sqlite(path: Path, streams: Streams, cell: Cell, mode: rosbag2.CompressionMode) -> None:
    """A rosbag2 folder with a database, by `rosbags`."""
    writer = rosbag2.Writer(path, version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
    writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    store = get_typestore(Stores.ROS2_JAZZY)
    with writer:
        connections = [writer.add_connection(item.topic, item.msgtype, typestore=store) for item in channels(cell)]
        for time, number, data in _messages(streams, cell):
            writer.write(connections[number], time, data)


def write_ros1(path: Path, streams: Streams, cell: Cell, *, lz4: bool = False) -> None:
    """A bag of ROS 1, by `rosbags`."""
    writer = rosbag1.Writer(path)
    if lz4:
        writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
    store = get_typestore(Stores.ROS1_NOETIC)
    with writer:
        connections = [writer.add_connection(item.topic, item.msgtype, typestore=store) for item in channels(cell)]
        for time, number, data in _messages(streams, cell):
            msgtype = connections[number].msgtype
            writer.write(connections[number], time, ros2_types().cdr_to_ros1(data, msgtype))
