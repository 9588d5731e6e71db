"""The two checksums at the end of an MCAP file: over its data, and over its index.

Each chunk has one of its own. Together they cover every byte of the file, so
that no damage goes unseen; where the writer left one out (a zero in its
place), what it would cover is taken on trust.
"""

from __future__ import annotations

import struct
import zlib
from os import SEEK_END
from typing import IO, Any

from mcap.exceptions import McapError

MAGIC = b'\x89MCAP0\r\n'
"""How an MCAP file begins and ends."""
_FOOTER = struct.Struct('<BQQQI8s')
"""Opcode, length, start of the index (the summary section), start of its offsets, its checksum, magic."""
_UNCHECKED = 4 + 8
"""What of that the checksum does not cover: itself and the magic, bytes."""
_DATA_END = struct.Struct('<BQI')
"""Opcode, length, checksum over all bytes before."""
_FOOT, _ENDS_DATA = 2, 15
_PORTION = 1 << 20


def seal(stream: IO[bytes]) -> None:
    """Enters the checksum over the data of a file that a writer has just finished.

    Args:
        stream: the file, open for reading and writing.

    Raises:
        OSError: it cannot be read or written.
        McapError: it is not finished.
    """
    at = _data_end(stream)
    opcode, length, _ = _read(stream, at, _DATA_END)
    checksum = _checksum(stream, 0, at)
    stream.seek(at)
    stream.write(_DATA_END.pack(opcode, length, checksum))
    stream.seek(0, SEEK_END)


def index_is_whole(stream: IO[bytes]) -> bool:
    """Whether the file ends as it should, and the checksum over its index matches, or there is none.

    Raises:
        OSError: the file cannot be read.
        McapError: it has no end.
    """
    size = stream.seek(0, SEEK_END)
    opcode, _, start, _, expected, magic = _read(stream, size - _FOOTER.size, _FOOTER)
    if (opcode, magic) != (_FOOT, MAGIC):
        return False
    return not (start and expected) or _checksum(stream, start, size - _UNCHECKED) == expected


def data_is_whole(stream: IO[bytes]) -> bool:
    """Whether the checksum over the data matches, or there is none. Reads the whole file.

    Raises:
        OSError: the file cannot be read.
        McapError: it has no end.
    """
    at = _data_end(stream)
    if not at:
        return True
    opcode, _, expected = _read(stream, at, _DATA_END)
    return opcode == _ENDS_DATA and (not expected or _checksum(stream, 0, at) == expected)


def _data_end(stream: IO[bytes]) -> int:
    """Where the record stands that ends the data; 0 where there is no index behind it, by which to find it."""
    size = stream.seek(0, SEEK_END)
    start = int(_read(stream, size - _FOOTER.size, _FOOTER)[2])
    return start - _DATA_END.size if start else 0


def _read(stream: IO[bytes], at: int, record: struct.Struct) -> tuple[Any, ...]:
    if at < 0:
        raise McapError('the file is too short')
    stream.seek(at)
    content = stream.read(record.size)
    if len(content) < record.size:
        raise McapError('a record breaks off')
    return record.unpack(content)


def _checksum(stream: IO[bytes], start: int, end: int) -> int:
    stream.seek(start)
    checksum, left = 0, end - start
    while left > 0 and (portion := stream.read(min(left, _PORTION))):
        checksum = zlib.crc32(portion, checksum)
        left -= len(portion)
    return checksum
