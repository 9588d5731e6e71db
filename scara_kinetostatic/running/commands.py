"""Commands to the robot's joints: short pieces of a track, checked at the one place where they are made.

A command says where the joints are to be at some times from now on, `AHEAD` at most, and replaces the one before. Where
no further one comes, the robot stands at its end. The joints of a command are those of the cell, then the lift, then
the held ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import Parameters

AHEAD = 0.2
"""No motion is commanded farther ahead, s."""
AHEAD_OF_CONTACT = 0.1
"""The same towards a contact and in it, s."""
PERIOD = 0.02
"""Time between two commands, s."""
ACCELERATION = 0.5
"""Of the tip at the ends of a track and at its corners, m/s²."""
_CORNER = 0.02
"""Speed at a corner, m/s: with a lag of 50 ms the tip cuts it by less than 1 mm."""
_POINTS = 4
"""Points of a command."""
_TWICE = 0.05
"""Angle that counts as much as a metre of the way, rad/m: far less than the joints turn on it."""
_FASTER = 1.25
"""What a commanded speed may exceed the wanted one by: the model of the arm is not exact."""


class Command(NamedTuple):
    """Positions of the joints to come.

    Attributes:
        names: of the joints.
        times: from now on, (k,), s.
        positions: readings at these times, (k, j), rad and m.
    """

    names: tuple[str, ...]
    times: Floats
    positions: Floats


class Fault(Exception):  # noqa: N818
    """Why the robot has to stop, one sentence.

    Args:
        reason: the sentence.
        may_retract: whether the robot may go back along the way it came.
    """

    def __init__(self, reason: str, *, may_retract: bool = True) -> None:
        super().__init__(reason)
        self.may_retract = may_retract


class Track(NamedTuple):
    """A way of the joints through given points, straight between them.

    Attributes:
        joints: Q, (n, 2), rad.
        lift: its position, (n,), m; 0 without one.
        at: length of the way to each, (n,), m.
        corners: lengths at which the direction changes, first and last point included, (c,), m.
    """

    joints: Floats
    lift: Floats
    at: Floats
    corners: Floats

    @classmethod
    def of(cls, joints: Floats, lift: Floats, parameters: Parameters) -> Track:
        """The way through n points.

        Its length is that of the tip, or of a joint's turn at the length of link 2, or of the lift, whatever is
        longest: near the straight arm the joints turn fast while the tip hardly moves.

        Args:
            joints: Q, (n, 2), rad.
            lift: its position, (n,), m.
            parameters: of the arm.
        """
        moved = np.hypot(*np.diff(forward(parameters, joints), axis=0).T)
        turned = parameters.l2 * np.abs(np.diff(joints, axis=0)).max(axis=1)
        step = np.maximum.reduce([moved, turned, np.abs(np.diff(lift))])
        keep = np.append(True, step > 1e-9)
        joints, lift, at = joints[keep], lift[keep], np.append(0.0, np.cumsum(step[step > 1e-9]))
        steps = np.column_stack([np.diff(joints, axis=0), np.diff(lift)])
        units = steps / np.linalg.norm(steps, axis=1)[:, None]
        turns = (units[1:] * units[:-1]).sum(axis=1) < np.cos(0.15)
        return cls(joints, lift, at, np.concatenate([[0.0], at[1:-1][turns], at[-1:]]))

    @property
    def length(self) -> float:
        """Of the whole way, m."""
        return float(self.at[-1])

    def place(self, at: Floats) -> tuple[Floats, Floats]:
        """Q, (k, 2), and lift, (k,), at lengths (k,)."""
        q1, q2 = (np.interp(at, self.at, column) for column in self.joints.T)
        return np.stack([q1, q2], axis=-1), np.interp(at, self.at, self.lift)

    def nearest(self, joints: Floats, lift: float | None, at: float) -> tuple[float, float]:
        """Length of the way to where it comes nearest to Q, (2,), rad, and lift, m, and how far the joints are off.

        Where it comes there twice, as it turns back, the place next to `at`, m, counts.
        """
        every = np.column_stack([self.joints, self.lift])
        if len(every) == 1:  # it begins where it ends
            return 0.0, float(np.abs(joints - self.joints[0]).max())
        here = np.append(joints, self.lift[0] if lift is None else lift)
        along = np.diff(every, axis=0)
        part = ((here - every[:-1]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-18)
        part = np.minimum(np.maximum(part, 0.0), 1.0)
        off = every[:-1] + part[:, None] * along - here
        lengths = self.at[:-1] + part * np.diff(self.at)
        k = int(np.argmin((off**2).sum(axis=1) + (_TWICE * (lengths - at)) ** 2))
        return float(lengths[k]), float(np.abs(off[k]).max())


class Motion:
    """Runs along a track; it can turn round and stop anywhere.

    Args:
        track: the way.
        speed: of the tip, m/s.
        at: where it begins, m.
        ramps: whether it starts and stops, and passes corners, with `ACCELERATION`; slow ones need not.

    Attributes:
        at: where it is, m.
        speed: as given.
    """

    def __init__(self, track: Track, speed: float, at: float = 0.0, *, ramps: bool = True) -> None:
        self.track, self.at, self.speed = track, at, speed
        self._now, self._ramps = 0.0, ramps

    def advance(self, elapsed: float, goal: float) -> None:
        """Goes on for some time towards a length of the track."""
        self.at, self._now = self._after(self.at, self._now, elapsed, goal)

    def points(self, ahead: float, goal: float) -> tuple[Floats, Floats, Floats]:
        """Times, Q and lift of the motion to come."""
        times, lengths = ahead * np.arange(1, _POINTS + 1) / _POINTS, []
        at, now = self.at, self._now
        for _ in times:
            at, now = self._after(at, now, ahead / _POINTS, goal)
            lengths.append(at)
        return (times, *self.track.place(np.array(lengths)))

    def _after(self, at: float, now: float, elapsed: float, goal: float) -> tuple[float, float]:
        """Length and speed after some time."""
        left = goal - at
        speed = self.speed
        if self._ramps:
            corner = np.append(self.track.corners, goal)
            ahead = (corner - at) * np.sign(left)
            near = float(np.min(ahead[ahead > 1e-6], initial=abs(left)))
            behind = float(np.min(-ahead[ahead <= 1e-6], initial=1.0))
            slow = [np.sqrt(_CORNER**2 + 2 * ACCELERATION * d) for d in (near, behind)]
            speed = min(speed, now + ACCELERATION * elapsed, *slow)
            speed = max(speed, min(self.speed, _CORNER))
        step = min(speed * elapsed, abs(left))
        return at + float(np.copysign(step, left)), 0.0 if step == abs(left) else speed


class Commander:
    """Makes the commands.

    Args:
        cell: with the limits of the joints and the speeds.

    Attributes:
        joints: Q commanded last, (2,), rad; None before the first command.
        lift: position commanded last, m.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._limits = np.array(cell.limits).T
        lift = () if cell.lift is None else (cell.lift.joint,)
        self._names = (*cell.joint_names, *lift, *cell.hold)
        self.joints: Floats | None = None
        self.lift = 0.0 if cell.lift is None else cell.lift.down

    def command(self, at: tuple[Floats, float], points: tuple[Floats, Floats, Floats]) -> Command:
        """Checks where the joints are to be, and says it.

        Args:
            at: Q and lift that hold now.
            points: times, Q and lift to come.

        Raises:
            Fault: a point is beyond the limits of a joint, too far ahead, or too fast.
        """
        times, joints, lift = points
        if not np.isfinite(joints).all() or not ((joints >= self._limits[0]) & (joints <= self._limits[1])).all():
            raise Fault('a motion beyond the limits of the joints was planned; nothing was commanded')
        if times[-1] > AHEAD + 1e-9:
            raise Fault('a motion too far ahead was planned; nothing was commanded')
        tip = forward(self._cell.nominal, np.vstack([at[0], joints]))
        speed = np.hypot(*np.diff(tip, axis=0).T) / np.diff(np.append(0.0, times))
        if speed.max() > _FASTER * self._cell.touch.speed:
            raise Fault(f'a motion of {1e3 * speed.max():.0f} mm/s was planned; nothing was commanded')
        self.joints, self.lift = at[0], float(at[1])
        lifts = [lift[:, None]] if self._cell.lift is not None else []
        held = np.tile(list(self._cell.hold.values()), (len(times), 1))
        return Command(self._names, times, np.hstack([self._cell.readings(joints), *lifts, held]))
