"""Writing recordings: message by message and crash-safe, or whole streams, as MCAP.

A `BagWriter` makes a rosbag2 folder, which appears in one step, with the cell description as the first message of
`<name>_0.mcap`. `checkpoint` ends the chunk that is being filled, waits until it is on the disk and replaces
`metadata.yaml` in one step; when it returns, everything written before is part of the recording, also after a kill or
a power failure. A file that was not ended has no index: this package reads it up to its last complete chunk; `mcap
recover` adds the index.
"""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from mcap.writer import CompressionType, Writer
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.metadata import dump_qos_v9

from scara_kinetostatic.bags.decoding import (
    DISCARD_TOPIC,
    JOINT_STATE,
    METADATA,
    STRING,
    TF_MESSAGE,
    TF_STATIC,
    WRENCH_STAMPED,
    joint_state_messages,
    ros2_types,
    string_message,
    wrench_messages,
)
from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.files.atomic import KIB, all_or_nothing, fresh_folder, replace_text, writing
from scara_kinetostatic.files.cell_file import CELL_TOPIC, dump_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.streams import Streams

__all__ = ['BagWriter', 'fresh_folder', 'write_streams']

_LATEST = int(np.iinfo(np.int64).max)
_FOREVER = QosTime(*divmod(_LATEST, SECOND))


class Channel(NamedTuple):
    """A topic to be written: its name, type, and quality of service to be offered when the recording is played."""

    topic: str
    msgtype: str
    qos: Qos

    @classmethod
    def of(cls, topic: str, msgtype: str, depth: int = 10, *, latched: bool = False) -> Channel:
        """A topic that is reliable and keeps the last messages."""
        durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
        policies = (QosHistory.KEEP_LAST, depth, QosReliability.RELIABLE, durability, _FOREVER, _FOREVER)
        return cls(topic, msgtype, Qos(*policies, QosLiveliness.AUTOMATIC, _FOREVER, False))


def channels(cell: Cell, topics: tuple[str, str] | None = None) -> list[Channel]:
    """The topics of a recording of a cell: its description, joint states, wrenches.

    Args:
        cell: the cell.
        topics: names of the last two as recorded; by default those of the cell, in the root namespace.
    """
    joint_states, wrench = topics or cell.sensor.topics
    description = Channel.of(CELL_TOPIC, STRING, 1, latched=True)
    return [description, Channel.of(joint_states, JOINT_STATE), Channel.of(wrench, WRENCH_STAMPED)]


class McapWriter:
    """Writes messages into a new MCAP file with every checksum that the format has.

    Args:
        path: the file, which must not exist.
        channels: topics that the file has even if they get no message.
        compress: whether to compress chunks with zstd.

    Attributes:
        name: of the file.
        start: time of its earliest message, ns.
        end: time of its latest message, ns.
        counts: its messages by topic.

    Raises:
        OSError: the file cannot be written; so do all methods.
    """

    def __init__(self, path: Path, channels: Sequence[Channel] = (), *, compress: bool = False) -> None:
        self.name = path.name
        self.start, self.end = _LATEST, 0
        self.counts: Counter[str] = Counter()
        self._stream = path.open('xb')
        compression = CompressionType.ZSTD if compress else CompressionType.NONE
        # a chunk is what a reader decompresses at a time, and what a kill may cost
        self._writer = Writer(self._stream, chunk_size=256 * KIB, compression=compression, enable_data_crcs=True)
        self._writer.start('ros2', 'scara_kinetostatic')
        self._ids = {channel: self._register(channel) for channel in channels}

    def _register(self, channel: Channel) -> int:
        definition, digest = _definition(channel.msgtype)
        schema = self._writer.register_schema(channel.msgtype, 'ros2msg', definition.encode())
        qos = yaml.safe_dump(dump_qos_v9([channel.qos]), sort_keys=False)
        metadata = {'offered_qos_profiles': qos, 'topic_type_hash': digest}
        return self._writer.register_channel(channel.topic, 'cdr', schema, metadata)

    def write(self, channel: Channel, payload: bytes, log_time: int) -> None:
        """Adds a message: its channel, its bytes, CDR, and when it was recorded, ns."""
        if channel not in self._ids:
            self._ids[channel] = self._register(channel)
        self._writer.add_message(self._ids[channel], log_time, payload, log_time, self.counts[channel.topic])
        self.counts[channel.topic] += 1
        self.start, self.end = min(self.start, log_time), max(self.end, log_time)

    def flush(self) -> None:
        """Ends the chunk; everything written is on the disk when this returns."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        os.fsync(self._stream.fileno())

    def finish(self) -> None:
        """Completes the file and closes it once it is on the disk."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()

    def discard(self) -> None:
        """Closes the file as it is, incomplete."""
        try:
            self._stream.close()
        except OSError:  # the buffered rest cannot be written either
            self._stream.raw.close()


def _definition(msgtype: str) -> tuple[str, str]:
    """Text of a type with all it depends on, and its hash (REP 2011)."""
    return ros2_types().generate_msgdef(msgtype, ros_version=2)[0], ros2_types().hash_rihs01(msgtype)


def metadata_text(channels: Sequence[Channel], file: McapWriter) -> str:
    """`metadata.yaml` of a rosbag2 folder with an MCAP file that has a message, as Jazzy writes it (version 9)."""
    topics = [
        {
            'topic_metadata': {
                'name': channel.topic,
                'type': channel.msgtype,
                'serialization_format': 'cdr',
                'offered_qos_profiles': dump_qos_v9([channel.qos]),
                'type_description_hash': _definition(channel.msgtype)[1],
            },
            'message_count': file.counts[channel.topic],
        }
        for channel in channels
    ]
    span = {
        'duration': {'nanoseconds': file.end - file.start},
        'starting_time': {'nanoseconds_since_epoch': file.start},
        'message_count': file.counts.total(),
    }
    information = {
        'version': 9,
        'storage_identifier': 'mcap',
        **span,
        'topics_with_message_count': topics,
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [file.name],
        'files': [{'path': file.name, **deepcopy(span)}],  # YAML would refer to what is there twice
        'custom_data': None,
        'ros_distro': 'jazzy',
    }
    dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
    return str(yaml.dump({'rosbag2_bagfile_information': information}, Dumper=dumper, sort_keys=False))


class BagWriter:
    """Records one run of a cell; may be used from several threads.

    Args:
        folder: the new folder; `fresh_folder` finds a name.
        cell: the cell, whose description becomes the first message.
        log_time: time of that message, ns; now by default.
        topics: names of joint states and wrenches; by default those of the cell, in the root namespace.

    Attributes:
        folder: the folder.
        recorded: number of joint states and wrenches up to the last checkpoint.

    Raises:
        OutputError: the folder exists, or cannot be written; so do all methods. The recording up to the last checkpoint
            stays.
    """

    def __init__(
        self, folder: str | Path, cell: Cell, *, log_time: int | None = None, topics: tuple[str, str] | None = None
    ) -> None:
        self.folder = Path(folder)
        self.recorded = 0
        self._channels = channels(cell, topics)
        self._lock = threading.RLock()
        self._state = 'open'
        with all_or_nothing(self.folder) as workshop:
            home = workshop / self.folder.name
            home.mkdir()
            self._file = McapWriter(home / f'{self.folder.name}_0.mcap')
            now = time.time_ns() if log_time is None else log_time
            try:
                self._file.write(self._channels[0], string_message(dump_cell(cell)), now)
                self._file.flush()
                self._describe(home)
            except BaseException:
                self._file.discard()
                raise

    def write_joint_state(self, data: bytes, log_time: int) -> None:
        """Add a `JointState`: the message as it came, CDR, and when it came, ns."""
        self._write(self._channels[1], data, log_time)

    def write_wrench(self, data: bytes, log_time: int) -> None:
        """Add a `WrenchStamped`: the message as it came, CDR, and when it came, ns."""
        self._write(self._channels[2], data, log_time)

    def write_discard(self, text: str, log_time: int) -> None:
        """Add that a touch is discarded, as `messages.DISCARD_TOPIC` describes, and make it part of the recording."""
        self._write(Channel.of(DISCARD_TOPIC, STRING), string_message(text), log_time)
        self.checkpoint()

    def write_transforms(self, data: bytes, log_time: int) -> None:
        """Add fixed transforms: a `tf2_msgs/msg/TFMessage` as it came, CDR, and when it came, ns."""
        self._write(Channel.of(TF_STATIC, TF_MESSAGE, 100, latched=True), data, log_time)

    def checkpoint(self) -> None:
        """Makes everything written so far part of the recording on the disk; call it before reporting a touch."""
        with self._lock, self._guarded():
            self._file.flush()
            self._describe(self.folder)

    def close(self) -> None:
        """Checkpoint and end of the recording. A second call does nothing."""
        with self._lock:
            if self._state == 'open':
                with self._guarded():
                    self._file.finish()
                    self._describe(self.folder)
                self._state = 'closed'

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, channel: Channel, data: bytes, log_time: int) -> None:
        with self._lock, self._guarded():
            if all(known.topic != channel.topic for known in self._channels):
                self._channels.append(channel)
            self._file.write(channel, bytes(data), log_time)

    def _describe(self, folder: Path) -> None:
        """Replaces the metadata by those of everything written so far."""
        replace_text(folder / METADATA, metadata_text(self._channels, self._file))
        self.recorded = sum(self._file.counts[channel.topic] for channel in self._channels[1:3])

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """Raises after the end of the recording, and ends it where the disk fails."""
        if self._state != 'open':
            raise OutputError(self.folder, f'the recording was {self._state}', 'start a new one')
        try:
            with writing(self.folder):
                yield
        except OutputError:
            self._state = 'stopped by an error'
            self._file.discard()
            raise


def write_streams(
    path: str | Path, streams: Streams, cell: Cell, *, compression: str | None = None, with_cell: bool = True
) -> None:
    """Write a recording.

    Args:
        path: what to make: a bare file if it ends in `.mcap`, else a rosbag2 folder.
        streams: the messages; each is logged at its stamp.
        cell: names the topics and joints; written into the recording.
        compression: of the chunks, `zstd` or None.
        with_cell: whether the recording starts with the cell description; plain recordings do not.

    Raises:
        OutputError: `path` exists, cannot be written, or is named as a recording of another form; nothing is left
            behind.
    """
    path = Path(path)
    if path.suffix in ('.bag', '.db3'):
        raise OutputError(path, 'is written as MCAP alone', 'name a folder or .mcap; rosbags-convert makes other forms')
    if len(streams.joints.stamp) + len(streams.wrench.stamp) == 0:
        raise OutputError(path, 'nothing to record: both streams are empty', 'give streams with samples')
    topics = channels(cell)
    with all_or_nothing(path) as workshop:
        made = workshop / path.name
        place = made if path.suffix == '.mcap' else made / f'{path.name}_0.mcap'
        place.parent.mkdir(exist_ok=True)
        file, by_name = McapWriter(place, topics, compress=compression is not None), {one.topic: one for one in topics}
        try:
            for topic, payload, log_time in _messages(streams, cell, with_cell):
                file.write(by_name[topic], payload, log_time)
            file.finish()
        except BaseException:
            file.discard()
            raise
        if place != made:
            replace_text(made / METADATA, metadata_text(topics, file))


def _messages(streams: Streams, cell: Cell, with_cell: bool) -> Iterator[tuple[str, bytes, int]]:
    """Topic, bytes and time, ns, of every message in the order of the stamps, the cell description first."""
    joints, wrench = streams.joints, streams.wrench
    stamp = np.concatenate([joints.stamp, wrench.stamp])
    payloads = joint_state_messages(joints.stamp, cell.readings(joints.position), cell.joint_names)
    payloads += wrench_messages(wrench.stamp, wrench.force @ cell.force_axes, cell.sensor.frame.value)
    order = np.argsort(stamp, kind='stable')
    if with_cell:
        yield CELL_TOPIC, string_message(dump_cell(cell)), int(stamp[order[0]])
    for place in order.tolist():
        yield cell.sensor.topics[place >= len(joints.stamp)], payloads[place], int(stamp[place])
