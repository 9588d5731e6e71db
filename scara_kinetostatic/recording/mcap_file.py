"""A `.mcap` file, whole or not.

A whole file is read by its index, so that chunks without the wanted topics
(camera images, say) are never touched. A file without an index, because its
writer was killed or the end is lost, is read from the front as far as it goes.
A damaged chunk costs that chunk and a warning, not the recording.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.summary import Summary
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.recording.inflate import inflate
from scara_kinetostatic.recording.raw import BATCH, Batch, Batches, Topic, ros2_type, ros_topic

MAGIC = b'\x89MCAP0\r\n'
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
_RECORD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<BQH')
_SCHEMA, _CHANNEL, _DATA, _CHUNK = 3, 4, 5, 6
_HEAD = 9 + 22  # opcode and length of the record; channel, sequence, two times


class McapFile:
    """Reads an MCAP file with messages of ROS 2 or ROS 1; a `Source`.

    Args:
        path: the file.
        stream: what to read it from where that is not the file itself (a decompressor); need not seek.
    """

    def __init__(self, path: Path, stream: IO[bytes] | None = None) -> None:
        self.path = path
        self.warnings: list[str] = []
        self._stream = stream
        self._limit = path.stat().st_size if stream is None else 1 << 32
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """Every topic of the file."""
        return list(dict.fromkeys(self._channels.values()))

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, chunk by chunk."""
        with self._stream or self.path.open('rb') as stream:
            summary = self._summary(stream) if self._stream is None else None
            if summary is not None:
                yield from self._by_index(stream, summary, wanted)
            else:
                yield from self._from_front(stream, wanted)

    def _summary(self, stream: IO[bytes]) -> Summary | None:
        """What the end of the file says about the whole; None where it says nothing or nonsense."""
        try:
            reader = SeekingReader(stream, validate_crcs=True, record_size_limit=self._limit)
            summary = reader.get_summary()
        except _DAMAGE:
            summary = None
        stream.seek(0)
        complete = summary is not None and summary.statistics is not None and bool(summary.channels)
        if summary is None or not complete or len(summary.chunk_indexes) != summary.statistics.chunk_count:  # type: ignore[union-attr]
            return None
        loose = summary.statistics.message_count and not summary.chunk_indexes  # type: ignore[union-attr]
        return None if loose else summary

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
            try:
                stream.seek(index.chunk_start_offset)
                opcode, length = _RECORD.unpack(stream.read(9))
                if opcode != _CHUNK or length > self._limit:
                    raise ValueError('no chunk where the index says')
                chunk = Chunk.read(ReadDataStream(stream))
            except _DAMAGE as error:
                self._damaged(index.chunk_start_offset, error)
                continue
            yield from self._chunk(chunk, index.chunk_start_offset, wanted)

    def _from_front(self, stream: IO[bytes], wanted: Collection[str]) -> Iterator[Batch]:
        loose = _Loose()
        offset = len(MAGIC)
        try:
            for record in StreamReader(stream, emit_chunks=True, record_size_limit=self._limit).records:
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
                offset = stream.tell()
        except _DAMAGE:
            yield from loose.rest()
            self.warnings.append(
                f'{self.path.name} breaks off after {offset} bytes (writer killed, or copy not complete): '
                'read as far as it goes'
            )
            yield from self._torn_chunk(stream, offset, wanted)
        else:
            yield from loose.rest()

    def _torn_chunk(self, stream: IO[bytes], offset: int, wanted: Collection[str]) -> Iterator[Batch]:
        """What can be had of a chunk whose end is missing."""
        if self._stream is not None:
            return
        try:
            stream.seek(offset)
            torn = stream.read(self._limit - offset)
            opcode, _ = _RECORD.unpack_from(torn)
            if opcode != _CHUNK:
                return
            size, name_length = struct.unpack_from('<16xQ4xI', torn, 9)
            data_at = 9 + 32 + name_length + 8
            compression = torn[9 + 32 : 9 + 32 + name_length].decode()
            data = inflate(torn[data_at:], compression, size)
        except _DAMAGE:
            return
        yield from self._messages(data, wanted)

    def _chunk(self, chunk: Chunk, offset: int, wanted: Collection[str]) -> Iterator[Batch]:
        try:
            data = inflate(chunk.data, chunk.compression, chunk.uncompressed_size)
            if len(data) != chunk.uncompressed_size:
                raise ValueError(f'expected {chunk.uncompressed_size} bytes, got {len(data)}')
            if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
                raise ValueError('the checksum does not match')
        except _DAMAGE as error:
            self._damaged(offset, error)
            return
        yield from self._messages(data, wanted)

    def _messages(self, data: bytes, wanted: Collection[str]) -> Iterator[Batch]:
        """The messages in the bytes of one chunk; what does not look like a record ends it."""
        places: dict[Topic, list[int]] = {}
        for key, places_of_channel in self._walk(data).items():
            topic = self._channels.get(key)
            if topic is not None and topic.name in wanted:
                places.setdefault(topic, []).extend(places_of_channel)
        buffer = np.frombuffer(data, np.uint8)
        for topic, starts in places.items():
            at = np.sort(np.array(starts, dtype=np.int64))
            yield Batch(topic, _field(buffer, at + 15), buffer, at + _HEAD, _field(buffer, at + 1) - 22)

    def _walk(self, data: bytes) -> dict[int, list[int]]:
        """Where the messages of each channel start; schemas and channels on the way are taken in."""
        places: dict[int, list[int]] = {}
        unpack, size = _MESSAGE.unpack_from, len(data)
        at = 0
        while at + 11 <= size:
            opcode, length, key = unpack(data, at)
            end = at + 9 + length
            if end > size:
                break
            if opcode == _DATA and length >= 22:
                if key in places:
                    places[key].append(at)
                else:
                    places[key] = [at]
            elif opcode in (_SCHEMA, _CHANNEL):
                self._definition(opcode, data[at + 9 : end])
            at = end
        return places

    def _definition(self, opcode: int, content: bytes) -> None:
        stream = ReadDataStream(BytesIO(content))
        if opcode == _SCHEMA:
            self._add_schema(Schema.read(stream))
        else:
            self._add_channel(Channel.read(stream))

    def _add_schema(self, schema: Schema) -> None:
        self._schemas[schema.id] = ros2_type(schema.name)

    def _add_channel(self, channel: Channel) -> None:
        msgtype = self._schemas.get(channel.schema_id, 'unknown')
        self._channels[channel.id] = Topic(ros_topic(channel.topic), msgtype, channel.message_encoding)

    def _damaged(self, offset: int, error: Exception) -> None:
        reason = str(error) or type(error).__name__
        self.warnings.append(f'{self.path.name}: a damaged chunk at byte {offset} was left out ({reason})')


class _Loose:
    """Gathers messages that lie outside chunks into batches."""

    def __init__(self) -> None:
        self._pending: dict[Topic, tuple[list[int], list[bytes]]] = {}

    def add(self, topic: Topic, time: int, payload: bytes) -> Iterator[Batch]:
        times, payloads = self._pending.setdefault(topic, ([], []))
        times.append(time)
        payloads.append(payload)
        if len(times) == BATCH:
            yield Batch.from_payloads(topic, times, payloads)
            del self._pending[topic]

    def rest(self) -> Iterator[Batch]:
        for topic, (times, payloads) in self._pending.items():
            yield Batch.from_payloads(topic, times, payloads)
        self._pending.clear()


def _field(buffer: NDArray[np.uint8], at: NDArray[np.int64]) -> NDArray[np.int64]:
    """The 8-byte number at each of several places."""
    return sliding_window_view(buffer, 8)[at].view('<i8')[:, 0].astype(np.int64)
