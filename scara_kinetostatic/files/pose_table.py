"""Tables of poses and of states of an arm: CSV with one row each, extended by columns of results.

`compensate` reads `x_m, y_m, fx_N, fy_N` and optional `elbow` (``left`` or ``right``), `locate` reads
`q1_rad, q2_rad, fx_N, fy_N`; both may have `time_s`, and `approach1, approach2`, as a table of touches. Other columns
are handed on as they are, unless a result has their name; numbers that are read, with a decimal point. See `csv_text`
for separators, decimal commas and encodings.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import OutputError, RecordingError
from scara_kinetostatic.files.atomic import write_texts
from scara_kinetostatic.files.csv_text import (
    CsvRows,
    number_text,
    plain,
    raise_wrong_rows,
    read_csv_text,
    read_number,
    split_rows,
    too_many_cells,
)
from scara_kinetostatic.files.touch_table import quoted
from scara_kinetostatic.model.arrays import Floats

POSES = ('x_m', 'y_m', 'fx_N', 'fy_N')
STATES = ('q1_rad', 'q2_rad', 'fx_N', 'fy_N')
ELBOW = 'elbow'
OPTIONAL = ('time_s', 'approach1', 'approach2')
_LARGEST = {'x_m': 100.0, 'y_m': 100.0, 'q1_rad': 30.0, 'q2_rad': 30.0, 'fx_N': 1e5, 'fy_N': 1e5, 'time_s': 1e12}
"""Beyond this a number is not plausible in its unit."""
_LARGEST_OTHER = 30.0
_UNITS = {'m': 'lengths in m', 'rad': 'angles in rad', 'N': 'forces in N', 's': 'times in s'}
_WORD = re.compile(r'[a-z]+[12]?', re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class PoseTable:
    """The rows of a table.

    Attributes:
        source: the file.
        values: the numbers by column, (n,) each.
        elbows: of each row, ``left`` or ``right``; None where the table does not say.
        heading: names of all its columns, in their order, without those that are empty throughout.
        cells: text of all cells, row by row; numbers that were read have a decimal point.
    """

    source: Path
    values: Mapping[str, Floats]
    elbows: tuple[str, ...] | None
    heading: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]

    def __len__(self) -> int:
        return len(self.cells)

    def pair(self, first: str, second: str) -> Floats:
        """Two columns, (n, 2)."""
        return np.stack([self.values[first], self.values[second]], axis=-1)

    @property
    def force(self) -> Floats:
        """F, (n, 2), N."""
        return self.pair('fx_N', 'fy_N')

    @property
    def time(self) -> Floats | None:
        """(n,), s; None where the table does not say."""
        return self.values.get('time_s')

    @property
    def approach(self) -> Floats | None:
        """Last movement of each joint, (n, 2), rad or its sense; None where the table does not say."""
        return self.pair('approach1', 'approach2') if 'approach1' in self.values else None

    def replaced(self, results: Sequence[str]) -> list[str]:
        """Names of columns, beside those that are read, in whose place a result is written."""
        return [name for name in self.heading if name in results]

    def text_with(self, results: Mapping[str, NDArray[Any]]) -> str:
        """The table with columns of results, (n,) each, behind its own."""
        kept = [place for place, name in enumerate(self.heading) if name not in results]
        heading = [*(quoted(self.heading[place]) for place in kept), *results]
        texts = zip(*([_text(value) for value in column.tolist()] for column in results.values()), strict=True)
        rows = zip(self.cells, texts, strict=True)
        lines = [','.join((*(quoted(cells[place]) for place in kept), *text)) for cells, text in rows]
        return '\n'.join([','.join(heading), *lines, ''])


def _text(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def load_pose_table(path: Path, needed: Sequence[str]) -> PoseTable:
    """Read a table.

    Args:
        path: the file.
        needed: `POSES` or `STATES`.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    rows = split_rows(read_csv_text(path), str(path), ','.join(needed))
    heading = tuple(cell.strip() for cell in rows.heading)
    columns = _columns(heading, needed, str(path))
    wrong: list[tuple[int, str]] = []
    numbers, elbows = [], []
    for line, cells in rows.body:
        try:
            numbers.append(_numbers(cells, heading, columns, rows.decimal_comma))
            elbows.append(_elbow(cells, columns))
        except ValueError as error:
            wrong.append((line, str(error)))
    raise_wrong_rows(str(path), wrong)
    names = [name for name in columns if name != ELBOW]
    values = {name: np.array([row[k] for row in numbers]) for k, name in enumerate(names)}
    texts = _texts(rows, len(heading), {columns[name] for name in names})
    kept = [place for place, name in enumerate(heading) if name or any(row[place].strip() for row in texts)]
    return PoseTable(
        path,
        values,
        tuple(elbows) if ELBOW in columns else None,
        tuple(heading[place] for place in kept),
        tuple(tuple(row[place] for place in kept) for row in texts),
    )


def _columns(heading: Sequence[str], needed: Sequence[str], where: str) -> dict[str, int]:
    """Place of each column that is read, by name.

    Raises:
        RecordingError: one is missing, has another unit, or comes twice.
    """
    known = {name.lower(): name for name in (*needed, ELBOW, *OPTIONAL)}
    columns: dict[str, int] = {}
    for place, cell in enumerate(heading):
        name = known.get(cell.lower())
        if name in columns:
            raise RecordingError(where, f'two columns of {name}', 'leave one out')
        if name is not None:
            columns[name] = place
    for name in needed:
        if name not in columns:
            raise _missing(name, heading, needed, where)
    if ('approach1' in columns) != ('approach2' in columns):
        raise RecordingError(where, 'there is one of approach1 and approach2', 'give both, or none')
    return columns


def _missing(name: str, heading: Sequence[str], needed: Sequence[str], where: str) -> RecordingError:
    word, _, unit = name.partition('_')
    for cell in heading:
        match = _WORD.match(cell)
        if match and match[0].lower() == word.lower():
            remedy = f'give {_UNITS[unit]}, and name it {name}'
            return RecordingError(where, f'there is no column {name!r}, but {cell!r}', remedy)
    got = ', '.join(cell for cell in heading if cell)
    return RecordingError(where, f'there is no column {name!r}, got {got[:200]}', f'name them {",".join(needed)}')


def _numbers(cells: Sequence[str], heading: Sequence[str], columns: Mapping[str, int], comma: bool) -> list[float]:
    """The numbers of a row, in the order of `columns`.

    Raises:
        ValueError: one is missing or not plausible; the message names the column.
    """
    surplus = too_many_cells(cells, len(heading), comma)
    if surplus:
        raise ValueError(surplus)
    found = []
    for name, place in columns.items():
        if name == ELBOW:
            continue
        try:
            value = read_number(cells[place] if place < len(cells) else '', comma)
        except ValueError as error:
            raise ValueError(f'{name}: {error}') from error
        most = _LARGEST.get(name, _LARGEST_OTHER)
        if not abs(value) <= most:
            unit = name.rpartition('_')[2]
            hint = f' ({_UNITS[unit]})' if unit in _UNITS else ''
            raise ValueError(f'{name}: expected at most {most:g} in size{hint}, got {value:g}')
        found.append(value)
    return found


def _elbow(cells: Sequence[str], columns: Mapping[str, int]) -> str:
    if ELBOW not in columns:
        return ''
    text = plain(cells[columns[ELBOW]]).lower() if columns[ELBOW] < len(cells) else ''
    if text not in ('left', 'right'):
        raise ValueError(f'{ELBOW}: expected left or right, got {text[:40]!r}')
    return text


def _texts(rows: CsvRows, width: int, numbers: Container[int]) -> list[list[str]]:
    """The cells of all rows at the width of the heading, with those of the columns `numbers` as plain numbers."""
    padded = [[*cells[:width], *[''] * (width - len(cells))] for _, cells in rows.body]
    return [[number_text(text) if k in numbers else text for k, text in enumerate(row)] for row in padded]


def check_output(path: Path, inputs: Sequence[Path]) -> None:
    """Check, before anything is computed, that a table may be written.

    Raises:
        OutputError: it would replace an input, or its path names no ``.csv`` file.
    """
    remedy = 'choose another file for --out'
    if path.is_dir():
        raise OutputError(path, 'is a folder where a file is to be written', remedy)
    if path.suffix.lower() != '.csv':
        raise OutputError(path, f'expected a file name that ends in .csv, got {path.name!r}', remedy)
    if path.resolve() in [given.resolve() for given in inputs]:
        raise OutputError(path, 'is an input and would be replaced', remedy)


def write_pose_table(path: Path, table: PoseTable, results: Mapping[str, NDArray[Any]]) -> None:
    """Write a table with its results, in one step.

    Raises:
        OutputError: it cannot be written; a former file stays.
    """
    write_texts(path.parent, {path.name: table.text_with(results)})
