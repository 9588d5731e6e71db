"""The trajectory of a recording: joint angles and contact force at any time.

Each touch runs through eight phases (`Phase`). Free phases interpolate between
poses in joint space; the arm travels with its third axis lifted, so the tip may
pass over the discs without force. A touch comes from the free pose, on the normal
of the disc at a clearance, to the pose at which the backlash is used up and the
force begins, `Ḡ(S, 0+)`. From there on the contact S stays and the force follows
its time law: Q(t) = Ḡ(S, F(t)), hence F(t) = A(Q(t), L̄) all along, without an
inner solve. Every phase follows the minimum-jerk law 10 s³ - 15 s⁴ + 6 s⁵. A press
with preload goes beyond the force of the hold and eases down to it; without, that
phase lasts no time.

The effects of a robot with effects (`ExtendedModel`) are simulated: the joint angles are
commanded as above, deeper or less deep so that the force of the hold comes about, and the force at any time is
A(Q(t), L̄) with the effects. What joints with memory keep goes from touch to touch along the
whole plan, with preloads, unloading and the free motion between touches; see `load_history`.

The simulated controller uses the base model: it commands Ḡ(S, F) without effects. The force that results is
F = A(Q, L̄) with the effects. A controller that presses until the sensor shows a force therefore commands a point
deeper, or less deep, than the base model gives. This depth is solved for at two forces, a light one and that of the
hold, and is linear in the force between them and beyond.
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
    peaks: Floats,
    holds: Floats,
    has_preload: Mask,
    parameters: Parameters,
    frame: SensorFrame = SensorFrame.BASE,
    repeated: bool = False,
) -> Histories:
    """The histories of the touches of a plan.

    Args:
        peaks: Q, rad, and F, N, under the largest force of each touch in the order of time, (m, 4).
        holds: the same in the hold.
        has_preload: whether the peak is beyond the hold, (m,).
        parameters: L̄, which tells the torques that a memory keeps.
        frame: that of the forces.
        repeated: whether the joints come from another pass through the same plan instead of the relaxed state.
    """
    points = np.stack([peaks, holds, holds * (1, 1, 0, 0)], axis=1).reshape(-1, 4)
    torques = [(first, second) for first, second in torques_of(parameters, points, frame).tolist()]
    stages: tuple[list[Floats], ...] = ([], [], [])
    memory: list[int] = []
    for turn in range(1 + repeated):
        for place in range(len(points)):
            if turn == repeated:
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
_MOST_PASSES = 20
"""Until forces and histories agree; each touch wipes out most of what came before, so that few do."""


class CellState(NamedTuple):
    """The state of the cell at k times.

    Attributes:
        joints: actuator angles Q, (k, 2), rad.
        force: force on the object in the base frame, (k, 2), N.
        touch: number of the touch in the plan, (k,); after the last touch, the last.
        phase: which `Phase`, (k,).
        progress: how much of the phase has passed, by the time law, 0 to 1, (k,).
        relative_force: contact force over that of the hold, 0 to about 1 + preload, (k,).
    """

    joints: Floats
    force: Floats
    touch: Indices
    phase: Indices
    progress: Floats
    relative_force: Floats


class Trajectory:
    """The trajectory of one cell through one plan.

    Args:
        cell: discs, sign of the gripper's law.
        truth: the simulated robot, with its effects.
        plan: the touches.
        timing: how long the phases last.
        repeated: whether joints with memory come from another pass through the plan instead of the relaxed state.

    Attributes:
        duration: of the whole trajectory, s.
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

    def __init__(
        self, cell: Cell, truth: Robot, plan: Plan, timing: Timing | None = None, repeated: bool = False
    ) -> None:
        self.cell, self.plan, self.timing, self._repeated = cell, plan, timing or Timing(), repeated
        self.model = as_model(truth)
        self.truth = self.model.parameters
        if not len(plan):
            raise UnsupportedDataError('the plan holds no touch', 'plan at least one')
        self._contact = plan.contact(cell)
        self._inward = -plan.normal(cell)
        self.hold_force = plan.force[:, None] * self._inward
        self.peak_force = (1.0 + plan.preload)[:, None] * self.hold_force
        self._depth = np.zeros((2, len(plan)))
        self._solve_poses()
        self._start_and_end = self.free_joints[[0, -1]] + (0.25, -0.15)
        self.knots, self.duration = self._schedule()
        self.metadata = self._metadata()
        if self.model.effects:
            self._include_effects()

    def _solve_poses(self) -> None:
        """Joint angles at the ends of the phases."""
        self.hold_joints = self._pose(self._commanded_tip(1.0), self.hold_force)
        self.contact_joints = self._near_hold(self._pose(self._commanded_tip(0.0), FIRST_FORCE * self._inward))
        self.peak_joints = self._loaded_joints(np.arange(len(self.plan)), 1.0 + self.plan.preload)
        clear = self._contact - self.timing.clearance * self._inward
        self.free_joints = self._near_hold(self._pose(clear, np.zeros_like(clear)))
        self._check_reach()

    def _include_effects(self) -> None:
        """The forces with effects. The metadata are those of the path without effects, then corrected.

        Once, or until the holds have their forces with the histories that the touches make. The commanded joints then
        stay, and forces and histories come to agree.
        """
        for number in range(_MOST_PASSES):
            self.metadata = self._metadata()
            self._take_histories()
            compliance = self._normal_compliance(self.hold_force)
            for row, relative_force in enumerate((LIGHT_FORCE, 1.0)):
                self._depth[row] = self._command_depths(relative_force, compliance, self._depth[row])
            self._solve_poses()
            self.peak_force = self._peak_forces()
            self._take_histories()
            if number and not self._off_plan(self._in_hold()).any():
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
        self.histories = load_histories(peaks, holds, self.plan.preload > 0, self.truth, repeated=self._repeated)
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
        surface, surfaces = self.plan.surface(self.cell)[touch], self.cell.surfaces
        return contact(
            self.model,
            joints,
            surfaces.centers[surface],
            surfaces.radii[surface],
            self.cell.gripper,
            tangents=surfaces.tangents[surface] if self.cell.has_outlines else None,
            tension=tension,
            warm_start=warm_start,
            metadata=metadata,
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

    def _command_depths(self, relative_force: float, compliance: Floats, start: Floats) -> Floats:
        """Depths at which the force is reached, beyond those of the base model, (m,), m; by the secant method.

        Args:
            relative_force: part of the force of the hold that is wanted.
            compliance: depth per force of the robot without effects, (m,), m/N.
            start: first depths, (m,), m.
        """
        wanted, planned = relative_force * self.plan.force, relative_force * self.hold_force
        depth, slope, todo = start.copy(), compliance.copy(), np.arange(len(self.plan))
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
            depth[todo] += np.clip(slope[todo] * (wanted[todo] - force), -2e-3, 2e-3)
        return depth

    def _peak_forces(self) -> Floats:
        """Largest force on the object in each touch, (m, 2), N; the planned one where no equilibrium is found."""
        planned = ((1.0 + self.plan.preload) * self.plan.force)[:, None] * self._inward
        before = self.metadata._replace(history=self.histories.press)
        found = self._contact_at(np.arange(len(self.plan)), self.peak_joints, planned, before)
        return np.where(found.solved[:, None], found.force, planned)

    def _in_hold(self) -> Contact:
        """A(Q, L̄) in each hold."""
        planned = self.plan.force[:, None] * self._inward
        return self._contact_at(np.arange(len(self.plan)), self.hold_joints, planned, self.metadata)

    def _off_plan(self, found: Contact, tolerance: float = 0.02) -> Mask:
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
            name = self.cell.discs[self.plan.disc[first]].name
            got = f'it comes to {found.magnitude[first]:.3g} N' if found.solved[first] else 'there is no equilibrium'
            touch = f'touch {first} of the plan, on {name!r}, under {self.plan.force[first]:g} N'
            remedy = 'leave the touch out, or simulate smaller effects'
            raise UnsupportedDataError(f'the simulated robot cannot hold {touch}: {got}', remedy)
        return found.force

    def _metadata(self) -> TouchMetadata:
        approach, press = (last_movement(path, self.hold_joints) for path in (self.path, self.path[1:]))
        order, surface, plan = np.arange(len(self.plan)), self.plan.surface(self.cell), self.plan
        return TouchMetadata(plan.disc, self.hold_time, approach, plan.posture, press, order=order, surface=surface)

    def _normal_compliance(self, force: Floats) -> Floats:
        """Displacement of the tip along the normal per force by the base model, (m,), m/N."""
        p, size = self.truth, np.hypot(*force.T)
        torques = inverse_kinetostatics(p, self._contact, force, self.plan.posture, self.cell.gripper)[1]
        return np.asarray(p.p_ee + (np.array([p.p1, p.p2]) * (torques / size[:, None]) ** 2).sum(axis=1))

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
        time = np.clip(np.atleast_1d(np.asarray(time, dtype=float)), 0.0, self.duration)
        starts = np.append(self.knots.ravel(), self.knots[-1, Phase.RETRACT] + self.timing.retract)
        ends = np.append(starts[1:], self.duration)
        row = np.clip(np.searchsorted(starts, time, side='right') - 1, 0, len(starts) - 1)
        span = ends[row] - starts[row]
        progress = minimum_jerk(np.divide(time - starts[row], span, out=np.ones_like(time), where=span > 0))
        touch, phase = np.minimum(row // len(Phase), len(self.plan) - 1), row % len(Phase)
        begin, end = self._poses()
        joints = begin[row] + progress[:, None] * (end[row] - begin[row])
        returning = row == len(starts) - 1
        relative_force = np.where(returning, 0.0, self._relative_force(touch, phase, progress))
        force = relative_force[:, None] * self.hold_force[touch]
        loaded = np.flatnonzero((phase >= Phase.PRESS) & (phase <= Phase.RELEASE) & ~returning)
        joints[loaded] = self._loaded_joints(touch[loaded], relative_force[loaded])
        if self.model.effects:
            close = np.flatnonzero(self._contact_possible(touch, phase, joints))
            force[close] = self._force_over_time(touch[close], joints[close], force[close], phase[close])
            relative_force = np.hypot(*force.T) / np.hypot(*self.hold_force[touch].T)
        return CellState(joints, force, touch, phase, progress, relative_force)

    def _contact_possible(self, touch: Indices, phase: Indices, joints: Floats) -> Mask:
        """Where a force is possible and not known yet, (k,): within 0.5 mm of the contact."""
        displacement = forward(self.truth, joints) - forward(self.truth, self.contact_joints[touch])
        near = np.einsum('ij,ij->i', displacement, self._inward[touch]) > -5e-4
        return np.asarray((phase >= Phase.APPROACH) & (phase != Phase.HOLD) & near)

    def _relative_force(self, touch: Indices, phase: Indices, progress: Floats) -> Floats:
        """Force over that of the hold, (k,)."""
        beyond = self.plan.preload[touch]
        parts = [progress * (1.0 + beyond), 1.0 + beyond * (1.0 - progress), np.ones_like(progress), 1.0 - progress]
        return np.select([phase == which for which in (Phase.PRESS, Phase.EASE, Phase.HOLD, Phase.RELEASE)], parts, 0.0)

    def _pose(self, tip: Floats, force: Floats, touch: Indices | slice = slice(None)) -> Floats:
        """Ḡ in the posture of touches, all or some: Q for places of the tip and forces, (k, 2) each."""
        return inverse_kinetostatics(self.truth, tip, force, self.plan.posture[touch], self.cell.gripper)[0]

    def _loaded_joints(self, touch: Indices, relative_force: Floats) -> Floats:
        """Ḡ at a relative force, without a jump of a full turn within the touch."""
        force = np.maximum(relative_force * self.plan.force[touch], FIRST_FORCE)[:, None] * self._inward[touch]
        joints = self._pose(self._commanded_tip(relative_force, touch), force, touch)
        hold = self.hold_joints[touch]
        turned = np.abs(joints - hold) > np.pi
        return np.where(turned, hold + wrap(joints - hold), joints)

    def _near_hold(self, joints: Floats) -> Floats:
        return self.hold_joints + wrap(joints - self.hold_joints)

    def _check_reach(self) -> None:
        poses = np.hstack([self.hold_joints, self.peak_joints, self.contact_joints, self.free_joints])
        lost = np.flatnonzero(~np.isfinite(poses).all(axis=1))
        if len(lost):
            name = self.cell.discs[self.plan.disc[lost[0]]].name
            problem = f'the simulated robot cannot reach touch {lost[0]} of the plan, on {name!r}'
            remedy = 'leave the touch out, move the disc, or simulate a robot closer to the nominal one'
            raise UnsupportedDataError(problem, remedy)

    def _schedule(self) -> tuple[Floats, float]:
        """Starts of all phases and the end of the trajectory."""
        fixed = [getattr(self.timing, phase.name.lower()) for phase in list(Phase)[1:]]
        stops = np.vstack([self._start_and_end[:1], self.free_joints, self._start_and_end[1:]])
        distance = np.abs(np.diff(stops, axis=0)).max(axis=1)
        travel = np.maximum(self.timing.travel, distance / self.timing.speed)
        durations = np.column_stack([travel[:-1], np.tile(fixed, (len(self.plan), 1))])
        durations[:, Phase.EASE] *= self.plan.preload > 0
        ends = np.cumsum(durations)
        starts = np.concatenate([[0.0], ends[:-1]]).reshape(durations.shape)
        return starts, float(ends[-1] + travel[-1])

    def _poses(self) -> tuple[Floats, Floats]:
        """Joint angles at the start and at the end of every phase, the return last, (7 m + 1, 2) each."""
        free, touch, peak, hold = self.free_joints, self.contact_joints, self.peak_joints, self.hold_joints
        before = np.vstack([self._start_and_end[:1], free[:-1]])
        begin = np.stack([before, free, free, touch, peak, hold, hold, touch], axis=1).reshape(-1, 2)
        end = np.stack([free, free, touch, peak, hold, hold, touch, free], axis=1).reshape(-1, 2)
        return np.vstack([begin, free[-1:]]), np.vstack([end, self._start_and_end[1:]])
