"""A touch on the topic of the collector (`judged_touch`) as the monitor takes it; whether a calibration has seen it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.touch_table import LARGEST
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.record import CalibrationRecord

_MOTION = ('approach1', 'approach2', 'press1', 'press2')


def touch_of(values: Mapping[str, str], record: CalibrationRecord) -> TouchSet:
    """A touch of the message in the cell of the calibration.

    Raises:
        KeyError, ValueError: a value is missing or no number.
        InputError: the object or the frame is not that of the calibration.
    """
    cell = record.arm.cell
    names = [disc.name for disc in cell.discs]
    if values['object'] not in names:
        problem = f'the calibration knows no object {values["object"]!r}'
        raise InputError('collector/touch', problem, 'calibrate with this cell description')
    if values['frame'] != cell.sensor.frame.value:
        raise InputError('collector/touch', f'the frame of the force is {values["frame"]}, not that of the calibration')
    joints = np.array([[_number(values, 'q1_rad'), _number(values, 'q2_rad')]])
    force = np.array([[_number(values, 'fx_N'), _number(values, 'fy_N')]])
    moved = np.array([float(values.get(name) or 0.0) for name in _MOTION])
    return TouchSet(
        joints,
        force,
        np.array([names.index(values['object'])]),
        posture(record.arm.model.parameters, joints),
        time=np.array([record.arm.used.duration]),
        approach=moved[None, :2],
        press=moved[None, 2:],
    )


def _number(values: Mapping[str, str], name: str) -> float:
    """A plausible number.

    Raises:
        KeyError, ValueError: there is none.
    """
    number = float(values[name])
    if not abs(number) <= LARGEST[name]:
        raise ValueError(f'{name} = {number:g} is not plausible')
    return number


def was_seen(recording: str, number: str, record: CalibrationRecord) -> bool:
    """Whether a touch is one of those that a calibration was made of.

    Of a calibration by one recording that went on afterwards, the touches that it had found then; of one by several,
    all touches of these. A path that is not absolute is that of any folder whose path ends with it.
    """
    parts = Path(recording).parts
    places = [Path(path) for path in record.paths if path]
    if not any(recording == str(p) or (not p.is_absolute() and parts[-len(p.parts) :] == p.parts) for p in places):
        return False
    found = record.document['touches'].get('found')
    return len(places) > 1 or not isinstance(found, int) or not number.isdigit() or int(number) < found
