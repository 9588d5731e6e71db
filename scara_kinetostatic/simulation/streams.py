"""A simulated recording of touches: whole streams, or the touches alone.

**The motion.** Each touch runs through eight phases (`Phase`). Free phases interpolate between poses in joint space;
the arm travels with its third axis lifted, so the tip may pass over the discs without force. A touch comes from the
free pose, on the normal of the disc at a clearance, to the pose at which the backlash is used up and the force begins,
`Ḡ(S, 0+)`. From there on the contact S stays and the force follows its time law: Q(t) = Ḡ(S, F(t)), hence F(t) =
A(Q(t), L̄) all along, without an inner solve. Every phase follows the minimum-jerk law 10 s³ - 15 s⁴ + 6 s⁵. A press
with preload goes beyond the force of the hold and eases down to it; without, that phase lasts no time.

The effects of a robot with effects (`ExtendedModel`) are simulated: the joint angles are commanded as above, deeper or
less deep so that the force of the hold comes about, and the force at any time is A(Q(t), L̄) with the effects. What
joints with memory keep goes from touch to touch along the whole plan, with preloads, unloading and the free motion
between touches; see `load_history`.

The simulated controller uses the base model: it commands Ḡ(S, F) without effects. The force that results is F = A(Q,
L̄) with the effects. A controller that presses until the sensor shows a force therefore commands a point deeper, or
less deep, than the base model gives. This depth is solved for at two forces, a light one and that of the hold, and is
linear in the force between them and beyond.

**The sensors.** There are two kinds of noise. The noise of one touch (`Noise`, `cell.noise`) is its repeatability: an
error that is constant during the touch, so that averaging does not reduce it. Its force part is proportional to the
contact force; otherwise the tare before the touch would remove it. The noise of the samples is white.

An effect that is an error of the force sensor is treated alike: the part of it that does not depend on the force, a
bias, is scaled with the contact force up to its full value in the hold.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model import extended_model
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, Noise, SensorFrame, SensorSign
from scara_kinetostatic.model.contact import Contact, contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.kinematics import forward, rotate, wrap
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet, padded_history, remembered, stacked_histories, torques_of
from scara_kinetostatic.simulation.plan import CLEARANCE, Plan, check_numbers
from scara_kinetostatic.touches.load_history import last_movement
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

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
        self._contact, self._inward = plan.contact(cell), -plan.normal(cell)
        self._surfaces, self._every = cell.surfaces.select(plan.surface(cell)), np.arange(len(plan))
        self._planned = self.hold_force = plan.force[:, None] * self._inward
        self.peak_force = (1.0 + plan.preload)[:, None] * self._planned
        self._depth = np.zeros((2, len(plan)))
        self._solve_poses()
        self._start_and_end = self.free_joints[[0, -1]] + (0.25, -0.15)
        self.knots, self.duration = self._schedule()
        self.metadata = self._metadata()
        if self.model.effects:
            self._include_effects()

    def _solve_poses(self) -> None:
        """Joint angles at the ends of the phases.

        Raises:
            UnsupportedDataError: the simulated robot cannot reach a touch.
        """
        self.hold_joints = self._pose(self._commanded_tip(1.0), self._planned)
        self.contact_joints = self._near_hold(self._pose(self._commanded_tip(0.0), FIRST_FORCE * self._inward))
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
        at = self._surfaces.select(touch)
        return contact(
            self.model,
            joints,
            at.centers,
            at.radii,
            self.cell.gripper,
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
        """
        wanted, planned, p = relative_force * self.plan.force, relative_force * self._planned, self.truth
        # depth per force of the robot without effects, m/N
        torques = inverse_kinetostatics(p, self._contact, self._planned, self.plan.posture, self.cell.gripper)[1]
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
            name = self.cell.discs[self.plan.disc[first]].name
            got = f'it comes to {found.magnitude[first]:.3g} N' if found.solved[first] else 'there is no equilibrium'
            touch = f'touch {first} of the plan, on {name!r}, under {self.plan.force[first]:g} N'
            remedy = 'leave the touch out, or simulate smaller effects'
            raise UnsupportedDataError(f'the simulated robot cannot hold {touch}: {got}', remedy)
        return found.force

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
        return self._near_hold(joints, touch)

    def _near_hold(self, joints: Floats, touch: Indices | slice = slice(None)) -> Floats:
        """The same joint angles within half a turn of the hold."""
        hold = self.hold_joints[touch]
        return np.asarray(hold + wrap(joints - hold))

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


TYPICAL_NOISE = Noise(joint=1e-5, force=0.3)
"""Repeatability of a touch where neither the sensors nor the cell give one."""


@dataclass(frozen=True)
class SensorModel:
    """Encoders and force sensor.

    Attributes:
        touch_noise: repeatability of one touch; None: that of the cell.
        joint_noise: white noise of the joint samples, rad.
        force_noise: white noise of the force samples, N.
        bias: reading of the force sensor without force, in its own frame and sign, N.
        resolution: step of the encoders, rad; 0 for none.
        joint_rate: joint states per second.
        wrench_rate: wrenches per second.
        jitter: 1-sigma of a stamp's lateness, in periods; also makes rare gaps of a few periods.
        offset: lateness of the first wrench after the first joint state, s.

    Raises:
        ParameterError: a negative noise, a rate that is not above 0.
    """

    touch_noise: Noise | None = None
    joint_noise: float = 0.0
    force_noise: float = 0.05
    bias: tuple[float, float] = (1.2, -0.8)
    resolution: float = 1e-6
    joint_rate: float = 80.0
    wrench_rate: float = 98.0
    jitter: float = 0.1
    offset: float = 0.0037

    def __post_init__(self) -> None:
        zero = ('touch_noise', 'joint_noise', 'force_noise', 'resolution', 'jitter', 'offset')
        check_numbers('sensors', self, zero=zero, signed=('bias',))

    @classmethod
    def ideal(cls, rate: float = 100.0) -> SensorModel:
        """Sensors without any error, both at one even rate."""
        return cls(Noise(0.0, 0.0), 0.0, 0.0, (0.0, 0.0), 0.0, rate, rate, 0.0, 0.0)

    def touch_errors(
        self, cell: Cell, unit: Floats, force: Floats, sensor_angle: Floats | None = None
    ) -> tuple[Floats, Floats]:
        """Errors of the joint angles and of the force of each touch, (n, 2) each, rad and N, base frame.

        Args:
            cell: its noise is taken where the sensors have none.
            unit: both errors in standard deviations, (2, n, 2).
            force: in the hold, (n, 2), N: the noise may grow with it.
            sensor_angle: of the sensor's x axis in the base frame, (n,), rad; None for 0.
        """
        noise = self.touch_noise or cell.noise or TYPICAL_NOISE
        joint_errors = np.array(noise.joint_levels) * unit[0]
        force_errors = np.hypot(noise.force_levels, noise.growth * np.hypot(*force.T)[:, None]) * unit[1]
        if noise.is_plain or sensor_angle is None:
            return joint_errors, force_errors
        return joint_errors, rotate(force_errors, sensor_angle)

    def stamps(self, duration: float, rate: float, offset: float, random: np.random.Generator) -> NDArray[np.int64]:
        """Stamps of one topic from `offset` to `duration`, increasing, (k,), ns since the start."""
        count = max(2, int(np.floor((duration - offset) * rate)) + 1)
        lateness = np.abs(random.standard_normal(count)) * self.jitter
        lateness += (random.random(count) < 0.01) * self.jitter * 20.0
        due = (np.arange(count) + lateness) / rate + offset
        stamps = np.maximum.accumulate(np.round(due * 1e9).astype(np.int64))
        return np.unique(stamps[stamps <= round(duration * 1e9)])


def in_sensor_frame(cell: Cell, truth: Parameters, joints: Floats, force: Floats) -> Floats:
    """A force in the base frame, (k, 2), N, as seen from the frame the sensor reports in."""
    angle = sensor_angle(cell, truth, joints)
    return force if angle is None else rotate(force, -angle)


def sensor_angle(cell: Cell, truth: Parameters, joints: Floats) -> Floats | None:
    """Angle of the sensor's x axis in the base frame, (k,), rad; None where it is the base frame's."""
    if cell.sensor.frame is SensorFrame.BASE:
        return None
    return np.asarray(joints.sum(axis=1) + truth.theta1 + truth.theta2)


def reported_force(
    cell: Cell,
    truth: Robot,
    joints: Floats,
    force: Floats,
    error: Floats,
    relative_force: Floats | None = None,
    metadata: TouchMetadata | None = None,
) -> Floats:
    """Reading of the sensor for a force on the object, without its sign and bias, (k, 2), N, in its frame.

    Args:
        cell: frame of the sensor.
        truth: places the tool frame; its effects may be errors of the sensor.
        joints: Q, (k, 2), rad.
        force: true force, base frame, (k, 2), N.
        error: noise of the touch, base frame, (k, 2), N.
        relative_force: force over that of the hold, (k,); None in the hold.
        metadata: of the touches of these moments, (k,).
    """
    model = as_model(truth)
    reported = in_sensor_frame(cell, model.parameters, joints, force + error)
    if model.effects:
        true = in_sensor_frame(cell, model.parameters, joints, force)
        reported = reported + extended_model.reported_force(model, true, metadata) - true
        if relative_force is not None:
            at_rest = extended_model.reported_force(model, np.zeros_like(true), metadata)
            reported -= (1.0 - relative_force)[:, None] * at_rest
    return reported


START = 1_700_000_000_000_000_000
"""Stamp of the start of a simulated recording, ns."""
Sensed = Callable[[Floats], tuple[CellState, Floats, Floats]]
"""From times, s, to a state, and the errors of joint angles, rad, and of the force, N."""


def simulate_streams(
    cell: Cell,
    truth: Robot,
    plan: Plan,
    *,
    timing: Timing | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
    start: int = START,
    repeated: bool = False,
) -> Streams:
    """Both streams of one pass through a plan, with the effects of the robot.

    Args:
        cell: discs, sensor, noise of a touch.
        truth: the simulated robot: its parameters, or the model with its effects.
        plan: the touches.
        timing: how long the phases last.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.
        repeated: whether joints with memory come from another pass through the plan instead of the relaxed state.

    Raises:
        UnsupportedDataError: the simulated robot cannot reach a touch, or hold its force.
    """
    sensors = sensors or SensorModel()
    trajectory = Trajectory(cell, truth, plan, timing, repeated)
    errors = _touch_errors(sensors, cell, truth, trajectory, seed)

    def at(time: Floats) -> tuple[CellState, Floats, Floats]:
        return trajectory.state_at(time), *errors

    return recorded('simulation', cell, truth, sensors, trajectory.duration, at, seed, start)


def recorded(
    source: str, cell: Cell, truth: Robot, sensors: SensorModel, duration: float, at: Sensed, seed: int, start: int
) -> Streams:
    """Both streams of any motion as the sensors report them.

    Args:
        source: for messages.
        cell: frame and sign of the sensor.
        truth: the simulated robot.
        sensors: noise, bias and rates.
        duration: of the motion, s.
        at: the state at times in s, (k,), and the errors of joint angles and force, base frame, that it numbers.
        seed: of white noise and stamps.
        start: stamp of the start, ns.
    """
    random = np.random.default_rng([seed, 1])
    joint_stamps = sensors.stamps(duration, sensors.joint_rate, 0.0, random)
    wrench_stamps = sensors.stamps(duration, sensors.wrench_rate, sensors.offset, random)
    state, joint_errors, _ = at(1e-9 * joint_stamps.astype(np.float64))
    # the errors of the joints change from touch to touch during the travel
    before = np.where((state.phase == Phase.TRAVEL) & (state.touch > 0), state.touch - 1, state.touch)
    share = np.where(state.phase == Phase.TRAVEL, state.progress, 1.0)[:, None]
    error = (1.0 - share) * joint_errors[before] + share * joint_errors[state.touch]
    position = state.joints + error + sensors.joint_noise * random.standard_normal(error.shape)
    if sensors.resolution:
        position = np.round(position / sensors.resolution) * sensors.resolution
    state, _, force_errors = at(1e-9 * wrench_stamps.astype(np.float64))
    error = state.relative_force[:, None] * force_errors[state.touch]
    touch = TouchMetadata.plain(len(error))._replace(order=state.touch)
    force = reported_force(cell, truth, state.joints, state.force, error, state.relative_force, touch)
    force *= -1.0 if cell.sensor.sign is SensorSign.ON_ROBOT else 1.0
    force = force + sensors.bias + sensors.force_noise * random.standard_normal(force.shape)
    return Streams(source, JointStream(joint_stamps + start, position), WrenchStream(wrench_stamps + start, force))


def simulate_touches(cell: Cell, truth: Robot, plan: Plan, noise: Noise | None = None, seed: int = 0) -> TouchSet:
    """The touches of a plan without streams: Ḡ, the effects of the robot, and the noise of one touch.

    The same seed gives the same noise of the touches as in `simulate_streams`.

    Args:
        cell: discs, sensor.
        truth: the simulated robot: its parameters, or the model with its effects.
        plan: the touches.
        noise: repeatability; None: that of the cell; Noise(0, 0) for exact touches.
        seed: of the noise.

    Returns:
        One touch per row of the plan, force in the frame of the sensor.

    Raises:
        UnsupportedDataError: the simulated robot cannot reach a touch, or hold its force.
    """
    trajectory = Trajectory(cell, truth, plan)
    sensors = SensorModel(touch_noise=noise)
    joint_errors, force_errors = _touch_errors(sensors, cell, truth, trajectory, seed)
    t, joints = trajectory, trajectory.hold_joints + joint_errors
    force = reported_force(cell, truth, t.hold_joints, t.hold_force, force_errors, metadata=t.metadata)
    beyond = np.hypot(*t.peak_force.T) / np.hypot(*t.hold_force.T)
    errors = beyond[:, None] * force_errors
    peak_force = reported_force(cell, truth, t.peak_joints, t.peak_force, errors, beyond, t.metadata)
    peaks, holds = np.hstack([t.peak_joints + joint_errors, peak_force]), np.hstack([joints, force])
    return TouchSet(
        joints=joints,
        force=force,
        disc=plan.disc,
        posture=plan.posture,
        time=trajectory.hold_time,
        approach=trajectory.metadata.approach,
        press=trajectory.metadata.press,
        history=load_histories(peaks, holds, plan.preload > 0, cell.nominal, cell.sensor.frame).hold,
    )


def _touch_errors(
    sensors: SensorModel, cell: Cell, truth: Robot, trajectory: Trajectory, seed: int
) -> tuple[Floats, Floats]:
    """The errors of each touch of a trajectory, base frame, (n, 2) each, rad and N."""
    joints, force = trajectory.hold_joints, trajectory.hold_force
    angle = sensor_angle(cell, as_model(truth).parameters, joints)
    unit = np.random.default_rng([seed, 0]).standard_normal((2, len(joints), 2))
    return sensors.touch_errors(cell, unit, force, angle)
