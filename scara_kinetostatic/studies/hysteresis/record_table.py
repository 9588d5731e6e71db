"""A record of a load and a response from a CSV file, checked row by row; see `files.csv_text` for what is read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import RecordingError, UnsupportedDataError
from scara_kinetostatic.files import csv_text
from scara_kinetostatic.files.csv_text import CsvRows, raise_wrong_rows, read_csv_text, split_rows, too_many_cells
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.table_file import parse_readings
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord
from scara_kinetostatic.studies.hysteresis.record_columns import (
    LARGEST,
    RecordColumn,
    RecordColumns,
    choose_columns,
    is_gauge_heading,
)


class RecordTable(NamedTuple):
    """A table before it is known what drives it; arrays (n,), SI.

    Attributes:
        source: the file.
        time: s; None where the table has no column of it.
        load: N or Nm.
        response: m or rad.
        load_unit: 'N' or 'Nm'.
        response_unit: 'm' or 'rad'.
        joint: its number in the headings, if there is one.
        notes: remarks on the file.
    """

    source: str
    time: Floats | None
    load: Floats
    response: Floats
    load_unit: str
    response_unit: str
    joint: int | None = None
    notes: tuple[str, ...] = ()

    @property
    def readings(self) -> DialGaugeReadings:
        """As a record driven by its motion: force over displacement, or torque over angle."""
        time = np.nan if self.time is None else self.time
        return replace(DialGaugeReadings.of(self.load, self.response, time=time, source=self.source), notes=self.notes)

    @property
    def load_record(self) -> LoadRecord:
        """As a record driven by its load.

        Raises:
            UnsupportedDataError: see `LoadRecord`, or there are no times.
        """
        if self.time is None or not np.all(np.isfinite(self.time)):
            raise UnsupportedDataError(f'{self.source}: the time of every row is needed', 'add a column time_s')
        return LoadRecord(
            self.source, self.time, self.load, self.response, self.load_unit, self.response_unit, self.notes
        )


def load_record_table(path: str | Path, response: str | None = None, load: str | None = None) -> RecordTable:
    """Reads a record.

    Args:
        path: the file.
        response: heading of the response; None for the one that its name or its unit tells.
        load: heading of the load, likewise.

    Raises:
        ParameterError: a column asked for does not exist, or is no response or load.
        RecordingError: the file cannot be read, columns do not go together, or a row is wrong.
    """
    where, text = str(path), read_csv_text(Path(path))
    rows = split_rows(text, where, 'time_s,angle_rad,torque_Nm')
    if response is None and load is None and is_gauge_heading(rows.heading):
        readings = parse_readings(text, where)
        return RecordTable(where, readings.time, readings.force, readings.displacement, 'N', 'm', notes=readings.notes)
    columns = choose_columns(rows.heading, where, response, load)
    values = _values(rows, columns, where)
    if columns.response.unit == 'rad':
        _check_continuous(values[columns.response.heading], columns.response, rows, where)
    return RecordTable(
        where,
        None if columns.time is None else values[columns.time.heading],
        values[columns.load.heading],
        values[columns.response.heading],
        columns.load.unit,
        columns.response.unit,
        columns.response.joint if columns.response.joint is not None else columns.load.joint,
    )


def check_alike(tables: list[RecordTable]) -> None:
    """Checks that the records may be of one joint.

    Raises:
        RecordingError: their units or the numbers of their joints differ; the first other one is named.
    """
    first = tables[0]
    for table in tables[1:]:
        if table.load_unit != first.load_unit:
            problem = f'its load is in {table.load_unit}, that of {first.source} in {first.load_unit}'
            raise RecordingError(table.source, problem, 'give records of one joint')
        if None not in (table.joint, first.joint) and table.joint != first.joint:
            problem = f'a record of joint {table.joint}, but {first.source} is one of joint {first.joint}'
            raise RecordingError(table.source, problem, 'give records of one joint, or rename the columns')


def _values(rows: CsvRows, columns: RecordColumns, where: str) -> dict[str, Floats]:
    """The columns in SI, by heading.

    Raises:
        RecordingError: a row is wrong; it names the line and the column, and the lines of others.
    """
    chosen = [column for column in columns if column is not None]
    values: list[list[float]] = []
    wrong: list[tuple[int, str]] = []
    for line, cells in rows.body:
        problem = too_many_cells(cells, len(rows.heading), rows.decimal_comma)
        found = []
        for column in () if problem else chosen:
            try:
                found.append(_number(cells, column, rows.decimal_comma))
            except ValueError as error:
                problem = f'{column.heading}: {error}'
                break
        values.append(found)
        wrong += [(line, problem)] if problem else []
    raise_wrong_rows(where, wrong)
    return {column.heading: array for column, array in zip(chosen, np.array(values).T, strict=True)}


def _check_continuous(angle: Floats, column: RecordColumn, rows: CsvRows, where: str) -> None:
    steps = np.abs(np.diff(angle))
    if np.any(steps > np.pi):
        line = rows.body[int(steps.argmax()) + 1][0]
        problem = f'line {line}: {column.heading} jumps by {steps.max():.3g} rad, more than half a turn'
        raise RecordingError(where, problem, 'unwrap the angle, or check the unit of the column')


def _number(cells: list[str], column: RecordColumn, decimal_comma: bool) -> float:
    cell = cells[column.place] if column.place < len(cells) else ''
    value = csv_text.read_number(cell, decimal_comma) * column.factor
    if not abs(value) <= LARGEST[column.unit]:
        raise ValueError(f'{cell.strip()[:40]} is too large to be plausible; check the unit of the column')
    return value
