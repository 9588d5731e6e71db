"""Hypotheses for residuals that are too large, and the selection of the likeliest by its penalised deviance.

They may come from effects that act in all touches (`search`), from friction that turns each force by a random
angle (`contact_angle`), or from bad touches, some of which an effect may have made look bad. Each hypothesis that
applies is fitted, and compared by `refit.penalised_deviance`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from scara_kinetostatic.calibration.noise_estimation import USUAL_NOISE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.contact_angle import fit_with_off_normal, growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.effort import SEARCH, Effort
from scara_kinetostatic.diagnosis.noise_advice import implausible_noise
from scara_kinetostatic.diagnosis.refit import fitted_effects, penalised_deviance
from scara_kinetostatic.diagnosis.search import Search, search
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE, FRICTION_SIGNIFICANCE
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import UnsupportedDataError


class Selection(NamedTuple):
    """The likeliest hypothesis.

    Attributes:
        found: what was found; None if nothing is missing.
        lead: decrease of the penalised deviance against the base model.
    """

    found: Search | None
    lead: float


def select_hypothesis(
    calibration: Calibration, known: Sequence[Effect], alarm: bool, off_normal: bool, effort: Effort
) -> Selection:
    """Find what the base model lacks, if anything.

    Args:
        calibration: the base model.
        known: the catalogue.
        alarm: whether a test of the base model is significant.
        off_normal: whether that of the off-normal angles is.
        effort: of the diagnosis; hypotheses beyond it are left out.
    """
    c = calibration
    hypotheses = _fit_hypotheses(c, known, alarm, off_normal, effort)
    fitted = [(found, found.extended) for found in hypotheses if found.extended is not None]
    if not fitted:
        return Selection(hypotheses[0] if alarm else None, 0.0)
    scale = max(1.0, min(fit.reduced_chi_square for fit in (c, *(extended for _, extended in fitted))))
    deviances = [penalised_deviance(extended, found.penalty, scale) for found, extended in fitted]
    lead = penalised_deviance(c, 0.0, scale) - min(deviances)
    if lead < CREDIBLE:
        without = hypotheses[0]._replace(extended=None, in_every_model=(), rivals=())
        return Selection(without if alarm else None, 0.0)
    return Selection(fitted[int(np.argmin(deviances))][0], lead)


def _fit_hypotheses(
    c: Calibration, known: Sequence[Effect], alarm: bool, off_normal: bool, effort: Effort
) -> list[Search]:
    """The hypotheses that apply: an effect; one that explains the rejected touches, too; one so large that it was taken
    for noise; random off-normal angles.
    """
    hypotheses: list[Search] = []
    if alarm:
        hypotheses.append(search(c, known, effort))
    all_used = any(found.extended and found.extended.used.all() for found in hypotheses)
    if not c.used.all() and not all_used and effort.allows(SEARCH):
        hypotheses.append(search(c, known, effort, replace(c, used=np.ones(len(c.touches), dtype=bool))))
    is_open = alarm and c.cell.noise is None and not any(found.extended for found in hypotheses)
    if is_open and effort.allows(SEARCH):
        hypotheses += _with_usual_noise(c, known, effort)
    fits = [found.extended for found in hypotheses if found.extended]
    is_open = (off_normal or _shows_off_normal(fits)) and not any(_is_radial(fit) for fit in fits)
    if is_open and effort.allows(SEARCH):
        hypotheses += _with_off_normal_forces(c, known, effort)
    return hypotheses


def _shows_off_normal(fits: Sequence[Calibration]) -> bool:
    """Whether off-normal angles are significant beside effects that hide them in the base model."""
    return any(not fit.model.off_normal_std and off_normal_p_value(fit) < FRICTION_SIGNIFICANCE for fit in fits)


def _with_usual_noise(calibration: Calibration, known: Sequence[Effect], effort: Effort) -> list[Search]:
    """Effects so large that they were taken for noise, searched for with the usual noise; empty where it has no fit."""
    c = calibration
    try:
        begin = effort.fit(c.touches, replace(c.cell, noise=USUAL_NOISE), fixed=c.fixed)
    except UnsupportedDataError:
        return []
    return [search(c, known, effort, begin)]


def _with_off_normal_forces(calibration: Calibration, known: Sequence[Effect], effort: Effort) -> list[Search]:
    """Random off-normal angles, and other effects beside them; empty where these are not significant."""
    try:
        with_angles = fit_with_off_normal(calibration, effort)
        friction = next(effect for effect, _, _ in fitted_effects(with_angles) if effect.off_normal_std)
        found = search(with_angles, [effect for effect in known if effect.name != friction.name], effort)
        extended = found.extended
        if extended is not None and len(extended.model.effects) > 1:
            extended = fit_with_off_normal(extended, effort)
    except UnsupportedDataError:
        return []
    if extended is None or extended.termination is not Termination.CONVERGED or not _is_surely_off_normal(extended):
        return []
    penalty = found.penalty + float(np.log(len(calibration.touches)) + 2 * np.log(len(known)))
    labels = (friction.label, *found.in_every_model)
    return [found._replace(extended=extended, penalty=penalty, in_every_model=labels)]


def _is_radial(extended: Calibration) -> bool:
    """Whether an extended model fits without a fitted curve and without off-normal angles beyond noise."""
    c = extended
    if not all(effect.is_physical for effect, _, _ in fitted_effects(c)):
        return False
    if c.noise_source == 'estimated':
        fits = not implausible_noise(c)
    else:
        fits = bool(chdtrc(c.degrees_of_freedom, c.chi_square) > FRICTION_SIGNIFICANCE)
    return fits and off_normal_p_value(c) > FRICTION_SIGNIFICANCE


def _is_surely_off_normal(extended: Calibration) -> bool:
    """Whether, beside the other effects of an extended model, the off-normal angles are no noise growing with force.

    The test is made at the parameters of the extended model: those of a fit without off-normal angles may be far off.
    Where growing noise is significant beside the angles, these must be more significant by the same factor.
    """
    others = tuple(effect for effect in extended.model.effects if not effect.off_normal_std)
    without = replace(extended, model=extended.model.with_effects(others))
    off_normal, growing = off_normal_p_value(without, beside_growing=True), growing_p_value(extended)
    return off_normal < FRICTION_SIGNIFICANCE * (growing if growing < FRICTION_SIGNIFICANCE else 1.0)
