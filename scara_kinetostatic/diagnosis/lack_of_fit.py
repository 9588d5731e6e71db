"""Lack of fit: F-tests of the residual against everything that it could depend on.

If the model is complete, the whitened misclosures of the used touches are white noise, projected off the columns of the
fit. An effect that the model lacks makes them depend smoothly on a joint angle, a torque, the force, the disc, the
place on it, the time. Each such family of functions is added to the linearised fit, and its contribution is tested by
an F-test, which is valid whether the noise was given or estimated.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from scara_kinetostatic.calibration.fit_point import Point, select, unfitted
from scara_kinetostatic.calibration.identifiability import NOISE_SHARE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.whitening import noise_left, whiten_by
from scara_kinetostatic.diagnosis.thresholds import FORCE_LEVELS, INDEPENDENT_PART_CAUTIOUS, ROUNDING
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.model.touch_equations import view_arm


class _Family(NamedTuple):
    """Functions of one quantity that the residual could depend on.

    Attributes:
        name: of the quantity.
        columns: the functions at each touch, (n, 2, m), whitened.
        noise: their change by one standard deviation of the noise in the forces, (n, 2, m); None for nothing.
    """

    name: str
    columns: Floats
    noise: Floats | None = None


class Dependence(NamedTuple):
    """The test of one family.

    Attributes:
        name: of the quantity on which the residual would depend.
        p_value: of "it does not".
        share: part of the residual's sum of squares that the family explains.
    """

    name: str
    p_value: float
    share: float


def _families(calibration: Calibration, point: Point) -> tuple[_Family, ...]:
    """All families at the used touches: smooth functions along and across the force, displaced discs, joints whose zero
    changes.
    """
    touches = calibration.touches.select(calibration.used)
    state = point.adjusted.state
    arm = view_arm(point.parameters, *state[:4], calibration.cell.gripper)
    f, phi = state.magnitude, state.direction
    q1, q2 = point.adjusted.joints.T
    link2 = q1 + q2 + point.parameters.theta1 + point.parameters.theta2
    larger = f + noise_left(point.linear, point.whitened.root, calibration.noise, 0)
    larger_by_noise = {
        'the torque of joint 1': _powers(f * arm.lever1, larger * arm.lever1),
        'the torque of joint 2': _powers(f * arm.lever2, larger * arm.lever2),
        'the size of the force': _powers(f, larger),
    }
    smooth = {
        'the angle of joint 1': _waves(q1, 2),
        'the angle of joint 2': _waves(q2, 2),
        'the torque of joint 1': _powers(f * arm.lever1),
        'the torque of joint 2': _powers(f * arm.lever2),
        'the size of the force': _powers(f),
        'the direction of the force': _waves(phi, 2),
        'the direction of the force relative to link 2': _waves(phi - link2, 2),
        'the touched disc': _indicators(touches.disc),
        'the elbow posture': touches.posture[:, None].astype(float),
        'the direction of approach': np.sign(touches.approach),
        'time': _powers(touches.time)[:, :2],
    }
    if np.std(f) < FORCE_LEVELS * calibration.noise.force_at(float(np.mean(f))):
        del smooth['the size of the force']  # its differences are noise
    one_side = [
        _Family(
            f'{name} ({side} the force)',
            _on_side(columns, k),
            _on_side(larger_by_noise[name] - columns, k) if name in larger_by_noise else None,
        )
        for name, columns in smooth.items()
        for k, side in enumerate(('along', 'across'))
    ]
    return (*one_side, *_displaced_discs(touches, phi, point), *_changed_joints(touches, point))


def _on_side(columns: Floats, side: int) -> Floats:
    out = np.zeros((len(columns), 2, columns.shape[1]))
    out[:, side] = columns
    return out


def _displaced_discs(touches: TouchSet, direction: Floats, point: Point) -> list[_Family]:
    """A disc displaced, or of another radius: h changes by the displacement along n and t, by the radius along n."""
    c, s, one, none = np.cos(direction), np.sin(direction), np.ones_like(direction), np.zeros_like(direction)
    shifts = np.stack([np.stack([c, s, one], axis=-1), np.stack([-s, c, none], axis=-1)], axis=1)
    return [
        _Family(
            f'place and size of disc number {disc}',
            whiten_by(shifts * (touches.disc == disc)[:, None, None], point.whitened.root),
        )
        for disc in np.unique(touches.disc)
    ]


def _changed_joints(touches: TouchSet, point: Point) -> list[_Family]:
    """The zero of a joint drifts with time, jumps at some time, or depends on the direction of approach."""
    order = np.argsort(np.argsort(touches.time, kind='stable'))
    parts = [np.where(order >= len(order) * part, 0.5, -0.5) for part in (0.25, 0.5, 0.75)]
    turns = whiten_by(point.linear.by_joints, point.whitened.root)
    drift = np.stack([_powers(touches.time)[:, 0], *parts], axis=-1)
    return [
        family
        for joint in (0, 1)
        for family in (
            _Family(f'time, through the zero of joint {joint + 1}', turns[:, :, joint, None] * drift[:, None, :]),
            _Family(
                f'the direction of approach, through joint {joint + 1}',
                turns[:, :, joint, None] * np.sign(touches.approach[:, joint])[:, None, None],
            ),
        )
    ]


def _waves(angle: Floats, most: int) -> Floats:
    return np.stack([wave(k * angle) for k in range(1, most + 1) for wave in (np.cos, np.sin)], axis=1)


def _powers(values: Floats, at: Floats | None = None) -> Floats:
    """Powers of values (n,) scaled to their range, (n, 3); or of the values `at`, scaled alike."""
    span = float(np.ptp(values)) or 1.0
    z = ((values if at is None else at) - values.mean()) / span
    return np.stack([z, z**2, z**3], axis=1)


def _indicators(labels: NDArray[np.intp]) -> Floats:
    return (labels[:, None] == np.unique(labels)).astype(float)


def find_dependences(calibration: Calibration) -> tuple[Dependence, ...]:
    """Test every family.

    Args:
        calibration: with or without effects.

    Returns:
        One test per family that is independent of the fitted parameters, the most significant first.
    """
    c = calibration
    point = select(c.projection, c.used)
    n = len(point.distance)
    uninformative = n if c.model.off_normal_std else 0
    marginal, unprojected = unfitted(point)
    jacobian = marginal.apply((point.whitened.derivative @ c.subspace.basis).reshape(2 * n, -1))
    base = np.linalg.qr(jacobian)[0]
    residual = unprojected - base @ (base.T @ unprojected)
    dependences = []
    for family in _families(c, point):
        noise = None if family.noise is None else family.noise.reshape(2 * n, -1)
        dependence = _test(residual, base, marginal.apply(family.columns.reshape(2 * n, -1)), noise, uninformative)
        if dependence is not None:
            dependences.append(Dependence(family.name, *dependence))
    return tuple(sorted(dependences, key=lambda dependence: dependence.p_value))


def _test(
    residual: Floats, base: Floats, columns: Floats, noise: Floats | None, uninformative: int
) -> tuple[float, float] | None:
    """p-value and share of the residual that further columns explain; None if they add nothing testable.

    Args:
        residual: (m,).
        base: orthonormal basis of the fit's columns, (m, r).
        columns: to be tested, (m, k).
        noise: their change by one standard deviation of the noise of the forces, (m, k); directions that consist
            mostly of that do not count.
        uninformative: how many rows of the residual are zero by construction.
    """
    scale = np.linalg.norm(columns, axis=0)
    visible = scale > 0
    columns = columns[:, visible] / scale[visible]
    left = columns - base @ (base.T @ columns)
    u, values, vt = np.linalg.svd(left, full_matrices=False)
    independent = values > INDEPENDENT_PART_CAUTIOUS
    if noise is not None:
        independent &= np.linalg.norm(noise[:, visible] / scale[visible] @ vt.T, axis=0) ** 2 <= NOISE_SHARE * values**2
    u = u[:, independent]
    q, freedoms = u.shape[1], len(residual) - uninformative - base.shape[1] - u.shape[1]
    total = float(residual @ residual)
    if q == 0 or freedoms < 1 or total < ROUNDING * len(residual):
        return None
    explained = float(((u.T @ residual) ** 2).sum())
    ratio = (explained / q) / (max(total - explained, 1e-300) / freedoms)
    return float(special.fdtrc(q, freedoms, ratio)), explained / total
