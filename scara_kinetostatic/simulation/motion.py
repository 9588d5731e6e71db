"""The motion of a simulated robot from contact to contact, and that through the touches of a plan.

Between contacts the arm travels straight in joint space (`Course`), with its third axis lifted, so that the tip may
pass over the discs without force. A touch (`Trajectory`) runs through eight phases (`Phase`). It comes from the free
pose, on the normal of the disc at a clearance, in joint space to the pose at which the backlash is used up and the
force begins, `Ḡ(S, 0+)`. From there on the contact S stays and the force follows its time law: Q(t) = Ḡ(S, F(t)),
hence F(t) = A(Q(t), L̄) all along, without an inner solve. Every phase follows the minimum-jerk law 10 s³ - 15 s⁴ +
6 s⁵. A press with preload goes beyond the force of the hold and eases down to it; without, that phase lasts no time.

The effects of a robot with effects (`ExtendedModel`) are simulated: the joint angles are commanded as above, deeper or
less deep so that the force of the hold comes about, and the force at any time is A(Q(t), L̄) with the effects. What
joints with memory keep goes from touch to touch along the whole plan, with preloads, unloading and the free motion
between touches; see `load_history`.

The simulated controller uses the base model: it commands Ḡ(S, F) without effects. The force that results is F = A(Q,
L̄) with the effects. A controller that presses until the sensor shows a force therefore commands a point deeper, or
less deep, than the base model gives. This depth is solved for at two forces, a light one and that of the hold, and is
linear in the force between them and beyond.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.contact import Contact, contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.kinematics import forward, wrap
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import padded_history, remembered, stacked_histories, torques_of
from scara_kinetostatic.simulation.plan import CLEARANCE, Plan, check_numbers
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


class Histories(NamedTuple):
    """Histories at three stages of every touch, (m, K, 4) each, as in `TouchSet.history`.

    Attributes:
        press: before it.
        hold: before it, with the preload.
        release: before it, with the hold.
    """

    press: Floats
    hold: Floats
    release: Floats


def load_histories(
    peaks: Floats, holds: Floats, has_preload: Mask, parameters: Parameters, frame: SensorFrame = SensorFrame.BASE
) -> Histories:
    """The histories of the touches of a plan.

    Args:
        peaks: Q, rad, and F, N, under the largest force of each touch in the order of time, (m, 4).
        holds: the same in the hold.
        has_preload: whether the peak is beyond the hold, (m,).
        parameters: L̄, which tells the torques that a memory keeps.
        frame: that of the forces.
    """
    points = np.stack([peaks, holds, holds * (1, 1, 0, 0)], axis=1).reshape(-1, 4)
    torques = [(first, second) for first, second in torques_of(parameters, points, frame).tolist()]
    stages: tuple[list[Floats], ...] = ([], [], [])
    memory: list[int] = []
    for place in range(len(points)):
        stages[place % 3].append(points[memory])
        if place % 3 or has_preload[place // 3]:
            memory.append(place)
            memory = [memory[k] for k in remembered([torques[one] for one in memory])]
    return Histories(*(stacked_histories(stage, holds[:, :2]) for stage in stages))


LIGHT_FORCE = 0.05
"""The light force, over that of the hold."""
FORCE_TOLERANCE = 1e-3
"""Relative error of the force at which the iteration for a depth ends."""


FIRST_FORCE = 1e-6
"""The 0+ of `Ḡ(S, 0+)`, N: defines the direction of the force, its deflection is negligible."""
_MOST_DEPTH = 0.02
"""Depth up to which a commanded point is moved on in search of the force, m."""
_MOST_PASSES = 20
"""Until forces and histories agree; each touch wipes out most of what came before, so that few do."""


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
        home = ends[[0, -1], [0, 1]] + (0.25, -0.15)
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
        self._surfaces, self._every = cell.surfaces.select(plan.surface(cell)), np.arange(len(plan))
        self._planned = self.hold_force = plan.force[:, None] * self._inward
        self.peak_force = (1.0 + plan.preload)[:, None] * self._planned
        self._depth = np.zeros((2, len(plan)))
        self._solve_poses()
        spans = [getattr(self.timing, phase.name.lower()) for phase in list(Phase)[1:]]
        durations, ends = np.tile(spans, (len(plan), 1)), np.stack([self.free_joints, self.free_joints], axis=1)
        durations[:, Phase.EASE - 1] *= plan.preload > 0
        self._course = Course(ends, durations, self.timing.travel, self.timing.speed)
        self.knots, self.duration, self.count = self._course.knots, self._course.duration, len(plan)
        self.metadata = self._metadata()
        if self.model.effects:
            self._include_effects()

    def _solve_poses(self) -> None:
        """Joint angles at the ends of the phases.

        Raises:
            UnsupportedDataError: the simulated robot cannot reach a touch.
        """
        self.hold_joints = self._pose(self._commanded_tip(1.0), self._planned)
        self.contact_joints = self._loaded_joints(self._every, np.zeros(len(self.plan)))
        self.peak_joints = self._loaded_joints(self._every, 1.0 + self.plan.preload)
        clear = self._contact - self.timing.clearance * self._inward
        self.free_joints = self._near_hold(self._pose(clear, np.zeros_like(clear)))
        poses = np.hstack([self.hold_joints, self.peak_joints, self.contact_joints, self.free_joints])
        lost = np.flatnonzero(~np.isfinite(poses).all(axis=1))
        if len(lost):
            name = self.cell.discs[self.plan.disc[lost[0]]].name
            problem = f'the simulated robot cannot reach touch {lost[0]} of the plan, on {name!r}'
            remedy = 'leave the touch out, move the disc, or simulate a robot closer to the nominal one'
            raise UnsupportedDataError(problem, remedy)

    def _include_effects(self) -> None:
        """The forces with effects. The metadata are those of the path without effects, then corrected.

        Once, or until the holds have their forces with the histories that the touches make. The commanded joints then
        stay, and forces and histories come to agree.
        """
        for number in range(_MOST_PASSES):
            self.metadata = self._metadata()
            self._take_histories()
            for row, relative_force in enumerate((LIGHT_FORCE, 1.0)):
                self._depth[row] = self._command_depths(relative_force, self._depth[row])
            self._solve_poses()
            self.peak_force = self._peak_forces()
            self._take_histories()
            if number and not self._off_plan(self._in_hold(), 0.02).any():
                break
        self.hold_force = self._hold_forces()
        for _ in range(_MOST_PASSES):
            before = np.stack([self.peak_force, self.hold_force])
            self._take_histories()
            self.peak_force, self.hold_force = self._peak_forces(), self._hold_forces()
            if np.abs(before - (self.peak_force, self.hold_force)).max() < 1e-9:
                return
        problem = 'the forces of the touches and the loads before them do not come to agree'
        raise UnsupportedDataError(problem, 'simulate smaller effects')

    def _take_histories(self) -> None:
        """The load before the stages of each touch, by the joints and forces as they are now."""
        peaks, holds = np.hstack([self.peak_joints, self.peak_force]), np.hstack([self.hold_joints, self.hold_force])
        self.histories = load_histories(peaks, holds, self.plan.preload > 0, self.truth)
        self.metadata = self.metadata._replace(history=self.histories.hold)

    def _contact_at(
        self, touch: Indices, joints: Floats, warm_start: Floats, metadata: TouchMetadata, tension: bool = False
    ) -> Contact:
        """A(Q, L̄) at k moments of touches.

        Args:
            touch: number of the touch, (k,).
            joints: commanded Q, (k, 2), rad.
            warm_start: of several equilibria, the one nearest to this force is taken, (k, 2), N.
            metadata: of the moments.
            tension: as in `model.contact.contact`.
        """
        at = self._surfaces.select(touch)
        return contact(
            self.model,
            joints,
            at.centers,
            at.radii,
            self.cell.gripper_sign,
            tension=tension,
            warm_start=warm_start,
            metadata=metadata,
            tangents=at.tangents if self.cell.has_outlines else None,
        )

    def _force_over_time(self, touch: Indices, joints: Floats, warm_start: Floats, phase: Indices) -> Floats:
        """Force on the object at k moments in the order of time, (k, 2), N; zero outside contact.

        Where no equilibrium is found the force is interpolated in time.
        """
        stages = [part[touch] for part in self.histories]
        longest = max(part.shape[1] for part in stages)
        stages = [padded_history(part, joints, longest) for part in stages]
        before, after = (phase < Phase.EASE)[:, None, None], (phase > Phase.HOLD)[:, None, None]
        history = np.where(before, stages[0], np.where(after, stages[2], stages[1]))
        found = self._contact_at(touch, joints, warm_start, self.metadata.select(touch)._replace(history=history))
        force, at = found.force.copy(), np.arange(len(touch))
        if not found.solved.all() and found.solved.any():
            for axis in (0, 1):
                force[:, axis] = np.interp(at, at[found.solved], force[found.solved, axis])
        return force

    def _command_depths(self, relative_force: float, start: Floats) -> Floats:
        """Depths at which the force is reached, beyond those of the base model, (m,), m; by the secant method.

        Args:
            relative_force: part of the force of the hold that is wanted.
            start: first depths, (m,), m.

        Raises:
            UnsupportedDataError: the force of a touch is not reached within `_MOST_DEPTH`.
        """
        wanted, planned, p = relative_force * self.plan.force, relative_force * self._planned, self.truth
        # depth per force of the robot without effects, m/N
        torques = inverse_kinetostatics(p, self._contact, self._planned, self.plan.posture, self.cell.gripper_sign)[1]
        arms = torques / self.plan.force[:, None]
        compliance = p.p_ee + (np.array([p.p1, p.p2]) * arms**2).sum(axis=1)
        depth, slope, todo = start.copy(), compliance.copy(), self._every
        before = np.full((2, len(self.plan)), np.nan)
        for _ in range(30):
            joints = self._pose(self._contact + depth[:, None] * self._inward, planned)[todo]
            force = self._contact_at(todo, joints, planned[todo], self.metadata.select(todo), tension=True).magnitude
            off = np.abs(wanted[todo] - force) > FORCE_TOLERANCE * wanted[todo]
            todo, force = todo[off], force[off]
            if not len(todo):
                break
            step, rise = depth[todo] - before[0, todo], force - before[1, todo]
            known = np.abs(rise) > 1e-9  # false in the first pass
            bounds = compliance[todo] / 20.0, compliance[todo] * 20.0  # at most so much softer or stiffer
            slope[todo[known]] = np.clip(step / np.where(known, rise, 1.0), *bounds)[known]
            before[:, todo] = depth[todo], force
            if (lost := np.abs(depth[todo]) > _MOST_DEPTH).any():
                problem = f'it is not reached {1e3 * _MOST_DEPTH:.0f} mm beyond its place'
                raise self._cannot_hold(int(todo[np.argmax(lost)]), problem)
            depth[todo] += np.clip(slope[todo] * (wanted[todo] - force), -2e-3, 2e-3)
        return depth

    def _peak_forces(self) -> Floats:
        """Largest force on the object in each touch, (m, 2), N; the planned one where no equilibrium is found."""
        planned = (1.0 + self.plan.preload)[:, None] * self._planned
        before = self.metadata._replace(history=self.histories.press)
        found = self._contact_at(self._every, self.peak_joints, planned, before)
        return np.where(found.solved[:, None], found.force, planned)

    def _in_hold(self) -> Contact:
        """A(Q, L̄) in each hold."""
        return self._contact_at(self._every, self.hold_joints, self._planned, self.metadata)

    def _off_plan(self, found: Contact, tolerance: float) -> Mask:
        """Which touches have no equilibrium, or not the force that is planned but for a relative error, (m,)."""
        return ~(np.abs(found.magnitude - self.plan.force) <= tolerance * self.plan.force) | ~found.solved

    def _hold_forces(self) -> Floats:
        """Force on the object in each hold, (m, 2), N.

        Raises:
            UnsupportedDataError: a touch has no equilibrium, or not the force that is planned.
        """
        found = self._in_hold()
        # at kinks the commanded joints need not settle; the force is that of the joints as commanded
        off = self._off_plan(found, 0.02 if all(effect.is_smooth for effect in self.model.effects) else 0.1)
        if off.any():
            first = int(np.argmax(off))
            got = f'it comes to {found.magnitude[first]:.3g} N' if found.solved[first] else 'there is no equilibrium'
            raise self._cannot_hold(first, got)
        return found.force

    def _cannot_hold(self, number: int, problem: str) -> UnsupportedDataError:
        name = self.cell.discs[self.plan.disc[number]].name
        touch = f'touch {number} of the plan, on {name!r}, under {self.plan.force[number]:g} N'
        remedy = 'leave the touch out, or simulate smaller effects'
        return UnsupportedDataError(f'the simulated robot cannot hold {touch}: {problem}', remedy)

    def _metadata(self) -> TouchMetadata:
        approach, press = (last_movement(path, self.hold_joints) for path in (self.path, self.path[1:]))
        plan, surface = self.plan, self.plan.surface(self.cell)
        found = TouchMetadata(plan.disc, self.hold_time, approach, plan.posture, press)
        return found._replace(order=self._every, surface=surface)

    def _commanded_tip(self, relative_force: Floats | float, touch: Indices | slice = slice(None)) -> Floats:
        """Commanded place of the tip of the base model at a relative force, (k, 2), m."""
        first, hold = self._depth[:, touch]
        depth = first + (relative_force - LIGHT_FORCE) / (1.0 - LIGHT_FORCE) * (hold - first)
        return self._contact[touch] + depth[:, None] * self._inward[touch]

    @property
    def hold_time(self) -> Floats:
        """Middle of each hold, (m,), s."""
        return self.knots[:, Phase.HOLD] + 0.5 * self.timing.hold

    @property
    def path(self) -> Floats:
        """Joint angles before each hold: free, first contact, peak, (3, m, 2), rad."""
        return np.stack([self.free_joints, self.contact_joints, self.peak_joints])

    def state_at(self, time: ArrayLike) -> CellState:
        """The state of the cell at times since the start, (k,), s; before it and past the end the arm rests."""
        at = self._course.at(time)
        joints, phase, touch = at.joints, at.phase, np.minimum(at.contact, len(self.plan) - 1)
        beyond = self.plan.preload[touch]
        relative_force = at.part(Phase.PRESS) - at.part(Phase.RELEASE)
        relative_force = relative_force + beyond * (at.part(Phase.PRESS) - at.part(Phase.EASE))
        force = relative_force[:, None] * self.hold_force[touch]
        near = np.flatnonzero(phase != Phase.TRAVEL)
        away = (1.0 - at.part(Phase.APPROACH) + at.part(Phase.RETRACT))[near, None]
        clear = (self.free_joints - self.contact_joints)[touch[near]]
        joints[near] = self._loaded_joints(touch[near], relative_force[near]) + away * clear
        if self.model.effects:
            close = np.flatnonzero(self._contact_possible(touch, phase, joints))
            force[close] = self._force_over_time(touch[close], joints[close], force[close], phase[close])
            relative_force = np.hypot(*force.T) / np.hypot(*self.hold_force[touch].T)
        return CellState(joints, force, touch, phase, at.progress, relative_force)

    def _contact_possible(self, touch: Indices, phase: Indices, joints: Floats) -> Mask:
        """Where a force is possible and not known yet, (k,): within 0.5 mm of the contact."""
        displacement = forward(self.truth, joints) - forward(self.truth, self.contact_joints[touch])
        near = np.einsum('ij,ij->i', displacement, self._inward[touch]) > -5e-4
        return np.asarray((phase >= Phase.APPROACH) & (phase != Phase.HOLD) & near)

    def _pose(self, tip: Floats, force: Floats, touch: Indices | slice = slice(None)) -> Floats:
        """Ḡ in the posture of touches, all or some: Q for places of the tip and forces, (k, 2) each."""
        return inverse_kinetostatics(self.truth, tip, force, self.plan.posture[touch], self.cell.gripper_sign)[0]

    def _loaded_joints(self, touch: Indices, relative_force: Floats) -> Floats:
        """Ḡ at a relative force, without a jump of a full turn within the touch."""
        force = np.maximum(relative_force * self.plan.force[touch], FIRST_FORCE)[:, None] * self._inward[touch]
        joints = self._pose(self._commanded_tip(relative_force, touch), force, touch)
        return self._near_hold(joints, touch)

    def _near_hold(self, joints: Floats, touch: Indices | slice = slice(None)) -> Floats:
        """The same joint angles within half a turn of the hold."""
        hold = self.hold_joints[touch]
        return np.asarray(hold + wrap(joints - hold))
