"""The whole motion of a recording: joint angles and contact force at any time.

Each touch runs through eight phases (`PHASES`). Free phases interpolate between
poses in joint space; the arm travels with its third axis lifted, so the tip may
pass over the discs without force. A touch comes from the free pose, on the normal
of the disc at a clearance, to the pose at which the backlash is used up and the
force begins, `Ḡ(S, 0+)`. From there on the contact S stays and the force follows
its time law: Q(t) = Ḡ(S, F(t)), hence F(t) = A(Q(t), L̄) all along, without an
inner solve. Every phase follows the minimum-jerk law 10 s³ - 15 s⁴ + 6 s⁵. A press
with overpress goes beyond the force of the hold and eases down to it; without, that
phase lasts no time.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import wrap
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.simulation.plan import CLEARANCE, Plan

Floats = NDArray[np.float64]

PHASES = ('travel', 'pause', 'approach', 'press', 'ease', 'hold', 'release', 'retract')
TRAVEL, PAUSE, APPROACH, PRESS, EASE, HOLD, RELEASE, RETRACT = range(8)
FIRST_FORCE = 1e-6
"""The 0+ of `Ḡ(S, 0+)`, N: the sense of the force is settled, its size is not yet felt."""


@dataclass(frozen=True)
class Timing:
    """How long the phases of a touch last, s.

    Attributes:
        travel: shortest travel between two touches.
        pause: rest at the free pose before the approach.
        approach: from the free pose to the disc.
        press: from no force to the force of the hold, or to the peak beyond it.
        ease: from the peak down to the force of the hold, where there is one.
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
        for item in fields(self):
            value = getattr(self, item.name)
            if not np.isfinite(value) or value < 0 or (value == 0 and item.name != 'pause'):
                raise ParameterError(f'timing: {item.name}', f'expected a value above 0, got {value}')


class Instant(NamedTuple):
    """The state of the cell at k times.

    Attributes:
        joints: actuator angles Q, (k, 2), rad.
        force: force on the object in the base frame, (k, 2), N.
        touch: number of the touch in the plan, (k,); after the last touch, the last.
        phase: which of `PHASES`, (k,).
        progress: how much of the phase has passed, by the time law, 0 to 1, (k,).
        level: contact force as a part of that of the hold, 0 to 1 + overpress, (k,).
    """

    joints: Floats
    force: Floats
    touch: NDArray[np.intp]
    phase: NDArray[np.intp]
    progress: Floats
    level: Floats


class Motion:
    """The motion of one cell through one plan.

    Args:
        cell: discs and sign of the gripper's law.
        truth: the parameters of the simulated robot.
        plan: the touches.
        timing: how long the phases last.

    Attributes:
        duration: of the whole motion, s.
        knots: start of every phase, (m, 8), s.
        hold_joints: Q in each hold, (m, 2), rad.
        hold_force: F on the object in each hold, base frame, (m, 2), N.
        peak_joints: Q under the largest force, (m, 2), rad; that of the hold without overpress.
        contact_joints: Q at which each contact begins, (m, 2), rad.
        free_joints: Q of each free pose, (m, 2), rad.

    Raises:
        UnsupportedDataError: the plan is empty, or the simulated robot cannot reach a touch.
    """

    def __init__(self, cell: Cell, truth: Parameters, plan: Plan, timing: Timing | None = None) -> None:
        self.cell, self.truth, self.plan, self.timing = cell, truth, plan, timing or Timing()
        if not len(plan):
            raise UnsupportedDataError('the plan holds no touch', 'plan at least one')
        self._contact = plan.contact(cell)
        self._inward = -plan.normal()
        self.hold_force = plan.force[:, None] * self._inward
        self.hold_joints = self._pose(self._contact, self.hold_force)
        self.contact_joints = self._near_hold(self._pose(self._contact, FIRST_FORCE * self._inward))
        self.peak_joints = self._pressed(np.arange(len(plan)), 1.0 + plan.overpress)
        clear = self._contact - self.timing.clearance * self._inward
        self.free_joints = self._near_hold(self._pose(clear, np.zeros_like(clear)))
        self._check_reach()
        self._home = self.free_joints[[0, -1]] + (0.25, -0.15)
        self.knots, self.duration = self._schedule()

    @property
    def hold_time(self) -> Floats:
        """Middle of each hold, (m,), s."""
        return self.knots[:, HOLD] + 0.5 * self.timing.hold

    @property
    def way(self) -> Floats:
        """Joint angles through which each touch comes to its hold: free, first contact, peak, (3, m, 2), rad."""
        return np.stack([self.free_joints, self.contact_joints, self.peak_joints])

    def at(self, time: ArrayLike) -> tuple[Floats, Floats]:
        """Joint angles and force at any times.

        Args:
            time: since the start, (k,), s; before the start and past the end the arm rests.

        Returns:
            Q, (k, 2), rad, and F on the object in the base frame, (k, 2), N.
        """
        instant = self.instant(time)
        return instant.joints, instant.force

    def instant(self, time: ArrayLike) -> Instant:
        """The same with the touch and the phase; see `Instant`."""
        time = np.clip(np.atleast_1d(np.asarray(time, dtype=float)), 0.0, self.duration)
        starts = np.append(self.knots.ravel(), self.knots[-1, RETRACT] + self.timing.retract)
        ends = np.append(starts[1:], self.duration)
        row = np.clip(np.searchsorted(starts, time, side='right') - 1, 0, len(starts) - 1)
        span = ends[row] - starts[row]
        progress = minimum_jerk(np.divide(time - starts[row], span, out=np.ones_like(time), where=span > 0))
        touch, phase = np.minimum(row // len(PHASES), len(self.plan) - 1), row % len(PHASES)
        begin, end = self._poses()
        joints = begin[row] + progress[:, None] * (end[row] - begin[row])
        going_home = row == len(starts) - 1
        level = np.where(going_home, 0.0, self._level(touch, phase, progress))
        force = level[:, None] * self.hold_force[touch]
        loaded = np.flatnonzero((phase >= PRESS) & (phase <= RELEASE) & ~going_home)
        joints[loaded] = self._pressed(touch[loaded], level[loaded])
        return Instant(joints, force, touch, phase, progress, level)

    def _level(self, touch: NDArray[np.intp], phase: NDArray[np.intp], progress: Floats) -> Floats:
        """Force as a part of that of the hold, (k,)."""
        beyond = self.plan.overpress[touch]
        levels = [progress * (1.0 + beyond), 1.0 + beyond * (1.0 - progress), np.ones_like(progress), 1.0 - progress]
        return np.select([phase == which for which in (PRESS, EASE, HOLD, RELEASE)], levels, 0.0)

    def _pose(self, tip: Floats, force: Floats) -> Floats:
        """Ḡ of one pose per touch."""
        return self._inverse(np.arange(len(self.plan)), tip, force)

    def _inverse(self, touch: NDArray[np.intp], tip: Floats, force: Floats) -> Floats:
        """Ḡ in the posture of each touch: Q for places of the tip and forces, (k, 2) each."""
        return inverse_kinetostatics(self.truth, tip, force, self.plan.posture[touch], self.cell.gripper)[0]

    def _pressed(self, touch: NDArray[np.intp], level: Floats) -> Floats:
        """Ḡ under a part of the force of the hold, without a jump of a full turn within the touch."""
        force = np.maximum(level * self.plan.force[touch], FIRST_FORCE)[:, None] * self._inward[touch]
        joints = self._inverse(touch, self._contact[touch], force)
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
            raise UnsupportedDataError(
                f'the simulated robot cannot reach touch {lost[0]} of the plan, on {name!r}',
                'leave the touch out, move the disc, or simulate a robot closer to the nominal one',
            )

    def _schedule(self) -> tuple[Floats, float]:
        """Starts of all phases and the end of the motion."""
        fixed = [getattr(self.timing, name) for name in PHASES[1:]]
        stops = np.vstack([self._home[:1], self.free_joints, self._home[1:]])
        distance = np.abs(np.diff(stops, axis=0)).max(axis=1)
        travel = np.maximum(self.timing.travel, distance / self.timing.speed)
        durations = np.column_stack([travel[:-1], np.tile(fixed, (len(self.plan), 1))])
        durations[:, EASE] *= self.plan.overpress > 0
        ends = np.cumsum(durations)
        starts = np.concatenate([[0.0], ends[:-1]]).reshape(durations.shape)
        return starts, float(ends[-1] + travel[-1])

    def _poses(self) -> tuple[Floats, Floats]:
        """Joint angles at the start and at the end of every phase, the way home last, (7 m + 1, 2) each."""
        free, touch, peak, hold = self.free_joints, self.contact_joints, self.peak_joints, self.hold_joints
        before = np.vstack([self._home[:1], free[:-1]])
        begin = np.stack([before, free, free, touch, peak, hold, hold, touch], axis=1).reshape(-1, 2)
        end = np.stack([free, free, touch, peak, hold, hold, touch, free], axis=1).reshape(-1, 2)
        return np.vstack([begin, free[-1:]]), np.vstack([end, self._home[1:]])


def minimum_jerk(part: Floats) -> Floats:
    """10 s³ - 15 s⁴ + 6 s⁵: from 0 to 1, at rest at both ends."""
    return part**3 * (10.0 + part * (6.0 * part - 15.0))
