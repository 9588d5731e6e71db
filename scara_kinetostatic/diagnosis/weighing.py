"""The sets of effects that explain a fit, weighed (`diagnosis.odds`), and the values by each of them.

The small columns of the linear problem are those of the mixed model: declared errors, and the small part of every
effect in its typical size. The gross ones are those of the candidates, an effect at each of its likely trials, in the
same unit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import Point, select
from scara_kinetostatic.calibration.observations import DeclaredErrors
from scara_kinetostatic.calibration.result import Alternative
from scara_kinetostatic.diagnosis.candidates import Candidate, CandidateSet, all_candidates, significance
from scara_kinetostatic.diagnosis.linear_problem import LinearProblem, fitted_effects, pose_problem
from scara_kinetostatic.diagnosis.mixed_model import MixedModel, amplitudes, trusted_rows
from scara_kinetostatic.diagnosis.odds import (
    NEEDED,
    UNNAMED,
    Form,
    Labels,
    Odds,
    OddsProblem,
    SizedSet,
    components,
    posterior_odds,
)
from scara_kinetostatic.diagnosis.result import Ranked
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.effects.unnamed import columns_of, derivatives
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
        undetected: what effects that are not seen add to their mean covariance, (12 + k + m + r, 12 + k + m + r).
    """

    alternatives: tuple[Alternative, ...]
    undetected: Floats


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
    problem: LinearProblem
    candidates: CandidateSet
    forms: tuple[Form, ...]
    linear: OddsProblem
    odds: Odds
    lift: Floats

    @property
    def deviance(self) -> float:
        """-2 log likelihood of the touches, with all sets."""
        return -2 * self.odds.log_evidence + self.model.rejected

    def likeliest(self, excluded: frozenset[str]) -> list[Candidate]:
        """The effects of the likeliest set without some labels, in their likeliest forms; small ones too."""
        labels = next((x for x in self.odds.probabilities if not excluded & x), frozenset[str]())
        likely = self.odds.parts[labels][0].forms
        return [self.candidates.candidates[k] for k in likely if self.forms[k].label not in excluded]

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
        b, c = len(self.linear.along), len(self.linear.is_declared)
        known = np.asarray(np.isfinite(self.lift[:, b + c :]).all(axis=0))
        fit, odds = self.model.fit, self.odds
        is_known = [known[form.columns].all() for form in self.forms]
        named, probabilities = list[Labels](), list[float]()
        own, with_undetected = list[list[SizedSet]](), list[list[SizedSet]]()
        for labels, merged in self._sets.items():
            every = [[part for part in odds.parts[x] if all(is_known[k] for k in part.forms)] for x in merged]
            together = _likeliest_parts([part for some in every for part in some])
            if every[0]:
                named.append(labels)
                own.append(_likeliest_parts(every[0]))
                with_undetected.append(together)
                probabilities.append(sum(odds.probabilities.get(x, 0.0) for x in merged))
        if not named:
            return Mixture((), np.zeros((len(self.lift),) * 2))
        weight, lift = np.array(probabilities) / sum(probabilities), np.nan_to_num(self.lift)
        found = components(self.linear, self.forms, odds.states, [*with_undetected, *own], lift)
        found, alone = found[: len(named)], found[len(named) :]
        values, surplus = np.concatenate([amplitudes(fit), fit.errors, fit.random_values]), np.zeros((len(lift),) * 2)
        if fit.used.sum() > len(self.problem.force):  # of many touches some say how the sets differ, all where it is
            of_fit = {effect.label for effect, _ in fitted_effects(fit)}
            first = max(range(len(named)), key=lambda k: (named[k] == of_fit, weight[k]))
            values, surplus = found[first].mean, found[first].covariance - fit.covariance_with_errors / fit.enlargement
        undetected = np.tensordot(weight, [a.covariance - b.covariance for a, b in zip(found, alone, strict=True)], 1)
        alternatives = (
            Alternative(tuple(sorted(labels)), p, item.mean - values, item.covariance - surplus)
            for labels, p, item in zip(named, weight.tolist(), found, strict=True)
        )
        return Mixture(tuple(alternatives), undetected)


def _likeliest_parts(parts: Sequence[SizedSet]) -> list[SizedSet]:
    """Those that are not negligible beside the likeliest of them."""
    most = max((part.log for part in parts), default=0.0)
    return [part for part in parts if part.log > most + np.log(LEAST)]


class _Columns(NamedTuple):
    """Columns of the linear problem.

    Attributes:
        changes: of the whitened misclosures by each, (2n, k).
        of_values: of all values of the model, declared errors and random effects, (12 + k + m + r, k); NaN of gross
            effects that are neither named nor among the random ones.
        is_declared: whether the size of each is given, (k,).
    """

    changes: Floats
    of_values: Floats
    is_declared: Mask


def weigh(model: MixedModel, known: Sequence[Effect]) -> Weighed:
    """Weigh the sets of effects of the catalogue at a fit."""
    c, problem = model.fit, pose_problem(model.fit, model.level)
    point, rows = problem.point, problem.point.whitened.residual.size
    every = all_candidates(problem, known)
    by_errors = np.zeros((rows, 0)) if point.whitened.by_errors is None else point.whitened.by_errors.reshape(rows, -1)
    by_effects, own = point.whitened.derivative.reshape(rows, -1), amplitudes(c)
    y = point.whitened.residual.ravel() - by_errors @ np.concatenate([c.errors, c.random_values]) - by_effects @ own
    gross, places = _gross_columns(problem, every.candidates, by_errors, by_effects * own)
    small = _small_columns(
        model, problem, by_errors, [(item.effect, at) for item, at in zip(every.candidates, places, strict=True)], gross
    )
    behind, off = trusted_rows(c, problem.identifiable)
    columns = np.concatenate([small.changes, gross.changes], axis=1)
    linear = OddsProblem.of(
        np.concatenate([problem.jacobian, behind]),
        np.pad(columns, ((0, len(behind)), (0, 0))),
        np.concatenate([y, off]),
        small.is_declared,
        problem.noise_given,
        _log_determinant(point) + _log_determinant(select(c.projection, ~c.used)),
    )
    forms = tuple(
        Form(item.effect.label if item.effect.is_physical else UNNAMED, at, share, is_placed(item.effect))
        for item, at, share in zip(every.candidates, places, _shares(every.candidates), strict=True)
    )
    present = {form.label for form in forms}
    weights = {x.effect.label: _SPECIAL for x in every.candidates if present & set(x.effect.special_cases)}
    of_base = np.pad(problem.identifiable, ((0, len(small.of_values) - c.model.base_count), (0, 0)))
    lift = np.concatenate([of_base, small.of_values, gross.of_values], axis=1)
    return Weighed(model, problem, every, forms, linear, posterior_odds(linear, forms, weights), lift)


def _gross_columns(
    problem: LinearProblem, candidates: Sequence[Candidate], by_errors: Floats, by_amplitudes: Floats
) -> tuple[_Columns, list[Indices]]:
    """Those of candidates, each by its typical size, and where the columns of each are.

    Args:
        problem: the touches.
        candidates: the effects.
        by_errors: what one standard deviation of each declared error and random effect changes, (2n, m + r).
        by_amplitudes: what each value of the model with its amplitudes changes, (2n, 12 + k).
    """
    c, arm = problem.calibration, problem.calibration.cell.uncertainty.effects.arm
    size, declared = len(c.model.names), c.declared
    labels = np.array([] if c.random is None else [column.effect.label for column in c.random.columns])
    fitted = {effect: len(values) for effect, values in fitted_effects(c) if len(values)}
    units = [trial_units(item.effect, item.trial, arm) for item in candidates]
    for item, unit in zip(candidates, units, strict=True):
        if item.effect not in fitted:  # what the arm contains of an effect counts where it is named
            unit[[p.is_alias for p in item.effect.parameters][: len(unit)]] = 0.0
    every = [np.zeros((len(problem.left), 0)), *(item.changes for item in candidates)]
    changes = np.concatenate(every, axis=1) * np.concatenate([*units, []])
    places = np.split(np.arange(changes.shape[1]), np.cumsum([len(unit) for unit in units])[:-1])
    of_values = np.full((size + by_errors.shape[1], changes.shape[1]), np.nan)
    for item, unit, at in zip(candidates, units, places, strict=True):
        own = _errors_of(item.effect, declared, len(c.errors) + np.flatnonzero(labels == item.effect.label))
        if item.effect in fitted:
            first = next(k for k, name in enumerate(c.model.names) if name.startswith(f'{item.effect.label}.'))
            values = first + np.arange(fitted[item.effect])
            amount = np.linalg.lstsq(changes[:, at], by_amplitudes[:, values].sum(axis=1), rcond=None)[0] * unit
            of_values[:, at] = 0.0
            of_values[np.ix_(values, at)] = _by_coefficients(item.trial, amount) * unit
        elif len(own):
            of_values[:, at] = 0.0
            of_values[np.ix_(size + own, at)] = np.linalg.lstsq(by_errors[:, own], changes[:, at], rcond=1e-6)[0]
    return _Columns(changes, of_values, np.zeros(changes.shape[1], dtype=bool)), places


def _small_columns(
    model: MixedModel,
    problem: LinearProblem,
    by_errors: Floats,
    effects: Sequence[tuple[Effect, Indices]],
    gross: _Columns,
) -> _Columns:
    """Declared errors, the random effects of a fit, and the small part of what it names, which these are without."""
    c, size = model.fit, len(model.fit.model.names)
    width = np.concatenate([np.ones(len(c.errors)), model.typical])
    is_declared = np.concatenate([np.ones(len(c.errors), dtype=bool), ~model.is_free])
    parts = [_Columns(by_errors * width, np.pad(np.diag(width), ((size, 0), (0, 0))), is_declared)]
    fitted, declared = {effect for effect, values in fitted_effects(c) if len(values)}, c.declared
    for effect, at in effects:
        own = _errors_of(effect, declared, np.zeros(0, dtype=np.intp))
        if effect not in fitted or c.cell.uncertainty.effects.sizes is not SizeMode.ESTIMATED or len(own):
            continue  # of what is declared the small part is that
        changes, of_values = gross.changes[:, at], gross.of_values[:, at]
        if effect.grid_parameter:  # small, it is where undetected effects are, not at the place found
            changes = _small_part(problem, effect, c.cell.uncertainty.effects.arm)
            of_values = np.zeros((len(of_values), changes.shape[1]))
        parts.append(_Columns(changes, of_values, np.zeros(changes.shape[1], dtype=bool)))
    return _Columns(*(np.concatenate(some, axis=-1) for some in zip(*parts, strict=True)))


def _errors_of(effect: Effect, declared: DeclaredErrors | None, random: Indices) -> Indices:
    """Which of the declared errors and random effects an effect is: its own random ones, or the error declared."""
    places = {} if declared is None else declared.places
    return random if len(random) else places.get(effect.declared_as or effect.label, random)


def _small_part(problem: LinearProblem, effect: Effect, arm: ArmClass) -> Floats:
    """The whitened columns by which an effect is there undetected, in its typical size, (2n, k)."""
    at = problem.touch_state
    columns = columns_of(effect, at)
    size = [effect.size(column.parameter, arm) for column in columns]
    changes = problem.changes(Trial(derivatives(columns, at)))
    return changes * np.array(size) / max(len({column.values for column in columns}), 1) ** 0.5


def is_placed(effect: Effect) -> bool:
    """Whether small columns of an effect are at all places of a grid, and not where it is."""
    return bool(effect.grid_parameter) and not effect.is_stepwise


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
        typical = [size / effect.size(k, arm) for k, size in enumerate(sizes.tolist())]
        units.append(1 / max(typical))
    return np.array(units)


def _by_coefficients(trial: Trial, at: Floats) -> Floats:
    """Derivative of the values of an effect by the coefficients of a trial (m,), (k, m)."""
    step = 1e-4 * max(float(np.abs(at).max()), 1e-9)
    ends = [(np.asarray(trial.values(at + one)), np.asarray(trial.values(at - one))) for one in step * np.eye(len(at))]
    return np.array([(after - before) / (2 * step) for after, before in ends]).T
