"""Whether the `frame_id` of the wrenches agrees with the frame that the cell description states; no ROS in here.

The forces are taken in the frame that the cell description states, and recordings hold them as they came. A `frame_id`
speaks of the same frame where its name is one of ROS-Industrial's for it, or where the fixed transforms on `/tf_static`
connect it with such a frame without a turn. Only fixed transforms count: a sensor is mounted once.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, degrees

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SensorFrame

NAMES = {
    SensorFrame.BASE: ('base_link', 'base', 'world'),
    SensorFrame.TOOL: ('tool0', 'tool', 'flange', 'tcp'),
}
"""Usual names of both frames, without what a prefix puts before the last slash; the first is that of the URDF."""
LARGEST_TURN = 1e-3
"""A larger turn of the sensor against the frame is reported, rad."""


class WrenchFrame:
    """Compares `frame_id` with the cell description.

    Args:
        stated: frame that the cell description states.
    """

    def __init__(self, stated: SensorFrame) -> None:
        self._stated = stated
        self._neighbours: dict[str, dict[str, Floats]] = {}

    def add_fixed(self, parent: str, child: str, quaternion: Sequence[float]) -> None:
        """Notes a fixed transform.

        Args:
            parent: frame.
            child: frame.
            quaternion: x, y, z, w of the rotation of the child in the parent.
        """
        turn = _matrix(quaternion)
        parent, child = parent.lstrip('/'), child.lstrip('/')
        self._neighbours.setdefault(parent, {})[child] = turn
        self._neighbours.setdefault(child, {})[parent] = turn.T

    def complaint(self, frame_id: str) -> str:
        """How a `frame_id` contradicts the cell description; empty if it does not, or if nothing is known of it."""
        found = self._known_frame(frame_id.lstrip('/'))
        if found is None:
            return ''
        frame, name, turn = found
        if frame is not self._stated:
            how = f'is fixed to {name}' if name != frame_id.lstrip('/') else f'is a frame of the {frame.value}'
            stated = f'the cell description states sensor.frame: {self._stated.value}'
            return f'frame_id {frame_id!r} {how}, but {stated}; one of them is wrong'
        angle = acos(min(1.0, max(-1.0, (float(np.trace(turn)) - 1) / 2)))
        if angle <= LARGEST_TURN:
            return ''
        turned = f'frame_id {frame_id!r} is turned by {degrees(angle):.3g} degrees against {name}'
        return f'{turned}, which is not corrected; publish the wrench in {name}'

    def _known_frame(self, start: str) -> tuple[SensorFrame, str, Floats] | None:
        """The nearest frame with a usual name that is fixed to one: which it is, its name, the rotation to it."""
        waiting, seen = [(start, np.eye(3))], {start}
        for name, turn in waiting:
            for frame, names in NAMES.items():
                if name.rpartition('/')[2] in names:
                    return frame, name, turn
            for neighbour, step in self._neighbours.get(name, {}).items():
                if neighbour not in seen:
                    seen.add(neighbour)
                    waiting.append((neighbour, turn @ step))
        return None


def _matrix(quaternion: Sequence[float]) -> Floats:
    """The rotation matrix of a quaternion x, y, z, w; the identity where it is no rotation."""
    q = np.asarray(quaternion, dtype=float)
    length = float(np.linalg.norm(q))
    if not (np.isfinite(length) and length > 0):
        return np.eye(3)
    x, y, z, w = q / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
