"""Messages as bytes, not yet decoded, in batches: what every source of a recording yields, and what that may cost.

A few kilobytes can unpack to gigabytes, and an index can name the same bytes as a million messages. Every source
charges what it unpacks and what it takes apart to one `Budget`, in proportion to the size of the recording on disk.
"""

from __future__ import annotations

import bz2
import os
import re
from collections.abc import Collection, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import lz4.frame
import numpy as np
import zstandard
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError, ScaraKinetostaticError, one_line
from scara_kinetostatic.files.atomic import KIB, MIB

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
