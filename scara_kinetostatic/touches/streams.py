"""What arrives: joint angles and forces with their stamps, as arrays, and the frame in which the forces are.

Joint states may come in parts, messages with some of the joints each, from several publishers; `JointParts` brings them
to common times. In the order of the stamps, a message with news of one angle after news of the other gives a sample at
its time: one angle was measured there, the other is interpolated between its neighbours. So there are as many samples
as of the slower joint, none bridges the silence of one, and each waits until both angles are known up to its time:
messages may come in bursts. A message with both angles is a sample as it came. Other joints, as of a lift, count as
they were last heard, for one second.

The forces are taken in the frame that `sensor.frame` states, the base or the tool. Its names in ROS are `NAMES`. Where
fixed transforms (`/tf_static`) connect the `frame_id` of a wrench with such a frame, the force is turned by them:

    f = R f_id,    R the rotation of the frame `frame_id` in that frame,

of which the two components in the plane are used. A sensor that is mounted with a turn, or upside down, so gives the
force in the frame stated. Only fixed transforms count: a sensor is mounted once. A recording holds the wrenches as they
came, and the transforms; each reader of forces, the collector and the reader of recordings, turns them once, by this
code. `sensor.base_frame` and `sensor.tool_frame` name the frames where a prefix or a driver calls them otherwise. A
`frame_id` that is neither known nor fixed to a known frame is said: nobody knows how the sensor is turned, unless the
cell states how it is mounted. A frame of a robot of which `robot.plane` is stated is not that of link 2, unless
`sensor.tool_frame` names it: there the transforms count for forces in the base, and those in the tool are taken as
`sensor.rotation` or `sensor.axes` say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import acos, degrees, isnan, nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.touches.clock import SECOND, TOLERANCE, Samples


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


ALTERNATE = 'the positions alternate: two publishers?'


def alternate(positions: Floats) -> bool:
    """Whether joint angles in the order of time, (n, 2), rad, jump back and forth between two motions.

    In a motion of one robot a step from sample to sample is followed by its like; with messages of another publisher
    in between many large steps are undone by the next large one.
    """
    if len(positions) < 3:
        return False
    steps = np.diff(positions[:, int(np.argmax(np.ptp(positions, axis=0)))])
    jumps = steps[np.abs(steps) > 5e-3]  # less may be noise, or the resolution of an encoder
    undone = int(np.sum(np.abs(jumps[1:] + jumps[:-1]) < 0.05 * np.abs(jumps[1:])))
    return undone >= max(6, 0.05 * len(positions))


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
        prefix: before the names of frames, where the node has one.
    """

    def __init__(self, cell: Cell, prefix: str = '') -> None:
        sensor, plane, base, tool = cell.sensor, cell.plane, *NAMES.values()
        self._stated, self._axes, self._prefix = sensor.frame, cell.force_axes, prefix.lstrip('/')
        self._plane = plane.axes.T if self._stated is SensorFrame.BASE else np.eye(3)
        if plane.is_stated:
            base, tool = (plane.frame,), ()
        named = [(name.lstrip('/'),) if name else usual for name, usual in zip(sensor[-2:], (base, tool), strict=True)]
        self._names: dict[SensorFrame, tuple[str, ...]] = dict(zip(NAMES, named, strict=True))
        self._is_mounted = bool(sensor.axes or sensor.rotation or not self._names[self._stated])
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
        """How a `frame_id` contradicts the cell description, or that it is not known; empty if neither, or without one.

        A frame that is not known does no harm where the cell description states how the sensor is mounted.
        """
        start = frame_id.lstrip('/')
        frame, name, _ = self._known_frame(start)
        if frame is self._stated or not start or (frame is None and self._is_mounted):
            return ''
        if frame is None:
            stated, known = self._stated.value, ', '.join(self._names[self._stated])
            like = [each for each in self._turns(start) if each.endswith(NAMES[self._stated])]
            named = f'{like[0]} if that is it' if like else f'its name, {start} where that is not turned against it'
            unknown = f'frame_id {frame_id!r} is no known frame ({known}), nor fixed to one on /tf_static'
            if name:
                unknown = f'frame_id {frame_id!r} is fixed to {name}, but {like[0]}, turned against it, is nearer'
            remedy = f'set sensor.{stated}_frame, the name of the {stated}, to {named}, or state sensor.rotation'
            return f'{unknown}; forces are taken as in the {stated}: {remedy}'
        how = f'is fixed to {name}' if name != start else f'is a frame of the {frame.value}'
        stated = f'the cell description states sensor.frame: {self._stated.value}'
        return f'frame_id {frame_id!r} {how}, but {stated}; one of them is wrong'

    def _known_frame(self, start: str) -> tuple[SensorFrame | None, str, Floats]:
        """The frame with a usual name that is fixed to one, its name and the rotation into it.

        That which the cell states counts before the other, a nearer one before one that is farther off. None, with the
        name: something nearer that is turned against it is called like a base; as of one of two arms in one world.
        """
        turns = self._turns(start)
        for frame in sorted(self._names, key=lambda frame: frame is not self._stated):
            for usual in (usuals := self._names[frame]):
                nearer = list[Floats]()  # of what may be the base of this arm, where none is named
                for name, turn in turns.items():
                    called = {name, name.rpartition('/')[2], name.removeprefix(self._prefix)}
                    if usual in called:
                        is_doubtful = any(not np.allclose(other, turn, rtol=0, atol=1e-9) for other in nearer)
                        return (None, name, turns[start]) if is_doubtful else (frame, name, turn)
                    if frame is self._stated is SensorFrame.BASE and len(usuals) > 1 and called.isdisjoint(usuals):
                        nearer += [turn] if name.endswith(usuals) else []
        return None, '', turns[start]

    def _turns(self, start: str) -> dict[str, Floats]:
        """The frames that are fixed to one, itself included, nearer ones first, with the rotation into each."""
        turns = {start: np.eye(3)}
        waiting = [start]
        for name in waiting:
            for neighbour, step in self._neighbours.get(name, {}).items():
                if neighbour not in turns:
                    turns[neighbour] = step @ turns[name]
                    waiting.append(neighbour)
        return turns


def _matrix(quaternion: Sequence[float]) -> Floats | None:
    """The rotation matrix of a quaternion x, y, z, w; None where it is no rotation."""
    length = float(np.linalg.norm(quaternion))
    if not (np.isfinite(length) and length > 0):
        return None
    x, y, z, w = np.asarray(quaternion) / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


_BOTH = 2
"""In place of the number of a joint, 0 or 1: the message has both."""
_NEVER = -(1 << 62)


class JointParts:
    """Brings the joint states of one topic, of which a message has some of the joints, to common times.

    Messages may be added one by one or many at once: the samples are the same.

    Args:
        names: of q1, q2 and the other joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._rows = Samples(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, len(names))))
        self._done = np.zeros(0, bool)  # which of these messages are behind the common time
        self._last = _BOTH, False  # joint of the latest of them, and whether it gave a sample
        self._heard, self._when = np.full(len(names) + 2, nan), np.zeros(0, np.int64)

    @property
    def awaited(self) -> str:
        """Names of q1 and q2; of one alone where the other has been heard of."""
        unheard = [name for name, at in zip(self._names, self._heard[:2].tolist(), strict=False) if isnan(at)]
        return ' and '.join(unheard or self._names[:2])

    def add(self, new: Samples) -> tuple[Samples, dict[str, int]]:
        """One or more messages.

        Args:
            new: in the order in which they came, (n, 2 + h), NaN where a message does not have that joint.

        Returns:
            The samples that they complete, each with the times of one message, and how many messages are of no use, by
            reason. Where a joint is not stamped, no sample is.
        """
        rows = Samples(*(np.concatenate(both) for both in zip(self._rows, new, strict=True)))
        angle, kept = ~np.isnan(rows.values[:, :2]), len(self._done)
        stamped = all(2 * np.count_nonzero(rows.stamp[column]) >= column.sum() for column in angle.T)
        time = rows.stamp if stamped else rows.log_time
        rows.values[kept:, 2:], good, problems = self._checked(new, (time - rows.log_time)[kept:])
        used = np.append(np.ones(kept, bool), good)
        done = np.append(self._done, np.zeros(len(good), bool))[used]
        rows, angle, time = rows.select(used), angle[used], time[used]
        place = np.maximum.accumulate(np.where(angle, np.arange(len(time))[:, None], -1), axis=0)
        common = np.where(place < 0, _NEVER, time[place])[kept:].min(axis=1).max(initial=_NEVER)
        which, order = np.where(angle.all(axis=1), _BOTH, angle[:, 1]), np.argsort(time, kind='stable')
        due = order[(((time <= common) | (which == _BOTH)) & ~done)[order]]
        samples = self._samples(rows, time, order, due[self._give_samples(which[due])])
        done[due] = True
        since = min([int(time[done & column][-1]) if (done & column).any() else _NEVER for column in angle.T])
        later: Mask = time >= since
        self._rows, self._done = rows.select(later), done[later]
        return samples if stamped else samples._replace(stamp=np.zeros_like(samples.stamp)), problems

    def _checked(self, new: Samples, lag: NDArray[np.int64]) -> tuple[Floats, Mask, dict[str, int]]:
        """Positions of the other joints as last heard; which messages can be used; how many cannot, by reason."""
        angle = ~np.isnan(new.values[:, :2])
        columns = np.column_stack([new.values, np.where(angle, lag[:, None], nan)])
        place = np.where(np.isnan(columns), -1, np.arange(len(columns))[:, None])
        place = np.maximum.accumulate(place, axis=0)
        heard = np.where(place < 0, self._heard, np.take_along_axis(columns, place, axis=0))
        when = np.where(place < 0, self._when if len(self._when) else new.log_time[0], new.log_time[place])
        self._heard, self._when = heard[-1], when[-1]
        pause, apart = new.log_time[:, None] - when, np.abs(heard[:, -1] - heard[:, -2])
        silent = (pause[:, :2] > SECOND) & angle[:, ::-1] & ~angle  # while the other one speaks
        slow = pause[:, :2].sum(axis=1)  # of a clock that runs slower, as a simulated one, the lag changes by as much
        differ = (angle.sum(axis=1) == 1) & ~silent.any(axis=1) & (apart > TOLERANCE + slow)
        problems = {f'{name} is silent': int(n) for name, n in zip(self._names, silent.sum(axis=0), strict=False) if n}
        if differ.any():
            how = f'{" and ".join(self._names[:2])} differ by {np.median(apart[differ]) / SECOND:.1g} s'
            problems[f'the clocks of {how}, or one comes late'] = int(differ.sum())
        others = np.where(pause > SECOND, nan, heard)[:, 2:-2]
        return others, angle.any(axis=1) & ~silent.any(axis=1) & ~differ, problems

    def _give_samples(self, joint: NDArray[np.int64]) -> Mask:
        """Which of these messages, in the order of time, have news of one joint after news of the other."""
        changes = np.append(self._last[1], np.append(self._last[0], joint[:-1]) + joint == 1)
        at = np.arange(len(changes))
        second = changes & ((at - np.maximum.accumulate(np.where(changes, -1, at))) % 2 == 1)  # every other one in turn
        self._last = (int(joint[-1]), bool(second[-1])) if len(joint) else self._last
        return np.asarray(second[1:] | (joint == _BOTH))

    @staticmethod
    def _samples(rows: Samples, time: NDArray[np.int64], order: Indices, due: Indices) -> Samples:
        """At the times of some messages; an angle that one does not have is interpolated, but not over a second."""
        found, when = rows.select(due), time[due]
        for k in (0, 1) if len(due) else ():
            mine = order[~np.isnan(rows.values[order, k])]
            known, after = time[mine], np.searchsorted(time[mine], when).clip(max=len(mine) - 1)
            between = np.interp(when - known[0], known - known[0], rows.values[mine, k], left=nan, right=nan)
            between[known[after] - known[np.maximum(after - 1, 0)] > SECOND] = nan
            found.values[:, k] = np.where(np.isnan(found.values[:, k]), between, found.values[:, k])
        found = found.select(np.flatnonzero(np.isfinite(found.values[:, 0] + found.values[:, 1])))
        return found.select(np.argsort(found.log_time, kind='stable'))
