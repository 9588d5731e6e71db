"""Search for missing effects: select a set of effects, fit it, select again at that fit, until the set stays the same.

The linear problem in which sets are scored holds near its fit only. So each round poses it at the latest fit, selects
the credible sets, and fits their union. A round that finds no fit continues from a part of the best set, or without
the effects whose frequency fits the linear problem alone; `_State` is all that one round hands to the next.

**Hypotheses.** Residuals may be too large by effects that act in all touches (`search`), by friction that turns each
force by a random angle (`fit_with_off_normal`), or by bad touches, some of which an effect may have made look bad.
Each hypothesis that applies is fitted, and compared by `refit.penalised_deviance`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

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
from scara_kinetostatic.diagnosis.model_selection import ScoredSubsets, Subset, score_subsets
from scara_kinetostatic.diagnosis.noise_structure import fit_with_off_normal
from scara_kinetostatic.diagnosis.refit import SEARCH, Effort, fit_with, penalised_deviance
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import UnsupportedDataError

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
        empty = next(subset for subset in self.scored_subsets.subsets if not subset.members)
        return empty.score - min(subset.score for subset in self.scored_subsets.subsets if subset.members)

    def fit_rivals(self, calibration: Calibration, effort: Effort) -> list[Calibration]:
        """The touches of a calibration fitted with each credible set of effects by itself.

        Args:
            calibration: that with which the search began.
            effort: of the diagnosis; fits beyond it are left out.
        """
        selection = _Selection(effort, calibration, self.start or calibration, self.problem, self.scored_subsets)
        subsets = self.scored_subsets.credible[:8]
        return [fit for one in subsets if effort.allows() and (fit := selection.fit(selection.members(one)))]


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
    state = _State(begin or calibration)
    # most searches end after two rounds
    for _ in range(6):
        state = _next_state(calibration, effects, state, effort)
        if state.is_final or not effort.allows(SEARCH):
            break
    result = state.result or state.fallback
    assert result is not None
    return result


class _State(NamedTuple):
    """A search between two rounds.

    Attributes:
        latest: the fit at which the next linear problem is posed.
        labels: of the effects that the last round fitted.
        excluded: labels of effects that are no longer candidates.
        failed: sets of effects, by labels, whose fit does not converge or is not plausible.
        failures: number of such fits in all rounds.
        result: of the last round that fitted all selected effects.
        fallback: the result if there is no such round, or if this is the last one.
        is_final: whether the search ends here.
    """

    latest: Calibration
    labels: frozenset[str] = frozenset()
    excluded: frozenset[str] = frozenset()
    failed: frozenset[frozenset[str]] = frozenset()
    failures: int = 0
    result: Search | None = None
    fallback: Search | None = None
    is_final: bool = False


class _Selection(NamedTuple):
    """The model selection of one round, from which effects are fitted.

    Attributes:
        effort: of the diagnosis.
        calibration: that with which the search began.
        latest: the fit at which the problem is posed.
        problem: the linear problem.
        scored_subsets: the model selection in it.
    """

    effort: Effort
    calibration: Calibration
    latest: Calibration
    problem: Problem
    scored_subsets: ScoredSubsets

    def members(self, subset: Subset) -> list[Candidate]:
        """The candidates of a set."""
        return [self.scored_subsets.candidate_set.candidates[k] for k in subset.members]

    def union(self, subsets: Sequence[Subset]) -> list[Candidate]:
        """The effects of the first set, and those of the others up to `_MOST_IN_UNION`, each once."""
        union: dict[str, Candidate] = {}
        for subset in subsets:
            for candidate in self.members(subset):
                if len(union) < _MOST_IN_UNION or subset is subsets[0]:
                    union.setdefault(candidate.effect.label, candidate)
        return list(union.values())

    def fit(self, members: Sequence[Candidate]) -> Calibration | None:
        """The fit with effects; None if it is no result or not plausible."""
        try:
            fitted = fit_with(self.calibration, self.latest, self.problem, members, self.effort)
        except UnsupportedDataError:
            return None
        return fitted if fitted.is_result and self._predicts(fitted) and _is_plausible(fitted) else None

    def _predicts(self, fitted: Calibration) -> bool:
        """Whether a fit predicts the forces: a curve over the force may follow the deviations of the tip, and yet be so
        steep that no contact, or another one, belongs to the joint angles.
        """
        c = self.calibration
        return fitted.force_error <= 2.0 * c.force_error + c.noise.force_rms

    def result(self, extended: Calibration, best: Subset) -> Search:
        """The result with the fit of all selected effects."""
        in_every_model, rivals = _partition(self.scored_subsets)
        return Search(self.problem, self.scored_subsets, extended, best.penalty, in_every_model, rivals, self.latest)

    def without_effects(self, penalty: float = 0.0) -> Search:
        """The result where no effect was fitted: no extended model, unless the search began with one."""
        c = self.calibration
        extended = c if any(effect.label not in c.held_effects for effect in c.model.effects) else None
        return Search(self.problem, self.scored_subsets, extended, penalty)


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


def _next_state(calibration: Calibration, effects: Sequence[Effect], state: _State, effort: Effort) -> _State:
    """One round: select effects at the latest fit, and fit them."""
    problem = pose_problem(state.latest)
    remaining = [effect for effect in effects if effect.label not in state.excluded]
    scored_subsets = score_subsets(problem, all_candidates(state.latest, problem, remaining))
    selection = _Selection(effort, calibration, state.latest, problem, scored_subsets)
    state = state._replace(fallback=selection.without_effects())
    if not scored_subsets.credible:
        return state._replace(is_final=True)
    fitted, failed = _fit_first(selection, scored_subsets.credible, state.failed)
    state = state._replace(failed=failed, failures=state.failures + len(failed - state.failed))
    if fitted is None and state.failures >= 6:
        return state._replace(fallback=selection.without_effects(scored_subsets.credible[0].penalty), is_final=True)
    return _after_failure(selection, state) if fitted is None else _after_fit(selection, fitted, state)


def _fit_first(
    selection: _Selection, subsets: Sequence[Subset], failed: frozenset[frozenset[str]]
) -> tuple[Calibration | None, frozenset[frozenset[str]]]:
    """Fit the union of sets, or else the first of them whose fit converges.

    The union is left out if its effects are nearly the same and would run to large values that cancel.

    Args:
        selection: of the round.
        subsets: the best first.
        failed: sets that are not tried again.

    Returns:
        The fit, None if none converges; `failed` with those that did not.
    """
    union, tried = selection.union(subsets), False
    attempts = [selection.members(subset) for subset in subsets[:_ATTEMPTS]]
    for members in [union, *attempts] if _are_distinguishable(selection.problem, union) else attempts:
        labels = _labels(members)
        if labels in failed:
            continue
        if tried and not selection.effort.allows(SEARCH):
            break
        tried = True
        fitted = selection.fit(members)
        if fitted is not None:
            return fitted, failed
        failed |= {labels}
    return None, failed


def _are_distinguishable(problem: Problem, members: Sequence[Candidate]) -> bool:
    """Whether effects may be fitted together; else the best set is, and its rivals widen the standard deviations."""
    columns = np.concatenate([member.unit for member in members], axis=1)
    least = float(np.linalg.svd(columns, compute_uv=False)[-1])
    diverges = any(member.effect.diverges_with_alias or problem.is_declared(member.effect) for member in members)
    return least > 0.1 or not diverges


def _after_failure(selection: _Selection, state: _State) -> _State:
    """Where no credible set could be fitted: continue from a part of the best one, or without effects of unknown
    frequency, which then explain the linear problem alone; or end.
    """
    scored_subsets = selection.scored_subsets
    best = scored_subsets.credible[0]
    selected = selection.union(scored_subsets.credible)
    labels = _labels(selected)
    parts = [subset for subset in scored_subsets.subsets if subset.members and set(best.members) > set(subset.members)]
    if labels != state.labels and parts and selection.effort.allows(SEARCH):
        part, failed = _fit_first(selection, parts[:_ATTEMPTS], state.failed)
        if part is not None:
            return state._replace(latest=part, labels=labels, failed=frozenset())
        state = state._replace(failed=failed)
    scanned = {candidate.effect.label for candidate in selected if candidate.tried > 1}
    if scanned:
        return state._replace(excluded=state.excluded | scanned)
    return state._replace(fallback=selection.without_effects(best.penalty), is_final=True)


def _after_fit(selection: _Selection, fitted: Calibration, state: _State) -> _State:
    """Continue from the fit, or from a smaller one that is likelier; end where the set stays the same."""
    credible = selection.scored_subsets.credible
    labels = _labels(selection.union(credible))
    result = selection.result(fitted, credible[0])
    if len(credible) == 1 and labels != state.labels:
        smaller = _fit_smaller(selection, fitted)
        if smaller is not None:
            return state._replace(latest=smaller, labels=labels, fallback=result)
    return state._replace(result=result, latest=fitted, labels=labels, is_final=labels == state.labels)


def _fit_smaller(selection: _Selection, fitted: Calibration) -> Calibration | None:
    """The likeliest fit without one of the effects, if likelier than with all; None if each is needed.

    Where the residuals are large, the linear problem may select an effect only to make up for its second-order error.
    """
    penalty = selection.scored_subsets.penalty
    best = selection.scored_subsets.credible[0]
    if len(best.members) < 2:
        return None
    scale = max(1.0, fitted.reduced_chi_square)
    least, smaller = penalised_deviance(fitted, penalty(best.members), scale), None
    for out in best.members:
        if not selection.effort.allows(SEARCH):
            break
        kept = tuple(k for k in best.members if k != out)
        fit = selection.fit(selection.members(best._replace(members=kept)))
        if fit is None:
            continue
        total = penalised_deviance(fit, penalty(kept), scale)
        if total < least:
            least, smaller = total, fit
    return smaller


def _labels(members: Iterable[Candidate]) -> frozenset[str]:
    return frozenset(member.effect.label for member in members)


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
    if not c.used.all() and not all_used and effort.allows(SEARCH):
        hypotheses.append(search(c, known, effort, replace(c, used=np.ones(len(c.touches), dtype=bool))))
    is_open = alarm and c.cell.noise is None and not any(found.extended for found in hypotheses)
    if is_open and effort.allows(SEARCH):
        hypotheses += _with_usual_noise(c, known, effort)
    fits = [found.extended for found in hypotheses if found.extended]
    # effects may hide them in the base model
    off_normal = off_normal or any(
        not fit.model.off_normal_std and off_normal_p_value(fit) < FRICTION_SIGNIFICANCE for fit in fits
    )
    is_open = off_normal and not any(_is_radial(fit) for fit in fits)
    if is_open and effort.allows(SEARCH):
        hypotheses += _with_off_normal_forces(c, known, effort)
    return hypotheses


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
