"""Diagnosis: whether the base model is complete, what it lacks, and the extended model with its uncertainty.

It says that nothing is missing, that a lack of fit is unexplained, or which effects extend the model.

**Trusted nominal values** (`Cell.uncertainty.nominal`) are tested against what the touches say of them. Where these
give L̂' with σ' in a fit without any trusted value, t = (L̂' - L_n) / sqrt(u² + σ'²) is standard normal if L_n with its
standard uncertainty u is right. Those that are not are left out, and the touches are diagnosed without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.estimate import off_normal_uncertainty
from scara_kinetostatic.calibration.fit_point import select
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.candidates import Moment, moments
from scara_kinetostatic.diagnosis.lack_of_fit import PENALTY, adequacy, find_dependences, fit_again, noise_candidate
from scara_kinetostatic.diagnosis.linear_problem import SIGNIFICANCE, STRICT_SIGNIFICANCE, fitted_effects
from scara_kinetostatic.diagnosis.mixed_model import HEAVY_TAILS, averaged, fit_mixed, with_assumed_places, with_places
from scara_kinetostatic.diagnosis.odds import UNNAMED
from scara_kinetostatic.diagnosis.result import Contradiction, Dependence, Diagnosis, Found, Value
from scara_kinetostatic.diagnosis.search import FOUND, POSSIBLE, Search, chi_square_p_value, is_explained, likeliest
from scara_kinetostatic.diagnosis.weighing import Weighed, weigh
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.arrays import Floats


def diagnose(calibration: Calibration, effects: Sequence[Effect] | None = None) -> Diagnosis:
    """Test whether the base model is complete, and find what it lacks.

    Assumes Gaussian noise and independent touches. The p-value is that of `_report`. Where the stated noise is too
    large, the noise is estimated; where the touches show noise that grows with the force (`lack_of_fit`), with this
    component.

    Args:
        calibration: the base model.
        effects: the catalogue; None for all that `effects.registry` lists.
    """
    offered = catalogue(calibration.cell) if effects is None else effects
    own = {effect.label for effect in calibration.model.effects}
    known = tuple(effect for effect in offered if effect.label not in own)
    found = _with_likeliest_noise(calibration, known)
    tests = contradictions(found.extended or found.refitted or calibration)
    level = SIGNIFICANCE / (2 * _shares(calibration)) if tests else 0.0
    wrong = tuple(test for test in tests if test.p_value < level)
    kept = {name: u for name, u in calibration.cell.uncertainty.nominal.items() if name not in {t.name for t in wrong}}
    base = _trusting(calibration, kept) if wrong else None
    if base is None:
        return found
    found = _with_likeliest_noise(base, known)
    named = tuple(Dependence(advice.contradicted(test), test.p_value, 0.0) for test in wrong)
    return replace(
        found,
        verdict='unexplained' if found.verdict == 'none' else found.verdict,
        p_value=min(found.p_value, SIGNIFICANCE / level * wrong[0].p_value),
        refitted=found.refitted or base,
        contradicted=wrong,
        dependences=(*named, *found.dependences),
        advice=advice.joined(advice.of_contradicted(wrong), found.advice),
    )


def contradictions(c: Calibration) -> tuple[Contradiction, ...]:
    """The tests of all trusted nominal values that the touches check, the worst first."""
    trusted = {name: u for name, u in c.cell.uncertainty.nominal.items() if name not in c.fixed}
    free = _trusting(c, {}) if trusted else None
    if free is None:
        return ()
    tests = []
    for name, u in trusted.items():
        off = getattr(c.cell.nominal, name) - free[name].value
        deviation = abs(off) / float(np.hypot(u, free[name].std))
        freedoms = max(free.degrees_of_freedom, 1)
        p_value = 2 * (special.ndtr(-deviation) if c.noise_source == 'given' else special.stdtr(freedoms, -deviation))
        if np.isfinite(deviation):
            tests.append(Contradiction(name, off, u, deviation, min(1.0, len(trusted) * float(p_value))))
    return tuple(sorted(tests, key=lambda test: (test.p_value, -test.deviation)))


def _trusting(c: Calibration, nominal: dict[str, float]) -> Calibration | None:
    """The same fit with other nominal values trusted; None where it has none."""
    cell = replace(c.cell, uncertainty=replace(c.cell.uncertainty, nominal=nominal))
    fit = fit_again(c, cell=cell)
    return fit if fit is not None and fit.termination is Termination.CONVERGED else None


def _shares(c: Calibration) -> int:
    """Among how many kinds of tests of what is declared their half of the false alarms is divided."""
    return int(len(c.errors) > 0) + int(c.trusted > 0)


def _with_likeliest_noise(calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise as stated, estimated where it is stated too large, or with the component that the
    touches ask for.
    """
    bases, found = [calibration], list[tuple[Diagnosis, float]]()
    for base in bases:
        overstated, diagnosis, deviance = advice.overstated_noise(base), None, 0.0
        if not overstated:
            diagnosis, deviance = _report(base, likeliest(base, known))
            # undetected errors take from the residual; without them it is as large at least as the noise
            if diagnosis.extended is not None and advice.overstated_noise(diagnosis.extended):
                plain = fit_again(diagnosis.extended)
                overstated = '' if plain is None else advice.overstated_noise(plain)
        if diagnosis is None or overstated:
            free = fit_again(base, cell=replace(base.cell, noise=None)) or base
            diagnosis, deviance = _report(free, likeliest(free, known))
        if overstated and diagnosis.verdict == 'none' and diagnosis.refitted is not None:
            stated = weigh(fit_mixed(base, known, freedoms=HEAVY_TAILS), known)
            diagnosis = replace(diagnosis, refitted=_averaged(stated, stated.model.fit))
        found.append((_with_remarks(diagnosis, base, overstated), deviance))
        grown = noise_candidate(calibration, found[0][0]) if len(found) == 1 else None
        bases += [] if grown is None else [grown]
    (best, deviance), *others = found
    for other, lower in others:
        if (other.verdict == 'unexplained' and best.verdict != 'unexplained') or deviance - lower <= PENALTY:
            continue
        final = other.extended or other.refitted
        if calibration.cell.noise is not None and final is not None and advice.has_small_residuals(final):
            continue  # smaller than the noise that is stated: what grows is no noise
        best = other if other.refitted is not None else replace(other, refitted=bases[1])
    return best


def _with_remarks(diagnosis: Diagnosis, base: Calibration, overstated: str) -> Diagnosis:
    """A diagnosis of a base model with what is to be said of its noise and premises."""
    noise = advice.noise_found(diagnosis.extended or diagnosis.refitted or base)
    fixed = advice.fixed_parameters(base) if diagnosis.verdict != 'none' else ''
    unknown, premises = advice.unknown_history(base.touches, diagnosis), advice.premises(diagnosis)
    return replace(diagnosis, advice=advice.joined(overstated, noise, diagnosis.advice, fixed, unknown, premises))


def _report(c: Calibration, found: Search) -> tuple[Diagnosis, float]:
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
    refitted = _averaged(weighed, weighed.model.fit) if significant else None
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
    refitted = _averaged(weighed, fit) if fit.random is not None else None
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


def _averaged(weighed: Weighed, fit: Calibration) -> Calibration:
    """The mean over the sets of effects, with their scatter and what effects that are not seen may change, and what is
    assumed of undeclared places.
    """
    return with_assumed_places(averaged(fit, *weighed.mixture()))


def _p_value(found: Search, fit: Calibration) -> float:
    """P-value of "no effect is gross" with a fit (see `_report`)."""
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
    fit = _averaged(found.weighed, fit)
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
