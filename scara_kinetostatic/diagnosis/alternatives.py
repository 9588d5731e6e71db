"""Alternative laws and frequencies of the effects found, and standard deviations that cover them.

The law of an effect is an assumption. A contact that yields by f^(2/3) and one that yields by f^(1/2) fit a few force
levels alike, and differ in what they leave to p_ee and g_ee. The frequency of a wave may be wrong as well: the
offsets and link lengths take up most of a slow wave, and the residual resembles one of another frequency; of a small
wave a neighbouring peak may be higher by chance. Every law and every frequency that fit the touches equally well are
fitted, and the standard deviations of the extended model are widened to cover them.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.contributions import ALTERNATIVES, Contribution
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.candidates import (
    Candidate,
    Scan,
    ScannedTrial,
    as_fitted,
    explained,
    gains,
    refined,
    scan_trials,
)
from scara_kinetostatic.diagnosis.effort import Effort
from scara_kinetostatic.diagnosis.linear_problem import Problem, orthonormal, pose_problem
from scara_kinetostatic.diagnosis.refit import fitted_effects, penalised_deviance, start_from
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE, DISTINCT
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G1, G2, G_EE, NAMES, P1, P2, P_EE

_COMPLIANCES = np.array([P_EE, P1, P2, G_EE, G1, G2])
"""Compliances and backlashes: not negative in any robot."""
_SIGNIFICANTLY_NEGATIVE = 3.0
"""Standard deviations below zero from which on a fit with such a compliance or backlash is discarded."""
_GRID_LOSS = 0.2
"""Part of what a wave explains that may be lost at the nearest frequency of the grid, with a margin."""
_MOST_PEAKS = 4
"""Peaks that are fitted at most, the highest first."""


def fit_alternative_laws(extended: Calibration, effort: Effort) -> list[Calibration]:
    """The touches of an extended model fitted with alternative laws of its effects, where these fit equally well."""
    model, variants = extended.model, []
    for place, (effect, _, _) in enumerate(fitted_effects(extended)):
        for other in effect.alternative_laws():
            effects, values = list(model.effects), list(model.effect_values)
            effects[place], values[place] = other, other.start
            variants.append(ExtendedModel(model.parameters, tuple(effects), tuple(values)))
    return _fit_variants(extended, variants, effort)


def fit_alternative_frequencies(
    extended: Calibration, in_every_model: Container[str], effort: Effort
) -> list[Calibration]:
    """The touches of an extended model fitted with other frequencies of its effects, where these fit equally well.

    Args:
        extended: the extended model.
        in_every_model: labels of effects without rivals; the frequency of a rival, which explains a part, is vague.
        effort: of the diagnosis.
    """
    fitted = fitted_effects(extended)
    waves = [
        k
        for k, (effect, _, _) in enumerate(fitted)
        if effect.grid_parameter and effect.is_smooth and not effect.is_stepwise and effect.label in in_every_model
    ]
    if not waves:
        return []
    problem = pose_problem(extended)
    found = [as_fitted(problem, effect, values, 1) for effect, values, _ in fitted]
    variants = []
    for place in waves:
        k = fitted[place].effect.grid_parameter_index
        frequency, std = fitted[place].values[k], fitted[place].std[k]
        for peak in _peaks(problem, found, place, max(1.0, extended.reduced_chi_square)):
            if abs(peak.trial.place - frequency) > DISTINCT * std:
                variants.append(start_from(problem, [*found[:place], peak, *found[place + 1 :]])[0])
    return _fit_variants(extended, variants, effort)


def alternative_places(extended: Calibration) -> list[Calibration]:
    """An extended model with its effects at other places of their grids, where the touches are explained equally well.

    For laws with kinks, whose optimum along the grid is a valley with many small ones in it: the curvature at one of
    them says nothing of the width of the valley. They are not fitted anew, which would lead to the nearest optimum,
    but are those of the linear problem, with all other parameters at their best.
    """
    fitted = fitted_effects(extended)
    places = [k for k, (effect, _, _) in enumerate(fitted) if effect.grid_parameter and not effect.is_smooth]
    if not places:
        return []
    problem = pose_problem(extended)
    found = [as_fitted(problem, effect, values, 1) for effect, values, _ in fitted]
    models = [
        start_from(problem, [*found[:place], other, *found[place + 1 :]])[0]
        for place in places
        for other in _credible_trials(problem, found, place, max(1.0, extended.reduced_chi_square))
    ]
    others = [replace(extended, model=model) for model in models]
    return [other for other in others if _has_physical_compliances(other) and _is_plausible(other)]


def _credible_trials(problem: Problem, found: list[Candidate], place: int, scale: float) -> list[Candidate]:
    """The trials of an effect that explain the touches as well as its fit, or the best trial, beside other effects."""
    scan, beside = _scan_beside(problem, found, place)
    if not scan.columns.any():
        return []
    gained = gains(problem, scan, beside)
    unit = found[place].unit
    unit = unit if beside is None else orthonormal(unit - beside @ (beside.T @ unit))
    best = max(float(gained.max()), float(np.sum((unit.T @ problem.left) ** 2)))
    near = np.flatnonzero(gained > best - CREDIBLE * scale)
    candidates = [ScannedTrial(scan, k).candidate(problem) for k in near.tolist()]
    return [candidate for candidate in candidates if candidate.unit.shape[1]]


def _is_plausible(fit: Calibration) -> bool:
    return all(effect.is_plausible(values) for effect, values, _ in fitted_effects(fit))


def _scan_beside(problem: Problem, found: list[Candidate], place: int) -> tuple[Scan, Floats | None]:
    """The trials of an effect, and an orthonormal basis of the other effects."""
    effect = found[place].effect
    trials = effect.trials(problem.touch_state, problem.force)
    others = [candidate.unit for k, candidate in enumerate(found) if k != place]
    beside = orthonormal(np.concatenate(others, axis=1)) if others else None
    return scan_trials(problem, effect, trials, len(trials)), beside


def _peaks(problem: Problem, found: list[Candidate], place: int, scale: float) -> list[Candidate]:
    """The frequencies of an effect that explain nearly as much as the best, beside the other effects."""
    scan, beside = _scan_beside(problem, found, place)
    gained = gains(problem, scan, beside)
    padded = np.concatenate([[-np.inf], gained, [-np.inf]])
    tops = np.flatnonzero((gained >= padded[:-2]) & (gained >= padded[2:]))
    least = (1 - _GRID_LOSS) * float(gained.max()) - CREDIBLE * scale
    found_at = [ScannedTrial(scan, k) for k in tops.tolist() if gained[k] > least]
    peaks = [refined(problem, top, float(gained[top.k]), beside).candidate(problem) for top in found_at]
    return sorted(peaks, key=lambda peak: -explained(problem, peak))[:_MOST_PEAKS]


def _fit_variants(extended: Calibration, variants: Sequence[ExtendedModel], effort: Effort) -> list[Calibration]:
    """Fits that start from other models, where they are credible beside the extended one.

    Args:
        extended: the extended model.
        variants: the models to start from.
        effort: of the diagnosis; variants beyond it are left out.
    """
    scale = max(1.0, extended.reduced_chi_square)
    limit = penalised_deviance(extended, 0.0, scale) + CREDIBLE
    fits = [fit for variant in variants if effort.allows() and (fit := _fit_variant(extended, variant, effort))]
    return [fit for fit in fits if _has_physical_compliances(fit) and penalised_deviance(fit, 0.0, scale) < limit]


def _fit_variant(extended: Calibration, start: ExtendedModel, effort: Effort) -> Calibration | None:
    c = extended
    warm_start = WarmStart(start, c.noise, c.used, c.errors)
    try:
        fit = effort.fit(c.touches, c.cell, start.effects, fixed=c.fixed, warm_start=warm_start)
    except UnsupportedDataError:
        return None
    return fit if fit.termination is Termination.CONVERGED else None


def _has_physical_compliances(fit: Calibration) -> bool:
    """Whether no compliance and no backlash is significantly negative."""
    values, std = fit.parameters.as_array()[_COMPLIANCES], fit.std[_COMPLIANCES]
    return not np.any(values < -_SIGNIFICANTLY_NEGATIVE * std)


def widened_to_each(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with standard deviations within one of which every other fit lies.

    Args:
        extended: the extended model.
        others: the alternatives; the farthest is taken first.
    """

    def distance(other: Calibration) -> float:
        off = other.parameters.as_array() - extended.parameters.as_array()
        return float(np.nanmax(np.abs(off) / np.where(extended.std > 0, extended.std, np.inf), initial=0.0))

    wide = extended
    for other in sorted(others, key=distance, reverse=True):
        off = np.abs(other.model.as_array() - extended.model.as_array())
        same_effects = other.model.effects == extended.model.effects
        std = np.concatenate([wide.std, wide.effect_std])
        beyond = off > np.where(std > 0, std, np.inf)
        if beyond[: len(std) if same_effects else len(NAMES)].any():
            wide = widened_by(wide, [other])
    return wide


def widened_by(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with the scatter of other fits about it added to its covariance.

    It is added to the base parameters, and to those of the effects if all fits have the same.
    """
    if not others:
        return extended
    same_effects = all(other.model.effects == extended.model.effects for other in others)
    count = len(extended.covariance) if same_effects else len(NAMES)
    off = np.array([other.model.as_array()[:count] - extended.model.as_array()[:count] for other in others])
    covariance = extended.covariance.copy()
    covariance[:count, :count] += off.T @ off / len(off)
    std = np.sqrt(np.diag(covariance))
    known = np.concatenate([extended.std, extended.effect_std])
    std = np.where(known > 0, std, known)
    contributions = with_alternatives(extended, covariance)
    return replace(
        extended,
        covariance=covariance,
        contributions=contributions,
        std=std[: len(NAMES)],
        effect_std=std[len(NAMES) :],
    )


def with_alternatives(extended: Calibration, covariance: Floats) -> tuple[Contribution, ...]:
    """The contributions to a covariance that has grown, what it has grown by as that of other credible models."""
    known = [part for part in extended.contributions if part.label != ALTERNATIVES]
    rest = covariance - np.sum([part.covariance for part in known], axis=0)
    return (*known, Contribution(ALTERNATIVES, None, '', rest))


def widened_by_constants(extended: Calibration, fits: Sequence[Calibration]) -> Calibration:
    """The extended model with the undetermined constants of fitted curves added to its covariance.

    A constant added to a curve changes a base parameter instead of the fit (`Effect.undetermined_constant`); of several
    curves the largest counts.

    Args:
        extended: the extended model.
        fits: it and those of rivals.
    """
    largest: dict[str, float] = {}
    for fit in fits:
        curves = [(effect, values) for effect, values, _ in fitted_effects(fit) if not effect.is_physical]
        at = pose_problem(fit).touch_state if curves else None
        for effect, values in curves:
            constant = effect.undetermined_constant(at, values) if at is not None else None
            if constant is not None:
                name, size = constant
                largest[name] = max(size, largest.get(name, 0.0))
    covariance = extended.covariance.copy()
    for name, size in largest.items():
        place = NAMES.index(name)
        covariance[place, place] += size**2 if extended.std[place] > 0 else 0.0
    std = np.where(extended.std > 0, np.sqrt(np.diag(covariance)[: len(NAMES)]), extended.std)
    if not largest:
        return extended
    return replace(extended, covariance=covariance, contributions=with_alternatives(extended, covariance), std=std)
