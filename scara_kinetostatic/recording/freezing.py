"""A joint whose reading stands still although the joint gave way under the force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.kinematics import jacobian, rotate
from scara_kinetostatic.recording.signals import Topic

Floats = NDArray[np.float64]

BEFORE = 0.1
"""From this long before a contact on the joints must have moved, s."""
CERTAIN, PROBABLE = 50.0, 5.0
"""A joint that should give way by so many steps of its encoder does not stand still by chance: a motion of the
link may cancel what the joint gives way, to the step in one pose of so many. Fewer do where it happened before."""
OFTEN = 3
"""So many certain cases make the probable ones certain."""


def expected_moves(joints: Floats, force: Floats, cell: Cell) -> Floats:
    """How far each joint gives way under a force at nominal compliance, (2,), rad.

    Args:
        joints: Q, (2,), rad.
        force: F in the sensor's frame, of either sign, (2,), N.
        cell: nominal parameters and the sensor's frame.
    """
    p = cell.nominal
    if cell.sensor.frame is SensorFrame.TOOL:
        force = rotate(force, joints[0] + joints[1] + p.theta1 + p.theta2)
    moves: Floats = np.abs(jacobian(p, joints).T @ force) * (p.p1, p.p2)
    return moves


def stuck_joints(topic: Topic, contact: float, end: float, moves: Floats, steps: Floats) -> Floats:
    """By how many steps of its encoder each joint should have moved that reads the same all along.

    Args:
        topic: the joint angles.
        contact: when the contact begins, s.
        end: when the hold ends, s.
        moves: what each joint should have given way, (2,), rad.
        steps: of the encoders, (2,), rad.

    Returns:
        (2,); 0 for a joint whose reading changes from before the contact to the end of the hold.
    """
    readings = topic.value[topic.stretch(contact - BEFORE, end)]
    if len(readings) <= 5:
        return np.zeros(2)
    stuck = ~np.any(np.diff(readings, axis=0), axis=0)
    return np.where(stuck, moves / np.maximum(steps, 1e-12), 0.0)


def stuck_reasons(missed: Floats) -> list[str]:
    """Why each contact is to be rejected; empty where it is not.

    Args:
        missed: of `stuck_joints`, (n, 2).
    """
    often = (missed > CERTAIN).sum(axis=0) >= OFTEN
    stuck = missed > np.where(often, PROBABLE, CERTAIN)
    reason = 'the reading of joint {} is frozen: it stands still where the joint should give way by {:.0f} of its steps'
    return [
        reason.format(row.argmax() + 1, steps[row.argmax()]) if row.any() else ''
        for row, steps in zip(stuck, missed, strict=True)
    ]
