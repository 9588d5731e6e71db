"""The sense of the last motion of the joints, which effects such as hysteresis depend on, from a stream of angles."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model.arrays import Floats

_MOVED = 1e-4
"""Movement of a joint that counts as its last one, rad: above the noise of its angle."""


class MotionSense:
    """The sense in which each joint has moved last, pose after pose; 0 before its first motion."""

    def __init__(self) -> None:
        self._references = [0.0, 0.0]
        self._sense = [0.0, 0.0]
        self._begun = False

    def note(self, first: float, second: float) -> tuple[float, float]:
        """The senses after the next pose, -1, 0 or 1 each.

        Args:
            first: angle of joint 1, rad.
            second: of joint 2.
        """
        angles = (first, second)
        if not self._begun:
            self._references, self._begun = list(angles), True
        for joint, angle in enumerate(angles):
            moved = angle - self._references[joint]
            if abs(moved) > _MOVED:
                self._references[joint], self._sense[joint] = angle, 1.0 if moved > 0 else -1.0
        return self._sense[0], self._sense[1]


def motion_senses(joints: Floats) -> Floats:
    """The senses at each of n poses that follow each other, (n, 2): -1, 0 or 1.

    Args:
        joints: Q, (n, 2), rad.
    """
    sense = MotionSense()
    return np.array([sense.note(*pair) for pair in joints.tolist()]).reshape(-1, 2)
