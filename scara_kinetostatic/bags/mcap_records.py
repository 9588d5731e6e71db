"""The records of an MCAP file: the messages of a chunk as arrays, without an object for each, and the checksums.

Three kinds of CRC-32 cover every byte of a file: one of each chunk, one of the data section (the chunks as they lie
in the file), one of the summary section (the index behind them). A writer may leave any of them out (0 in its place);
what it would cover cannot be verified then. `mcap.reader.SeekingReader`, which reads by the index, verifies neither of
the last two; `summary_is_intact` and `data_is_intact` do.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from os import SEEK_END
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.exceptions import McapError
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.bags.messages import BATCH, Batch, Topic

MAGIC = b'\x89MCAP0\r\n'
"""First and last bytes of an MCAP file."""
SCHEMA, _CHANNEL, CHUNK = 3, 4, 6
"""Opcodes."""
_FOOTER_OPCODE, _MESSAGE, _DATA_END_OPCODE = 2, 5, 15
RECORD = struct.Struct('<BQ')
"""Head of every record: opcode, length of the content."""
_RECORD_AND_ID = struct.Struct('<BQH')
_FOOTER = struct.Struct('<BQQQI8s')
"""Opcode, length, start of the summary section, start of its offsets, its CRC, magic."""
_NOT_IN_SUMMARY_CRC = 4 + 8
"""The CRC of the summary section covers the footer without its last bytes: the CRC itself and the magic, bytes."""
_DATA_END = struct.Struct('<BQI')
"""Opcode, length, CRC of the data section: all bytes of the file before this record."""
_MESSAGE_HEAD = 9 + 22
"""Bytes before the payload of a message: opcode, length; channel, sequence, log time, publish time."""
_PORTION = 1 << 20
"""Bytes read at a time for a checksum."""


class ChunkRecords(NamedTuple):
    """The records of a chunk.

    Attributes:
        messages: by channel number, where its messages start, bytes from the start of the chunk.
        definitions: opcode and content of the schemas and channels.
        complete: whether the chunk consists of valid records to its end.
    """

    messages: dict[int, list[int]]
    definitions: list[tuple[int, bytes]]
    complete: bool


def chunk_records(data: bytes) -> ChunkRecords:
    """The records in the decompressed bytes of a chunk, up to the first one that is not valid."""
    places: dict[int, list[int]] = {}
    definitions: list[tuple[int, bytes]] = []
    complete = True
    unpack, size = _RECORD_AND_ID.unpack_from, len(data)
    at = 0
    while at + 11 <= size:
        opcode, length, key = unpack(data, at)
        end = at + 9 + length
        if end > size:
            break
        if opcode == _MESSAGE and length >= 22:
            if key in places:
                places[key].append(at)
            else:
                places[key] = [at]
        elif opcode in (SCHEMA, _CHANNEL):
            definitions.append((opcode, data[at + 9 : end]))
        else:
            complete &= opcode != _MESSAGE
        at = end
    return ChunkRecords(places, definitions, complete and at == size)


def message_batch(topic: Topic, data: bytes, starts: list[int]) -> Batch:
    """The messages of one topic in a chunk.

    Args:
        topic: their topic.
        data: the decompressed bytes of the chunk.
        starts: where the messages start in them, (n,).
    """
    buffer = np.frombuffer(data, np.uint8)
    at = np.sort(np.array(starts, dtype=np.int64))
    return Batch(topic, _field(buffer, at + 15), buffer, at + _MESSAGE_HEAD, _field(buffer, at + 1) - 22)


class MessageBuffer:
    """Collects messages that lie outside chunks into batches of `BATCH` messages, topic by topic."""

    def __init__(self) -> None:
        self._pending: dict[Topic, tuple[list[int], list[bytes]]] = {}

    def add(self, topic: Topic, time: int, payload: bytes) -> Iterator[Batch]:
        """Adds a message; yields a batch when one is full."""
        times, payloads = self._pending.setdefault(topic, ([], []))
        times.append(time)
        payloads.append(payload)
        if len(times) == BATCH:
            yield Batch.from_payloads(topic, times, payloads)
            del self._pending[topic]

    def flush(self) -> Iterator[Batch]:
        """Yields what is left in batches that are not full."""
        for topic, (times, payloads) in self._pending.items():
            yield Batch.from_payloads(topic, times, payloads)
        self._pending.clear()


def summary_is_intact(stream: IO[bytes]) -> bool:
    """Whether the file has a footer and its summary section has the CRC stated there, or none is stated.

    Raises:
        OSError: the file cannot be read.
        McapError: it is shorter than a footer.
    """
    size = stream.seek(0, SEEK_END)
    opcode, _, start, _, expected, magic = _read(stream, size - _FOOTER.size, _FOOTER)
    if (opcode, magic) != (_FOOTER_OPCODE, MAGIC):
        return False
    return not (start and expected) or _crc(stream, start, size - _NOT_IN_SUMMARY_CRC) == expected


def data_is_intact(stream: IO[bytes]) -> bool:
    """Whether the data section has the CRC stated at its end, or none is stated. Reads the whole file.

    Raises:
        OSError: the file cannot be read.
        McapError: it is shorter than a footer.
    """
    size = stream.seek(0, SEEK_END)
    summary_start = int(_read(stream, size - _FOOTER.size, _FOOTER)[2])
    if not summary_start:  # without a summary section behind it, the end of the data section is not known
        return True
    end = summary_start - _DATA_END.size
    opcode, _, expected = _read(stream, end, _DATA_END)
    return opcode == _DATA_END_OPCODE and (not expected or _crc(stream, 0, end) == expected)


def _read(stream: IO[bytes], at: int, record: struct.Struct) -> tuple[Any, ...]:
    if at < 0:
        raise McapError('the file is too short')
    stream.seek(at)
    content = stream.read(record.size)
    if len(content) < record.size:
        raise McapError('a record is cut off')
    return record.unpack(content)


def _crc(stream: IO[bytes], start: int, end: int) -> int:
    """CRC-32 of the bytes from `start` to `end`."""
    stream.seek(start)
    checksum, left = 0, end - start
    while left > 0 and (portion := stream.read(min(left, _PORTION))):
        checksum = zlib.crc32(portion, checksum)
        left -= len(portion)
    return checksum


def _field(buffer: NDArray[np.uint8], at: NDArray[np.int64]) -> NDArray[np.int64]:
    """The 8-byte integer at each of n offsets."""
    return sliding_window_view(buffer, 8)[at].view('<i8')[:, 0].astype(np.int64)
