"""Model selection: which set of effects explains the residual best, from all singles and pairs and larger sets.

A set of effects is scored by its deviance and a penalty per effect,

    score = deviance + Σ (m ln n + 2 ln (M t)),

with m parameters of the effect, n touches, M candidate effects and t trials of this one: the extended Bayesian
information criterion, whose prior takes every number of effects for equally likely (Chen and Chen, Biometrika 95
(2008) 759). A fitted curve, which can take any shape, is accepted only where it is clearly better than every physical
effect: its penalty is larger by `CREDIBLE`. What is declared to be uncertain is the first to be wrong: one effect
alone by which something exceeds its declared uncertainty has a penalty smaller by `CREDIBLE`, and M counts such
effects only. Two of them at once, or one beside another effect, are no likelier than other pairs. What explains the
touches better without that preference is not ruled out by it. The deviance is χ²
where the noise is given (divided by s² where no set of effects reduces it to that noise), and ν ln RSS where it is
estimated.

Sets whose score is within `CREDIBLE` of the best are credible, too. An effect that is in every credible set is found;
those that replace each other are rivals. What is searched of a single effect, a moment or a frequency, is penalised by
its trials and as a parameter; it is no rival only where it would be none by its trials alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.diagnosis.candidates import Candidate, CandidateSet
from scara_kinetostatic.diagnosis.linear_problem import CREDIBLE, STRICT_SIGNIFICANCE, Problem, f_test
from scara_kinetostatic.diagnosis.result import Ranked
from scara_kinetostatic.model.arrays import Floats, Indices, pick

_MOST_SETS = 2000
"""Sets of one size that are kept."""
_PARALLEL = 1e-4
"""Least eigenvalue of the Gram matrix of the unit columns of a set; a direction with less adds no rank."""


class Subset(NamedTuple):
    """A set of candidates with what it achieves.

    Attributes:
        members: the candidates, in the order of all.
        rest: residual sum of squares.
        penalty: of its effects.
        score: deviance and penalty; lower is better.
        unpreferred: the score that it would have if nothing were declared.
    """

    members: tuple[Candidate, ...]
    rest: float
    penalty: float
    score: float
    unpreferred: float

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of its effects."""
        return tuple(candidate.effect.label for candidate in self.members)

    @property
    def freedoms(self) -> int:
        """Identifiable parameters of its effects."""
        return sum(candidate.freedoms for candidate in self.members)


class ScoredSubsets(NamedTuple):
    """The result of a model selection.

    Attributes:
        unidentifiable: effects that are in no set.
        subsets: the empty set, all of one candidate, and those near the best, the best first.
        credible: those, except the empty one, that the data do not rule out, the best first.
        scale: s², the variance in units of which deviances are counted.
    """

    unidentifiable: tuple[Ranked, ...]
    subsets: tuple[Subset, ...]
    credible: tuple[Subset, ...]
    scale: float

    @property
    def empty(self) -> Subset:
        """The set without effects."""
        return next(subset for subset in self.subsets if not subset.members)


def score_subsets(problem: Problem, candidate_set: CandidateSet, together: bool = True) -> ScoredSubsets:
    """Score all singles and pairs, and larger sets made from the best ones; not together, singles only.

    No set is credible unless its score is below that of the empty one by `CREDIBLE`.
    """
    scorer = _SubsetScorer(problem, candidate_set)
    number = len(candidate_set.candidates)
    layers = [scorer.score(sets) for sets in (np.empty((1, 0), dtype=np.intp), np.arange(number)[:, None])]
    if together:
        layers.append(scorer.score(scorer.allowed(np.transpose(np.triu_indices(number, 1)))))
    while together and len(layers[-1].members) and len(layers) <= 4:
        layers.append(scorer.score(scorer.allowed(_grown(layers[-1], number))))
    scored_subsets = _ranked(problem, candidate_set, layers, scorer.less)
    if not together or scored_subsets.subsets[0].score > scored_subsets.empty.score - CREDIBLE:
        return scored_subsets
    return scored_subsets._replace(credible=_credible(scored_subsets, len(problem.left) // 2))


class _Layer(NamedTuple):
    """Sets of one size.

    Attributes:
        members: indices of the candidates of each set, ascending, (s, k).
        rest: residual sums of squares, (s,).
        rank: columns that each set adds, (s,).
        penalty: of each set, (s,).
        preference: by how much this is smaller, as it is what is declared, (s,).
    """

    members: Indices
    rest: Floats
    rank: Indices
    penalty: Floats
    preference: Floats


class _SubsetScorer:
    """Residual sums of squares of sets of candidates, from the inner products of all columns."""

    def __init__(self, problem: Problem, candidate_set: CandidateSet) -> None:
        candidates = candidate_set.candidates
        together = np.concatenate([np.empty((len(problem.left), 0)), *(c.unit for c in candidates)], axis=1)
        self.gram, self.projected = together.T @ together, together.T @ problem.left
        self.places = _places([c.unit.shape[1] for c in candidates])
        self.total = float(problem.left @ problem.left)
        labels, self.effects = np.unique([c.effect.label for c in candidates], return_inverse=True)
        stated, number = {c.effect.label for c in candidates if problem.is_stated(c.effect)}, len(labels)
        self.declared = np.array([c.effect.label in stated for c in candidates], dtype=bool)
        self.penalties = np.array(
            [
                float(c.freedoms * np.log(len(problem.left) // 2) + 2 * np.log(number * c.tried))
                + (0.0 if c.effect.is_physical else CREDIBLE)
                for c in candidates
            ]
        )
        self.less = CREDIBLE + 2 * np.log(number / max(len(stated), 1))

    def allowed(self, sets: Indices) -> Indices:
        """Those of the sets (s, k) in which no effect is twice."""
        return sets[np.diff(np.sort(self.effects[sets], axis=1), axis=1).all(axis=1)]

    def score(self, sets: Indices) -> _Layer:
        """Residual sum of squares, rank and penalty of each set (s, k); of very many only the best.

        Sets with equally many columns are solved together.
        """
        columns = np.sort(self.places[sets].reshape(len(sets), sets.shape[1] * self.places.shape[1]), axis=1)
        width = (columns < len(self.gram)).sum(axis=1)
        explained, rank = np.zeros(len(sets)), np.zeros(len(sets), dtype=np.intp)
        for w in np.unique(width[width > 0]).tolist():
            alike = np.flatnonzero(width == w)
            explained[alike], rank[alike] = self._solve(columns[alike, :w])
        rest, preference = self.total - explained, np.zeros(len(sets))
        if sets.shape[1] == 1:
            preference[self.declared[sets[:, 0]]] = self.less
        layer = _Layer(sets, rest, rank, self.penalties[sets].sum(axis=1) - preference, preference)
        return pick(layer, _promising(rest, layer.penalty))

    def _solve(self, at: Indices) -> tuple[Floats, Indices]:
        """Decrease of the sum of squares by columns (s, w) of each set, and their rank, (s,) each.

        The eigenvalues of a Gram matrix of w unit columns add up to w. So the product of all but the least is less than
        e, and only where the determinant is less than e `_PARALLEL` the least may be less than `_PARALLEL`.
        """
        gram, projected = self.gram[at[:, :, None], at[:, None, :]], self.projected[at]
        explained, rank = np.empty(len(at)), np.full(len(at), at.shape[1])
        doubtful = np.linalg.det(gram) < math.e * _PARALLEL
        explained[doubtful], rank[doubtful] = _explained_by_independent(gram[doubtful], projected[doubtful])
        gram, projected = gram[~doubtful], projected[~doubtful]
        coefficients = np.linalg.solve(gram, projected[:, :, None])[:, :, 0]
        explained[~doubtful] = (projected * coefficients).sum(axis=1)
        return explained, rank


def _explained_by_independent(gram: Floats, projected: Floats) -> tuple[Floats, Indices]:
    """Decrease of the sum of squares without the directions that add no rank, and the rank, (s,) each.

    Args:
        gram: inner products of the columns of each set, (s, w, w).
        projected: those of the columns with y, (s, w).
    """
    values, vectors = np.linalg.eigh(gram)
    part = np.einsum('ski,sk->si', vectors, projected)
    kept = values > _PARALLEL
    explained = np.sum(np.where(kept, part**2 / np.where(kept, values, 1.0), 0.0), axis=1)
    return np.asarray(explained), np.asarray(kept.sum(axis=1))


def _places(widths: Sequence[int]) -> Indices:
    """The columns of each candidate in the matrix of all, (M, largest width); the number of all columns for none."""
    columns = np.arange(max(widths, default=0))
    starts = np.cumsum([0, *widths])
    return np.where(columns < np.array(widths)[:, None], starts[:-1, None] + columns, starts[-1])


def _promising(rest: Floats, penalty: Floats) -> Indices:
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
    has_curve, best_has = (any(not c.effect.is_physical for c in e.members) for e in (subset, best))
    if not has_curve or best_has or subset.freedoms <= best.freedoms:
        return True
    return _is_significantly_better(scored_subsets, subset, best)


def _is_significantly_better(scored_subsets: ScoredSubsets, subset: Subset, other: Subset) -> bool:
    gain = (other.rest - subset.rest) / scored_subsets.scale
    more = subset.freedoms - other.freedoms
    return float(special.chdtrc(max(more, 1), max(gain, 0.0))) < STRICT_SIGNIFICANCE


def _is_replaced(subset: Subset, near: Sequence[Subset]) -> bool:
    """Whether, with a special case in place of an effect of a set, another set is the same or needs fewer effects."""
    return any(
        set(other.labels) < case or (set(other.labels) == case and other.freedoms >= subset.freedoms)
        for case in special_cases(subset.members)
        for other in near
    )


def special_cases(members: Sequence[Candidate]) -> set[frozenset[str]]:
    """The sets, by labels, with a special case in place of one of the effects."""
    names = {candidate.effect.label for candidate in members}
    cases = [(candidate.effect.label, case) for candidate in members for case in candidate.effect.special_cases]
    return {frozenset(names - {label} | {case}) for label, case in cases if case not in names}


def _grown(layer: _Layer, number: int) -> Indices:
    """The best sets of a layer, each with each of the candidates, (s, k + 1)."""
    best = layer.members[np.argsort(layer.rest + layer.penalty, kind='stable')[:12]]
    more = np.tile(np.arange(number), len(best))[:, None]
    return np.unique(np.sort(np.concatenate([np.repeat(best, number, axis=0), more], axis=1), axis=1), axis=0)


def _ranked(problem: Problem, candidate_set: CandidateSet, layers: Sequence[_Layer], near: float) -> ScoredSubsets:
    """The sets of all layers, scored, the best first; of larger ones those whose score is so near to the best."""
    rest, rank, penalty, preference = (np.concatenate([layer[k] for layer in layers]) for k in (1, 2, 3, 4))
    members = [row for layer in layers for row in layer.members]
    scale = _scale(problem, rest, rank)
    deviance = rest / scale if problem.noise_given else problem.freedoms * np.log(np.maximum(rest, 1e-300))
    score = deviance + penalty
    limit = score.min() + near
    order = [k for k in np.argsort(score, kind='stable').tolist() if len(members[k]) < 2 or score[k] <= limit]
    columns = (values[order].tolist() for values in (rest, penalty, score, score + preference))
    sets = (tuple(candidate_set.candidates[j] for j in members[k]) for k in order)
    subsets = tuple(Subset(*row) for row in zip(sets, *columns, strict=True))
    return ScoredSubsets(candidate_set.unidentifiable, subsets, (), scale)


def _scale(problem: Problem, rest: Floats, rank: Indices) -> float:
    """s²: 1 if the noise is given and some set reduces the residual to it; else the variance left by the best set."""
    least = float((rest / np.maximum(problem.freedoms - rank, 1)).min())
    return max(least, 1.0) if problem.noise_given else least


def _credible(scored_subsets: ScoredSubsets, touches: int) -> tuple[Subset, ...]:
    """Sets near the best, without those that only add to a credible one, and each set of effects once."""
    found: list[Subset] = []
    best, *others = [subset for subset in scored_subsets.subsets if subset.members]
    near = [best]
    for subset in others:
        twice = subset.members[0].searched * np.log(touches) if len(subset.members) == 1 else 0.0
        if subset.score - twice <= best.score + CREDIBLE or subset.unpreferred < best.unpreferred:
            near.append(subset)
    near = [e for e in near if _needed(scored_subsets, e, best)]
    near = [e for e in near if not _is_replaced(e, near)]
    for subset in sorted(near, key=lambda e: (len(e.members), e.score)):
        if not any(set(other.labels) <= set(subset.labels) for other in found):
            found.append(subset)
    return tuple(sorted(found, key=lambda subset: subset.score))


def significance(problem: Problem, candidate: Candidate) -> tuple[float, float]:
    """F-test of one candidate (Bonferroni over its trials), and the part of the sum of squares it explains.

    A fitted effect may add nothing that is independent of the base model; then it is not significant.
    """
    p_value, share = f_test(candidate.unit, problem.left, problem.freedoms) or (1.0, 0.0)
    return min(1.0, candidate.tried * p_value), share
