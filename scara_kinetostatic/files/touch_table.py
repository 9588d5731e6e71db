"""Tables of touches, and of poses and states of an arm: CSV with one row each, checked row by row.

**Touches.**

    q1_rad,q2_rad,fx_N,fy_N,object,time_s,approach1,approach2

The first four are needed: joint angles, and the force on the object in the base frame; or, with `fx_tool_N, fy_tool_N`
in place of `fx_N, fy_N`, in that of the tool, which link 2 carries. The others are optional, as columns and as cells:

- `object`: name of the touched object; where it is absent, it is found as in a recording (`touches.association`);
- `time_s`: time of the touch; absent: unknown, so that drift cannot be identified;
- `approach1`, `approach2`: each joint's last movement before the hold, rad, or only its sign, as 1 or -1; absent: 0,
  unknown, so that hysteresis cannot be identified, and friction only of one object that turns all forces to one side.

Unknown columns, and rows without joint angles and force, are named in a note and not used, so that a table of residuals
can be read as a table of touches; so are rows in which one of these is NaN or infinite, unless most are. See `columns`
for headings, units, separators, decimal commas and encodings.

**Poses and states** are extended by columns of results. `compensate` reads `x_m, y_m, fx_N, fy_N` and optional `elbow`
(``left`` or ``right``), `locate` reads `q1_rad, q2_rad, fx_N, fy_N`; both may have `time_s`, and `approach1,
approach2`, as a table of touches. Other columns are handed on as they are, unless a result has their name; numbers that
are read, with a decimal point and in SI units.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files import columns
from scara_kinetostatic.files.columns import Column, Place, Table, csv_cell, load_table, one_of, plain, split_heading
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SensorFrame

COLUMNS = {
    column.name: column
    for column in (
        *(Column(f'{q}_rad', (q,), columns.ANGLE, True, largest=30.0, hint=f'name it {q}_deg where it is in degrees')
          for q in ('q1', 'q2')),
        *(Column(f'{x}_m', (x,), columns.LENGTH, True, largest=100.0, hint=f'name it {x}_mm where it is in mm')
          for x in ('x', 'y')),
        *(Column(f'{f}_N', (f,), columns.FORCE, True, largest=1e5) for f in ('fx', 'fy', 'fx_tool', 'fy_tool')),
        Column('elbow', ('elbow',), parse=one_of({'left': 'left', 'right': 'right'})),
        Column('time_s', ('time',), columns.TIME, largest=1e12),
        *(Column(name, (name,), columns.SENSE_OR_ANGLE, largest=30.0) for name in ('approach1', 'approach2')),
        Column('object', ('object',), parse=str.strip),
    )
}  # fmt: skip
POSES, STATES = ('x_m', 'y_m', 'fx_N', 'fy_N'), ('q1_rad', 'q2_rad', 'fx_N', 'fy_N')
"""Columns that a table of poses, and one of states or touches, must have."""
EXAMPLE = ','.join(STATES)
TOOL_STATES = (*STATES[:2], 'fx_tool_N', 'fy_tool_N')
"""Those of a table of touches whose forces are in the frame of the tool."""
_NOT_FINITE = re.compile(r'[-+]?(nan|inf)', re.IGNORECASE)


class TouchTable(NamedTuple):
    """The rows of a table of touches.

    Attributes:
        joints: readings of the joints, (n, 2), rad.
        force: on the object, base frame, (n, 2), N; in that of the tool where `frame` is.
        objects: name of the touched object, n of them; empty where the table does not say.
        time: since the first touch, (n,), s; 0 where unknown.
        approach: each joint's last movement, (n, 2), rad or sign; 0 where unknown.
        lines: line number of each row, (n,).
        source: the file.
        notes: what is odd about it, one sentence each.
        frame: that of the forces.
    """

    joints: Floats
    force: Floats
    objects: tuple[str, ...]
    time: Floats
    approach: Floats
    lines: tuple[int, ...]
    source: str
    notes: tuple[str, ...] = ()
    frame: SensorFrame = SensorFrame.BASE


def is_touch_table(path: str | Path) -> bool:
    """Whether a path names a table rather than a recording: by its suffix, in any case."""
    return Path(path).suffix.lower() == '.csv' and not Path(path).is_dir()


def _places(table: Table, needed: Sequence[str], besides: Sequence[str], *, blank: bool) -> dict[str, Place]:
    """Where the columns are; the cells of those besides the needed ones may be empty if `blank`."""
    known = [COLUMNS[name] for name in needed]
    known += [COLUMNS[name]._replace(blank=blank and bool(COLUMNS[name].units)) for name in besides]
    places = table.find(known)
    if ('approach1' in places) != ('approach2' in places):
        raise RecordingError(table.source, 'there is one of approach1 and approach2', 'give both, or none')
    return places


def load_touch_table(path: str | Path) -> TouchTable:
    """Read a table of touches.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    return _touches(load_table(Path(path), EXAMPLE))


def _touches(table: Table) -> TouchTable:
    words = {split_heading(heading)[0].lower() for heading in table.heading}
    states = TOOL_STATES if 'fx_tool' in words and 'fx' not in words else STATES
    places = _places(table, states, ('time_s', 'approach1', 'approach2', 'object'), blank=True)
    notes = table.unused(places)
    needed = [places[name].number for name in states]
    cells_of = ((line, [cells[k] for k in needed if k < len(cells)]) for line, cells in table.rows)
    wrong = dict.fromkeys(line for line, cells in cells_of if any(_NOT_FINITE.match(plain(cell)) for cell in cells))
    if wrong:
        some = ', '.join(map(str, list(wrong)[:8]))
        some += f' and {len(wrong) - 8} more' * (len(wrong) > 8)
        notes.append(f'not finite: {len(wrong)} of {len(table.rows)} rows, line {some}; not used')
        if 2 * len(wrong) > len(table.rows):
            raise RecordingError(table.source, notes[-1], 'see what writes the table')
    table = replace(table, rows=tuple(row for row in table.rows if row[0] not in wrong))
    filled = [any(cells[k].strip() for k in needed if k < len(cells)) for _, cells in table.rows]
    if not any(filled):
        raise RecordingError(table.source, f'no row has a number in {EXAMPLE}', 'give one row per touch')
    empty = [line for (line, _), full in zip(table.rows, filled, strict=True) if not full]
    if empty:  # such as those of rejected touches
        more = f' and {len(empty) - 1} more' if len(empty) > 1 else ''
        notes.append(f'line {empty[0]}{more}: no joint angles and no force; not used')
    table = replace(table, rows=tuple(row for row, full in zip(table.rows, filled, strict=True) if full))
    numbers, others = table.read(places)
    time = numbers.get('time_s', np.zeros(len(table.rows)))
    unknown = np.isnan(time)
    if unknown.any() and not unknown.all():
        raise RecordingError(table.source, 'time_s: some cells are empty', 'give the time of every touch, or of none')
    approach = [numbers.get(name, np.zeros(len(time))) for name in ('approach1', 'approach2')]
    values = np.stack([numbers[name] for name in states], axis=-1)
    return TouchTable(
        joints=values[:, :2],
        force=values[:, 2:],
        objects=tuple(others.get('object', [''] * len(time))),
        time=np.zeros(len(time)) if unknown.any() else time - time.min(),
        approach=np.nan_to_num(np.stack(approach, axis=-1), nan=0.0),
        lines=tuple(line for line, _ in table.rows),
        source=table.source,
        notes=tuple(notes),
        frame=SensorFrame.TOOL if states is TOOL_STATES else SensorFrame.BASE,
    )


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

    def text_with(self, results: Mapping[str, NDArray[Any]]) -> str:
        """The table with columns of results, (n,) each, behind its own."""
        kept = [place for place, name in enumerate(self.heading) if name not in results]
        heading = [*(csv_cell(self.heading[place]) for place in kept), *results]
        texts = zip(*(map(str, column.tolist()) for column in results.values()), strict=True)
        rows = zip(self.cells, texts, strict=True)
        lines = [','.join((*(csv_cell(cells[place]) for place in kept), *text)) for cells, text in rows]
        return '\n'.join([','.join(heading), *lines, ''])


def load_pose_table(path: Path, needed: Sequence[str]) -> PoseTable:
    """Read a table.

    Args:
        path: the file.
        needed: `POSES` or `STATES`.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    table = load_table(path, ','.join(needed))
    places = _places(table, needed, ('elbow', 'time_s', 'approach1', 'approach2'), blank=False)
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
