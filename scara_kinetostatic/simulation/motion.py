"""The motion of a simulated robot from contact to contact: through touches, and along outlines.

Between contacts the arm travels straight in joint space (`Course`), with its third axis lifted, so that the tip may
pass over the discs without force. A touch (`Trajectory`) runs through eight phases (`Phase`). It comes from the free
pose, on the normal of the disc at a clearance, in joint space to the pose at which the backlash is used up and the
force begins, `Ḡ(S, 0+)`. From there on the contact S stays and the force follows its time law: Q(t) = Ḡ(S, F(t)),
hence F(t) = A(Q(t), L̄) all along, without an inner solve. Every phase follows the minimum-jerk law 10 s³ - 15 s⁴ +
6 s⁵. A press with preload goes beyond the force of the hold and eases down to it; without, that phase lasts no time.

A robot with effects (`ExtendedModel`) is pressed along the same line: its controller knows the base model alone and
goes deeper, or less deep, until the force of the plan is there. So the rigid tip H(Q) is where the base model has it
under the same force, but for its place along the normal n of the plan. The tip is where the true object is, and the
force has the planned size, with the direction that object and friction give it. Q(t) is Ḡ with the effects, and F(t) is
A(Q(t), L̄) with them. What joints with memory keep goes from touch to touch along the whole plan, with preloads,
unloading and the free motion between touches; see `load_history`.

**Where the tip is.** S = S_planned + u n + v t, n inward. With d what the effects on the object add and n_F the
direction of the force, (11) is w = (r - u) n - v t, w = r n_F + d; on a straight edge w = (r - u) n. v, by which the
rigid tip comes to its line, and n_F, which turns with w, are found by fixed-point iteration.

**Slides.** The outline consists of straight edges and arcs, or is a circle. The object is on the left of the direction
of travel along it, the tip slides on the right: a closed outline is counter-clockwise. The centre of the tip is on the
outline grown by the tip's radius (`model.outline`): at a sharp corner the surface stays while the normal turns, so that
the centre moves on an arc around the corner.

The repeatability of a touch (`cell.noise`) is here an error of the same size that changes slowly along the slide
(`SlideTiming.variation_time`); its force part grows and falls with the force, as in a touch. White noise, zero, frame,
sign, resolution and stamps are those of `SensorModel`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, as_complex, pairs
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata, TouchState, as_model
from scara_kinetostatic.model.kinematics import forward, quarter_turn, wrap
from scara_kinetostatic.model.kinetostatics import Equilibrium, Force, Law, inverse_kinetostatics, joints_under_load
from scara_kinetostatic.model.outline import Outline, surfaces_of
from scara_kinetostatic.model.parameters import MICRO, MILLI, Parameters
from scara_kinetostatic.model.play_operator import remembered
from scara_kinetostatic.model.touch import stacked_histories, torques_of
from scara_kinetostatic.simulation.plan import CLEARANCE, Circle, Plan, Slide, check_numbers
from scara_kinetostatic.touches.load_history import last_movement

Robot: TypeAlias = ExtendedModel | Parameters
"""A simulated robot: its parameters, or the model with its effects."""
Phase = IntEnum('Phase', 'TRAVEL PAUSE APPROACH PRESS EASE HOLD RELEASE RETRACT', start=0)
"""Of a touch."""


@dataclass(frozen=True)
class Timing:
    """Durations of the phases of a touch, s.

    Attributes:
        travel: shortest travel between two touches.
        pause: rest at the free pose before the approach.
        approach: from the free pose to the disc.
        press: from no force to the force of the hold, or to the peak beyond it.
        ease: from the peak down to the force of the hold, for touches with preload.
        hold: at rest under the force.
        release: back to no force.
        retract: back to the free pose.
        speed: largest mean speed of a joint during the travel, rad/s.
        clearance: distance of the free pose from the disc, m.

    Raises:
        ParameterError: a value that is not above 0 (0 is fine for the pause).
    """

    travel: float = 0.6
    pause: float = 0.1
    approach: float = 0.4
    press: float = 0.3
    ease: float = 0.2
    hold: float = 0.5
    release: float = 0.2
    retract: float = 0.2
    speed: float = 4.0
    clearance: float = CLEARANCE

    def __post_init__(self) -> None:
        check_numbers('timing', self, zero=('pause',))


def minimum_jerk(part: Floats) -> Floats:
    """10 s³ - 15 s⁴ + 6 s⁵: from 0 to 1, at rest at both ends."""
    return part**3 * (10.0 + part * (6.0 * part - 15.0))


def load_histories(
    peaks: Floats, holds: Floats, has_preload: Mask, parameters: Parameters, frame: SensorFrame = SensorFrame.BASE
) -> Floats:
    """The histories of the touches of a plan, as in `TouchSet.history`, (3, m, K, 4).

    Before the press; before the hold, with the preload; before the release, with the hold.

    Args:
        peaks: Q, rad, and F, N, under the largest force of each touch in the order of time, (m, 4).
        holds: the same in the hold.
        has_preload: whether the peak is beyond the hold, (m,).
        parameters: L̄, which tells the torques that a memory keeps.
        frame: that of the forces.
    """
    points = np.stack([peaks, holds, holds * (1, 1, 0, 0)], axis=1).reshape(-1, 4)
    torques = [(first, second) for first, second in torques_of(parameters, points, frame).tolist()]
    stages: list[Floats] = []
    memory: list[int] = []
    for place in range(len(points)):
        stages.append(points[memory])
        if place % 3 or has_preload[place // 3]:
            memory.append(place)
            memory = [memory[k] for k in remembered([torques[one] for one in memory])]
    found = stacked_histories(stages, np.repeat(holds[:, :2], 3, axis=0))
    return found.reshape(len(holds), 3, -1, 4).swapaxes(0, 1)


HOME = (0.25, -0.15)
"""Of the joints, from the nearest contact, rad."""
FIRST_FORCE = MICRO
"""The 0+ of `Ḡ(S, 0+)`, N: defines the direction of the force, its deflection is negligible."""
_MOST_DEPTH = 0.02
"""How far the object may be from where the plan has it, along the line of the press, m."""
_MOST_PASSES = 60
"""Until places and forces, or poses and histories agree: ten or so do, more where the tip all but sticks."""
_PRESS, _HOLD, _RELEASE = range(3)
"""Stages of a touch by the load before them, see `load_histories`."""


class CellState(NamedTuple):
    """The state of the cell at k times.

    Attributes:
        joints: actuator angles Q, (k, 2), rad.
        force: force on the object in the base frame, (k, 2), N.
        touch: number of the touch or slide, (k,); after the last, the last.
        phase: which `Phase`, or `SlidePhase`, (k,); both begin with the travel.
        progress: how much of the phase has passed, by the time law, 0 to 1, (k,).
        relative_force: contact force over that of the hold, 0 to about 1 + preload, or over the planned one, (k,).
    """

    joints: Floats
    force: Floats
    touch: Indices
    phase: Indices
    progress: Floats
    relative_force: Floats


class Motion:
    """A motion from contact to contact.

    Attributes:
        duration: of the whole motion, s.
        count: of the contacts, m.
    """

    duration: float
    count: int

    def state_at(self, time: ArrayLike) -> CellState:
        """The state of the cell at times since the start, (k,), s; before it and past the end the arm rests."""
        raise NotImplementedError

    def errors_at(self, time: Floats, state: CellState, seed: int) -> Floats:
        """Errors of joint angles and force at k moments, in standard deviations, (2, k, 2).

        One of each contact; those of the joints change from one to the next during the travel.
        """
        unit = np.random.default_rng([seed, 0]).standard_normal((2, self.count, 2))
        travels = state.phase == Phase.TRAVEL
        before = np.where(travels, np.maximum(state.touch - 1, 0), state.touch)
        share = np.where(travels, state.progress, 1.0)[:, None]
        return np.asarray((1.0 - share) * unit[:, before] + share * unit[:, state.touch])


class Moments(NamedTuple):
    """Where a motion is at k times.

    Attributes:
        contact: which one, or the next one during the travel, (k,); on the way home m.
        phase: number of its phase, (k,), 0 for the travel.
        progress: how much of the phase has passed, by the time law, 0 to 1, (k,).
        joints: of the travel, where it is one, (k, 2), rad.
    """

    contact: Indices
    phase: Indices
    progress: Floats
    joints: Floats

    def select(self, which: Indices) -> Moments:
        """Some of them."""
        return Moments(self.contact[which], self.phase[which], self.progress[which], self.joints[which])

    def part(self, phase: int) -> Floats:
        """How much of a phase has passed, 0 to 1, by the time law, (k,)."""
        return np.where(self.phase == phase, self.progress, self.phase > phase)


class Course:
    """The travels between contacts, straight in joint space, and the phases of each contact.

    Args:
        ends: joint angles where each contact begins and ends, (m, 2, 2), rad.
        durations: of its phases, (m, p), s.
        travel: shortest duration of a travel, s.
        speed: largest mean speed of a joint there, rad/s.

    Attributes:
        knots: start of the travel to each contact and of each of its phases, (m, 1 + p), s.
        duration: of all with the way home, s.
    """

    def __init__(self, ends: Floats, durations: Floats, travel: float, speed: float = 4.0) -> None:
        home = ends[[0, -1], [0, 1]] + HOME
        self._ways = np.concatenate([home[:1], ends.reshape(-1, 2), home[1:]]).reshape(-1, 2, 2)
        travels = np.maximum(travel, np.abs(np.diff(self._ways, axis=1)).max(axis=(1, 2)) / speed)
        spans = np.append(np.column_stack([travels[:-1], durations]), travels[-1])
        self._times = np.append(0.0, np.cumsum(spans))
        self.knots, self.duration = self._times[:-2].reshape(len(ends), -1), float(self._times[-1])

    def at(self, time: ArrayLike) -> Moments:
        """Where it is at times in s, (k,); before the start and past the end at rest."""
        time = np.clip(np.atleast_1d(np.asarray(time, dtype=float)), 0.0, self.duration)
        row = np.minimum(np.searchsorted(self._times, time, side='right') - 1, len(self._times) - 2)
        begins, spans = self._times[row], np.diff(self._times)[row]
        progress = minimum_jerk(np.divide(time - begins, spans, out=np.ones_like(time), where=spans > 0))
        contact, phase = np.divmod(row, self.knots.shape[1])
        begin, end = self._ways[contact].transpose(1, 0, 2)
        return Moments(contact, phase, progress, begin + progress[:, None] * (end - begin))


class _End(NamedTuple):
    """Where `Trajectory._pressed` ended: depth and displacement aside, (k,), m, direction of the force, and the arm."""

    depth: Floats
    aside: Floats
    direction: NDArray[np.complex128]
    found: Equilibrium


class Trajectory(Motion):
    """The trajectory of one cell through one plan.

    Args:
        cell: discs, sign of the gripper's law.
        truth: the simulated robot, with its effects.
        plan: the touches.
        timing: how long the phases last.

    Attributes:
        knots: start of every phase, (m, 8), s.
        hold_joints: Q in each hold, (m, 2), rad.
        hold_force: F on the object in each hold, base frame, (m, 2), N.
        peak_joints: Q under the largest force, (m, 2), rad; that of the hold without preload.
        peak_force: the largest force on the object, base frame, (m, 2), N.
        contact_joints: Q at which each contact begins, (m, 2), rad.
        free_joints: Q of each free pose, (m, 2), rad.
        metadata: disc, time, approach, posture, press and history of each touch.

    Raises:
        UnsupportedDataError: the plan is empty, or the simulated robot cannot reach a touch or hold its force.
    """

    def __init__(self, cell: Cell, truth: Robot, plan: Plan, timing: Timing | None = None) -> None:
        self.cell, self.plan, self.timing = cell, plan, timing or Timing()
        self.model = as_model(truth)
        self.truth = self.model.parameters
        if not len(plan):
            raise UnsupportedDataError('the plan holds no touch', 'plan at least one')
        self._contact, self._inward = plan.contact(cell), -plan.normal(cell)
        self._surfaces = cell.surfaces.select(plan.surface(cell))
        self.count, every, still = len(plan), np.arange(len(plan)), np.zeros((len(plan), 2))
        self.metadata = TouchMetadata(plan.disc, still[:, 0], still, plan.posture, still)
        self.metadata = self.metadata._replace(order=every, surface=plan.surface(cell))
        self._histories, self._ends = np.zeros((3, len(plan), 0, 4)), dict[str, _End]()
        self._solve_poses()
        spans = [getattr(self.timing, phase.name.lower()) for phase in list(Phase)[1:]]
        durations, ends = np.tile(spans, (len(plan), 1)), np.stack([self.free_joints, self.free_joints], axis=1)
        durations[:, Phase.EASE - 1] *= plan.preload > 0
        self._course = Course(ends, durations, self.timing.travel, self.timing.speed)
        self.knots, self.duration = self._course.knots, self._course.duration
        self._remember()
        if self.model.effects:
            self._agree()

    def _solve_poses(self) -> None:
        """Joint angles and forces at the ends of the phases.

        Raises:
            UnsupportedDataError: the simulated robot cannot reach a touch.
        """
        every, ones = np.arange(self.count), np.ones(self.count)
        self.hold_joints, self.hold_force, *depths = self._pressed(every, ones, _HOLD, 'hold')
        contact_joints, _, at_first = self._pressed(every, 0.0 * ones, _PRESS, 'first')
        peak_joints, self.peak_force, at_peak = self._pressed(every, 1.0 + self.plan.preload, _PRESS, 'peak')
        clear = self._contact - self.timing.clearance * self._inward
        free_joints = self._without_effects(clear, np.zeros_like(clear), every)
        self.contact_joints, self.peak_joints, self.free_joints = (
            self._near_hold(joints) for joints in (contact_joints, peak_joints, free_joints)
        )
        poses = np.hstack([self.hold_joints, self.peak_joints, self.contact_joints, self.free_joints])
        is_near = (np.abs([*depths, at_first, at_peak]) < _MOST_DEPTH).all(axis=0)
        lost = np.flatnonzero(~(np.isfinite(poses).all(axis=1) & is_near))
        if len(lost):
            name = self.cell.discs[self.plan.disc[lost[0]]].name
            problem = f'the simulated robot cannot reach touch {lost[0]} of the plan, on {name!r}, or does not settle'
            remedy = 'leave the touch out, move the disc, or simulate smaller effects or offsets'
            raise UnsupportedDataError(problem, remedy)

    def _agree(self) -> None:
        """Poses and what effects know of the touches, until they agree."""
        for _ in range(_MOST_PASSES):
            before = np.stack([self.peak_joints, self.hold_joints, self.contact_joints])
            self._solve_poses()
            self._remember()
            if np.abs(before - (self.peak_joints, self.hold_joints, self.contact_joints)).max() < 1e-13:
                return
        problem = 'the joint angles of the touches and the loads before them do not come to agree'
        raise UnsupportedDataError(problem, 'simulate smaller effects')

    def _remember(self) -> None:
        """Movements and loads before the stages of each touch, by the joints and forces as they are now."""
        path = np.stack([self.free_joints, self.contact_joints, self.peak_joints])
        approach, press = (last_movement(part, self.hold_joints) for part in (path, path[1:]))
        peaks, holds = np.hstack([self.peak_joints, self.peak_force]), np.hstack([self.hold_joints, self.hold_force])
        self._histories = load_histories(peaks, holds, self.plan.preload > 0, self.truth)
        known = {'time': self.hold_time, 'approach': approach, 'press': press, 'history': self._histories[_HOLD]}
        self.metadata = self.metadata._replace(**known)

    def _pressed(
        self, touch: Indices, relative_force: Floats, stage: Indices | int, end: str = ''
    ) -> tuple[Floats, Floats, Floats]:
        """Ḡ on the line of the press, for k moments of touches.

        Args:
            touch: number of the touch, (k,).
            relative_force: over that of the hold, (k,).
            stage: `_PRESS`, `_HOLD` or `_RELEASE`, (k,) or one for all.
            end: name of these moments where they are asked for again, with other histories.

        Returns:
            Q, (k, 2), rad, NaN where the place is out of reach; F on the object, (k, 2), N; u, (k,), m,
            NaN where there is no such touch.
        """
        at, n, contact = self._surfaces.select(touch), as_complex(self._inward[touch]), self._contact[touch]
        planned, depth, aside = relative_force * self.plan.force[touch], np.zeros(len(touch)), np.zeros(len(touch))
        size, direction = np.maximum(planned, FIRST_FORCE)[:, None], n
        joints = self._without_effects(contact, size * pairs(n), touch)
        metadata = self.metadata.select(touch)._replace(history=self._histories[stage, touch])
        law, rigid, changed, found = Law(self.model, self.cell.gripper_sign), forward(self.truth, joints), depth, None
        if end in self._ends:
            depth, aside, direction, found = self._ends[end]
        for _ in range(_MOST_PASSES if self.model.effects else 0):
            tip, before = contact + pairs(n * (depth + 1j * aside)), (depth, aside, direction)
            with np.errstate(invalid='ignore'):  # where the object is not on the line
                force = Force.of(size * pairs(direction))
                found = joints_under_load(law, tip, force, metadata.posture, metadata, found)
                joints, state = found.joints, cast('TouchState', found.state)
                of_object = state._replace(centers=at.centers, radii=at.radii, tangents=at.tangents)
                reach = at.radii * direction + as_complex(self.model.object_shift(of_object))
                aside = aside - (as_complex(forward(self.truth, joints) - rigid) * n.conj()).imag
                beside = np.where(at.is_edge, 0.0, aside)  # along an edge the object has no place
                along = np.sign(at.radii) * np.sqrt(np.abs(reach) ** 2 - beside**2)
                depth, direction = at.radii - along, direction * n * (along - 1j * beside) / reach
            changed = np.abs(np.subtract((depth, aside, direction), before)).max(axis=0)
            if not (changed > 1e-14).any():
                break
        if end and found is not None:
            self._ends[end] = _End(depth, aside, direction, found)
        return joints, planned[:, None] * pairs(direction), np.where(changed < 1e-12, depth, np.nan)

    def _without_effects(self, tip: Floats, force: Floats, touch: Indices) -> Floats:
        """Ḡ of the base model for places and forces of touches: Q, (k, 2), rad."""
        return inverse_kinetostatics(self.truth, tip, force, self.plan.posture[touch], self.cell.gripper_sign)[0]

    @property
    def hold_time(self) -> Floats:
        """Middle of each hold, (m,), s."""
        return self.knots[:, Phase.HOLD] + 0.5 * self.timing.hold

    def state_at(self, time: ArrayLike) -> CellState:
        """The state of the cell at times since the start, (k,), s; before it and past the end the arm rests."""
        at = self._course.at(time)
        joints, phase, touch = at.joints, at.phase, np.minimum(at.contact, len(self.plan) - 1)
        beyond = self.plan.preload[touch]
        relative_force = at.part(Phase.PRESS) - at.part(Phase.RELEASE)
        relative_force = relative_force + beyond * (at.part(Phase.PRESS) - at.part(Phase.EASE))
        force, near = np.zeros((len(touch), 2)), np.flatnonzero(phase != Phase.TRAVEL)
        stage = np.where(phase < Phase.EASE, _PRESS, np.where(phase > Phase.HOLD, _RELEASE, _HOLD))[near]
        away = (1.0 - at.part(Phase.APPROACH) + at.part(Phase.RETRACT))[near, None]
        loaded, force[near], _ = self._pressed(touch[near], relative_force[near], stage)
        loaded = self._near_hold(loaded, touch[near])
        joints[near] = loaded + away * (self.free_joints[touch[near]] - loaded)
        return CellState(joints, force, touch, phase, at.progress, relative_force)

    def _near_hold(self, joints: Floats, touch: Indices | slice = slice(None)) -> Floats:
        """The same joint angles within half a turn of the hold."""
        hold = self.hold_joints[touch]
        return np.asarray(hold + wrap(joints - hold))


class TipPath:
    """The path of the tip's centre along an outline.

    Args:
        outline: of the surface; anything with `surfaces` and `is_closed`, as `Circle` has them.
        tip_radius: m.

    Attributes:
        length: of the whole path, m.

    Raises:
        ParameterError: an inner corner is narrower than the tip.
    """

    def __init__(self, outline: Outline | Circle, tip_radius: float) -> None:
        self._is_closed = outline.is_closed
        s = surfaces_of([outline], tip_radius) if isinstance(outline, Outline) else outline.surfaces(tip_radius)
        if len(s.inner_corners[0]):
            raise ParameterError(
                'outline', 'an inner corner is narrower than the tip', f'round it by {tip_radius:g} m or more'
            )
        self._ends = np.cumsum(2 * s.halves * np.where(s.is_edge, 1.0, np.abs(s.radii)))
        self._surfaces, self.length = s, float(self._ends[-1])

    def at(self, travelled: Floats) -> tuple[Floats, Floats]:
        """Centre of the tip, m, and outward normal of the surface, (k, 2) each, after lengths of the path, (k,), m.

        A closed outline goes on behind its end.
        """
        along = np.mod(travelled, self.length) if self._is_closed else np.clip(travelled, 0.0, self.length)
        row = np.minimum(np.searchsorted(self._ends, along, side='right'), len(self._ends) - 1)
        begin = np.append(0.0, self._ends)[row]
        part = 2.0 * (along - begin) / np.maximum(self._ends[row] - begin, 1e-12) - 1.0
        return self._surfaces.select(row).at(part)


@dataclass(frozen=True)
class SlideTiming:
    """Durations of the parts of a slide, s, and the behaviour of the force controller.

    Attributes:
        travel: between two slides.
        pause: at rest, free, before the approach and after the retraction.
        approach: from the free pose to the object, and back.
        press: from no force to the normal force, and back.
        stick: from no tangential force to that of sliding, while the tip stands, and back.
        start: from rest to the speed, and back.
        clearance: distance of the free pose from the object, m.
        force_variation: standard deviation of the normal force that the controller holds, relative.
        variation_time: time over which this deviation and the errors of the sensors change, s.
    """

    travel: float = 1.5
    pause: float = 0.4
    approach: float = 0.4
    press: float = 0.3
    stick: float = 0.15
    start: float = 0.2
    clearance: float = 0.01
    force_variation: float = 0.02
    variation_time: float = 0.5

    def __post_init__(self) -> None:
        check_numbers('timing', self, zero=('force_variation',))


SlidePhase = IntEnum('SlidePhase', 'TRAVEL PAUSE APPROACH PRESS STICK SLIDE STOP RELEASE RETRACT REST', start=0)
"""Of a slide."""
CROSSING = 2 * MILLI
"""Lever arm of the force within which a joint crosses its backlash, m."""


class SlidingMotion(Motion):
    """The motion through several slides.

    Args:
        cell: sign of the gripper's law; its tip has the tip's radius.
        truth: the simulated robot, with its effects.
        slides: one after the other.
        timing: how long the phases last.
        seed: of the variation of the normal force.

    Attributes:
        knots: start of every phase, (m, 10), s.
        tip_radius: m; 0 where the cell does not state it.

    Raises:
        UnsupportedDataError: there is no slide, or the simulated robot does not reach one.
        ParameterError: an outline is too narrow for the tip.
    """

    def __init__(
        self, cell: Cell, truth: Robot, slides: tuple[Slide, ...], timing: SlideTiming | None = None, seed: int = 0
    ) -> None:
        if not slides:
            raise UnsupportedDataError('there is no slide', 'plan at least one')
        self.cell, self.model, self.slides, self.count = cell, as_model(truth), slides, len(slides)
        t = self.timing = timing or SlideTiming()
        self.tip_radius = cell.tip_radius or 0.0
        self._tracks = [TipPath(slide.outline, self.tip_radius) for slide in slides]
        random = np.random.default_rng([seed, 2])
        self._variation = [SlowNoise(random, 1, t.variation_time) for _ in slides]
        self._paths = [self._path(number) for number in range(len(slides))]
        ends, durations = [], []
        for number, (slide, track) in enumerate(zip(slides, self._tracks, strict=True)):
            travelled = np.array([slide.begin, slide.end]) * track.length
            center, normal = track.at(travelled)
            ends.append(self._joints(number, travelled, center + t.clearance * normal, -FIRST_FORCE * normal))
            sliding = abs(slide.end - slide.begin) * track.length / slide.speed + t.start
            durations.append((t.pause, t.approach, t.press, t.stick, sliding, t.stick, t.press, t.approach, t.pause))
        self._course = Course(np.array(ends), np.array(durations), t.travel)
        self.knots, self.duration = self._course.knots, self._course.duration

    def state_at(self, time: ArrayLike) -> CellState:
        """The state at times in s since the start, (k,); before it and past the end the arm rests."""
        at, time = self._course.at(time), np.asarray(time, dtype=float)
        joints, force, slide = at.joints, np.zeros((len(time), 2)), at.contact.clip(max=self.count - 1)
        for number in range(self.count):
            here = np.flatnonzero((slide == number) & (at.phase != SlidePhase.TRAVEL))
            joints[here], force[here] = self._contact_at(number, at.select(here), time[here])
        relative_force = np.minimum(np.hypot(*force.T) / np.array([each.force for each in self.slides])[slide], 1.0)
        return CellState(joints, force, slide, at.phase, at.progress, relative_force)

    def errors_at(self, time: Floats, state: CellState, seed: int) -> Floats:
        """Errors of joint angles and force at k moments, in standard deviations, (2, k, 2): they change slowly."""
        return slow_errors(time, self.timing.variation_time, seed)

    def _contact_at(self, number: int, at: Moments, time: Floats) -> tuple[Floats, Floats]:
        """Joint angles, rad, and force, N, at moments and times within a slide, (k, 2) each.

        The angles are Ḡ, each joint crossing its backlash within `CROSSING`, near the path of the slide. The force is
        F = N (-n + μ τ t); 0+ along -n in the free motion.
        """
        slide, track, t = self.slides[number], self._tracks[number], self.timing
        begin, end = self.knots[number, [SlidePhase.SLIDE, SlidePhase.STOP]]
        sense = np.sign(slide.end - slide.begin)
        distance = _distance(np.clip(time - begin, 0.0, None), end - begin, slide.speed, t.start)
        travelled = slide.begin * track.length + sense * distance
        center, normal = track.at(travelled)
        steady = at.part(SlidePhase.STICK) - at.part(SlidePhase.STOP)
        variation = t.force_variation * self._variation[number].at(time)[:, 0].clip(-3, 3)
        clearance = t.clearance * (1.0 - at.part(SlidePhase.APPROACH) + at.part(SlidePhase.RETRACT))
        pressed = at.part(SlidePhase.PRESS) - at.part(SlidePhase.RELEASE)
        normal_force = slide.force * pressed * (1.0 + steady * variation)
        friction = (slide.friction * steady)[:, None] * (sense * quarter_turn(normal))
        force = np.maximum(normal_force, FIRST_FORCE)[:, None] * (friction - normal)
        joints = self._joints(number, travelled, center + clearance[:, None] * normal, force)
        return joints, np.where(normal_force[:, None] > 0, force, 0.0)

    def _joints(self, number: int, travelled: Floats, tip: Floats, force: Floats) -> Floats:
        """Joint angles of a slide for places of the tip and forces, (k, 2), rad, near the path of the slide."""
        places, path = self._paths[number]
        near = np.column_stack([np.interp(travelled, places, column) for column in path.T])
        return np.asarray(near + wrap(self._poses(number, tip, force) - near))

    def _poses(self, number: int, tip: Floats, force: Floats) -> Floats:
        p, posture = self.model.parameters, self.slides[number].posture
        joints, torques = inverse_kinetostatics(
            self.model, tip, force, np.full(len(tip), posture), self.cell.gripper_sign
        )
        arm = torques / np.hypot(*force.T)[:, None]
        return np.asarray(joints + (p.g1, p.g2) * (np.clip(arm / CROSSING, -1.0, 1.0) - np.sign(torques)))

    def _path(self, number: int) -> tuple[Floats, Floats]:
        """Lengths travelled, increasing, and the joint angles there, without a jump of a turn."""
        slide, track = self.slides[number], self._tracks[number]
        travelled = np.linspace(min(slide.begin, slide.end), max(slide.begin, slide.end), 721) * track.length
        center, normal = track.at(travelled)
        tips = center, center + self.timing.clearance * normal
        poses = [self._poses(number, tip, -slide.force * normal) for tip in tips]
        lost = ~self.cell.can_take(np.array(poses)).all(axis=0)
        if lost.any():
            x, y = center[lost][0]
            problem = f'slide {number}: the simulated robot does not reach it around ({x:.3f}, {y:.3f}) m'
            remedy = 'place the object elsewhere, slide along a part of it, or correct robot.limits'
            raise UnsupportedDataError(problem, remedy)
        path = np.unwrap(poses[0], axis=0)
        if np.abs(np.diff(path, axis=0)).max() > 0.5:
            raise ParameterError(f'slide {number}', 'it passes a stretched or folded arm', 'place the object elsewhere')
        return travelled, path


def _distance(time: Floats, span: float, speed: float, start: float) -> Floats:
    """Distance after a time of a motion of constant speed that starts and stops with constant acceleration, (k,), m."""
    start = min(start, span / 2)
    time = np.minimum(time, span)
    rest = span - time
    gone = np.where(time < start, time**2 / (2 * start), time - start / 2)
    return np.asarray(speed * np.where(rest < start, span - start - rest**2 / (2 * start), gone))


class SlowNoise:
    """Random numbers of variance 1 that change slowly with time: normal, with the correlation exp(-t²/(2 T²)).

    Args:
        random: source.
        columns: independent ones.
        duration: T, s.
    """

    def __init__(self, random: np.random.Generator, columns: int, duration: float) -> None:
        waves = 48  # of which they are made
        shape = waves, columns
        self._frequency = random.standard_normal(shape) / duration
        self._phase = random.uniform(0, 2 * np.pi, shape)
        self._size = random.rayleigh(1.0, shape) / np.sqrt(waves)

    def at(self, time: Floats) -> Floats:
        """Their values at times in s, (k, columns)."""
        waves = np.cos(time[:, None, None] * self._frequency + self._phase)
        return np.asarray((self._size * waves).sum(axis=1))


def slow_errors(time: Floats, duration: float, seed: int) -> Floats:
    """Errors of joint angles and force at times, s, in standard deviations, (2, k, 2), correlated over a duration."""
    return SlowNoise(np.random.default_rng([seed, 0]), 4, duration).at(time).reshape(-1, 2, 2).transpose(1, 0, 2)
