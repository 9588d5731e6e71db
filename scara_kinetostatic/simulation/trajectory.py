"""The whole motion of a recording: joint angles and contact force at any time.

Each touch runs through eight phases (`PHASES`). Free phases interpolate between
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
A(Q(t), L̄) with the effects; see `loading`.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.kinematics import forward, wrap
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.simulation.loading import LIGHT, Loading
from scara_kinetostatic.simulation.phases import (
    APPROACH,
    EASE,
    HOLD,
    PAUSE,
    PHASES,
    PRESS,
    RELEASE,
    RETRACT,
    TRAVEL,
    Timing,
    minimum_jerk,
)
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.touches.approach import last_movement

__all__ = [
    'APPROACH',
    'EASE',
    'HOLD',
    'PAUSE',
    'PRESS',
    'RELEASE',
    'RETRACT',
    'TRAVEL',
    'Instant',
    'Motion',
    'Timing',
    'minimum_jerk',
]
Floats = NDArray[np.float64]

FIRST_FORCE = 1e-6
"""The 0+ of `Ḡ(S, 0+)`, N: the sense of the force is settled, its size is not yet felt."""

CLOSE = 5e-4
"""Farther from where a contact is commanded to begin there is none, m: what effects do to that is commanded."""


class Instant(NamedTuple):
    """The state of the cell at k times.

    Attributes:
        joints: actuator angles Q, (k, 2), rad.
        force: force on the object in the base frame, (k, 2), N.
        touch: number of the touch in the plan, (k,); after the last touch, the last.
        phase: which of `PHASES`, (k,).
        progress: how much of the phase has passed, by the time law, 0 to 1, (k,).
        level: contact force as a part of that of the hold, 0 to about 1 + preload, (k,).
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
        cell: discs, sign of the gripper's law.
        truth: the simulated robot, with its effects.
        plan: the touches.
        timing: how long the phases last.

    Attributes:
        duration: of the whole motion, s.
        knots: start of every phase, (m, 8), s.
        hold_joints: Q in each hold, (m, 2), rad.
        hold_force: F on the object in each hold, base frame, (m, 2), N.
        peak_joints: Q under the largest force, (m, 2), rad; that of the hold without preload.
        contact_joints: Q at which each contact begins, (m, 2), rad.
        free_joints: Q of each free pose, (m, 2), rad.
        tags: disc, time, approach, posture and press of each touch.

    Raises:
        UnsupportedDataError: the plan is empty, or the simulated robot cannot reach a touch or hold its force.
    """

    def __init__(self, cell: Cell, truth: ExtendedModel | Parameters, plan: Plan, timing: Timing | None = None) -> None:
        self.cell, self.plan, self.timing = cell, plan, timing or Timing()
        self.model = as_model(truth)
        self.truth = self.model.parameters
        if not len(plan):
            raise UnsupportedDataError('the plan holds no touch', 'plan at least one')
        self._contact = plan.contact(cell)
        self._inward = -plan.normal()
        self.hold_force = plan.force[:, None] * self._inward
        self._depth = np.zeros((2, len(plan)))
        self._loading: Loading | None = None
        self._find_poses()
        self._home = self.free_joints[[0, -1]] + (0.25, -0.15)
        self.knots, self.duration = self._schedule()
        self.metadata = self._metadata()
        if self.model.effects:
            self._play_effects()

    def _find_poses(self) -> None:
        """Joint angles at the ends of the phases."""
        self.hold_joints = self._pose(self._aim(1.0), self.hold_force)
        self.contact_joints = self._near_hold(self._pose(self._aim(0.0), FIRST_FORCE * self._inward))
        self.peak_joints = self._pressed(np.arange(len(self.plan)), 1.0 + self.plan.preload)
        clear = self._contact - self.timing.clearance * self._inward
        self.free_joints = self._near_hold(self._pose(clear, np.zeros_like(clear)))
        self._check_reach()

    def _play_effects(self) -> None:
        """The forces with effects. A touch's tags are those of the path without, then corrected once."""
        planned = self.hold_force
        for _ in range(2):
            self.metadata = self._metadata()
            loading = Loading(self.cell, self.model, self.plan, self.metadata)
            softness = self._softness(planned)
            for row, level in enumerate((LIGHT, 1.0)):
                aimed = partial(self._aimed, level * planned)
                self._depth[row] = loading.depths(aimed, level, softness, self._depth[row])
            self._find_poses()
        self.hold_force, self._loading = loading.held(self.hold_joints), loading

    def _metadata(self) -> TouchMetadata:
        approach, press = (last_movement(path, self.hold_joints) for path in (self.way, self.way[1:]))
        return TouchMetadata(self.plan.disc, self.hold_time, approach, self.plan.posture, press)

    def _softness(self, force: Floats) -> Floats:
        """Way of the tip along the normal per force, by the twelve, (m,), m/N."""
        p, size = self.truth, np.hypot(*force.T)
        torques = inverse_kinetostatics(p, self._contact, force, self.plan.posture, self.cell.gripper)[1]
        return np.asarray(p.p_ee + (np.array([p.p1, p.p2]) * (torques / size[:, None]) ** 2).sum(axis=1))

    def _aimed(self, force: Floats, depth: Floats) -> Floats:
        """Ḡ of the twelve for a tip that is aimed deeper, (m, 2), rad."""
        return self._pose(self._contact + depth[:, None] * self._inward, force)

    def _aim(self, level: Floats | float, touch: NDArray[np.intp] | slice = slice(None)) -> Floats:
        """Where the tip of the twelve is commanded to be under a part of the force of the hold, (k, 2), m."""
        first, hold = self._depth[:, touch]
        depth = first + (level - LIGHT) / (1.0 - LIGHT) * (hold - first)
        return self._contact[touch] + depth[:, None] * self._inward[touch]

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
        if self._loading is not None:
            close = np.flatnonzero(self._close(touch, phase, joints))
            force[close] = self._loading.along(touch[close], joints[close], force[close])
            level = np.hypot(*force.T) / np.hypot(*self.hold_force[touch].T)
        return Instant(joints, force, touch, phase, progress, level)

    def _close(self, touch: NDArray[np.intp], phase: NDArray[np.intp], joints: Floats) -> NDArray[np.bool_]:
        """Where a force is possible and not known yet, (k,): on the way, not farther than `CLOSE` from the contact."""
        way = forward(self.truth, joints) - forward(self.truth, self.contact_joints[touch])
        warm_start = np.einsum('ij,ij->i', way, self._inward[touch]) > -CLOSE
        return np.asarray((phase >= APPROACH) & (phase != HOLD) & warm_start)

    def _level(self, touch: NDArray[np.intp], phase: NDArray[np.intp], progress: Floats) -> Floats:
        """Force as a part of that of the hold, (k,)."""
        beyond = self.plan.preload[touch]
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
        joints = self._inverse(touch, self._aim(level, touch), force)
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
        durations[:, EASE] *= self.plan.preload > 0
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
