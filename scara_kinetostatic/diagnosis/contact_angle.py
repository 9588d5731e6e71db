"""Contact friction as a random off-normal angle α of each force: score test, and estimate of its standard deviation.

A random angle shifts no mean. It adds the variance σ_α² h_α h_αᵀ to that of the noise, which grows with the disc's
radius, whereas that by noise of the force decreases with its size. The test is a score test of this variance
component beside those of the noise (Rao; for variance components see Searle, Casella and McCulloch, 1992, section 6.8);
σ_α is estimated by expectation and maximisation, σ_α² ← mean of α̂² plus its own variance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.calibration.whitening import whiten_by
from scara_kinetostatic.diagnosis.effort import Effort
from scara_kinetostatic.diagnosis.refit import fitted_effects, with_rejections_of
from scara_kinetostatic.diagnosis.variance_components import FORCE, GROWING, JOINT, OFF_NORMAL, excess_p_value
from scara_kinetostatic.effects.off_normal_force import OffNormalForce

_UNCONSTRAINED_STD = 10.0
"""A standard deviation of α that leaves it free, rad."""
_FIRST_STD = 0.03
"""Where the estimation of σ_α begins, rad."""
_LEAST_STD = 1e-4
"""Lower limit of σ_α, rad: no sensor resolves less."""
_ROUNDS = 8
_MANY_STEPS = 150
"""Steps of a fit beyond which it hardly converges: something else is wrong."""
_MOST_SLOW = 2
"""Such fits after which the estimation ends where it is."""
_CONVERGED = 0.02
"""Relative change of σ_α at which the estimation ends."""


def off_normal_p_value(calibration: Calibration, beside_growing: bool = False) -> float:
    """P-value of "the off-normal angles are noise", one-sided.

    It does not depend on the size of the stated noise: the residuals are scaled to unit variance.

    Args:
        calibration: with or without effects, none of them with an off-normal angle.
        beside_growing: whether the noise of the force may grow with it, which acts along the force as well as across.
    """
    beside = (JOINT, FORCE, GROWING) if beside_growing else (JOINT, FORCE)
    return excess_p_value(calibration, OFF_NORMAL, beside)


def growing_p_value(calibration: Calibration) -> float:
    """P-value of "the noise of the force is the same at all forces", one-sided against noise that grows with it."""
    return excess_p_value(calibration, GROWING, (JOINT, FORCE, OFF_NORMAL))


def fit_with_off_normal(calibration: Calibration, effort: Effort) -> Calibration:
    """The touches of a calibration fitted with a random off-normal angle of each force, σ_α estimated.

    Effects that the calibration has stay.
    """
    c = calibration
    others = tuple(effect for effect in c.model.effects if not effect.off_normal_std)
    off_normal, used, latest, slow = _FIRST_STD, np.ones(len(c.touches), dtype=bool), c, 0
    for _ in range(_ROUNDS):
        effects = (OffNormalForce(off_normal=off_normal), *others)
        warm_start = WarmStart(latest.model.with_effects(effects), latest.noise, used, latest.errors)
        latest = effort.fit(c.touches, c.cell, effects, fixed=c.fixed, warm_start=warm_start)
        used, before = latest.used, off_normal
        off_normal = max(_updated(latest, off_normal), _LEAST_STD)
        slow += latest.termination is not Termination.CONVERGED or latest.iterations > _MANY_STEPS
        if abs(off_normal / before - 1) < _CONVERGED or slow >= _MOST_SLOW:
            break
    return with_rejections_of(latest, c)


def with_free_off_normal_angles(calibration: Calibration) -> Calibration:
    """The same with unconstrained off-normal angles, where it has them: its residual is then free of them.

    Off-normal angles may depend on anything; a test for a lack of fit is to use the other half of the residual.
    """
    effects = tuple(
        effect.with_off_normal_std(_UNCONSTRAINED_STD) if effect.off_normal_std else effect
        for effect, _, _ in fitted_effects(calibration)
    )
    return replace(calibration, model=replace(calibration.model, effects=effects))


def _updated(c: Calibration, off_normal: float) -> float:
    """One step of expectation and maximisation."""
    point = project(observe(c.touches.select(c.used), c.cell, c.errors), c.model, c.noise)
    assert point.linear.by_off_normal is not None
    assert point.adjusted.off_normal is not None
    shrunk = whiten_by(point.linear.by_off_normal, point.whitened.root)
    left = off_normal**2 * (1 - (shrunk**2).sum(axis=1))
    return float(np.sqrt(np.mean(point.adjusted.off_normal**2 + left)))
