"""Writes one MCAP file with every checksum that the format has."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mcap.writer import CompressionType, Writer

from scara_kinetostatic.bags.encoding import Channel
from scara_kinetostatic.bags.metadata import FileInfo, qos_text

_LIBRARY = 'scara_kinetostatic'
_CHUNK_SIZE = 256 * 1024
"""A chunk is closed when it holds so many bytes: what a reader decompresses at a time, and what a kill may cost."""


class McapWriter:
    """Writes messages of given channels into a new file.

    Args:
        path: the file, which must not exist.
        channels: what may be written; a channel's number is its place here, from 0.
        compress: whether to compress chunks with zstd.

    Attributes:
        size: bytes of the messages written so far.

    Raises:
        OSError: the file cannot be written; so do all methods.
    """

    def __init__(self, path: Path, channels: Sequence[Channel], *, compress: bool = False) -> None:
        self._stream = path.open('xb')
        compression = CompressionType.ZSTD if compress else CompressionType.NONE
        self._writer = Writer(self._stream, chunk_size=_CHUNK_SIZE, compression=compression, enable_data_crcs=True)
        self._writer.start('ros2', _LIBRARY)
        self._ids = [self._register(channel) for channel in channels]
        self._counts = [0] * len(channels)
        self.size = 0
        self._start = self._end = 0

    def write(self, channel: int, payload: bytes, log_time: int) -> None:
        """Adds a message.

        Args:
            channel: its number.
            payload: the serialized message.
            log_time: when it was recorded, ns.
        """
        first = not any(self._counts)
        self._writer.add_message(self._ids[channel], log_time, payload, log_time, self._counts[channel])
        self._counts[channel] += 1
        self.size += len(payload)
        self._start = log_time if first else min(self._start, log_time)
        self._end = log_time if first else max(self._end, log_time)

    def finish(self, name: str) -> FileInfo:
        """Completes the file and closes it once it is on the disk (fsync).

        Args:
            name: the file's final name.

        Returns:
            What the file holds, as the metadata of a recording lists it.
        """
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()
        return FileInfo(name, self._start, self._end, tuple(self._counts))

    def discard(self) -> None:
        """Closes the file as it is, incomplete."""
        try:
            self._stream.close()
        except OSError:  # the buffered rest cannot be written either
            self._stream.raw.close()

    def _register(self, channel: Channel) -> int:
        schema = self._writer.register_schema(channel.msgtype, 'ros2msg', channel.definition.encode())
        metadata = {'offered_qos_profiles': qos_text(channel.qos), 'topic_type_hash': channel.digest}
        return self._writer.register_channel(channel.topic, 'cdr', schema, metadata)
