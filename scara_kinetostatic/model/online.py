"""H̄ of one pose after the other, as they come at 1 kHz: the equations of `tip` with plain floats.

For one pose, arrays take ten times as long as the arithmetic. What effects add is worked out with arrays all the same.

**Hysteresis.** In a dead band, of a joint without load say, the noise of the force would move the tip to and fro. So
the places in the dead bands follow a force that gives way to the measured one only where they differ by more than
`WIDTH` standard deviations; all else follows the measured force at once.

**Covariance.** It changes slowly: it is worked out anew where joints, force or a place in a dead band have moved.
"""

from __future__ import annotations

from dataclasses import replace
from math import cos, hypot, isfinite, nan, sin
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arm import CalibratedArm, Predictor, force_on_object
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Noise, SensorFrame
from scara_kinetostatic.model.effect_law import TouchMetadata, TouchState
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.sensor_error import has_sensor_error
from scara_kinetostatic.model.tip import DEPENDS, SIGN_KNOWN, STEEPEST, Force, Law, Loading, Spread, Squares, faded


class MotionSense:
    """The sense in which each joint has moved last, pose after pose; 0 before its first motion."""

    def __init__(self) -> None:
        self._references = [0.0, 0.0]
        self._sense = [0.0, 0.0]
        self._begun = False

    def note(self, first: float, second: float) -> tuple[float, float]:
        """The senses after the next pose, -1, 0 or 1 each.

        Args:
            first: angle of joint 1, rad.
            second: of joint 2.
        """
        angles = (first, second)
        if not self._begun:
            self._references, self._begun = list(angles), True
        for joint, angle in enumerate(angles):
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


class HeldForce(NamedTuple):
    """The measured force, and the one that the dead bands follow."""

    x: float
    y: float
    size: float
    std: float
    held_x: float
    held_y: float
    place: float
    nx: float
    ny: float


class PoseLoad(NamedTuple):
    """As `Loading`, of one pose."""

    x1: float
    y1: float
    x2: float
    y2: float
    c1: float
    c2: float
    s1: float
    s2: float
    k1: float
    k2: float


class InverseRows(NamedTuple):
    """M⁻¹."""

    i11: float
    i12: float
    i21: float
    i22: float


def load_at(p: Parameters, first: float, second: float, force: HeldForce) -> PoseLoad:
    """The torques of a pose, and its places in the dead bands.

    Args:
        p: the parameters.
        first: angle of link 1, rad.
        second: of link 2.
        force: on the object.
    """
    x1, y1, x2, y2 = p.l1 * cos(first), p.l1 * sin(first), p.l2 * cos(second), p.l2 * sin(second)
    c2 = x2 * force.y - y2 * force.x
    h2 = x2 * force.held_y - y2 * force.held_x
    h1 = x1 * force.held_y - y1 * force.held_x + h2
    own, known = STEEPEST * (p.l1 + p.l2) * force.size, SIGN_KNOWN * force.std
    b1, b2 = known * hypot(x1 + x2, y1 + y2) + abs(p.g1) * own, known * p.l2 + abs(p.g2) * own
    k1, k2 = p.p1 + (p.g1 / b1 if -b1 < h1 < b1 else 0.0), p.p2 + (p.g2 / b2 if -b2 < h2 < b2 else 0.0)
    s1, s2 = min(max(h1 / b1, -1.0), 1.0), min(max(h2 / b2, -1.0), 1.0)
    return PoseLoad(x1, y1, x2, y2, x1 * force.y - y1 * force.x + c2, c2, s1, s2, k1, k2)


def turned(load: PoseLoad, first: float, second: float) -> PoseLoad:
    """The arm with its links turned by tiny angles, rad."""
    x1, y1, x2, y2 = load[:4]
    return load._replace(x1=x1 - y1 * first, y1=y1 + x1 * first, x2=x2 - y2 * second, y2=y2 + x2 * second)


def inverse_rows(load: PoseLoad, force: HeldForce) -> InverseRows:
    """M⁻¹, as `tip.inverse_of_rows`."""
    c22 = -(force.x * load.x2 + force.y * load.y2)
    c11 = c22 - (force.x * load.x1 + force.y * load.y1)
    m11, m12, m21, m22 = 1.0 + load.k1 * c11, load.k1 * c22, load.k2 * c22, 1.0 + load.k2 * c22
    scale = 1.0 / (m11 * m22 - m12 * m21)
    return InverseRows(m22 * scale, -m12 * scale, -m21 * scale, m11 * scale)


_MOVED_ONLINE_COVARIANCE = 4e-3
"""Change of a joint angle, rad, beyond which the covariance is worked out anew."""


class OnlineCovariance:
    """Of x, y and yaw by calibration, dead band and noise of the measurement.

    Args:
        arm: with the noise of one sample.
        law: of its deflections.

    Attributes:
        matrix: (3, 3), m² and rad²; NaN where the calibration does not determine it.
    """

    def __init__(self, arm: CalibratedArm, law: Law) -> None:
        self._p, self._along, self._joint_noise = law.model.parameters, law.gripper.factor, arm.noise.joint_levels
        spread = Spread.of(arm.covariance, arm.undetermined)
        self._factor, self._free = np.ascontiguousarray(spread.factor.T), np.ascontiguousarray(spread.undetermined.T)
        self._gaps, self._free_gaps = spread.gaps(self._p), spread.undetermined_gaps
        self._key = (nan,) * 7
        self.matrix = np.full((3, 3), nan)

    def is_outdated(self, q1: float, q2: float, load: PoseLoad, force: HeldForce) -> bool:
        """Whether the pose has moved away from where it was worked out; then it counts as worked out there."""
        # change of a component of the force beyond which the covariance is worked out anew
        pushed, (old1, old2, s1, s2, place, fx, fy) = 4.0 * force.std, self._key
        near = abs(q1 - old1) < _MOVED_ONLINE_COVARIANCE and abs(q2 - old2) < _MOVED_ONLINE_COVARIANCE
        near = near and abs(force.x - fx) < pushed and abs(force.y - fy) < pushed
        # and of a place in a dead band
        if near and max(abs(load.s1 - s1), abs(load.s2 - s2), abs(force.place - place)) < 0.02:
            return False
        self._key = (q1, q2, load.s1, load.s2, force.place, force.x, force.y)
        return True

    def renew(self, load: PoseLoad, rows: InverseRows, force: HeldForce, by_effects: Floats) -> None:
        """Works it out.

        Args:
            load: of the pose.
            rows: M⁻¹ there.
            force: on the object.
            by_effects: δ and d per unit of each value of the effects, (k, 4).
        """
        self.matrix = self._at(load, rows, force, by_effects)

    def _at(self, load: PoseLoad, rows: InverseRows, force: HeldForce, by_effects: Floats) -> Floats:
        j1x, j1y = -(load.y1 + load.y2), load.x1 + load.x2
        gxx, gxy = j1x * rows.i11 - load.y2 * rows.i21, j1x * rows.i12 - load.y2 * rows.i22
        gyx, gyy = j1y * rows.i11 + load.x2 * rows.i21, j1y * rows.i12 + load.x2 * rows.i22
        w1, w2 = rows.i11 + rows.i21, rows.i12 + rows.i22
        by_joints = np.array([[gxx, gyx, w1], [gxy, gyy, w2]])
        derivative = self._derivative(load, force, by_joints, by_effects)
        spread = self._factor @ derivative
        found: Floats = spread.T @ spread
        if len(self._free):
            change = self._free @ derivative[:, :2]
            if (change * change).sum() > DEPENDS**2 * (found[0, 0] + found[1, 1]):
                return np.full((3, 3), nan)
        by_1, by_2 = by_joints
        found = found + self._by_bands(self._gaps, load, force, by_1, by_2)
        if len(self._free):
            free = self._by_bands(self._free_gaps, load, force, by_1, by_2)
            if free[0, 0] + free[1, 1] > DEPENDS**2 * (found[0, 0] + found[1, 1]):
                return np.full((3, 3), nan)
        q1, q2 = self._joint_noise
        by_force = self._by_force(load, force, by_1, by_2)
        return found + q1 * q1 * by_1[:, None] * by_1 + q2 * q2 * by_2[:, None] * by_2 + by_force @ by_force.T

    def _by_bands(self, gaps: Squares, load: PoseLoad, force: HeldForce, by_1: Floats, by_2: Floats) -> Floats:
        """Of x, y and yaw by the places in the dead bands, (3, 3)."""
        v1, v2 = gaps.joint1 / 3 * (1 - load.s1 * load.s1), gaps.joint2 / 3 * (1 - load.s2 * load.s2)
        found: Floats = v1 * by_1[:, None] * by_1 + v2 * by_2[:, None] * by_2
        own = gaps.gripper / 3 * (1 - force.place * force.place)
        found[0, 0] += own
        found[1, 1] += own
        return found

    def _derivative(self, load: PoseLoad, force: HeldForce, by_joints: Floats, by_effects: Floats) -> Floats:
        """Of x, y and yaw by the values of the model, (12 + k, 3), as `tip.tip_derivative`."""
        p, s = self._p, self._along
        u1x, u1y, u2x, u2y = load.x1 / p.l1, load.y1 / p.l1, load.x2 / p.l2, load.y2 / p.l2
        by_l1, by_l2 = u1x * force.y - u1y * force.x, u2x * force.y - u2y * force.x
        place = force.place
        plain = (
            (1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (u1x, u1y), (0.0, 0.0), (u2x, u2y), (s * force.x, s * force.y),
            (0.0, 0.0), (0.0, 0.0), (-place * force.nx, -place * force.ny), (0.0, 0.0), (0.0, 0.0),
        )  # fmt: skip
        joints = (
            (0.0, 0.0), (0.0, 0.0), (1.0, 0.0), (-load.k1 * by_l1, 0.0), (0.0, 1.0),
            (-load.k1 * by_l2, -load.k2 * by_l2), (0.0, 0.0), (-load.c1, 0.0), (0.0, -load.c2),
            (0.0, 0.0), (-load.s1, 0.0), (0.0, -load.s2),
        )  # fmt: skip
        found = np.array(joints) @ by_joints
        found[:, :2] += np.array(plain)
        if not len(by_effects):
            return found
        effects = -by_effects[:, :2] @ by_joints
        effects[:, :2] += by_effects[:, 2:]
        return np.concatenate([found, effects])

    def _by_force(self, load: PoseLoad, force: HeldForce, by_1: Floats, by_2: Floats) -> Floats:
        """Standard deviation of x, y and yaw by the noise of both components of the force, (3, 2)."""
        p, std = self._p, force.std
        along = self._along * p.p_ee
        aside = p.g_ee * force.place / max(force.size, SIGN_KNOWN * std)
        nx, ny = force.nx, force.ny
        tip = ((along - aside * ny * ny, aside * nx * ny), (aside * nx * ny, along - aside * nx * nx), (0.0, 0.0))
        torque1 = np.array([-(load.y1 + load.y2), load.x1 + load.x2])
        torque2 = np.array([-load.y2, load.x2])
        return std * (np.array(tip) - p.p1 * by_1[:, None] * torque1 - p.p2 * by_2[:, None] * torque2)


WIDTH = 2.0
"""Of the hysteresis, standard deviations of a component of the force."""
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

    Raises:
        ParameterError: the gripper of the cell is not isotropic.
    """

    def __init__(self, arm: CalibratedArm, noise: Noise | None = None) -> None:
        self.arm = arm if noise is None else replace(arm, noise=noise)
        if not arm.cell.gripper.isotropic:
            raise ParameterError('gripper_excess', 'a gripper that is not isotropic cannot be followed online')
        self.predictor = Predictor(self.arm)
        self._law, self._p = self.predictor.law, self.predictor.law.model.parameters
        self._covariance = OnlineCovariance(self.arm, self._law)
        exact = self.arm.sensor == (0.0, 0.0) and not has_sensor_error(self._law.model)
        self._is_sensor_exact = exact and arm.cell.sensor.frame is SensorFrame.BASE
        self._levels = self.arm.noise.force_rms, self.arm.noise.growth
        self._held = (0.0, 0.0)
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
        first, second = q1 + p.theta1 + self._deflection[0], q1 + p.theta1 + q2 + p.theta2 + self._deflection[1]
        first, second, load, rows, solved = self._links(q1, q2, first, second, force)
        state = None
        if self._law.model.effects:
            for _ in range(_PASSES):
                state, change = self._update(q1, q2, load, force, metadata)
                first, second, load, rows, solved = self._links(q1, q2, first, second, force)
                # change of what effects add after which one more solution is enough, rad and m; it depends on itself
                # weakly
                if change < 1e-6:
                    break
        _, _, moved_x, moved_y = self._shift
        along = self._law.gripper.slope(p)
        x = p.x0 + load.x1 + load.x2 + along * fx - p.g_ee * force.place * force.nx + moved_x
        y = p.y0 + load.y1 + load.y2 + along * fy - p.g_ee * force.place * force.ny + moved_y
        if not (solved and isfinite(x) and isfinite(y)):
            self._deflection, self._shift = (0.0, 0.0), (0.0, 0.0, 0.0, 0.0)
            return OnlinePosition(nan, nan, nan, np.full((3, 3), nan), 'undetermined')
        self._deflection = first - q1 - p.theta1, second - q1 - p.theta1 - q2 - p.theta2
        if self._covariance.is_outdated(q1, q2, load, force):
            self._covariance.renew(load, rows, force, self._derivatives(state, force))
        return OnlinePosition(x, y, second, self._covariance.matrix, self._status(load, force, second - first))

    def _force(self, fx: float, fy: float) -> HeldForce:
        size, (level, growth) = hypot(fx, fy), self._levels
        std = hypot(level, growth * size)
        hx, hy = self._held if isfinite(self._held[0] + self._held[1]) else (0.0, 0.0)
        away = hypot(fx - hx, fy - hy)
        if away > WIDTH * std:
            part = 1.0 - WIDTH * std / away
            self._held = hx, hy = hx + part * (fx - hx), hy + part * (fy - hy)
        held = hypot(hx, hy)
        nx, ny = (hx / held, hy / held) if held > 0 else (1.0, 0.0)
        return HeldForce(fx, fy, size, std, hx, hy, min(held / (SIGN_KNOWN * std), 1.0), nx, ny)

    def _links(
        self, q1: float, q2: float, first: float, second: float, force: HeldForce
    ) -> tuple[float, float, PoseLoad, InverseRows, bool]:
        """Angles of the links by Newton's method from a guess, the arm there, M⁻¹, and whether they were found."""
        p, (turn1, turn2, _, _) = self._p, self._shift
        for _ in range(_PASSES):
            load = load_at(p, first, second, force)
            rows = inverse_rows(load, force)
            row1 = first - p.theta1 - q1 + p.p1 * load.c1 + p.g1 * load.s1 + turn1
            row2 = second - first - p.theta2 - q2 + p.p2 * load.c2 + p.g2 * load.s2 + turn2
            step1, step2 = rows.i11 * row1 + rows.i12 * row2, rows.i21 * row1 + rows.i22 * row2
            first, second = first - step1, second - step1 - step2
            # a step of Newton's method after which the angles are right to its square, rad
            if abs(step1) + abs(step2) < 1e-7:
                return first, second, turned(load, -step1, -step1 - step2), rows, True
        return first, second, load, rows, False

    def _update(
        self, q1: float, q2: float, load: PoseLoad, force: HeldForce, metadata: TouchMetadata | None
    ) -> tuple[TouchState, float]:
        """Works out what the effects add at a pose; the pose as they take it, and by what that differs from before."""
        at, f = self._as_arrays(load, force)
        known = TouchMetadata.plain(1) if metadata is None else metadata
        state = self._law.touch_state(np.array([[q1, q2]]), at, f, known)
        joints, moved = self._law.shift(state, f.place)
        before, self._shift = self._shift, (*joints[0].tolist(), *moved[0].tolist())
        return state, max(abs(new - old) for new, old in zip(self._shift, before, strict=True))

    def _derivatives(self, state: TouchState | None, force: HeldForce) -> Floats:
        """δ and d per unit of each value of the effects, (k, 4)."""
        found = np.zeros((len(self._law.model.names) - len(NAMES), 4))
        if state is None:
            return found
        row, place = 0, np.array([force.place])
        for effect, values in zip(self._law.model.effects, self._law.model.effect_arrays, strict=True):
            for part in effect.derivative(state, values):
                shift = faded(part, effect.force_dependence, place)
                found[row, :2] = 0.0 if shift.joints is None else shift.joints[0]
                found[row, 2:] = 0.0 if shift.place is None or effect.on_object else shift.place[0]
                row += 1
        return found

    def _as_arrays(self, load: PoseLoad, force: HeldForce) -> tuple[Loading, Force]:
        slope, p = self._law.gripper.slope(self._p), self._p
        offset = (slope * force.x - p.g_ee * force.place * force.nx, slope * force.y - p.g_ee * force.place * force.ny)
        columns = np.array([*load[:4], *offset, *load[4:]])[:, None]
        direction = (force.x / force.size, force.y / force.size) if force.size > 0 else (1.0, 0.0)
        given = np.array([force.x, force.y, force.size, *direction, force.place, force.std])[:, None]
        return Loading(*columns), Force(*given)

    def _status(self, load: PoseLoad, force: HeldForce, elbow: float) -> str:
        used, side = self.arm.used, 1 if sin(elbow) > 0 else -1
        if not isfinite(self._covariance.matrix[0, 0]):
            return 'undetermined'
        if force.size > used.highest_force + SIGN_KNOWN * force.std or side not in used.postures:
            return 'extrapolated'
        return 'unloaded' if abs(load.s1) < 1 or abs(load.s2) < 1 or force.place < 1 else 'ok'
