"""CSV as spreadsheets save it: text of a file, rows with their line numbers, numbers with a decimal comma.

The heading is the first line that is neither empty nor a comment (`#`). Separators are comma, semicolon or tab; with
the latter two, numbers may have a decimal comma. An invalid row is an error that names its
line: nothing is dropped silently. Empty rows are skipped.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.errors import RecordingError

MAX_BYTES = 64 * 2**20
"""Larger files are refused."""
_SHOWN = 5
"""So many further bad rows are named."""
_NUMBER = re.compile(r'[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?\Z')


class CsvRows(NamedTuple):
    """The rows of a table.

    Attributes:
        heading: cells of the first row.
        body: the other rows with something in them, each with its line number.
        decimal_comma: whether numbers may have one.
    """

    heading: list[str]
    body: list[tuple[int, list[str]]]
    decimal_comma: bool


def read_csv_text(path: Path) -> str:
    """The text of a CSV file: UTF-8, UTF-16 with its mark, or Latin-1.

    Raises:
        RecordingError: the file cannot be read, is too large, or is no text.
    """
    try:
        if not path.exists():
            raise RecordingError(path, 'there is no such file', 'check the path')
        if not path.is_file():
            raise RecordingError(path, 'expected a CSV file, got ' + ('a folder' if path.is_dir() else 'no file'))
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise RecordingError(path, f'expected at most {MAX_BYTES // 2**20} MiB of CSV, got {size} bytes')
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(path, f'cannot be read: {error.strerror or error}', 'check the file') from error
    except ValueError as error:  # a path with a null character
        raise RecordingError(repr(str(path)), f'cannot be read: {error}', 'check the path') from error
    return _decoded(data, path)


def _decoded(data: bytes, path: Path) -> str:
    if data[:2] == b'PK' or data[:4] == b'\xd0\xcf\x11\xe0':
        raise RecordingError(path, 'expected CSV, got a spreadsheet', 'save it as CSV')
    utf16 = data[:2] in (b'\xff\xfe', b'\xfe\xff')
    if b'\x00' in data and not utf16:
        raise RecordingError(path, 'expected CSV text, got binary data', 'save the table as CSV')
    try:
        return data.decode('utf-16' if utf16 else 'utf-8-sig')
    except UnicodeDecodeError as error:
        if utf16:
            raise RecordingError(path, 'not UTF-16 text as it begins', 'save it as CSV UTF-8') from error
        return data.decode('latin-1')  # old spreadsheets; µ is the only letter that matters


def split_rows(text: str, where: str, example: str) -> CsvRows:
    """The rows of a text.

    Args:
        text: of the table.
        where: its file, for messages.
        example: of a heading, for messages.

    Raises:
        RecordingError: there is no heading, no row below it, or a quote is not closed.
    """
    lines = text.splitlines()
    first = next((k for k, line in enumerate(lines) if line.strip(' \t,;') and not line.startswith('#')), len(lines))
    heading = lines[first] if first < len(lines) else ''
    separator = next((sign for sign in ';\t' if sign in heading), ',')
    reader = csv.reader(io.StringIO('\n'.join(lines[first:])), delimiter=separator, strict=True)
    try:
        rows = list(_numbered(reader, first))
    except csv.Error as error:
        line = first + reader.line_num
        raise RecordingError(where, f'line {line}: not CSV: {error}', 'check the quotes') from error
    if not rows:
        raise RecordingError(where, 'the file is empty', f'begin with a line such as {example}')
    body = [(line, cells) for line, cells in rows[1:] if any(cell.strip() for cell in cells)]
    if any(_NUMBER.match(plain(cell)) for cell in rows[0][1]):
        problem = 'expected a heading in the first line, got numbers'
        raise RecordingError(where, problem, f'begin with a line such as {example}')
    if not body:
        raise RecordingError(where, 'there are no rows below the heading', 'give one row for each measurement')
    return CsvRows(rows[0][1], body, separator != ',')


def _numbered(reader: Iterator[list[str]], first: int) -> Iterator[tuple[int, list[str]]]:
    for cells in reader:
        line = first + int(reader.line_num)  # type: ignore[attr-defined]
        if cells and not cells[0].lstrip().startswith('#'):
            yield line, cells


def plain(cell: str) -> str:
    """A cell without what spreadsheets put around a number."""
    return cell.strip().replace('\N{MINUS SIGN}', '-').replace('\N{NO-BREAK SPACE}', '').strip()


def number_text(cell: str) -> str:
    """The number of a cell that `read_number` accepts, with a decimal point."""
    return plain(cell).replace(',', '.')


def read_number(cell: str, decimal_comma: bool) -> float:
    """The number in a cell; infinite where it is too large for a float.

    Raises:
        ValueError: it holds none; the message says what was expected.
    """
    text = plain(cell)
    if decimal_comma and text.count(',') == 1 and '.' not in text:
        text = text.replace(',', '.')
    if not text:
        raise ValueError('expected a number, got nothing')
    if not _NUMBER.match(text):
        raise ValueError(f'expected a number, got {cell.strip()[:40]!r}')
    return float(text)


def too_many_cells(cells: Sequence[str], width: int, decimal_comma: bool) -> str:
    """What is wrong with a row that is longer than the heading; empty if nothing is."""
    if not any(cell.strip() for cell in cells[width:]):
        return ''
    hint = '' if decimal_comma else ' (a decimal comma needs semicolons between the columns)'
    return f'expected {width} columns, got {len(cells)}{hint}'


def raise_wrong_rows(where: str, wrong: Sequence[tuple[int, str]]) -> None:
    """Refuse a table with wrong rows, given by line and problem; nothing happens without any.

    Raises:
        RecordingError: names the first line and its problem, and further lines.
    """
    if not wrong:
        return
    (line, problem), *others = wrong
    more = [str(number) for number, _ in others]
    also = f'; also wrong: line{"s" * (len(more) > 1)} {", ".join(more[:_SHOWN])}' if more else ''
    also += f' and {len(more) - _SHOWN} more' if len(more) > _SHOWN else ''
    raise RecordingError(
        where, f'line {line}: {problem}{also}', 'correct the table, or begin the line with # to leave it out'
    )
