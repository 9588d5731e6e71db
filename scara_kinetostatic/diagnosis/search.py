"""Search for missing effects: select a set of effects, fit it, select again at that fit, until the set stays the same.

The linear problem in which sets are scored holds near its fit only. So each round poses it at the latest fit, selects
the credible sets, and fits their union. Where none of them has a fit, the next round begins at that of a part of the
best set, or the search ends with what the round before found.

**Hypotheses.** Residuals may be too large by effects that act in all touches (`search`), by friction that turns each
force by a random angle (`fit_with_off_normal`), or by bad touches, some of which an effect may have made look bad.
Each hypothesis that applies is fitted, and compared by `refit.penalised_deviance`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.noise_estimation import USUAL_NOISE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.advice import implausible_noise
from scara_kinetostatic.diagnosis.candidates import Candidate, all_candidates
from scara_kinetostatic.diagnosis.lack_of_fit import growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    FRICTION_SIGNIFICANCE,
    Problem,
    fitted_effects,
    pose_problem,
)
from scara_kinetostatic.diagnosis.model_selection import ScoredSubsets, score_subsets
from scara_kinetostatic.diagnosis.noise_structure import fit_with_off_normal
from scara_kinetostatic.diagnosis.refit import Effort, Rival, fit_with, penalised_deviance
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import SizeMode
from scara_kinetostatic.model.extended_model import ExtendedModel

_ATTEMPTS = 4
"""Credible sets that are fitted one by one, where their union does not converge."""
_MOST_IN_UNION = 5
"""Effects of several credible sets that are fitted together at most; of more, those of the best sets."""


class Search(NamedTuple):
    """The result of a search.

    Attributes:
        problem: the last linear problem.
        scored_subsets: the model selection in it.
        extended: the fit with the selected effects; None if there is none.
        penalty: of the best set of effects.
        in_every_model: labels of effects in every credible set.
        rivals: labels of effects that replace each other.
        start: the fit at which the problem was posed.
    """

    problem: Problem
    scored_subsets: ScoredSubsets
    extended: Calibration | None
    penalty: float = 0.0
    in_every_model: tuple[str, ...] = ()
    rivals: tuple[tuple[str, ...], ...] = ()
    start: Calibration | None = None

    @property
    def gain(self) -> float:
        """By how much the best set scores better than no effect."""
        return self.scored_subsets.empty.score - min(
            subset.score for subset in self.scored_subsets.subsets if subset.members
        )


def search(
    calibration: Calibration, effects: Sequence[Effect], effort: Effort, begin: Calibration | None = None
) -> Search:
    """Find the effects that a calibration lacks.

    Args:
        calibration: the base model; effects that it has stay.
        effects: the catalogue.
        effort: of the diagnosis; beyond it there are no further rounds, nor attempts in a round.
        begin: another fit to the same touches to begin at, with noise or used touches of its own. Each
            fit with effects decides anew which touches are rejected, and estimates the noise anew if it is not given.
    """
    latest, labels, result = begin or calibration, set[str](), None
    own = calibration if any(e.label not in calibration.held_effects for e in calibration.model.effects) else None
    # most searches end after two rounds
    for _ in range(6):
        problem = pose_problem(latest)
        scored_subsets = score_subsets(problem, all_candidates(latest, problem, effects))
        found = Search(problem, scored_subsets, own, start=latest)
        if not scored_subsets.credible:
            return result or found
        best, selected = scored_subsets.credible[0], {member.effect.label for member in _union(scored_subsets)}
        fitted = _fit_first(calibration, latest, found, _attempts(problem, scored_subsets), effort)
        if fitted is not None:
            result = Search(problem, scored_subsets, fitted, best.penalty, *_partition(scored_subsets), latest)
        elif selected != labels:  # the fit of a part of the best set may lead to where all of it has one
            parts = [scored_subsets.members(part) for part in scored_subsets.subsets if part.is_part_of(best)]
            fitted = _fit_first(calibration, latest, found, parts[:_ATTEMPTS], effort)
        if fitted is None:
            return result or found._replace(penalty=best.penalty)
        if (result is not None and selected == labels) or not effort.allows():
            break
        latest, labels = fitted, selected
    return result or found


def fit_rivals(found: Search, calibration: Calibration, effort: Effort) -> list[Rival]:
    """The touches of a calibration fitted with each credible set of effects by itself.

    Args:
        found: the model selection.
        calibration: that with which the search began.
        effort: of the diagnosis; fits beyond it are left out.
    """
    start, sets = found.start or calibration, found.scored_subsets
    fits = [
        (_fit_set(calibration, start, found, sets.members(subset), effort), subset.score)
        for subset in sets.credible[:8]
        if effort.allows()
    ]
    good = [(fit, score) for fit, score in fits if fit is not None]
    if calibration.cell.uncertainty.effects.sizes is not SizeMode.ESTIMATED:
        return [Rival(fit, 1.0) for fit, _ in good]
    best = min((score for _, score in good), default=0.0)
    return [Rival(fit, float(np.exp((best - score) / 2))) for fit, score in good]


def _fit_set(
    c: Calibration, start: Calibration, found: Search, members: Sequence[Candidate], effort: Effort
) -> Calibration | None:
    """The touches of a calibration fitted with effects; None if it is no result or not plausible.

    Args:
        c: the calibration.
        start: the fit at which the problem of `found` is posed.
        found: the model selection of a round.
        members: the effects.
        effort: of the diagnosis.
    """
    try:
        fitted = fit_with(c, start, found.problem, members, effort)
    except UnsupportedDataError:
        return None
    # a curve over the force may be so steep that no contact, or another one, belongs to the joint angles
    predicts = fitted.force_error <= 2.0 * c.force_error + c.noise.force_rms
    return fitted if fitted.is_result and predicts and _is_plausible(fitted) else None


def _is_plausible(fitted: Calibration) -> bool:
    """Whether each effect has values that it can have, and the used touches determine one of its parameters at least.

    They do not where all touches on which it acts are rejected.
    """
    groups = [set(group) for group in fitted.identifiability.confounded]
    for effect, values, _ in fitted_effects(fitted):
        own = set(effect.labels)
        alone = {label for group in groups if group <= own for label in group}
        if not effect.is_plausible(values) or (own and alone >= own - fitted.model.held):
            return False
    return True


def _union(scored_subsets: ScoredSubsets) -> list[Candidate]:
    """The effects of the best credible set, and those of the others up to `_MOST_IN_UNION`, each once."""
    best, *others = scored_subsets.credible
    union = {candidate.effect.label: candidate for candidate in scored_subsets.members(best)}
    for candidate in (candidate for subset in others for candidate in scored_subsets.members(subset)):
        if len(union) < _MOST_IN_UNION:
            union.setdefault(candidate.effect.label, candidate)
    return list(union.values())


def _attempts(problem: Problem, scored_subsets: ScoredSubsets) -> list[list[Candidate]]:
    """The union of the credible sets, and the first of them by themselves.

    The union is left out if its effects are nearly the same and would run to large values that cancel.
    """
    union = _union(scored_subsets)
    attempts = [scored_subsets.members(subset) for subset in scored_subsets.credible[:_ATTEMPTS]]
    return [union, *attempts] if _are_distinguishable(problem, union) else attempts


def _fit_first(
    c: Calibration, start: Calibration, found: Search, attempts: Sequence[Sequence[Candidate]], effort: Effort
) -> Calibration | None:
    """The fit of the first set of effects that has one; None if none has."""
    tried: list[set[str]] = []
    for members in attempts:
        labels = {member.effect.label for member in members}
        if labels in tried:
            continue
        if tried and not effort.allows():
            break
        tried.append(labels)
        fitted = _fit_set(c, start, found, members, effort)
        if fitted is not None:
            return fitted
    return None


def _are_distinguishable(problem: Problem, members: Sequence[Candidate]) -> bool:
    """Whether effects may be fitted together; else the best set is, and its rivals widen the standard deviations."""
    columns = np.concatenate([member.unit for member in members], axis=1)
    least = float(np.linalg.svd(columns, compute_uv=False)[-1])
    diverges = any(member.effect.diverges_with_alias or problem.is_declared(member.effect) for member in members)
    return least > 0.1 or not diverges


def _partition(scored_subsets: ScoredSubsets) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Labels of the effects in every credible set, and groups of those that replace each other."""
    sets = [set(scored_subsets.labels(subset)) for subset in scored_subsets.credible]
    common = set.intersection(*sets)
    best = scored_subsets.labels(scored_subsets.credible[0])
    replaceable = [label for label in best if label not in common]
    groups: list[tuple[str, ...]] = []
    for label in replaceable:
        kept = set(best) - {label}
        instead = {frozenset(labels - kept) for labels in sets if kept <= labels}
        group = [label, *sorted({x for labels in instead for x in labels if x != label})]
        if len(group) > 1:
            groups.append(tuple(group))
    grouped = {label for group in groups for label in group}
    rest = sorted({label for labels in sets for label in labels} - common - grouped)
    if rest:
        groups.append(tuple(dict.fromkeys([*replaceable, *rest])))
    return tuple(label for label in best if label in common), tuple(groups)


def select_hypothesis(
    calibration: Calibration, known: Sequence[Effect], alarm: bool, off_normal: bool, effort: Effort
) -> tuple[Search | None, float]:
    """Find what the base model lacks, if anything.

    Args:
        calibration: the base model.
        known: the catalogue.
        alarm: whether a test of the base model is significant.
        off_normal: whether that of the off-normal angles is.
        effort: of the diagnosis; hypotheses beyond it are left out.

    Returns:
        The likeliest hypothesis, None if nothing is missing, and the decrease of the penalised deviance by it.
    """
    c = calibration
    hypotheses = _fit_hypotheses(c, known, alarm, off_normal, effort)
    fitted = [(found, found.extended) for found in hypotheses if found.extended is not None]
    if not fitted:
        return hypotheses[0] if alarm else None, 0.0
    scale = max(1.0, min(fit.reduced_chi_square for fit in (c, *(extended for _, extended in fitted))))
    deviances = [penalised_deviance(extended, found.penalty, scale) for found, extended in fitted]
    lead = penalised_deviance(c, 0.0, scale) - min(deviances)
    if lead < CREDIBLE:
        without = hypotheses[0]._replace(extended=None, in_every_model=(), rivals=())
        return without if alarm else None, 0.0
    return fitted[int(np.argmin(deviances))][0], lead


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
    if not c.used.all() and not all_used and effort.allows():
        hypotheses.append(search(c, known, effort, replace(c, used=np.ones(len(c.touches), dtype=bool))))
    is_open = alarm and c.cell.noise is None and not any(found.extended for found in hypotheses)
    if is_open and effort.allows():
        hypotheses += _with_usual_noise(c, known, effort)
    fits = [found.extended for found in hypotheses if found.extended]
    # effects may hide them in the base model
    off_normal = off_normal or any(
        not fit.model.off_normal_std and off_normal_p_value(fit) < FRICTION_SIGNIFICANCE for fit in fits
    )
    is_open = off_normal and not any(_is_radial(fit) for fit in fits)
    if is_open and effort.allows():
        hypotheses += _with_off_normal_forces(c, known, effort)
    return hypotheses


def _with_usual_noise(calibration: Calibration, known: Sequence[Effect], effort: Effort) -> list[Search]:
    """Effects so large that they were taken for noise, searched for with the usual noise; empty where it has no fit."""
    c = calibration
    # under gravity from here, for another fit would leave out other touches
    near = WarmStart(ExtendedModel(c.parameters), USUAL_NOISE, c.used, c.errors) if c.parameters.has_gravity else None
    try:
        begin = effort.fit(c.touches, replace(c.cell, noise=USUAL_NOISE), fixed=c.fixed, warm_start=near)
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
