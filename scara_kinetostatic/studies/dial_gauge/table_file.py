"""Readings from a CSV file, such as a spreadsheet saves, checked row by row.

The first line that is neither empty nor a comment (`#`) names the columns, each with its unit:

    force_N,displacement_mm,direction_deg,cycle          also: force [N];displacement [mm]

See `files.columns` for separators, decimal commas, encodings and invalid rows.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.columns import Table, load_table, parse_table, plain, raise_wrong_rows
from scara_kinetostatic.files.columns import read_number as plain_number
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, JOINT1, JOINT2, LINK, TIP, DialGaugeReadings

_LENGTH = {'m': 1.0, 'mm': 1e-3, 'um': 1e-6, 'µm': 1e-6, 'μm': 1e-6}


class Quantity(NamedTuple):
    """A column that holds numbers.

    Attributes:
        names: its names; the first one is used in messages.
        units: factor to SI by unit.
        largest: largest plausible magnitude, SI.
        hint: the likeliest mistake behind a larger one.
    """

    names: tuple[str, ...]
    units: dict[str, float]
    largest: float
    hint: str


QUANTITIES = {
    'force': Quantity(('force', 'load', 'f'), {'N': 1.0, 'kN': 1e3, 'mN': 1e-3}, 1e6, 'check the unit of the column'),
    'displacement': Quantity(
        ('displacement', 'deflection', 'gauge', 'ds', 'δs'), _LENGTH, 0.5, 'check the unit of the column: m, mm or um'
    ),
    'direction': Quantity(
        ('direction', 'angle'), {'deg': math.pi / 180, 'rad': 1.0}, 4 * math.pi + 1e-9, 'give an angle within two turns'
    ),
    'lever': Quantity(('lever', 'arm'), _LENGTH, 10.0, 'check the unit of the column: m or mm'),
    'time': Quantity(('time', 't'), {'s': 1.0, 'ms': 1e-3}, 1e12, 'check the unit of the column: s or ms'),
}
NEEDED = ('force', 'displacement')
CHOICES = {
    'part': {GRIPPER: GRIPPER, 'joint1': JOINT1, 'joint2': JOINT2, '1': JOINT1, '2': JOINT2},
    'gauge_at': {TIP: TIP, LINK: LINK},
}
_SYNONYMS = {'joint': 'part', 'seat': 'gauge_at'}
_WORDS = {word: name for name, quantity in QUANTITIES.items() for word in quantity.names}
_HEADING = re.compile(r'(?P<word>.*?)[\s_]*(?:\[(?P<square>[^\]]*)\]|\((?P<round>[^)]*)\)|[_\s](?P<plain>[^_\s]+))?\Z')


class Column(NamedTuple):
    """One column of a table.

    Attributes:
        name: 'force', 'cycle', 'part', …
        heading: as in the file.
        place: number of the column, from 0.
        factor: to SI.
    """

    name: str
    heading: str
    place: int
    factor: float = 1.0


def read_heading(cells: Sequence[str], where: str) -> tuple[dict[str, Column], list[str]]:
    """The columns by name, and the unknown headings.

    Raises:
        RecordingError: a unit is missing or unknown, a column is missing or given twice, or there is no heading.
    """
    columns: dict[str, Column] = {}
    unknown = []
    for place, cell in enumerate(cells):
        column = _column(cell.strip(), place, where)
        if column is None:
            unknown += [cell.strip()] if cell.strip() else []
            continue
        if column.name in columns:
            both = f'{columns[column.name].heading!r} and {column.heading!r}'
            raise RecordingError(where, f'two columns of {column.name}, {both}', 'leave one out')
        columns[column.name] = column
    for name in NEEDED:
        if name not in columns:
            got = ', '.join(cell.strip() for cell in cells if cell.strip()) or 'nothing'
            raise RecordingError(where, f'there is no column of {name}, got {got[:200]}', _example())
    return columns, unknown


def split_heading(heading: str) -> tuple[str, str]:
    """A heading as its word and its unit, '' where it has none: `force_N`, `force [N]` and `force (N)` alike."""
    match = _HEADING.match(heading)
    if match is None:  # pragma: no cover - the pattern matches every text on one line
        return heading, ''
    return match['word'], match['square'] or match['round'] or match['plain'] or ''


def _example() -> str:
    return 'begin with a line such as force_N,displacement_mm'


def _column(heading: str, place: int, where: str) -> Column | None:
    plain_name = re.sub(r'\s+', '_', heading.lower())
    plain_name = _SYNONYMS.get(plain_name, plain_name)
    if plain_name in CHOICES or plain_name == 'cycle':
        return Column(plain_name, heading, place)
    word, unit = split_heading(heading)
    name = _WORDS.get(word.strip().lower()) or _WORDS.get(plain_name)
    if name is None:
        return None
    units = QUANTITIES[name].units
    choices = ', '.join(f'{QUANTITIES[name].names[0]}_{one}' for one in units if one.isascii())
    if not unit:
        raise RecordingError(where, f'the column {heading!r} has no unit', f'call it one of {choices}')
    if unit.strip() not in units:
        raise RecordingError(where, f'the column {heading!r} has an unknown unit', f'call it one of {choices}')
    return Column(name, heading, place, units[unit.strip()])


def read_number(cell: str, column: Column, decimal_comma: bool) -> float:
    """A number in SI.

    Raises:
        ValueError: it is not a number, or not a plausible one; the message says what was expected.
    """
    value = plain_number(cell, decimal_comma) * column.factor
    quantity = QUANTITIES[column.name]
    if not abs(value) <= quantity.largest:
        raise ValueError(f'{cell.strip()[:40]} is too large to be plausible; {quantity.hint}')
    if column.name == 'lever' and value <= 0:
        raise ValueError(f'expected a lever above 0, got {cell.strip()[:40]}')
    return value


def read_cycle(cell: str) -> int:
    """The number of a cycle.

    Raises:
        ValueError: it is not a whole number of 0 or more.
    """
    text = plain(cell)
    if not re.fullmatch(r'\d{1,6}([.,]0*)?', text):
        raise ValueError(f'expected the number of a cycle, got {cell.strip()[:40]!r}')
    return int(re.split('[.,]', text)[0])


def read_choice(cell: str, column: Column) -> str:
    """One of the values allowed in a column of text.

    Raises:
        ValueError: it is not one of them.
    """
    values = CHOICES[column.name]
    text = re.sub(r'[\s_-]', '', cell.lower())
    if text not in values:
        raise ValueError(f'expected one of {", ".join(dict.fromkeys(values.values()))}, got {cell.strip()[:40]!r}')
    return values[text]


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
    return table_readings(load_table(Path(path), 'force_N,displacement_mm'), defaults)


def parse_readings(text: str, where: str, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """The readings in a text.

    Args:
        text: of the table.
        where: its file, for messages.
        defaults: see `load_readings`.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    return table_readings(parse_table(text, where, 'force_N,displacement_mm'), defaults)


def table_readings(table: Table, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """The readings in a table; see `load_readings`.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    columns, unknown = read_heading(table.heading, table.source)
    values = _values(table, columns)
    notes = [f'{table.source}: the column {name!r} is unknown and not used' for name in unknown]
    return _readings(values, [line for line, _ in table.rows], table.source, defaults, notes)


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


def _values(table: Table, columns: dict[str, Column]) -> dict[str, list[float | int | str | None]]:
    """The values by column, None where an optional cell is empty.

    Raises:
        RecordingError: a row is wrong; it names the line and the column, and the lines of others.
    """
    values: dict[str, list[float | int | str | None]] = {name: [] for name in columns}
    wrong: list[tuple[int, str]] = []
    for line, cells in table.rows:
        heading = ''
        try:
            table.check_width(cells)
            for name, column in columns.items():
                heading = f'{column.heading}: '
                cell = cells[column.place] if column.place < len(cells) else ''
                values[name].append(_value(cell, column, table.decimal_comma))
        except ValueError as error:
            wrong.append((line, f'{heading}{error}'))
    raise_wrong_rows(table.source, wrong)
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
