"""Decompression with a limit on the output, which also works for input that is cut off."""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from scara_kinetostatic.bags.messages import Batch

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
_LARGEST_CHUNK = 1 << 28
"""Larger chunks are refused, bytes."""
LARGEST_MESSAGE = 1 << 20
"""A joint state, wrench or cell description is smaller than this, bytes; larger messages are refused."""
_PORTION = 1 << 25
"""So many bytes of decompressed messages are held at a time."""
LEAST_ALLOWED, _LARGEST_RATIO = 1 << 28, 200
"""A file that is decompressed as a whole may grow to so many bytes, or to so many times its size."""


def decompress(data: bytes, compression: str, size: int) -> bytes:
    """Decompress one portion.

    Args:
        data: compressed bytes, possibly cut off.
        compression: `zstd`, `lz4`, or empty for none.
        size: how many bytes to give back at most.

    Returns:
        The first `size` bytes, fewer where the input ends early.

    Raises:
        ValueError: the compression is unknown, or the size exceeds `_LARGEST_CHUNK`.
    """
    if size > _LARGEST_CHUNK:
        raise ValueError(f'a chunk of {size} bytes, expected at most {_LARGEST_CHUNK}')
    if compression in ('', 'none'):
        return data[:size]
    if compression == 'zstd':
        with zstandard.ZstdDecompressor().stream_reader(data, read_across_frames=True) as reader:
            return _drain(reader, size)
    if compression == 'lz4':
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))
    raise ValueError(f'unknown compression {compression!r}')


def _drain(reader: zstandard.ZstdDecompressionReader, size: int) -> bytes:
    parts: list[bytes] = []
    try:
        while size > 0 and (part := reader.read(min(size, 1 << 20))):
            parts.append(part)
            size -= len(part)
    except zstandard.ZstdError:
        if not parts:
            raise
    return b''.join(parts)


def decompress_messages(batch: Batch) -> Iterator[Batch]:
    """The same messages in portions, decompressed where each was compressed on its own (rosbag2's compression mode
    `message`).

    A message that is not compressed never starts with the magic number of a zstd frame.
    """
    if len(batch.start) == 0 or batch.payload(0)[:4] != ZSTD_MAGIC:
        yield batch
        return
    times, payloads, size = batch.log_time.tolist(), [], 0
    for index in range(len(times)):
        payloads.append(_message(batch.payload(index)))
        size += len(payloads[-1])
        if size > _PORTION or index == len(times) - 1:
            yield Batch.from_payloads(batch.topic, times[index + 1 - len(payloads) : index + 1], payloads)
            payloads, size = [], 0


def _message(data: bytes) -> bytes:
    try:
        message = decompress(data, 'zstd', LARGEST_MESSAGE + 1)
    except zstandard.ZstdError:
        return b''
    return message if len(message) <= LARGEST_MESSAGE else b''


def unpack(packed: IO[bytes], plain: IO[bytes], compressed: int) -> None:
    """Decompress a whole file.

    Args:
        packed: gives the decompressed bytes.
        plain: where they go.
        compressed: size of the compressed file.

    Raises:
        ValueError: it grows beyond the limit; nothing beyond that is written.
    """
    left = limit = max(LEAST_ALLOWED, _LARGEST_RATIO * compressed)
    while part := packed.read(1 << 20):
        left -= len(part)
        if left < 0:
            raise ValueError(f'it exceeds {limit} bytes when decompressed')
        plain.write(part)
