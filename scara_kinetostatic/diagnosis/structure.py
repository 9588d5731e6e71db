"""Is anything left in the residual? Tests of the residual against all it could depend on.

If the twelve-parameter model is enough, the whitened misclosures of the used touches
are white noise less what the fit took out. A physical effect that the model lacks
leaves a smooth trace in them: over a joint angle, the torque, the force, the
disc, the place on it, the time. Each such family of functions is added to the linearised fit;
what it explains beyond chance is an F-test, valid whether the noise was
given or estimated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.calibration.solver import Point
from scara_kinetostatic.model.statics import view_arm

Floats = NDArray[np.float64]


class Family(NamedTuple):
    """Functions of one thing the residual could depend on.

    Attributes:
        name: that thing, in words.
        columns: the functions at each touch, (n, m).
    """

    name: str
    columns: Floats


class Trace(NamedTuple):
    """What one family explains.

    Attributes:
        name: on what the residual would depend.
        p_value: of "it does not".
        share: part of the residual's sum of squares explained.
    """

    name: str
    p_value: float
    share: float


def families(calibration: Calibration, point: Point) -> tuple[Family, ...]:
    """What the residual could depend on, as functions at the used touches."""
    touches = calibration.touches.select(calibration.used)
    state = point.adjusted.state
    arm = view_arm(point.parameters, *state[:4], observe(touches, calibration.cell).gripper)
    f, phi = state.magnitude, state.direction
    q1, q2 = point.adjusted.joints.T
    link2 = q1 + q2 + point.parameters.theta1 + point.parameters.theta2
    return (
        Family('the angle of joint 1', _waves(q1, 2)),
        Family('the angle of joint 2', _waves(q2, 2)),
        Family('the torque of joint 1', _powers(f * arm.a1)),
        Family('the torque of joint 2', _powers(f * arm.a2)),
        Family('the size of the force', _powers(f)),
        Family('the direction of the force', _waves(phi, 2)),
        Family('the direction of the force seen from link 2', _waves(phi - link2, 2)),
        Family('the touched disc', _indicators(touches.disc)),
        Family('the elbow posture', touches.posture[:, None].astype(float)),
        Family('the sense of approach', np.sign(touches.approach)),
        Family('time', _powers(touches.time)[:, :2]),
    )


def _waves(angle: Floats, most: int) -> Floats:
    return np.stack([wave(k * angle) for k in range(1, most + 1) for wave in (np.cos, np.sin)], axis=1)


def _powers(values: Floats) -> Floats:
    spread = float(np.ptp(values)) or 1.0
    z = (values - values.mean()) / spread
    return np.stack([z, z**2, z**3], axis=1)


def _indicators(labels: NDArray[np.intp]) -> Floats:
    return (labels[:, None] == np.unique(labels)).astype(float)


def find_traces(calibration: Calibration) -> tuple[Trace, ...]:
    """Test every family, along and across the force.

    Returns:
        One trace per family and direction for which there are enough touches, the most significant first.
    """
    c = calibration
    point = project(observe(c.touches.select(c.used), c.cell), c.parameters, c.noise)
    n = len(point.distance)
    jacobian = (point.whitened.derivative @ c.subspace.basis).reshape(2 * n, -1)
    base = np.linalg.qr(jacobian)[0]
    residual = point.whitened.residual.ravel() - base @ (base.T @ point.whitened.residual.ravel())
    traces = []
    for family in families(c, point):
        for k, side in enumerate(('along', 'across')):
            columns = np.zeros((n, 2, family.columns.shape[1]))
            columns[:, k] = family.columns
            trace = _test(residual, base, columns.reshape(2 * n, -1))
            if trace is not None:
                traces.append(Trace(f'{family.name} ({side} the force)', *trace))
    return tuple(sorted(traces, key=lambda trace: trace.p_value))


def _test(residual: Floats, base: Floats, columns: Floats) -> tuple[float, float] | None:
    """p-value and share of the residual that further columns explain; None if they add nothing testable."""
    scale = np.linalg.norm(columns, axis=0)
    columns = columns[:, scale > 0] / scale[scale > 0]
    left = columns - base @ (base.T @ columns)
    u, values, _ = np.linalg.svd(left, full_matrices=False)
    u = u[:, values > 1e-3]
    q, freedoms = u.shape[1], len(residual) - base.shape[1] - u.shape[1]
    total = float(residual @ residual)
    if q == 0 or freedoms < 1 or total == 0:
        return None
    explained = float(((u.T @ residual) ** 2).sum())
    ratio = (explained / q) / (max(total - explained, 1e-300) / freedoms)
    return float(stats.f.sf(ratio, q, freedoms)), explained / total
