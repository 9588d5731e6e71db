"""One MCAP file in the making."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from mcap.writer import CompressionType, Writer

from scara_kinetostatic.bags.encoding import Channel
from scara_kinetostatic.bags.mcap_checksum import seal
from scara_kinetostatic.bags.metadata import Piece, qos_text

LIBRARY = 'scara_kinetostatic'
CHUNK_SIZE = 256 * 1024


class McapPiece:
    """Writes messages of given channels into a new file, channel numbers counted from 0.

    Args:
        path: the file, which must not exist.
        channels: what may be written.
        compress: whether to compress chunks with zstd.

    Raises:
        OSError: the file cannot be written, here and in every method.
    """

    def __init__(self, path: Path, channels: Sequence[Channel], *, compress: bool = False) -> None:
        self._stream = path.open('x+b')
        compression = CompressionType.ZSTD if compress else CompressionType.NONE
        self._writer = Writer(self._stream, chunk_size=CHUNK_SIZE, compression=compression)
        self._writer.start('ros2', LIBRARY)
        self._ids = [self._register(channel) for channel in channels]
        self._counts = [0] * len(channels)
        self._start = self._end = 0

    def write(self, channel: int, payload: bytes, log_time: int) -> None:
        """Add a message."""
        first = not any(self._counts)
        self._writer.add_message(self._ids[channel], log_time, payload, log_time, self._counts[channel])
        self._counts[channel] += 1
        self._start = log_time if first else min(self._start, log_time)
        self._end = log_time if first else max(self._end, log_time)

    def finish(self, name: str) -> Piece:
        """Complete the file and see it to the disk.

        Args:
            name: the file's final name.

        Returns:
            What it holds.
        """
        self._writer.finish()  # type: ignore[no-untyped-call]
        seal(self._stream)
        to_disk(self._stream)
        self._stream.close()
        return Piece(name, self._start, self._end, tuple(self._counts))

    def discard(self) -> None:
        """Let go of the file as it is."""
        try:
            self._stream.close()
        except OSError:  # what the buffer still held cannot be written, either
            self._stream.raw.close()

    def _register(self, channel: Channel) -> int:
        schema = self._writer.register_schema(channel.msgtype, 'ros2msg', channel.definition.encode())
        metadata = {'offered_qos_profiles': qos_text(channel.qos), 'topic_type_hash': channel.digest}
        return self._writer.register_channel(channel.topic, 'cdr', schema, metadata)


def to_disk(stream: IO[bytes]) -> None:
    """See everything written so far to the disk."""
    stream.flush()
    os.fsync(stream.fileno())
