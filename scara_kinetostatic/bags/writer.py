"""Writes whole streams as a recording, atomically, in every form that the reader reads.

These are a rosbag2 folder (MCAP or SQLite, compressed or not), a bare `.mcap` file, a ROS 1 `.bag`.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from scara_kinetostatic.bags.bag_folder import METADATA
from scara_kinetostatic.bags.bag_writer import CELL, JOINTS, WRENCH, BagWriter
from scara_kinetostatic.bags.encoding import channels, joint_state_messages, string_message, wrench_messages
from scara_kinetostatic.bags.mcap_writer import McapWriter
from scara_kinetostatic.bags.metadata import FileInfo, metadata_text
from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.files.atomic import all_or_nothing, fresh_folder, replace_text
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.streams import Streams

__all__ = ['BagWriter', 'fresh_folder', 'write_streams']


class _Message(NamedTuple):
    channel: int
    payload: bytes
    log_time: int


def write_streams(
    path: str | Path,
    streams: Streams,
    cell: Cell,
    *,
    storage: Literal['mcap', 'sqlite3'] = 'mcap',
    compression: Literal['zstd'] | None = None,
    with_cell: bool = True,
) -> None:
    """Write a recording.

    Args:
        path: what to make: a bare file if it ends in `.mcap`, a ROS 1 bag if in `.bag`, else a rosbag2 folder.
        streams: the messages; each is logged at its stamp.
        cell: names the topics and joints; written into the recording.
        storage: of a rosbag2 folder.
        compression: MCAP is compressed chunk by chunk, SQLite as a file; a ROS 1 bag is not.
        with_cell: whether the recording starts with the cell description; plain recordings do not.

    Raises:
        OutputError: `path` exists or cannot be written; nothing is left behind.
    """
    path = Path(path)
    if len(streams.joints.stamp) + len(streams.wrench.stamp) == 0:
        raise OutputError(path, 'nothing to record: both streams are empty', 'give streams with samples')
    with all_or_nothing(path) as workshop:
        made = workshop / path.name
        if path.suffix == '.bag':
            _write_ros1(made, streams, cell, with_cell)
        elif path.suffix == '.mcap':
            _write_mcap(made, path.name, streams, cell, with_cell, compression is not None)
        elif storage == 'sqlite3':
            _write_sqlite(made, streams, cell, with_cell, compression is not None)
        else:
            made.mkdir()
            name = f'{path.name}_0.mcap'
            info = _write_mcap(made / name, name, streams, cell, with_cell, compression is not None)
            replace_text(made / METADATA, metadata_text(channels(cell), [info]))


def _messages(streams: Streams, cell: Cell, with_cell: bool, *, ros1: bool = False) -> Iterator[_Message]:
    """Every message in the order of the stamps, the cell description first."""
    joints, wrench = streams.joints, streams.wrench
    stamp = np.concatenate([joints.stamp, wrench.stamp])
    channel = np.repeat([JOINTS, WRENCH], [len(joints.stamp), len(wrench.stamp)])
    payloads = joint_state_messages(joints.stamp, joints.position, cell.joint_names, ros1=ros1)
    payloads += wrench_messages(wrench.stamp, wrench.force, cell.sensor.frame.value, ros1=ros1)
    order = np.argsort(stamp, kind='stable')
    if with_cell:
        yield _Message(CELL, string_message(dump_cell(cell), ros1=ros1), int(stamp[order[0]]))
    for place, which, log_time in zip(order.tolist(), channel[order].tolist(), stamp[order].tolist(), strict=True):
        yield _Message(which, payloads[place], log_time)


def _write_mcap(path: Path, name: str, streams: Streams, cell: Cell, with_cell: bool, compress: bool) -> FileInfo:
    file = McapWriter(path, channels(cell), compress=compress)
    try:
        for message in _messages(streams, cell, with_cell):
            file.write(*message)
        return file.finish(name)
    except BaseException:
        file.discard()
        raise


def _write_sqlite(path: Path, streams: Streams, cell: Cell, with_cell: bool, compress: bool) -> None:
    with tempfile.TemporaryDirectory(prefix='scara_kinetostatic_') as plain:  # rosbags cannot write where `#` is
        writer = rosbag2.Writer(Path(plain) / 'bag', version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
        if compress:
            writer.set_compression(rosbag2.CompressionMode.FILE, rosbag2.CompressionFormat.ZSTD)
        with writer:
            connections = [
                writer.add_connection(
                    item.topic,
                    item.msgtype,
                    msgdef=item.definition,
                    rihs01=item.digest,
                    offered_qos_profiles=[item.qos],
                )
                for item in channels(cell)
            ]
            for message in _messages(streams, cell, with_cell):
                writer.write(connections[message.channel], message.log_time, message.payload)
        shutil.move(writer.path, path)


def _write_ros1(path: Path, streams: Streams, cell: Cell, with_cell: bool) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with rosbag1.Writer(path) as writer:
        connections = [writer.add_connection(item.topic, item.msgtype, typestore=store) for item in channels(cell)]
        for message in _messages(streams, cell, with_cell, ros1=True):
            writer.write(connections[message.channel], message.log_time, message.payload)
