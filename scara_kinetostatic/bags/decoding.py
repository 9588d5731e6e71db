"""Messages of recordings: as bytes in batches, which every source yields, and decoded, to numbers and back.

A few kilobytes can unpack to gigabytes, and an index can name the same bytes as a million messages. Every source
charges what it unpacks and what it takes apart to one `Budget`, in proportion to the size of the recording on disk.

**CDR** (little endian) is decoded one by one for nodes, in whole batches for recordings. The layout of the message
types is fixed once the lengths of their strings are known; a field of n bytes starts at a multiple of n, counted from
byte 4:

====== ======== ========= ======== ========= ==========
byte   0        4         8        12        16
       encoding s (i32)   ns (u32) length of `frame_id`
====== ======== ========= ======== ========= ==========

Messages of a batch that agree from byte 12 on up to their numbers share a layout; they are stacked into a matrix of
bytes whose columns are the fields, without an object for each message.
"""

from __future__ import annotations

import bz2
import os
import re
from collections import Counter
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import lz4.frame
import numpy as np
import zstandard
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from scara_kinetostatic.errors import RecordingError, ScaraKinetostaticError, one_line
from scara_kinetostatic.files.atomic import KIB, MIB
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.quantities import count
from scara_kinetostatic.touches.clock import SECOND, JointParts, Samples
from scara_kinetostatic.touches.streams import FixedTransform

_MOST_NAMES = 1000
"""Most joints in a message."""
_TOGETHER = 1 << 16
"""Joint states that are brought to common times at once: more take longer, by the memory."""
_INCOMPLETE = 'incomplete'
_STAMP = np.dtype({'names': ['s', 'ns'], 'formats': ['<i4', '<u4'], 'offsets': [4, 8]})
"""Stamp of a message with a header."""
_STRINGS = _STAMP.itemsize
"""Where the first string of such a message begins: `frame_id`."""
_NUMBER = np.dtype('<f8')
_SIZE = _NUMBER.itemsize


class Fields(NamedTuple):
    """Where the numbers of a message are.

    Attributes:
        frame_id: of its header.
        names: of the joints, in a `JointState`.
        numbers: how many there are.
        begin: where they begin, 8 bytes each.
        end: another message that is the same from byte 12 up to here has the same layout.
    """

    frame_id: str
    names: tuple[str, ...]
    numbers: int
    begin: int
    end: int


def wrench_fields(message: bytes) -> Fields:
    """Where force and torque of a `WrenchStamped` are.

    Raises:
        ValueError: it is incomplete.
    """
    frame_id, end = _text(message, _STRINGS)
    return _checked(Fields(frame_id, (), 6, aligned(end, _SIZE), end), message)


def joint_fields(message: bytes) -> Fields:
    """Where the positions of a `JointState` are.

    Raises:
        ValueError: it is incomplete.
    """
    frame_id, at = _text(message, _STRINGS)
    count, at = _count(message, at)
    if 4 * count > len(message):
        raise ValueError(_INCOMPLETE)
    if count > _MOST_NAMES:
        raise ValueError(f'of more than {_MOST_NAMES} joints')
    names = []
    for _ in range(count):
        name, at = _text(message, at)
        names.append(name)
    positions, end = _count(message, at)
    begin = aligned(end, _SIZE) if positions else end
    return _checked(Fields(frame_id, tuple(names), positions, begin, end), message)


def unlike_lengths(fields: Fields) -> str:
    """That a `JointState` does not say which position is of which joint; empty where it does."""
    names, positions = count(len(fields.names), 'name'), count(fields.numbers, 'position')
    return f'with {names} and {positions}' * (len(fields.names) != fields.numbers)


def _checked(fields: Fields, message: bytes) -> Fields:
    if fields.begin + _SIZE * fields.numbers > len(message):
        raise ValueError(_INCOMPLETE)
    return fields


def aligned(at: int, size: int) -> int:
    """The next place for a field of that size."""
    return at + (4 - at) % size


def _count(message: bytes, at: int) -> tuple[int, int]:
    """The number at the next place for one of 4 bytes, and where it ends."""
    at = aligned(at, 4)
    return int.from_bytes(message[at : at + 4], 'little'), at + 4


def _text(message: bytes, at: int) -> tuple[str, int]:
    """The string at the next place for one, and where it ends.

    Raises:
        ValueError: it reaches beyond the message.
    """
    size, begin = _count(message, at)
    if begin + size > len(message):
        raise ValueError(_INCOMPLETE)
    return message[begin : begin + size].rstrip(b'\0').decode('utf-8', 'replace'), begin + size


class Decoder:
    """Gathers the samples of one topic, batch by batch.

    Args:
        joint_names: names of q1 and q2 where the topic carries `JointState`; None for `WrenchStamped`.
        others: names of further joints.

    Attributes:
        frame_ids: of the messages, in the order in which they came.
        dropped: number of messages that were of no use, by reason; complete after `samples`.
        names: for joint states, the names of all joints in the messages.
    """

    def __init__(self, joint_names: tuple[str, str] | None = None, others: Sequence[str] = ()) -> None:
        self._joint_names, self._wanted = joint_names, (*(joint_names or ()), *others)
        self.frame_ids: list[str] = []
        none = np.zeros(0, np.int64)
        self._parts: list[tuple[NDArray[Any], ...]] = [(none, none, none, np.zeros((0, len(self._wanted) or 3)))]
        self.dropped: Counter[str] = Counter()
        self.names: set[str] = set()

    def add(self, batch: Batch) -> None:
        """Adds the messages of a batch."""
        count = len(batch.start)
        stamp, frame = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int32)
        values = np.full((count, len(self._wanted) or 3), np.nan)
        good = np.zeros(count, dtype=bool)
        for fields, rows, where in self._same_layout(batch):
            time = _column(rows, 0, _STAMP)
            stamp[where] = time['s'].astype(np.int64) * SECOND + time['ns']
            used = [(k, fields.names.index(name)) for k, name in enumerate(self._wanted) if name in fields.names]
            for column, number in used if self._joint_names else [(0, 0), (1, 1), (2, 2)]:
                found = _column(rows, fields.begin + _SIZE * number, _NUMBER)
                is_angle = self._joint_names and column < 2  # where NaN is one that the message does not have
                values[where, column] = np.where(np.isnan(found), np.inf, found) if is_angle else found
            if fields.frame_id not in self.frame_ids:
                self.frame_ids.append(fields.frame_id)
            frame[where] = self.frame_ids.index(fields.frame_id)
            good[where] = True
        self._parts.append((stamp[good], batch.log_time[good], frame[good], values[good]))

    def force_ranges(self) -> Floats:
        """Ranges of fx, fy and fz of wrenches as they came, from their 1st to their 99th percentile, (3,), N."""
        values = np.concatenate([part[-1] for part in self._parts])
        some = values[np.isfinite(values).all(axis=1)][:: 1 + len(values) // 20_000]
        return np.asarray(np.ptp(np.percentile(some, [1, 99], axis=0), axis=0)) if len(some) else np.zeros(3)

    def samples(self, turns: Mapping[str, Floats] | None = None) -> Samples:
        """Everything decoded: q1, q2 and other joints, NaN where none was heard of, (n, 2 + h); or fx, fy, (n, 2).

        Args:
            turns: of forces by their `frame_id`, (2, 3): f = turn (fx, fy, fz).
        """
        stamp, log_time, frame, all_values = map(np.concatenate, zip(*self._parts, strict=True))
        values = all_values if self._joint_names else all_values[:, :2]
        for frame_id, turn in (turns or {}).items():
            same = frame == self.frame_ids.index(frame_id)
            values[same] = all_values[same] @ turn.T
        absent = np.isnan(values[:, :2]) & bool(self._joint_names)
        # larger values are dropped as well, rad or N
        finite = np.all((np.abs(values[:, :2]) < 1e9) | absent, axis=1)
        self.dropped += Counter({'with values that are not finite': int(np.sum(~finite))})
        found = Samples(stamp[finite], log_time[finite], values[finite])
        missing = np.isnan(found.values)
        return self._joined(found) if (missing != missing[:1]).any() or missing[:, :2].any() else found

    def _joined(self, parts: Samples) -> Samples:
        """The samples of messages of which some have only a part of the joints."""
        join, found = JointParts(self._wanted), []
        for begin in range(0, len(parts.stamp), _TOGETHER):
            samples, problems = join.add(parts.select(slice(begin, begin + _TOGETHER)))
            found.append(samples)
            self.dropped += Counter({f'where {why}': number for why, number in problems.items()})
        return Samples(*map(np.concatenate, zip(*found, strict=True)))

    def _same_layout(self, batch: Batch) -> Iterator[tuple[Fields, NDArray[np.uint8], Indices]]:
        """Messages that share a layout, as a matrix of bytes, with their places in the batch."""
        plausible = (batch.length >= 20) & (batch.length <= LARGEST_MESSAGE)
        where = np.flatnonzero(plausible)
        start = batch.start[where]
        plain = (batch.buffer[start] == 0) & (batch.buffer[start + 1] == 1)
        strange = {_INCOMPLETE: int(np.sum(~plausible)), 'in an encoding other than plain CDR': int(np.sum(~plain))}
        self.dropped += Counter(strange)
        where = where[plain]
        compared, left = 0, len(where)
        for size in np.unique(batch.length[where]).tolist():
            places = where[batch.length[where] == size]
            rows = sliding_window_view(batch.buffer, size)[batch.start[places]]
            compared += len(where)
            while len(rows):
                compared += len(rows)
                # too many layouts: the rest of the batch is dropped
                if compared > 4_000_000:
                    self.dropped['in too many layouts'] += left
                    return
                fields, problem = self._fields(rows[0].tobytes())
                same = np.all(rows[:, _STRINGS : fields.end] == rows[0, _STRINGS : fields.end], axis=1)
                left -= int(np.sum(same))
                if problem:
                    self.dropped[problem] += int(np.sum(same))
                else:
                    yield fields, rows[same], places[same]
                rows, places = rows[~same], places[~same]

    def _fields(self, message: bytes) -> tuple[Fields, str]:
        """The layout of a message, and why it cannot be used; empty if it can."""
        try:
            fields = joint_fields(message) if self._joint_names else wrench_fields(message)
        except ValueError as error:
            return Fields('', (), 0, 0, len(message)), str(error)
        if not self._joint_names:
            return fields, ''
        self.names.update(fields.names)
        if set(self._wanted).isdisjoint(fields.names):
            return fields, f'without {" and ".join(self._joint_names)}'
        return fields, unlike_lengths(fields) if fields.numbers else 'without positions'


def _column(rows: NDArray[np.uint8], at: int, kind: np.dtype[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(rows[:, at : at + kind.itemsize]).view(kind)[:, 0]


def decode_string(payload: bytes) -> str:
    """The text of a `std_msgs/msg/String`.

    Raises:
        ValueError: the bytes are no such message.
    """
    return _text(payload, 4)[0]


def decode_transforms(payload: bytes) -> list[FixedTransform]:
    """The transforms of a `tf2_msgs/msg/TFMessage`.

    Raises:
        ValueError: the bytes are no such message.
    """
    try:
        message: Any = ros2_types().deserialize_cdr(payload, TF_MESSAGE)
    except Exception as error:  # rosbags raises whatever the bytes lead to
        raise ValueError(f'/tf_static: the message is no {TF_MESSAGE}') from error
    turns = ((item, item.transform.rotation) for item in message.transforms)
    return [FixedTransform(item.header.frame_id, item.child_frame_id, (q.x, q.y, q.z, q.w)) for item, q in turns]


@lru_cache
def ros2_types() -> Typestore:
    """The message types of ROS 2."""
    return get_typestore(Stores.ROS2_JAZZY)


def joint_state_messages(stamp: NDArray[np.int64], position: Floats, names: tuple[str, str]) -> list[bytes]:
    """`JointState` messages without velocity and effort.

    Args:
        stamp: header stamps, (n,), ns.
        position: q1, q2, (n, 2), rad.
        names: joint names of q1 and q2.

    Returns:
        n messages.
    """
    none = np.zeros(0)
    template = _serialized(JOINT_STATE, _header(''), list(names), np.zeros(2), none, none)
    return _filled(template, joint_fields(template).begin, stamp, position)


def wrench_messages(stamp: NDArray[np.int64], force: Floats, frame_id: str) -> list[bytes]:
    """`WrenchStamped` messages with a force in the plane.

    Args:
        stamp: header stamps, (n,), ns.
        force: fx, fy, and fz where it is not 0, (n, 2) or (n, 3), N.
        frame_id: of the header.

    Returns:
        n messages.
    """
    types = ros2_types().types
    zero = types['geometry_msgs/msg/Vector3'](0.0, 0.0, 0.0)
    template = _serialized(WRENCH_STAMPED, _header(frame_id), types['geometry_msgs/msg/Wrench'](zero, zero))
    return _filled(template, wrench_fields(template).begin, stamp, force)


def string_message(text: str) -> bytes:
    """A `std_msgs/msg/String`."""
    return _serialized(STRING, text)


def _serialized(msgtype: str, *fields: Any) -> bytes:
    store = ros2_types()
    return bytes(store.serialize_cdr(store.types[msgtype](*fields), msgtype))


def _header(frame_id: str) -> Any:
    types = ros2_types().types
    return types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](0, 0), frame_id)


def _filled(template: bytes, begin: int, stamp: NDArray[np.int64], values: Floats) -> list[bytes]:
    """Messages as the template, with their stamps and first numbers, (n, k)."""
    size = len(template)
    rows = np.tile(np.frombuffer(template, np.uint8), (len(stamp), 1))
    head = np.zeros(len(rows), dtype=_STAMP)
    head['s'], head['ns'] = np.divmod(np.asarray(stamp, dtype=np.int64), SECOND)
    begins = _STAMP.fields['s'][1]  # type: ignore[index]
    rows[:, begins:_STRINGS] = head.view(np.uint8).reshape(len(rows), -1)[:, begins:]
    rows[:, begin : begin + _SIZE * values.shape[1]] = np.ascontiguousarray(values, dtype=_NUMBER).view(np.uint8)
    data = rows.tobytes()
    return [data[at : at + size] for at in range(0, len(data), size)]


JOINT_STATE = 'sensor_msgs/msg/JointState'
WRENCH_STAMPED = 'geometry_msgs/msg/WrenchStamped'
STRING = 'std_msgs/msg/String'
TF_MESSAGE = 'tf2_msgs/msg/TFMessage'
TF_STATIC = '/tf_static'
METADATA = 'metadata.yaml'
"""File of a rosbag2 folder that lists its other files."""
DISCARD_TOPIC = '/discarded_touch'
"""Carries, for each touch that was discarded while recording, `{"touch": 5, "stamp": 1700…, "received": 1700…}`: its
number, the middle of its hold by the clock of the streams, and when that was received, ns."""

LARGEST_MESSAGE = MIB
"""A joint state, wrench or cell description is smaller than this, bytes; larger messages are refused."""
BATCH, BATCH_BYTES = 8 * KIB, 32 * MIB
"""Messages and bytes after which a batch ends, where the source does not set its own portion."""
PORTION = 64
"""Messages that are in memory before their bytes are counted: many may be the same bytes of a file."""


MAX_BYTES = 'SCARA_KINETOSTATIC_MAX_BYTES'
"""Environment variable with the limit in bytes; ``--max-bytes`` sets it, for child processes as well."""
_BYTES, _BYTES_RATIO = 256 * MIB, 200
"""A recording may unpack to the larger of these, bytes and times its size; the tests' recordings to 7 times."""
_RECORDS, _RECORD_SIZE = 200_000, 4
"""So many records, and one more for so many bytes of the recording; in compressed ones a message has 20 or more."""
_RECORD_BYTES = 64
"""Bytes of ``--max-bytes`` that allow a record."""
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'


class BudgetError(RecordingError):
    """A recording costs more than its size justifies."""


class Budget:
    """Counts down what bytes and records are left, over all files of a recording and all layers of compression.

    Args:
        path: the recording, a file or a folder.
    """

    def __init__(self, path: Path) -> None:
        own = r'\.(mcap|db3|bag)(\.zstd|\.part|-wal|-journal)?\Z'  # of the files of a recording in its folder
        files = [item for item in path.iterdir() if re.search(own, item.name)] if path.is_dir() else [path]
        stats = [item.stat() for item in files if item.is_file()]
        size = sum(min(item.st_size, 512 * item.st_blocks) for item in stats)  # holes cost nothing
        given = os.environ.get(MAX_BYTES, '')
        if given and not given.isdecimal():
            raise RecordingError(MAX_BYTES, f'expected a number of bytes, got {given!r:.40}')
        self._path = path
        self._limit = self._bytes = max(_BYTES, _BYTES_RATIO * size, int(given or 0))
        self._records_limit = self.records = max(_RECORDS + size // _RECORD_SIZE, int(given or 0) // _RECORD_BYTES)
        # of a chunk when unpacked; recorders write up to 4 MiB, and single images more
        self.largest_piece = max(2 * BATCH_BYTES, int(given or 0))

    def charge(self, size: int, records: int = 0) -> None:
        """Charges bytes unpacked or copied, and records taken apart.

        Raises:
            BudgetError: there is no more left.
        """
        self._bytes -= size
        self.records -= records
        if self._bytes < 0 or self.records < 0:
            over = f'{self._limit} bytes' if self._bytes < 0 else f'{self._records_limit} records'
            problem = f'unpacks to more than {over}, implausible for its size'
            enough = 2 * (self._limit if self._bytes < 0 else _RECORD_BYTES * self._records_limit)
            raise BudgetError(self._path, problem, f'if you trust it, raise the limit, by --max-bytes {enough} or more')


def unpack(data: bytes, most: int) -> bytes:
    """The content of compressed bytes, whose first ones tell the format: zstd, LZ4 or bzip2.

    Raises:
        ValueError: they unpack to more than `most` bytes, beyond which little is made, or end early.
        OSError, RuntimeError, zstandard.ZstdError: they are damaged.
    """
    if data.startswith(ZSTD_MAGIC):
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            content = reader.read(most + 1)
    else:
        step = 4 * MIB  # unpacked at a time: the memory is taken before
        decoder: Any = bz2.BZ2Decompressor() if data.startswith(b'BZh') else lz4.frame.LZ4FrameDecompressor()
        content = decoder.decompress(data, min(most + 1, step))
        while not (decoder.eof or decoder.needs_input) and len(content) <= most:
            content += decoder.decompress(b'', step)
        if len(content) <= most and not decoder.eof:
            raise ValueError('its compressed bytes end early')
    if len(content) > most:
        raise ValueError(f'it unpacks to more than {most} bytes, as stated or as --max-bytes allows')
    return bytes(content)


class Topic(NamedTuple):
    """A topic of a recording.

    Attributes:
        name: with a leading slash.
        msgtype: as ROS 2 writes it, `package/msg/Name`.
        encoding: `cdr`, or whatever else the file says.
    """

    name: str
    msgtype: str
    encoding: str

    @classmethod
    def of(cls, name: str, msgtype: str, encoding: str) -> Topic:
        """A topic as a file names it: old ones lack the leading slash, and `msg` in `std_msgs/msg/String`."""
        parts = one_line(msgtype).split('/')
        return cls(ros_topic(name), f'{parts[0]}/msg/{parts[1]}' if len(parts) == 2 else msgtype, encoding)


class Batch(NamedTuple):
    """Consecutive messages of one topic.

    Attributes:
        topic: their topic.
        log_time: when each was recorded, (n,), ns.
        buffer: bytes that hold all payloads, (any,), uint8.
        start: where each payload starts in the buffer, (n,).
        length: how many bytes it has, (n,).
    """

    topic: Topic
    log_time: NDArray[np.int64]
    buffer: NDArray[np.uint8]
    start: NDArray[np.int64]
    length: NDArray[np.int64]

    @classmethod
    def from_payloads(cls, topic: Topic, log_time: Sequence[int], payloads: Sequence[bytes]) -> Batch:
        """From payloads that lie apart."""
        length = np.fromiter(map(len, payloads), np.int64, len(payloads))
        times, buffer = np.array(log_time, dtype=np.int64), np.frombuffer(b''.join(payloads), np.uint8)
        return cls(topic, times, buffer, np.cumsum(length) - length, length)

    def payload(self, index: int) -> bytes:
        """The bytes of one message."""
        start = int(self.start[index])
        return self.buffer[start : start + int(self.length[index])].tobytes()


Batches: TypeAlias = Generator[Batch, None, None]


def batched(topic: Topic, portions: Iterable[tuple[Sequence[int], Sequence[bytes]]], budget: Budget) -> Iterator[Batch]:
    """Batches of messages that lie apart, each charged to the budget.

    Args:
        topic: their topic.
        portions: when each was recorded, ns, and their payloads; a few at a time.
        budget: of the recording.
    """
    times, payloads, size = list[int](), list[bytes](), 0
    for some_times, some_payloads in portions:
        times += some_times
        payloads += some_payloads
        part = sum(map(len, some_payloads))
        budget.charge(part, len(some_times))
        size += part
        if len(times) >= BATCH or size >= BATCH_BYTES:
            yield Batch.from_payloads(topic, times, payloads)
            times, payloads, size = [], [], 0
    if times:
        yield Batch.from_payloads(topic, times, payloads)


class Storage:
    """A recording, of whatever form.

    Args:
        path: the file or folder.
        budget: of the recording.

    Attributes:
        path: as given.
        warnings: what is damaged and how it was dealt with; complete once `batches` is exhausted.
        cut_off: that of the warnings which says that the recording ends amid its data; empty where it does not.
    """

    cut_off = ''

    def __init__(self, path: Path, budget: Budget) -> None:
        self.path, self._budget = path, budget
        self.warnings: list[str] = []
        self._topics: dict[Any, Topic] = {}

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, in the order of their recording, within each topic."""
        raise NotImplementedError

    def topics(self) -> list[Topic]:
        """Every topic of the recording, complete once `batches` is exhausted."""
        return list(dict.fromkeys(self._topics.values()))

    def _compare(self, stated: Mapping[Any, int], read: Mapping[str, int], wanted: Collection[str]) -> None:
        """Warns where the file states other numbers of messages, by the keys of its topics, than were read."""
        for name in wanted:
            keys = [key for key, topic in self._topics.items() if topic.name == name]
            if keys and (expected := sum(stated.get(key, 0) for key in keys)) != read[name]:
                said = f'its index states {expected} messages of {name}, read were {read[name]}'
                self.warnings.append(f'{self.path.name}: {said}')


@contextmanager
def reading(path: str | Path) -> Iterator[None]:
    """Turns every exception inside into a `RecordingError`; the only place where that is done.

    Args:
        path: the recording, for the message.

    Raises:
        RecordingError: something went wrong.
    """
    try:
        yield
    except ScaraKinetostaticError:
        raise
    except Exception as error:
        reason = (error.strerror if isinstance(error, OSError) else str(error)) or type(error).__name__
        raise RecordingError(path, f'cannot be read: {reason:.200}', 'check the file, or record it again') from error


def ros_topic(name: str) -> str:
    """The name of a topic with its leading slash (old recordings lack it)."""
    return '/' + one_line(name).lstrip('/')
