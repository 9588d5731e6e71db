"""Noise that is not the same for both axes or at all forces: found where the touches ask for it.

The cell description states levels, or nothing. What it leaves open (a part that grows with the force; different levels
of two axes where it states one, which is then their root mean square) is estimated only where the scatter of the
touches shows it:

- where the diagnosis finds nothing missing, or what is missing, by a score test (`excess_p_value`) at the last
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
from scara_kinetostatic.diagnosis.lack_of_fit import (
    FORCE,
    FORCE_AXES,
    GROWING,
    JOINT,
    JOINT_AXES,
    OFF_NORMAL,
    excess_p_value,
    find_dependences,
)
from scara_kinetostatic.diagnosis.linear_problem import CREDIBLE, STRICT_SIGNIFICANCE
from scara_kinetostatic.diagnosis.refit import Effort, fit_again, penalised_deviance, with_rejections_of
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.contact_friction import OffNormalForce
from scara_kinetostatic.model.cell import Noise

_PENALTY = 6.0
"""Decrease of the deviance that a component of the noise must bring where the residuals are larger than noise."""


def noise_candidate(calibration: Calibration, found: Diagnosis, effort: Effort) -> Calibration | None:
    """The base model refitted with the noise that the touches ask for, at the extended model or else at the base model.

    Args:
        calibration: the base model.
        found: its diagnosis; where it leaves nothing to ask for, there is no candidate.
        effort: of the diagnosis.
    """
    c, extended = calibration, found.extended
    # with fewer the scatter does not show what it depends on
    if not _open_kinds(c) or c.degrees_of_freedom < 30:
        return None
    is_friction = extended is not None and bool(extended.model.off_normal_std)
    suspicious = found.verdict == 'unexplained' or is_friction
    fits = [c] if extended is None or is_friction else [extended, c] if suspicious else [extended]
    for fit in fits:
        noise = _noise_of(fit, suspicious, effort)
        if noise is not None:
            return _refitted(c, noise, effort)
    return None


def likelier(one: Diagnosis, before: Calibration, other: Diagnosis, refitted: Calibration) -> Diagnosis:
    """The likelier of two diagnoses of the same touches.

    Args:
        one: with the noise as stated or of two levels.
        before: its base model.
        other: with further components of the noise.
        refitted: its base model.
    """
    if other.verdict == 'unexplained' and one.verdict != 'unexplained':
        return one
    components = sum(kind not in _open_kinds(refitted) for kind in _open_kinds(before))
    gain = _deviance(one, before) - _deviance(other, refitted) - _PENALTY * components
    return replace(other, refitted=refitted) if gain > 0 else one


def _deviance(found: Diagnosis, base: Calibration) -> float:
    """The penalised deviance of the final model: ln n per parameter of an effect, and that of a choice for each."""
    final = found.extended or base
    choices = 2 * np.log(max(len(found.ranking), 1))
    parameters = sum(max(len(effect.parameters), 1) for effect in final.model.effects)
    penalty = parameters * np.log(len(final.touches)) + choices * len(final.model.effects)
    return penalised_deviance(final, float(penalty), 1.0)


def _open_kinds(c: Calibration) -> list[str]:
    """The components that neither the cell description states nor the fit has."""
    stated, kinds = c.cell.noise, []
    if c.noise.force_relative is None:
        kinds.append(GROWING)
    for kind, level, given in (
        (JOINT_AXES, c.noise.joint, stated and stated.joint),
        (FORCE_AXES, c.noise.force, stated and stated.force),
    ):
        if not isinstance(level, tuple) and not isinstance(given, tuple):
            kinds.append(kind)
    return kinds


def _noise_of(c: Calibration, suspicious: bool, effort: Effort) -> Noise | None:
    """The noise of a fit with the components that its residuals ask for, one after the other; None where none is."""
    if not _is_asked_for(c, suspicious):
        return None
    needed = _PENALTY if suspicious else CREDIBLE
    best, least, kinds = c, penalised_deviance(c, 0.0, 1.0), _open_kinds(c)
    while kinds and effort.allows():
        tried = {kind: _refitted(best, _with_component(best.noise, kind), effort) for kind in kinds if effort.allows()}
        fits = {kind: fit for kind, fit in tried.items() if fit is not None}
        gains = {kind: least - penalised_deviance(fit, 0.0, 1.0) for kind, fit in fits.items()}
        chosen = max(gains, key=lambda kind: gains[kind], default='')
        if not chosen or gains[chosen] < needed:
            break
        best, least = fits[chosen], least - gains[chosen]
        kinds = [kind for kind, gain in gains.items() if kind != chosen and gain > needed / 2]
    # noise that grows by more than 5 % of the force is a model error
    if best is c or best.noise.growth > 0.05 or _is_understated(c, least, effort):
        return None
    if suspicious and _depends_on_something(best):
        return None
    return best.noise


def _is_asked_for(c: Calibration, suspicious: bool) -> bool:
    """Whether the scatter asks for a component: by the score test, or since it is larger than stated and depends on
    nothing; then the levels are as stated, and the score test, which leaves them free, sees little.
    """
    if not suspicious:
        return _is_significant(c, STRICT_SIGNIFICANCE)
    # where the residuals are larger than noise, a hint is enough
    return _is_significant(c, 0.1) or (c.cell.noise is not None and not _depends_on_something(c))


def _is_significant(c: Calibration, level: float) -> bool:
    """Whether a score test asks for a component at a level of significance, with the others of any size."""
    kinds = _open_kinds(c)
    beside = (JOINT, FORCE, OFF_NORMAL) if c.model.off_normal_std else (JOINT, FORCE)
    return any(excess_p_value(c, kind, beside) * len(kinds) < level for kind in kinds)


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


def _with_component(noise: Noise, kind: str) -> Noise:
    """A noise with one component more, to begin with."""
    if kind == GROWING:
        return noise._replace(force_relative=0.01)
    if kind == JOINT_AXES:
        return noise._replace(joint=noise.joint_levels)
    return noise._replace(force=noise.force_levels)


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
