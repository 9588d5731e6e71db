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

from scara_kinetostatic.diagnosis.candidates import Candidate, Field
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


class Entry(NamedTuple):
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
    price: float
    score: float = 0.0


class Contest(NamedTuple):
    """The outcome.

    Attributes:
        field: who competed.
        entries: sets examined, the best first; the empty one is among them.
        credible: those, the empty one apart, that the data do not rule out, the best first.
        scale: s², the size of the noise in which deviances are counted.
    """

    field: Field
    entries: tuple[Entry, ...]
    credible: tuple[Entry, ...]
    scale: float

    def labels(self, entry: Entry) -> tuple[str, ...]:
        """Labels of an entry's effects."""
        return tuple(self.field.candidates[k].effect.label for k in entry.members)

    def freedoms(self, entry: Entry) -> int:
        """Parameters of an entry's effects that can show."""
        return sum(self.field.candidates[k].freedoms for k in entry.members)


def compete(problem: Problem, field: Field) -> Contest:
    """Examine all singles and pairs, and larger sets made from the best ones.

    No set is credible unless it beats the empty one by `CREDIBLE`.
    """
    judge = _Judge(problem, field)
    entries = judge.enter([()])
    layer = judge.enter([(k,) for k in range(len(field.candidates))])
    while layer:
        entries += layer
        size = len(layer[0].members) + 1
        if size > LARGEST:
            break
        pairs = combinations(range(len(field.candidates)), 2)
        sets = pairs if size == 2 else _grown(sorted(layer, key=lambda e: e.rest + e.price)[:KEPT], judge)
        layer = judge.enter([members for members in sets if judge.allows(members)])
    scale = _scale(problem, entries)
    ranked = sorted((_scored(problem, entry, scale) for entry in entries), key=lambda entry: entry.score)
    contest = Contest(field, tuple(ranked), (), scale)
    empty = next(entry for entry in ranked if not entry.members)
    if ranked[0].score > empty.score - CREDIBLE:
        return contest
    return contest._replace(credible=_credible(contest))


def rank_singles(problem: Problem, field: Field) -> Contest:
    """Examine single effects only: where nothing is missing, that is all there is to say."""
    judge = _Judge(problem, field)
    entries = judge.enter([(), *((k,) for k in range(len(field.candidates)))])
    scale = _scale(problem, entries)
    ranked = sorted((_scored(problem, entry, scale) for entry in entries), key=lambda entry: entry.score)
    return Contest(field, tuple(ranked), (), scale)


class _Judge:
    """Sums of squares of any set, from the inner products of all columns."""

    def __init__(self, problem: Problem, field: Field) -> None:
        candidates = field.candidates
        together = np.concatenate([np.empty((len(problem.left), 0)), *(c.unit for c in candidates)], axis=1)
        ends = np.cumsum([c.unit.shape[1] for c in candidates])
        self.places = [np.arange(end - c.unit.shape[1], end) for c, end in zip(candidates, ends, strict=True)]
        self.gram, self.projected = together.T @ together, together.T @ problem.left
        self.total = float(problem.left @ problem.left)
        self.touches = len(problem.left) // 2
        self.names = [c.effect.label for c in candidates]
        self.prices = [self._price(c, field.number) for c in candidates]

    def _price(self, candidate: Candidate, number: int) -> float:
        price = candidate.freedoms * np.log(self.touches) + 2 * np.log(number * candidate.tried)
        return float(price) + (CREDIBLE if isinstance(candidate.effect, Unnamed) else 0.0)

    def allows(self, members: Sequence[int]) -> bool:
        """Whether no effect is in a set twice."""
        return len({self.names[k] for k in members}) == len(members)

    def enter(self, sets: Sequence[tuple[int, ...]]) -> list[Entry]:
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
            Entry(members, self.total - float(gain), int(r), sum(self.prices[k] for k in members))
            for members, gain, r in zip(sets, explained, rank, strict=True)
        ]


def _needed(contest: Contest, entry: Entry, best: Entry) -> bool:
    """Whether a set has a claim beside the best: one with unnamed structure only if it is significantly better.

    A curve that holds a named effect as a special case always comes near it; that is no rival.
    """
    unnamed = [any(isinstance(contest.field.candidates[k].effect, Unnamed) for k in e.members) for e in (entry, best)]
    if not unnamed[0] or unnamed[1]:
        return True
    gain, more = (best.rest - entry.rest) / contest.scale, contest.freedoms(entry) - contest.freedoms(best)
    return more <= 0 or float(special.chdtrc(more, gain)) < CLAIM


def _grown(best: Sequence[Entry], judge: _Judge) -> set[tuple[int, ...]]:
    everyone = range(len(judge.places))
    return {tuple(sorted((*entry.members, k))) for entry in best for k in everyone if k not in entry.members}


def _scale(problem: Problem, entries: Sequence[Entry]) -> float:
    """s²: 1 if the noise is given and some set comes down to it; else what the best set leaves per freedom."""
    least = min(entry.rest / max(problem.freedoms - entry.rank, 1) for entry in entries)
    return max(least, 1.0) if problem.noise_given else least


def _scored(problem: Problem, entry: Entry, scale: float) -> Entry:
    likelihood = problem.freedoms * np.log(max(entry.rest, 1e-300))
    deviance = entry.rest / scale if problem.noise_given else float(likelihood)
    return entry._replace(score=deviance + entry.price)


def _credible(contest: Contest) -> tuple[Entry, ...]:
    """Sets near the best, without those that only add to a credible one, and each set of effects once."""
    found: list[Entry] = []
    some = [entry for entry in contest.entries if entry.members]
    near = [e for e in some if e.score <= some[0].score + CREDIBLE and _needed(contest, e, some[0])]
    for entry in sorted(near, key=lambda e: (len(e.members), e.score)):
        names = set(contest.labels(entry))
        if not any(set(contest.labels(other)) <= names for other in found):
            found.append(entry)
    return tuple(sorted(found, key=lambda entry: entry.score))
