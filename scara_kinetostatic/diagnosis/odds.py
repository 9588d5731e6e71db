"""Posterior probabilities of sets of gross effects in the linear problem at a fit.

Whitened, the misclosures of the touches are, to first order,

    y + J Δ + N e + τ Σ_g X_g u_g + Σ_(g in S) X_g v_g = ε,    e, u_g, ε ~ N(0, I),    v_g ~ N(0, s_g² I).

Every effect of the catalogue has a small part, u_g, in units of its typical size, all with a common size τ; those of
the set S are **gross**. A form is one way of being gross, an effect at one of its frequencies or moments; the prior of
an effect is shared among its forms. Whatever explains the touches and is not in the catalogue is the effect `UNNAMED`,
whose forms are smooth curves.

**Priors.** Δ is flat. τ and the gross sizes s, in typical sizes, are half-Cauchy with scales 1 and `SCALE`, on grids;
the number of gross effects has the prior `NUMBER`, and the sets of a number are alike but for `UNNAMED`. All sizes are
integrated, so that more effects have to explain more. Noise that is stated is known or, with `UNDERSTATED`, larger;
else its level is integrated, as flat in its logarithm.

**Likelihood.** J is projected off once; then only Z'MZ, Z'My and y'My of the columns Z = (N, X) count. At τ the small
parts are factorised once, K = I + W A W, which leaves of the gross columns A_V = A - A W K⁻¹ W A, and b_V alike; sets
follow from the blocks of these, one effect at a time.

**Inclusion** of an effect is the probability that it is gross: the sum over the sets with it. A set whose further
effect has a Bayes factor below `NEEDED` counts as the one without, unless this is the empty one: effects that are not
seen would take from the probability of those that are.

Source: Gelman, Bayesian Analysis 1 (2006) 515, for the priors of the sizes; Kass and Raftery, J. Am. Stat. Assoc. 90
(1995) 773, for Bayes factors.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from scara_kinetostatic.gaussian.linear_model import Projected
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


class LinearProblem(NamedTuple):
    """The touches at a fit, projected off J.

    Attributes:
        gram: Z'MZ of the small columns and then the gross ones, (c + g, c + g).
        projected: Z'My, (c + g,).
        square: y'My.
        freedoms: rows less columns of J.
        is_declared: of the small columns those whose size is given, (c,).
        noise_given: whether the noise is stated.
        constant: -2 log likelihood that all sets have in common.
        triangle: R of J = Q R, (b, b).
        of_columns: Q'Z, (b, c + g).
        of_residual: Q'y, (b,).
    """

    gram: Floats
    projected: Floats
    square: float
    freedoms: int
    is_declared: Mask
    noise_given: bool
    constant: float
    triangle: Floats
    of_columns: Floats
    of_residual: Floats

    @classmethod
    def of(
        cls, fitted: Floats, columns: Floats, residual: Floats, is_declared: Mask, noise_given: bool, constant: float
    ) -> LinearProblem:
        """Of J (rows, b), Z (rows, c + g) and y (rows,); `constant` without that of J."""
        p = Projected.of(fitted, np.column_stack([columns, residual]))
        constant += 2 * float(np.log(np.abs(np.diag(p.triangle))).sum())
        freedoms, solving = len(residual) - fitted.shape[1], (p.triangle, p.of_columns, p.of_residual)
        return cls(p.gram, p.projected, p.square, freedoms, is_declared, noise_given, constant, *solving)

    def log_likelihood(self, square: Floats, log_determinant: Floats) -> Floats:
        """Of sums of squares in the metric of the noise and all sizes, and log determinants of the latter."""
        nu = self.freedoms
        square = np.maximum(square, 1e-8 * nu)  # whitened, less is rounding
        free = -0.5 * nu * (np.log(square / nu) + 1) + 0.5 * np.log(np.pi / nu)
        if self.noise_given:
            larger = np.where(square > nu, free - np.log(np.log(_MOST_NOISE)) + np.log(UNDERSTATED), -np.inf)
            free = np.logaddexp(np.log1p(-UNDERSTATED) - 0.5 * square, larger)
        return np.asarray(free - 0.5 * log_determinant)


class _State(NamedTuple):
    """The problem at one size of the small parts.

    Attributes:
        widths: standard deviations of the small columns, (c,).
        log_prior: of this size.
        square: y'V⁻¹y without gross effects.
        log_determinant: of K.
        gram: A_V of the gross columns, (g, g).
        projected: b_V, (g,).
    """

    widths: Floats
    log_prior: float
    square: float
    log_determinant: float
    gram: Floats
    projected: Floats


class SizedSet(NamedTuple):
    """A set at given sizes.

    Attributes:
        log: its log posterior.
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


def posterior_odds(p: LinearProblem, forms: Sequence[Form], weights: Mapping[str, float] | None = None) -> Odds:
    """The probabilities of the sets of up to three effects: of none, of each alone, of the most promising others.

    Args:
        p: the linear problem.
        forms: of all effects; those of the label `UNNAMED` are curves.
        weights: prior of an effect in that of the others, by label; 1 by default.
    """
    labels = list(dict.fromkeys(form.label for form in forms))
    named = sum(label != UNNAMED for label in labels)
    weight = dict.fromkeys(labels, 1.0) | dict(weights or {})
    weight[UNNAMED] = _UNNAMED_SHARE / NUMBER[1] * max(named, 1)
    every = np.poly([-weight[label] for label in labels])[:4]  # elementary symmetric polynomials of the weights
    log_number = np.log(NUMBER[: len(every)]) - np.log(every)
    states = [_state(p, tau) for tau in _TAUS]
    total = np.logaddexp.reduce([state.log_prior for state in states])
    states = [state._replace(log_prior=state.log_prior - total) for state in states]
    scan = _Scan(p, forms, states, np.array([np.log(weight[form.label]) for form in forms]), log_number)
    log_none = float(np.logaddexp.reduce(scan.bare))
    parts = [SizedSet(log + log_number[0], frozenset(), (), (), k) for k, log in enumerate(scan.bare)]
    singles, alone = scan.integrated(np.arange(len(scan.ways))[:, None])
    alone -= scan.log_number_of(np.arange(len(scan.ways))[:, None])
    visible = _visible(scan.ways, alone, log_none)
    parts += [part for part in singles if part.labels or part.forms[0] in {scan.ways[k].form for k in visible}]
    best = [*_best_forms(forms, alone), *visible]
    if len(labels) > 1:
        pairs = scan.promising([pair for pair in combinations(best, 2) if scan.are_different(*pair)])
        found, evidence = scan.integrated(pairs)
        parts += found
        top = pairs[np.argsort(-evidence)[:_TRIPLES]]
        grown = {tuple(sorted((*pair, k))) for pair in top.tolist() for k in best if scan.are_different(*pair, k)}
        if grown and len(log_number) > 3:
            parts += scan.integrated(scan.promising(sorted(grown), 3 * _TRIPLES))[0]
    factors, likely = dict[str, float](), dict[str, int]()
    for label in labels:
        own = [k for k, form in enumerate(forms) if form.label == label]
        small = [alone[k] for k in visible if scan.ways[k].label == label]
        without = np.logaddexp.reduce([log_none, *small])
        factors[label] = float(np.logaddexp.reduce(alone[own]) - without - np.log(weight[label]))
        likely[label] = max(own, key=lambda k: alone[k])
    return _gathered(parts, log_number, weight, factors, likely, states, p.constant)


class _Way(NamedTuple):
    """A form, by number, with the label of its effect, as a gross effect or a small one."""

    form: int
    label: str
    is_small: bool


def _visible(ways: Sequence[_Way], alone: Floats, log_none: float) -> list[int]:
    """The small ways, of effects of which these together have a Bayes factor of `NEEDED`, the likeliest of each."""
    found = list[int]()
    for label in dict.fromkeys(way.label for way in ways if way.is_small):
        own = [k for k, way in enumerate(ways) if way.is_small and way.label == label]
        if np.logaddexp.reduce(alone[own]) - log_none >= np.log(NEEDED):
            found.append(max(own, key=lambda k: alone[k]))
    return found


def _best_forms(forms: Sequence[Form], alone: Floats) -> list[int]:
    """The forms that are tried together: of each effect the likeliest two, of curves the likeliest eight."""
    found = list[int]()
    for label in dict.fromkeys(form.label for form in forms):
        own = [k for k, form in enumerate(forms) if form.label == label]
        found += sorted(own, key=lambda k: -alone[k])[: 8 if label == UNNAMED else 2]
    return sorted(found)


def _solved(factor: Floats, right: Floats) -> Floats:
    """L⁻¹ B; of no rows none, which LAPACK refuses."""
    return np.asarray(lapack.dtrtrs(factor, right, lower=1)[0]) if len(factor) else right


def _state(p: LinearProblem, tau: float) -> _State:
    """At a common size of the small parts."""
    c = len(p.is_declared)
    widths = np.where(p.is_declared, 1.0, tau)
    factor = np.linalg.cholesky(np.eye(c) + widths[:, None] * p.gram[:c, :c] * widths)
    right = widths[:, None] * np.concatenate([p.gram[:c, c:], p.projected[:c, None]], axis=1)
    half = _solved(np.asarray(factor, dtype=np.float64), right)
    columns, y = half[:, :-1], half[:, -1]
    return _State(
        widths,
        float(np.log(tau / (1 + tau**2))),
        p.square - float(y @ y),
        float(2 * np.log(np.diag(factor)).sum()),
        p.gram[c:, c:] - columns.T @ columns,
        p.projected[c:] - columns.T @ y,
    )


class _Scan:
    """Likelihoods of sets of effects, sizes integrated on the grid.

    Attributes:
        ways: all forms as gross effects, then those that are placed as small ones.
        bare: log evidence of no effect at each size of the small parts.
    """

    def __init__(
        self, p: LinearProblem, forms: Sequence[Form], states: Sequence[_State], log_weight: Floats, log_number: Floats
    ) -> None:
        self.p, self.states, self.log_number = p, states, log_number
        placed = [k for k, form in enumerate(forms) if form.is_placed]
        self.ways = [_Way(k, form.label, is_small=False) for k, form in enumerate(forms)]
        self.ways += [_Way(k, forms[k].label, is_small=True) for k in placed]
        self.bare = [
            float(p.log_likelihood(np.array(s.square), np.array(s.log_determinant))) + s.log_prior for s in states
        ]
        log_share = np.log([form.share for form in forms])
        self.log_prior = np.concatenate([log_share + log_weight, log_share[placed]])
        own = [forms[way.form].columns for way in self.ways]
        self.widths = np.array([len(one) for one in own], dtype=np.intp)
        every, g = np.concatenate([*own, []]).astype(np.intp), int(self.widths.sum())
        self.places = np.full((len(own), max(self.widths, default=0)), g)  # g: a column of zeros
        first = np.cumsum(self.widths) - self.widths
        for row, begin, width in zip(self.places, first.tolist(), self.widths.tolist(), strict=True):
            row[:width] = begin + np.arange(width)
        is_small = np.repeat([way.is_small for way in self.ways], self.widths)
        self.padded = []
        for tau, state in zip(_TAUS.tolist(), states, strict=True):
            scale = np.where(is_small, tau, 1.0)
            gram = scale[:, None] * state.gram[np.ix_(every, every)] * scale
            self.padded.append((np.pad(gram, (0, 1)), np.pad(scale * state.projected[every], (0, 1))))
        x = SIZES / SCALE
        of_gross = np.log(x / (1 + x**2)) - np.log(np.sum(x / (1 + x**2)))
        self.log_size = np.tile(of_gross, (len(self.ways), 1))
        self.log_size[[way.is_small for way in self.ways]] = np.where(SIZES == 1.0, 0.0, -np.inf)  # τ is in the columns

    def are_different(self, *ways: int) -> bool:
        """Whether ways are of different effects."""
        return len({self.ways[k].label for k in ways}) == len(ways)

    def log_number_of(self, sets: Indices) -> Floats:
        """Log prior of the number of gross effects of sets of ways (m, k), (m,)."""
        is_gross = np.array([not way.is_small for way in self.ways], dtype=bool)
        return np.asarray(self.log_number[is_gross[sets].sum(axis=1)]) if len(sets) else np.zeros(0)

    def integrated(self, sets: Indices) -> tuple[list[SizedSet], Floats]:
        """The parts of sets of ways (m, k) at all sizes that count, and the log evidence of each set, (m,)."""
        m, k = sets.shape
        logs = np.full((m, len(self.states), len(SIZES) ** k), -np.inf)
        grid = (self.log_prior[sets].sum(axis=1) + self.log_number_of(sets))[:, None]
        for column in sets.T:
            grid = (grid[:, :, None] + self.log_size[column][:, None]).reshape(m, -1)
        width = self.widths[sets].max(axis=1, initial=0)
        for w in np.unique(width).tolist():
            at = np.flatnonzero(width == w)
            for number, (state, (gram, projected)) in enumerate(zip(self.states, self.padded, strict=True)):
                columns = self.places[sets[at], :w].reshape(len(at), -1)
                blocks = gram[columns[:, :, None], columns[:, None, :]], projected[columns]
                quad, log_determinant = _gains(*blocks, w, k)
                likelihood = self.p.log_likelihood(state.square - quad, state.log_determinant + log_determinant)
                logs[at, number] = likelihood + grid[at] + state.log_prior
        every = logs.reshape(m, -1)
        evidence = np.logaddexp.reduce(every, axis=1) if m else np.zeros(0)
        sizes = np.array(np.meshgrid(*(SIZES,) * k, indexing='ij')).reshape(k, -1).T
        parts = list[SizedSet]()
        most = evidence.max(initial=-np.inf)
        for row, (one, log) in enumerate(zip(sets.tolist(), evidence.tolist(), strict=True)):
            if log < most - _NEGLIGIBLE and k > 1:
                continue
            ways = [self.ways[number] for number in one]
            labels = frozenset(way.label for way in ways if not way.is_small)
            order = np.argsort(-every[row])[: _PARTS if log > most - _NEGLIGIBLE / 2 else 1]
            taken = np.exp(np.logaddexp.reduce(every[row, order]) - log)
            for place in order.tolist():  # the rest counts with these
                number, size = divmod(place, logs.shape[2])
                of_each = zip(ways, sizes[size].tolist(), strict=True)
                own = tuple(float(_TAUS[number]) if way.is_small else size for way, size in of_each)
                log_part = float(every[row, place] - np.log(taken))
                parts.append(SizedSet(log_part, labels, tuple(way.form for way in ways), own, number))
        return parts, evidence

    def promising(self, sets: Sequence[tuple[int, ...]], most: int = _PAIRS) -> Indices:
        """The sets that are likeliest at the likeliest sizes of the small parts, by one size for all gross effects."""
        every = np.array(sets, dtype=np.intp).reshape(len(sets), -1)
        k, guess, prior = every.shape[1], np.full(len(every), -np.inf), self.log_prior[every].sum(axis=1)
        prior += self.log_number_of(every)
        is_small = np.array([way.is_small for way in self.ways], dtype=bool)[every]
        width, likeliest = self.widths[every].max(axis=1, initial=0), int(np.argmax(self.bare))
        for number in {likeliest, min(likeliest, 2)}:
            state, (gram, projected) = self.states[number], self.padded[number]
            for w in np.unique(width).tolist():
                at = np.flatnonzero(width == w)
                columns = self.places[every[at], :w].reshape(len(at), -1)
                a, b = gram[columns[:, :, None], columns[:, None, :]], projected[columns]
                for size in SIZES[[2, 4, 6]].tolist():
                    scale = np.repeat(np.where(is_small[at], 1.0, size), w, axis=1)
                    inside = np.eye(k * w) + scale[:, :, None] * a * scale[:, None]
                    right = scale * b
                    quad = (right * np.linalg.solve(inside, right[..., None])[..., 0]).sum(axis=1)
                    log = self.p.log_likelihood(
                        state.square - quad, state.log_determinant + np.linalg.slogdet(inside)[1]
                    )
                    guess[at] = np.maximum(guess[at], log + prior[at])
        return every[np.argsort(-guess)[:most]]


def _gains(gram: Floats, projected: Floats, w: int, k: int) -> tuple[Floats, Floats]:
    """Decreases of the sum of squares and log determinants by k effects of w columns each at all sizes, (m, S^k).

    The first effect at each size is taken off what the others see; the sizes of the last follow from its eigenvalues.
    """
    m = len(gram)
    a, b = gram[:, None], projected[:, None]
    quad, log_determinant = np.zeros((m, 1)), np.zeros((m, 1))
    for _ in range(k - 1):
        own = a[:, :, None, :w, :w] + np.eye(w) / SIZES[:, None, None] ** 2
        right = np.concatenate([a[:, :, :w, w:], b[:, :, :w, None]], axis=-1)[:, :, None]
        solved = np.linalg.solve(own, np.broadcast_to(right, (*own.shape[:3], *right.shape[3:])))
        quad = quad[:, :, None] + (b[:, :, None, :w] * solved[..., -1]).sum(axis=-1)
        log_determinant = log_determinant[:, :, None] + np.linalg.slogdet(own)[1] + 2 * w * np.log(SIZES)
        across = a[:, :, None, w:, :w]
        a = a[:, :, None, w:, w:] - across @ solved[..., :-1]
        b = b[:, :, None, w:] - (across @ solved[..., -1:])[..., 0]
        a, b = a.reshape(m, -1, *a.shape[3:]), b.reshape(m, -1, b.shape[-1])
        quad, log_determinant = quad.reshape(m, -1), log_determinant.reshape(m, -1)
    values, vectors = np.linalg.eigh(a)
    values = np.maximum(values, 0.0)[:, :, None]
    along = (vectors.swapaxes(-1, -2) @ b[..., None])[..., 0][:, :, None]
    s2 = SIZES[:, None] ** 2
    quad = quad[:, :, None] + (s2 * along**2 / (1 + s2 * values)).sum(axis=-1)
    log_determinant = log_determinant[:, :, None] + np.log1p(s2 * values).sum(axis=-1)
    return quad.reshape(m, -1), log_determinant.reshape(m, -1)


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
        by_labels[part.labels].append(part._replace(log=part.log - total))
    logs = {labels: float(np.logaddexp.reduce([part.log for part in own])) for labels, own in by_labels.items()}
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
    p: LinearProblem, forms: Sequence[Form], states: Sequence[_State], parts: Sequence[Sequence[SizedSet]], lift: Floats
) -> list[Component]:
    """The values with each of several groups of sized sets.

    At a size of the small parts the values are normal without gross effects, with mean m and covariance C; with those
    of S, D_S (D = the change of the values by a unit of each gross column, y held), they have the mean
    m - D_S G⁻¹ b_S and the covariance C + D_S G⁻¹ D_S', G = A_V[S, S] + diag(1/s²).

    Args:
        p: the linear problem.
        forms: of the effects.
        states: of the posterior.
        parts: the sized sets of each group.
        lift: rows of values by Δ in the basis of J and the columns, (v, b + c + g).
    """
    b, c = len(p.of_residual), len(p.is_declared)
    by_base = lift[:, :b] @ linalg.solve_triangular(p.triangle, np.eye(b), check_finite=False)
    by_columns, of_base = lift[:, b:] - by_base @ p.of_columns, by_base @ p.of_residual
    plain = dict[int, tuple[Floats, Floats, Floats]]()
    for number in {part.state for group in parts for part in group}:
        width = states[number].widths
        factor = np.linalg.cholesky(np.eye(c) + width[:, None] * p.gram[:c, :c] * width)
        right = [p.gram[:c, c:], p.projected[:c, None], by_columns[:, :c].T]
        half = _solved(np.asarray(factor), width[:, None] * np.concatenate(right, axis=1))
        gross, y, rows = half[:, : len(p.gram) - c], half[:, len(p.gram) - c], half[:, len(p.gram) - c + 1 :].T
        plain[number] = -rows @ y - of_base, rows @ rows.T + by_base @ by_base.T, by_columns[:, c:] - rows @ gross
    found = list[Component]()
    for group in parts:
        means, roots, weights = list[Floats](), list[Floats](), list[Floats]()
        second, most = np.zeros((len(lift),) * 2), max(part.log for part in group)
        alike = defaultdict[tuple[int, int], list[SizedSet]](list)
        for part in group:
            alike[part.state, sum(len(forms[k].columns) for k in part.forms)].append(part)
        for (number, _), some in alike.items():
            state, (mean, covariance, change) = states[number], plain[number]
            own = [[forms[k].columns for k in part.forms] for part in some]
            columns = np.array([np.concatenate([*one, []]) for one in own], dtype=np.intp)
            each = (np.repeat(x.sizes, [len(k) for k in one]) for x, one in zip(some, own, strict=True))
            precision = np.power(np.array(list(each)), -2.0)[:, :, None] * np.eye(columns.shape[1])
            root = np.linalg.cholesky(state.gram[columns[:, :, None], columns[:, None, :]] + precision)
            right = [change[:, columns].transpose(1, 2, 0), state.projected[columns][..., None]]
            rows = np.linalg.solve(root, np.concatenate(right, axis=2))
            rows, y = rows[..., :-1], rows[..., -1:]
            noise = np.ones(len(some)) if p.noise_given else (state.square - (y**2).sum(axis=(1, 2))) / p.freedoms
            weight = np.exp([part.log - most for part in some])
            weights.append(weight)
            means.append(mean - (rows * y).sum(axis=1))
            roots.append((np.sqrt(weight * noise)[:, None, None] * rows).reshape(-1, len(lift)))
            second += (weight @ noise) * covariance
        weight, mean = np.concatenate(weights), np.concatenate(means)
        total, middle = weight.sum(), weight @ mean / weight.sum()
        rows = np.concatenate([*roots, np.sqrt(weight)[:, None] * (mean - middle)])
        found.append(Component(middle, (second + rows.T @ rows) / total))
    return found
