"""Search for missing effects: name what stands out of the mixed model, fit it, look again, until the names stay.

Sets of effects are compared in the linear problem at the latest fit, in which every effect of the catalogue counts by
the size that the errors of this robot have as a whole (`MixedModel.level`). So a set is credible only where it explains
what errors of that size do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.noise_estimation import USUAL_NOISE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.candidates import Candidate, all_candidates, as_fitted, gains, scan_trials
from scara_kinetostatic.diagnosis.lack_of_fit import growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    FRICTION_SIGNIFICANCE,
    INDEPENDENT_PART,
    Problem,
    fitted_effects,
    orthonormal,
    pose_problem,
)
from scara_kinetostatic.diagnosis.mixed_model import HEAVY_TAILS, LIGHT_TAILS, MixedModel, fit_mixed
from scara_kinetostatic.diagnosis.model_selection import ScoredSubsets, Subset, score_subsets, special_cases
from scara_kinetostatic.diagnosis.noise_structure import fit_again, fit_with_off_normal
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.effects.undetected import typical_size
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import ArmClass
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G2, P_EE

_MOST_IN_UNION = 5
"""Effects of several credible sets that are named together at most; of more, those of the best sets."""
_VANISHED = 0.1
"""Typical size below which named effects are none: in the mixed model others explain the touches."""
_PEAKS = 8
"""Places of a grid about which a moment, a frequency or a friction is compared at least."""
_UNLIKELY = 1e-3
"""Of the weight of the likeliest place of a grid, below which a place does not count."""
_BELOW_ZERO = 4.0
"""Standard deviations below zero at which a compliance or backlash is of no robot."""
_RULED_OUT = 20.0
"""Difference of the deviance with the sizes beyond which a rival is none. A base tilt of 600 typical sizes beside a
gain of 5 has 22; a soft contact of 760 beside a nonlinear sensor of 70 has 11, and either may be true.
"""
_MOST_RIVALS = 4
"""Sets that replace each other, of which models are made at most; of four times as many credible sets at most."""


class Search(NamedTuple):
    """The result of a search.

    Attributes:
        model: the fit with all effects that are named.
        problem: the linear problem at it.
        scored_subsets: the model selection in it.
        in_every_model: labels of effects in every credible set.
        rivals: labels of effects that replace each other.
        base: the fit without effects of the catalogue that it belongs to.
        lead: decrease of the deviance by the names, and by the touches that they explain.
        is_unpredictable: whether only a curve explains the touches, with which no force can be predicted.
    """

    model: MixedModel
    problem: Problem
    scored_subsets: ScoredSubsets
    in_every_model: tuple[str, ...]
    rivals: tuple[tuple[str, ...], ...]
    base: Calibration
    lead: float = 0.0
    is_unpredictable: bool = False

    @property
    def fit(self) -> Calibration:
        """The calibration of the mixed model."""
        return self.model.fit

    @property
    def has_names(self) -> bool:
        """Whether any effect is named."""
        return bool(self.in_every_model or self.rivals)

    @property
    def deviance(self) -> float:
        """That of the mixed model, with the penalty of the choice of effects."""
        sets = self.scored_subsets
        return self.model.deviance + (sets.credible[0].penalty if sets.credible else 0.0)


def identify(c: Calibration, known: Sequence[Effect], plain: MixedModel | None = None) -> Search:
    """The mixed model of a calibration with the effects that stand out of it.

    Args:
        c: the base model; effects that it has stay.
        known: the catalogue.
        plain: the mixed model without names, where it is known.
    """
    plain = plain or fit_mixed(c, known, freedoms=HEAVY_TAILS)
    model, excluded, found, before = plain, set[str](), None, None
    for _ in range(6):  # most searches end after two rounds
        problem = pose_problem(model.fit, model.level)
        candidates = all_candidates(problem, known)
        kept = tuple(item for item in candidates.candidates if item.effect.label not in excluded)
        sets = score_subsets(problem, candidates._replace(candidates=kept))
        nothing = Search(plain, problem, sets, (), (), c)
        members = _union(sets)
        names = {_name(member) for member in members}
        if not members or names == before:
            break
        best = len(sets.credible[0].members)
        before, first, others = names, members[:best], members[best:]
        fitted = _fit_named(c, known, problem, first, others, freedoms=HEAVY_TAILS)
        if fitted is None and not c.model.effects:  # with an outlier among the touches it may have gone off
            alone = fit_again(replace(c, model=start_from(problem, first, others)))
            if alone is not None and len(alone.touches) == len(c.touches):
                fitted = _fit(replace(c, used=alone.used), known, alone.model, freedoms=HEAVY_TAILS)
        if fitted is None:
            curves = {member.effect.label for member in members if not member.effect.is_physical}
            if curves & set(_partition(sets)[0]):
                return nothing._replace(scored_subsets=sets._replace(credible=()), is_unpredictable=True)
            wrong = curves or {member.effect.label for member in members}
        else:
            effects, arm = fitted_effects(fitted.fit), c.cell.uncertainty.effects.arm
            wrong = {effect.label for effect, values, _ in effects if not effect.is_plausible(values)}
            if all(_in_typical_size(effect, values, arm) < _VANISHED for effect, values, _ in effects):
                wrong = {effect.label for effect, _, _ in effects}  # what is not named explains the touches
        model = fitted or plain
        found = None if wrong else Search(model, problem, sets, *_partition(sets), c)
        if wrong:
            excluded |= wrong
            before = {('', 0.0)}
    return found or nothing


def _fit(
    c: Calibration,
    known: Sequence[Effect],
    start: ExtendedModel,
    most: int = 8,
    freedoms: float = LIGHT_TAILS,
    begin: MixedModel | None = None,
) -> MixedModel | None:
    """The mixed model with effects named, of so many linearisations at most; None where there is none, or where it does
    not predict the forces: the joint angles of a steep curve have no contact or another one, and so has a wrong arm. A
    curve must predict touches that it was not fitted to, as well as the base model does.
    """
    try:
        model = fit_mixed(c, known, start, most, freedoms=freedoms, begin=begin)
    except (np.linalg.LinAlgError, UnsupportedDataError, ParameterError):
        return None
    fit = model.fit
    if fit.force_error > c.force_error + c.noise.force_rms:
        return None
    if all(effect.is_physical for effect, _, _ in fitted_effects(fit)):
        return model
    before = replace(c, used=fit.used)
    return model if held_out_force_error(fit).force_error <= held_out_force_error(before).force_error else None


def _fit_named(
    c: Calibration,
    known: Sequence[Effect],
    problem: Problem,
    members: Sequence[Candidate],
    others: Sequence[Candidate] = (),
    most: int = 8,
    freedoms: float = LIGHT_TAILS,
) -> MixedModel | None:
    """The mixed model with effects named, begun where they fit the linear problem best (`start_from`) or, as large ones
    are not linear, at a quarter of the way.
    """
    starts = (start_from(problem, members, others, step) for step in (1.0, 0.25))
    return next(filter(None, (_fit(c, known, start, most, freedoms) for start in starts)), None)


def _in_typical_size(effect: Effect, values: Floats, arm: ArmClass) -> float:
    """The largest amplitude of an effect, in its typical size."""
    amplitudes = np.abs(effect.amplitudes(values))
    return max((size / typical_size(effect, k, arm) for k, size in enumerate(amplitudes.tolist()) if size), default=0.0)


def _name(member: Candidate) -> tuple[str, float]:
    """An effect and, where it begins or ends in a step, when."""
    return member.effect.label, member.trial.place if member.effect.is_stepwise else 0.0


def start_from(
    problem: Problem, members: Sequence[Candidate], others: Sequence[Candidate] = (), step: float = 1.0
) -> ExtendedModel:
    """L̄ and effects that fit the linear problem best, to start from.

    Args:
        problem: the touches.
        members: the effects.
        others: further ones, which start at zero: rivals together would start at large values of opposite sign.
        step: part of the way from a model without the effects.
    """
    columns = [problem.columns(member.trial) for member in members]
    together = np.concatenate(columns, axis=1)
    scale = np.linalg.norm(together, axis=0)
    scale[scale == 0] = 1.0
    projected = (together - problem.base @ (problem.base.T @ together)) / scale
    found = -step * np.linalg.lstsq(projected, problem.left, rcond=INDEPENDENT_PART)[0] / scale
    parts = np.split(found, np.cumsum([part.shape[1] for part in columns])[:-1])
    parts += [np.zeros(len(other.trial.columns)) for other in others]
    every = (*members, *others)
    values = [member.trial.values(part) for member, part in zip(every, parts, strict=True)]
    moved = problem.without_effects + problem.response @ together @ found
    base = problem.point.parameters.with_array(problem.point.parameters.as_array() + moved)
    return ExtendedModel(base, tuple(member.effect for member in every), tuple(map(tuple, values)))


class Rivals(NamedTuple):
    """The mixed models with each credible set of effects named by itself.

    Attributes:
        models: of the sets that replace each other.
        more_general: models that are, and less likely.
        weights: of these, in that of a rival.
    """

    models: tuple[MixedModel, ...] = ()
    more_general: tuple[MixedModel, ...] = ()
    weights: tuple[float, ...] = ()


def fit_rivals(found: Search, known: Sequence[Effect]) -> tuple[Search, Rivals]:
    """The mixed model with each of the likeliest credible sets named by itself, and the search with those alone that
    are credible with the sizes that their effects need there.

    A set with a more general effect in place of one of another set is a rival where its restricted likelihood is
    larger; else it counts by the ratio of the two.
    """
    sets, base = found.scored_subsets, replace(found.base, used=found.fit.used)
    named = {frozenset(one.labels) for one in sets.credible}
    is_general = [bool(special_cases(one.members) & named) for one in sets.credible]
    simple = [one for one, more in zip(sets.credible, is_general, strict=True) if not more]
    general_sets = [one for one, more in zip(sets.credible, is_general, strict=True) if more]
    tried = list[tuple[Subset, MixedModel | None]]()
    for some in simple, general_sets:
        begun = len(tried)
        for one in some[: 4 * _MOST_RIVALS]:
            if len(_likely(tried[begun:])) < _MOST_RIVALS:
                fits = (_fit_named(base, known, found.problem, one.members, most=most) for most in (3, 8))
                tried.append((one, next(filter(None, fits), None)))
    kept = _likely(tried)
    deviance = {frozenset(one.labels): fit.deviance for one, fit in kept}
    rivals, general, weights = list[MixedModel](), list[MixedModel](), list[float]()
    stays = {one.labels for one in simple} - {one.labels for one, _ in tried}
    for one, fit in kept:
        more = fit.deviance - min((deviance.get(case, np.inf) for case in special_cases(one.members)), default=np.inf)
        if more <= 0:
            rivals.append(fit)
            stays.add(one.labels)
        else:
            general.append(fit)
            weights.append(float(np.exp(-more / 2)))
    if rivals and len(stays) < len(sets.credible):
        sets = sets._replace(credible=tuple(one for one in sets.credible if one.labels in stays))
        labels, groups = _partition(sets)
        members, best = _union(sets), len(sets.credible[0].members)
        model = _fit_named(base, known, found.problem, members[:best], members[best:])
        found = found._replace(model=model or rivals[0], scored_subsets=sets, in_every_model=labels, rivals=groups)
    return found, Rivals(tuple(rivals), tuple(general), tuple(weights))


def _likely(tried: Sequence[tuple[Subset, MixedModel | None]]) -> list[tuple[Subset, MixedModel]]:
    """Those of the sets that have a model, and are not ruled out beside the likeliest."""
    fits = [(one, fit) for one, fit in tried if fit is not None]
    most = min((fit.deviance + one.penalty for one, fit in fits), default=0.0) + _RULED_OUT
    return [(one, fit) for one, fit in fits if fit.deviance + one.penalty <= most]


def _union(sets: ScoredSubsets) -> list[Candidate]:
    """The effects of the best credible set, and those of the others up to `_MOST_IN_UNION`, each once."""
    union = dict[str, Candidate]()
    for number, subset in enumerate(sets.credible):
        for candidate in subset.members:
            if number == 0 or len(union) < _MOST_IN_UNION:
                union.setdefault(candidate.effect.label, candidate)
    return list(union.values())


def _partition(sets: ScoredSubsets) -> tuple[tuple[str, ...], tuple[tuple[str, ...], ...]]:
    """Labels of the effects in every credible set, and groups of those that replace each other."""
    credible, best = [set(subset.labels) for subset in sets.credible], sets.credible[0].labels
    common = set.intersection(*credible)
    replaceable = [label for label in best if label not in common]
    groups: list[tuple[str, ...]] = []
    for label in replaceable:
        kept = set(best) - {label}
        instead = {x for labels in credible if kept <= labels for x in labels - kept if x != label}
        if instead:
            groups.append((label, *sorted(instead)))
    rest = sorted(set().union(*credible) - common - {label for group in groups for label in group})
    if rest:
        groups.append(tuple(dict.fromkeys([*replaceable, *rest])))
    return tuple(label for label in best if label in common), tuple(groups)


def likeliest(c: Calibration, known: Sequence[Effect], off_normal: bool) -> Search:
    """The likeliest of several ways to begin: with the touches of the fit, or with all where some were rejected,
    which an effect may explain; with the usual noise, where what is missing was taken for it; with off-normal angles.

    Args:
        c: the base model.
        known: the catalogue.
        off_normal: whether the test of the off-normal angles is significant.
    """
    plain = fit_mixed(c, known, freedoms=HEAVY_TAILS)
    found = [identify(c, known, plain)]
    if not c.used.all() and not found[0].fit.used.all():
        every = replace(c, used=np.ones(len(c.touches), dtype=bool))
        with suppress(np.linalg.LinAlgError, UnsupportedDataError):  # with the outliers there is none
            found.append(identify(every, known, fit_mixed(every, known, keeps_touches=True, freedoms=HEAVY_TAILS)))
    if c.cell.noise is None and not any(item.has_names for item in found) and c.noise.joint_rms > USUAL_NOISE.joint_rms:
        with suppress(UnsupportedDataError):
            usual = calibrate(c.touches, replace(c.cell, noise=USUAL_NOISE), c.model.effects, fixed=c.fixed)
            if len(usual.touches) == len(c.touches):
                found.append(identify(replace(usual, cell=c.cell, noise_source='estimated'), known))
    # effects may hide off-normal angles in the base model
    off_normal = off_normal or any(off_normal_p_value(item.fit) < FRICTION_SIGNIFICANCE for item in found)
    if off_normal and not _is_radial(min(found, key=lambda item: item.deviance)):
        found += _with_off_normal_forces(c, known)
    best = min([item for item in found if _is_robot(item.fit)] or found, key=lambda item: item.deviance)
    own, model, base = len(best.base.model.effects), best.fit.model, replace(best.base, used=best.fit.used)
    named = ExtendedModel(model.parameters, model.effects[own:], model.effect_values[own:])
    light = _fit(base, known, named, begin=best.model)
    # where steps across a kink have led it away, the fit that it began at is better
    final = light if light is not None and light.deviance <= best.model.deviance + CREDIBLE else best.model
    return best._replace(lead=plain.deviance - best.deviance, model=final)


def _is_robot(fit: Calibration) -> bool:
    """Whether no compliance or backlash is below zero beyond its uncertainty."""
    values, std = fit.parameters.as_array()[P_EE : G2 + 1], fit.std[P_EE : G2 + 1]
    return not (values < -_BELOW_ZERO * std).any()


def _is_radial(found: Search) -> bool:
    """Whether a model fits without a fitted curve and without off-normal angles beyond noise."""
    physical = all(effect.is_physical for effect, _, _ in fitted_effects(found.fit))
    return physical and off_normal_p_value(found.fit) > FRICTION_SIGNIFICANCE


def _with_off_normal_forces(c: Calibration, known: Sequence[Effect]) -> list[Search]:
    """Random off-normal angles, and other effects beside them; empty where these are not significant.

    The test is made at the parameters of the model with them: those without may be far off. Where noise that grows with
    the force is significant beside the angles, these must be more significant by the same factor.
    """
    try:
        with_angles = fit_with_off_normal(c)
    except UnsupportedDataError:
        return []
    friction = next(effect for effect, _, _ in fitted_effects(with_angles) if effect.off_normal_std)
    found = identify(with_angles, [effect for effect in known if effect.name != friction.name])
    others = tuple(effect for effect in found.fit.model.effects if not effect.off_normal_std)
    without = replace(found.fit, model=found.fit.model.with_effects(others))
    off_normal, growing = off_normal_p_value(without, beside_growing=True), growing_p_value(found.fit)
    if off_normal >= FRICTION_SIGNIFICANCE * (growing if growing < FRICTION_SIGNIFICANCE else 1.0):
        return []
    return [found._replace(in_every_model=(friction.label, *found.in_every_model))]


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
    if not any(effect.grid_parameter for effect, _, _ in named):
        return ()
    problem, found = pose_problem(fit), []
    candidates = [as_fitted(problem, effect, values, 1) for effect, values, _ in named]
    scale = max(1.0 if problem.noise_given else 0.0, fit.reduced_chi_square, 1e-300)
    for number, (effect, values, _) in enumerate(named):
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
