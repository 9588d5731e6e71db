"""Readings from a CSV file, such as a spreadsheet saves, checked row by row.

The first line that is neither empty nor a comment (`#`) names the columns, each with its unit:

    force_N,displacement_mm,direction_deg,cycle          also: force [N];displacement [mm]

Separators are comma, semicolon or tab; with the latter two, numbers may have a decimal comma. An invalid row is an
error that names its line: nothing is dropped silently. Empty rows are skipped.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, LINK, TIP, DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.table_columns import (
    CHOICES,
    NEEDED,
    Column,
    read_choice,
    read_cycle,
    read_heading,
    read_number,
)

_MAX_BYTES = 64 * 2**20
_SHOWN = 5
"""Number of further invalid rows that a message names."""


class TableDefaults(NamedTuple):
    """Values for missing columns and empty cells: part, lever in m, direction in rad, place of the gauge."""

    part: str = GRIPPER
    lever: float = math.nan
    direction: float = math.nan
    gauge_at: str | None = None


def load_readings(path: str | Path, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """Reads a table of readings.

    Args:
        path: the file.
        defaults: values where a column is missing, or a cell of an optional one is empty.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    return parse_readings(_text(Path(path)), str(path), defaults)


def parse_readings(text: str, where: str, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """The readings in a text.

    Args:
        text: of the table.
        where: its file, for messages.
        defaults: see `load_readings`.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    separator, rows = _rows(text, where)
    if not rows:
        raise RecordingError(where, 'the file is empty', 'begin with a line such as force_N,displacement_mm')
    (_, heading), *body = rows
    columns, unknown = read_heading(heading, where)
    body = [(line, cells) for line, cells in body if any(cell.strip() for cell in cells)]
    if not body:
        raise RecordingError(where, 'there are no rows below the heading', 'give a force and a displacement per row')
    values = _values(body, columns, len(heading), separator != ',', where)
    notes = [f'{where}: the column {name!r} is unknown and not used' for name in unknown]
    return _readings(values, [line for line, _ in body], where, defaults, notes)


def dump_readings(readings: DialGaugeReadings) -> str:
    """The readings as a table that `parse_readings` reads; columns without any value are left out."""
    names = {
        'force_N': readings.force,
        'displacement_um': 1e6 * readings.displacement,
        'direction_deg': np.degrees(readings.direction),
        'lever_m': readings.lever,
        'time_s': readings.time,
    }
    table = {
        name: [f'{value:.9g}' if np.isfinite(value) else '' for value in values.tolist()]
        for name, values in names.items()
        if np.any(np.isfinite(values))
    }
    if np.any(readings.cycle >= 0):
        table['cycle'] = ['' if number < 0 else str(number) for number in readings.cycle.tolist()]
    table['part'], table['gauge_at'] = readings.part.tolist(), readings.gauge_at.tolist()
    lines = [','.join(table), *(','.join(row) for row in zip(*table.values(), strict=True))]
    return '\n'.join(lines) + '\n'


def _text(path: Path) -> str:
    try:
        if not path.exists():
            raise RecordingError(path, 'there is no such file', 'check the path')
        if not path.is_file():
            raise RecordingError(path, 'expected a CSV file, got ' + ('a folder' if path.is_dir() else 'no file'))
        size = path.stat().st_size
        if size > _MAX_BYTES:
            raise RecordingError(path, f'expected at most {_MAX_BYTES // 2**20} MiB of CSV, got {size} bytes')
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
        return data.decode('latin-1')  # old spreadsheets; µ is the only letter beyond ASCII that is needed


def _rows(text: str, where: str) -> tuple[str, list[tuple[int, list[str]]]]:
    """The separator, and the rows from the heading on, each with its line number."""
    lines = text.splitlines()
    first = next((k for k, line in enumerate(lines) if line.strip(' \t,;') and not line.startswith('#')), len(lines))
    heading = lines[first] if first < len(lines) else ''
    separator = next((sign for sign in ';\t' if sign in heading), ',')
    reader = csv.reader(io.StringIO('\n'.join(lines[first:])), delimiter=separator, strict=True)
    try:
        return separator, list(_numbered(reader, first))
    except csv.Error as error:
        line = first + reader.line_num
        raise RecordingError(where, f'line {line}: not CSV: {error}', 'check the quotes') from error


def _numbered(reader: Iterator[list[str]], first: int) -> Iterator[tuple[int, list[str]]]:
    for cells in reader:
        line = first + int(reader.line_num)  # type: ignore[attr-defined]
        if cells and not cells[0].lstrip().startswith('#'):
            yield line, cells


def _values(
    body: Sequence[tuple[int, list[str]]], columns: dict[str, Column], width: int, decimal_comma: bool, where: str
) -> dict[str, list[float | int | str | None]]:
    """The values by column, None where an optional cell is empty.

    Raises:
        RecordingError: a row is wrong; it names the line and the column, and the lines of others.
    """
    values: dict[str, list[float | int | str | None]] = {name: [] for name in columns}
    wrong: list[tuple[int, str]] = []
    for line, cells in body:
        if len(cells) > width and any(cell.strip() for cell in cells[width:]):
            hint = '' if decimal_comma else ' (a decimal comma needs semicolons between the columns)'
            wrong.append((line, f'expected {width} columns, got {len(cells)}{hint}'))
            continue
        for name, column in columns.items():
            try:
                cell = cells[column.place] if column.place < len(cells) else ''
                values[name].append(_value(cell, column, decimal_comma))
            except ValueError as error:
                wrong.append((line, f'{column.heading}: {error}'))
                break
    if wrong:
        (line, problem), *others = wrong
        more = [str(number) for number, _ in others]
        also = f'; also wrong: line{"s" * (len(more) > 1)} {", ".join(more[:_SHOWN])}' if more else ''
        also += f' and {len(more) - _SHOWN} more' if len(more) > _SHOWN else ''
        raise RecordingError(
            where, f'line {line}: {problem}{also}', 'correct the table, or begin the line with # to leave it out'
        )
    return values


def _value(cell: str, column: Column, decimal_comma: bool) -> float | int | str | None:
    if not cell.strip() and column.name not in NEEDED:
        return None
    if column.name in CHOICES:
        return read_choice(cell, column)
    return read_cycle(cell) if column.name == 'cycle' else read_number(cell, column, decimal_comma)


def _readings(
    values: dict[str, list[float | int | str | None]],
    lines: list[int],
    where: str,
    defaults: TableDefaults,
    notes: list[str],
) -> DialGaugeReadings:
    count = len(lines)

    def column(name: str, instead: float | int | str) -> list[float | int | str]:
        return [instead if value is None else value for value in values.get(name, [None] * count)]

    parts = column('part', defaults.part)
    gauge_places = [
        str(value if value is not None else defaults.gauge_at or (TIP if part == GRIPPER else LINK))
        for value, part in zip(values.get('gauge_at', [None] * count), parts, strict=True)
    ]
    return DialGaugeReadings(
        force=np.array(values['force'], dtype=float),
        displacement=np.array(values['displacement'], dtype=float),
        part=np.array(parts, dtype=np.str_),
        gauge_at=np.array(gauge_places, dtype=np.str_),
        direction=np.array(column('direction', defaults.direction), dtype=float),
        lever=np.array(column('lever', defaults.lever), dtype=float),
        cycle=np.array(column('cycle', -1), dtype=np.int64),
        time=np.array(column('time', math.nan), dtype=float),
        source=np.zeros(count, dtype=np.int64),
        line=np.array(lines, dtype=np.int64),
        sources=(where,),
        notes=tuple(notes),
    )
