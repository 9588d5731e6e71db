"""Readings from a CSV file, such as a spreadsheet saves, checked row by row.

The first line that is neither empty nor a comment (`#`) names the columns, each with its unit:

    force_N,displacement_mm,direction_deg,cycle          also: force [N];displacement [mm]

See `files.csv_text` for separators, decimal commas, encodings and invalid rows.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.files.csv_text import CsvRows, raise_wrong_rows, read_csv_text, split_rows, too_many_cells
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
    return parse_readings(read_csv_text(Path(path)), str(path), defaults)


def parse_readings(text: str, where: str, defaults: TableDefaults = TableDefaults()) -> DialGaugeReadings:  # noqa: B008 - immutable
    """The readings in a text.

    Args:
        text: of the table.
        where: its file, for messages.
        defaults: see `load_readings`.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    rows = split_rows(text, where, 'force_N,displacement_mm')
    columns, unknown = read_heading(rows.heading, where)
    values = _values(rows, columns, where)
    notes = [f'{where}: the column {name!r} is unknown and not used' for name in unknown]
    return _readings(values, [line for line, _ in rows.body], where, defaults, notes)


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


def _values(rows: CsvRows, columns: dict[str, Column], where: str) -> dict[str, list[float | int | str | None]]:
    """The values by column, None where an optional cell is empty.

    Raises:
        RecordingError: a row is wrong; it names the line and the column, and the lines of others.
    """
    values: dict[str, list[float | int | str | None]] = {name: [] for name in columns}
    wrong: list[tuple[int, str]] = []
    for line, cells in rows.body:
        problem = too_many_cells(cells, len(rows.heading), rows.decimal_comma)
        if problem:
            wrong.append((line, problem))
            continue
        for name, column in columns.items():
            try:
                cell = cells[column.place] if column.place < len(cells) else ''
                values[name].append(_value(cell, column, rows.decimal_comma))
            except ValueError as error:
                wrong.append((line, f'{column.heading}: {error}'))
                break
    raise_wrong_rows(where, wrong)
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
