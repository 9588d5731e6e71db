"""Readings of a dial gauge and a force gauge: the rows of the experiments of section 5.2, and their CSV files.

The displacement is positive along the positive force.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.files import columns
from scara_kinetostatic.files.columns import Column, Table, load_table, one_of
from scara_kinetostatic.model.arrays import Floats, Indices

GRIPPER, JOINT1, JOINT2 = 'gripper', 'joint1', 'joint2'
PARTS = (GRIPPER, JOINT1, JOINT2)
"""The loaded part: the gripper with both joints locked, or one joint with the other locked."""
TIP, LINK = 'tip', 'link'
"""Where the dial gauge touches: the end-effector, or the end of link 2, where the gripper does not contribute."""


@dataclass(frozen=True)
class DialGaugeReadings:
    """Rows in the order in which they were taken; every array (n,), read-only.

    Attributes:
        force: load along the direction, of either sign, N.
        displacement: of the point that the gauge touches, along the same direction, m.
        part: one of `PARTS` per row.
        gauge_at: `TIP` or `LINK` per row.
        direction: of the positive load, rad; NaN where none is given.
        lever: arm of the load about the joint, m; NaN where none is given.
        cycle: number of the load cycle; NaN where none is given.
        time: s; NaN where none is given.
        source: index of the row's file in `sources`.
        line: its line there, from 1; 0 if it comes from no file.
        sources: names of the files.
        notes: remarks on the files.
    """

    force: Floats
    displacement: Floats
    part: NDArray[np.str_]
    gauge_at: NDArray[np.str_]
    direction: Floats
    lever: Floats
    cycle: Floats
    time: Floats
    source: Indices
    line: Indices
    sources: tuple[str, ...] = ('readings',)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            array = np.array(getattr(self, name))
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __len__(self) -> int:
        return len(self.force)

    @classmethod
    def of(
        cls, force: ArrayLike, displacement: ArrayLike, source: str = 'readings', **others: ArrayLike
    ) -> DialGaugeReadings:
        """Rows of one file, from arrays.

        Args:
            force: (n,), N.
            displacement: (n,), m.
            source: the file.
            others: columns by name, each (n,) or one value for all rows. By default the part is the gripper, the gauge
                is at the `TIP` of a gripper and at the `LINK` of a joint, also where `gauge_at` is empty.
        """
        force = np.asarray(force, dtype=float)
        absent: dict[str, ArrayLike] = {
            'part': GRIPPER, 'gauge_at': '', 'direction': np.nan, 'lever': np.nan, 'cycle': np.nan, 'time': np.nan,
            'source': 0, 'line': 0,
        }  # fmt: skip
        found: dict[str, Any] = {name: np.broadcast_to(value, force.shape) for name, value in (absent | others).items()}
        by_part = np.where(found['part'] == GRIPPER, TIP, LINK)
        found['gauge_at'] = np.where(found['gauge_at'] == '', by_part, found['gauge_at'])
        return cls(force, np.asarray(displacement, dtype=float), **found, sources=(source,))

    def select(self, rows: ArrayLike) -> DialGaugeReadings:
        """Some of the rows, by mask or index."""
        return replace(self, **{name: getattr(self, name)[np.asarray(rows)] for name in _ARRAYS})


_ARRAYS = tuple(field.name for field in fields(DialGaugeReadings) if field.name not in ('sources', 'notes'))


def join(all_readings: Iterable[DialGaugeReadings]) -> DialGaugeReadings:
    """Readings one after the other."""
    several = list(all_readings)
    shift = np.cumsum([0, *(len(readings.sources) for readings in several)])
    arrays = {name: np.concatenate([getattr(readings, name) for readings in several]) for name in _ARRAYS}
    arrays['source'] = np.concatenate([r.source + shift[k] for k, r in enumerate(several)])
    return DialGaugeReadings(
        **arrays,
        sources=tuple(name for readings in several for name in readings.sources),
        notes=tuple(note for readings in several for note in readings.notes),
    )


COLUMNS = {
    column.name: column
    for column in (
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
    )
}  # fmt: skip
"""Those of a table of readings, by name."""


def load_readings(path: str | Path, **defaults: str | float) -> DialGaugeReadings:
    """Reads a table of readings.

    Args:
        path: the file.
        defaults: by name of an optional column, the value where it is missing, or a cell of it is empty; SI.

    Raises:
        RecordingError: the file cannot be read, or a column or a row of it is wrong.
    """
    return table_readings(load_table(Path(path), 'force_N,displacement_mm'), **defaults)


def table_readings(table: Table, **defaults: str | float) -> DialGaugeReadings:
    """The readings in a table; see `load_readings`.

    Raises:
        RecordingError: a column or a row is wrong.
    """
    places = table.find(COLUMNS.values())
    values = table.read(places)
    found: dict[str, Any] = {**values.numbers, **values.others}
    for name, default in ({'part': GRIPPER, 'gauge_at': ''} | defaults).items():
        cells = found.get(name, [None] * len(table.rows))
        found[name] = [default if cell is None or cell != cell else cell for cell in cells]  # NaN is an empty one
    lines = [line for line, _ in table.rows]
    notes = tuple(f'{table.source}: {note}' for note in table.unused(places))
    return replace(DialGaugeReadings.of(**found, source=table.source, line=lines), notes=notes)
