"""Model selection: which set of effects explains the residual best, from all singles and pairs and larger sets.

A set of effects is scored by its deviance and a penalty per effect,

    score = deviance + Σ (m ln n + 2 ln (M t)),

with m parameters of the effect, n touches, M candidate effects and t trials of this one: the extended Bayesian
information criterion, whose prior takes every number of effects for equally likely (Chen and Chen, Biometrika 95
(2008) 759). A fitted curve, which can take any shape, is accepted only where it is clearly better than every physical
effect: its penalty is larger by `CREDIBLE`. What is declared to be uncertain is the first to be wrong: where a set has
an effect by which something exceeds its declared uncertainty, the penalty of the set is smaller by `CREDIBLE`, and M
counts such effects only. The deviance is χ² where the noise is given (divided by s² where no set of effects reduces it
to that noise), and ν ln RSS where it is estimated.

Sets whose score is within `CREDIBLE` of the best are credible, too. An effect that is in every credible set is found;
those that replace each other are rivals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from scara_kinetostatic.diagnosis.candidates import Candidate, CandidateSet
from scara_kinetostatic.diagnosis.linear_problem import Problem
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE, STRICT_SIGNIFICANCE
from scara_kinetostatic.model.arrays import Floats

_LARGEST = 4
"""Effects in a set at most."""
_KEPT = 12
"""Sets of each size from which larger ones are made."""
_WIDEST = 64
"""More than the columns of any effect."""
_MOST_SETS = 2000
"""Sets of one size that are kept."""
_PARALLEL = 1e-4
"""Least eigenvalue of the Gram matrix of the unit columns of a set; a direction with less adds no rank."""


class Subset(NamedTuple):
    """A set of candidates with what it achieves.

    Attributes:
        members: indices of the candidates, ascending.
        rest: residual sum of squares.
        rank: columns that the set adds.
        penalty: of its effects.
        score: deviance and penalty; lower is better.
    """

    members: tuple[int, ...]
    rest: float
    rank: int
    penalty: float
    score: float = 0.0


class ScoredSubsets(NamedTuple):
    """The result of a model selection.

    Attributes:
        candidate_set: the candidates.
        subsets: all sets scored, the best first; the empty one is among them.
        credible: those, except the empty one, that the data do not rule out, the best first.
        scale: s², the variance in units of which deviances are counted.
        penalty: of a set, from the indices of its candidates.
    """

    candidate_set: CandidateSet
    subsets: tuple[Subset, ...]
    credible: tuple[Subset, ...]
    scale: float
    penalty: Callable[[Sequence[int]], float]

    def labels(self, subset: Subset) -> tuple[str, ...]:
        """Labels of the effects of a set."""
        return tuple(self.candidate_set.candidates[k].effect.label for k in subset.members)

    def freedoms(self, subset: Subset) -> int:
        """Identifiable parameters of the effects of a set."""
        return sum(self.candidate_set.candidates[k].freedoms for k in subset.members)


def score_subsets(problem: Problem, candidate_set: CandidateSet) -> ScoredSubsets:
    """Score all singles and pairs, and larger sets made from the best ones.

    No set is credible unless its score is below that of the empty one by `CREDIBLE`.
    """
    scorer = _SubsetScorer(problem, candidate_set)
    subsets = scorer.score([()])
    layer = scorer.score([(k,) for k in range(len(candidate_set.candidates))])
    while layer:
        subsets += layer
        size = len(layer[0].members) + 1
        if size > _LARGEST:
            break
        pairs = combinations(range(len(candidate_set.candidates)), 2)
        sets = pairs if size == 2 else _grown(sorted(layer, key=lambda e: e.rest + e.penalty)[:_KEPT], scorer)
        layer = scorer.score([members for members in sets if scorer.allows(members)])
    scale = _scale(problem, subsets)
    ranked = sorted((_scored(problem, subset, scale) for subset in subsets), key=lambda subset: subset.score)
    scored_subsets = ScoredSubsets(candidate_set, tuple(ranked), (), scale, scorer.penalty)
    empty = next(subset for subset in ranked if not subset.members)
    if ranked[0].score > empty.score - CREDIBLE:
        return scored_subsets
    return scored_subsets._replace(credible=_credible(scored_subsets))


def rank_singles(problem: Problem, candidate_set: CandidateSet) -> ScoredSubsets:
    """Score single effects only, for the ranking where nothing is missing."""
    scorer = _SubsetScorer(problem, candidate_set)
    subsets = scorer.score([()]) + scorer.score([(k,) for k in range(len(candidate_set.candidates))])
    scale = _scale(problem, subsets)
    ranked = sorted((_scored(problem, subset, scale) for subset in subsets), key=lambda subset: subset.score)
    return ScoredSubsets(candidate_set, tuple(ranked), (), scale, scorer.penalty)


class _SubsetScorer:
    """Residual sums of squares of sets of candidates, from the inner products of all columns."""

    def __init__(self, problem: Problem, candidate_set: CandidateSet) -> None:
        candidates = candidate_set.candidates
        together = np.concatenate([np.empty((len(problem.left), 0)), *(c.unit for c in candidates)], axis=1)
        ends = np.cumsum([c.unit.shape[1] for c in candidates])
        self.places = [np.arange(end - c.unit.shape[1], end) for c, end in zip(candidates, ends, strict=True)]
        self.gram, self.projected = together.T @ together, together.T @ problem.left
        self.total = float(problem.left @ problem.left)
        self.touches = len(problem.left) // 2
        self.names = [c.effect.label for c in candidates]
        declared = [c.effect.label for c in candidates if problem.is_declared(c.effect)]
        self.declared = [c.effect.label in declared for c in candidates]
        self.penalties = [
            self._penalty(c, len(set(declared)), 0.0)
            if c.effect.label in declared
            else self._penalty(c, candidate_set.number, 0.0 if c.effect.is_physical else CREDIBLE)
            for c in candidates
        ]

    def _penalty(self, candidate: Candidate, number: int, more: float) -> float:
        return float(candidate.freedoms * np.log(self.touches) + 2 * np.log(number * candidate.tried)) + more

    def penalty(self, members: Sequence[int]) -> float:
        """Penalty of a set."""
        less = CREDIBLE if any(self.declared[k] for k in members) else 0.0
        return sum(self.penalties[k] for k in members) - less

    def allows(self, members: Sequence[int]) -> bool:
        """Whether no effect is in a set twice."""
        return len({self.names[k] for k in members}) == len(members)

    def score(self, sets: Sequence[tuple[int, ...]]) -> list[Subset]:
        """Residual sum of squares, rank and penalty of each set, all of one size; of very many only the best.

        Sets whose members have equally many columns, one by one, are solved together.
        """
        if not sets:
            return []
        members = np.array(sets, dtype=np.intp).reshape(len(sets), -1)
        widths = np.array([len(place) for place in self.places], dtype=np.intp)[members]
        starts = np.array([place[0] if len(place) else 0 for place in self.places], dtype=np.intp)
        explained, rank = np.zeros(len(sets)), np.zeros(len(sets), dtype=np.intp)
        code = widths @ (_WIDEST ** np.arange(widths.shape[1]))
        for pattern in np.unique(code[widths.sum(axis=1) > 0]):
            alike = np.flatnonzero(code == pattern)
            width = widths[alike[0]].tolist()
            parts = [starts[members[alike, k], None] + np.arange(w) for k, w in enumerate(width)]
            explained[alike], rank[alike] = self._solve(np.concatenate(parts, axis=1))
        rest, penalty = self.total - explained, np.array([self.penalty(each) for each in sets])
        return [
            Subset(sets[k], float(rest[k]), int(rank[k]), float(penalty[k])) for k in _promising(rest, penalty).tolist()
        ]

    def _solve(self, at: NDArray[np.intp]) -> tuple[Floats, NDArray[np.intp]]:
        """Decrease of the sum of squares by columns (s, w) of each set, and their rank, (s,) each."""
        values, vectors = np.linalg.eigh(self.gram[at[:, :, None], at[:, None, :]])
        part = np.einsum('ski,sk->si', vectors, self.projected[at])
        kept = values > _PARALLEL
        explained = np.sum(np.where(kept, part**2 / np.where(kept, values, 1.0), 0.0), axis=1)
        return np.asarray(explained), np.asarray(kept.sum(axis=1))


def _promising(rest: Floats, penalty: Floats) -> NDArray[np.intp]:
    """Which sets are kept, in their order: all of few; of very many those best by several measures."""
    if len(rest) <= _MOST_SETS:
        return np.arange(len(rest))
    logarithm = np.log(np.maximum(rest, 1e-300))
    measures = rest + penalty, rest, *(weight * logarithm + penalty for weight in (50.0, 200.0))
    best = [np.argpartition(measure, _MOST_SETS // 4)[: _MOST_SETS // 4] for measure in measures]
    return np.unique(np.concatenate(best))


def _needed(scored_subsets: ScoredSubsets, subset: Subset, best: Subset) -> bool:
    """Whether a set counts beside the best: one with a fitted curve only if it is significantly better.

    A curve that contains a physical effect as a special case always comes near it; that is no rival.
    """
    candidates = scored_subsets.candidate_set.candidates
    has_curve = [any(not candidates[k].effect.is_physical for k in e.members) for e in (subset, best)]
    if not has_curve[0] or has_curve[1]:
        return True
    gain = (best.rest - subset.rest) / scored_subsets.scale
    more = scored_subsets.freedoms(subset) - scored_subsets.freedoms(best)
    return more <= 0 or float(special.chdtrc(more, gain)) < STRICT_SIGNIFICANCE


def _has_special_case(scored_subsets: ScoredSubsets, subset: Subset) -> bool:
    """Whether a set is not significantly better than with a special case in place of one of its effects."""
    candidates = scored_subsets.candidate_set.candidates
    names = set(scored_subsets.labels(subset))
    simpler = {
        frozenset(names - {effect.label} | {case})
        for effect in (candidates[k].effect for k in subset.members)
        for case in effect.special_cases
        if case not in names
    }
    if not simpler:
        return False
    for other in scored_subsets.subsets:
        if len(other.members) == len(names) and frozenset(scored_subsets.labels(other)) in simpler:
            gain = max(other.rest - subset.rest, 0.0) / scored_subsets.scale
            more = scored_subsets.freedoms(subset) - scored_subsets.freedoms(other)
            if more <= 0 or float(special.chdtrc(more, gain)) >= STRICT_SIGNIFICANCE:
                return True
    return False


def _grown(best: Sequence[Subset], scorer: _SubsetScorer) -> set[tuple[int, ...]]:
    everyone = range(len(scorer.places))
    return {tuple(sorted((*subset.members, k))) for subset in best for k in everyone if k not in subset.members}


def _scale(problem: Problem, subsets: Sequence[Subset]) -> float:
    """s²: 1 if the noise is given and some set reduces the residual to it; else the variance left by the best set."""
    least = min(subset.rest / max(problem.freedoms - subset.rank, 1) for subset in subsets)
    return max(least, 1.0) if problem.noise_given else least


def _scored(problem: Problem, subset: Subset, scale: float) -> Subset:
    likelihood = problem.freedoms * np.log(max(subset.rest, 1e-300))
    deviance = subset.rest / scale if problem.noise_given else float(likelihood)
    return subset._replace(score=deviance + subset.penalty)


def _credible(scored_subsets: ScoredSubsets) -> tuple[Subset, ...]:
    """Sets near the best, without those that only add to a credible one, and each set of effects once."""
    found: list[Subset] = []
    some = [subset for subset in scored_subsets.subsets if subset.members]
    near = [e for e in some if e.score <= some[0].score + CREDIBLE and _needed(scored_subsets, e, some[0])]
    near = [e for e in near if not _has_special_case(scored_subsets, e)]
    for subset in sorted(near, key=lambda e: (len(e.members), e.score)):
        names = set(scored_subsets.labels(subset))
        if not any(set(scored_subsets.labels(other)) <= names for other in found):
            found.append(subset)
    return tuple(sorted(found, key=lambda subset: subset.score))
