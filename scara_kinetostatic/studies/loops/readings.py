"""Tables of a dial gauge and a force gauge, section 5.2: loads point by point, run by run, or a record of loops."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.files import columns
from scara_kinetostatic.files.columns import Column, Table, load_table, one_of
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.studies.loops.record import Record

GRIPPER, JOINT1, JOINT2 = 'gripper', 'joint1', 'joint2'
PARTS = (GRIPPER, JOINT1, JOINT2)
"""The loaded part: the gripper with both joints locked, or one joint with the other locked."""
TIP, LINK = 'tip', 'link'
"""Where the dial gauge touches: the end-effector, or the end of link 2, where the gripper does not contribute."""


@dataclass(frozen=True)
class Readings:
    """Rows of one run, in the order in which they were taken: one part, one place of the gauge, one direction.

    Attributes:
        force: load along the direction, of either sign, (n,), N.
        displacement: of the point that the gauge touches, positive along the positive force, (n,), m.
        cycle: number of the load cycle, (n,); NaN where none is given.
        line: of the file, (n,), from 1.
        part: one of `PARTS`.
        gauge_at: `TIP` or `LINK`; if empty the `TIP` for a gripper, the `LINK` for a joint.
        direction: of the positive load, rad; NaN if none is given.
        lever: arm of the load about the joint, m; NaN for the gripper.
        source: name of the file.
    """

    force: Floats
    displacement: Floats
    cycle: Floats = field(default_factory=lambda: np.array(math.nan))
    line: Indices = field(default_factory=lambda: np.array(0))
    part: str = GRIPPER
    gauge_at: str = ''
    direction: float = math.nan
    lever: float = math.nan
    source: str = 'readings'

    def __post_init__(self) -> None:
        for name in ('force', 'displacement', 'cycle', 'line'):
            array = np.array(np.broadcast_to(getattr(self, name), np.shape(self.force)))
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if not self.gauge_at:
            object.__setattr__(self, 'gauge_at', TIP if self.part == GRIPPER else LINK)

    def __len__(self) -> int:
        return len(self.force)

    @property
    def name(self) -> str:
        """What was loaded, for messages."""
        part = self.part.replace('joint', 'joint ')
        return part if math.isnan(self.direction) else f'{part} at {math.degrees(self.direction):g}°'


class GaugeTable(NamedTuple):
    """What a table holds: its runs in the order in which they begin, or its record of loops; remarks."""

    runs: tuple[Readings, ...]
    record: Record | None = None
    notes: tuple[str, ...] = ()


COLUMNS = (
    Column('force', ('force', 'load', 'f'), columns.FORCE, True, largest=1e6),
    Column('displacement', ('displacement', 'deflection', 'gauge', 'ds', 'δs'), columns.LENGTH, True, largest=0.5),
    Column(
        'direction', ('direction', 'angle'), columns.ANGLE, blank=True,
        largest=4 * math.pi + 1e-9, hint='give an angle within two turns',
    ),
    Column('lever', ('lever', 'arm'), columns.LENGTH, blank=True, largest=10.0, positive=True),
    Column('time', ('time', 't'), columns.TIME, blank=True, largest=1e12),
    Column('cycle', ('cycle',), blank=True, largest=1e6),
    Column(
        'part', ('part', 'joint'), blank=True,
        parse=one_of({GRIPPER: GRIPPER, 'joint1': JOINT1, 'joint2': JOINT2, '1': JOINT1, '2': JOINT2}),
    ),
    Column('gauge_at', ('gauge_at',), blank=True, parse=one_of({TIP: TIP, LINK: LINK})),
)  # fmt: skip
_ABSENT = {'direction': math.nan, 'lever': math.nan, 'time': math.nan, 'cycle': math.nan, 'part': GRIPPER}


def load_readings(path: str | Path, **defaults: str | float) -> GaugeTable:
    """Reads a table of readings.

    Args:
        path: the file.
        defaults: by name of an optional column, the value where it is missing, or a cell of it is empty; SI.

    Raises:
        ParameterError: the rows of a joint have no lever.
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
        UnsupportedDataError: the time of a record of loops does not rise, or its load never changes.
    """
    return table_readings(load_table(Path(path), 'force_N,displacement_mm'), **defaults)


def table_readings(table: Table, **defaults: str | float) -> GaugeTable:
    """The readings in a table; see `load_readings`."""
    places = table.find(COLUMNS)
    values = table.read(places)
    cells: dict[str, list[Any]] = {name: list(several) for name, several in (values.numbers | values.others).items()}
    for name, default in (_ABSENT | {'gauge_at': ''} | defaults).items():
        given = cells.get(name, [None] * len(table.rows))
        cells[name] = [default if cell is None or cell != cell else cell for cell in given]  # NaN is an empty one
    notes = tuple(f'{table.source}: {note}' for note in table.unused(places))
    if not np.isnan(cells['time']).any() and np.isnan(cells['cycle'] + cells['direction']).all():
        time, force, displacement = (np.array(cells[name]) for name in ('time', 'force', 'displacement'))
        record = Record(table.source, time, force, displacement, 'N')
        return GaugeTable((), record, notes)
    runs: dict[tuple[Any, ...], list[int]] = {}
    keys = zip(*(cells[name] for name in ('part', 'gauge_at', 'direction', 'lever')), strict=True)
    for row, (part, gauge_at, direction, lever) in enumerate(keys):
        if part != GRIPPER and math.isnan(lever):
            where = f'{table.source}: line {table.rows[row][0]}'
            raise ParameterError(where, 'a joint needs its lever', 'add a column lever_m, or give --lever')
        own = (str(round(direction, 6)), str(round(lever, 9)) if part != GRIPPER else '')
        runs.setdefault((part, gauge_at, *own), []).append(row)
    return GaugeTable(tuple(_run(table, cells, rows) for rows in runs.values()), None, notes)


def _run(table: Table, cells: dict[str, list[Any]], rows: list[int]) -> Readings:
    """One run, from the numbers of its rows."""
    first = {name: cells[name][rows[0]] for name in ('part', 'gauge_at', 'direction', 'lever')}
    force, displacement, cycle = (np.array(cells[name])[rows] for name in ('force', 'displacement', 'cycle'))
    line = np.array([table.rows[row][0] for row in rows])
    if first['part'] == GRIPPER:
        first['lever'] = math.nan
    return Readings(force, displacement, cycle, line, **first, source=table.source)
