"""Tables of poses and of states of an arm: CSV with one row each, extended by columns of results.

`compensate` reads `x_m, y_m, fx_N, fy_N` and optional `elbow` (``left`` or ``right``), `locate` reads
`q1_rad, q2_rad, fx_N, fy_N`; both may have `time_s`, and `approach1, approach2`, as a table of touches. Other columns
are handed on as they are, unless a result has their name; numbers that are read, with a decimal point and in SI units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files import columns
from scara_kinetostatic.files.atomic import write_texts
from scara_kinetostatic.files.columns import Column, load_table, one_of, plain
from scara_kinetostatic.files.escaping import csv_cell
from scara_kinetostatic.files.touch_table import APPROACH, FORCE, JOINTS, TIME
from scara_kinetostatic.model.arrays import Floats

_PLACE = tuple(
    Column(f'{axis}_m', (axis,), columns.LENGTH, True, largest=100.0, hint=f'name it {axis}_mm where it is in mm')
    for axis in 'xy'
)
POSES = (*_PLACE, *FORCE)
STATES = (*JOINTS, *FORCE)
_BESIDES = (Column('elbow', ('elbow',), parse=one_of({'left': 'left', 'right': 'right'})), TIME, *APPROACH)


@dataclass(frozen=True, eq=False)
class PoseTable:
    """The rows of a table.

    Attributes:
        source: the file.
        values: the numbers by column, (n,) each.
        elbows: of each row, ``left`` or ``right``; None where the table does not say.
        heading: names of all its columns, in their order, without those that are empty throughout; of those that were
            converted, that of the SI unit.
        cells: text of all cells, row by row; numbers that were read have a decimal point, and are in SI units.
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
        heading = [*(csv_cell(self.heading[place]) for place in kept), *results]
        columns = (column.tolist() for column in results.values())
        texts = zip(*([repr(v) if isinstance(v, float) else str(v) for v in column] for column in columns), strict=True)
        rows = zip(self.cells, texts, strict=True)
        lines = [','.join((*(csv_cell(cells[place]) for place in kept), *text)) for cells, text in rows]
        return '\n'.join([','.join(heading), *lines, ''])


def load_pose_table(path: Path, needed: Sequence[Column]) -> PoseTable:
    """Read a table.

    Args:
        path: the file.
        needed: `POSES` or `STATES`.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    table = load_table(path, ','.join(column.name for column in needed))
    places = table.find((*needed, *_BESIDES))
    if ('approach1' in places) != ('approach2' in places):
        raise RecordingError(path, 'there is one of approach1 and approach2', 'give both, or none')
    numbers, others = table.read(places)
    width = len(table.heading)
    texts = [[*cells[:width], *[''] * (width - len(cells))] for _, cells in table.rows]
    headings = list(table.heading)
    for name, values in numbers.items():
        _, k, factor = places[name]
        headings[k] = headings[k] if factor == 1 else name
        for row, value in zip(texts, values.tolist(), strict=True):
            row[k] = plain(row[k]).replace(',', '.') if factor == 1 else f'{value:.15g}'
    kept = [k for k, heading in enumerate(headings) if heading or any(row[k].strip() for row in texts)]
    return PoseTable(
        path,
        numbers,
        tuple(others['elbow']) if 'elbow' in others else None,
        tuple(headings[k] for k in kept),
        tuple(tuple(row[k] for k in kept) for row in texts),
    )


def write_pose_table(path: Path, table: PoseTable, results: Mapping[str, NDArray[Any]]) -> None:
    """Write a table with its results, in one step.

    Raises:
        OutputError: it cannot be written; a former file stays.
    """
    write_texts(path.parent, {path.name: table.text_with(results)})
