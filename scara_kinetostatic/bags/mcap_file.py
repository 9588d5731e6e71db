"""A `.mcap` file, complete or cut off.

A complete file is read by its index, so that chunks without the wanted topics (camera images, say) are skipped. A
file without an index, because its writer was killed or its end is lost, is read from the start as far as it is valid.
Of a damaged file everything but the damaged chunks is read. Every damage that the checksums and message counts of the
file show becomes a warning.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Message, Schema, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.summary import Summary

from scara_kinetostatic.bags.decompression import decompress
from scara_kinetostatic.bags.mcap_records import (
    CHUNK,
    MAGIC,
    RECORD,
    SCHEMA,
    MessageBuffer,
    chunk_records,
    data_is_intact,
    message_batch,
    summary_is_intact,
)
from scara_kinetostatic.bags.messages import Batch, Batches, Topic, ros2_type, ros_topic

_SMALL = 1 << 26
"""The checksum of the whole file is verified up to this size even if most of it was not read, bytes (0.1 s)."""
_DAMAGE = (
    McapError,
    CRCValidationError,
    zstandard.ZstdError,
    struct.error,
    LookupError,
    OSError,
    RuntimeError,
    ValueError,
)


class McapFile:
    """Reads an MCAP file with messages of ROS 2 or ROS 1; a `Source`.

    Args:
        path: the file.
        stream: what to read instead of the file itself, a decompressor, say; need not be seekable.
    """

    def __init__(self, path: Path, stream: IO[bytes] | None = None) -> None:
        self.path = path
        self.warnings: list[str] = []
        self._stream = stream
        self._limit = path.stat().st_size if stream is None else 1 << 32
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Topic] = {}
        self._read: Counter[str] = Counter()
        self._statistics: Statistics | None = None
        self._bytes_read = 0

    def topics(self) -> list[Topic]:
        """Every topic of the file."""
        return list(dict.fromkeys(self._channels.values()))

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, chunk by chunk."""
        with self._stream or self.path.open('rb') as stream:
            summary, intact = self._summary(stream) if self._stream is None else (None, True)
            messages = self._from_start(stream, wanted) if summary is None else self._by_index(stream, summary, wanted)
            for batch in messages:
                self._read[batch.topic.name] += len(batch.start)
                yield batch
            if not self.warnings and not intact:
                self.warnings.append(f'{self.path.name}: the index at its end is damaged; read from the start')
            if not self.warnings:
                self._check(stream, wanted)

    def _summary(self, stream: IO[bytes]) -> tuple[Summary | None, bool]:
        """The index at the end of the file, None if it cannot be used, and whether it is undamaged."""
        summary = None
        try:
            intact = summary_is_intact(stream)
            stream.seek(0)
            if intact:
                summary = SeekingReader(stream, record_size_limit=self._limit).get_summary()
        except _DAMAGE:
            intact = False
        stream.seek(0)
        if summary is None or summary.statistics is None or not summary.channels:
            return None, intact
        self._statistics = summary.statistics
        if len(summary.chunk_indexes) != summary.statistics.chunk_count:
            return None, intact
        loose = summary.statistics.message_count and not summary.chunk_indexes
        return None if loose else summary, intact

    def _by_index(self, stream: IO[bytes], summary: Summary, wanted: Collection[str]) -> Iterator[Batch]:
        for schema in summary.schemas.values():
            self._add_schema(schema)
        for channel in summary.channels.values():
            self._add_channel(channel)
        ids = {key for key, topic in self._channels.items() if topic.name in wanted}
        if not ids:
            return
        for index in sorted(summary.chunk_indexes, key=lambda item: item.chunk_start_offset):
            if index.message_index_offsets and ids.isdisjoint(index.message_index_offsets):
                continue
            self._bytes_read += index.chunk_length
            try:
                stream.seek(index.chunk_start_offset)
                opcode, length = RECORD.unpack(stream.read(9))
                if opcode != CHUNK or length > self._limit:
                    raise ValueError('no chunk at the place in the index')
                chunk = Chunk.read(ReadDataStream(stream))
            except _DAMAGE as error:
                self._damaged(index.chunk_start_offset, error)
                continue
            yield from self._chunk(chunk, index.chunk_start_offset, wanted)

    def _from_start(self, stream: IO[bytes], wanted: Collection[str]) -> Iterator[Batch]:
        loose = MessageBuffer()
        offset = len(MAGIC)
        records = StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=self._limit).records
        try:
            for record in records:
                if isinstance(record, Schema):
                    self._add_schema(record)
                elif isinstance(record, Channel):
                    self._add_channel(record)
                elif isinstance(record, Message):
                    topic = self._channels.get(record.channel_id)
                    if topic is not None and topic.name in wanted:
                        yield from loose.add(topic, record.log_time, record.data)
                elif isinstance(record, Chunk):
                    yield from self._chunk(record, offset, wanted)
                elif isinstance(record, Statistics):
                    self._statistics = record
                offset = stream.tell()
        except CRCValidationError:
            yield from loose.flush()
            self._data_damaged()
        except _DAMAGE:
            yield from loose.flush()
            self.warnings.append(
                f'{self.path.name} ends early, after {offset} bytes (writer killed, or copy not complete): '
                'read up to there'
            )
            yield from self._incomplete_chunk(stream, offset, wanted)
        else:
            yield from loose.flush()

    def _incomplete_chunk(self, stream: IO[bytes], offset: int, wanted: Collection[str]) -> Iterator[Batch]:
        """The messages in a chunk whose end is missing."""
        if self._stream is not None:
            return
        try:
            stream.seek(offset)
            part = stream.read(self._limit - offset)
            opcode, _ = RECORD.unpack_from(part)
            if opcode != CHUNK:
                return
            size, name_length = struct.unpack_from('<16xQ4xI', part, 9)
            data_at = 9 + 32 + name_length + 8
            compression = part[9 + 32 : 9 + 32 + name_length].decode()
            data = decompress(part[data_at:], compression, size)
        except _DAMAGE:
            return
        yield from self._messages(data, offset, wanted)

    def _chunk(self, chunk: Chunk, offset: int, wanted: Collection[str]) -> Iterator[Batch]:
        try:
            data = decompress(chunk.data, chunk.compression, chunk.uncompressed_size)
            if len(data) != chunk.uncompressed_size:
                raise ValueError(f'expected {chunk.uncompressed_size} bytes, got {len(data)}')
            if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
                raise ValueError('the checksum does not match')
        except _DAMAGE as error:
            self._damaged(offset, error)
            return
        yield from self._messages(data, offset, wanted)

    def _messages(self, data: bytes, offset: int, wanted: Collection[str]) -> Iterator[Batch]:
        """The messages in the bytes of one chunk, up to the first invalid record."""
        found = chunk_records(data)
        intact = found.complete
        for opcode, content in found.definitions:
            intact &= self._define(opcode, content)
        starts: dict[Topic, list[int]] = {}
        for key, places in found.messages.items():
            topic = self._channels.get(key)
            intact &= topic is not None
            if topic is not None and topic.name in wanted:
                starts.setdefault(topic, []).extend(places)
        for topic, places in starts.items():
            yield message_batch(topic, data, places)
        if not intact and not self.warnings:
            self.warnings.append(f'{self.path.name}: the chunk at byte {offset} is damaged: read up to the damage')

    def _define(self, opcode: int, content: bytes) -> bool:
        """Adds a schema or channel that a chunk contains; returns whether it is valid."""
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == SCHEMA:
                self._add_schema(Schema.read(stream))
            else:
                self._add_channel(Channel.read(stream))
        except _DAMAGE:
            return False
        return True

    def _add_schema(self, schema: Schema) -> None:
        self._schemas[schema.id] = ros2_type(schema.name)

    def _add_channel(self, channel: Channel) -> None:
        msgtype = self._schemas.get(channel.schema_id, 'unknown')
        self._channels[channel.id] = Topic(ros_topic(channel.topic), msgtype, channel.message_encoding)

    def _check(self, stream: IO[bytes], wanted: Collection[str]) -> None:
        """Warns where other numbers of messages were read than the file states, or the checksum of its data differs.

        The checksum needs the whole file; it is not verified where that is large and most of it was not read.
        """
        counts = self._statistics.channel_message_counts if self._statistics else {}
        for topic in wanted if counts else ():
            ids = [key for key, channel in self._channels.items() if channel.name == topic]
            expected = sum(counts.get(key, 0) for key in ids)
            if expected != self._read[topic]:
                self.warnings.append(
                    f'{self.path.name}: its index states {expected} messages of {topic}, read were {self._read[topic]}'
                )
        worth_it = self._stream is None and (self._limit < _SMALL or 2 * self._bytes_read > self._limit)
        if worth_it and not data_is_intact(stream):
            self._data_damaged()

    def _data_damaged(self) -> None:
        self.warnings.append(f'{self.path.name}: damaged somewhere: the checksum of its data does not match')

    def _damaged(self, offset: int, error: Exception) -> None:
        reason = str(error) or type(error).__name__
        self.warnings.append(f'{self.path.name}: the damaged chunk at byte {offset} was skipped ({reason})')
