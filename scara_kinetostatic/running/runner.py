"""The run: a robot that touches, judges and goes on by itself. Samples come in, commands go out; no ROS.

Every touch: travel to where the approach begins, with one command; take the zero of the force; approach slowly until
the force says contact; press in steps to the force that is wanted, dragging the tip aside
(`kinetostatics.press_aside`); hold; retract to where the approach began; wait for the judgement of the collector's own
detection. The script of it is a generator that is resumed with every `tick`.

**Speeds in contact.** From a force to its effect on the robot `DELAY` goes by. With the compliance c of arm and tip
along the normal, the force grows by speed · `DELAY` / c meanwhile: the approach is so slow that this stays below what
is missing to the wanted force.

**What stops it**: silent, late or frozen sensors, a force where none must be, more than `touch.max_force`, no contact,
a robot that is not where it was commanded to be, a joint that moved which must not. It stops, retracts along the way it
came where that is safe, and says why. A tip that slides, so that the force falls at once but does not vanish, has made
a touch that failed. Where the cause may pass by itself, as silent sensors or a robot that stands on
its way, it stands still instead, for `patience` at most, then retracts and begins the touch again. A robot that is late
on its way, as a controller that scales the speed makes it, is waited for as long as it moves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor
from math import dist, hypot
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import HELD_WITHIN, Cell
from scara_kinetostatic.model.parameters import Parameters, quantity
from scara_kinetostatic.model.tip import press_aside, tip_yield
from scara_kinetostatic.planning.motion import Waypoints
from scara_kinetostatic.planning.planner import Planner
from scara_kinetostatic.planning.program import CONTACT, joint_angles
from scara_kinetostatic.running.campaign import Campaign, End, Target, Worker, length
from scara_kinetostatic.running.robot import AHEAD_OF_CONTACT, SILENT, Command, Commander, Fault, Motion, Senses, Track
from scara_kinetostatic.touches.detection import Detection

DELAY = 0.08
"""From a force to its effect on the robot, s: sensor, filter, command, the robot's own lag."""
_REACTION = 0.01
"""From a contact on the way to the stop of the robot, s."""
_STIFFEST = 5e-6
"""No arm with its sensor and tip is less compliant, m/N."""
_STIFFER = 3.0
"""So many times as stiff as the model says a contact may be."""
_LEAST_SPEED = 3e-4
"""Towards a contact, m/s."""
_OFF_TRACK, _OFF_APPROACH = 0.02, 2e-3
"""How far the joints may be off their way in travel and towards a contact, rad."""
_LATE, _BEHIND = 0.15, 2e-4
"""How far the robot may be behind, s and m together; farther, its way waits for it."""
_STANDS, _MOVED = 0.25, 5e-5
"""A robot that is behind and comes less far in such a time stands, s and m."""
_FOLLOWS = 1 / 3
"""A robot that for `_LATE` comes less than such a part of its way is behind, too, and gets no further message: at each
one a controller whose time is scaled by 0 moves on.
"""
_ARRIVED = 1e-3
"""The same at the end of a way, m."""
_QUIET = 0.5
"""So long all must be well before it goes on after an interruption, s; that of a touch is then judged within twice."""
_LARGEST_ZERO = 0.5
"""Zero of the sensor at the start up to this part of the smallest force of a touch: more is a contact, or no zero."""
_LIFT_SPEED = 0.05
"""Of the lift, m/s."""
_BACK = 0.02
"""How far it goes back after a contact on the way, m."""
_FAST = 0.02
"""Towards a contact, as far as none can be expected, m/s; a stop from it has to stay below the largest force."""
_CLEAR = 5e-4
"""How far from the surface it is before it retracts fast, m."""
_WAIT = 0.12
"""Between a motion in contact and the measurement of the force, s: less than what would be a hold."""
_JUDGED = 6.0
"""Time within which a touch is judged, s."""
_STEP = 5e-3
"""Distance of the points of a track, m; tenth of that towards a contact."""


class _Slid(Fault):
    """The force fell faster than any motion explains."""


class Status(NamedTuple):
    """How the run is.

    Attributes:
        phase: ``idle``, ``travel``, ``approach``, ``press``, ``hold``, ``retract``, ``judge``, ``plan``, ``paused``,
            ``waiting``, ``stopped`` or ``done``.
        text: one sentence.
        is_fault: whether it stopped because something is wrong.
        values: by name.
    """

    phase: str
    text: str
    is_fault: bool = False
    values: dict[str, str] = {}  # noqa: RUF012


class Runner:
    """Makes the touches.

    Args:
        cell: with `robot.limits`.
        most: accepted touches after which it ends.
        detect: returns the touches found since the last call.
        work: does the calibrations aside.
        planner: to begin with; None for the nominal arm.
        patience: how long it waits in a touch for what may pass by itself, s.

    Attributes:
        senses: takes the samples.
        streams: whether motions towards a contact and in it are streamed; else there are as few commands as safety
            needs.
        status: how it is.
        target: the touch that is being made; None between touches.
        end: why it ended, and the exit status; None while it runs.

    Raises:
        CellError: the cell has no limits of the joints.
        UnsupportedDataError: nothing can be reached, or the tolerance is out of reach.
    """

    def __init__(
        self,
        cell: Cell,
        most: int,
        detect: Callable[[], Detection],
        work: Worker,
        planner: Planner | None = None,
        patience: float = 0.0,
    ) -> None:
        self.cell, self.senses, self.streams, self._patience = cell, Senses(cell), True, patience
        self.campaign = Campaign(cell, most, planner, work)
        self._detect, self._commander = detect, Commander(cell)
        self.status = Status('idle', 'not started')
        self.target: Target | None = None
        self.end: End | None = None
        self._now = -np.inf
        self._command: Command | None = None
        self._motion: Motion | None = None
        self._contact, self._surface, self._steepest, self._last_force = False, 0.0, 0.0, ((0.0, 0.0), 0.0)
        self._is_behind, self._near, self._seen, self._seen_at = False, 0.0, 0.0, -np.inf
        self._waits_until, self._disturbed = np.inf, -np.inf
        self._script: Iterator[None] | None = None
        self._former: Runner | None = None
        self._paused = False

    # From outside

    def take_over(self, former: Runner) -> None:
        """Begins by retracting the touch in which a former run has left the robot, where it still stands there."""
        if former.is_in_contact:
            self.senses, self.target, self._former = former.senses, former.target, former._former or former

    def start(self) -> None:
        """Begins, or goes on after a pause."""
        self._paused = False
        if self._script is None and self.end is None:
            self._script = self._begin()

    def pause(self) -> None:
        """Stands still as soon as the touch that is being made has ended; `start` goes on."""
        self._paused = True

    def obstacle(self) -> str:
        """Why the robot may not obey now; empty where nothing is known against it."""
        is_waiting = self.status.phase == 'waiting' or self._former is not None
        return self.status.text if is_waiting else self.senses.problem(self._now)

    def stop(self, reason: str) -> None:
        """Retracts and holds, for good."""
        if self.end is None:
            self._give_up(Fault(reason), is_fault=False)

    def fail(self, reason: str, *, may_retract: bool = True, passes: bool = False) -> None:
        """Something outside is wrong: stops, and retracts where it may, or waits where it may pass by itself."""
        self._disturbed = self._now
        if self.end is None and not (passes and self.status.phase == 'waiting'):
            self._interrupt(Fault(reason, may_retract=may_retract, passes=passes))

    def revoke(self, reason: str) -> None:
        """The tolerance is not reached after all."""
        if self.end is not None and self.end.is_reached:
            self.end = End(1, reason)
            self.status = self.status._replace(text=reason, is_fault=True)

    @property
    def is_in_contact(self) -> bool:
        """Whether the robot is towards a contact, in one or on its way back, or was left there at the end."""
        return self._former is not None or (self._contact and self._motion is not None)

    @property
    def is_over(self) -> bool:
        """Whether it has ended and the robot stands."""
        return self.end is not None and self._script is None

    def note(self, now: float) -> float:
        """Time that has passed, s; call it, too, when a command has been sent: a tick that plans takes long.

        Args:
            now: s.
        """
        elapsed, self._now = now - self._now, now
        self.senses.excuse(now, elapsed)
        return elapsed

    def tick(self, now: float) -> Command | None:
        """Goes on; call it often, with every sample.

        Args:
            now: s.

        Returns:
            What the robot is to do; None where that does not change.
        """
        elapsed = self.note(now)
        if self._motion is not None and not self._is_behind:  # also while nobody has ticked
            self._motion.advance(elapsed)
            self._commander.place = self._motion.place
        if self._script is None:
            return None
        self._command = None
        try:
            next(self._script)
        except StopIteration:
            self._script = None
        except Fault as fault:
            if self.end is None:
                self._interrupt(fault)
            else:  # while retracting: it stands
                self._script = None
                self._add(f'not retracted: {fault}')
            return self._stand()
        except (ScaraKinetostaticError, BrokenExecutor, OSError) as error:  # of the calibrating process, too
            self._give_up(Fault(str(error)))
            return self._stand()
        return self._command

    # Commands

    def _halt(self, place: Floats) -> Command:
        """To stop within 0.05 s where it is to be; from where it was seen it gets there no faster than in travel."""
        speed = self.cell.touch.speed
        way = Track.of(np.stack([self._seen_place(place), place]), self._parameters, max(speed / _LIFT_SPEED, 1.0))
        return self._commander.command(place, (np.array([max(0.05, way.length / speed)]), place[None]), is_halt=True)

    def _seen_place(self, place: Floats) -> Floats:
        """Where the robot was seen last, (3,); the lift at a place where that is not known."""
        return np.where(np.isnan(self.senses.place), place, self.senses.place)

    def _halt_motion(self, motion: Motion) -> None:
        """Stops a motion where it is; where the robot is late, there."""
        if abs(self._near - motion.at) > 1.5 * _BEHIND and self.senses.knows_joints(self._now):
            motion.at, motion.followed = self._near, None
        if motion.sent != motion.at:
            self._command, motion.sent = self._halt(motion.place), motion.at

    def _stand(self) -> Command | None:
        """Stops where the robot is; where that is not known, where it is to be."""
        if (at := self._commander.place) is None:
            return None
        if self._motion is not None:
            self._motion.sent = self._motion.at
        return self._halt(self._seen_place(at) if self.senses.knows_joints(self._now) else at)

    def _move(self, motion: Motion, goal: float, until: float | None = None, *, is_free: bool = False) -> None:
        """Commands more of a motion where that is due and nothing is against it.

        Args:
            motion: that goes on.
            goal: to which length of its track.
            until: where motions are not streamed: to where one command may lead, and `AHEAD_OF_CONTACT` farther; None:
                to the goal.
            is_free: whether all of it is far from a contact: it is one command.
        """
        is_deaf = self._contact and goal > motion.at and not self.senses.knows_force(self._now)  # busy or not
        if self._is_behind or is_deaf:
            return
        if self.streams and not is_free:
            end, ahead, reach = motion.even(motion.at, goal), AHEAD_OF_CONTACT, AHEAD_OF_CONTACT * motion.speed
        else:
            reach = AHEAD_OF_CONTACT * motion.speed_at(motion.at if until is None else max(motion.at, until))
            end, ahead = goal if until is None else min(goal, max(motion.at, until) + reach), np.inf
        due = motion.sent is None or (motion.sent != end and abs(motion.sent - motion.at) < 0.25 * reach)
        if due:
            self._command = self._commander.command(motion.place, motion.points(end, ahead), is_free=is_free)

    def _check(self, off_track: float) -> None:
        """Check the sensors and the robot.

        Raises:
            Fault: the robot must not go on.
        """
        self.senses.check(self._now)
        force, most = self.senses.force, self.cell.touch.max_force
        if force > most:
            raise Fault(f'a force of {force:.0f} N, more than touch.max_force, {most:g} N')
        (before, began), self._last_force = self._last_force, (self.senses.net_force, self.senses.stamp)
        jump, within = dist(self.senses.net_force, before), max(self.senses.stamp - began, 0.01)
        if self._contact and jump > self._steepest * within + 10 * self.senses.noise + 0.1 * most:
            kind = _Slid if hypot(*self.senses.net_force) < hypot(*before) else Fault
            raise kind(f'the force jumps by {jump:.0f} N: no motion of the robot explains that')
        self._check_place(off_track)

    def _on_way(self, motion: Motion | None, off_track: float) -> float:
        """Length of the track of a motion next to which the robot is, m; without one, 0, and it is where it stood.

        Raises:
            Fault: it is off its way.
        """
        stood, near, away = self._commander.place, 0.0, 0.0
        if motion is not None:
            near, away = motion.track.nearest(self.senses.place, motion.at)
        elif stood is not None:
            away = float(np.nanmax(np.abs(self.senses.place - stood)))
        if away > off_track:
            text = f'the robot is {1e3 * away:.1f} mrad off its way: it does not follow, or is moved by something else'
            raise Fault(text, may_retract=False)
        return near

    def _check_place(self, off_track: float) -> None:
        """Check that the robot is on its track, and not far from where it is to be; where it stands, there."""
        motion, near = self._motion, self._on_way(self._motion, off_track)
        if motion is None:
            self._near, self._is_behind, self._seen, self._seen_at = near, False, near, self._now
            return
        behind, sent = abs(motion.at - near), motion.sent
        is_at_end = motion.at in (0.0, motion.track.length)
        late = _ARRIVED if is_at_end else _LATE * motion.speed * (sent != motion.at) + _BEHIND
        at, seen, when = motion.followed or (motion.at, near, self._now)
        way = np.sign(motion.at - at)
        if (near - seen) * way >= _FOLLOWS * (motion.at - at) * way:
            at, seen, when = motion.at, near, self._now
        motion.followed, is_late = (at, seen, when), self._now - when > _LATE
        is_stuck = self._contact and is_late and min((motion.at - at) * way, (motion.at - near) * way) > _BEHIND
        self._near, self._is_behind = near, (behind > late or is_stuck) and self.senses.knows_joints(self._now, SILENT)
        is_ahead = sent is not None and (near - motion.at) * (sent - motion.at) > 0
        if is_ahead and self._is_behind and not is_stuck:
            text = f'the robot is {1e3 * behind:.1f} mm ahead on its way: it is faster than commanded'
            raise Fault(text, may_retract=False)
        if not self._is_behind or abs(near - self._seen) > _MOVED:
            self._seen, self._seen_at = near, self._now
        if self._now - self._seen_at > _STANDS:
            slowest = int(np.nanargmax(np.abs(self.senses.place - motion.place)))
            name = (*self.cell.joint_names, *self.cell.other_joints)[slowest]
            text = f'the robot stands {1e3 * behind:.2f} mm behind, {name} most: it does not follow'
            raise Fault(text, may_retract=False, passes=True)

    # The run

    def _say(self, phase: str, text: str) -> None:
        if (phase, text) != self.status[:2]:
            self.status = Status(phase, text, values=self._values())

    def _values(self) -> dict[str, str]:
        campaign, tolerance, known = self.campaign, self.cell.tolerance, self.campaign.knowledge
        values = {
            'touch': str(campaign.accepted + 1),
            'accepted': str(campaign.accepted),
            'failed': str(campaign.failed),
            'uncertainty_m': '' if known.now is None else f'{known.now:.4g}',
            'uncertainty': '' if known.now is None else length(known.now),
            'tolerance': '' if tolerance is None else quantity(tolerance, 'm'),
            'grade': known.grade,
            'verdict': known.verdict,
            'note': known.text,
        }
        if self.target is not None:
            values |= {'next': campaign.name(self.target), 'why': self.target.reason}
        return values

    def _go_on(self) -> Iterator[None]:
        """Touch by touch; first the one that was interrupted."""
        while True:
            chosen: tuple[Target, Waypoints] | End | None = self.campaign.poll()
            if chosen is None and not self._paused:
                chosen = self.campaign.choose(self._here()[:2], self.target)
            if isinstance(chosen, End):  # the robot stands free; with a lift, the tip is raised
                if self.cell.lift is not None and self._commander.place is not None:
                    yield from self._raise(self.cell.lift.up)
                self.end = chosen
                self.status = Status('done', chosen.reason, chosen.status == 1, self._values())
                return
            if chosen is None:
                if self._paused:
                    self._say('paused', 'paused; call ~/start to go on')
                else:
                    self.target, self._waits_until = None, np.inf
                    self._say('plan', 'calibrating and planning the next touches')
                self._check(_OFF_TRACK)
                yield
                continue
            self.target, way = chosen
            yield from self._travel(self.target, way)
            try:
                yield from self._touch(self.target)
            except _Slid as slide:
                yield from self._slid(slide)
            yield from self._judgement(self.target)
            self.target, self._waits_until = None, np.inf

    def _here(self) -> Floats:
        """Q, rad, and lift, m, where the robot is told to be, (3,); at first where it is."""
        if self._commander.place is not None:
            return self._commander.place
        return self._seen_place(np.full(3, 0.0 if self.cell.lift is None else self.cell.lift.down))

    def _begin(self) -> Iterator[None]:
        """Waits for the sensors, checks all that can be checked before anything moves, and goes on.

        Raises:
            Fault: something is wrong.
        """
        cell, began, forgot = self.cell, self._now, self._now
        while (
            (problem := self.senses.problem(self._now)) or self.senses.is_excused(self._now) or self._now - began < 0.5
        ):
            self._say('idle', problem or 'listening to the sensors')
            if self._now - forgot > 1.0:
                self.senses.forget_delays()
                forgot = self._now
            if self._now - began > 5.0:
                raise Fault(problem or 'this machine does not keep up with the sensors', may_retract=False)
            yield
        if not self.senses.stands(self._now):
            raise Fault('the joints move: something else moves the robot', may_retract=False)
        if self._former is not None:
            yield from self._leave(self._former)
        zero, most = self.senses.tare(self._now), _LARGEST_ZERO * cell.touch.force[0]
        if zero > most:
            text = f'the sensor reads {zero:.1f} N, more than {most:g} N, where nothing must be touched'
            raise Fault(f'{text}: retract the tip, or set the zero of the sensor', may_retract=False)
        limits = np.array(cell.limits)
        if not ((self.senses.joints > limits[:, 0]) & (self.senses.joints < limits[:, 1])).all():
            raise Fault('the robot stands beyond robot.limits: move it', may_retract=False)
        self._command = self._halt(self._here())  # a controller that refuses says so now
        began = self._now
        while self._now - began < 0.2:
            yield
            self._check(_OFF_TRACK)
        if cell.lift is not None:
            yield from self._raise(cell.lift.up)
        yield from self._go_on()

    def _leave(self, former: Runner) -> Iterator[None]:
        """Retracts the touch in which a former run has left the robot, unless that was moved meanwhile."""
        assert former._motion is not None
        near, away = former._motion.track.nearest(self.senses.place, former._motion.at)
        self._former = None
        if away < _OFF_APPROACH:
            self._motion, self._contact, self._surface = former._motion, True, former._surface
            self._resume(near)
            self._say('retract', 'retracting the touch of the former run')
            yield from self._back()
            began = self._now
            while self._now - began < 2 * _QUIET:  # a touch that is found now is none of this run
                self._detect()
                self._check(_OFF_TRACK)
                yield
            self._commander.place = None
        self.target = None

    def _resume(self, near: float) -> None:
        """Takes the motion up where the robot stands, at a length of its track, m."""
        if self._motion is not None:
            self._motion.at, self._motion.sent = near, None
            self._commander.place = self._motion.place
        self._is_behind, self._seen_at = False, self._now
        self._last_force = self.senses.net_force, self.senses.stamp

    def _raise(self, goal: float) -> Iterator[None]:
        """Moves the lift, and sees that it moves.

        Raises:
            Fault: it does not.
        """
        lift, here = self.cell.lift, self._here()
        assert lift is not None
        if abs(here[2] - goal) < 1e-6 and self._arrived(goal):
            return
        track = Track.of(np.array([here, [*here[:2], goal]]), self._parameters)
        yield from self._follow(track, min(_LIFT_SPEED, self.cell.touch.speed))
        began = self._now
        while not self._arrived(goal):
            if self._now - began > 1.0:
                at = self.senses.lift
                text = 'nowhere' if at is None else f'{at:.4f} m'
                raise Fault(f'{lift.joint} (robot.lift) is at {text}, commanded {goal:g} m: it does not lift')
            self._check(_OFF_TRACK)
            yield

    def _arrived(self, goal: float) -> bool:
        return self.senses.lift is not None and abs(self.senses.lift - goal) <= HELD_WITHIN

    @property
    def _parameters(self) -> Parameters:
        return self._planner.arm.model.parameters

    @property
    def _planner(self) -> Planner:
        return self.campaign.knowledge.planner

    def _follow(self, track: Track, speed: float) -> Iterator[None]:
        """Goes along a track through free space.

        Raises:
            Fault: a contact on the way, or what `_check` says.
        """
        motion = self._motion = Motion(track, speed)
        limit = self._free_limit
        while motion.at < track.length:
            self._check(_OFF_TRACK)
            self._check_lift(track)
            if self.senses.force > limit:
                raise Fault(f'a force of {self.senses.force:.1f} N on the way: a contact where none must be')
            self._move(motion, track.length, is_free=True)
            yield
        yield from self._stopped()
        self._motion = None

    def _check_lift(self, track: Track) -> None:
        """Check that the lift is up wherever the arm is under way, on a track that is raised.

        Raises:
            Fault: it is not.
        """
        at, lift = self.senses.lift, track.places[:, 2]
        up, away = lift[len(lift) // 2], np.abs(track.places[[0, -1], :2] - self.senses.joints).max(axis=1).min()
        if np.ptp(lift) and at is not None and away > _OFF_APPROACH and abs(at - up) > 2 * HELD_WITHIN:
            raise Fault(f'the lift is at {at:.4f} m, not at {up:g} m, while the arm moves', may_retract=False)

    def _stopped(self) -> Iterator[None]:
        """Waits until the joints stand where they were commanded to be."""
        began = self._now
        while self._now - began < 0.1 or not self.senses.stands(self._now):
            self._check(_OFF_TRACK)
            if self._is_behind:
                began = self._now
            if self._now - began > 2.0:
                raise Fault('the joints do not come to rest', may_retract=False)
            yield

    def _travel(self, target: Target, way: Waypoints) -> Iterator[None]:
        """To where the approach begins."""
        planner, cell = self._planner, self.cell
        self._say('travel', f'next: {self.campaign.name(target)}, {target.reason}')
        self._tare('where nothing is touched', may_retract=False)
        here = self._here()
        pieces = [here[None, :2]]
        for k, corner in enumerate(joint_angles(planner, way)):
            before = pieces[-1][-1]
            if k and way.posture[k] == way.posture[k - 1]:
                along = way.tip[k] - way.tip[k - 1]
                part = np.linspace(0.0, 1.0, max(2, int(np.hypot(*along) / _STEP)))[1:, None]
                tips = way.tip[k - 1] + part * along
                pieces.append(joint_angles(planner, Waypoints(tips, np.full(len(tips), way.posture[k]))))
            else:
                pieces.append(before + np.linspace(0.0, 1.0, 20)[1:, None] * (corner - before))
        joints, weight = np.concatenate(pieces), 1.0
        lift = np.full(len(joints), here[2])
        speed = self._travel_speed(raised=cell.lift is not None)
        if cell.lift is not None:  # raised first, lowered last
            joints = np.concatenate([joints[:1], joints, joints[-1:]])
            lift = np.concatenate([lift[:1], np.full(len(lift), cell.lift.up), [cell.lift.down]])
            weight = max(speed / _LIFT_SPEED, 1.0)
        yield from self._follow(Track.of(np.column_stack([joints, lift]), self._parameters, weight), speed)

    def _tare(self, where: str, *, may_retract: bool = True) -> None:
        """Takes the force in free motion as zero.

        Raises:
            Fault: it has changed by too much.
        """
        if (zero := self.senses.tare(self._now)) > self._free_limit:
            why = 'the sensor, or something touches the arm'
            raise Fault(f'the force {where} changed by {zero:.1f} N: {why}', may_retract=may_retract)

    def _travel_speed(self, *, raised: bool = False) -> float:
        """At which an obstacle that nobody knows is met with at most 1.5 times the largest force, m/s; raised the tip
        meets none.
        """
        touch, compliance = self.cell.touch, max(self._parameters.p_ee, _STIFFEST)
        met = np.inf if raised else 1.5 * touch.max_force * compliance / _REACTION
        return float(min(touch.speed, met))

    def _compliance(self, target: Target, joints: Floats) -> float:
        """Of arm and tip along the normal of a touch, m/N."""
        n = target.plan.normal(self.cell)
        return max(float((tip_yield(self._parameters, joints[None], n) * n).sum()), _STIFFEST)

    def _touch(self, target: Target) -> Iterator[None]:
        """Approach, press, hold, retract."""
        plan, touch, planner = target.plan, self.cell.touch, self._planner
        goal = float(plan.force[0])
        start, normal = planner.approach(plan).tip[0], plan.normal(self.cell)[0]
        begin = planner.space.clearance + 1e-3 + touch.search
        count = int((begin + 4e-3) / (0.1 * _STEP)) + 2
        depths = np.linspace(0.0, begin + 4e-3, count)
        tips = start - depths[:, None] * normal
        joints = joint_angles(planner, Waypoints(tips, np.full(count, plan.posture[0])))
        here = self._here()
        joints[0] = here[:2]
        track = Track.of(np.column_stack([joints, np.full(count, here[2])]), self._parameters)
        compliance = self._compliance(target, joints[0])
        self._tare('in free motion')
        self._say('approach', f'approaching {self.campaign.name(target)}')
        threshold = max(CONTACT * goal, 6 * self.senses.noise, 1.0)
        speed = np.clip((0.8 * goal - threshold) * compliance / DELAY, _LEAST_SPEED, touch.contact_speed)
        expected, deepest = (float(np.interp(depth, depths, track.at)) for depth in (begin - touch.search, begin))
        fast, slow = float(np.clip(touch.max_force * compliance / DELAY, speed, _FAST)), expected - planner.doubt
        self._contact, self._surface, self._steepest = True, 0.0, max(_STIFFER * touch.contact_speed, fast) / compliance
        self._last_force = self.senses.net_force, self.senses.stamp
        motion = self._motion = Motion(track, fast, ramps=False, slow=(slow, float(speed)))
        until = slow if planner.now is None or np.isinf(planner.now) else expected
        for _ in range(4):
            while self.senses.force < threshold:
                self._check(_OFF_APPROACH)
                if motion.at >= deepest:
                    name = self.campaign.name(target)
                    raise Fault(f'no contact with {name} within touch.search, {1e3 * touch.search:g} mm, of its place')
                self._move(motion, deepest, until)
                yield
            yield from self._pushed(motion, 0.0, 0.0)
            if self.senses.force > 0.5 * threshold:
                break
            yield from self._pushed(motion, 0.0, 0.0)  # an arm with play swings back from the surface: from free again
        else:
            raise Fault(f'the contact with {self.campaign.name(target)} is lost again and again')
        surface = self._surface = motion.at
        self._say('press', f'pressing to {goal:g} N')
        motion.track, way = self._into(track, surface, target)
        yield from self._press(motion, goal * (1 + float(plan.preload[0])), way)
        if plan.preload[0] > 0:
            track, way = self._out_of(motion.track, self._motion.at, target)
            self._surface = track.nearest(motion.track.place(surface), surface)[0]
            yield from self._release(track, goal, way)
        self._say('hold', f'holding {self.senses.force:.1f} N')
        began = self._now
        while self._now - began < touch.hold + 0.1:
            self._check(_OFF_APPROACH)
            yield
        self._say('retract', 'retracting')
        yield from self._back()

    def _into(self, track: Track, surface: float, target: Target) -> tuple[Track, float]:
        """The way of an approach, from the surface on of a press that drags the tip aside; length per force, m/N."""
        newtons = (track.length - surface) / self._compliance(target, track.place(surface)[:2])
        pressed = self._pressed(track.place(surface), np.linspace(0.0, newtons, 60), -1.0, target)
        whole = Track.of(np.concatenate([track.places[track.at < surface], pressed]), self._parameters)
        return whole, (whole.length - surface) / newtons

    def _out_of(self, track: Track, at: float, target: Target) -> tuple[Track, float]:
        """Backwards a way out of a press: some of it drags the tip to the same side; length per force, m/N."""
        newtons = 1.5 * float((target.plan.preload * target.plan.force)[0])
        pressed = self._pressed(track.place(at), np.linspace(newtons, 0.0, 60), 1.0, target)
        whole = Track.of(np.concatenate([track.places[:1], pressed]), self._parameters)
        return whole, (whole.length - float(whole.at[1])) / newtons

    def _pressed(self, here: Floats, newtons: Floats, sense: float, target: Target) -> Floats:
        """Places beside one, (k, 3), under k forces along the normal of a touch, into the object or out of it."""
        normal, aside = sense * target.plan.normal(self.cell), -sense * target.plan.aside
        per_newton = press_aside(self._parameters, here[None, :2], normal, aside)
        return here + np.pad(newtons[:, None] * per_newton, ((0, 0), (0, 1)))

    def _pushed(self, motion: Motion, step: float, until: float) -> Iterator[None]:
        """Moves by a step towards the contact, or back, and waits; ends early where the force comes to a value."""
        goal = float(np.clip(motion.at + step, 0.0, motion.track.length))
        sign = np.sign(step)
        while motion.at != goal and sign * (self.senses.force - until) < 0:
            self._check(_OFF_APPROACH)
            self._move(motion, goal)
            yield
        self._halt_motion(motion)
        began = self._now
        yield
        while self._now - began < (2 if self._is_behind else 1) * _WAIT:
            self._check(_OFF_APPROACH)
            yield

    def _press(self, motion: Motion, goal: float, compliance: float) -> Iterator[None]:
        """To a force, from below.

        Raises:
            Fault: the force does not grow.
        """
        track, speed = motion.track, float(np.clip(0.2 * goal * compliance / DELAY, _LEAST_SPEED / 2, 2e-3))
        motion = self._motion = Motion(track, speed, motion.at, ramps=False)
        self._steepest = _STIFFER * speed / compliance  # of the approach nothing is left
        softer = 1.0
        for _ in range(40):
            force = self.senses.mean_force(self._now, 0.05)
            if force > 0.93 * goal:
                return
            before = motion.at
            yield from self._pushed(motion, 0.9 * (goal - force) * softer * compliance, 0.97 * goal)
            gained = self.senses.mean_force(self._now, 0.05) - force
            seen = (motion.at - before) / max(gained, 1e-3) / compliance
            softer = float(np.clip(seen, max(0.2, softer / 2), softer * 2))
            if motion.at >= track.length:
                raise Fault(f'the force stays at {force:.1f} N, wanted {goal:.0f} N: the object gives way, or slides')
        raise Fault(f'the force does not come to {goal:.0f} N')

    def _release(self, track: Track, goal: float, compliance: float) -> Iterator[None]:
        """Down to a force, from above, backwards on a track."""
        speed = float(np.clip(0.2 * goal * compliance / DELAY, _LEAST_SPEED / 2, 2e-3))
        motion = self._motion = Motion(track, speed, track.length, ramps=False)
        for _ in range(20):
            force = self.senses.mean_force(self._now, 0.05)
            if force < 1.07 * goal:
                return
            yield from self._pushed(motion, -0.9 * (force - goal) * compliance, 1.03 * goal)

    def _slid(self, slide: Fault) -> Iterator[None]:
        """Stands, and retracts where the tip still presses.

        Raises:
            Fault: it does not, or the sensor has died: another approach would not feel the object.
        """
        self._command, began = self._stand(), self._now
        yield
        while self._now - began < _WAIT:
            self._check(_OFF_APPROACH)
            yield
        if self.senses.mean_force(self._now, 0.05) < self._free_limit:
            raise Fault(f'{slide}; none is left')
        self._say('retract', f'retracting: {slide}')
        yield from self._back()

    def _back(self) -> Iterator[None]:
        """To where the approach began: in contact slowly, then as through free space.

        Raises:
            Fault: a force remains.
        """
        assert self._motion is not None and self.target is not None
        self._steepest = _STIFFER * self.cell.touch.contact_speed / self._compliance(self.target, self._here()[:2])
        clear, track = max(self._surface - _CLEAR, 0.0), self._motion.track
        motion = Motion(track, self._travel_speed(), self._motion.at, slow=(clear, self.cell.touch.contact_speed))
        self._motion = motion
        for goal in (clear, 0.0) if self.streams else (0.0,):
            while motion.at > goal or self._near - _BEHIND > clear > 0:  # the robot, too, has to leave the contact
                self._check(_OFF_TRACK)
                self._move(motion, goal, is_free=self.streams and goal < clear)
                yield
        yield from self._stopped()
        if self.senses.force > 2 * self._free_limit:
            raise Fault(f'a force of {self.senses.force:.1f} N remains after the touch', may_retract=False)
        self._contact, self._motion = False, None

    def _judgement(self, target: Target) -> Iterator[None]:
        """Waits for the judgement of the touch, and acts on it."""
        self._say('judge', 'waiting for the judgement of the touch')
        began, asked = self._now, -np.inf
        while True:
            if self._now - asked > 0.1:
                asked = self._now
                found = self._detect()
                if len(found.touches):
                    self.campaign.accept(found)
                    return
                if found.found:
                    failure = found.rejected[-1].reason
                    break
            if self._now - began > _JUDGED:
                failure = 'the touch was not found in the streams'
                break
            self._check(_OFF_TRACK)
            yield
        name, what = self.campaign.name(target), self.campaign.reject(target)
        self._say('judge', f'{name}: {failure}; {what}')
        yield

    # What goes wrong

    def _interrupt(self, fault: Fault) -> None:
        """Waits where the cause may pass by itself and time is left for that in this touch; else gives up."""
        passes = fault.passes and self.status.phase != 'idle'
        self._waits_until = min(self._waits_until, self._now + self._patience) if passes else self._waits_until
        if passes and self._now < self._waits_until:
            self._script = self._wait(f'{fault} (in {self.status.phase})', may_retract=fault.may_retract)
        else:
            self._give_up(fault)

    def _wait(self, reason: str, *, may_retract: bool) -> Iterator[None]:
        """Stands until all is well, retracts, and goes on with the touch that was interrupted.

        Args:
            reason: why.
            may_retract: whether the robot may go back where the cause does not pass.

        Raises:
            Fault: it does not pass, or the robot has been moved.
        """
        self._command, self._disturbed, asked, near = self._stand(), self._now, -np.inf, 0.0
        text = f'{reason}; waiting for {self._waits_until - self._now:.0f} s at most'
        self.status = Status('waiting', text, values=self._values())
        yield
        while asked <= self._disturbed or self._now - self._disturbed < _QUIET:
            if self._now > self._waits_until:
                raise Fault(f'{reason}; waited for {self._patience:g} s', may_retract=may_retract)
            if self.senses.force > self.cell.touch.max_force:
                text = f'{reason}; a force of {self.senses.force:.1f} N while it waits'
                raise Fault(text, may_retract=may_retract)
            if self.senses.problem(self._now) or self.senses.is_excused(self._now) or not self.senses.stands(self._now):
                self._disturbed = self._now
            elif asked <= self._disturbed < self._now - 0.5 * _QUIET and self.senses.knows_joints(self._now):
                near = self._on_way(self._motion, _OFF_APPROACH if self._contact else _OFF_TRACK)
                self._command, asked = self._stand(), self._now  # a controller that still refuses says so
            yield
        if not self._contact and self.senses.force > self._free_limit:
            text = f'{reason}; now there is a force of {self.senses.force:.1f} N where nothing must be touched'
            raise Fault(text, may_retract=False)
        self._resume(near)
        if self._contact:
            self._say('retract', f'going on after: {reason}')
            yield from self._back()
        self._motion = None
        self._say('judge', f'going on after: {reason}')
        began = self._now
        while self.target is not None and self._now - began < 2 * _QUIET:  # a touch that is good counts all the same
            self._check(_OFF_TRACK)
            if len((found := self._detect()).touches):
                self.campaign.accept(found)
                self.target, self._waits_until = None, np.inf
            yield
        yield from self._go_on()

    def _give_up(self, fault: Fault, *, is_fault: bool = True) -> None:
        """Stops, and retracts where that may be done."""
        where = self.status.phase
        self.end = End(3, f'{fault} (in {where})' if is_fault else str(fault))
        self.status = Status('stopped', self.end.reason, is_fault, self._values())
        self._script = self._retract(may_retract=fault.may_retract)

    def _retract(self, *, may_retract: bool) -> Iterator[None]:
        """Stands, then goes back along the way it came: to the beginning of an approach, else a little."""
        self._command, motion, began = self._stand(), self._motion, self._now
        yield
        if motion is None or not may_retract:
            return
        while self._now - began < 1.0 and not self.senses.knows_joints(self._now, SILENT):  # a moment's silence passes
            yield
        off_track = _OFF_APPROACH if self._contact else _OFF_TRACK
        at = min(motion.at, self._on_way(motion, off_track))
        motion = self._motion = Motion(motion.track, self.cell.touch.contact_speed, at, ramps=False)
        self._is_behind, self._seen_at = False, self._now
        goal = 0.0 if self._contact else max(0.0, motion.at - _BACK)
        force, began = self.senses.force, self._now
        while motion.at > goal:
            if not self.senses.knows_joints(self._now, SILENT):
                raise Fault('no joint states while retracting', may_retract=False)
            if self._now - began > 0.3 and self.senses.force > max(1.2 * force, self.cell.touch.max_force):
                raise Fault('the force grows while retracting', may_retract=False)
            self._check_place(off_track)
            self._move(motion, goal)
            yield
        self._motion, self._contact = None, False
        if self.senses.force > self._free_limit and not self.senses.problem(self._now):
            self._add(f'{self.senses.force:.1f} N remain after retracting: a force in free motion')

    def _add(self, text: str) -> None:
        """What has gone wrong at the end."""
        self.status = self.status._replace(text=f'{self.status.text}; {text}', is_fault=True)
        self.end = End(3, self.status.text)

    @property
    def _free_limit(self) -> float:
        """Largest force in free motion, N."""
        return max(0.25 * self.cell.touch.force[0], 10 * self.senses.noise)
