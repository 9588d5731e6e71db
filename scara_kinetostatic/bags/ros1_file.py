"""A `.bag` file of ROS 1, format 2.0, read from its start; `rosbags` converts its messages to those of ROS 2.

A bag is a sequence of records: a header of fields, `name=value`, and data; both, and each field, follow their length.
Messages are inside of chunks, which may be compressed. Without checksums, damage shows where a record is no record,
and by the numbers of chunks and messages, which the bag states. What is read once is charged once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from io import BytesIO
from typing import IO

from scara_kinetostatic.bags.decoding import LARGEST_MESSAGE, Batch, Batches, Storage, Topic, ros2_types, unpack
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.touches.clock import SECOND

_MESSAGE, _BAG, _INDEX, _CHUNK, _CONNECTION = b'\2', b'\3', b'\4', b'\5', b'\7'
"""Kinds of records, field `op`."""
_MAGIC = b'#ROSBAG V2.0\n'
_HEADER = 64
"""Bytes of a header that cost a record."""
_DAMAGE = (LookupError, OSError, RuntimeError, ValueError)
_Fields = dict[bytes, bytes]


class Ros1File(Storage):
    """A bag, plain or compressed chunk by chunk."""

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, chunk by chunk."""
        stated, chunks = 0, 0
        expected, read = Counter[bytes](), Counter[str]()
        with self.path.open('rb') as stream:
            if stream.read(len(_MAGIC)) != _MAGIC:
                raise RecordingError(self.path, 'expected a bag of version 2.0', 'convert it by `rosbag fix`')
            try:
                for fields, data in self._records(stream, self.path.stat().st_size):
                    if fields[b'op'] == _BAG:
                        stated = _number(fields[b'chunk_count'])
                    elif fields[b'op'] == _INDEX:
                        expected[fields[b'conn']] += _number(fields[b'count'])
                    elif fields[b'op'] == _CONNECTION:
                        self._connection(fields, data)
                    elif fields[b'op'] == _CHUNK:
                        chunks += 1
                        for batch in self._chunk(fields, data, wanted):
                            read[batch.topic.name] += len(batch.start)
                            yield batch
            except _DAMAGE as error:
                self.warnings.append(f'{self.path.name} is damaged ({error}): read up to there')
        if self.warnings:
            return
        if chunks != stated:
            self.warnings.append(f'{self.path.name} states {stated} chunks, read were {chunks}: it was not closed')
        self._compare(expected, read, wanted)

    def _records(self, stream: IO[bytes], most: int) -> Iterator[tuple[_Fields, bytes]]:
        """Fields and data of each record up to the end; no part is longer than `most`."""
        while start := stream.read(4):
            header = _part(start, stream, most)
            yield self._fields(header), _part(stream.read(4), stream, most)

    def _fields(self, header: bytes) -> _Fields:
        self._budget.charge(0, 1 + len(header) // _HEADER)
        found, at = _Fields(), 0
        while at < len(header):
            end = at + 4 + _number(header[at : at + 4])
            name, equals, found[name] = header[at + 4 : end].partition(b'=')
            if not equals or end > len(header):
                raise ValueError('a header that is none')
            at = end
        return found

    def _connection(self, fields: _Fields, data: bytes) -> None:
        name, kind = fields[b'topic'], self._fields(data)[b'type']
        topic = Topic.of(name.decode('utf-8', 'replace'), kind.decode('utf-8', 'replace'), 'cdr')
        if self._topics.setdefault(fields[b'conn'], topic) != topic:
            raise ValueError('two topics of one number')

    def _chunk(self, fields: _Fields, data: bytes, wanted: Collection[str]) -> Iterator[Batch]:
        found: dict[Topic, tuple[list[int], list[bytes]]] = {}
        try:
            plain = data if fields[b'compression'] == b'none' else unpack(data, self._budget.largest_piece)
            self._budget.charge(len(plain))
            for head, payload in self._records(BytesIO(plain), len(plain)):
                if head[b'op'] == _CONNECTION:
                    self._connection(head, payload)
                elif head[b'op'] == _MESSAGE and self._topics[head[b'conn']].name in wanted:
                    topic = self._topics[head[b'conn']]
                    times, payloads = found.setdefault(topic, ([], []))
                    times.append(_number(head[b'time'][:4]) * SECOND + _number(head[b'time'][4:]))
                    payloads.append(_converted(payload, topic.msgtype))
                    self._budget.charge(len(payload))
        except _DAMAGE as error:
            self.warnings.append(f'{self.path.name}: a chunk is damaged ({error}): messages may be missing')
        for topic, messages in found.items():
            yield Batch.from_payloads(topic, *messages)


def _number(data: bytes) -> int:
    return int.from_bytes(data, 'little')


def _part(size: bytes, stream: IO[bytes], most: int) -> bytes:
    """The bytes that follow their number."""
    length = _number(size)
    content = stream.read(length) if len(size) == 4 and length <= most else b''
    if len(size) < 4 or len(content) < length:
        raise ValueError('it ends early')
    return content


def _converted(payload: bytes, msgtype: str) -> bytes:
    """A message of ROS 2; empty where it is damaged or too large."""
    if len(payload) <= LARGEST_MESSAGE:
        with suppress(Exception):  # rosbags raises whatever the bytes lead to
            return bytes(ros2_types().ros1_to_cdr(payload, msgtype))
    return b''
