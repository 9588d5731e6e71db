"""Readings of a dial gauge and a force gauge: the rows of the experiments of section 5.2.

The displacement is positive along the positive force.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats

GRIPPER, JOINT1, JOINT2 = 'gripper', 'joint1', 'joint2'
PARTS = (GRIPPER, JOINT1, JOINT2)
"""The loaded part: the gripper with both joints locked, or one joint with the other locked."""
TIP, LINK = 'tip', 'link'
_GAUGE_PLACES = (TIP, LINK)
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
        cycle: number of the load cycle; -1 where none is given.
        time: s; NaN where none is given.
        source: index of the row's file in `sources`.
        line: its line there, from 1; 0 if it comes from no file.
        sources: names of the files.
        notes: remarks on the files.

    Raises:
        ParameterError: lengths differ, a force or displacement is not finite, or a part or place is unknown.
    """

    force: Floats
    displacement: Floats
    part: NDArray[np.str_]
    gauge_at: NDArray[np.str_]
    direction: Floats
    lever: Floats
    cycle: NDArray[np.int64]
    time: Floats
    source: NDArray[np.int64]
    line: NDArray[np.int64]
    sources: tuple[str, ...] = ('readings',)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            array = np.array(getattr(self, name))
            if array.shape != np.shape(self.force):
                raise ParameterError(name, f'expected as many values as forces, {len(self.force)}, got {array.shape}')
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        for name in ('force', 'displacement'):
            if not np.all(np.isfinite(getattr(self, name))):
                raise ParameterError(name, 'expected finite numbers')
        for name, words in (('part', PARTS), ('gauge_at', _GAUGE_PLACES)):
            if not np.all(np.isin(getattr(self, name), words)):
                raise ParameterError(name, f'expected one of {" ".join(words)}')

    def __len__(self) -> int:
        return len(self.force)

    @classmethod
    def of(
        cls,
        force: ArrayLike,
        displacement: ArrayLike,
        *,
        part: ArrayLike = GRIPPER,
        gauge_at: ArrayLike | None = None,
        direction: ArrayLike = np.nan,
        lever: ArrayLike = np.nan,
        cycle: ArrayLike = -1,
        time: ArrayLike = np.nan,
        source: str = 'readings',
    ) -> DialGaugeReadings:
        """From arrays, or one value for all rows; `gauge_at`: by default `TIP` for the gripper, `LINK` for a joint."""
        force = np.asarray(force, dtype=float)
        parts = np.broadcast_to(np.asarray(part), force.shape)
        defaults = np.where(parts == GRIPPER, TIP, LINK)

        def column(value: ArrayLike) -> NDArray[Any]:
            return np.broadcast_to(np.asarray(value), force.shape)

        return cls(
            force,
            np.asarray(displacement, dtype=float),
            parts,
            defaults if gauge_at is None else column(gauge_at),
            column(direction),
            column(lever),
            column(cycle),
            column(time),
            source=np.zeros(force.shape, dtype=np.int64),
            line=np.zeros(force.shape, dtype=np.int64),
            sources=(source,),
        )

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
