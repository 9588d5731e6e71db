"""Noise that grows with the force: found where the touches ask for it.

Where the cell description does not state a part that grows, it is estimated only where the scatter of the touches
shows it:

- where the diagnosis finds nothing missing, or what is missing, by a score test (`growing_p_value`) at the last
  fit, at a false alarm rate well below 1 %, confirmed by the deviance of the fit with it;
- where the residuals are larger than stated, or unlike noise, by the deviance alone: then noise that grows competes
  with contact friction and with a lack of fit.

In both cases the touches are diagnosed anew with the noise found, and the likelier of the two diagnoses is kept. A
model error is no noise: it depends on something, so the F-tests find it whatever the weights are.

**Contact friction** is a random off-normal angle α of each force: a score test, and an estimate of its standard
deviation. A random angle shifts no mean. It adds the variance σ_α² h_α h_αᵀ to that of the noise, which grows with the
disc's radius, whereas that by noise of the force decreases with its size. The test is a score test of this variance
component beside those of the noise (Rao; for variance components see Searle, Casella and McCulloch, 1992, section
6.8); σ_α is estimated by expectation and maximisation, σ_α² ← mean of α̂² plus its own variance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.gauss_helmert import whiten_by
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.lack_of_fit import FORCE, JOINT, OFF_NORMAL, find_dependences, growing_p_value
from scara_kinetostatic.diagnosis.linear_problem import CREDIBLE, STRICT_SIGNIFICANCE
from scara_kinetostatic.diagnosis.refit import Effort, fit_again, penalised_deviance, with_rejections_of
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.contact_friction import OffNormalForce
from scara_kinetostatic.model.cell import Noise

_PENALTY = 6.0
"""Decrease of the deviance that noise that grows must bring where the residuals are larger than noise."""


def noise_candidate(calibration: Calibration, found: Diagnosis, effort: Effort) -> Calibration | None:
    """The base model refitted with noise that grows with the force, where the touches ask for it.

    Args:
        calibration: the base model.
        found: its diagnosis: the noise is looked for at the extended model, or else at the base model.
        effort: of the diagnosis.
    """
    c, extended = calibration, found.extended
    # with fewer degrees of freedom the scatter does not show what it depends on
    if c.noise.force_relative is not None or c.degrees_of_freedom < 30:
        return None
    is_friction = extended is not None and bool(extended.model.off_normal_std)
    suspicious = found.verdict == 'unexplained' or is_friction
    fits = [c] if extended is None or is_friction else [extended, c] if suspicious else [extended]
    noises = (_noise_of(fit, suspicious, effort) for fit in fits)
    noise = next((noise for noise in noises if noise is not None), None)
    return None if noise is None else _refitted(c, noise, effort)


def likelier(one: Diagnosis, before: Calibration, other: Diagnosis, refitted: Calibration) -> Diagnosis:
    """The likelier of two diagnoses of the same touches.

    Args:
        one: with the noise as stated or estimated.
        before: its base model.
        other: with noise that grows.
        refitted: its base model.
    """
    if other.verdict == 'unexplained' and one.verdict != 'unexplained':
        return one
    gain = _deviance(one, before) - _deviance(other, refitted)
    return replace(other, refitted=refitted) if gain > _PENALTY else one


def _deviance(found: Diagnosis, base: Calibration) -> float:
    """The penalised deviance of the final model: ln n per parameter of an effect, and that of a choice for each."""
    final = found.extended or base
    choices = 2 * np.log(max(len(found.ranking), 1))
    parameters = sum(max(len(effect.parameters), 1) for effect in final.model.effects)
    penalty = parameters * np.log(len(final.touches)) + choices * len(final.model.effects)
    return penalised_deviance(final, float(penalty), 1.0)


def _noise_of(c: Calibration, suspicious: bool, effort: Effort) -> Noise | None:
    """The noise of a fit with a part that grows with the force, if its residuals ask for it."""
    beside = (JOINT, FORCE, OFF_NORMAL) if c.model.off_normal_std else (JOINT, FORCE)
    # where the residuals are larger than noise, a hint is enough, or that they depend on nothing: the levels are then
    # as stated, and the score test, which leaves them free, sees little
    asked = growing_p_value(c, beside) < (0.03 if suspicious else STRICT_SIGNIFICANCE)
    asked = asked or (suspicious and c.cell.noise is not None and not _depends_on_something(c))
    grown = _refitted(c, c.noise._replace(force_relative=0.01), effort) if asked and effort.allows() else None
    if grown is None:
        return None
    least = penalised_deviance(grown, 0.0, 1.0)
    gain = penalised_deviance(c, 0.0, 1.0) - least
    # noise that grows by more than 5 % of the force is a model error
    if gain < (_PENALTY if suspicious else CREDIBLE) or grown.noise.growth > 0.05 or _is_understated(c, least, effort):
        return None
    return None if suspicious and _depends_on_something(grown) else grown.noise


def _depends_on_something(c: Calibration) -> bool:
    """Whether the residual of a fit, weighted by its noise, shows a model error."""
    dependences = find_dependences(c)
    return bool(dependences) and dependences[0].p_value * len(dependences) < STRICT_SIGNIFICANCE


def _is_understated(c: Calibration, deviance: float, effort: Effort) -> bool:
    """Whether stated levels that are all too small explain the touches clearly better than further components do."""
    if c.cell.noise is None:
        return False
    free = _refitted(replace(c, cell=replace(c.cell, noise=None)), c.noise._replace(force_relative=None), effort)
    return free is not None and penalised_deviance(free, 0.0, 1.0) < deviance - CREDIBLE


def _refitted(c: Calibration, noise: Noise, effort: Effort) -> Calibration | None:
    """The model of a calibration fitted with the components of a noise; None where it has no fit."""
    found = fit_again(c, effort.fit, noise=noise, start=c.start)
    return None if found is None else with_rejections_of(found, c)


def fit_with_off_normal(calibration: Calibration, effort: Effort) -> Calibration:
    """The touches of a calibration fitted with a random off-normal angle of each force, σ_α estimated.

    Effects that the calibration has stay.
    """
    c = calibration
    others = tuple(effect for effect in c.model.effects if not effect.off_normal_std)
    off_normal, used, latest, slow = 0.03, np.ones(len(c.touches), dtype=bool), c, 0
    for _ in range(8):
        effects = (OffNormalForce(off_normal=off_normal), *others)
        warm_start = WarmStart(latest.model.with_effects(effects), latest.noise, used, latest.errors)
        latest = effort.fit(c.touches, c.cell, effects, fixed=c.fixed, warm_start=warm_start)
        used, before = latest.used, off_normal
        # no sensor resolves less than 1e-4 rad
        off_normal = max(_updated(latest, off_normal), 1e-4)
        # a fit of more than 150 steps hardly converges: something else is wrong
        slow += latest.termination is not Termination.CONVERGED or latest.iterations > 150
        if abs(off_normal / before - 1) < 0.02 or slow >= 2:
            break
    return with_rejections_of(latest, c)


def _updated(c: Calibration, off_normal: float) -> float:
    """One step of expectation and maximisation."""
    point = project(observe(c.touches.select(c.used), c.cell, c.errors), c.model, c.noise)
    assert point.linear.by_off_normal is not None
    assert point.adjusted.off_normal is not None
    shrunk = whiten_by(point.linear.by_off_normal, point.whitened.root)
    left = off_normal**2 * (1 - (shrunk**2).sum(axis=1))
    return float(np.sqrt(np.mean(point.adjusted.off_normal**2 + left)))
