"""Several MCAP files of one recording to one, chunk by chunk as they are.

The data sections are copied one after another behind the header of the first file; only the index at the end is made
anew, with the places of the chunks shifted. All files must have the same channels under the same numbers, as those of
one `BagWriter` have, and an intact index.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import IO, NamedTuple

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import ChunkIndex, DataEnd, Footer, McapRecord, Statistics, SummaryOffset
from mcap.summary import Summary

from scara_kinetostatic.bags.mcap_records import MAGIC, RECORD

_PORTION = 1 << 22
"""Copied at once, bytes: large enough that other threads run meanwhile."""
_DATA_END = 13
"""Length of the record that ends the data section, bytes."""


class MergeCancelledError(Exception):
    """The recording ended before the merge did."""


class _Part(NamedTuple):
    """A file to be copied: its stream, its index, and where its data section begins and ends."""

    stream: IO[bytes]
    summary: Summary
    begin: int
    end: int


def merge_files(paths: Sequence[Path], target: Path, cancelled: Callable[[], bool] = lambda: False) -> None:
    """Writes one file with the contents of several, and waits until it is on the disk.

    Args:
        paths: the files in the order of recording.
        target: the new file, which must not exist; removed again where something goes wrong.
        cancelled: asked between portions.

    Raises:
        MergeCancelledError: `cancelled` said so.
        OSError: a file cannot be read or written.
        ValueError: a file has no index.
    """
    with ExitStack() as stack:
        parts = [_open(stack.enter_context(path.open('rb'))) for path in paths]
        out = stack.enter_context(target.open('xb'))
        try:
            _write(out, parts, cancelled)
            out.flush()
            os.fsync(out.fileno())
        except BaseException:
            target.unlink(missing_ok=True)
            raise


def _open(stream: IO[bytes]) -> _Part:
    summary = SeekingReader(stream).get_summary()
    if summary is None or summary.statistics is None:
        raise ValueError(f'{stream.name}: no index')
    stream.seek(len(MAGIC))
    _, length = RECORD.unpack(stream.read(RECORD.size))
    stream.seek(-(8 + 8 + 4) - len(MAGIC), os.SEEK_END)
    (summary_start,) = struct.unpack('<Q', stream.read(8))
    return _Part(stream, summary, len(MAGIC) + RECORD.size + length, summary_start - _DATA_END)


def _write(out: IO[bytes], parts: Sequence[_Part], cancelled: Callable[[], bool]) -> None:
    checksum, chunks = 0, list[ChunkIndex]()
    for number, part in enumerate(parts):
        begin = part.begin if number else 0
        shift = out.tell() - begin
        for portion in _portions(part.stream, begin, part.end):
            if cancelled():
                raise MergeCancelledError
            checksum = zlib.crc32(portion, checksum)
            out.write(portion)
        chunks += [_shifted(index, shift) for index in part.summary.chunk_indexes]
    out.write(_bytes_of(DataEnd(checksum)))
    _write_summary(out, parts, chunks)


def _portions(stream: IO[bytes], begin: int, end: int) -> Iterator[bytes]:
    stream.seek(begin)
    while begin < end and (portion := stream.read(min(_PORTION, end - begin))):
        begin += len(portion)
        yield portion


def _shifted(index: ChunkIndex, shift: int) -> ChunkIndex:
    offsets = {key: offset + shift for key, offset in index.message_index_offsets.items()}
    return replace(index, chunk_start_offset=index.chunk_start_offset + shift, message_index_offsets=offsets)


def _write_summary(out: IO[bytes], parts: Sequence[_Part], chunks: Sequence[ChunkIndex]) -> None:
    start, summary, offsets = out.tell(), b'', list[SummaryOffset]()
    first = parts[0].summary
    groups: dict[Opcode, Iterable[McapRecord]] = {
        Opcode.SCHEMA: first.schemas.values(),
        Opcode.CHANNEL: first.channels.values(),
        Opcode.STATISTICS: [_added([part.summary for part in parts])],
        Opcode.CHUNK_INDEX: chunks,
    }
    for opcode, records in groups.items():
        group = _bytes_of(*records)
        offsets.append(SummaryOffset(opcode, start + len(summary), len(group)))
        summary += group
    offsets_start = start + len(summary)
    summary += _bytes_of(*offsets)
    head = struct.pack('<BQQQ', Opcode.FOOTER, 8 + 8 + 4, start, offsets_start)
    footer = Footer(start, offsets_start, zlib.crc32(head, zlib.crc32(summary)))
    out.write(summary + _bytes_of(footer) + MAGIC)


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _added(summaries: Sequence[Summary]) -> Statistics:
    """The numbers of messages of all files together."""
    every = [summary.statistics for summary in summaries if summary.statistics is not None]
    filled = [one for one in every if one.message_count]
    counts: Counter[int] = Counter()
    for one in every:
        counts.update(one.channel_message_counts)
    return replace(
        every[0],
        channel_message_counts=dict(counts),
        message_count=sum(one.message_count for one in every),
        chunk_count=sum(one.chunk_count for one in every),
        message_start_time=min((one.message_start_time for one in filled), default=0),
        message_end_time=max((one.message_end_time for one in filled), default=0),
    )
