"""What arrives: joint angles and forces with their stamps, as arrays, and the frame in which the forces are.

Joint states may come from several publishers, messages with some of the joints each. q1 and q2 have to be in one; the
other joints, as of a lift, count as they were last heard, for one second (`JointParts`).

The forces are taken in the frame that `sensor.frame` states, the base or the tool. Its names in ROS are `NAMES`. Where
fixed transforms (`/tf_static`) connect the `frame_id` of a wrench with such a frame, the force is turned by them:

    f = R f_id,    R the rotation of the frame `frame_id` in that frame,

of which the two components in the plane are used. A sensor that is mounted with a turn, or upside down, so gives the
force in the frame stated. Only fixed transforms count: a sensor is mounted once. A recording holds the wrenches as they
came, and the transforms; each reader of forces, the collector and the reader of recordings, turns them once, by this
code. A frame of a robot of which `robot.plane` is stated is not that of link 2, whatever its name: there the transforms
count for forces in the base, and those in the tool are taken as `sensor.rotation` or `sensor.axes` say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import acos, degrees, isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.touches.clock import SECOND


@dataclass(frozen=True)
class JointStream:
    """Joint angles as they came, but for a coupling of the joints (`Cell.angles`).

    Attributes:
        stamp: header stamps, (n,), ns.
        position: q1, q2, (n, 2), rad.
        others: of the cell's other joints, (n, h), rad or m, NaN where a message has none; None where there are none.
    """

    stamp: NDArray[np.int64]
    position: Floats
    others: Floats | None = None

    @classmethod
    def of(cls, stamp: NDArray[np.int64], values: Floats) -> JointStream:
        """From rows of q1, q2 and the other joints, (n, 2 + h)."""
        return cls(stamp, values[:, :2], values[:, 2:])

    def moved(self, cell: Cell) -> Mask:
        """In which samples another joint is not where the cell holds it, (n,)."""
        none = np.zeros(len(self.stamp), dtype=bool)
        return none if self.others is None else none | cell.moved(self.others).any(axis=1)

    def while_held(self, cell: Cell) -> JointStream:
        """The other samples."""
        kept = ~self.moved(cell)
        return self if kept.all() else JointStream(self.stamp[kept], self.position[kept])


@dataclass(frozen=True)
class WrenchStream:
    """Forces as they came: sign, frame and zero are still the sensor's.

    Attributes:
        stamp: header stamps, (n,), ns.
        force: fx, fy, (n, 2), N.
    """

    stamp: NDArray[np.int64]
    force: Floats


@dataclass(frozen=True)
class Streams:
    """Both streams of one recording.

    Attributes:
        source: the file or topic pair they come from, for messages.
        joints: joint angles.
        wrench: forces.
        warnings: what was dropped or mended on reading, one sentence each.
        topics: the names of both, where they are not those of the cell description.
        discarded: touches that were discarded while recording, each by a stamp within its hold, ns.
        turned: how the forces were turned by their `frame_id`; empty where they were not.
        force_ranges: of fx, fy and fz as they came, without spikes, (3,), N; None where turned or unknown.
    """

    source: str
    joints: JointStream
    wrench: WrenchStream
    warnings: tuple[str, ...] = field(default=())
    topics: tuple[str, str] | None = None
    discarded: tuple[int, ...] = ()
    turned: str = ''
    force_ranges: Floats | None = None


NAMES = {SensorFrame.BASE: ('base_link', 'base', 'world'), SensorFrame.TOOL: ('tool0', 'tool', 'flange', 'tcp')}
"""Usual names of both frames, without what a prefix puts before the last slash; the first is that of the URDF, and an
earlier one counts where several are connected."""


class FixedTransform(NamedTuple):
    """A transform that does not change.

    Attributes:
        parent: frame.
        child: frame.
        quaternion: x, y, z, w of the rotation of the child in the parent.
    """

    parent: str
    child: str
    quaternion: tuple[float, float, float, float]


class WrenchFrame:
    """What the `frame_id` of wrenches says, beside the cell description.

    Args:
        cell: whose sensor it is.
    """

    def __init__(self, cell: Cell) -> None:
        self._stated, self._axes, plane = cell.sensor.frame, cell.force_axes, cell.plane
        self._plane, self._names = plane.axes.T if self._stated is SensorFrame.BASE else np.eye(3), NAMES
        if plane.is_stated:
            self._names = {SensorFrame.BASE: (plane.frame,), SensorFrame.TOOL: ()}
        self._neighbours: dict[str, dict[str, Floats]] = {}

    def add(self, transform: FixedTransform) -> None:
        """Notes a fixed transform; a later one between the same frames replaces it. One without a rotation is none."""
        turn = _matrix(transform.quaternion)
        if turn is None:
            return
        parent, child = transform.parent.lstrip('/'), transform.child.lstrip('/')
        self._neighbours.setdefault(parent, {})[child] = turn.T
        self._neighbours.setdefault(child, {})[parent] = turn

    def turn(self, frame_id: str) -> Floats | None:
        """How wrenches with a `frame_id` give the force in the plane, (2, 3); None: they are taken as they come."""
        start = frame_id.lstrip('/')
        frame, name, turn = self._known_frame(start)
        axes = self._plane[:2] @ turn if frame is self._stated and name != start else self._axes
        return None if np.allclose(axes, np.eye(3)[:2], rtol=0, atol=1e-9) else axes

    def description(self, frame_id: str) -> str:
        """How the forces are turned, in words; empty where they are not."""
        _, name, turn = self._known_frame(frame_id.lstrip('/'))
        if (axes := self.turn(frame_id)) is None:
            return ''
        if axes is self._axes:
            return 'forces turned into the plane as the cell description states'
        angle = degrees(acos(min(1.0, max(-1.0, (float(np.trace(turn)) - 1) / 2))))
        return f'forces turned by {angle:.3g} degrees from {frame_id} into {name}'

    def complaint(self, frame_id: str) -> str:
        """How a `frame_id` contradicts the cell description; empty if it does not, or if nothing is known of it."""
        start = frame_id.lstrip('/')
        frame, name, _ = self._known_frame(start)
        if frame is None or frame is self._stated:
            return ''
        how = f'is fixed to {name}' if name != start else f'is a frame of the {frame.value}'
        stated = f'the cell description states sensor.frame: {self._stated.value}'
        return f'frame_id {frame_id!r} {how}, but {stated}; one of them is wrong'

    def _known_frame(self, start: str) -> tuple[SensorFrame | None, str, Floats]:
        """The frame with a usual name that is fixed to one, its name and the rotation into it.

        That which the cell states counts before the other, a nearer one before one that is farther off.
        """
        turns = {start: np.eye(3)}
        waiting = [start]
        for name in waiting:
            for neighbour, step in self._neighbours.get(name, {}).items():
                if neighbour not in turns:
                    turns[neighbour] = step @ turns[name]
                    waiting.append(neighbour)
        for frame in sorted(self._names, key=lambda frame: frame is not self._stated):
            for usual in self._names[frame]:
                for name, turn in turns.items():
                    if name.rpartition('/')[2] == usual:
                        return frame, name, turn
        return None, '', turns[start]


def _matrix(quaternion: Sequence[float]) -> Floats | None:
    """The rotation matrix of a quaternion x, y, z, w; None where it is no rotation."""
    length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(length) and length > 0):
        return None
    x, y, z, w = np.asarray(quaternion) / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


class UnjoinedError(Exception):
    """A message with one of q1 and q2 alone."""


class JointParts:
    """Adds to joint states what other messages of their topic say of the other joints.

    Args:
        names: of q1, q2 and the other joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._others = [(0, nan)] * (len(names) - 2)  # when it was received, ns, and the position

    def add(self, stamp: int, received: int, values: Sequence[float]) -> tuple[int, int, list[float]] | None:
        """One message.

        Args:
            stamp: of its header, ns.
            received: when it came, ns.
            values: q1, q2, rad, and the other joints; NaN where the message has none.

        Returns:
            Stamp of the sample, when it was received, ns, and its values; None where the message has other joints
            alone.

        Raises:
            UnjoinedError: it has one of q1 and q2 alone.
        """
        news = zip(self._others, values[2:], strict=True)
        self._others = [old if isnan(new) else (received, new) for old, new in news]
        absent = sum(map(isnan, values[:2]))
        if absent == 1:
            raise UnjoinedError(f'{" and ".join(self._names[:2])} are not in one message')
        others = [nan if received - heard > SECOND else position for heard, position in self._others]
        return None if absent else (stamp, received, [*values[:2], *others])
