"""A `.mcap` file, complete or cut off, read from its start by the library `mcap` down to its chunks.

Of a file whose writer was killed, or whose end is lost, all is read up to there; of a damaged file everything but the
damaged chunks. The first one defines the topics; where it is damaged, the summary at the end of a complete file repeats
them. Chunk and file have checksums, and a complete file counts its messages: damage that changes what is read becomes a
warning. The messages of a chunk become arrays, without an object for each.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import suppress
from io import SEEK_END, BytesIO
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader
from numpy.lib.stride_tricks import sliding_window_view

from scara_kinetostatic.bags.decoding import BATCH, LARGEST_MESSAGE, Batch, Batches, Budget, Storage, Topic, unpack

MAGIC = b'\x89MCAP0\r\n'
"""First and last bytes of an MCAP file."""
_FOOTER = struct.Struct(f'<QQI{len(MAGIC)}s')
"""The end of a file: where its summary starts, and what follows."""
_MESSAGE = np.dtype([('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'), ('times', '<i8', 2)])
"""What is before the payload of a message: its length counts what follows, the times are of log and publishing."""
_AFTER_LENGTH = int(_MESSAGE.fields['channel'][1])  # type: ignore[index]
_LEAST = _MESSAGE.itemsize - _AFTER_LENGTH
"""Length of a message without payload."""
_ENTRY = 16
"""Bytes of statistics, a schema or a channel that cost as much as a record."""
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)
_READ = (Opcode.HEADER, *_DEFINITIONS, Opcode.MESSAGE, Opcode.CHUNK, Opcode.DATA_END, Opcode.STATISTICS, Opcode.FOOTER)
"""Records that are read; the others, such as the index, are skipped."""
_DAMAGE = (McapError, zstandard.ZstdError, struct.error, LookupError, MemoryError, OSError, RuntimeError, ValueError)


class McapFile(Storage):
    """An MCAP file with messages of ROS 2."""

    def __init__(self, path: Path, budget: Budget) -> None:
        super().__init__(path, budget)
        self._schemas: dict[int, str] = {}

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, chunk by chunk."""
        read, statistics = Counter[str](), list[Statistics]()
        with self.path.open('rb') as stream:
            for batch in self._batches(stream, wanted, statistics):
                read[batch.topic.name] += len(batch.start)
                yield batch
        if statistics and not self.warnings and (counts := statistics[0].channel_message_counts):
            self._compare(counts, read, wanted)

    def _batches(self, stream: IO[bytes], wanted: Collection[str], statistics: list[Statistics]) -> Iterator[Batch]:
        """The messages; appends what the file states of their number."""
        loose: dict[Topic, tuple[list[int], list[bytes]]] = {}
        offset, ended = len(MAGIC), False
        reader = _Records(stream, emit_chunks=True, validate_crcs=True, record_size_limit=self.path.stat().st_size)
        reader.budget = self._budget
        try:
            for record in reader.records:
                if isinstance(record, Message):
                    topic = self._topics.get(record.channel_id)
                    if topic is not None and topic.name in wanted:
                        times, payloads = loose.setdefault(topic, ([], []))
                        times.append(record.log_time)
                        payloads.append(record.data)
                        if len(times) == BATCH:
                            yield Batch.from_payloads(topic, *loose.pop(topic))
                elif isinstance(record, Chunk):
                    yield from self._chunk(record, offset, wanted)
                elif isinstance(record, (Schema, Channel)):
                    self._define([record])
                elif isinstance(record, Statistics):
                    statistics.append(record)
                ended = ended or isinstance(record, DataEnd)
                offset = stream.tell()
        except CRCValidationError:
            self.warnings.append(f'{self.path.name}: damaged somewhere: the checksum of its data does not match')
        except _DAMAGE:
            why = '(writer killed, or copy not complete)'
            self.warnings.append(f'{self.path.name} ends early, after {offset} bytes {why}: read up to there')
            self.cut_off = '' if ended else self.warnings[-1]
        for topic, messages in loose.items():
            yield Batch.from_payloads(topic, *messages)

    def _chunk(self, chunk: Chunk, offset: int, wanted: Collection[str]) -> Iterator[Batch]:
        if (size := max(chunk.uncompressed_size, len(chunk.data))) > self._budget.largest_piece:
            skipped = f'a chunk of {size} bytes, at byte {offset}, was skipped'
            self.warnings.append(f'{self.path.name}: {skipped}; if you trust it, --max-bytes {size} reads it')
            return
        try:
            data = unpack(chunk.data, chunk.uncompressed_size) if chunk.compression else chunk.data
            if chunk.compression and len(data) != chunk.uncompressed_size:
                raise ValueError(f'it unpacks to {len(data)} bytes, expected {chunk.uncompressed_size}')
            if chunk.uncompressed_crc and chunk.uncompressed_crc != zlib.crc32(data):
                raise ValueError('its checksum does not match')
            starts, definitions, number = _records(data, self._budget.records)
            self._budget.charge(len(chunk.data) + len(data), number + sum(map(len, definitions)) // _ENTRY)
            self._define(map(_definition, definitions))
        except _DAMAGE as error:
            reason = str(error) or type(error).__name__
            self.warnings.append(f'{self.path.name}: the damaged chunk at byte {offset} was skipped ({reason})')
            with suppress(*_DAMAGE):
                self._define(self._summary())
            return
        places: dict[Topic, list[int]] = {}
        for key, found in starts.items():
            topic = self._topics.get(key)
            if topic is not None and topic.name in wanted:
                places.setdefault(topic, []).extend(found)
        buffer = np.frombuffer(data, np.uint8)
        for topic, found in places.items():
            at, size = np.sort(np.array(found, dtype=np.int64)), _MESSAGE.itemsize
            head = sliding_window_view(buffer, size)[at].view(_MESSAGE)[:, 0]
            yield Batch(topic, head['times'][:, 0].copy(), buffer, at + size, head['length'].astype(np.int64) - _LEAST)

    def _summary(self) -> list[Schema | Channel]:
        """The definitions at the end of a complete file."""
        with self.path.open('rb') as stream:
            stream.seek(-_FOOTER.size, SEEK_END)
            start, *_ = _FOOTER.unpack(stream.read())
            stream.seek(start)
            reader = _Records(stream, skip_magic=True, record_size_limit=LARGEST_MESSAGE)
            reader.budget = self._budget
            return [record for record in reader.records if isinstance(record, (Schema, Channel))] if start else []

    def _define(self, records: Iterable[Schema | Channel]) -> None:
        for record in records:
            if isinstance(record, Schema):
                self._schemas[record.id] = record.name
            else:
                msgtype = self._schemas.get(record.schema_id, 'unknown')
                self._topics[record.id] = Topic.of(record.topic, msgtype, record.message_encoding)


class _Records(StreamReader):
    """That of `mcap`, which takes records of any length apart: they are charged before, and only some are read."""

    budget: Budget

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        if opcode in (Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL):
            _check_definition(length)
        self.budget.charge(0, 1 + length // _ENTRY if opcode in (*_DEFINITIONS, Opcode.STATISTICS) else 1)
        return super()._read_record(opcode if opcode in _READ else 0, length)


def _check_definition(length: int) -> None:
    if length > LARGEST_MESSAGE:
        raise ValueError(f'a definition of {length} bytes, expected at most {LARGEST_MESSAGE}')


def _records(data: bytes, most: int) -> tuple[dict[int, list[int]], list[bytes], int]:
    """By channel number, where its messages start in the bytes of a chunk; each schema and channel, once; and the
    number of all records. With more than `most` that are no messages, the others are left out.

    Raises:
        ValueError: the chunk does not consist of valid records to its end.
    """
    places: dict[int, list[int]] = {}
    definitions: dict[bytes, None] = {}
    head, size, message = struct.Struct('<BQH'), len(data), int(Opcode.MESSAGE)
    parts, at, others = head.unpack_from, 0, 0
    while at + head.size <= size:
        opcode, length, key = parts(data, at)
        end = at + _AFTER_LENGTH + length
        if end > size:
            break
        if opcode == message and length >= _LEAST:
            if key in places:
                places[key].append(at)
            else:
                places[key] = [at]
        elif opcode == message or others > most:
            break
        else:
            others += 1
            if opcode in _DEFINITIONS:
                _check_definition(length)
                definitions[data[at:end]] = None
        at = end
    if at != size and others <= most:
        raise ValueError('invalid records')
    return places, list(definitions), others + sum(map(len, places.values()))


def _definition(record: bytes) -> Schema | Channel:
    content = ReadDataStream(BytesIO(record[_AFTER_LENGTH:]))
    return Schema.read(content) if record[0] == Opcode.SCHEMA else Channel.read(content)
