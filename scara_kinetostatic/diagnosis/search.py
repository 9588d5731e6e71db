"""Search for missing effects: weigh all sets of effects at the latest fit, fit the likeliest one, weigh again, until it
stays.

Sets of effects are compared in the linear problem at a fit (`diagnosis.odds`), in which every effect of the catalogue
has a small part by the size that the errors of this robot have as a whole. So a set is likely only where it explains
what errors of that size do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.estimate import find_good
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.noise_estimation import USUAL_NOISE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.candidates import Candidate, as_fitted, gains, scan_trials
from scara_kinetostatic.diagnosis.lack_of_fit import growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.linear_problem import (
    FRICTION_SIGNIFICANCE,
    INDEPENDENT_PART,
    STRICT_SIGNIFICANCE,
    Problem,
    fitted_effects,
    pose_problem,
)
from scara_kinetostatic.diagnosis.mixed_model import HEAVY_TAILS, MixedModel, fit_mixed
from scara_kinetostatic.diagnosis.noise_structure import fit_again, fit_with_off_normal
from scara_kinetostatic.diagnosis.odds import NUMBER, UNNAMED
from scara_kinetostatic.diagnosis.result import EffectSet
from scara_kinetostatic.diagnosis.weighing import LEAST, Weighed, weigh
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.gaussian.linear_model import orthonormal
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G2, P_EE

FOUND = 0.95
"""Inclusion from which on an effect is found."""
POSSIBLE = 0.05
"""Probability of "no effect" below which the touches show that something is missing; part of the likeliest set's
probability from which on another one is its rival.
"""
_PEAKS = 8
"""Places of a grid about which a moment, a frequency or a friction is compared at least."""
_UNLIKELY = 1e-3
"""Of the weight of the likeliest place of a grid, below which a place does not count."""
_BELOW_ZERO = 4.0
"""Standard deviations below zero at which a compliance or backlash is of no robot."""


class Search(NamedTuple):
    """The result of a search.

    Attributes:
        weighed: the sets of effects at the fit with the likeliest one.
        base: the fit without effects of the catalogue that it belongs to.
        angles: label of random off-normal angles, which `base` then has; empty for none.
        angles_odds: log odds of these beforehand.
        angles_probability: of these.
    """

    weighed: Weighed
    base: Calibration
    angles: str = ''
    angles_odds: float = 0.0
    angles_probability: float = 1.0

    @property
    def fit(self) -> Calibration:
        """The calibration of the mixed model."""
        return self.weighed.model.fit

    @property
    def named(self) -> list[Effect]:
        """The effects of the fit that are named."""
        return [effect for effect, _ in fitted_effects(self.fit)][len(self.base.model.effects) :]

    @property
    def deviance(self) -> float:
        """-2 log likelihood with all sets, and prior of off-normal angles."""
        return self.weighed.deviance - 2 * self.angles_odds

    @property
    def probabilities(self) -> tuple[EffectSet, ...]:
        """Of all sets of effects of at least `LEAST`, the likeliest first; they add up to 1."""
        odds, angles = self.weighed.odds.probabilities, (self.angles,) if self.angles else ()
        sure = self.angles_probability
        sets = [EffectSet((*angles, *sorted(labels)), sure * p) for labels, p in odds.items() if p >= LEAST]
        sets += [EffectSet((), 1 - sure)] if 1 - sure >= LEAST else []
        total = sum(item.probability for item in sets)
        found = [item._replace(probability=item.probability / total) for item in sets]
        return tuple(sorted(found, key=lambda item: -item.probability))

    @property
    def inclusion(self) -> dict[str, float]:
        """The probability of each effect to be gross, by label, of at least `LEAST`."""
        found = {label: min(p, 1.0) for label, p in self.weighed.odds.inclusion.items() if p >= LEAST}
        return ({self.angles: self.angles_probability} if self.angles else {}) | found

    @property
    def none(self) -> float:
        """The probability that no effect is gross."""
        return 1 - self.angles_probability if self.angles else self.weighed.odds.none

    @property
    def sure(self) -> tuple[str, ...]:
        """Labels of the effects with an inclusion of `FOUND`; none where what is missing is rather outside the
        catalogue.
        """
        included = self.inclusion
        if included.get(UNNAMED, 0.0) >= 0.5:
            return ()
        return tuple(label for label, p in included.items() if p >= FOUND and label != UNNAMED)

    @property
    def found(self) -> tuple[str, ...]:
        """Those that are in the fit as well: the odds are to hold where it is."""
        named = {self.angles, *(effect.label for effect in self.named)}
        return tuple(label for label in self.sure if label in named)

    @property
    def is_explained(self) -> bool:
        """Whether the effects found may be all that is missing."""
        alone = sum(item.probability for item in self.probabilities if set(item.effects) <= set(self.found))
        return bool(self.found) and alone >= POSSIBLE

    @property
    def rivals(self) -> tuple[tuple[str, ...], ...]:
        """Groups of labels that replace each other, where the effects found do not explain the touches alone."""
        if self.is_explained:
            return ()
        sets = [(set(item.effects) - {*self.found, UNNAMED}, item.probability) for item in self.probabilities]
        likely = [labels for labels, p in sets if labels and p >= POSSIBLE * sets[0][1]] or [set[str]()]
        best, every = likely[0], dict.fromkeys(label for labels in likely for label in sorted(labels))
        groups = []
        for label in sorted(best):
            instead = {x for labels in likely if label not in labels for x in labels - best}
            groups.append((label, *(x for x in every if x in instead)))
        return tuple(dict.fromkeys(groups))


def identify(c: Calibration, known: Sequence[Effect], plain: Weighed | None = None) -> Search:
    """The mixed model of a calibration with the likeliest set of effects.

    Args:
        c: the base model; effects that it has stay.
        known: the catalogue.
        plain: the sets weighed at the mixed model without names, where they are known.
    """
    weighed = plain or weigh(fit_mixed(c, known, freedoms=HEAVY_TAILS), known)
    names, excluded, tried = frozenset[tuple[str, float]](), frozenset[str](), {frozenset[tuple[str, float]]()}
    visited, settled = list[Weighed](), list[Weighed]()
    for _ in range(6):  # most searches end after one or two rounds
        members = weighed.likeliest(excluded)
        wanted = frozenset(_name(member) for member in members)
        if wanted == names or not members:
            settled.append(weighed)
            if UNNAMED in excluded or all(member.effect.is_physical for member in members):
                break
            excluded |= {UNNAMED}  # where a curve is fitted, a set without may be likelier all the same
            continue
        if wanted in tried:  # each of several sets is the likeliest at the fit with another
            break
        tried.add(wanted)
        start = start_from(weighed.problem, members)
        fitted = _fit(c, known, start)
        if fitted is None and len(members) > 1:  # far from the truth a set may be likely that has no fit
            members = weighed.likeliest_of(members)
            wanted, start = frozenset(_name(member) for member in members), start_from(weighed.problem, members)
            fitted = None if wanted == names else _fit(c, known, start)
        if fitted is None and not c.model.effects:  # with an outlier among the touches it may have gone off
            good = find_good(c.changed(model=start).projection.distance)
            fitted = _fit(c.changed(used=good), known, start) if (good != c.used).any() else None
        if fitted is None:
            has_curve = not all(member.effect.is_physical for member in members)
            excluded |= {UNNAMED} if has_curve else {member.effect.label for member in members}
            continue
        wrong = {effect.label for effect, values in fitted_effects(fitted.fit) if not effect.is_plausible(values)}
        excluded |= wrong
        if not wrong:
            weighed, names = weigh(fitted, known), wanted
            visited.append(weighed)
    return Search(min(settled or visited or [weighed], key=lambda one: one.deviance), c)


def _fit(c: Calibration, known: Sequence[Effect], start: ExtendedModel) -> MixedModel | None:
    """The mixed model with effects named; None where there is none, or where it does not predict the forces: the joint
    angles of a steep curve have no contact or another one, and so has a wrong arm. A curve must predict touches that it
    was not fitted to as well as the base model does.
    """
    try:
        model = fit_mixed(c, known, start)
    except (np.linalg.LinAlgError, UnsupportedDataError, ParameterError):
        return None
    fit = model.fit
    if fit.force_error > c.force_error + c.noise.force_rms:
        return None
    if all(effect.is_physical for effect, _ in fitted_effects(fit)):
        return model
    before = c.changed(used=fit.used)
    return model if held_out_force_error(fit).force_error <= held_out_force_error(before).force_error else None


def _name(member: Candidate) -> tuple[str, float]:
    """An effect and, where it begins or ends in a step, when."""
    return member.effect.label, member.trial.place if member.effect.is_stepwise else 0.0


def start_from(problem: Problem, members: Sequence[Candidate]) -> ExtendedModel:
    """L̄ and effects that fit the linear problem of the touches best, to start from."""
    columns = [problem.columns(member.trial) for member in members]
    together = np.concatenate(columns, axis=1)
    scale = np.linalg.norm(together, axis=0)
    scale[scale == 0] = 1.0
    projected = (together - problem.base @ (problem.base.T @ together)) / scale
    found = -np.linalg.lstsq(projected, problem.left, rcond=INDEPENDENT_PART)[0] / scale
    parts = np.split(found, np.cumsum([part.shape[1] for part in columns])[:-1])
    values = [member.trial.values(part) for member, part in zip(members, parts, strict=True)]
    moved = problem.without_effects + problem.response @ together @ found
    base = problem.point.parameters.with_array(problem.point.parameters.as_array() + moved)
    return ExtendedModel(base, tuple(member.effect for member in members), tuple(map(tuple, values)))


def likeliest(c: Calibration, known: Sequence[Effect], plain: Weighed, off_normal: bool) -> Search:
    """The likeliest of several ways to begin: at the fit without names, and at its first linearisation where that is
    likelier; with all touches where some were rejected, which an effect may explain; with the usual noise, where what
    is missing was taken for it; with off-normal angles.

    Args:
        c: the base model.
        known: the catalogue.
        plain: the sets weighed at the mixed model without names.
        off_normal: whether the test of the off-normal angles is significant.
    """
    found = [identify(c, known, plain)]
    if (first := plain.model.first) is not None:
        found += [item for item in [identify(c, known, weigh(first, known))] if item.named]
    if not c.used.all() and not found[0].fit.used.all():
        every = c.changed(used=np.ones(len(c.touches), dtype=bool))
        with suppress(np.linalg.LinAlgError, UnsupportedDataError):  # with the outliers there is none
            found.append(
                identify(every, known, weigh(fit_mixed(every, known, keeps_touches=True, freedoms=HEAVY_TAILS), known))
            )
    if c.cell.noise is None and not any(item.named for item in found) and c.noise.joint_rms > USUAL_NOISE.joint_rms:
        usual = fit_again(c, cell=replace(c.cell, noise=USUAL_NOISE))
        if usual is not None and len(usual.touches) == len(c.touches):
            with suppress(UnsupportedDataError):
                found.append(identify(usual.changed(cell=c.cell), known))
    best = _likeliest(found)
    # effects may hide off-normal angles in the base model
    off_normal = off_normal or any(off_normal_p_value(item.fit) < FRICTION_SIGNIFICANCE for item in found)
    if off_normal and not _is_radial(best):
        for item in _with_off_normal_forces(c, known):
            sure = float(special.expit((best.deviance - item.deviance) / 2))
            if sure >= FOUND:
                found.append(item._replace(angles_probability=sure))
    return _likeliest(found)


def _likeliest(found: Sequence[Search]) -> Search:
    """That of the least deviance, whose robot has no compliance or backlash below zero where one has none."""
    return min([item for item in found if _is_robot(item.fit)] or found, key=lambda item: item.deviance)


def naming(found: Search, known: Sequence[Effect], labels: Sequence[str]) -> Search:
    """A search with the fit of some effects, all others small; as it is where there is none.

    Args:
        found: the search.
        known: the catalogue.
        labels: of the effects to name.
    """
    model, base = found.fit.model, found.base.changed(used=found.fit.used)
    turned = {effect.name for effect, _ in fitted_effects(base) if effect.off_normal_std}
    known = [effect for effect in known if effect.name not in turned]
    pairs = {effect.label: (effect, values) for effect, values in zip(model.effects, model.effect_values, strict=True)}
    for label in labels:  # rivals together would start at large values of opposite sign: at zero
        if label not in pairs:
            item = found.weighed.single(label)
            pairs[label] = item.effect, tuple(item.trial.values(np.zeros(len(item.trial.columns))))
    effects, values = zip(*(pairs[label] for label in labels), strict=True) if labels else ((), ())
    fitted = _fit(base, known, ExtendedModel(model.parameters, effects, values))
    if fitted is None:
        return found
    return found._replace(weighed=weigh(fitted, known))


def _is_robot(fit: Calibration) -> bool:
    """Whether no compliance or backlash is below zero beyond its uncertainty."""
    values, std = fit.parameters.as_array()[P_EE : G2 + 1], fit.std[P_EE : G2 + 1]
    return not (values < -_BELOW_ZERO * std).any()


def _is_radial(found: Search) -> bool:
    """Whether a model fits without a fitted curve and without off-normal angles beyond noise."""
    physical = all(effect.is_physical for effect, _ in fitted_effects(found.fit))
    fits = found.fit.noise_source != 'given' or found.fit.p_value >= STRICT_SIGNIFICANCE
    return physical and fits and off_normal_p_value(found.fit) > FRICTION_SIGNIFICANCE


def _with_off_normal_forces(c: Calibration, known: Sequence[Effect]) -> list[Search]:
    """Random off-normal angles, and other effects beside them; empty where these are not significant.

    The test is made at the parameters of the model with them: those without may be far off. Where noise that grows with
    the force is significant beside the angles, these must be more significant by the same factor.
    """
    with_angles = fit_with_off_normal(c)
    if with_angles is None:
        return []
    friction = next(effect for effect, _ in fitted_effects(with_angles) if effect.off_normal_std)
    found = identify(with_angles, [effect for effect in known if effect.name != friction.name])
    others = tuple(effect for effect in found.fit.model.effects if not effect.off_normal_std)
    without = found.fit.changed(model=found.fit.model.with_effects(others))
    off_normal, growing = off_normal_p_value(without, beside_growing=True), growing_p_value(found.fit)
    if off_normal >= FRICTION_SIGNIFICANCE * (growing if growing < FRICTION_SIGNIFICANCE else 1.0):
        return []
    # one effect of the catalogue, its size as uncertain as the touches leave it
    odds = np.log(NUMBER[1] / NUMBER[0] / max(len(known), 1)) - 0.5 * np.log(len(c.touches))
    return [found._replace(angles=friction.label, angles_odds=float(odds))]


class Moment(NamedTuple):
    """The place of one effect of a fit on its grid: a moment, a frequency, a friction.

    Attributes:
        effect: the effect.
        text: between which touches a moment is, with a probability of 95 %; empty for others.
        std: its standard deviation.
        change: of L̄, and of the amplitudes of the effect, from the place of the fit to each of some places,
            (t, 12 + k); other effects are as fitted. Empty where the law is smooth in it.
        weight: of these places, (t,).
    """

    effect: Effect
    text: str
    std: float
    change: Floats
    weight: Floats


def moments(fit: Calibration) -> tuple[Moment, ...]:
    """When the stepwise effects of a fit begin or end, and the frequency or friction of others, on which it depends in
    waves and kinks.

    Places of the grid are compared in the linear problem at the fit, about the likeliest of all: with χ²_k the least
    sum of squares with the place k, in units of s², its weight is exp(-χ²_k/2), as all are equally likely before.
    """
    named = [item for item in fitted_effects(fit) if item[0].label not in fit.held_effects]
    if not any(effect.grid_parameter for effect, _ in named):
        return ()
    problem, found = pose_problem(fit), []
    candidates = [as_fitted(problem, effect, values) for effect, values in named]
    scale = max(1.0 if problem.noise_given else 0.0, fit.reduced_chi_square, 1e-300)
    for number, (effect, values) in enumerate(named):
        at = problem.touch_state
        trials = effect.trials(at, problem.force) if effect.grid_parameter else ()
        if len(trials) < 2 or any(f'{effect.label}.{p.name}' in fit.fixed for p in effect.parameters):
            continue
        others = [item.unit for k, item in enumerate(candidates) if k != number and item.unit.size]
        beside = orthonormal(np.concatenate(others, axis=1)) if others else None

        def gained(some: Sequence[Trial], effect: Effect = effect, beside: Floats | None = beside) -> Floats:
            return gains(problem, scan_trials(problem, effect, some, len(some)), beside)

        gain = gained(trials)
        least = min(np.sort(gain)[-_PEAKS:][0], gain.max() + 2 * scale * np.log(_UNLIKELY))
        nearest = np.flatnonzero(gain >= least).tolist()
        width = 3.0 if effect.is_stepwise else 1.0
        trials = [trial for k in nearest for trial in effect.finer(at, trials[k], width)] or trials
        trials = list({round(trial.place, 12): trial for trial in trials}.values())  # the grids overlap
        gain, places = gained(trials), np.array([trial.place for trial in trials])
        weight = np.exp((gain - gain.max()) / (2 * scale))
        # a wave is near to linear in its frequency; beside a curve any would do
        has_kinks = effect.is_stepwise or not effect.is_smooth
        likely = np.flatnonzero(weight > _UNLIKELY) if has_kinks else np.empty(0, dtype=np.intp)
        weight /= weight.sum()
        off = np.abs(places - values[effect.grid_parameter_index])
        text, std = '', float(np.sqrt(weight @ off**2))
        if effect.is_stepwise:
            text, std = _when(fit, problem, effect, places, weight)
        every = [list(candidates) for _ in range(len(likely) + 1)]
        for one, k in zip(every, (*likely.tolist(), int(np.argmin(off))), strict=True):
            one[number] = one[number]._replace(trial=trials[k])
        *with_each, here = (start_from(problem, one).as_array() for one in every)
        change = np.array([one - here for one in with_each])
        found.append(Moment(effect, text, std, change, weight[likely] / weight[likely].sum()))
    return tuple(found)


def _when(fit: Calibration, problem: Problem, effect: Effect, places: Floats, weight: Floats) -> tuple[str, float]:
    """Between which touches an effect begins or ends, and the standard deviation of that moment."""
    touches, known = fit.touches, problem.touch_state.metadata.order
    order = np.sort(touches.order[fit.used])
    acts = order if known is None else np.sort(known[effect.acts_on(problem.touch_state)])
    best = np.argsort(-weight)
    likely = places[best[: int(np.searchsorted(np.cumsum(weight[best]), 0.95)) + 1]]
    low = float(acts[acts < likely.min()].max(initial=order[0]))
    high = float(acts[acts > likely.max()].min(initial=order[-1]))
    two = [int(np.flatnonzero(touches.order == one)[0]) for one in (low, high)]
    first, second = touches.recording[two].tolist()
    where = ['numbered in the order of time'] if np.any(touches.index[two] != touches.order[two]) else []
    where += [f'that is between the recordings {first + 1} and {second + 1}'] if first != second else []
    mean = float(weight @ places)
    after = np.clip(np.searchsorted(acts, places), 1, len(acts) - 1)
    between = (acts[after] - acts[after - 1]) ** 2 / 12  # a moment may lie anywhere between its two touches
    text = ', '.join([f'{effect.title} between the touches {low:.0f} and {high:.0f}', *where])
    return text, float(np.sqrt(weight @ ((places - mean) ** 2 + between)))
