"""H̄ of one pose after the other, as they come at 1 kHz: the equations of `loading` and `uncertainty` with plain floats.

For one pose, arrays take ten times as long as the arithmetic. What effects add is worked out with arrays all the same.

**Hysteresis.** In a dead band, of a joint without load say, the noise of the force would move the tip to and fro. So
the places in the dead bands follow a force that gives way to the measured one only where they differ by more than
`WIDTH` standard deviations; all else follows the measured force at once.
"""

from __future__ import annotations

from dataclasses import replace
from math import hypot, isfinite, nan, sin
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.compensation.loading import SIGN_KNOWN, Force, Loading, faded
from scara_kinetostatic.compensation.online_covariance import OnlineCovariance
from scara_kinetostatic.compensation.online_pose import HeldForce, InverseRows, PoseLoad, inverse_rows, load_at, turned
from scara_kinetostatic.compensation.predictions import Predictor
from scara_kinetostatic.compensation.sensor import force_on_object
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.effect_law import TouchMetadata, TouchState
from scara_kinetostatic.model.noise import Noise
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.sensor_error import has_sensor_error

WIDTH = 2.0
"""Of the hysteresis, standard deviations of a component of the force."""
_PASSES = 30
_NEAR = 1e-7
"""A step of Newton's method after which the angles are right to its square, rad."""
_SETTLED = 1e-6
"""Change of what effects add after which one more solution is enough, rad and m; it depends on itself weakly."""


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
                if change < _SETTLED:
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
            if abs(step1) + abs(step2) < _NEAR:
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
