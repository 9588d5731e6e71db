"""H̄ of one pose after the other, as they come at 1 kHz: the equations of `kinetostatics` with plain floats.

For one pose, arrays take ten times as long as the arithmetic. What effects add is worked out with arrays all the same.

**Hysteresis.** In a dead band, of a joint without load say, the noise of the force would move the tip to and fro. So
the places in the dead bands follow a force that gives way to the measured one only where they differ by more than
`WIDTH` standard deviations; all else follows the measured force at once.

**Covariance.** It changes slowly: it is worked out anew where joints, force or a place in a dead band have moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import cos, hypot, isfinite, nan, sin
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm, Predictor, force_on_object
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Noise, SensorFrame
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata, TouchState
from scara_kinetostatic.model.kinematics import forward, posture
from scara_kinetostatic.model.kinetostatics import (
    SIGN_KNOWN,
    Force,
    Law,
    Loading,
    load_arm,
    newton_step,
    tip_by_joints,
    tip_by_noise,
)


class MotionSense:
    """The sense in which each joint has moved last, pose after pose; 0 before its first motion."""

    def __init__(self) -> None:
        self._references = list[float]()
        self._sense = [0.0, 0.0]

    def note(self, first: float, second: float) -> tuple[float, float]:
        """The senses after the next pose, -1, 0 or 1 each.

        Args:
            first: angle of joint 1, rad.
            second: of joint 2.
        """
        self._references = self._references or [first, second]
        for joint, angle in enumerate((first, second)):
            moved = angle - self._references[joint]
            # movement of a joint that counts as its last one, rad: above the noise of its angle
            if abs(moved) > 1e-4:
                self._references[joint], self._sense[joint] = angle, 1.0 if moved > 0 else -1.0
        return self._sense[0], self._sense[1]


def motion_senses(joints: Floats) -> Floats:
    """The senses at each of n poses that follow each other, (n, 2): -1, 0 or 1.

    Args:
        joints: Q, (n, 2), rad.
    """
    sense = MotionSense()
    return np.array([sense.note(*pair) for pair in joints.tolist()]).reshape(-1, 2)


def check_free(arm: CalibratedArm, joints: Floats, reported: Floats) -> None:
    """Check that the tip does not press against an object of the cell, as where the zero of the force is taken.

    A force r is reported, f = A(Q, L̄) is that of the object at these joint angles. What is left for the zero is r where
    nothing is touched, r - f where the object is; the smaller of both is believed.

    Args:
        arm: the calibrated arm.
        joints: Q, (1, 2), rad.
        reported: on the object, in the sensor's frame, less the zero where one is known, (1, 2), N.

    Raises:
        UnsupportedDataError: it presses.
    """
    p, surfaces = arm.model.parameters, arm.cell.surfaces
    near = surfaces.distances(forward(p, joints)).argmin(axis=1)
    known = TouchMetadata.plain(1)._replace(disc=surfaces.object[near], posture=posture(p, joints), surface=near)
    places = surfaces.centers[near], surfaces.radii[near], arm.cell.gripper_sign
    found = contact(arm.model, joints, *places, metadata=known, tangents=surfaces.tangents[near])
    force, remedy = force_on_object(arm, reported, joints), 'move it away, then tare'
    if (np.hypot(*(force - found.force).T) < np.hypot(*force.T)).any():
        pressed = f'{arm.cell.discs[int(surfaces.object[near[0]])].name!r} with {found.magnitude[0]:.2g} N'
        raise UnsupportedDataError(f'by its joint angles the tip presses against {pressed}', remedy)


WIDTH = 2.0
"""Of the hysteresis, standard deviations of a component of the force."""
_NOWHERE = (nan,) * 7
"""A pose from which all others have moved away."""
_PASSES = 30


class OnlinePosition(NamedTuple):
    """Where the tip is.

    Attributes:
        x: base frame, m; NaN where it could not be found.
        y: along y.
        yaw: angle of link 2, which is the x axis of the tool frame, rad.
        covariance: of x, y and yaw by calibration, dead band and noise of the measurement, (3, 3), m² and rad²; NaN
            where the calibration does not determine it.
        status: as that of `TipPosition`.
    """

    x: float
    y: float
    yaw: float
    covariance: Floats
    status: str


class OnlineArm:
    """A calibrated arm whose tip is followed, sample by sample.

    Args:
        arm: the arm.
        noise: of one sample of joints and force; None for that of one touch.
    """

    def __init__(self, arm: CalibratedArm, noise: Noise | None = None) -> None:
        self.arm = arm if noise is None else replace(arm, noise=noise)
        self.predictor = Predictor(self.arm)
        self._law, self._p = self.predictor.law, self.predictor.law.model.parameters
        self._spread = arm.spread
        self._covariance, self._covariance_at = np.full((3, 3), nan), _NOWHERE
        exact = self.arm.sensor == (0.0, 0.0) and not self._law.model.has_sensor_error
        self._is_sensor_exact = exact and arm.cell.sensor.frame is SensorFrame.BASE
        self._levels = self.arm.noise.force_rms, self.arm.noise.growth
        self._held = (0.0, 0.0)
        self._parts = dict[bool, Law]()  # of the effects, the named and the undetected ones
        for is_small in (False, True):
            if some := [pair for pair in self._law.model.acting.pairs if pair[0].is_undetected == is_small]:
                effects, values = zip(*some, strict=True)
                model = ExtendedModel(self._p, effects, tuple(map(tuple, values)))
                self._parts[is_small] = replace(self._law, model=model)
        self._shifts = dict.fromkeys(self._parts, np.zeros(4))
        self._shift = (0.0, 0.0, 0.0, 0.0)
        self._deflection = (0.0, 0.0)

    def follow_on(self, other: OnlineArm) -> None:
        """Takes over the hysteresis of another calibration of the same arm."""
        self._held = other._held

    def true_force(self, q1: float, q2: float, fx: float, fy: float) -> tuple[float, float]:
        """F in the base frame behind what the sensor reports in its own, N; NaN where there is none.

        Args:
            q1: angle of joint 1, rad.
            q2: of joint 2.
            fx: reported, on the object, N.
            fy: along y of the sensor's frame.
        """
        if self._is_sensor_exact:
            return fx, fy
        (found,) = force_on_object(self.arm, np.array([[fx, fy]]), np.array([[q1, q2]])).tolist()
        return found[0], found[1]

    def locate(
        self, q1: float, q2: float, fx: float, fy: float, metadata: TouchMetadata | None = None
    ) -> OnlinePosition:
        """H̄.

        Args:
            q1: angle of joint 1, rad.
            q2: of joint 2.
            fx: true force on the object, base frame, N.
            fy: along y.
            metadata: of this one pose; None for nothing known.
        """
        p, force = self._p, self._force(fx, fy)
        joints, rest = (q1, q2), (q1 + p.theta1, q1 + p.theta1 + q2 + p.theta2)
        first, second = rest[0] + self._deflection[0], rest[1] + self._deflection[1]
        first, second, load, rows, solved = self._links(joints, first, second, force)
        state = None
        # undetected effects are so small that they need not be worked out anew at every sample
        parts = self._parts and [small for small in self._parts if not small or self._is_outdated(joints, load, force)]
        if parts:
            for _ in range(_PASSES):
                state, change = self._update(parts, joints, load, force, metadata or TouchMetadata.plain(1))
                first, second, load, rows, solved = self._links(joints, first, second, force)
                # change of what effects add after which one more solution is enough, rad and m; it depends on itself
                # weakly
                if change < 1e-6:
                    break
        x, y = load.tip(p)
        x, y = x + self._shift[2], y + self._shift[3]
        if not (solved and isfinite(x) and isfinite(y)):
            self._deflection, self._shift, self._covariance_at = (0.0, 0.0), (0.0, 0.0, 0.0, 0.0), _NOWHERE
            return OnlinePosition(nan, nan, nan, np.full((3, 3), nan), 'undetermined')
        self._deflection = first - rest[0], second - rest[1]
        if self._is_outdated(joints, load, force):
            self._covariance_at = (q1, q2, load.s1, load.s2, force.place, fx, fy)
            if state is None and self._law.model.effects:
                state = self._law.touch_state(np.array([joints]), load, force, metadata or TouchMetadata.plain(1))
            self._covariance = self._covariance_of(load, rows, force, state)
        return OnlinePosition(x, y, second, self._covariance, self._status(load, force, second - first))

    def _force(self, fx: float, fy: float) -> Force:
        size, (level, growth) = hypot(fx, fy), self._levels
        std = hypot(level, growth * size)
        hx, hy = self._held if isfinite(self._held[0] + self._held[1]) else (0.0, 0.0)
        away = hypot(fx - hx, fy - hy)
        if away > WIDTH * std:
            part = 1.0 - WIDTH * std / away
            self._held = hx, hy = hx + part * (fx - hx), hy + part * (fy - hy)
        held = hypot(hx, hy)
        nx, ny = (hx / held, hy / held) if held > 0 else (1.0, 0.0)
        return Force(fx, fy, size, std, min(held / (SIGN_KNOWN * std), 1.0), nx, ny, (hx, hy))

    def _links(
        self, joints: tuple[float, float], first: float, second: float, force: Force
    ) -> tuple[float, float, Loading, tuple[float, float, float, float], bool]:
        """Angles of the links by Newton's method from a guess, the arm there, M⁻¹, and whether they were found."""
        p, offset, turn = self._p, self._law.offset(force), self._shift
        for _ in range(_PASSES):
            links = p.l1 * cos(first), p.l1 * sin(first), p.l2 * cos(second), p.l2 * sin(second)
            load = load_arm(p, links, offset, force, self._law.gravity_std)
            step1, step2, rows = newton_step(p, joints, (first, second), turn, load, force)
            first, second = first - step1, second - step1 - step2
            # a step of Newton's method after which the angles are right to its square, rad
            if abs(step1) + abs(step2) < 1e-7:
                x1, y1, x2, y2 = links
                step2 += step1
                turned = x1 + y1 * step1, y1 - x1 * step1, x2 + y2 * step2, y2 - x2 * step2
                return first, second, Loading(*turned, *load[4:]), rows, True
        return first, second, load, rows, False

    def _update(
        self, parts: Sequence[bool], joints: tuple[float, float], load: Loading, force: Force, metadata: TouchMetadata
    ) -> tuple[TouchState, float]:
        """Works out what effects add at a pose; the pose as they take it, and by what that differs from before."""
        state = self._law.touch_state(np.array([joints]), load, force, metadata)
        for part in parts:
            self._shifts[part] = np.concatenate(self._parts[part].shift(state, np.array([force.place])), axis=1)[0]
        one, two, three, four = np.sum(list(self._shifts.values()), axis=0).tolist()
        before, self._shift = self._shift, (one, two, three, four)
        return state, max(abs(new - old) for new, old in zip(self._shift, before, strict=True))

    def _is_outdated(self, joints: tuple[float, float], load: Loading, force: Force) -> bool:
        """Whether the pose has moved away from where the covariance was worked out."""
        old1, old2, s1, s2, place, fx, fy = self._covariance_at
        # change of a joint angle, rad, beyond which the covariance is worked out anew; of a component of the force; and
        # of a place in a dead band
        near = abs(joints[0] - old1) < 4e-3 and abs(joints[1] - old2) < 4e-3
        near = near and abs(force.x - fx) < 4.0 * force.std and abs(force.y - fy) < 4.0 * force.std
        return not (near and max(abs(load.s1 - s1), abs(load.s2 - s2), abs(force.place - place)) < 0.02)

    def _covariance_of(
        self, load: Loading, rows: tuple[float, float, float, float], force: Force, state: TouchState | None
    ) -> Floats:
        """Of x, y and yaw by calibration, dead band and noise of the measurement, (3, 3); NaN if it is undetermined."""
        jacobian = tip_by_joints(load, rows, with_yaw=True)
        by_noise = tip_by_noise(self._law, jacobian, load, force)
        return self._spread.of_poses(self._law, jacobian, load, force, state) + by_noise @ by_noise.T

    def _status(self, load: Loading, force: Force, elbow: float) -> str:
        used, side = self.arm.used, 1 if sin(elbow) > 0 else -1
        if not isfinite(self._covariance[0, 0]):
            return 'undetermined'
        if force.size > used.highest_force + SIGN_KNOWN * force.std or side not in used.postures:
            return 'extrapolated'
        return 'unloaded' if load.in_band or force.place < 1 else 'ok'
