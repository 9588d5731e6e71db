"""The search for what is missing: contest, fit with the winners, contest again, until nothing changes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.candidates import Candidate, CandidateSet, gather
from scara_kinetostatic.diagnosis.evidence import penalised_deviance
from scara_kinetostatic.diagnosis.linear_problem import Problem, pose_problem
from scara_kinetostatic.diagnosis.model_selection import ScoredSubsets, score_subsets
from scara_kinetostatic.diagnosis.refit import effect_values, fit_with
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import empirical_effects
from scara_kinetostatic.errors import UnsupportedDataError

ROUNDS = 6
ATTEMPTS = 4
FITTED = 8
APART = 0.1
"""Least singular value of the unit columns of effects that are fitted together."""
MOST_IN_UNION = 5
"""Rivals that are fitted together at most; of more, the best ones."""


class Search(NamedTuple):
    """Where the search ended.

    Attributes:
        problem: the last linear problem.
        contest: its outcome.
        extended: the fit with the winners; None if it does not settle.
        price: of the best set of effects.
        proved: labels of effects in every credible set.
        rivals: labels of effects that replace each other.
        start: the fit at which the problem was posed.
    """

    problem: Problem
    scored_subsets: ScoredSubsets
    extended: Calibration | None
    penalty: float
    in_every_model: tuple[str, ...]
    rivals: tuple[tuple[str, ...], ...]
    start: Calibration | None = None

    @property
    def gain(self) -> float:
        """By how much the best set scores better than no effect."""
        empty = next(subset for subset in self.scored_subsets.subsets if not subset.members)
        return empty.score - min(subset.score for subset in self.scored_subsets.subsets if subset.members)

    def fit_rivals(self, calibration: Calibration) -> list[Calibration]:
        """The touches of a calibration fitted with each credible set of effects by itself, `FITTED` sets at most.

        Args:
            calibration: that with which the search began.
        """
        fits = []
        for subset in self.scored_subsets.credible[:FITTED]:
            members = [self.scored_subsets.candidate_set.candidates[k] for k in subset.members]
            try:
                fits.append(fit_with(calibration, self.start or calibration, self.problem, members))
            except UnsupportedDataError:
                continue
        return [fit for fit in fits if fit.termination is Termination.CONVERGED and _is_plausible(fit)]


def search(calibration: Calibration, effects: Sequence[Effect], begin: Calibration | None = None) -> Search:
    """Find the effects that a calibration lacks.

    Args:
        calibration: of the twelve parameters; effects that it has stay.
        effects: the catalogue.
        begin: another fit to the same touches to begin at, with noise or used touches of its own. Each
            fit with effects judges anew which touches are bad, and estimates the noise anew if it is not given.
    """
    latest = begin or calibration
    nothing = calibration if calibration.model.effects else None
    found: Search | None = None
    before, out = frozenset[str](), frozenset[str]()
    given_up: set[frozenset[str]] = set()
    for _ in range(ROUNDS):
        problem = pose_problem(latest)
        scored_subsets = score_subsets(
            problem, all_candidates(latest, problem, [e for e in effects if e.label not in out])
        )
        winners = _winners(scored_subsets)
        if not winners:
            return found or Search(problem, scored_subsets, nothing, 0.0, (), ())
        labels = frozenset(candidate.effect.label for candidate in winners)
        fitted = _converged(calibration, latest, problem, scored_subsets, given_up)
        waves = {c.effect.label for c in winners if c.tried > 1}
        part = None
        if fitted is None and labels != before:
            part = _part(calibration, latest, problem, scored_subsets, given_up)
        if part is not None:
            latest, before = part, labels
            given_up.clear()
            continue
        if fitted is None and waves:
            out |= waves  # such a frequency explains only the linear problem
            continue
        if fitted is None:
            return found or Search(problem, scored_subsets, nothing, scored_subsets.credible[0].penalty, (), ())
        if len(scored_subsets.credible) == 1 and labels != before:
            smaller = _smaller(calibration, latest, problem, scored_subsets, fitted)
            if smaller is not None:
                latest, before = smaller, labels
                continue
        in_every_model, rivals = _sort_out(scored_subsets)
        found = Search(
            problem, scored_subsets, fitted, scored_subsets.credible[0].penalty, in_every_model, rivals, latest
        )
        if labels == before:
            break
        latest, before = fitted, labels
    return found or Search(problem, scored_subsets, nothing, 0.0, (), ())


def _converged(
    calibration: Calibration,
    latest: Calibration,
    problem: Problem,
    scored_subsets: ScoredSubsets,
    given_up: set[frozenset[str]],
) -> Calibration | None:
    """The fit with all winners; if that does not settle, with the best credible set that does; None if none does.

    Sets that do not are remembered in `given_up`, and not tried again. Winners that are nearly the same are not tried
    together where they would run to large values that cancel.
    """
    sets = [
        [scored_subsets.candidate_set.candidates[k] for k in subset.members]
        for subset in scored_subsets.credible[:ATTEMPTS]
    ]
    together = _winners(scored_subsets)
    for members in ([together] if _are_apart(together) else []) + sets:
        labels = frozenset(member.effect.label for member in members)
        if labels in given_up:
            continue
        with suppress(UnsupportedDataError):
            fitted = fit_with(calibration, latest, problem, members)
            if fitted.termination is Termination.CONVERGED and _is_plausible(fitted):
                return fitted
        given_up.add(labels)
    return None


def _are_apart(members: Sequence[Candidate]) -> bool:
    columns = np.concatenate([member.unit for member in members], axis=1)
    least = float(np.linalg.svd(columns, compute_uv=False)[-1])
    return least > APART or not any(member.effect.diverges_with_alias for member in members)


def _part(
    calibration: Calibration,
    latest: Calibration,
    problem: Problem,
    scored_subsets: ScoredSubsets,
    given_up: set[frozenset[str]],
) -> Calibration | None:
    """The fit with a part of the best set, where the whole does not settle: from there the rest looks different."""
    whole = set(scored_subsets.credible[0].members)
    parts = [subset for subset in scored_subsets.subsets if subset.members and whole > set(subset.members)]
    scored_subsets = scored_subsets._replace(credible=tuple(parts[:ATTEMPTS]))
    return _converged(calibration, latest, problem, scored_subsets, given_up) if parts else None


def _is_plausible(fitted: Calibration) -> bool:
    pairs = zip(fitted.model.effects, effect_values(fitted), strict=True)
    return all(effect.is_plausible(values) for effect, (values, _) in pairs if isinstance(effect, Effect))


def _smaller(
    calibration: Calibration, latest: Calibration, problem: Problem, scored_subsets: ScoredSubsets, fitted: Calibration
) -> Calibration | None:
    """A fit without one of the winners that is the likelier story; None if each is needed.

    Where the residuals are large the linear problem may ask for an effect only to make up for its own second order.
    """
    winners = scored_subsets.credible[0].members
    if len(winners) < 2:
        return None
    penalty = {subset.members[0]: subset.penalty for subset in scored_subsets.subsets if len(subset.members) == 1}
    scale = max(1.0, fitted.reduced_chi_square)
    least, best = penalised_deviance(fitted, sum(penalty[k] for k in winners), scale), None
    for out in winners:
        kept = [k for k in winners if k != out]
        try:
            fit = fit_with(calibration, latest, problem, [scored_subsets.candidate_set.candidates[k] for k in kept])
        except UnsupportedDataError:
            continue
        total = penalised_deviance(fit, sum(penalty[k] for k in kept), scale)
        if fit.termination is Termination.CONVERGED and _is_plausible(fit) and total < least:
            least, best = total, fit
    return best


def all_candidates(
    latest: Calibration, problem: Problem, effects: Sequence[Effect], together: bool = True
) -> CandidateSet:
    """The catalogue and unnamed structure as candidates; `together` as in `gather`."""
    pairs = zip(latest.model.effects, effect_values(latest), strict=True)
    fitted = {effect.label: values for effect, (values, _) in pairs if isinstance(effect, Effect) and len(values)}
    discs = [disc.name for disc in latest.cell.discs]
    return gather(
        problem, [*effects, *empirical_effects(problem.touch_state, discs, problem.one_level)], fitted, together
    )


def _winners(scored_subsets: ScoredSubsets) -> list[Candidate]:
    """The effects of the best set, and with them those that could replace them."""
    winners: dict[str, Candidate] = {}
    for subset in scored_subsets.credible:
        for k in subset.members:
            candidate = scored_subsets.candidate_set.candidates[k]
            if len(winners) < MOST_IN_UNION or subset is scored_subsets.credible[0]:
                winners.setdefault(candidate.effect.label, candidate)
    return list(winners.values())


def _sort_out(scored_subsets: ScoredSubsets) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Which effects are in every credible set, and which replace each other."""
    sets = [set(scored_subsets.labels(subset)) for subset in scored_subsets.credible]
    in_every_model = set.intersection(*sets)
    best = scored_subsets.labels(scored_subsets.credible[0])
    open_ones = [label for label in best if label not in in_every_model]
    groups: list[tuple[str, ...]] = []
    for label in open_ones:
        without = {frozenset(s - (set(best) - {label})) for s in sets if set(best) - {label} <= s}
        group = [label, *sorted({x for s in without for x in s if x != label})]
        if len(group) > 1:
            groups.append(tuple(group))
    grouped = {label for group in groups for label in group}
    rest = sorted({label for s in sets for label in s} - in_every_model - grouped)
    if rest:
        groups.append(tuple(dict.fromkeys([*open_ones, *rest])))
    return tuple(label for label in best if label in in_every_model), tuple(groups)
