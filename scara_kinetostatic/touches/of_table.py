"""Touches of a table: which object each belongs to, as for those of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scara_kinetostatic.errors import InputError, RecordingError
from scara_kinetostatic.files.touch_table import TouchTable
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.touch import TouchSet, order_of_time
from scara_kinetostatic.touches.association import associate
from scara_kinetostatic.touches.detection import Detection


def in_base_frame(cell: Cell) -> Cell:
    """The cell with a sensor that reports the force on the object in the base frame, as tables hold it."""
    return replace(cell, sensor=cell.sensor._replace(frame=SensorFrame.BASE, sign=SensorSign.ON_OBJECT))


def touches_of_table(table: TouchTable, cell: Cell) -> Detection:
    """The touches of a table, rejected where no object of the cell is there.

    Args:
        table: the table.
        cell: nominal parameters and discs.

    Raises:
        RecordingError: a row names an object that the cell does not have.
    """
    cell, joints, approach = in_base_frame(cell), cell.angles(table.joints), approach_of(table.approach, cell)
    names = [disc.name for disc in cell.discs]
    for line, name in zip(table.lines, table.objects, strict=True):
        if name and name not in names:
            problem = f'line {line}: the cell has no object {name!r}'
            raise RecordingError(table.source, problem, f'its objects are {", ".join(names)}')
    association = associate(joints, table.force, cell)
    named = np.array([bool(name) for name in table.objects])
    given = np.array([names.index(name) if name else 0 for name in table.objects], dtype=np.intp)
    disc, known = np.where(named, given, association.disc), named | association.known
    touches = TouchSet(
        joints=joints,
        force=table.force,
        disc=disc,
        posture=posture(cell.nominal, joints),
        time=table.time,
        approach=approach,
        press=press_of(approach),
        order=order_of_time(table.time),
    )
    found = Detection.of(touches)
    episodes = tuple(
        one if known[one.index] else replace(one, reason=association.reason(one.index, cell), kind='no object')
        for one in found.episodes
    )
    return replace(found, episodes=episodes, warnings=table.notes)


def approach_of(readings: Floats, cell: Cell) -> Floats:
    """The last movements of the angles of a coupled arm; of senses, ±1, alone that of joint 2 is taken as it is."""
    return cell.angles(readings) if press_of(readings).any() else cell.in_sense(readings)


def press_of(approach: Floats) -> Floats:
    """The part of the last movements that is in contact: all of it, or 0, unknown, if they are only senses, ±1."""
    return np.zeros_like(approach) if np.isin(np.abs(approach), (0.0, 1.0)).all() else approach


def cell_of_files(cell: Cell, tables: Sequence[str | Path], recordings: Sequence[str | Path]) -> Cell:
    """The cell as the sensor of these files sees it: the forces of tables are those on the object in the base frame.

    Raises:
        InputError: there are tables, and recordings of a sensor that turns with link 2.
    """
    if not tables or (recordings and cell.sensor.frame is SensorFrame.BASE):
        return cell
    if recordings:
        problem = f'a table has its forces in the base frame, {recordings[0]} in the tool frame'
        raise InputError(tables[0], problem, 'calibrate the tables and the recordings separately')
    return in_base_frame(cell)
