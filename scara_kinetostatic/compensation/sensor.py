"""The true force behind what the force sensor reports: the errors of the sensor that the calibration found removed."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.sensor_error import true_force


def force_on_object(
    arm: CalibratedArm, reported: Floats, joints: Floats, metadata: TouchMetadata | None = None
) -> Floats:
    """F in the base frame, (n, 2), N; NaN where no true force gives what was reported.

    Args:
        arm: with the errors of its sensor: those within declared uncertainties, and effects.
        reported: on the object, in the sensor's frame, (n, 2), N.
        joints: Q, (n, 2), rad.
        metadata: of the poses; None for nothing known.
    """
    turned = rotate(reported, np.full(len(reported), -arm.sensor.rotation)) / (1 + arm.sensor.gain)
    force = true_force(arm.model, turned, metadata)
    return force if arm.cell.sensor.frame is SensorFrame.BASE else rotate(force, _tool_angle(arm, joints))


def in_sensor_frame(arm: CalibratedArm, force: Floats, joints: Floats) -> Floats:
    """Forces (n, 2) in the base frame, in that of the sensor."""
    return force if arm.cell.sensor.frame is SensorFrame.BASE else rotate(force, -_tool_angle(arm, joints))


def _tool_angle(arm: CalibratedArm, joints: Floats) -> Floats:
    """Angle of the tool frame, (n,), rad."""
    p = arm.model.parameters
    return np.asarray(joints.sum(axis=1) + p.theta1 + p.theta2)
