"""Posterior probabilities of sets of gross effects in the linear problem at a fit.

Whitened, the misclosures of the touches are, to first order,

    y + J Δ + N e + τ Σ_g X_g u_g + Σ_(g in S) X_g v_g = ε,    e, u_g, ε ~ N(0, I),    v_g ~ N(0, s_g² I).

Every effect of the catalogue has a small part, u_g, in units of its typical size, all with a common size τ; those of
the set S are **gross**. A form is one way of being gross, an effect at one of its frequencies or moments; the prior of
an effect is shared among its forms. Whatever explains the touches and is not in the catalogue is the effect `UNNAMED`,
whose forms are smooth curves.

**Ways.** A set is one of *ways*: a form as a gross effect, or, behind all these, a form that `is_placed` as a small
one: small, an effect of unknown frequency may be at this place instead of at all of them. Small ways have the size τ.

**Priors.** Δ is flat. τ and the gross sizes s, in typical sizes, are half-Cauchy with scales 1 and `SCALE`, on grids;
the number of gross effects has the prior `NUMBER`, and the sets of a number are alike but for `UNNAMED`. All sizes are
integrated, so that more effects have to explain more. Noise that is stated is known or, with `UNDERSTATED`, larger;
else its level is integrated, as flat in its logarithm.

**Likelihood.** J is projected off once; then only Z'MZ, Z'My and y'My of the columns Z = (N, X) count. At τ the small
parts are factorised once, K = I + W A W, which leaves of the gross columns A_V = A - A W K⁻¹ W A, and b_V alike; sets
follow from the blocks of these, one column at a time.

**Inclusion** of an effect is the probability that it is gross: the sum over the sets with it. A set whose further
effect has a Bayes factor below `NEEDED` counts as the one without, unless this is the empty one: effects that are not
seen would take from the probability of those that are.

Source: Gelman, Bayesian Analysis 1 (2006) 515, for the priors of the sizes; Kass and Raftery, J. Am. Stat. Assoc. 90
(1995) 773, for Bayes factors.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.linalg import blas

from scara_kinetostatic.model.arrays import Floats, Indices, Mask

UNNAMED = 'unnamed'
"""Label of what is outside the catalogue."""
SIZES = np.geomspace(1.0, 128.0, 8)
"""Of gross effects, in typical ones: the grid on which they are integrated."""
SCALE = 5.0
"""Of the half-Cauchy prior of these."""
NUMBER = np.array([0.5, 0.35, 0.1, 0.05])
"""Prior of none, one, two and three gross effects."""
_TAUS = np.geomspace(0.1, 3.2, 6)
"""Common sizes of the small parts, in typical ones: the grid on which they are integrated."""
_UNNAMED_SHARE = 0.01
"""Prior of a single effect outside the catalogue."""
UNDERSTATED = 0.05
"""Prior of stated noise that is too small, by up to `_MOST_NOISE`."""
_MOST_NOISE = 10.0
NEEDED = 3.0
"""Bayes factor from which on a further effect is seen. Source: Kass and Raftery, "positive" evidence."""
_PAIRS, _TRIPLES = 60, 8
"""The most promising pairs, which are integrated; those of them that grow by one effect, of which three times as many
sets are.
"""
_NEGLIGIBLE = 12.0
"""Log of the part of the likeliest set below which a set of several effects does not count."""
_PARTS = 6
"""Sizes with which the values of a set are averaged."""

Labels = frozenset[str]


class Form(NamedTuple):
    """One way in which an effect may be gross.

    Attributes:
        label: of the effect.
        columns: places of its columns among the gross ones.
        share: of it in the prior of its effect, 0 to 1.
        is_placed: whether it is at one place of many, a frequency or a friction, where the small columns of its effect
            are at all of them: small, it may be at this one as well.
    """

    label: str
    columns: Indices
    share: float
    is_placed: bool = False


class OddsProblem(NamedTuple):
    """The touches at a fit, projected off J.

    Attributes:
        gram: Z'MZ of the small columns and then the gross ones, with Z'My and y'My behind, (c + g + 1, c + g + 1).
        freedoms: rows less columns of J.
        is_declared: of the small columns those whose size is given, (c,).
        noise_given: whether the noise is stated.
        constant: -2 log likelihood that all sets have in common.
        triangle: R of J = Q R, (b, b).
        along: Q'Z and Q'y, (b, c + g + 1).
    """

    gram: Floats
    freedoms: int
    is_declared: Mask
    noise_given: bool
    constant: float
    triangle: Floats
    along: Floats

    @classmethod
    def of(
        cls, fitted: Floats, columns: Floats, residual: Floats, is_declared: Mask, noise_given: bool, constant: float
    ) -> OddsProblem:
        """Of J (rows, b), Z (rows, c + g) and y (rows,); `constant` without that of J."""
        base, triangle = np.linalg.qr(fitted)
        beside = np.column_stack([columns, residual])
        along = base.T @ beside
        beside -= base @ along
        constant += 2 * float(np.log(np.abs(np.diag(triangle))).sum())
        freedoms = len(residual) - fitted.shape[1]
        return cls(beside.T @ beside, freedoms, is_declared, noise_given, constant, triangle, along)

    def log_likelihood(self, square: Floats, log_determinant: Floats) -> Floats:
        """Of sums of squares in the metric of the noise and all sizes, arrays, and log determinants of the latter."""
        nu, square = self.freedoms, np.maximum(square, 1e-8 * self.freedoms)  # whitened, less is rounding
        if not self.noise_given:
            return self._of_unknown_noise(square) - 0.5 * log_determinant
        log = np.log1p(-UNDERSTATED) - 0.5 * square
        too_large = square > nu
        larger = self._of_unknown_noise(square[too_large]) + np.log(UNDERSTATED / np.log(_MOST_NOISE))
        log[too_large] = np.logaddexp(log[too_large], larger)
        return np.asarray(log - 0.5 * log_determinant)

    def _of_unknown_noise(self, square: Floats) -> Floats:
        nu = self.freedoms
        return np.asarray(-0.5 * nu * (np.log(square / nu) + 1) + 0.5 * np.log(np.pi / nu))


class _State(NamedTuple):
    """The problem at one size of the small parts.

    Attributes:
        widths: standard deviations of the small columns, W, (c,).
        factor: L of K = L L', (c, c).
        half: L⁻¹ W A of the gross columns, with that of y behind, (c, g + 1).
        gram: A_V of the gross columns, with b_V and y'V⁻¹y behind, (g + 1, g + 1).
    """

    widths: Floats
    factor: Floats
    half: Floats
    gram: Floats


class SizedSet(NamedTuple):
    """A set at given sizes.

    Attributes:
        log: its log posterior, not normalised.
        labels: of its gross effects.
        forms: theirs, and those of small effects that are at one place.
        sizes: of these.
        state: the size of the small parts by number.
    """

    log: float
    labels: Labels
    forms: tuple[int, ...]
    sizes: tuple[float, ...]
    state: int


class Odds(NamedTuple):
    """The posterior.

    Attributes:
        probabilities: of sets of labels, the likeliest first.
        merged: of each of these the sets that count with it, itself the first.
        parts: of every set, those merged too, at its sizes, the likeliest first.
        log_evidence: of the touches with all sets together.
        bayes_factors: of each effect alone against none, by label, logarithms.
        best: of each effect alone the likeliest form, by label.
        states: by number.
    """

    probabilities: dict[Labels, float]
    merged: dict[Labels, list[Labels]]
    parts: dict[Labels, list[SizedSet]]
    log_evidence: float
    bayes_factors: dict[str, float]
    best: dict[str, int]
    states: list[_State]

    @property
    def inclusion(self) -> dict[str, float]:
        """The probability of each effect to be gross."""
        found = defaultdict[str, float](float)
        for labels, probability in self.probabilities.items():
            for label in labels:
                found[label] += probability
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    @property
    def none(self) -> float:
        """The probability that no effect is gross."""
        return self.probabilities.get(frozenset(), 0.0)


def posterior_odds(p: OddsProblem, forms: Sequence[Form], weights: Mapping[str, float] | None = None) -> Odds:
    """The probabilities of the sets of up to three effects: of none, of each alone, of the most promising others.

    Args:
        p: the linear problem.
        forms: of all effects; those of the label `UNNAMED` are curves.
        weights: prior of an effect in that of the others, by label; 1 by default.
    """
    by_label = defaultdict[str, list[int]](list)
    for k, form in enumerate(forms):
        by_label[form.label].append(k)
    weight = dict.fromkeys(by_label, 1.0) | dict(weights or {})
    weight[UNNAMED] = _UNNAMED_SHARE / NUMBER[1] * max(len(by_label.keys() - {UNNAMED}), 1)
    every = np.poly([-weight[label] for label in by_label])[:4]  # elementary symmetric polynomials of the weights
    log_number = np.log(NUMBER[: len(every)]) - np.log(every)
    states = [_state(p, tau) for tau in _TAUS.tolist()]
    scan = _Scan(p, forms, states, np.log([weight[form.label] for form in forms]), log_number)
    log_none = float(np.logaddexp.reduce(scan.bare))
    parts = [SizedSet(log + log_number[0], frozenset(), (), (), k) for k, log in enumerate(scan.bare.tolist())]
    ways = np.arange(len(scan.form))[:, None]
    singles, alone = scan.integrated(ways)
    alone -= scan.log_number_of(ways)
    small = defaultdict[str, list[int]](list)
    for k in range(len(forms), len(ways)):
        small[forms[scan.form[k]].label].append(k)
    # small at one place, of effects of which these together have a Bayes factor of `NEEDED`, the likeliest of each
    visible = {
        label: max(own, key=lambda k: alone[k])
        for label, own in small.items()
        if np.logaddexp.reduce(alone[own]) - log_none >= np.log(NEEDED)
    }
    seen = {int(scan.form[k]) for k in visible.values()}
    parts += [part for part in singles if part.labels or part.forms[0] in seen]
    # tried together: of each effect the likeliest two forms, of curves the likeliest eight
    likeliest = {label: sorted(own, key=lambda k: -alone[k]) for label, own in by_label.items()}
    best = sorted(k for label, own in likeliest.items() for k in own[: 8 if label == UNNAMED else 2])
    best += visible.values()
    if len(by_label) > 1:
        pairs = scan.promising(np.array(list(combinations(best, 2))), _PAIRS)
        found, evidence = scan.integrated(pairs)
        parts += found
        top = pairs[np.argsort(-evidence)[:_TRIPLES]]
        grown = {tuple(sorted((*pair, k))) for pair in top.tolist() for k in best if k not in pair}
        if grown and len(log_number) > 3:
            parts += scan.integrated(scan.promising(np.array(sorted(grown)), 3 * _TRIPLES))[0]
    factors = dict[str, float]()
    for label, own in by_label.items():
        without = np.logaddexp(log_none, alone[visible[label]]) if label in visible else log_none
        factors[label] = float(np.logaddexp.reduce(alone[own]) - without - np.log(weight[label]))
    likely = {label: own[0] for label, own in likeliest.items()}
    return _gathered(parts, log_number, weight, factors, likely, states, p.constant)


def _solved(factor: Floats, right: Floats) -> Floats:
    """L⁻¹ B; of no rows none, which BLAS refuses."""
    return np.asarray(blas.dtrsm(1.0, factor.T, right.T, side=1).T) if len(factor) else right


def _state(p: OddsProblem, tau: float) -> _State:
    """At a common size of the small parts."""
    c = len(p.is_declared)
    widths = np.where(p.is_declared, 1.0, tau)
    factor = np.asarray(np.linalg.cholesky(np.eye(c) + widths[:, None] * p.gram[:c, :c] * widths), dtype=np.float64)
    half = _solved(factor, widths[:, None] * p.gram[:c, c:])
    explained = half.T @ half
    return _State(widths, factor, half, np.subtract(p.gram[c:, c:], explained, out=explained))


class _Scan:
    """Likelihoods of sets of effects, sizes integrated on the grid.

    Its ways are all forms as gross effects, then those that are placed as small ones.

    Attributes:
        form: of each way, by number, (v,).
        bare: log evidence of no effect at each size of the small parts, (t,).
    """

    def __init__(
        self, p: OddsProblem, forms: Sequence[Form], states: Sequence[_State], log_weight: Floats, log_number: Floats
    ) -> None:
        self.p, self.forms, self.log_number = p, forms, log_number
        placed = [k for k, form in enumerate(forms) if form.is_placed]
        self.form = np.array([*range(len(forms)), *placed], dtype=np.intp)
        self.is_small = np.append(np.arange(len(self.form)) >= len(forms), False)
        self.effect = np.unique([form.label for form in forms], return_inverse=True)[1][self.form]
        prior = _TAUS / (1 + _TAUS**2)
        self.log_tau = np.log(prior / prior.sum())
        self.grams = [state.gram for state in states]
        self.log_determinant = np.array([2 * np.log(np.diag(state.factor)).sum() for state in states])
        self.bare = (
            p.log_likelihood(np.array([gram[-1, -1] for gram in self.grams]), self.log_determinant) + self.log_tau
        )
        log_share = np.log([form.share for form in forms])
        self.log_prior = np.concatenate([log_share + log_weight, log_share[placed]])
        own = [*(forms[k].columns for k in self.form), np.array([len(states[0].gram) - 1])]  # behind all ways y
        self.widths = np.array([len(one) for one in own], dtype=np.intp)
        self.columns, self.first = np.concatenate(own).astype(np.intp), np.cumsum(self.widths) - self.widths
        x = SIZES / SCALE
        of_gross = np.log(x / (1 + x**2)) - np.log(np.sum(x / (1 + x**2)))
        # the size of a small one is τ, whatever the place on the grid: the first counts
        self.log_size = np.where(self.is_small[:-1, None], np.where(SIZES == 1.0, 0.0, -np.inf), of_gross)

    def log_number_of(self, sets: Indices) -> Floats:
        """Log prior of the number of gross effects of sets of ways (m, k), (m,)."""
        return np.asarray(self.log_number[(~self.is_small[sets]).sum(axis=1)])

    def _alike(self, sets: Indices, states: Indices) -> Iterator[tuple[Indices, list[int], Floats]]:
        """Those of sets of ways (m, k) whose widths are the same, by number, these widths, and A_V of their columns at
        some sizes of the small parts, with b_V and y'V⁻¹y behind, (w + 1, w + 1, t, m).
        """
        kind = self.widths[sets] @ (1 + self.widths.max()) ** np.arange(sets.shape[1])
        sets = np.column_stack([sets, np.full(len(sets), len(self.form))])
        for one in np.unique(kind):
            at = np.flatnonzero(kind == one)
            each = self.widths[sets[at[0]]]
            ways, number = np.repeat(sets[at].T, each, axis=0), np.concatenate([np.arange(w) for w in each])
            columns = self.columns[self.first[ways] + number[:, None]]
            place = columns[:, None] * len(self.grams[0]) + columns
            yield at, each[:-1].tolist(), np.stack([self.grams[state].take(place) for state in states], axis=2)

    def integrated(self, sets: Indices) -> tuple[list[SizedSet], Floats]:
        """The parts of sets of ways (m, k) at all sizes that count, and the log evidence of each set, (m,)."""
        # `logs` has an axis for the size of each way, the last way first, then that of τ, then that of the sets
        (m, k), every = sets.shape, np.arange(len(self.grams))
        order = np.argsort(-self.widths[sets], axis=1, kind='stable')  # the narrowest is left out at most sizes
        sets, back = np.take_along_axis(sets, order, axis=1), np.argsort(order, axis=1)
        grid = (len(SIZES),) * k + (len(every),)
        logs = np.empty((*grid, m))
        for at, widths, gram in self._alike(sets, every):
            log_determinant = self.log_determinant[:, None]
            for way, w in zip(sets[at].T, widths, strict=True):
                sizes = np.where(self.is_small[way], _TAUS[:, None], SIZES[:, None, None])
                sizes = sizes.reshape(-1, *(1,) * (gram.ndim - 4), *sizes.shape[1:])
                gram, log_determinant = _without(gram[:, :, None], log_determinant, w, sizes)
            logs[..., at] = self.p.log_likelihood(gram[0, 0], log_determinant)
        logs += self.log_tau[:, None] + self.log_prior[sets].sum(axis=1) + self.log_number_of(sets)
        for axis, column in enumerate(sets.T):
            logs += self.log_size[column].T.reshape(-1, *(1,) * (axis + 1), m)
        flat, most = logs.reshape(-1, m).T, logs.reshape(-1, m).max(axis=0)
        evidence = most + np.log(np.exp(logs - most).reshape(-1, m).sum(axis=0))
        places = np.argpartition(-flat, _PARTS, axis=1)[:, :_PARTS]
        places = np.take_along_axis(places, np.argsort(-np.take_along_axis(flat, places, axis=1), axis=1), axis=1)
        *of_each, state = np.unravel_index(places, grid)
        sizes = np.where(self.is_small[sets][..., None], _TAUS[state][:, None], SIZES[np.stack(of_each[::-1], axis=1)])
        sizes, sets = np.take_along_axis(sizes, back[..., None], axis=1), np.take_along_axis(sets, back, axis=1)
        highest, flat = evidence.max(initial=-np.inf), np.take_along_axis(flat, places, axis=1)
        number = np.where(evidence > highest - _NEGLIGIBLE / 2, _PARTS, 1)
        taken = np.logaddexp.accumulate(flat, axis=1)[np.arange(m), number - 1]
        flat = flat + (evidence - taken)[:, None]  # the rest counts with these
        each = (flat.tolist(), sizes.swapaxes(1, 2).tolist(), state.tolist())
        parts = list[SizedSet]()
        for row in np.flatnonzero((evidence >= highest - _NEGLIGIBLE) | (k == 1)).tolist():
            ways = sets[row]
            forms = tuple(self.form[ways].tolist())
            gross = frozenset(self.forms[form].label for form in self.form[ways[~self.is_small[ways]]])
            some = zip(*(one[row][: number[row]] for one in each), strict=True)
            parts += [SizedSet(log, gross, forms, tuple(size), place) for log, size, place in some]
        return parts, evidence

    def promising(self, sets: Indices, most: int) -> Indices:
        """The sets that are likeliest at the likeliest sizes of the small parts, by one size for all gross effects."""
        effects = np.sort(self.effect[sets], axis=1)
        sets = sets[(np.diff(effects) > 0).all(axis=1)]  # of different effects
        sets = np.take_along_axis(sets, np.argsort(-self.widths[sets], axis=1, kind='stable'), axis=1)
        guess, likeliest = np.empty(len(sets)), int(np.argmax(self.bare))
        states = np.unique([likeliest, min(likeliest, 2)])
        for at, widths, gram in self._alike(sets, states):
            gram, log_determinant = gram[:, :, None], self.log_determinant[states, None]
            for way, w in zip(sets[at].T, widths, strict=True):
                sizes = np.where(self.is_small[way], _TAUS[states, None], SIZES[[2, 4, 6], None, None])
                gram, log_determinant = _without(gram, log_determinant, w, sizes)
            guess[at] = self.p.log_likelihood(gram[0, 0], log_determinant).max(axis=(0, 1))
        guess += self.log_prior[sets].sum(axis=1) + self.log_number_of(sets)
        return sets[np.argsort(-guess)[:most]]


def _without(gram: Floats, log_determinant: Floats, width: int, sizes: Floats) -> tuple[Floats, Floats]:
    """A_V, b_V and y'V⁻¹y, (c, c, ...), without the first columns, and the log determinants, (...), where these are a
    gross effect of some sizes, (...).
    """
    pivots, least = list[Floats](), sizes**-2.0
    for _ in range(width):
        pivots.append(np.maximum(gram[0, 0] + least, least))
        taken = gram[1:, :1] * (gram[:1, 1:] / pivots[-1])
        gram = np.subtract(gram[1:, 1:], taken, out=taken)
    return gram, log_determinant + np.log(np.array(pivots) / least).sum(axis=0)


def _gathered(
    parts: Sequence[SizedSet],
    log_number: Floats,
    weight: Mapping[str, float],
    factors: dict[str, float],
    likely: dict[str, int],
    states: list[_State],
    constant: float,
) -> Odds:
    """The posterior by sets of labels; supersets that are not needed are merged."""
    total = float(np.logaddexp.reduce([part.log for part in parts]))
    by_labels = defaultdict[Labels, list[SizedSet]](list)
    for part in parts:
        by_labels[part.labels].append(part)
    logs = {labels: float(np.logaddexp.reduce([part.log for part in own])) - total for labels, own in by_labels.items()}
    priors = {labels: log_number[len(labels)] + sum(np.log(weight[x]) for x in sorted(labels)) for labels in logs}
    merged_into = {labels: [labels] for labels in logs}
    for labels in sorted(logs, key=len, reverse=True):
        fewer = [labels - {x} for x in sorted(labels) if len(labels) > 1 and labels - {x} in logs]
        if not fewer:
            continue
        best = max(fewer, key=lambda one: logs[one] - priors[one])
        if logs[labels] - priors[labels] - (logs[best] - priors[best]) < np.log(NEEDED):
            # the prior of the smaller set stays, so that what is merged does not count as evidence for it
            merged = float(np.logaddexp(logs[best], logs.pop(labels)))
            priors[best] += merged - logs[best]
            logs[best] = merged
            merged_into[best] += merged_into.pop(labels)
    order = sorted(logs, key=lambda labels: -logs[labels])
    probabilities = {labels: float(np.exp(logs[labels])) for labels in order}
    kept = {labels: sorted(own, key=lambda part: -part.log) for labels, own in by_labels.items()}
    return Odds(probabilities, merged_into, kept, total - 0.5 * constant, factors, likely, states)


class Component(NamedTuple):
    """The values with some sized sets, by their probabilities: mean, (v,), and covariance, (v, v)."""

    mean: Floats
    covariance: Floats


def components(
    p: OddsProblem, forms: Sequence[Form], states: Sequence[_State], parts: Sequence[Sequence[SizedSet]], lift: Floats
) -> list[Component]:
    """The values with each of several groups of sized sets.

    At a size of the small parts the values are normal without gross effects, with mean m and covariance C; with those
    of S, D_S (D = the change of the values by a unit of each gross column, y held), they have the mean
    m - D_S G⁻¹ b_S and the covariance C + D_S G⁻¹ D_S', G = A_V[S, S] + diag(1/s²). Over the sized sets of a group,
    with their probabilities, mean and covariance are those of the mixture (law of total variance).

    Args:
        p: the linear problem.
        forms: of the effects.
        states: of the posterior.
        parts: the sized sets of each group.
        lift: rows of values by Δ in the basis of J and the columns, (v, b + c + g).
    """
    b, c = len(p.along), len(p.is_declared)
    by_base = lift[:, :b] @ linalg.solve_triangular(p.triangle, np.eye(b), check_finite=False)
    by_columns = np.pad(lift[:, b:], ((0, 0), (0, 1))) - by_base @ p.along  # the last: the mean without gross effects
    of_base, small = by_base @ by_base.T, dict[int, Floats]()
    for number in {part.state for group in parts for part in group}:
        state = states[number]
        small[number] = _solved(state.factor, state.widths[:, None] * by_columns[:, :c].T).T
    without = {number: of_base + by_small @ by_small.T for number, by_small in small.items()}
    alike = defaultdict[tuple[int, int], list[SizedSet]](list)
    for part in dict.fromkeys(chain(*parts)):
        alike[part.state, sum(len(forms[k].columns) for k in part.forms)].append(part)
    solved = dict[SizedSet, tuple[Floats, Floats, float]]()  # mean, roots of the covariance beside C, factor of both
    for (number, _), some in alike.items():
        gram = states[number].gram
        own = [[forms[k].columns for k in part.forms] for part in some]
        columns = np.array([np.concatenate([*one, []]) for one in own], dtype=np.intp)
        sizes = (np.repeat(x.sizes, [len(k) for k in one]) for x, one in zip(some, own, strict=True))
        precision = np.power(np.array(list(sizes)), -2.0)[:, :, None] * np.eye(columns.shape[1])
        root = np.linalg.cholesky(gram[columns[:, :, None], columns[:, None, :]] + precision)
        places = np.append(columns, len(gram) - 1)
        *change, middle = (by_columns[:, c + places] - small[number] @ states[number].half[:, places]).T
        right = [np.reshape(change, (*columns.shape, len(lift))), gram[columns, -1:]]
        rows = np.linalg.solve(root, np.concatenate(right, axis=2))
        rows, y = rows[..., :-1], rows[..., -1:]
        noise = np.ones(len(some)) if p.noise_given else (gram[-1, -1] - (y**2).sum(axis=(1, 2))) / p.freedoms
        mean = middle - (rows * y).sum(axis=1)
        solved |= zip(some, zip(mean, np.sqrt(noise)[:, None, None] * rows, noise.tolist(), strict=True), strict=True)
    found = list[Component]()
    for group in parts:
        weight = np.exp(np.array([part.log for part in group]) - max(part.log for part in group))
        weight /= weight.sum()
        means, roots, noise = zip(*(solved[part] for part in group), strict=True)
        middle, off = weight @ np.array(means), np.sqrt(weight)
        of_state = np.bincount([part.state for part in group], weight * noise, len(states))
        covariance = sum(of_state[number] * without[number] for number in np.flatnonzero(of_state).tolist())
        each = (x * rows for x, rows in zip(off, roots, strict=True))
        scatter = np.concatenate([*each, off[:, None] * (np.array(means) - middle)])
        found.append(Component(middle, covariance + scatter.T @ scatter))
    return found
