"""Decoding: the bytes of messages to arrays, whole batches at once, without an object for each message.

The three message types have a fixed layout once the lengths of their strings
are known. Messages of one length and one `frame_id` length share it, so they
are stacked into a matrix of bytes whose columns are the fields. Two wire
formats, CDR (ROS 2, either byte order) and that of ROS 1, begin alike:

====== ======== ========= ======== ========= ==========
byte   0        4         8        12        16
CDR    encoding s (i32)   ns (u32) length of `frame_id`
ROS 1  sequence s (u32)   ns (u32) length of `frame_id`
====== ======== ========= ======== ========= ==========

In CDR a field of n bytes starts at a multiple of n, counted from byte 4.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.bags.messages import Batch

_LARGEST_VALUE = 1e9
"""Larger values, and those that are not finite, are dropped, rad or N."""

_LONGEST = 1 << 24
"""Longer messages are dropped, bytes."""

_INCOMPLETE = 'incomplete'
_MOST_PROBLEMS = 64
"""After so many unusable layouts in a batch, the rest of it is dropped: these are not the expected messages."""
_FRAME_ID = 16
"""Where `frame_id` begins."""
_MOST_FRAME_IDS = 64
"""So many are noted."""
_SMALL, _TOGETHER = 1 << 20, 8
"""Batches of fewer than so many bytes are decoded up to so many at a time; 15 % faster with MCAP chunks of 256 KiB."""


class Samples(NamedTuple):
    """The decoded messages of one topic, in the order of recording.

    Attributes:
        stamp: header stamps, (n,), ns.
        log_time: when each was recorded, (n,), ns.
        values: q1, q2 or fx, fy, (n, 2), rad or N.
        dropped: number of messages without a sample, by reason.
        names: for joint states, the joint names in messages without q1 or q2.
    """

    stamp: NDArray[np.int64]
    log_time: NDArray[np.int64]
    values: NDArray[np.float64]
    dropped: Counter[str]
    names: frozenset[str]


class Decoder:
    """Gathers the samples of one topic, batch by batch.

    Args:
        joint_names: names of q1 and q2 where the topic carries `JointState`; None for `WrenchStamped`.
        turns: of forces by their `frame_id`, (2, 3): f = turn (fx, fy, fz).

    Attributes:
        frame_ids: of the messages, the first of each batch and length of message.
    """

    def __init__(
        self, joint_names: tuple[str, str] | None = None, turns: Mapping[str, NDArray[np.float64]] | None = None
    ) -> None:
        self._joint_names = joint_names
        self._turns = {name.encode(): turn for name, turn in (turns or {}).items()}
        self.frame_ids: set[str] = set()
        self._parts: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []
        self._dropped: Counter[str] = Counter()
        self._names: set[str] = set()
        self._small: list[Batch] = []

    def add(self, batch: Batch) -> None:
        """Adds the messages of a batch; small batches are decoded together, which is faster."""
        if self._small and (self._small[0].topic != batch.topic or len(self._small) == _TOGETHER):
            self._decode_small()
        if len(batch.buffer) < _SMALL:
            self._small.append(batch)
        else:
            self._decode_small()
            self._decode(batch)

    def _decode_small(self) -> None:
        if self._small:
            self._decode(Batch.concatenate(self._small))
            self._small = []

    def _decode(self, batch: Batch) -> None:
        stamp = np.zeros(len(batch.start), dtype=np.int64)
        values = np.zeros((len(batch.start), 2))
        good = np.zeros(len(batch.start), dtype=bool)
        for layout, rows, where in self._same_layout(batch):
            stamp[where] = layout.stamp(rows)
            values[where] = self._turned(layout, rows) if self._turns else layout.values(rows)
            good[where] = True
        finite = np.all(np.abs(values) < _LARGEST_VALUE, axis=1)  # false for NaN, too
        self._count('with values that are not finite', int(np.sum(good & ~finite)))
        good &= finite
        self._parts.append((stamp[good], batch.log_time[good], values[good]))

    def _turned(self, layout: _Layout, rows: NDArray[np.uint8]) -> NDArray[np.float64]:
        """The forces of messages that share a layout, turned by their `frame_id`."""
        values = layout.values(rows)
        for frame_id, turn in self._turns.items():
            end = _FRAME_ID + layout.frame_id_size
            if len(frame_id) != layout.frame_id_size or end > rows.shape[1]:
                continue
            same = np.all(rows[:, _FRAME_ID:end] == np.frombuffer(frame_id, np.uint8), axis=1)
            values[same] = np.column_stack([values[same], layout.third(rows[same])]) @ turn.T
        return values

    def samples(self) -> Samples:
        """Everything decoded so far."""
        self._decode_small()
        parts = self._parts or [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))]
        stamp, log_time, values = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        return Samples(stamp, log_time, values, self._dropped, frozenset(self._names))

    def _count(self, reason: str, number: int) -> None:
        if number:
            self._dropped[reason] += number

    def _same_layout(self, batch: Batch) -> Iterator[tuple[_Layout, NDArray[np.uint8], NDArray[np.intp]]]:
        """Messages that share a layout, as a matrix of bytes, with their places in the batch."""
        for rows, where, order, origin in self._same_shape(batch):
            problems = 0
            while len(rows):
                layout = self._layout(rows[0].tobytes(), order, origin)
                same = layout.fits(rows)
                if layout.problem:
                    self._count(layout.problem, int(np.sum(same)))
                    self._names.update(layout.names)
                else:
                    yield layout, rows[same], where[same]
                rows, where = rows[~same], where[~same]
                problems += bool(layout.problem)
                if problems == _MOST_PROBLEMS:
                    self._count(_INCOMPLETE, len(rows))
                    break

    def _same_shape(self, batch: Batch) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.intp], str, int]]:
        """Messages of one length, byte order and length of `frame_id`."""
        plausible = (batch.length >= 20) & (batch.length <= _LONGEST)
        self._count(_INCOMPLETE, int(np.sum(~plausible)))
        where = np.flatnonzero(plausible)
        if len(where) == 0:
            return
        head = sliding_window_view(batch.buffer, 16)[batch.start[where]]
        ros1 = batch.topic.encoding == 'ros1'
        kind = np.ones(len(where), np.int64) if ros1 else head[:, 0].astype(np.int64) << 8 | head[:, 1]
        text = np.where(kind == 0, head[:, 12:16].copy().view('>u4')[:, 0], head[:, 12:16].copy().view('<u4')[:, 0])
        key = batch.length[where] << 33 | text.astype(np.int64) << 1 | kind
        plain = kind <= 1
        self._count('in an encoding other than plain CDR', int(np.sum(~plain)))
        key, where = key[plain], where[plain]
        keys = np.unique(key) if np.any(key != key[:1]) else key[:1]
        for one in keys.tolist():
            at = where[key == one]
            rows = sliding_window_view(batch.buffer, one >> 33)[batch.start[at]]
            yield rows, at, '<' if one & 1 else '>', 0 if ros1 else 4

    def _layout(self, message: bytes, order: str, origin: int) -> _Layout:
        try:
            cursor = _Cursor(message, order, origin)
            if self._joint_names is not None:
                return _joint_layout(cursor, self._joint_names)
            if len(self.frame_ids) < _MOST_FRAME_IDS:
                self.frame_ids.add(cursor.frame_id.decode('utf-8', 'replace'))
            return _wrench_layout(cursor)
        except (struct.error, ValueError):
            return _Layout(order, 0, slice(0, len(message)), message, problem=_INCOMPLETE)


class _Layout(NamedTuple):
    """Where the fields of a message are.

    Attributes:
        order: byte order, `<` or `>`.
        origin: 4 in CDR, 0 in ROS 1.
        block: bytes that must agree for another message of the same shape to share the layout.
        content: what these are.
        first: where the first value is.
        second: where the second value is.
        problem: why there are no values.
        names: joint names, where they are the problem.
        frame_id_size: length of `frame_id`, bytes.
    """

    order: str
    origin: int
    block: slice
    content: bytes
    first: int = 0
    second: int = 0
    problem: str = ''
    names: tuple[str, ...] = ()
    frame_id_size: int = 0

    def fits(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        expected = np.frombuffer(self.content, np.uint8)
        return np.asarray(np.all(rows[:, self.block] == expected, axis=1))

    def stamp(self, rows: NDArray[np.uint8]) -> NDArray[np.int64]:
        seconds = self._column(rows, 4, 'i4' if self.origin else 'u4')
        return seconds.astype(np.int64) * 1_000_000_000 + self._column(rows, 8, 'u4').astype(np.int64)

    def values(self, rows: NDArray[np.uint8]) -> NDArray[np.float64]:
        return np.stack([self._column(rows, at, 'f8') for at in (self.first, self.second)], axis=1)

    def third(self, rows: NDArray[np.uint8]) -> NDArray[np.float64]:
        """fz, (n,)."""
        return self._column(rows, self.second + 8, 'f8').astype(np.float64)

    def _column(self, rows: NDArray[np.uint8], at: int, kind: str) -> NDArray[np.generic]:
        size = int(kind[1:])
        return np.ascontiguousarray(rows[:, at : at + size]).view(self.order + kind)[:, 0]


class _Cursor:
    """Reads one message field by field, to learn its layout."""

    def __init__(self, message: bytes, order: str, origin: int) -> None:
        self.message = message
        self.order = order
        self.origin = origin
        self.at = 12
        self.frame_id = self.text()

    def align(self, size: int) -> None:
        if self.origin:
            self.at += -(self.at - self.origin) % size

    def count(self) -> int:
        self.align(4)
        (value,) = struct.unpack_from(self.order + 'I', self.message, self.at)
        self.at += 4
        return int(value)

    def text(self) -> bytes:
        size = self.count()
        value = self.message[self.at : self.at + size]
        if len(value) < size:
            raise ValueError('a string reaches beyond the message')
        self.at += size
        return value.rstrip(b'\0')

    def doubles(self, count: int) -> int:
        """Where that many doubles start."""
        self.align(8)
        if self.at + 8 * count > len(self.message):
            raise ValueError('numbers reach beyond the message')
        return self.at


def _wrench_layout(cursor: _Cursor) -> _Layout:
    force = cursor.doubles(6)
    size = len(cursor.frame_id)
    return _Layout(cursor.order, cursor.origin, slice(0, 0), b'', force, force + 8, frame_id_size=size)


def _joint_layout(cursor: _Cursor, joint_names: tuple[str, str]) -> _Layout:
    start = cursor.at
    number = cursor.count()
    if 4 * number > len(cursor.message):
        raise ValueError('more names than fit in the message')
    names = tuple(cursor.text().decode('utf-8', 'replace') for _ in range(number))
    positions = cursor.count()
    block = slice(start, cursor.at)
    layout = _Layout(cursor.order, cursor.origin, block, cursor.message[block])
    if not set(joint_names) <= set(names):
        return layout._replace(problem=f'without {" and ".join(joint_names)}', names=names)
    first, second = (names.index(name) for name in joint_names)
    if max(first, second) >= positions:
        return layout._replace(problem='without positions')
    begin = cursor.doubles(positions)
    return layout._replace(first=begin + 8 * first, second=begin + 8 * second)


def decode_string(payload: bytes, encoding: str) -> str:
    """The text of a `std_msgs/msg/String`.

    Raises:
        ValueError: the bytes are no such message.
    """
    at, order = (0, '<') if encoding == 'ros1' else (4, '>' if payload[1:2] == b'\0' else '<')
    if len(payload) < at + 4:
        raise ValueError('incomplete')
    (size,) = struct.unpack_from(order + 'I', payload, at)
    text = payload[at + 4 : at + 4 + size]
    if len(text) < size:
        raise ValueError('incomplete')
    return text.rstrip(b'\0').decode('utf-8')
