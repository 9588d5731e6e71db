"""The robot as the runner commands it, and as it hears it.

**Commands.** A command says where the joints are to be at some times from now on, and how fast, and replaces the one
before. It ends at rest: where no further one comes, the robot stands there. One command is a whole way through free
space; towards a contact and in it, it ends within `AHEAD_OF_CONTACT`. The joints of a command are those of the cell,
then the lift, then the held ones.

**Senses.** The force is the median of the last three readings less the zero, which is taken anew while the tip stands
free. All times are of the runner's clock, s; stamps only tell whether messages come late.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from itertools import islice
from math import dist, hypot
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import MICRO, MILLI, Parameters
from scara_kinetostatic.simulation.plan import ROUNDING

AHEAD_OF_CONTACT = 0.1
"""No motion is commanded farther ahead towards a contact and in it, s."""
PERIOD = 0.02
"""After twice this time without a tick nobody has listened, s."""
ACCELERATION = 1.5
"""Of the tip at the ends of a track and at its corners, m/s²."""
_CORNER = 0.02
"""Speed at a corner, m/s: with a lag of 50 ms the tip cuts it by less than 1 mm; a blunt one is passed faster."""
_APART = 0.025
"""Time between two points of a command, s."""
_TWICE = 0.05
"""Angle that counts as much as a metre of the way, rad/m: far less than the joints turn on it."""
_FASTER = 1.25
"""What a commanded speed may exceed the wanted one by: the model of the arm is not exact."""
_BEND = 0.15
"""Corners are where the way turns by more, rad."""
LIFT_SPEED = 0.05
"""Of the lift, m/s."""
_OFF_TRACK, OFF_APPROACH = 0.02, 2 * MILLI
"""How far the joints may be off their way in travel and towards a contact, rad."""
_LATE, _BEHIND = 0.15, 2e-4
"""How far the robot may be behind, s and m together; farther, its way waits for it."""
_STANDS, _MOVED = 0.25, 5e-5
"""A robot that is behind and comes less far in such a time stands, s and m."""
_FOLLOWS = 1 / 3
"""A robot that for `_LATE` comes less than such a part of its way is behind, too, and gets no further message: at each
one a controller whose time is scaled by 0 moves on.
"""
_ARRIVED = MILLI
"""The same at the end of a way, m."""
LATEST = 0.05
"""A reading that is not older is that of now; the robot stops within this time, s."""


class Command(NamedTuple):
    """Motion of the joints to come.

    Attributes:
        names: of the joints.
        times: from now on, (k,), s.
        positions: readings at these times, (k, j), rad and m.
        velocities: their rates then, (k, j), rad/s and m/s, 0 at the end; (k, 0) where it is straight between the
            points: a spline would swing beyond the place where it stops.
    """

    names: tuple[str, ...]
    times: Floats
    positions: Floats
    velocities: Floats


class Fault(Exception):  # noqa: N818
    """Why the robot has to stop, one sentence.

    Args:
        reason: the sentence.
        may_retract: whether the robot may go back along the way it came.
        passes: whether the cause may pass by itself, so that it pays to wait.
    """

    def __init__(self, reason: str, *, may_retract: bool = True, passes: bool = False) -> None:
        super().__init__(reason)
        self.may_retract, self.passes = may_retract, passes


class Track(NamedTuple):
    """A way of the joints through given places, straight between them.

    Attributes:
        places: Q, rad, and the position of the lift, m, 0 without one, (n, 3).
        at: length of the way to each, (n,), m.
        corners: lengths at which the direction changes, first and last point included, (c,), m.
        slow: speed there, (c,), m/s.
    """

    places: Floats
    at: Floats
    corners: Floats
    slow: Floats

    @classmethod
    def of(cls, places: Floats, parameters: Parameters, lift_weight: float = 1.0) -> Track:
        """The way through n places.

        Its length is that of the tip, or of a joint's turn at the length of link 2, or of the lift, whatever is
        longest: near the straight arm the joints turn fast while the tip hardly moves.

        Args:
            places: Q, rad, and the position of the lift, m, (n, 3).
            parameters: of the arm.
            lift_weight: length per length of the lift: where it may only move that much slower.
        """
        moved = np.hypot(*np.diff(forward(parameters, places[:, :2]), axis=0).T)
        every = np.abs(np.diff(places, axis=0)) * (parameters.l2, parameters.l2, lift_weight)
        step = np.maximum(moved, every.max(axis=1))
        places, at = places[np.append(True, step > ROUNDING)], np.append(0.0, np.cumsum(step[step > ROUNDING]))
        steps = np.diff(places, axis=0)
        units = steps / np.linalg.norm(steps, axis=1)[:, None]
        turn = np.arccos(np.clip((units[1:] * units[:-1]).sum(axis=1), -1.0, 1.0))
        is_corner = turn > _BEND
        slow = _CORNER / np.minimum(2 * np.sin(turn[is_corner] / 2), 1.0)
        corners = np.concatenate([[0.0], at[1:-1][is_corner], at[-1:]])
        return cls(places, at, corners, np.pad(slow, 1, constant_values=_CORNER))

    @property
    def length(self) -> float:
        """Of the whole way, m."""
        return float(self.at[-1])

    def place(self, at: Floats | float) -> Floats:
        """Q, rad, and lift, m, at lengths (k,) or one, (k, 3) or (3,)."""
        return np.stack([np.interp(at, self.at, column) for column in self.places.T], axis=-1)

    def nearest(self, place: Floats, at: float) -> tuple[float, float]:
        """Length of the way to where it comes nearest to Q, rad, and lift, m, NaN where it is not known, (3,), and how
        far the joints are off.

        Where it comes there twice, as it turns back, the place next to `at`, m, counts.
        """
        every, here = self.places, np.where(np.isnan(place), self.places[0], place)
        if len(every) == 1:  # it begins where it ends
            return 0.0, float(np.abs(here - every[0])[:2].max())
        along = np.diff(every, axis=0)
        part = ((here - every[:-1]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), ROUNDING**2)
        part = np.minimum(np.maximum(part, 0.0), 1.0)
        off = every[:-1] + part[:, None] * along - here
        lengths = self.at[:-1] + part * np.diff(self.at)
        k = int(np.argmin((off**2).sum(axis=1) + (_TWICE * (lengths - at)) ** 2))
        return float(lengths[k]), float(np.abs(off[k]).max())


NEVER = (np.inf, 0.0)
"""Where a motion is slower, see `Traversal`."""


class Traversal:
    """A motion along a track; it can turn round and stop anywhere.

    Args:
        track: the way.
        speed: of the tip, m/s.
        at: where it begins, m.
        ramps: whether it starts and stops, and passes corners, with `ACCELERATION`; slow ones need not.
        slow: length from which on it is slower, m, and the speed there, m/s.

    Attributes:
        at: where it is, m.
        sent: to where it is commanded, m; None before the first command.
        followed: where it was, and the robot next to it, m, when that was last seen to follow, s; None before.
    """

    def __init__(
        self, track: Track, speed: float, at: float = 0.0, *, ramps: bool = True, slow: tuple[float, float] = NEVER
    ) -> None:
        self.track, self.at = track, at
        self.sent: float | None = None
        self.followed: tuple[float, float, float] | None = None
        self._speed, self._now, self._ramps, self._slow = speed, 0.0, ramps, slow

    @property
    def place(self) -> Floats:
        """Q, rad, and the lift, m, where it is, (3,)."""
        return self.track.place(self.at)

    @property
    def speed(self) -> float:
        """Largest speed where it is, m/s."""
        return self.speed_at(self.at)

    def speed_at(self, at: float) -> float:
        """Largest speed at a length of the track, m/s."""
        return self._slow[1] if at > self._slow[0] else self._speed

    def even(self, at: float, goal: float) -> float:
        """How far from a length of the track towards another its largest speed stays as it is, m."""
        return self._slow[0] if (at - self._slow[0]) * (goal - self._slow[0]) < 0 else goal

    def advance(self, elapsed: float) -> None:
        """Goes on for some time, to where it is commanded at most."""
        while self.sent is not None and self.at != self.sent and elapsed > 0:
            self.at, self._now = self._after(self.at, self._now, min(elapsed, PERIOD), self.sent)
            elapsed -= PERIOD

    def points(self, goal: float, ahead: float = np.inf) -> tuple[Floats, Floats]:
        """Times and places of the motion to come, to a length of the track; or one point, where it is after so long.

        At each message a controller that scales the time, be it by 0, goes on by a part of the way to the first point.
        """
        lengths, at, now = list[float](), self.at, self._now
        while not lengths or (at != goal and len(lengths) * _APART < ahead - ROUNDING):
            at, now = self._after(at, now, _APART, goal)
            lengths.append(at)
        self.sent, first = at, 0 if np.isinf(ahead) else len(lengths) - 1
        return _APART * np.arange(first + 1.0, len(lengths) + 1), self.track.place(np.array(lengths[first:]))

    def _after(self, at: float, now: float, elapsed: float, goal: float) -> tuple[float, float]:
        """Length and speed after some time."""
        left = goal - at
        speed = most = self.speed_at(at + ROUNDING * np.sign(left))
        within = self.even(at, goal) - at
        if self._ramps:
            ahead = (np.append(self.track.corners, goal) - at) * np.sign(left)
            there = np.append(self.track.slow, _CORNER)
            near, behind = ahead > MICRO, (ahead <= MICRO) & (ahead > -1.0)
            limits = np.sqrt(there**2 + 2 * ACCELERATION * np.abs(ahead))[near | behind]
            speed = min(most, now + ACCELERATION * elapsed, float(limits.min(initial=np.inf)))
            speed = max(speed, min(most, _CORNER))
        step = min(speed * elapsed, abs(within))
        return (goal, 0.0) if step == abs(left) else (at + float(np.copysign(step, left)), speed)


SILENT = 0.1
"""Sensors that say nothing for so long are silent; messages that come so much later than the fastest ones, late; s."""
TARE = 0.15
"""The zero of the force is the mean over so long, s."""
_DRIFT = 1e-4
"""By so much the clock of the stamps may fall behind from one message to the next, s."""
_FROZEN = 30
"""So many equal readings of a sensor whose readings vary are no measurement."""
_STANDING = 1e-4
"""A joint that turns by less in `TARE` stands, rad."""
_KEPT = 1000
"""Readings of each sensor."""


class Senses:
    """Joint angles and forces.

    Args:
        cell: whose they are.

    Attributes:
        joints: Q, (2,), rad.
        lift: position of the lift, m; None where no message has it.
        now: s.
        noise: standard deviation of a reading of the force while it stood free, N.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell, self._topics, self._lift = cell, cell.sensor.topics, cell.lift
        self._joints: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._forces: deque[tuple[float, float, float]] = deque(maxlen=_KEPT)
        self._fastest, self._delay = [np.inf, np.inf], [0.0, 0.0]
        self._late, self._excused_until = [0, 0], -np.inf
        self._refusal, self._moved = '', ''
        self.joints = np.full(2, np.nan)
        self.lift: float | None = None
        self._zero = np.zeros(2)
        self.now, self.noise, self._stamp = -np.inf, 0.0, 0.0
        self._noted = (0.0, 0.0), 0.0
        self._frozen, self._varies = 0, False

    def add_joints(self, now: float, stamp: float, joints: Sequence[float], lift: float | None = None) -> None:
        """A reading of both joints, rad, and the lift, m, with its stamp, s."""
        self._delayed(0, now, stamp)
        self._moved = ''
        self._joints.append((now, joints[0], joints[1]))
        self.joints, self.lift = np.array(joints, dtype=float), lift

    def add_force(self, now: float, stamp: float, force: Sequence[float]) -> None:
        """A reading of the force as the sensor gives it, N, with its stamp, s."""
        self._delayed(1, now, stamp)
        same = bool(self._forces) and self._forces[-1][1:] == (force[0], force[1])
        self._frozen = self._frozen + 1 if same else 0
        self._forces.append((now, force[0], force[1]))
        self._stamp = stamp

    def refuse(self, refusal: str, *, moved: bool = False) -> None:
        """A message that cannot be used; the text says why, and `moved` whether because a held joint has moved."""
        self._refusal, self._moved = refusal, refusal if moved else ''

    def _delayed(self, which: int, now: float, stamp: float) -> None:
        self._fastest[which] = min(self._fastest[which] + _DRIFT, now - stamp)
        self._delay[which] = now - stamp - self._fastest[which]
        self._late[which] = self._late[which] + 1 if self._delay[which] > SILENT else 0

    def forget_delays(self) -> None:
        """Measures delays anew: before anything moves the first messages, or a clock that is set, tell wrong ones."""
        self._fastest, self._late = [np.inf, np.inf], [0, 0]

    def note(self, now: float) -> float:
        """Time has passed, s; returns how much.

        For a moment messages may be missing or late where nobody has listened for some time: what has come meanwhile is
        yet to be heard.
        """
        elapsed, self.now = now - self.now, now
        if elapsed > 2 * PERIOD:
            self._excused_until = now + SILENT
        return elapsed

    @property
    def place(self) -> Floats:
        """Q, rad, and the lift, m, NaN where it is not known, (3,)."""
        return np.array([*self.joints, self.lift], dtype=float)

    @property
    def _pull(self) -> Floats:
        """What the weight of the tool adds to a reading here, (2,), N."""
        is_known = self._cell.sensor.tool_weight and np.isfinite(self.joints).all()
        return self._cell.tool_pull(self.joints) if is_known else np.zeros(2)

    @property
    def net_force(self) -> tuple[float, float]:
        """The force now, as reported, N; the median of three readings."""
        last = list(islice(reversed(self._forces), 3))
        if not last:
            return 0.0, 0.0
        x, y = (sorted(reading[k] for reading in last)[len(last) // 2] for k in (1, 2))
        zero = self._zero + self._pull
        return x - float(zero[0]), y - float(zero[1])

    @property
    def force(self) -> float:
        """Magnitude of the force now, N."""
        return hypot(*self.net_force)

    @property
    def doubt(self) -> float:
        """Ten standard deviations of a reading of the force, N."""
        return 10 * self.noise

    def jump(self) -> tuple[tuple[float, float], float, float]:
        """The force when this was asked before, N, how far it is from there, N, and how long that took, s."""
        (before, began), self._noted = self._noted, (self.net_force, self._stamp)
        return before, dist(self.net_force, before), max(self._stamp - began, 0.01)

    def problem(self) -> str:
        """What is wrong with the messages; empty if nothing."""
        most, now = 10 * SILENT if self.is_excused() else SILENT, self.now
        for which, readings in enumerate((self._joints, self._forces)):
            topic = self._topics[which]
            silent = now - readings[-1][0] if readings else np.inf
            if silent > most:
                lasting = f' for {silent:.2f} s' if readings else ''
                return f'{topic} is silent{lasting}' + (f': {self._refusal}' if self._refusal else '')
            if self._late[which] > 2 and most == SILENT:
                return f'{topic}: messages come {SILENT} s late'
        if self._moved:
            return f'a joint has moved that must not: {self._moved}'
        if self._lift is not None and self._joints and self.lift is None:
            return f'{self._topics[0]} has no position of {self._lift.joint} (robot.lift)'
        if self._varies and self._frozen > _FROZEN:
            return f'{self._topics[1]}: the same reading {self._frozen} times; the sensor is frozen'
        return ''

    def is_excused(self) -> bool:
        """Whether nobody has listened a moment ago."""
        return self.now <= self._excused_until

    def knows_joints(self, age: float = LATEST) -> bool:
        """Whether the last joint state was measured no longer ago, s; by default so that the robot is still there."""
        return bool(self._joints) and self.now - self._joints[-1][0] + self._delay[0] <= age

    def hears_joints(self) -> bool:
        """Whether the last joint state is not older than what counts as silence."""
        return self.knows_joints(SILENT)

    def knows_force(self) -> bool:
        """Whether the last reading of the force is not older than what counts as silence."""
        return bool(self._forces) and self.now - self._forces[-1][0] <= SILENT

    def check(self) -> None:
        """Check that both topics can be relied on.

        Raises:
            Fault: they cannot.
        """
        if text := self.problem():
            raise Fault(text, may_retract=not text.startswith(self._topics[0]), passes=not self._moved)

    def _latest(self, readings: deque[tuple[float, float, float]], span: float) -> Floats:
        """The readings of a time, s, at least three where there are so many, (k, 2)."""
        found = list[tuple[float, ...]]()
        for reading in reversed(readings):
            if reading[0] < self.now - span and len(found) > 2:
                break
            found.append(reading[1:])
        return np.array(found).reshape(-1, 2)

    def mean_force(self) -> float:
        """Magnitude of the mean force of late, N."""
        latest = self._latest(self._forces, LATEST)
        return float(np.hypot(*(latest.mean(axis=0) - self._zero - self._pull))) if len(latest) else self.force

    def stands(self) -> bool:
        """Whether both joints stand."""
        latest = self._latest(self._joints, TARE)
        return len(latest) > 2 and bool(np.ptp(latest, axis=0).max() < _STANDING)

    def tare(self) -> float:
        """Takes the force of late as zero, and returns its magnitude before, N."""
        latest = self._latest(self._forces, TARE)
        before, self._zero = self._zero, latest.mean(axis=0) - self._pull
        self.noise = max(float(latest.std(axis=0).max()), 0.9 * self.noise)
        self._varies = bool(np.diff(latest, axis=0).any(axis=1).mean() > 0.8)
        return float(np.hypot(*(self._zero - before)))


class Commander:
    """Makes the commands of a motion, and sees whether the robot follows.

    Args:
        cell: with the limits of the joints and the speeds.
        senses: where the robot is.

    Attributes:
        senses: as given.
        streams: whether motions towards a contact and in it are streamed; else there are as few commands as safety
            needs.
        order: the command to be sent now; None where nothing changes.
        place: Q, rad, and lift, m, commanded last, (3,); None before the first command.
        motion: that is under way; None while the robot is to stand in free space.
        in_contact: whether that is towards a contact, in one or on the way back.
        near: length of its track next to which the robot is, m; 0 without a motion.
        is_behind: whether the robot is so far behind that the motion waits for it.
    """

    def __init__(self, cell: Cell, senses: Senses) -> None:
        self._cell, self.senses, self.streams = cell, senses, True
        self._limits = np.array(cell.limits).T
        lift = () if cell.lift is None else (cell.lift.joint,)
        self._names = (*cell.joint_names, *lift, *cell.hold)
        self.order: Command | None = None
        self.place: Floats | None = None
        self.motion: Traversal | None = None
        self.in_contact = self.is_behind = False
        self.near, self._seen, self._seen_at = 0.0, 0.0, -np.inf  # the last progress of a robot that is behind

    def follow(
        self, track: Track, speed: float, at: float = 0.0, *, ramps: bool = True, slow: tuple[float, float] = NEVER
    ) -> Traversal:
        """Begins a motion; the arguments are those of `Traversal`."""
        self.motion = Traversal(track, speed, at, ramps=ramps, slow=slow)
        return self.motion

    def has_left(self, contact: float) -> bool:
        """Whether the robot, too, is no farther than a contact at a length of the track, m; one at 0 is left."""
        return contact <= 0 or self.near - _BEHIND <= contact

    def advance(self, elapsed: float) -> None:
        """The motion goes on for some time, s, unless it waits for the robot."""
        if self.motion is not None and not self.is_behind:
            self.motion.advance(elapsed)
            self.place = self.motion.place

    def resume(self, near: float) -> None:
        """Takes the motion up where the robot stands, at a length of its track, m."""
        if self.motion is not None:
            self.motion.at, self.motion.sent = near, None
            self.place = self.motion.place
        self.wait_no_more()

    def wait_no_more(self) -> None:
        """The robot counts as one that follows."""
        self.is_behind, self._seen_at = False, self.senses.now

    def here(self) -> Floats:
        """Q, rad, and lift, m, where the robot is told to be, (3,); at first where it is."""
        lift = self._cell.lift
        return self._seen_place(np.full(3, 0.0 if lift is None else lift.down)) if self.place is None else self.place

    def _seen_place(self, place: Floats) -> Floats:
        """Where the robot was seen last, (3,); the lift at a place where that is not known."""
        return np.where(np.isnan(self.senses.place), place, self.senses.place)

    def command(
        self, at: Floats, points: tuple[Floats, Floats], *, is_free: bool = False, is_halt: bool = False
    ) -> Command:
        """Checks where the joints are to be, and says it.

        Args:
            at: Q and lift that hold now, (3,).
            points: times, (k,), Q and lift, (k, 3), to come, evenly spaced in time.
            is_free: whether all of them are far from a contact: they are then passed smoothly.
            is_halt: whether it is to stand where it is, which is never refused.

        Raises:
            Fault: a point is beyond the limits of a joint, or too fast.
        """
        times, places = points
        joints, every = places[:, :2], np.vstack([at, places])
        inside = (joints >= self._limits[0]) & (joints <= self._limits[1])
        if not np.isfinite(joints).all() or not (is_halt or inside.all()):
            raise Fault('a motion beyond the limits of the joints was planned; nothing was commanded')
        tip = forward(self._cell.nominal, every[:, :2])
        speed = np.hypot(*np.diff(tip, axis=0).T) / np.diff(np.append(0.0, times))
        if not is_halt and speed.max() > _FASTER * self._cell.touch.speed:
            raise Fault(f'a motion of {speed.max() / MILLI:.0f} mm/s was planned; nothing was commanded')
        self.place = at
        lifts = every[:, 2:] if self._cell.lift is not None else every[:, :0]
        held = np.tile(list(self._cell.hold.values()), (len(every), 1))
        every = np.hstack([self._cell.readings(every[:, :2]), lifts, held])
        velocities = np.zeros((len(times), len(self._names) if is_free else 0))
        if is_free:  # of the curve through the points; it ends at rest
            velocities[:-1] = (every[2:] - every[:-2]) / (2 * times[0])
        self.order = Command(self._names, times, every[1:], velocities)
        return self.order

    def halt(self, place: Floats) -> None:
        """To stop within `LATEST` where it is to be; from where it was seen it gets there no faster than in travel."""
        speed = self._cell.touch.speed
        way = Track.of(np.stack([self._seen_place(place), place]), self._cell.nominal, max(speed / LIFT_SPEED, 1.0))
        self.command(place, (np.array([max(LATEST, way.length / speed)]), place[None]), is_halt=True)

    def halt_motion(self) -> None:
        """Stops the motion where it is; where the robot is late, there."""
        motion = self.motion
        assert motion is not None
        if abs(self.near - motion.at) > 1.5 * _BEHIND and self.senses.knows_joints():
            motion.at, motion.followed = self.near, None
        if motion.sent != motion.at:
            self.halt(motion.place)
            motion.sent = motion.at

    def stand(self) -> None:
        """Stops where the robot is; where that is not known, where it is to be."""
        self.order = None
        if (at := self.place) is not None:
            if self.motion is not None:
                self.motion.sent = self.motion.at
            self.halt(self._seen_place(at) if self.senses.knows_joints() else at)

    def move(self, goal: float, until: float | None = None, *, is_free: bool = False) -> None:
        """Commands more of the motion where that is due and nothing is against it.

        Args:
            goal: to which length of its track.
            until: where motions are not streamed: to where one command may lead, and `AHEAD_OF_CONTACT` farther; None:
                to the goal.
            is_free: whether all of it is far from a contact: it is one command.
        """
        motion = self.motion
        assert motion is not None
        is_deaf = self.in_contact and goal > motion.at and not self.senses.knows_force()  # busy or not
        if self.is_behind or is_deaf:
            return
        if self.streams and not is_free:
            end, ahead, reach = motion.even(motion.at, goal), AHEAD_OF_CONTACT, AHEAD_OF_CONTACT * motion.speed
        else:
            reach = AHEAD_OF_CONTACT * motion.speed_at(motion.at if until is None else max(motion.at, until))
            end, ahead = goal if until is None else min(goal, max(motion.at, until) + reach), np.inf
        if motion.sent is None or (motion.sent != end and abs(motion.sent - motion.at) < reach / 4):
            self.command(motion.place, motion.points(end, ahead), is_free=is_free)

    def on_way(self, *, loosely: bool = False) -> float:
        """Length of the track next to which the robot is, m; without a motion, 0, and it is where it stood.

        Args:
            loosely: whether in contact, too, the joints may be off by `_OFF_TRACK`, not by `OFF_APPROACH`.

        Raises:
            Fault: it is off its way.
        """
        near, away = 0.0, 0.0
        if self.motion is not None:
            near, away = self.motion.track.nearest(self.senses.place, self.motion.at)
        elif self.place is not None:
            away = float(np.nanmax(np.abs(self.senses.place - self.place)))
        if away > (OFF_APPROACH if self.in_contact and not loosely else _OFF_TRACK):
            what = f'{away / MILLI:.1f} mrad off its way: it does not follow, or is moved by something else'
            raise Fault(f'the robot is {what}', may_retract=False)
        return near

    def check(self, *, loosely: bool = False) -> None:
        """Check that the robot is on its track and not far from where it is to be, see `on_way`.

        Raises:
            Fault: it is not, or stands on its way.
        """
        motion, near, now = self.motion, self.on_way(loosely=loosely), self.senses.now
        if motion is None:
            self.near, self.is_behind, self._seen, self._seen_at = near, False, near, now
            return
        behind, sent = abs(motion.at - near), motion.sent
        is_at_end = motion.at in (0.0, motion.track.length)
        late = _ARRIVED if is_at_end else _LATE * motion.speed * (sent != motion.at) + _BEHIND
        at, seen, when = motion.followed or (motion.at, near, now)
        way = np.sign(motion.at - at)
        if (near - seen) * way >= _FOLLOWS * (motion.at - at) * way:
            at, seen, when = motion.at, near, now
        motion.followed, is_late = (at, seen, when), now - when > _LATE
        is_stuck = self.in_contact and is_late and min((motion.at - at) * way, (motion.at - near) * way) > _BEHIND
        self.near, self.is_behind = near, (behind > late or is_stuck) and self.senses.hears_joints()
        is_ahead = sent is not None and (near - motion.at) * (sent - motion.at) > 0
        if is_ahead and self.is_behind and not is_stuck:
            what = f'{behind / MILLI:.1f} mm ahead on its way: it is faster than commanded'
            raise Fault(f'the robot is {what}', may_retract=False)
        if not self.is_behind or abs(near - self._seen) > _MOVED:
            self._seen, self._seen_at = near, now
        if now - self._seen_at > _STANDS:
            slowest = int(np.nanargmax(np.abs(self.senses.place - motion.place)))
            name = (*self._cell.joint_names, *self._cell.other_joints)[slowest]
            text = f'the robot stands {behind / MILLI:.2f} mm behind, {name} most: it does not follow'
            raise Fault(text, may_retract=False, passes=True)
