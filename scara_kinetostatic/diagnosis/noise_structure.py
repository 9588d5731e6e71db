"""Noise that grows with the force: found where the touches ask for it.

Where the cell description does not state a part that grows, it is estimated only where the scatter of the touches
shows it:

- where the diagnosis finds nothing missing, or what is missing, by a score test (`growing_p_value`) at the last
  fit, at a false alarm rate well below 1 %, confirmed by the deviance of the fit with it;
- where the residuals are larger than stated, or unlike noise, by the deviance alone: then noise that grows competes
  with contact friction and with a lack of fit.

In both cases the touches are diagnosed anew with the noise found, and the likelier of the two diagnoses is kept. A
model error is no noise: it depends on something, so the F-tests find it whatever the weights are.

Fits may differ in the touches that they reject. So a rejected touch has a penalty, the squared distance d² beyond which
touches are rejected. Over all touches,

    D = Σ_used d² / s² + Σ_declared e² / s² + Σ_rejected d²_rejection + Σ ln det V,

and the smaller D is the likelier model.

**Contact friction** is a random off-normal angle α of each force: a score test, and an estimate of its standard
deviation. A random angle shifts no mean. It adds the variance σ_α² h_α h_αᵀ to that of the noise, which grows with the
disc's radius, whereas that by noise of the force decreases with its size. The test is a score test of this variance
component beside those of the noise (Rao; for variance components see Searle, Casella and McCulloch, 1992, section
6.8); σ_α is estimated along with the noise (`calibration.noise_estimation`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import FALSE_REJECTIONS, WarmStart, find_good, noise_of_residuals
from scara_kinetostatic.calibration.fit_point import last_step
from scara_kinetostatic.calibration.noise_estimation import estimated_levels
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import ActivePrior
from scara_kinetostatic.diagnosis.lack_of_fit import FORCE, JOINT, OFF_NORMAL, find_dependences, growing_p_value
from scara_kinetostatic.diagnosis.linear_problem import CREDIBLE, STRICT_SIGNIFICANCE
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.gaussian import least_squares
from scara_kinetostatic.model.cell import Cell, Noise

PENALTY = 6.0
"""Decrease of the deviance that noise that grows must bring where the residuals are larger than noise."""


def noise_candidate(calibration: Calibration, found: Diagnosis) -> Calibration | None:
    """The base model refitted with noise that grows with the force, where the touches ask for it.

    Args:
        calibration: the base model.
        found: its diagnosis: the noise is looked for at the extended model, or else at the base model.
    """
    c, extended = calibration, found.extended
    # with fewer degrees of freedom the scatter does not show what it depends on
    if c.noise.force_relative is not None or c.degrees_of_freedom < 30:
        return None
    is_friction = extended is not None and bool(extended.model.off_normal_std)
    suspicious = found.verdict == 'unexplained' or is_friction
    plain = None if extended is None or is_friction else fit_again(extended)
    fits = [c] if plain is None else [plain, c] if suspicious else [plain]
    noises = (_noise_of(fit, suspicious) for fit in fits)
    noise = next((noise for noise in noises if noise is not None), None)
    return None if noise is None else fit_again(c, noise=noise)


def _noise_of(c: Calibration, suspicious: bool) -> Noise | None:
    """The noise of a fit with a part that grows with the force, if its residuals ask for it."""
    beside = (JOINT, FORCE, OFF_NORMAL) if c.model.off_normal_std else (JOINT, FORCE)
    # where the residuals are larger than noise, a hint is enough, or that they depend on nothing: the levels are then
    # as stated, and the score test, which leaves them free, sees little
    asked = growing_p_value(c, beside) < (0.03 if suspicious else STRICT_SIGNIFICANCE)
    asked = asked or (suspicious and c.cell.noise is not None and not _depends_on_something(c))
    if not asked:
        return None
    noise, least = _at_levels(c, c.noise._replace(force_relative=0.01), c.cell)
    # noise that grows by more than 5 % of the force is a model error
    if _at_levels(c, c.noise, c.cell)[1] - least < (PENALTY if suspicious else CREDIBLE) or noise.growth > 0.05:
        return None
    if c.cell.noise is not None:  # stated levels that are all too small may explain the touches clearly better
        free = _at_levels(c, c.noise._replace(force_relative=None), replace(c.cell, noise=None))[1]
        if free < least - CREDIBLE:
            return None
    return None if suspicious and _depends_on_something(c.changed(noise=noise)) else noise


def _at_levels(c: Calibration, noise: Noise, cell: Cell) -> tuple[Noise, float]:
    """The noise by the residuals and D above, in the linear problem at a fit.

    Args:
        c: the fit.
        noise: to begin with; it has the components wanted.
        cell: which levels are stated.
    """
    observations, used = c.observe(), c.used
    basis, prior = c.subspace.with_errors(len(observations.errors)), ActivePrior.of(observations, c.subspace)
    for _ in range(20):
        point = c.projection.with_noise(noise)
        known = None if prior is None else prior.system(point)
        w = point.whitened
        system = least_squares.compress(w.jacobian, w.residual, used.astype(float), basis, known)
        point, before = last_step(point, basis @ least_squares.damped_step(system, 0.0)), noise
        used = find_good(point.distance)
        if estimated_levels(noise, cell.noise):
            noise, _ = noise_of_residuals(observations, point, used, c.subspace, noise, cell)
        if all(abs(a - b) <= 0.01 * b for a, b in zip(noise.levels, before.levels, strict=True)):
            break
    l11, _, l22 = point.whitened.root
    distance = np.where(used, point.distance, -2 * np.log(FALSE_REJECTIONS / len(used)))
    return noise, float(np.sum(distance + 2 * np.log(l11 * l22))) + (0.0 if prior is None else prior.cost(point))


def _depends_on_something(c: Calibration) -> bool:
    """Whether the residual of a fit, weighted by its noise, shows a model error."""
    dependences = find_dependences(c)
    return bool(dependences) and dependences[0].p_value * len(dependences) < STRICT_SIGNIFICANCE


def fit_again(c: Calibration, *, noise: Noise | None = None, cell: Cell | None = None) -> Calibration | None:
    """A calibration fitted anew, close to where it is; None where the touches have no such fit. The touches that were
    rejected before any fit stay so.

    Args:
        c: the calibration.
        noise: to start from; that of the calibration by default.
        cell: another description of the cell; likewise.
    """
    warm_start = WarmStart(c.model, noise or c.noise, c.used, c.errors)
    try:
        fit = calibrate(c.touches, cell or c.cell, c.model.effects, fixed=c.fixed, warm_start=warm_start)
    except UnsupportedDataError:
        return None
    if not np.isfinite(fit.projection.distance[fit.used]).all():
        return None  # free, rivals may go off to where the model is not defined
    places = set(c.touches.index.tolist())
    left_out = [item for item in c.rejected if item.index not in places]
    return fit.changed(rejected=tuple(sorted((*left_out, *fit.rejected), key=lambda item: item.index)))
