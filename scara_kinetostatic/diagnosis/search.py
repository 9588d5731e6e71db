"""The search for what is missing: contest, fit with the winners, contest again, until nothing changes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.candidates import Candidate, Field, gather
from scara_kinetostatic.diagnosis.evidence import story
from scara_kinetostatic.diagnosis.linear_problem import Problem, pose_problem
from scara_kinetostatic.diagnosis.model_selection import Contest, compete
from scara_kinetostatic.diagnosis.refit import effect_values, fit_with
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import unnamed_effects
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
    contest: Contest
    extended: Calibration | None
    price: float
    proved: tuple[str, ...]
    rivals: tuple[tuple[str, ...], ...]
    start: Calibration | None = None

    @property
    def gain(self) -> float:
        """By how much the best set scores better than no effect."""
        empty = next(entry for entry in self.contest.entries if not entry.members)
        return empty.score - min(entry.score for entry in self.contest.entries if entry.members)

    def fit_rivals(self, calibration: Calibration) -> list[Calibration]:
        """The touches of a calibration fitted with each credible set of effects by itself, `FITTED` sets at most.

        Args:
            calibration: that with which the search began.
        """
        fits = []
        for entry in self.contest.credible[:FITTED]:
            members = [self.contest.field.candidates[k] for k in entry.members]
            try:
                fits.append(fit_with(calibration, self.start or calibration, self.problem, members))
            except UnsupportedDataError:
                continue
        return [fit for fit in fits if fit.termination is Termination.CONVERGED and _makes_sense(fit)]


def search(calibration: Calibration, effects: Sequence[Effect], begin: Calibration | None = None) -> Search:
    """Find the effects that a calibration lacks.

    Args:
        calibration: of the twelve parameters; effects that its cell has stay.
        effects: the catalogue.
        begin: another fit to the same touches to begin at, with noise or used touches of its own. Each
            fit with effects judges anew which touches are bad, and estimates the noise anew if it is not given.
    """
    latest = begin or calibration
    nothing = calibration if calibration.cell.effects else None
    found: Search | None = None
    before, out = frozenset[str](), frozenset[str]()
    given_up: set[frozenset[str]] = set()
    for _ in range(ROUNDS):
        problem = pose_problem(latest)
        contest = compete(problem, all_candidates(latest, problem, [e for e in effects if e.label not in out]))
        winners = _winners(contest)
        if not winners:
            return found or Search(problem, contest, nothing, 0.0, (), ())
        labels = frozenset(candidate.effect.label for candidate in winners)
        fitted = _settled(calibration, latest, problem, contest, given_up)
        waves = {c.effect.label for c in winners if c.tried > 1}
        part = None
        if fitted is None and labels != before:
            part = _part(calibration, latest, problem, contest, given_up)
        if part is not None:
            latest, before = part, labels
            given_up.clear()
            continue
        if fitted is None and waves:
            out |= waves  # such a frequency explains only the linear problem
            continue
        if fitted is None:
            return found or Search(problem, contest, nothing, contest.credible[0].price, (), ())
        if len(contest.credible) == 1 and labels != before:
            smaller = _smaller(calibration, latest, problem, contest, fitted)
            if smaller is not None:
                latest, before = smaller, labels
                continue
        proved, rivals = _sort_out(contest)
        found = Search(problem, contest, fitted, contest.credible[0].price, proved, rivals, latest)
        if labels == before:
            break
        latest, before = fitted, labels
    return found or Search(problem, contest, nothing, 0.0, (), ())


def _settled(
    calibration: Calibration, latest: Calibration, problem: Problem, contest: Contest, given_up: set[frozenset[str]]
) -> Calibration | None:
    """The fit with all winners; if that does not settle, with the best credible set that does; None if none does.

    Sets that do not are remembered in `given_up`, and not tried again. Winners that are nearly the same are not tried
    together where they would run to large values that cancel.
    """
    sets = [[contest.field.candidates[k] for k in entry.members] for entry in contest.credible[:ATTEMPTS]]
    together = _winners(contest)
    for members in ([together] if _are_apart(together) else []) + sets:
        labels = frozenset(member.effect.label for member in members)
        if labels in given_up:
            continue
        with suppress(UnsupportedDataError):
            fitted = fit_with(calibration, latest, problem, members)
            if fitted.termination is Termination.CONVERGED and _makes_sense(fitted):
                return fitted
        given_up.add(labels)
    return None


def _are_apart(members: Sequence[Candidate]) -> bool:
    columns = np.concatenate([member.unit for member in members], axis=1)
    least = float(np.linalg.svd(columns, compute_uv=False)[-1])
    return least > APART or not any(member.effect.runs_off for member in members)


def _part(
    calibration: Calibration, latest: Calibration, problem: Problem, contest: Contest, given_up: set[frozenset[str]]
) -> Calibration | None:
    """The fit with a part of the best set, where the whole does not settle: from there the rest looks different."""
    whole = set(contest.credible[0].members)
    parts = [entry for entry in contest.entries if entry.members and whole > set(entry.members)]
    contest = contest._replace(credible=tuple(parts[:ATTEMPTS]))
    return _settled(calibration, latest, problem, contest, given_up) if parts else None


def _makes_sense(fitted: Calibration) -> bool:
    pairs = zip(fitted.cell.effects, effect_values(fitted), strict=True)
    return all(effect.makes_sense(values) for effect, (values, _) in pairs if isinstance(effect, Effect))


def _smaller(
    calibration: Calibration, latest: Calibration, problem: Problem, contest: Contest, fitted: Calibration
) -> Calibration | None:
    """A fit without one of the winners that is the likelier story; None if each is needed.

    Where the residuals are large the linear problem may ask for an effect only to make up for its own second order.
    """
    winners = contest.credible[0].members
    if len(winners) < 2:
        return None
    price = {entry.members[0]: entry.price for entry in contest.entries if len(entry.members) == 1}
    scale = max(1.0, fitted.reduced_chi_square)
    least, best = story(fitted, sum(price[k] for k in winners), scale), None
    for out in winners:
        kept = [k for k in winners if k != out]
        try:
            fit = fit_with(calibration, latest, problem, [contest.field.candidates[k] for k in kept])
        except UnsupportedDataError:
            continue
        total = story(fit, sum(price[k] for k in kept), scale)
        if fit.termination is Termination.CONVERGED and _makes_sense(fit) and total < least:
            least, best = total, fit
    return best


def all_candidates(latest: Calibration, problem: Problem, effects: Sequence[Effect], together: bool = True) -> Field:
    """The catalogue and unnamed structure as candidates; `together` as in `gather`."""
    pairs = zip(latest.cell.effects, effect_values(latest), strict=True)
    fitted = {effect.label: values for effect, (values, _) in pairs if isinstance(effect, Effect) and len(values)}
    discs = [disc.name for disc in latest.cell.discs]
    return gather(problem, [*effects, *unnamed_effects(problem.situation, discs, problem.one_level)], fitted, together)


def _winners(contest: Contest) -> list[Candidate]:
    """The effects of the best set, and with them those that could replace them."""
    winners: dict[str, Candidate] = {}
    for entry in contest.credible:
        for k in entry.members:
            candidate = contest.field.candidates[k]
            if len(winners) < MOST_IN_UNION or entry is contest.credible[0]:
                winners.setdefault(candidate.effect.label, candidate)
    return list(winners.values())


def _sort_out(contest: Contest) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Which effects are in every credible set, and which replace each other."""
    sets = [set(contest.labels(entry)) for entry in contest.credible]
    proved = set.intersection(*sets)
    best = contest.labels(contest.credible[0])
    open_ones = [label for label in best if label not in proved]
    groups: list[tuple[str, ...]] = []
    for label in open_ones:
        without = {frozenset(s - (set(best) - {label})) for s in sets if set(best) - {label} <= s}
        group = [label, *sorted({x for s in without for x in s if x != label})]
        if len(group) > 1:
            groups.append(tuple(group))
    grouped = {label for group in groups for label in group}
    rest = sorted({label for s in sets for label in s} - proved - grouped)
    if rest:
        groups.append(tuple(dict.fromkeys([*open_ones, *rest])))
    return tuple(label for label in best if label in proved), tuple(groups)
