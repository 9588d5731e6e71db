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
from math import hypot
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import HELD_WITHIN, Cell
from scara_kinetostatic.model.kinetostatics import press_aside, tip_yield
from scara_kinetostatic.model.parameters import MICRO, MILLI, Parameters
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.planning.motion import Waypoints
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.planning.program import CONTACT, joint_angles
from scara_kinetostatic.running.campaign import Campaign, End, Target, Worker, length
from scara_kinetostatic.running.robot import (
    LIFT_SPEED,
    OFF_APPROACH,
    Command,
    Commander,
    Fault,
    Senses,
    Track,
    Traversal,
)
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
_QUIET = 0.5
"""So long all must be well before it goes on after an interruption, s; that of a touch is then judged within twice."""
_LARGEST_ZERO = 0.5
"""Zero of the sensor at the start up to this part of the smallest force of a touch: more is a contact, or no zero."""
_FAST = 0.02
"""Towards a contact, as far as none can be expected, m/s; a stop from it has to stay below the largest force."""
_PRESS_SPEED = 2 * MILLI
"""Largest in a contact, m/s."""
_BACK = 0.02
"""How far it goes back after a contact on the way, m."""
_PAST = 4 * MILLI
"""How far the track of an approach leads on behind the end of the search, m."""
_CLEAR = MILLI / 2
"""How far from the surface it is before it retracts fast, m."""
_WAIT = 0.12
"""Between a motion in contact and the measurement of the force, s: less than what would be a hold."""
_FROM_GOAL, _SOON = 0.07, 0.03
"""A force is reached within such a part of it; a step towards it ends within the other."""
_STEPS = 40
"""Towards a force."""
_JUDGED = 6.0
"""Time within which a touch is judged, s."""
_STEP = 5e-3
"""Distance of the points of a track, m; tenth of that towards a contact."""
_PLACES = 60
"""Of a track in contact."""
_GENTLE = 0.2
"""Of the wanted force: by so much it may grow in `DELAY` while it is pressed."""


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
        robot: is commanded.
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
        self.cell, self.robot, self._patience = cell, Commander(cell, Senses(cell)), patience
        self.campaign = Campaign(cell, most, planner, work)
        self._detect = detect
        self.status = Status('idle', 'not started')
        self.target: Target | None = None
        self.end: End | None = None
        self._surface = self._steepest = 0.0  # of the contact: its place on the track, m, and N/s
        self._waits_until, self._disturbed = np.inf, -np.inf
        self._script: Iterator[None] | None = None
        self._former: Runner | None = None
        self._paused = False

    @property
    def senses(self) -> Senses:
        """Takes the samples."""
        return self.robot.senses

    @property
    def _now(self) -> float:
        return self.senses.now

    # From outside

    def take_over(self, former: Runner) -> None:
        """Begins by retracting the touch in which a former run has left the robot, where it still stands there."""
        if former.is_in_contact:
            self.robot.senses, self.target, self._former = former.senses, former.target, former._former or former

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
        return self.status.text if is_waiting else self.senses.problem()

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
        return self._former is not None or (self.robot.in_contact and self.robot.motion is not None)

    @property
    def is_over(self) -> bool:
        """Whether it has ended and the robot stands."""
        return self.end is not None and self._script is None

    def note(self, now: float) -> float:
        """Time that has passed, s; call it, too, when a command has been sent: a tick that plans takes long.

        Args:
            now: s.
        """
        return self.senses.note(now)

    def tick(self, now: float) -> Command | None:
        """Goes on; call it often, with every sample.

        Args:
            now: s.

        Returns:
            What the robot is to do; None where that does not change.
        """
        robot = self.robot
        robot.advance(self.note(now))  # also while nobody has ticked
        robot.order = None
        if self._script is None:
            return None
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
            robot.stand()
        except (ScaraKinetostaticError, BrokenExecutor, OSError) as error:  # of the calibrating process, too
            self._give_up(Fault(str(error)))
            robot.stand()
        return robot.order

    def _check(self, *, loosely: bool = False) -> None:
        """Check the sensors and the robot.

        Args:
            loosely: see `Commander.on_way`.

        Raises:
            Fault: the robot must not go on.
        """
        self.senses.check()
        force, most = self.senses.force, self.cell.touch.max_force
        if force > most:
            raise Fault(f'a force of {force:.0f} N, more than touch.max_force, {most:g} N')
        before, jump, lasting = self.senses.jump()
        if self.robot.in_contact and jump > self._steepest * lasting + self.senses.doubt + 0.1 * most:
            kind = _Slid if force < hypot(*before) else Fault
            raise kind(f'the force jumps by {jump:.0f} N: no motion of the robot explains that')
        self.robot.check(loosely=loosely)

    def _pass(self, duration: float, *, is_ordered: bool = False) -> Iterator[None]:
        """Lets time pass, s, while all is well; with the next tick on, where a command is to be sent in this one."""
        began = self._now
        if is_ordered:
            yield
        while self._now - began < duration:
            self._check()
            yield

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
                chosen = self.campaign.choose(self.robot.here()[:2], self.target)
            if isinstance(chosen, End):  # the robot stands free; with a lift, the tip is raised
                if self.cell.lift is not None and self.robot.place is not None:
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
                self._check()
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

    def _begin(self) -> Iterator[None]:
        """Waits for the sensors, checks all that can be checked before anything moves, and goes on.

        Raises:
            Fault: something is wrong.
        """
        cell, began, forgot = self.cell, self._now, self._now
        while (problem := self.senses.problem()) or self.senses.is_excused() or self._now - began < 0.5:
            self._say('idle', problem or 'listening to the sensors')
            if self._now - forgot > 1.0:
                self.senses.forget_delays()
                forgot = self._now
            if self._now - began > 5.0:
                raise Fault(problem or 'this machine does not keep up with the sensors', may_retract=False)
            yield
        if not self.senses.stands():
            raise Fault('the joints move: something else moves the robot', may_retract=False)
        if self._former is not None:
            yield from self._leave(self._former)
        zero, most = self.senses.tare(), _LARGEST_ZERO * cell.touch.force[0]
        if zero > most:
            text = f'the sensor reads {zero:.1f} N, more than {most:g} N, where nothing must be touched'
            raise Fault(f'{text}: retract the tip, or set the zero of the sensor', may_retract=False)
        limits = np.array(cell.limits)
        if not ((self.senses.joints > limits[:, 0]) & (self.senses.joints < limits[:, 1])).all():
            raise Fault('the robot stands beyond robot.limits: move it', may_retract=False)
        self.robot.halt(self.robot.here())  # a controller that refuses says so now
        yield from self._pass(0.2, is_ordered=True)
        if cell.lift is not None:
            yield from self._raise(cell.lift.up)
        yield from self._go_on()

    def _leave(self, former: Runner) -> Iterator[None]:
        """Retracts the touch in which a former run has left the robot, unless that was moved meanwhile."""
        motion = former.robot.motion
        assert motion is not None
        near, away = motion.track.nearest(self.senses.place, motion.at)
        self._former = None
        if away < OFF_APPROACH:
            self.robot.motion, self.robot.in_contact, self._surface = motion, True, former._surface
            self._resume(near)
            self._say('retract', 'retracting the touch of the former run')
            yield from self._back()
            for _ in self._pass(2 * _QUIET):
                self._detect()  # a touch that is found now is none of this run
                yield
            self.robot.place = None
        self.target = None

    def _resume(self, near: float) -> None:
        """Takes the motion up where the robot stands, at a length of its track, m."""
        self.robot.resume(near)
        self.senses.jump()

    def _raise(self, goal: float) -> Iterator[None]:
        """Moves the lift, and sees that it moves.

        Raises:
            Fault: it does not.
        """
        lift, here = self.cell.lift, self.robot.here()
        assert lift is not None
        if abs(here[2] - goal) < MICRO and self._arrived(goal):
            return
        track = Track.of(np.array([here, [*here[:2], goal]]), self._parameters)
        yield from self._follow(track, min(LIFT_SPEED, self.cell.touch.speed))
        began = self._now
        while not self._arrived(goal):
            if self._now - began > 1.0:
                at = self.senses.lift
                text = 'nowhere' if at is None else f'{at:.4f} m'
                raise Fault(f'{lift.joint} (robot.lift) is at {text}, commanded {goal:g} m: it does not lift')
            self._check()
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
        motion = self.robot.follow(track, speed)
        limit = self._free_limit
        while motion.at < track.length:
            self._check()
            self._check_lift(track)
            if self.senses.force > limit:
                raise Fault(f'a force of {self.senses.force:.1f} N on the way: a contact where none must be')
            self.robot.move(track.length, is_free=True)
            yield
        yield from self._stopped()
        self.robot.motion = None

    def _check_lift(self, track: Track) -> None:
        """Check that the lift is up wherever the arm is under way, on a track that is raised.

        Raises:
            Fault: it is not.
        """
        at, lift = self.senses.lift, track.places[:, 2]
        up, away = lift[len(lift) // 2], np.abs(track.places[[0, -1], :2] - self.senses.joints).max(axis=1).min()
        if np.ptp(lift) and at is not None and away > OFF_APPROACH and abs(at - up) > 2 * HELD_WITHIN:
            raise Fault(f'the lift is at {at:.4f} m, not at {up:g} m, while the arm moves', may_retract=False)

    def _stopped(self, *, loosely: bool = False) -> Iterator[None]:
        """Waits until the joints stand where they were commanded to be."""
        began = self._now
        while self._now - began < 0.1 or not self.senses.stands():
            self._check(loosely=loosely)
            if self.robot.is_behind:
                began = self._now
            if self._now - began > 2.0:
                raise Fault('the joints do not come to rest', may_retract=False)
            yield

    def _travel(self, target: Target, way: Waypoints) -> Iterator[None]:
        """To where the approach begins."""
        planner, cell = self._planner, self.cell
        self._say('travel', f'next: {self.campaign.name(target)}, {target.reason}')
        self._tare('where nothing is touched', may_retract=False)
        here = self.robot.here()
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
            weight = max(speed / LIFT_SPEED, 1.0)
        yield from self._follow(Track.of(np.column_stack([joints, lift]), self._parameters, weight), speed)

    def _tare(self, where: str, *, may_retract: bool = True) -> None:
        """Takes the force in free motion as zero.

        Raises:
            Fault: it has changed by too much.
        """
        if (zero := self.senses.tare()) > self._free_limit:
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
        plan, touch, robot = target.plan, self.cell.touch, self.robot
        goal, name = float(plan.force[0]), self.campaign.name(target)
        track, expected, deepest = self._approach(target)
        compliance = self._compliance(target, track.places[0, :2])
        self._tare('in free motion')
        self._say('approach', f'approaching {name}')
        threshold = max(CONTACT * goal, 6 * self.senses.noise, 1.0)
        speed = np.clip((0.8 * goal - threshold) * compliance / DELAY, _LEAST_SPEED, touch.contact_speed)
        fast = float(np.clip(touch.max_force * compliance / DELAY, speed, _FAST))
        slow, now = expected - self._planner.doubt, self._planner.now
        self._surface, self._steepest = 0.0, max(_STIFFER * touch.contact_speed, fast) / compliance
        self.senses.jump()
        robot.in_contact = True
        motion = robot.follow(track, fast, ramps=False, slow=(slow, float(speed)))
        for _ in range(4):
            while self.senses.force < threshold:
                self._check()
                if motion.at >= deepest:
                    where = f'within touch.search, {touch.search / MILLI:g} mm, of its place'
                    raise Fault(f'no contact with {name} {where}')
                robot.move(deepest, slow if now is None or np.isinf(now) else expected)
                yield
            yield from self._pushed(0.0, 0.0)
            if self.senses.force > threshold / 2:
                break
            yield from self._pushed(0.0, 0.0)  # an arm with play swings back from the surface: from free again
        else:
            raise Fault(f'the contact with {name} is lost again and again')
        surface = self._surface = motion.at
        self._say('press', f'pressing to {goal:g} N')
        track, way = self._into(track, surface, target)
        yield from self._press(track, motion.at, goal * (1 + float(plan.preload[0])), way)
        if plan.preload[0] > 0:
            before, at = track, self._motion.at
            track, way = self._out_of(before, at, target)
            self._surface = track.nearest(before.place(surface), surface)[0]
            yield from self._press(track, track.length, goal, way)
        self._say('hold', f'holding {self.senses.force:.1f} N')
        yield from self._pass(touch.hold + 0.1)
        self._say('retract', 'retracting')
        yield from self._back()

    @property
    def _motion(self) -> Traversal:
        """That is under way."""
        assert self.robot.motion is not None
        return self.robot.motion

    def _approach(self, target: Target) -> tuple[Track, float, float]:
        """The track of an approach; the lengths at which the contact is expected, and up to which it is sought, m."""
        plan, planner, here = target.plan, self._planner, self.robot.here()
        start, normal = planner.approach(plan).tip[0], plan.normal(self.cell)[0]
        begin = planner.space.clearance + MILLI + self.cell.touch.search
        depths = np.linspace(0.0, begin + _PAST, int((begin + _PAST) / (0.1 * _STEP)) + 2)
        joints = joint_angles(
            planner, Waypoints(start - depths[:, None] * normal, np.full(len(depths), plan.posture[0]))
        )
        joints[0] = here[:2]
        track = Track.of(np.column_stack([joints, np.full(len(depths), here[2])]), self._parameters)
        expected, deepest = np.interp([begin - self.cell.touch.search, begin], depths, track.at).tolist()
        return track, expected, deepest

    def _into(self, track: Track, surface: float, target: Target) -> tuple[Track, float]:
        """The way of an approach, from the surface on of a press that drags the tip aside; length per force, m/N."""
        newtons = (track.length - surface) / self._compliance(target, track.place(surface)[:2])
        pressed = self._pressed(track.place(surface), np.linspace(0.0, newtons, _PLACES), -1.0, target)
        whole = Track.of(np.concatenate([track.places[track.at < surface], pressed]), self._parameters)
        return whole, (whole.length - surface) / newtons

    def _out_of(self, track: Track, at: float, target: Target) -> tuple[Track, float]:
        """Backwards a way out of a press: some of it drags the tip to the same side; length per force, m/N."""
        newtons = 1.5 * float((target.plan.preload * target.plan.force)[0])
        pressed = self._pressed(track.place(at), np.linspace(newtons, 0.0, _PLACES), 1.0, target)
        whole = Track.of(np.concatenate([track.places[:1], pressed]), self._parameters)
        return whole, (whole.length - float(whole.at[1])) / newtons

    def _pressed(self, here: Floats, newtons: Floats, sense: float, target: Target) -> Floats:
        """Places beside one, (k, 3), under k forces along the normal of a touch, into the object or out of it."""
        normal, aside = sense * target.plan.normal(self.cell), -sense * target.plan.aside
        per_newton = press_aside(self._parameters, here[None, :2], normal, aside)
        return here + np.pad(newtons[:, None] * per_newton, ((0, 0), (0, 1)))

    def _pushed(self, step: float, until: float) -> Iterator[None]:
        """Moves by a step towards the contact, or back, and waits; ends early where the force comes to a value."""
        motion, sign = self._motion, np.sign(step)
        goal = float(np.clip(motion.at + step, 0.0, motion.track.length))
        while motion.at != goal and sign * (self.senses.force - until) < 0:
            self._check()
            self.robot.move(goal)
            yield
        self.robot.halt_motion()
        began = self._now
        yield
        while self._now - began < (2 if self.robot.is_behind else 1) * _WAIT:
            self._check()
            yield

    def _press(self, track: Track, at: float, goal: float, compliance: float) -> Iterator[None]:
        """To a force: from below forwards on a track, from above backwards.

        Args:
            track: the way.
            at: where on it the robot is, m.
            goal: the force, N.
            compliance: length per force, m/N.

        Raises:
            Fault: the force does not grow.
        """
        speed = float(np.clip(_GENTLE * goal * compliance / DELAY, _LEAST_SPEED / 2, _PRESS_SPEED))
        motion = self.robot.follow(track, speed, at, ramps=False)
        is_eased, sense = at == track.length, -1.0 if at == track.length else 1.0
        if not is_eased:
            self._steepest = _STIFFER * speed / compliance  # of the approach nothing is left
        softer = 1.0
        for _ in range(_STEPS // 2 if is_eased else _STEPS):
            force = self.senses.mean_force()
            missing = sense * (goal - force)
            if missing < _FROM_GOAL * goal:
                return
            before = motion.at
            yield from self._pushed(sense * 0.9 * missing * softer * compliance, (1 - sense * _SOON) * goal)
            if is_eased:
                continue
            gained = self.senses.mean_force() - force
            seen = (motion.at - before) / max(gained, MILLI) / compliance
            softer = float(np.clip(seen, max(_GENTLE, softer / 2), softer * 2))
            if motion.at >= track.length:
                raise Fault(f'the force stays at {force:.1f} N, wanted {goal:.0f} N: the object gives way, or slides')
        if not is_eased:
            raise Fault(f'the force does not come to {goal:.0f} N')

    def _slid(self, slide: Fault) -> Iterator[None]:
        """Stands, and retracts where the tip still presses.

        Raises:
            Fault: it does not, or the sensor has died: another approach would not feel the object.
        """
        self.robot.stand()
        yield from self._pass(_WAIT, is_ordered=True)
        if self.senses.mean_force() < self._free_limit:
            raise Fault(f'{slide}; none is left')
        self._say('retract', f'retracting: {slide}')
        yield from self._back()

    def _back(self) -> Iterator[None]:
        """To where the approach began: in contact slowly, then as through free space.

        Raises:
            Fault: a force remains.
        """
        assert self.target is not None
        before, robot, slow = self._motion, self.robot, self.cell.touch.contact_speed
        self._steepest = _STIFFER * slow / self._compliance(self.target, robot.here()[:2])
        clear = max(self._surface - _CLEAR, 0.0)
        motion = robot.follow(before.track, self._travel_speed(), before.at, slow=(clear, slow))
        for goal in (clear, 0.0) if robot.streams else (0.0,):
            while motion.at > goal or not robot.has_left(clear):
                self._check(loosely=True)
                robot.move(goal, is_free=robot.streams and goal < clear)
                yield
        yield from self._stopped(loosely=True)
        if self.senses.force > 2 * self._free_limit:
            raise Fault(f'a force of {self.senses.force:.1f} N remains after the touch', may_retract=False)
        robot.in_contact, robot.motion = False, None

    def _judgement(self, target: Target) -> Iterator[None]:
        """Waits for the judgement of the touch, and acts on it."""
        self._say('judge', 'waiting for the judgement of the touch')
        asked, failure = -np.inf, 'the touch was not found in the streams'
        for _ in self._pass(_JUDGED):
            if self._now - asked > 0.1:
                asked = self._now
                found = self._detect()
                if len(found.touches):
                    self.campaign.accept(found)
                    return
                if found.found:
                    failure = found.rejected[-1].reason
                    break
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
        self.robot.stand()
        self._disturbed, asked, near = self._now, -np.inf, 0.0
        text = f'{reason}; waiting for {self._waits_until - self._now:.0f} s at most'
        self.status = Status('waiting', text, values=self._values())
        yield
        while asked <= self._disturbed or self._now - self._disturbed < _QUIET:
            if self._now > self._waits_until:
                raise Fault(f'{reason}; waited for {self._patience:g} s', may_retract=may_retract)
            if self.senses.force > self.cell.touch.max_force:
                text = f'{reason}; a force of {self.senses.force:.1f} N while it waits'
                raise Fault(text, may_retract=may_retract)
            if self.senses.problem() or self.senses.is_excused() or not self.senses.stands():
                self._disturbed = self._now
            elif asked <= self._disturbed < self._now - 0.5 * _QUIET and self.senses.knows_joints():
                near, asked = self.robot.on_way(), self._now
                self.robot.stand()  # a controller that still refuses says so
            yield
        if not self.robot.in_contact and self.senses.force > self._free_limit:
            text = f'{reason}; now there is a force of {self.senses.force:.1f} N where nothing must be touched'
            raise Fault(text, may_retract=False)
        self._resume(near)
        if self.robot.in_contact:
            self._say('retract', f'going on after: {reason}')
            yield from self._back()
        self.robot.motion = None
        self._say('judge', f'going on after: {reason}')
        began = self._now
        while self.target is not None and self._now - began < 2 * _QUIET:  # a touch that is good counts all the same
            self._check()
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
        robot, began = self.robot, self._now
        robot.stand()
        yield
        if robot.motion is None or not may_retract:
            return
        while self._now - began < 1.0 and not self.senses.hears_joints():  # a moment's silence passes
            yield
        at = min(robot.motion.at, robot.on_way())
        motion = robot.follow(robot.motion.track, self.cell.touch.contact_speed, at, ramps=False)
        robot.wait_no_more()
        goal = 0.0 if robot.in_contact else max(0.0, motion.at - _BACK)
        force, began = self.senses.force, self._now
        while motion.at > goal:
            if not self.senses.hears_joints():
                raise Fault('no joint states while retracting', may_retract=False)
            if self._now - began > 0.3 and self.senses.force > max(1.2 * force, self.cell.touch.max_force):
                raise Fault('the force grows while retracting', may_retract=False)
            robot.check()
            robot.move(goal)
            yield
        robot.motion, robot.in_contact = None, False
        if self.senses.force > self._free_limit and not self.senses.problem():
            self._add(f'{self.senses.force:.1f} N remain after retracting: a force in free motion')

    def _add(self, text: str) -> None:
        """What has gone wrong at the end."""
        self.status = self.status._replace(text=f'{self.status.text}; {text}', is_fault=True)
        self.end = End(3, self.status.text)

    @property
    def _free_limit(self) -> float:
        """Largest force in free motion, N."""
        return max(self.cell.touch.force[0] / 4, self.senses.doubt)
