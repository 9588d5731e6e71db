"""The sets of effects that explain a fit, weighed (`diagnosis.odds`), and the values by each of them.

The small columns of the linear problem are those of the mixed model: declared errors, and the small part of every
effect in its typical size. The gross ones are those of the candidates, an effect at each of its likely trials, in the
same unit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.calibration.fit_point import Point, select
from scara_kinetostatic.calibration.result import Alternative
from scara_kinetostatic.diagnosis.candidates import Candidate, CandidateSet, all_candidates, significance
from scara_kinetostatic.diagnosis.linear_problem import Problem, fitted_effects, pose_problem
from scara_kinetostatic.diagnosis.mixed_model import MixedModel, amplitudes, trusted_rows
from scara_kinetostatic.diagnosis.odds import (
    NEEDED,
    UNNAMED,
    Form,
    Labels,
    LinearProblem,
    Odds,
    SizedSet,
    components,
    posterior_odds,
)
from scara_kinetostatic.diagnosis.result import Ranked
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.effects.undetected import columns_of, derivatives, typical_size
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import ArmClass, SizeMode

_CURVE = 2e-6
"""Typical size of a curve, rad or m."""
_SPECIAL = 0.02
"""Prior of an effect that contains another one of the catalogue, in that of the others."""
LEAST = 1e-3
"""Probability below which a set of effects does not count."""


class Mixture(NamedTuple):
    """The values by the sets of effects.

    Attributes:
        alternatives: by each.
        unseen: what effects that are not seen add to their mean covariance, (12 + k + m + r, 12 + k + m + r).
    """

    alternatives: tuple[Alternative, ...]
    unseen: Floats


class Weighed(NamedTuple):
    """The posterior at a fit.

    Attributes:
        model: the fit.
        problem: the linear problem at it.
        candidates: the effects, each in one or several forms.
        forms: of the candidates, in their order.
        linear: the problem projected, with the columns.
        odds: the posterior.
        lift: from the changes of L̄ in the basis of the fit and the values of all columns to all values of the model,
            declared errors and random effects, (12 + k + m + r, b + c + g); NaN of gross columns that these lack.
    """

    model: MixedModel
    problem: Problem
    candidates: CandidateSet
    forms: tuple[Form, ...]
    linear: LinearProblem
    odds: Odds
    lift: Floats

    @property
    def deviance(self) -> float:
        """-2 log likelihood of the touches, with all sets."""
        return -2 * self.odds.log_evidence + self.model.rejected

    def likeliest(self, excluded: frozenset[str]) -> list[Candidate]:
        """The effects of the likeliest set without some labels, in their likeliest forms."""
        labels = next((x for x in self.odds.probabilities if not excluded & x), frozenset[str]())
        return [self.candidates.candidates[k] for k in self.odds.parts[labels][0].forms]

    def likeliest_of(self, members: Sequence[Candidate]) -> list[Candidate]:
        """That of some effects which is the likeliest alone."""
        labels = (item.effect.label if item.effect.is_physical else UNNAMED for item in members)
        return [self.single(max(labels, key=lambda label: self.odds.bayes_factors[label]))]

    def single(self, label: str) -> Candidate:
        """An effect in its likeliest form."""
        return self.candidates.candidates[self.odds.best[label]]

    def ranking(self, roles: Mapping[str, str]) -> tuple[Ranked, ...]:
        """Every effect by itself, the likeliest first, with its role by label, ``rejected`` by default."""
        found = []
        for label in sorted(self.odds.best, key=lambda one: -self.odds.bayes_factors[one]):
            candidate, gain = self.single(label), 2 * self.odds.bayes_factors[label]
            role = roles.get(candidate.effect.label, 'rejected')
            tested = significance(self.problem, candidate)
            found.append(Ranked(candidate.effect, role, *tested, gain, candidate.independent_part))
        return (*found, *self.candidates.unidentifiable)

    @property
    def _sets(self) -> dict[Labels, list[Labels]]:
        """The sets by what the touches show, each with those that count with it: an effect that is not seen, as its
        Bayes factor alone is small, counts with none.
        """
        odds, sets = self.odds, {frozenset[str](): [frozenset[str]()]}
        for labels in odds.probabilities:
            is_seen = len(labels) != 1 or odds.bayes_factors[next(iter(labels))] >= np.log(NEEDED)
            sets.setdefault(labels if is_seen else frozenset(), []).extend(odds.merged[labels] if labels else ())
        of_set = {labels: sum(odds.probabilities.get(one, 0.0) for one in merged) for labels, merged in sets.items()}
        return {labels: merged for labels, merged in sets.items() if of_set[labels] >= LEAST}

    def mixture(self) -> Mixture:
        """The values by each set of at least `LEAST` of which they can be stated; empty where there is none."""
        b, c = len(self.linear.of_residual), len(self.linear.is_declared)
        known, fit, odds = np.asarray(np.isfinite(self.lift).all(axis=0)), self.model.fit, self.odds
        named, probabilities = list[Labels](), list[float]()
        own, with_unseen = list[list[SizedSet]](), list[list[SizedSet]]()
        for labels, merged in self._sets.items():
            every = [
                [part for part in odds.parts[x] if all(known[b + c + self.forms[k].columns].all() for k in part.forms)]
                for x in merged
            ]
            together = _likeliest_parts([part for some in every for part in some])
            if every[0]:
                named.append(labels)
                own.append(every[0])
                with_unseen.append(together)
                probabilities.append(sum(odds.probabilities.get(x, 0.0) for x in merged))
        if not named:
            return Mixture((), np.zeros((len(self.lift),) * 2))
        weight, lift = np.array(probabilities) / sum(probabilities), np.nan_to_num(self.lift)
        found = components(self.linear, self.forms, odds.states, [*with_unseen, *own], lift)
        found, alone = found[: len(named)], found[len(named) :]
        now, less = np.concatenate([amplitudes(fit), fit.errors, fit.random_values]), np.zeros((len(lift),) * 2)
        if fit.used.sum() > len(self.problem.force):  # some touches say how the sets differ, all where the fit is
            of_fit = {effect.label for effect, _, _ in fitted_effects(fit)}
            first = max(range(len(named)), key=lambda k: (named[k] == of_fit, weight[k]))
            now, less = found[first].mean, found[first].covariance - fit.covariance_with_errors / fit.enlargement
        unseen = np.tensordot(weight, [a.covariance - b.covariance for a, b in zip(found, alone, strict=True)], 1)
        alternatives = (
            Alternative(tuple(sorted(labels)), p, item.mean - now, item.covariance - less)
            for labels, p, item in zip(named, weight.tolist(), found, strict=True)
        )
        return Mixture(tuple(alternatives), unseen)


def _likeliest_parts(parts: Sequence[SizedSet]) -> list[SizedSet]:
    """Those that are not negligible beside the likeliest of them."""
    most = max((part.log for part in parts), default=0.0)
    return [part for part in parts if part.log > most + np.log(LEAST)]


def weigh(model: MixedModel, known: Sequence[Effect]) -> Weighed:
    """Weigh the sets of effects of the catalogue at a fit."""
    c, problem = model.fit, pose_problem(model.fit, model.level)
    arm, point = c.cell.uncertainty.effects.arm, problem.point
    rows, m, size = point.whitened.residual.size, len(c.errors), len(c.model.names)
    every = all_candidates(problem, known)
    kept = every.candidates
    by_errors = np.zeros((rows, 0)) if point.whitened.by_errors is None else point.whitened.by_errors.reshape(rows, -1)
    by_effects = point.whitened.derivative.reshape(rows, -1)
    own = amplitudes(c)
    y = point.whitened.residual.ravel() - by_errors @ np.concatenate([c.errors, c.random_values]) - by_effects @ own

    trials = [item.trial for item in kept]
    fitted = {effect: len(values) for effect, values, _ in fitted_effects(c) if len(values)}
    units = [trial_units(item.effect, item.trial, arm) for item in kept]
    for item, unit in zip(kept, units, strict=True):
        if item.effect not in fitted:  # what the arm contains of an effect counts where it is named
            unit[[p.is_alias for p in item.effect.parameters][: len(unit)]] = 0.0
    gross = problem.changes(*trials) * np.concatenate([*units, []])
    columns = np.split(np.arange(gross.shape[1]), np.cumsum([len(unit) for unit in units])[:-1])
    of_gross = np.full((size + by_errors.shape[1], gross.shape[1]), np.nan)
    labels = np.array([] if c.random is None else [column.effect.label for column in c.random.columns])
    declared, kept_random = c.observe().declared, np.ones(len(labels), dtype=bool)
    fresh, beside = list[tuple[Indices, Floats, Mask]](), [np.zeros((rows, 0))]
    for item, unit, at in zip(kept, units, columns, strict=True):
        own_random = np.flatnonzero(labels == item.effect.label)
        own_errors = _errors_of(item.effect, declared, m + own_random)
        if item.effect in fitted:
            first = next(k for k, name in enumerate(c.model.names) if name.startswith(f'{item.effect.label}.'))
            places = first + np.arange(fitted[item.effect])
            amount = np.linalg.lstsq(gross[:, at], by_effects[:, places] @ own[places], rcond=None)[0] * unit
            of_gross[:, at] = 0.0
            of_gross[np.ix_(places, at)] = _by_coefficients(item.trial, amount) * unit
            if c.cell.uncertainty.effects.sizes is not SizeMode.ESTIMATED or len(own_errors):
                continue  # of what is declared the small part is that
            if item.effect.grid_parameter:  # small, it is where undetected effects are, not at the place found
                beside.append(_small_part(problem, item.effect, arm))
            else:
                fresh.append((at, np.ones(len(at)), np.zeros(len(at), dtype=bool)))
        elif len(own_errors):
            found = np.linalg.lstsq(by_errors[:, own_errors], gross[:, at], rcond=1e-6)[0]
            of_gross[:, at] = 0.0
            of_gross[np.ix_(size + own_errors, at)] = found
            if len(own_random) and not item.effect.grid_parameter:  # those of the fit are where it began
                at = at[: len(own_random)]
                assert c.random is not None
                widths = (c.random.size * model.typical)[own_random] / unit[: len(at)]
                fresh.append((at, widths, ~model.is_free[own_random]))
                kept_random[own_random] = False
    mine = np.concatenate([*(at for at, _, _ in fresh), []]).astype(np.intp)
    widths = np.concatenate([*(part for _, part, _ in fresh), []])
    stays = np.concatenate([np.ones(m, dtype=bool), kept_random])
    by_small = np.concatenate([np.ones(m), model.typical])
    small = np.concatenate([(by_errors * by_small)[:, stays], gross[:, mine] * widths, *beside], axis=1)
    of_errors = np.pad(np.diag(by_small), ((size, 0), (0, 0)))[:, stays]
    of_small = np.concatenate([of_errors, of_gross[:, mine] * widths], axis=1)
    of_small = np.pad(of_small, ((0, 0), (0, small.shape[1] - of_small.shape[1])))
    of_base = np.zeros((len(of_small), problem.jacobian.shape[1]))
    of_base[: c.model.base_count] = problem.identifiable
    is_declared = np.concatenate([np.ones(m, dtype=bool), ~model.is_free])[stays]
    is_declared = np.concatenate([is_declared, *(part for _, _, part in fresh)]).astype(bool)
    is_declared = np.pad(is_declared, (0, small.shape[1] - len(is_declared)))

    behind, off = trusted_rows(c, problem.identifiable)
    zeros = np.zeros((len(behind), small.shape[1] + gross.shape[1]))
    linear = LinearProblem.of(
        np.concatenate([problem.jacobian, behind]),
        np.concatenate([np.concatenate([small, gross], axis=1), zeros]),
        np.concatenate([y, off]),
        is_declared,
        problem.noise_given,
        _log_determinant(point) + _log_determinant(select(c.projection, ~c.used)),
    )
    shares = _shares(kept)
    forms = tuple(
        Form(item.effect.label if item.effect.is_physical else UNNAMED, at, share)
        for item, at, share in zip(kept, columns, shares, strict=True)
    )
    present = {form.label for form in forms}
    weights = {item.effect.label: _SPECIAL for item in kept if present & set(item.effect.special_cases)}
    odds = posterior_odds(linear, forms, weights)
    lift = np.concatenate([of_base, of_small, of_gross], axis=1)
    return Weighed(model, problem, every, forms, linear, odds, lift)


def _errors_of(effect: Effect, declared: DeclaredErrors | None, random: Indices) -> Indices:
    """Which of the declared errors and random effects an effect is: its own random ones, or the error declared."""
    places = {} if declared is None else declared.places
    return random if len(random) else places.get(effect.declared_as or effect.label, random)


def _small_part(problem: Problem, effect: Effect, arm: ArmClass) -> Floats:
    """The whitened columns by which an effect is there undetected, in its typical size, (2n, k)."""
    at = problem.touch_state
    columns = columns_of(effect, at)
    size = [typical_size(effect, column.parameter, arm) for column in columns]
    changes = problem.changes(Trial(derivatives(columns, at)))
    return changes * np.array(size) / max(len({column.values for column in columns}), 1) ** 0.5


def _log_determinant(point: Point) -> float:
    """Of the variances of the noise."""
    l11, _, l22 = point.whitened.root
    return 2 * float(np.log(l11 * l22).sum())


def _shares(candidates: Sequence[Candidate]) -> Floats:
    """Of each candidate in the prior of its effect, at most 1 together; the curves are one effect."""
    share = np.array([item.share for item in candidates])
    names = np.array([item.effect.label if item.effect.is_physical else UNNAMED for item in candidates])
    curves = names == UNNAMED
    share[curves] /= max(curves.sum(), 1)
    for name in set(names.tolist()):
        share[names == name] /= max(share[names == name].sum(), 1.0)
    return share


def trial_units(effect: Effect, trial: Trial, arm: ArmClass) -> Floats:
    """The coefficients of a trial, (m,), by which the effect has its typical size."""
    if not effect.is_physical:
        return np.full(len(trial.columns), _CURVE)
    units = []
    for coefficients in np.eye(len(trial.columns)):
        sizes = np.abs(effect.amplitudes(np.asarray(trial.values(coefficients))))
        typical = [size / typical_size(effect, k, arm) for k, size in enumerate(sizes.tolist())]
        units.append(1 / max(typical))
    return np.array(units)


def _by_coefficients(trial: Trial, at: Floats) -> Floats:
    """Derivative of the values of an effect by the coefficients of a trial (m,), (k, m)."""
    step = 1e-4 * max(float(np.abs(at).max()), 1e-9)
    ends = [(np.asarray(trial.values(at + one)), np.asarray(trial.values(at - one))) for one in step * np.eye(len(at))]
    return np.array([(after - before) / (2 * step) for after, before in ends]).T
