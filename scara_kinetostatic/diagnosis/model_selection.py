"""Which effects explain what is left: all singles and pairs, then larger sets, on equal footing.

A set of effects is judged by minus twice its logarithmic likelihood and a price per effect,

    score = deviance + Σ (m ln n + 2 ln (M t)),

with m parameters of the effect, n touches, M effects that compete and t trials of this one: the
Bayesian information criterion with a prior that takes every number of effects for equally likely
(Chen and Chen, Biometrika 95 (2008) 759). So a flexible effect pays for its parameters and a long list for its
length. Structure without a name, which can take any shape, is believed only where it is clearly better than every
physical effect: it pays `CREDIBLE` on top. The deviance is χ² where the noise is given (divided by its own size where
no set of effects comes down to that noise), and ν ln RSS where it is estimated.

Sets whose score comes within `CREDIBLE` of the best are credible too: odds of less than e⁵ decide
nothing. An effect that is in all of them is found; those that replace each other are rivals.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from scara_kinetostatic.diagnosis.candidates import Candidate, CandidateSet
from scara_kinetostatic.diagnosis.linear_problem import Problem
from scara_kinetostatic.effects.unnamed import Unnamed

Floats = NDArray[np.float64]

CREDIBLE = 10.0
"""Twice the logarithm of the odds beyond which a set of effects is out."""
LARGEST = 4
"""Effects in a set at most."""
KEPT = 12
"""Sets of each size from which larger ones are made."""
CLAIM = 1e-3
"""Chance at which unnamed structure is significantly better than a named effect."""
PARALLEL = 1e-4
"""Least eigenvalue of the unit columns of a set: less, and the data do not tell them apart."""


class Subset(NamedTuple):
    """A set of candidates with what it achieves.

    Attributes:
        members: places in the field, ascending.
        rest: sum of squares left.
        rank: columns that the set adds.
        price: Σ (m ln n + 2 ln (M t)).
        score: see above; lower is better.
    """

    members: tuple[int, ...]
    rest: float
    rank: int
    penalty: float
    score: float = 0.0


class ScoredSubsets(NamedTuple):
    """The outcome.

    Attributes:
        field: who competed.
        entries: sets examined, the best first; the empty one is among them.
        credible: those, the empty one apart, that the data do not rule out, the best first.
        scale: s², the size of the noise in which deviances are counted.
    """

    candidate_set: CandidateSet
    subsets: tuple[Subset, ...]
    credible: tuple[Subset, ...]
    scale: float

    def labels(self, subset: Subset) -> tuple[str, ...]:
        """Labels of an entry's effects."""
        return tuple(self.candidate_set.candidates[k].effect.label for k in subset.members)

    def freedoms(self, subset: Subset) -> int:
        """Parameters of an entry's effects that can show."""
        return sum(self.candidate_set.candidates[k].freedoms for k in subset.members)


def score_subsets(problem: Problem, candidate_set: CandidateSet) -> ScoredSubsets:
    """Examine all singles and pairs, and larger sets made from the best ones.

    No set is credible unless it beats the empty one by `CREDIBLE`.
    """
    scorer = _SubsetScorer(problem, candidate_set)
    subsets = scorer.enter([()])
    layer = scorer.enter([(k,) for k in range(len(candidate_set.candidates))])
    while layer:
        subsets += layer
        size = len(layer[0].members) + 1
        if size > LARGEST:
            break
        pairs = combinations(range(len(candidate_set.candidates)), 2)
        sets = pairs if size == 2 else _grown(sorted(layer, key=lambda e: e.rest + e.penalty)[:KEPT], scorer)
        layer = scorer.enter([members for members in sets if scorer.allows(members)])
    scale = _scale(problem, subsets)
    ranked = sorted((_scored(problem, subset, scale) for subset in subsets), key=lambda subset: subset.score)
    scored_subsets = ScoredSubsets(candidate_set, tuple(ranked), (), scale)
    empty = next(subset for subset in ranked if not subset.members)
    if ranked[0].score > empty.score - CREDIBLE:
        return scored_subsets
    return scored_subsets._replace(credible=_credible(scored_subsets))


def rank_singles(problem: Problem, candidate_set: CandidateSet) -> ScoredSubsets:
    """Examine single effects only: where nothing is missing, that is all there is to say."""
    scorer = _SubsetScorer(problem, candidate_set)
    subsets = scorer.enter([(), *((k,) for k in range(len(candidate_set.candidates)))])
    scale = _scale(problem, subsets)
    ranked = sorted((_scored(problem, subset, scale) for subset in subsets), key=lambda subset: subset.score)
    return ScoredSubsets(candidate_set, tuple(ranked), (), scale)


class _SubsetScorer:
    """Sums of squares of any set, from the inner products of all columns."""

    def __init__(self, problem: Problem, candidate_set: CandidateSet) -> None:
        candidates = candidate_set.candidates
        together = np.concatenate([np.empty((len(problem.left), 0)), *(c.unit for c in candidates)], axis=1)
        ends = np.cumsum([c.unit.shape[1] for c in candidates])
        self.places = [np.arange(end - c.unit.shape[1], end) for c, end in zip(candidates, ends, strict=True)]
        self.gram, self.projected = together.T @ together, together.T @ problem.left
        self.total = float(problem.left @ problem.left)
        self.touches = len(problem.left) // 2
        self.names = [c.effect.label for c in candidates]
        self.prices = [self._penalty(c, candidate_set.number) for c in candidates]

    def _penalty(self, candidate: Candidate, number: int) -> float:
        penalty = candidate.freedoms * np.log(self.touches) + 2 * np.log(number * candidate.tried)
        return float(penalty) + (CREDIBLE if isinstance(candidate.effect, Unnamed) else 0.0)

    def allows(self, members: Sequence[int]) -> bool:
        """Whether no effect is in a set twice."""
        return len({self.names[k] for k in members}) == len(members)

    def enter(self, sets: Sequence[tuple[int, ...]]) -> list[Subset]:
        """What each set achieves; sets with equally many columns are worked out together."""
        columns = [np.concatenate([np.empty(0, dtype=np.intp), *(self.places[k] for k in s)]) for s in sets]
        widths = np.array([len(c) for c in columns])
        explained, rank = np.zeros(len(sets)), np.zeros(len(sets), dtype=np.intp)
        for width in np.unique(widths[widths > 0]):
            alike = np.flatnonzero(widths == width)
            at = np.stack([columns[k] for k in alike])
            values, vectors = np.linalg.eigh(self.gram[at[:, :, None], at[:, None, :]])
            part = np.einsum('ski,sk->si', vectors, self.projected[at])
            seen = values > PARALLEL
            explained[alike] = np.sum(np.where(seen, part**2 / np.where(seen, values, 1.0), 0.0), axis=1)
            rank[alike] = seen.sum(axis=1)
        return [
            Subset(members, self.total - float(gain), int(r), sum(self.prices[k] for k in members))
            for members, gain, r in zip(sets, explained, rank, strict=True)
        ]


def _needed(scored_subsets: ScoredSubsets, subset: Subset, best: Subset) -> bool:
    """Whether a set has a claim beside the best: one with unnamed structure only if it is significantly better.

    A curve that holds a named effect as a special case always comes near it; that is no rival.
    """
    unnamed = [
        any(isinstance(scored_subsets.candidate_set.candidates[k].effect, Unnamed) for k in e.members)
        for e in (subset, best)
    ]
    if not unnamed[0] or unnamed[1]:
        return True
    gain, more = (
        (best.rest - subset.rest) / scored_subsets.scale,
        scored_subsets.freedoms(subset) - scored_subsets.freedoms(best),
    )
    return more <= 0 or float(special.chdtrc(more, gain)) < CLAIM


def _grown(best: Sequence[Subset], scorer: _SubsetScorer) -> set[tuple[int, ...]]:
    everyone = range(len(scorer.places))
    return {tuple(sorted((*subset.members, k))) for subset in best for k in everyone if k not in subset.members}


def _scale(problem: Problem, subsets: Sequence[Subset]) -> float:
    """s²: 1 if the noise is given and some set comes down to it; else what the best set leaves per freedom."""
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
    warm_start = [e for e in some if e.score <= some[0].score + CREDIBLE and _needed(scored_subsets, e, some[0])]
    for subset in sorted(warm_start, key=lambda e: (len(e.members), e.score)):
        names = set(scored_subsets.labels(subset))
        if not any(set(scored_subsets.labels(other)) <= names for other in found):
            found.append(subset)
    return tuple(sorted(found, key=lambda subset: subset.score))
