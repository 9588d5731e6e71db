"""Decompression that never gives back more than it was told to expect, and what there is of a cut-off input."""

from __future__ import annotations

import lz4.frame  # type: ignore[import-untyped]
import zstandard

from scara_kinetostatic.recording.raw import Batch

ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'
LARGEST_CHUNK = 1 << 30
LARGEST_MESSAGE = 1 << 24


def inflate(data: bytes, compression: str, size: int) -> bytes:
    """Decompress one portion.

    Args:
        data: compressed bytes, possibly cut off.
        compression: `zstd`, `lz4`, or empty for none.
        size: how many bytes to give back at most.

    Returns:
        The first `size` bytes, fewer where the input ends early.

    Raises:
        ValueError: the compression is unknown, or the size beyond belief.
    """
    if size > LARGEST_CHUNK:
        raise ValueError(f'a chunk claims to hold {size} bytes')
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


def inflate_messages(batch: Batch) -> Batch:
    """The same messages, decompressed where each was compressed on its own (rosbag2's compression mode `message`).

    No message starts like a zstd frame, so none is taken for one by mistake.
    """
    if len(batch.start) == 0 or batch.payload(0)[:4] != ZSTD_MAGIC:
        return batch
    return Batch.from_payloads(batch.topic, batch.log_time.tolist(), [_message(data) for data in batch.payloads()])


def _message(data: bytes) -> bytes:
    try:
        return inflate(data, 'zstd', LARGEST_MESSAGE)
    except zstandard.ZstdError:
        return b''
