"""Touches as a table: CSV with one row per touch, checked row by row.

    q1_rad,q2_rad,fx_N,fy_N,object,time_s,approach1,approach2

The first four are needed: joint angles, and the force on the object in the base frame. The others are optional, as
columns and as cells:

- `object`: name of the touched object; where it is absent, it is found as in a recording (`touches.association`);
- `time_s`: time of the touch; absent: unknown, so that drift cannot be identified;
- `approach1`, `approach2`: each joint's last movement before the hold, rad, or only its sign, as 1 or -1; absent: 0,
  unknown, so that hysteresis and friction cannot be identified.

Unknown columns, and rows without joint angles and force, are named in a note and not used, so that a table of residuals
can be read as a table of touches. See `columns` for headings, units, separators, decimal commas and encodings.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files import columns
from scara_kinetostatic.files.columns import Column, Table, load_table
from scara_kinetostatic.model.arrays import Floats

EXAMPLE = 'q1_rad,q2_rad,fx_N,fy_N'
JOINTS = tuple(
    Column(f'{q}_rad', (q,), columns.ANGLE, required=True, largest=30.0, hint=f'name it {q}_deg where it is in degrees')
    for q in ('q1', 'q2')
)
FORCE = tuple(Column(f'{f}_N', (f,), columns.FORCE, required=True, largest=1e5) for f in ('fx', 'fy'))
TIME = Column('time_s', ('time',), columns.TIME, largest=1e12)
APPROACH = tuple(Column(name, (name,), columns.SENSE_OR_ANGLE, largest=30.0) for name in ('approach1', 'approach2'))
_BLANK = tuple(column._replace(blank=True) for column in (TIME, *APPROACH))
_COLUMNS = (*JOINTS, *FORCE, *_BLANK, Column('object', ('object',), parse=str.strip))
LARGEST = {column.name: column.largest for column in _COLUMNS}
"""Beyond this a number is not plausible in its unit."""


class TouchTable(NamedTuple):
    """The rows of a table of touches.

    Attributes:
        joints: readings of the joints, (n, 2), rad.
        force: on the object, base frame, (n, 2), N.
        objects: name of the touched object, n of them; empty where the table does not say.
        time: since the first touch, (n,), s; 0 where unknown.
        approach: each joint's last movement, (n, 2), rad or sign; 0 where unknown.
        lines: line number of each row, (n,).
        source: the file.
        notes: what is odd about it, one sentence each.
    """

    joints: Floats
    force: Floats
    objects: tuple[str, ...]
    time: Floats
    approach: Floats
    lines: tuple[int, ...]
    source: str
    notes: tuple[str, ...] = ()


def is_touch_table(path: str | Path) -> bool:
    """Whether a path names a table rather than a recording: by its suffix, in any case."""
    return Path(path).suffix.lower() == '.csv' and not Path(path).is_dir()


def load_touch_table(path: str | Path) -> TouchTable:
    """Read a table of touches.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    return _touches(load_table(Path(path), EXAMPLE))


def _touches(table: Table) -> TouchTable:
    places = table.find(_COLUMNS)
    if ('approach1' in places) != ('approach2' in places):
        raise RecordingError(table.source, 'there is one of approach1 and approach2', 'give both, or none')
    notes = table.unused(places)
    needed = [places[column.name].number for column in (*JOINTS, *FORCE)]
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
    approach = [numbers.get(column.name, np.zeros(len(time))) for column in APPROACH]
    return TouchTable(
        joints=np.stack([numbers[column.name] for column in JOINTS], axis=-1),
        force=np.stack([numbers[column.name] for column in FORCE], axis=-1),
        objects=tuple(others.get('object', [''] * len(time))),
        time=np.zeros(len(time)) if unknown.any() else time - time.min(),
        approach=np.nan_to_num(np.stack(approach, axis=-1), nan=0.0),
        lines=tuple(line for line, _ in table.rows),
        source=table.source,
        notes=tuple(notes),
    )
