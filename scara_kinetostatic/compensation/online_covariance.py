"""Covariance of the tip of one pose in plain floats: the equations of `uncertainty` for `online`.

It changes slowly: it is worked out anew where joints, force or a place in a dead band have moved.
"""

from __future__ import annotations

from math import nan

import numpy as np

from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.compensation.loading import SIGN_KNOWN, Law
from scara_kinetostatic.compensation.online_pose import HeldForce, InverseRows, PoseLoad
from scara_kinetostatic.compensation.uncertainty import DEPENDS, Spread, Squares
from scara_kinetostatic.model.arrays import Floats

_MOVED = 4e-3
"""Change of a joint angle, rad, beyond which the covariance is worked out anew."""
_PUSHED = 4.0
"""The same of a component of the force, standard deviations."""
_CROSSED = 0.02
"""The same of a place in a dead band."""


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
        pushed, (old1, old2, s1, s2, place, fx, fy) = _PUSHED * force.std, self._key
        near = abs(q1 - old1) < _MOVED and abs(q2 - old2) < _MOVED
        near = near and abs(force.x - fx) < pushed and abs(force.y - fy) < pushed
        if near and max(abs(load.s1 - s1), abs(load.s2 - s2), abs(force.place - place)) < _CROSSED:
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
        """Of x, y and yaw by the values of the model, (12 + k, 3), as `uncertainty.tip_derivative`."""
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
