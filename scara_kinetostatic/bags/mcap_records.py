"""The records of MCAP, many at a time: where the messages in a chunk are, without an object for each."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from scara_kinetostatic.bags.messages import BATCH, Batch, Topic

SCHEMA, CHANNEL, MESSAGE, CHUNK = 3, 4, 5, 6
RECORD = struct.Struct('<BQ')
"""How every record begins: opcode and length."""
_RECORD_AND_ID = struct.Struct('<BQH')
_HEAD = 9 + 22
"""What stands before the payload of a message: opcode, length; channel, sequence, two times."""


class Walked(NamedTuple):
    """What a chunk consists of.

    Attributes:
        messages: where the messages of each channel start.
        definitions: opcode and content of the schemas and channels.
        whole: whether it consists of records to its end.
    """

    messages: dict[int, list[int]]
    definitions: list[tuple[int, bytes]]
    whole: bool


def walk(data: bytes) -> Walked:
    """Goes through the bytes of a chunk, from record to record."""
    places: dict[int, list[int]] = {}
    definitions: list[tuple[int, bytes]] = []
    whole = True
    unpack, size = _RECORD_AND_ID.unpack_from, len(data)
    at = 0
    while at + 11 <= size:
        opcode, length, key = unpack(data, at)
        end = at + 9 + length
        if end > size:
            break
        if opcode == MESSAGE and length >= 22:
            if key in places:
                places[key].append(at)
            else:
                places[key] = [at]
        elif opcode in (SCHEMA, CHANNEL):
            definitions.append((opcode, data[at + 9 : end]))
        else:
            whole &= opcode != MESSAGE
        at = end
    return Walked(places, definitions, whole and at == size)


def batch_of(topic: Topic, data: bytes, starts: list[int]) -> Batch:
    """The messages of a chunk that start at these places."""
    buffer = np.frombuffer(data, np.uint8)
    at = np.sort(np.array(starts, dtype=np.int64))
    return Batch(topic, _field(buffer, at + 15), buffer, at + _HEAD, _field(buffer, at + 1) - 22)


class Loose:
    """Gathers messages that lie outside chunks into batches."""

    def __init__(self) -> None:
        self._pending: dict[Topic, tuple[list[int], list[bytes]]] = {}

    def add(self, topic: Topic, time: int, payload: bytes) -> Iterator[Batch]:
        """Takes in a message; gives a batch whenever one is full."""
        times, payloads = self._pending.setdefault(topic, ([], []))
        times.append(time)
        payloads.append(payload)
        if len(times) == BATCH:
            yield Batch.from_payloads(topic, times, payloads)
            del self._pending[topic]

    def rest(self) -> Iterator[Batch]:
        """The batches that are not full."""
        for topic, (times, payloads) in self._pending.items():
            yield Batch.from_payloads(topic, times, payloads)
        self._pending.clear()


def _field(buffer: NDArray[np.uint8], at: NDArray[np.int64]) -> NDArray[np.int64]:
    """The 8-byte number at each of several places."""
    return sliding_window_view(buffer, 8)[at].view('<i8')[:, 0].astype(np.int64)
