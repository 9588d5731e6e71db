"""Before fitting: do the forces point at the discs at all? A wrong sign or frame is told, not fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.gauss_helmert import Observations
from scara_kinetostatic.calibration.prediction import base_force
from scara_kinetostatic.errors import CellError
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import Parameters

Floats = NDArray[np.float64]

OPPOSED = -0.5
"""Median cosine between force and the direction to the disc below which the sign is wrong."""
ALIGNED = 0.8
"""The same above which all is well, even 20 mm and 3° off."""


def check_plausible(observations: Observations, cell: Cell) -> None:
    """Whether the measured forces point from the nominal tip to the disc.

    Raises:
        CellError: they point away, or every way; the message says which key to look at.
    """
    cosine = _alignment(observations, cell.nominal)
    better = _other_frame(observations)
    elsewhere = _alignment(better, cell.nominal)
    if abs(elsewhere) > ALIGNED > abs(cosine):
        raise CellError(
            'sensor.frame',
            f'the forces point {"at" if elsewhere > 0 else "away from"} the discs if the frame is '
            f'{better.frame.value}, and every way if it is {observations.frame.value}',
            f'set it to {better.frame.value}, or check the mounting of the sensor',
        )
    if cosine > 0.0:
        return
    other = SensorSign.ON_ROBOT if cell.sensor.sign is SensorSign.ON_OBJECT else SensorSign.ON_OBJECT
    if cosine < OPPOSED:
        raise CellError(
            'sensor.sign',
            f'the forces point away from the discs with {cell.sensor.sign.value}',
            f'set it to {other.value}',
        )
    raise CellError(
        'sensor', 'the forces point every way but at the discs', 'check frame, sign and the axes of the sensor'
    )


def _alignment(observations: Observations, nominal: Parameters) -> float:
    to_disc = observations.centers - forward(nominal, observations.joints)
    force = base_force(observations, ExtendedModel(nominal))
    lengths = np.hypot(*to_disc.T) * np.hypot(*force.T)
    return float(np.median((to_disc * force).sum(axis=1) / np.maximum(lengths, 1e-12)))


def _other_frame(observations: Observations) -> Observations:
    tool = observations.frame is SensorFrame.TOOL
    return observations._replace(frame=SensorFrame.BASE if tool else SensorFrame.TOOL)
