"""Score tests for further variances of the residual, beside those of the joint angles and of the force.

The scatter of the residual of a fit is compared with what V of `calibration.noise_estimation` says: if the noise of a
touch has a further component, the squares of the whitened residuals are larger where that component acts. Each
kind is tested by the score of its variance at zero, with those of the other kinds of any size, so that the p-value does
not depend on the size of the stated noise.

Source: Rao, Large sample tests of statistical hypotheses, Proc. Camb. Phil. Soc. 44 (1948) 50; for variance components,
Verbeke and Molenberghs, Biometrics 59 (2003) 254.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.fit_point import Point, augmented, select
from scara_kinetostatic.calibration.noise_estimation import by_axis, growing, whiten_matrix
from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.whitening import outer
from scara_kinetostatic.diagnosis.linear_problem import orthonormal
from scara_kinetostatic.model.arrays import Floats

JOINT, FORCE, GROWING, OFF_NORMAL = 'joint', 'force', 'growing', 'off_normal'
JOINT_AXES, FORCE_AXES = 'joint_axes', 'force_axes'
"""Kinds of variance; the last two are differences between the axes, of either sign."""
_TYPICAL_ANGLE = 0.01
"""Scale of the variance of off-normal angles, rad; the p-value does not depend on it."""
_LEAST_VARIANCE = 1e-12
"""Lower limit of the residual variance by which the scores are scaled; keeps exact data solvable."""


def excess_p_value(calibration: Calibration, kind: str, beside: Sequence[str] = (JOINT, FORCE)) -> float:
    """P-value of "there is no variance of this kind", with those of other kinds of any size.

    One-sided; two-sided for a difference between axes.

    Args:
        calibration: with or without effects.
        kind: the variance tested.
        beside: the others.
    """
    score = _score(calibration, kind, beside)
    return float(2 * special.ndtr(-abs(score))) if kind in (JOINT_AXES, FORCE_AXES) else float(special.ndtr(-score))


def _score(c: Calibration, kind: str, beside: Sequence[str]) -> float:
    """The score of one variance in its standard deviations, less what the others explain of it; 0 if they are alike."""
    observations = observe(c.touches.select(c.used), c.cell, c.errors)
    point = select(c.projection, c.used)
    jacobian = (point.whitened.derivative @ c.subspace.basis).reshape(2 * len(point.distance), -1)
    base = orthonormal(augmented(point, jacobian)[: len(jacobian)])  # whatever the declared errors are
    residual = point.whitened.residual.ravel()
    left = residual - base @ (base.T @ residual)
    size = max(float(left @ left) / max(len(left) - base.shape[1], 1), _LEAST_VARIANCE)
    kinds = [_variance(name, c, observations, point) for name in (*beside, kind)]
    rows = base.reshape(-1, 2, base.shape[1])
    kept = np.eye(2) - np.einsum('nik,njk->nij', rows, rows)
    e = (left / np.sqrt(size)).reshape(-1, 2)
    score = np.array([np.einsum('ni,nij,nj->', e, part, e) - np.einsum('nij,nji->', part, kept) for part in kinds])
    half = [np.einsum('nij,njk->nik', part, kept) for part in kinds]
    information = 2 * np.array([[np.einsum('nij,nji->', first, second) for second in half] for first in half])
    weights = np.linalg.lstsq(information[:-1, :-1], information[:-1, -1], rcond=1e-9)[0]
    value, variance = score[-1] - weights @ score[:-1], information[-1, -1] - weights @ information[:-1, -1]
    return float(value / np.sqrt(variance)) if variance > 0 else 0.0


def _variance(name: str, c: Calibration, observations: Observations, point: Point) -> Floats:
    """One kind of variance of each touch, whitened, of about unit size, (n, 2, 2)."""
    linear, noise = point.linear, c.noise
    if name == OFF_NORMAL:
        by_off_normal = np.zeros((len(observations.radii), 2, 1))
        by_off_normal[:, 1, 0] = _TYPICAL_ANGLE * observations.radii
        entries = outer(by_off_normal)
    elif name == GROWING:
        square = float((linear.force**2).sum(axis=1).mean())
        entries = noise.force_rms**2 / square * growing(linear)
    elif name in (JOINT, JOINT_AXES):
        first, second = by_axis(linear, JOINT)
        entries = noise.joint_rms**2 * (first + second if name == JOINT else first - second)
    else:
        first, second = by_axis(linear, FORCE)
        entries = noise.force_rms**2 * (first + second if name == FORCE else first - second)
    return whiten_matrix(entries, point.whitened.root)
