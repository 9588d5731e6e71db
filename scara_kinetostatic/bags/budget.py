"""What reading a recording may cost: bytes and records, over all its files and layers of compression.

A few kilobytes can unpack to gigabytes, and an index can name the same bytes as a million messages. Every reader
charges what it unpacks and what it takes apart to one `Budget`, in proportion to the size of the recording on disk.
"""

from __future__ import annotations

import bz2
import os
import re
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard

from scara_kinetostatic.errors import RecordingError

MAX_BYTES = 'SCARA_KINETOSTATIC_MAX_BYTES'
"""Environment variable with the limit in bytes; ``--max-bytes`` sets it, for child processes as well."""
_BYTES, _BYTES_RATIO = 1 << 28, 200
"""A recording may unpack to the larger of these, bytes and times its size; the tests' recordings to 7 times."""
_RECORDS, _RECORD_SIZE = 200_000, 4
"""So many records, and one more for so many bytes of the recording; in compressed ones a message has 20 or more."""
_RECORD_BYTES = 64
"""Bytes of ``--max-bytes`` that allow a record."""
_OWN = re.compile(r'\.(mcap|db3|bag)(\.zstd|\.part|-wal|-journal)?\Z')
"""Names of the files of a recording in its folder."""
_STEP = 1 << 22
"""Bytes that are unpacked at a time: the memory is taken before."""
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'


class BudgetError(RecordingError):
    """A recording costs more than its size justifies."""


class Budget:
    """Counts down what is left.

    Args:
        path: the recording, a file or a folder.
    """

    def __init__(self, path: Path) -> None:
        files = [item for item in path.iterdir() if _OWN.search(item.name)] if path.is_dir() else [path]
        stats = [item.stat() for item in files if item.is_file()]
        size = sum(min(item.st_size, 512 * item.st_blocks) for item in stats)  # holes cost nothing
        given = os.environ.get(MAX_BYTES, '')
        if given and not given.isdecimal():
            raise RecordingError(MAX_BYTES, f'expected a number of bytes, got {given!r:.40}')
        self._path = path
        self._limit = self._bytes = max(_BYTES, _BYTES_RATIO * size, int(given or 0))
        self._records_limit = self.records = max(_RECORDS + size // _RECORD_SIZE, int(given or 0) // _RECORD_BYTES)
        # of a chunk when unpacked; recorders write up to 4 MiB, and single images more
        self.largest_piece = max(1 << 26, int(given or 0))

    def charge(self, size: int, records: int = 0) -> None:
        """Charges bytes unpacked or copied, and records taken apart.

        Raises:
            BudgetError: there is no more left.
        """
        self._bytes -= size
        self.records -= records
        if self._bytes < 0 or self.records < 0:
            over = f'{self._limit} bytes' if self._bytes < 0 else f'{self._records_limit} records'
            problem = f'unpacks to more than {over}, implausible for its size'
            enough = 2 * (self._limit if self._bytes < 0 else _RECORD_BYTES * self._records_limit)
            raise BudgetError(self._path, problem, f'if you trust it, raise the limit, by --max-bytes {enough} or more')

    def check_piece(self, size: int) -> None:
        """Check the size of a chunk.

        Raises:
            ValueError: it is too large.
        """
        if size > self.largest_piece:
            raise ValueError(f'a chunk of {size} bytes, expected at most {self.largest_piece}; see --max-bytes')


def unpack(data: bytes, most: int) -> bytes:
    """The content of compressed bytes, whose first ones tell the format: zstd, LZ4 or bzip2.

    Raises:
        ValueError: they unpack to more than `most` bytes, beyond which little is made, or end early.
        OSError, RuntimeError, zstandard.ZstdError: they are damaged.
    """
    if data.startswith(ZSTD_MAGIC):
        with zstandard.ZstdDecompressor().stream_reader(data) as reader:
            content = reader.read(most + 1)
    else:
        decoder: Any = bz2.BZ2Decompressor() if data.startswith(b'BZh') else lz4.frame.LZ4FrameDecompressor()
        content = decoder.decompress(data, min(most + 1, _STEP))
        while not (decoder.eof or decoder.needs_input) and len(content) <= most:
            content += decoder.decompress(b'', _STEP)
        if len(content) <= most and not decoder.eof:
            raise ValueError('its compressed bytes end early')
    if len(content) > most:
        raise ValueError(f'it unpacks to more than {most} bytes, as stated or as --max-bytes allows')
    return bytes(content)
