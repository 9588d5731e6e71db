"""The verdict of a search: nothing is missing, this is, or nothing known explains the touches; effects in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic.calibration.fit_point import select
from scara_kinetostatic.calibration.noise import off_normal_uncertainty
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.candidates import Moment, moments
from scara_kinetostatic.diagnosis.lack_of_fit import adequacy, find_dependences
from scara_kinetostatic.diagnosis.linear_problem import SIGNIFICANCE, STRICT_SIGNIFICANCE, fitted_effects
from scara_kinetostatic.diagnosis.model_averaging import averaged, with_assumed_places, with_places
from scara_kinetostatic.diagnosis.odds import UNNAMED
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Value
from scara_kinetostatic.diagnosis.search import FOUND, POSSIBLE, Search, chi_square_p_value, is_explained
from scara_kinetostatic.diagnosis.weighing import Weighed
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.model.arrays import Floats


def report(c: Calibration, found: Search) -> tuple[Diagnosis, float]:
    """What a search says: nothing missing, a lack of fit or an extended model; the deviance of the model.

    The p-value is that of "no effect is gross": the inverse of its Bayes factor, which is smaller than p with a
    probability of at most p where nothing is missing; or, where the noise is stated, of the chi-square of the mixed
    model.
    """
    if not found.angles and found.weighed.odds.none >= POSSIBLE:
        for weighed in found.without:
            if is_explained(weighed.model.fit, STRICT_SIGNIFICANCE):
                return _without_effects(c, found, weighed), found.deviance
    elif found.angles or found.named:
        return _with_extended_model(c, found), found.deviance
    implausible = '; '.join(advice.implausible_noise(c) or ())
    weighed, dependences = found.weighed, find_dependences(c)
    significant = tuple(item for item in dependences if item.p_value * len(dependences) < SIGNIFICANCE)
    # noise stated too small is no model error
    refitted = mean_over_sets(weighed, weighed.model.fit) if significant else None
    return Diagnosis(
        verdict='unexplained',
        p_value=_p_value(found, found.fit),
        dependences=significant,
        remaining=significant,
        remaining_p_value=_p_value(found, found.fit),
        ranking=weighed.ranking({}),
        refitted=refitted,
        probabilities=found.probabilities,
        inclusion=found.inclusion,
        advice=implausible or advice.unexplained(c, significant),
    ), found.deviance


def _without_effects(c: Calibration, found: Search, weighed: Weighed) -> Diagnosis:
    """The diagnosis where nothing is shown to be missing: by a search, with the sets weighed at a fit that explains the
    touches.
    """
    fit = weighed.model.fit
    refitted = mean_over_sets(weighed, fit) if fit.random is not None else None
    is_small = not is_explained(c, SIGNIFICANCE)
    p_value = _p_value(found, fit)
    return Diagnosis(
        'none',
        p_value,
        remaining_p_value=p_value,
        ranking=found.weighed.ranking({}),
        refitted=refitted,
        probabilities=found.probabilities,
        inclusion=found.inclusion,
        has_small_errors=is_small,
        advice=advice.many_small(c.p_value, suspects(fit)) if is_small else '',
    )


def mean_over_sets(weighed: Weighed, fit: Calibration) -> Calibration:
    """The mean over the sets of effects, with their scatter and what effects that are not seen may change, and what is
    assumed of undeclared places.
    """
    return with_assumed_places(averaged(fit, *weighed.mixture()))


def _p_value(found: Search, fit: Calibration) -> float:
    """P-value of "no effect is gross" with a fit (see `report`)."""
    return min(1.0, found.none / max(1 - found.none, 1e-300), 4 * chi_square_p_value(fit))


def _with_extended_model(c: Calibration, found: Search) -> Diagnosis:
    """The diagnosis with an extended model: verdict, effects, rivals.

    Args:
        c: the base model.
        found: the effects that may be missing.
    """
    when = moments(found.fit)
    included = found.inclusion
    # in the union of rivals one may stand for the other at any place; each by itself has its own
    fit = _with_moments(found.fit, [item for item in when if included.get(item.effect.label, 0.0) >= FOUND])
    after, rivals = adequacy(fit), found.rivals
    fit = mean_over_sets(found.weighed, fit)
    effects = _describe(fit, found)
    curves = included.get(UNNAMED, 0.0) >= 0.5
    verdict = 'explained' if found.is_explained else 'ambiguous'
    if curves or after.p_value < SIGNIFICANCE:
        verdict = 'unexplained'
    if verdict == 'unexplained':
        # beside what is missing a name is no more than possible; a fitted curve names nothing
        effects = tuple(item._replace(is_possible=item.effect.is_physical) for item in effects)
    roles = {label: 'rival' for group in rivals for label in group} | dict.fromkeys(found.found, 'found')
    roles |= {item.effect.label: 'possible' for item in effects if item.is_possible}
    return Diagnosis(
        verdict=verdict,
        p_value=_p_value(found, found.fit),
        found=effects,
        rivals=rivals,
        probabilities=found.probabilities,
        inclusion=included,
        extended=fit,
        dependences=find_dependences(c)[:3],
        remaining=after.dependences,
        remaining_p_value=after.p_value,
        ranking=found.weighed.ranking(roles),
        advice=advice.joined(
            advice.moments(effects, when),
            advice.open_questions(verdict, effects, rivals, after.dependences),
            advice.large_noise(fit),
        ),
    )


def _with_moments(fit: Calibration, when: Sequence[Moment]) -> Calibration:
    """A calibration with the uncertainty of the places of its effects on their grids."""
    for moment in when:
        effect = moment.effect
        if len(moment.change):
            fit = with_places(fit, effect, moment.change, moment.weight)
        name = f'{effect.label}.{effect.grid_parameter}'
        fit = fit.changed(place_stds={**fit.place_stds, name: moment.std})
    return fit


def _describe(extended: Calibration, found: Search) -> tuple[Found, ...]:
    """All named effects with their values, of each those that it has if it is gross."""
    items = list[Found]()
    for (effect, estimates), std in zip(fitted_effects(extended), extended.effect_stds, strict=True):
        if effect.label in extended.held_effects:
            continue
        values, label = _values(effect, estimates, std, extended), effect.label if effect.is_physical else UNNAMED
        with_it = [item for item in extended.alternatives if label in item.effects]
        if effect.parameters and 0 < len(with_it) < len(extended.alternatives):
            first = extended.model.names.index(f'{effect.label}.{effect.parameters[0].name}')
            at = slice(first, first + len(values))
            weight = np.array([item.probability for item in with_it])
            off = np.array([item.change[at] for item in with_it])
            mean = weight @ off / weight.sum()
            square = np.array([np.diag(item.covariance)[at] for item in with_it]) + (off - mean) ** 2
            stds = np.where(np.isfinite(std), np.sqrt(weight @ square / weight.sum()), np.nan)
            if effect.grid_parameter:  # which the linear problem holds
                stds[effect.grid_parameter_index] = std[effect.grid_parameter_index]
            values = _values(effect, estimates + mean, stds, extended)
        is_certain = label in found.found or not effect.is_physical
        items.append(Found(effect, values, is_certain))
    return tuple(items)


def _values(effect: Effect, values: Floats, stds: Floats, calibration: Calibration) -> tuple[Value, ...]:
    """The parameters of an effect with their estimates; of random off-normal angles their standard deviation."""
    if size := effect.off_normal_std:
        std = off_normal_uncertainty(select(calibration.projection, calibration.used))
        return (Value('off_normal_angle', size, std, 'rad', 'of the force from the normal, root mean square'),)
    return tuple(
        Value(p.name, float(v), float(s), p.unit, p.meaning)
        for p, v, s in zip(effect.parameters, values, stds, strict=True)
    )


def suspects(final: Calibration) -> tuple[Found, ...]:
    """The effects of the catalogue that are not named, with an amplitude beyond their typical size: of each its largest
    column.
    """
    random, arm = final.random, final.cell.uncertainty.effects.arm
    if random is None:
        return ()
    value, std = random.size * final.random_values, np.sqrt(np.diag(final.covariance_with_errors))
    std, found = random.size * std[len(std) - len(value) :], dict[str, Found]()
    ratio = np.abs(value) / [column.effect.size(column.parameter, arm) for column in random.columns]
    for k in np.argsort(-ratio, kind='stable').tolist():
        effect, form, _ = random.columns[k]
        if ratio[k] <= 1 or effect.label in found:
            continue
        parts = [
            (effect.parameters[column.parameter], j)
            for j, column in enumerate(random.columns)
            if column[:2] == (effect, form)
        ]
        values = tuple(Value(p.name, float(value[j]), float(std[j]), p.unit, p.meaning) for p, j in parts)
        found[effect.label] = Found(effect, values, in_every_model=False, is_possible=True)
    return tuple(found.values())
