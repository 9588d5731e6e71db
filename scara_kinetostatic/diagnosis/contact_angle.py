"""Does the force lean from the normal, in every touch by an angle of its own? Friction as it is.

Such a lean moves no mean: it adds a variance σ_α² h_α h_αᵀ to that of the noise, which grows with the disc's
radius where noise of the force falls with its size. Whether it is there is a score test of that variance
component beside those of the noise (Rao; for variance components see Searle, Casella and McCulloch, 1992, section 6.8);
its size follows by expectation and maximisation, σ_α² ← mean of α̂² plus its own variance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.gauss_helmert import Observations
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Point
from scara_kinetostatic.calibration.variance import whiten_matrix
from scara_kinetostatic.calibration.whitening import outer, whiten_by
from scara_kinetostatic.diagnosis.linear_problem import orthonormal
from scara_kinetostatic.diagnosis.refit import with_left_out
from scara_kinetostatic.effects.off_normal_force import OffNormalForce
from scara_kinetostatic.model.cell import Noise

Floats = NDArray[np.float64]

FREE = 10.0
"""A standard deviation of the lean that leaves it free, rad."""
FIRST_STD = 0.03
TYPICAL_STD = 0.01
LEAST_STD = 1e-4
TINY = 1e-12
"""Mean square of a residual that is rounding error."""
ROUNDS = 8
SETTLED = 0.02
"""Relative change of the lean at which it has settled."""


def off_normal_p_value(calibration: Calibration, beside_growing: bool = False) -> float:
    """P-value of "no force leans beyond its noise", one-sided.

    Noise that is stated too small is none of its business: the residuals are taken to have the size that they have.

    Args:
        calibration: with or without effects, none of them a lean.
        beside_growing: whether the noise of the force may grow with it; that shows along the force as well as across.
    """
    return _excess(calibration, 'off_normal', ('joint', 'force', 'growing') if beside_growing else ('joint', 'force'))


def growing_p_value(calibration: Calibration) -> float:
    """P-value of "the noise of the force is the same at all forces", one-sided against noise that grows with it."""
    return _excess(calibration, 'growing', ('joint', 'force', 'off_normal'))


def _excess(calibration: Calibration, kind: str, beside: tuple[str, ...]) -> float:
    """P-value of "there is no variance of this kind", beside those of other kinds of any size."""
    c = calibration
    observations = observe(c.touches.select(c.used), c.cell)
    point = project(observations, c.model, c.noise)
    jacobian = (point.whitened.derivative @ c.subspace.basis).reshape(2 * len(point.distance), -1)
    base = orthonormal(jacobian)
    residual = point.whitened.residual.ravel()
    left = residual - base @ (base.T @ residual)
    size = max(float(left @ left) / max(len(left) - base.shape[1], 1), TINY)
    kinds = [_kind(name, observations, point, c.noise) for name in (*beside, kind)]
    rows = base.reshape(-1, 2, base.shape[1])
    kept = np.eye(2) - np.einsum('nik,njk->nij', rows, rows)
    e = (left / np.sqrt(size)).reshape(-1, 2)
    score = np.array([np.einsum('ni,nij,nj->', e, part, e) - np.einsum('nij,nji->', part, kept) for part in kinds])
    half = [np.einsum('nij,njk->nik', part, kept) for part in kinds]
    information = 2 * np.array([[np.einsum('nij,nji->', first, second) for second in half] for first in half])
    weights = np.linalg.lstsq(information[:-1, :-1], information[:-1, -1], rcond=1e-9)[0]
    value, variance = score[-1] - weights @ score[:-1], information[-1, -1] - weights @ information[:-1, -1]
    return float(special.ndtr(-value / np.sqrt(variance))) if variance > 0 else 1.0


def _kind(name: str, observations: Observations, point: Point, noise: Noise) -> Floats:
    """One kind of variance of each touch, whitened, (n, 2, 2)."""
    if name == 'off_normal':
        by_off_normal = np.zeros((len(observations.radii), 2, 1))
        by_off_normal[:, 1, 0] = TYPICAL_STD * observations.radii
        return whiten_matrix(outer(by_off_normal), point.whitened.root)
    by = noise.joint * point.linear.by_joints if name == 'joint' else noise.force * point.linear.by_force
    if name == 'growing':
        magnitude = point.adjusted.state.magnitude
        by = by * (magnitude / magnitude.mean())[:, None, None]
    return whiten_matrix(outer(by), point.whitened.root)


def fit_with_off_normal(calibration: Calibration) -> Calibration:
    """The touches of a calibration fitted with a lean of every force, its size estimated.

    Effects that the calibration has stay.
    """
    c = calibration
    others = tuple(effect for effect in c.model.effects if not isinstance(effect, OffNormalForce))
    off_normal, used, latest = FIRST_STD, np.ones(len(c.touches), dtype=bool), c
    for _ in range(ROUNDS):
        effects = (OffNormalForce(off_normal=off_normal), *others)
        warm_start = WarmStart(latest.model.with_effects(effects), latest.noise, used)
        latest = calibrate(c.touches, c.cell, effects, fixed=c.fixed, warm_start=warm_start)
        used, before = latest.used, off_normal
        off_normal = max(_updated(latest, off_normal), LEAST_STD)
        if abs(off_normal / before - 1) < SETTLED:
            break
    return with_left_out(latest, c)


def without_direction(calibration: Calibration) -> Calibration:
    """A calibration with leaning forces as its residual is to be tested: the lean of each touch free.

    What the leans depend on is friction's own affair; only the other half of the residual is to be clean.
    """
    effects = tuple(
        replace(effect, off_normal=FREE) if isinstance(effect, OffNormalForce) else effect
        for effect in calibration.model.effects
    )
    return replace(calibration, model=replace(calibration.model, effects=effects))


def _updated(c: Calibration, off_normal: float) -> float:
    """One step of expectation and maximisation."""
    point = project(observe(c.touches.select(c.used), c.cell), c.model, c.noise)
    assert point.linear.by_off_normal is not None
    assert point.adjusted.off_normal is not None
    shrunk = whiten_by(point.linear.by_off_normal, point.whitened.root)
    left = off_normal**2 * (1 - (shrunk**2).sum(axis=1))
    return float(np.sqrt(np.mean(point.adjusted.off_normal**2 + left)))
