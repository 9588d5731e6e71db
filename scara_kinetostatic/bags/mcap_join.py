"""Joins MCAP files into one without decoding them: chunks are copied as they are, the index is written anew."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import ChunkIndex, DataEnd, Footer, Header, McapRecord, Statistics, SummaryOffset
from mcap.summary import Summary

from scara_kinetostatic.bags.mcap_checksum import MAGIC, seal
from scara_kinetostatic.bags.mcap_writer import LIBRARY, to_disk


def join(sources: Sequence[Path], target: Path) -> None:
    """Join files that `McapPiece` wrote with the same channels.

    Args:
        sources: the files, in the order of recording.
        target: the new file, which must not exist.

    Raises:
        OSError: a file cannot be read or written.
    """
    with target.open('x+b') as stream:
        stream.write(MAGIC + _bytes([Header('ros2', LIBRARY)]))
        indexes: list[ChunkIndex] = []
        summaries: list[Summary] = []
        for source in sources:
            with source.open('rb') as piece:
                summary = SeekingReader(piece).get_summary()
                if summary is None:
                    raise OSError(f'{source.name} has no index')
                summaries.append(summary)
                indexes += [_copy_chunk(piece, index, stream) for index in summary.chunk_indexes]
        stream.write(_bytes([DataEnd(0)]))
        stream.write(_ending(stream.tell(), summaries, indexes))
        seal(stream)
        to_disk(stream)


def _copy_chunk(source: IO[bytes], index: ChunkIndex, target: IO[bytes]) -> ChunkIndex:
    """Copy a chunk with its message index; its place in the target."""
    shift = target.tell() - index.chunk_start_offset
    source.seek(index.chunk_start_offset)
    target.write(source.read(index.chunk_length + index.message_index_length))
    return ChunkIndex(
        chunk_length=index.chunk_length,
        chunk_start_offset=index.chunk_start_offset + shift,
        compression=index.compression,
        compressed_size=index.compressed_size,
        message_end_time=index.message_end_time,
        message_index_length=index.message_index_length,
        message_index_offsets={key: offset + shift for key, offset in index.message_index_offsets.items()},
        message_start_time=index.message_start_time,
        uncompressed_size=index.uncompressed_size,
    )


def _ending(start: int, summaries: Sequence[Summary], indexes: Sequence[ChunkIndex]) -> bytes:
    """Summary, footer and closing magic, to stand at the given place."""
    first = summaries[0]
    groups: list[tuple[Opcode, list[McapRecord]]] = [
        (Opcode.SCHEMA, list(first.schemas.values())),
        (Opcode.CHANNEL, list(first.channels.values())),
        (Opcode.STATISTICS, [_statistics([item.statistics for item in summaries if item.statistics], len(indexes))]),
        (Opcode.CHUNK_INDEX, list(indexes)),
    ]
    body, offsets = b'', []
    for opcode, records in groups:
        content = _bytes(records)
        offsets.append(SummaryOffset(group_opcode=opcode, group_start=start + len(body), group_length=len(content)))
        body += content
    offsets_start = start + len(body)
    body += _bytes(offsets)
    footer = _bytes([Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=0)])
    crc = zlib.crc32(body + footer[:-4])
    return body + footer[:-4] + crc.to_bytes(4, 'little') + MAGIC


def _statistics(parts: Sequence[Statistics], chunks: int) -> Statistics:
    filled = [part for part in parts if part.message_count]
    keys = sorted({key for part in parts for key in part.channel_message_counts})
    return Statistics(
        attachment_count=0,
        channel_count=parts[0].channel_count,
        channel_message_counts={key: sum(part.channel_message_counts.get(key, 0) for part in parts) for key in keys},
        chunk_count=chunks,
        message_count=sum(part.message_count for part in parts),
        message_end_time=max((part.message_end_time for part in filled), default=0),
        message_start_time=min((part.message_start_time for part in filled), default=0),
        metadata_count=0,
        schema_count=parts[0].schema_count,
    )


def _bytes(records: Sequence[McapRecord]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
