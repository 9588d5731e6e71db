"""A `.bag` file of ROS 1, read by `rosbags`, which also converts its messages to those of ROS 2."""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import Chunk, IndexData, decompressors

from scara_kinetostatic.bags.cdr import ros2_types
from scara_kinetostatic.bags.messages import LARGEST_MESSAGE, PORTION, Batches, Budget, Source, Topic, batched, unpack
from scara_kinetostatic.errors import RecordingError

_HEADER, _FIELD = 64, 4
"""Bytes of a message beside its payload, and so many more cost a record."""


class _BoundedReader(Reader):
    """That of `rosbags`, which trusts the sizes in a file: what it unpacks and takes apart is charged."""

    def __init__(self, path: Path, budget: Budget) -> None:
        super().__init__(path)
        self._budget = budget
        self._ids: set[int] = set()

    def read_connection(self) -> Connection:
        """One of the connections; each has a number of its own."""
        found = super().read_connection()
        if found.id in self._ids:
            raise ReaderError(f'its index has two connections of number {found.id}')
        self._ids.add(found.id)
        return found

    def read_chunk(self) -> Chunk:
        """The place of a chunk, with a decompressor that has a limit."""
        assert self.bio is not None
        begin = self.bio.tell()
        found = super().read_chunk()
        self._budget.charge(0, (found.datapos - begin) // _FIELD)
        is_plain = found.decompressor is decompressors['none']

        def content(data: bytes) -> bytes:
            plain = data if is_plain else unpack(data, self._budget.largest_piece)
            self._budget.charge(len(plain))
            return plain

        return found._replace(decompressor=content)

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """The places of a connection's messages in a chunk."""
        assert self.bio is not None
        begin = self.bio.tell()
        super().read_index_data(pos, indexes)
        self._budget.charge(0, (self.bio.tell() - begin) // 12)


class Ros1File(Source):
    """A bag of format 2.0, plain or compressed chunk by chunk."""

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, in the order of their recording."""
        try:
            with _BoundedReader(self.path, self._budget) as reader:
                for item in reader.connections:
                    self._topics[item.id] = Topic.of(item.topic, item.msgtype, 'cdr')
                for topic in (topic for topic in self.topics() if topic.name in wanted):
                    connections = [item for item in reader.connections if self._topics[item.id] == topic]
                    yield from batched(topic, self._portions(reader, connections, topic), self._budget)
        except ReaderError as error:
            indexed = 'index' not in str(error)
            remedy = 'copy it or record it again' if indexed else 'copy it again, or run "rosbag reindex" on it'
            raise RecordingError(self.path, f'the bag cannot be read: {error}', remedy) from error

    def _portions(
        self, reader: _BoundedReader, connections: list[Connection], topic: Topic
    ) -> Iterator[tuple[list[int], list[bytes]]]:
        """The times and payloads of a topic's messages, some at a time; empty where damaged or too large."""
        convert = ros2_types().ros1_to_cdr
        times, payloads, size, count = list[int](), list[bytes](), 0, 0
        places = heapq.merge(*(reader.indexes[item.id] for item in connections))
        try:
            for place, (_, time, payload) in zip(places, reader.messages(connections), strict=False):
                length = len(payload)
                beside = reader.current_chunk[1].tell() - place.offset - length
                if beside > _HEADER:
                    self._budget.charge(beside, (beside - _HEADER) // _FIELD)
                content = b''
                if length <= LARGEST_MESSAGE:
                    with suppress(Exception):  # rosbags raises whatever the bytes lead to
                        content = bytes(convert(payload, topic.msgtype))
                times.append(time)
                payloads.append(content)
                size += length
                if len(times) == PORTION:
                    self._budget.charge(size, PORTION)
                    yield times, payloads
                    times, payloads, size, count = [], [], 0, count + PORTION
        except (ReaderError, AssertionError, ArithmeticError, LookupError, OSError, RuntimeError, ValueError) as error:
            self.warnings.append(f'{self.path.name} is damaged ({error}): messages of {topic.name} may be missing')
        yield times, payloads
        count += len(times)
        expected = sum(item.msgcount for item in connections)
        if count != expected and not self.warnings:
            stated = f'its index states {expected} messages of {topic.name}, read were {count}'
            self.warnings.append(f'{self.path.name}: {stated}')
