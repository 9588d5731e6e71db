"""Whether calibrations are of one robot in one cell."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import numpy as np

from scara_kinetostatic.bags.reader import embedded_cell
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.errors import CellError, InputError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.monitoring.record import CalibrationRecord

_REMEDY = 'give calibrations of one robot and cell'


def check_same_robot(one: CalibrationRecord, other: CalibrationRecord) -> None:
    """Check that two calibrations are of one robot in one cell.

    Raises:
        InputError: they are not.
    """
    a, b = one.arm.cell, other.arm.cell
    check_same_arm(a, b, one.source, other.source, _REMEDY)
    if not {(d.name, d.x, d.y, d.radius) for d in a.discs} & {(d.name, d.x, d.y, d.radius) for d in b.discs}:
        raise InputError(other.source, f'is of another cell than {one.source}: no object is in both', _REMEDY)


def check_same_recorded(cell: Cell, path: str | Path, source: str) -> None:
    """Check that the cell description in a recording, if it has a valid one, is of the robot of a calibration.

    Args:
        cell: of the calibration.
        path: the recording.
        source: the file of the calibration.

    Raises:
        InputError: it is not.
    """
    with suppress(CellError):
        recorded = embedded_cell(path)
        if recorded is not None:
            check_same_arm(cell, recorded, source, str(path), 'give a recording of the calibrated robot')


def check_same_identification(a: Cell, b: Cell, first: str, second: str, remedy: str) -> None:
    """Check that two cells, as far as they say it, are of the same robot; `first` and `second` are their files.

    Raises:
        InputError: they are not.
    """
    for name in ('robot', 'serial_number', 'cell'):
        one, other = getattr(a.identification, name), getattr(b.identification, name)
        if one and other and one != other:
            raise InputError(second, f'is of {name.replace("_", " ")} {other!r}, and {first} of {one!r}', remedy)


def check_same_arm(a: Cell, b: Cell, first: str, second: str, remedy: str) -> None:
    """Check that two cells have the same robot; `first` and `second` are their files.

    Raises:
        InputError: they have not.
    """
    check_same_identification(a, b, first, second, remedy)
    off = np.abs(a.nominal.as_array() - b.nominal.as_array()) > SCALES
    if off.any():
        name = NAMES[int(np.argmax(off))]
        values = f'{getattr(b.nominal, name):g} and {getattr(a.nominal, name):g} {UNITS[name]}'
        raise InputError(second, f'is of another robot than {first}: nominal {name} is {values}', remedy)
    if a.gripper != b.gripper:
        raise InputError(second, f'has another gripper law (model) than {first}', remedy)
