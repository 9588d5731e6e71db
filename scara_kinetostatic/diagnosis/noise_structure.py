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
from scara_kinetostatic.calibration.estimate import FALSE_REJECTIONS, WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.lack_of_fit import FORCE, JOINT, OFF_NORMAL, find_dependences, growing_p_value
from scara_kinetostatic.diagnosis.linear_problem import CREDIBLE, STRICT_SIGNIFICANCE
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.objects import OffNormalForce
from scara_kinetostatic.errors import UnsupportedDataError
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
    grown = fit_again(c, noise=c.noise._replace(force_relative=0.01)) if asked else None
    if grown is None:
        return None
    least = _deviance(grown)
    gain = _deviance(c) - least
    # noise that grows by more than 5 % of the force is a model error
    if gain < (PENALTY if suspicious else CREDIBLE) or grown.noise.growth > 0.05 or _is_understated(c, least):
        return None
    return None if suspicious and _depends_on_something(grown) else grown.noise


def _depends_on_something(c: Calibration) -> bool:
    """Whether the residual of a fit, weighted by its noise, shows a model error."""
    dependences = find_dependences(c)
    return bool(dependences) and dependences[0].p_value * len(dependences) < STRICT_SIGNIFICANCE


def _is_understated(c: Calibration, least: float) -> bool:
    """Whether stated levels that are all too small explain the touches clearly better than further components do."""
    if c.cell.noise is None:
        return False
    free = fit_again(c, cell=replace(c.cell, noise=None), noise=c.noise._replace(force_relative=None))
    return free is not None and _deviance(free) < least - CREDIBLE


def fit_with_off_normal(c: Calibration) -> Calibration | None:
    """The touches of a calibration fitted with a random off-normal angle of each force, σ_α estimated; None where they
    have no such fit. Effects that the calibration has stay.
    """
    others = (effect for effect in c.model.effects if not effect.off_normal_std)
    model, used = c.model.with_effects((OffNormalForce(), *others)), np.ones(len(c.touches), dtype=bool)
    return fit_again(c.changed(model=model, used=used))


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


def _deviance(calibration: Calibration) -> float:
    """D above, up to a constant of the touches."""
    c = calibration
    l11, _, l22 = c.projection.whitened.root
    rejection = -2 * np.log(FALSE_REJECTIONS / len(c.touches))
    distance = np.where(c.used, c.projection.distance, rejection)
    return float(np.sum(distance + 2 * np.log(l11 * l22))) + c.prior_cost
