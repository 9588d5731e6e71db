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

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.candidates import all_candidates
from scara_kinetostatic.diagnosis.comparison import discriminating_touches
from scara_kinetostatic.diagnosis.lack_of_fit import Adequacy, adequacy, off_normal_p_value
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    SIGNIFICANCE,
    STRICT_SIGNIFICANCE,
    Problem,
    fitted_effects,
    pose_problem,
)
from scara_kinetostatic.diagnosis.mixed_model import (
    averaged,
    fit_mixed,
    with_large_effects,
    with_places,
    with_projection,
)
from scara_kinetostatic.diagnosis.model_selection import ScoredSubsets, score_subsets, significance
from scara_kinetostatic.diagnosis.noise_structure import PENALTY, fit_again, noise_candidate
from scara_kinetostatic.diagnosis.result import Contradiction, Dependence, Diagnosis, Found, Ranked, Value
from scara_kinetostatic.diagnosis.search import Moment, Rivals, Search, fit_rivals, likeliest, moments
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.effects.undetected import typical_size
from scara_kinetostatic.model.arrays import Floats

_GROSS = 10.0
"""Typical sizes beyond which an effect that is not named is no small error: the model is then not explained."""


def diagnose(calibration: Calibration, effects: Sequence[Effect] | None = None) -> Diagnosis:
    """Test whether the base model is complete, and find what it lacks.

    Assumes Gaussian noise and independent touches. The p-value is Bonferroni-corrected over all tests: the F-tests of
    `find_dependences` and of every effect, the score test of off-normal angles, and, where the noise was given, the
    chi-square test of the residual. Where the stated noise is too large, the noise is estimated; where the touches
    show noise that grows with the force (`noise_structure`), with this component.

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
    """The diagnosis with the noise as stated or estimated, or with the component that the touches ask for."""
    found, deviance = _with_noise_that_fits(calibration, known)
    refitted = noise_candidate(calibration, found)
    if refitted is None:
        return found
    other, lower = _with_noise_that_fits(refitted, known)
    if (other.verdict == 'unexplained' and found.verdict != 'unexplained') or deviance - lower <= PENALTY:
        return found
    return other if other.refitted is not None else replace(other, refitted=refitted)


def _with_noise_that_fits(calibration: Calibration, known: tuple[Effect, ...]) -> tuple[Diagnosis, float]:
    """The diagnosis with the noise of a calibration, estimated where it is stated too large; its deviance."""
    overstated = advice.overstated_noise(calibration)
    found = None if overstated else _examine(calibration, known)
    if found is not None and found[0].extended is not None:
        overstated = advice.overstated_noise(found[0].extended)
    if found is None or overstated:
        cell = replace(calibration.cell, noise=None)
        found = _examine(fit_again(calibration, cell=cell) or calibration, known)
    diagnosis, deviance = found
    if overstated and diagnosis.verdict == 'none' and diagnosis.refitted is not None:
        mixed = fit_mixed(calibration, known)
        diagnosis = replace(diagnosis, refitted=with_large_effects(mixed.fit, mixed))
    noise = advice.noise_found(diagnosis.extended or diagnosis.refitted or calibration)
    fixed = advice.fixed_parameters(calibration) if diagnosis.verdict != 'none' else ''
    unknown, premises = advice.unknown_history(calibration.touches, diagnosis), advice.premises(diagnosis)
    text = advice.joined(overstated, noise, diagnosis.advice, fixed, unknown, premises)
    return replace(diagnosis, advice=text), deviance


def _examine(c: Calibration, known: tuple[Effect, ...]) -> tuple[Diagnosis, float]:
    """Test the base model, find what stands out of the mixed model, and report nothing, a lack of fit or an extended
    model; and the deviance of the mixed model.

    Where uncertainties are declared, half of the false alarms that are accepted are those of tests of what they are
    about (weighted Bonferroni: Genovese, Roeder and Wasserman, Biometrika 93 (2006) 509).
    """
    problem = pose_problem(c)
    candidate_set = all_candidates(problem, known, together=False)
    fit, off_normal = adequacy(c, problem, candidate_set), off_normal_p_value(c)
    halves = 2 if fit.declared_p_value is not None or c.trusted else 1
    declared = 1.0 if fit.declared_p_value is None else fit.declared_p_value
    p_value = min(1.0, 2 * halves * min(fit.p_value, off_normal), halves * max(_shares(c), 1) * declared)
    implausible = '; '.join(advice.implausible_noise(c) or ())
    if p_value >= SIGNIFICANCE and not implausible and c.used.all():
        ranking = _ranking(problem, score_subsets(problem, candidate_set, together=False))
        mixed = fit_mixed(c, known)
        refitted = with_large_effects(mixed.fit, mixed) if mixed.fit.random is not None else None
        nothing = Diagnosis('none', p_value, remaining_p_value=p_value, ranking=ranking, refitted=refitted)
        return nothing, mixed.deviance
    found = likeliest(c, known, off_normal < SIGNIFICANCE / 2)
    if found.has_names and found.lead >= CREDIBLE:
        p_value = min(p_value, float(np.exp(-found.lead / 2)))
    alarm = p_value < (SIGNIFICANCE if found.has_names else STRICT_SIGNIFICANCE) or bool(implausible)
    if alarm and found.has_names:
        return _with_extended_model(c, p_value, fit.dependences, found, known), found.deviance
    after, gross = adequacy(found.fit), advice.gross(suspects(found.fit, _GROSS)) if alarm and fit.dependences else ''
    ranking = _ranking(found.problem, found.scored_subsets)
    # noise stated too small is no model error
    is_mixed = found.fit.random is not None and (fit.dependences or not alarm)
    refitted = with_large_effects(found.fit, found.model) if is_mixed else None
    if not alarm or (after.p_value >= SIGNIFICANCE and fit.dependences and not found.is_unpredictable and not gross):
        many = advice.many_small(p_value, suspects(found.fit)) if alarm else ''
        verdict = Diagnosis('none', p_value, ranking=ranking, refitted=refitted, advice=many)
        return replace(verdict, remaining_p_value=after.p_value if alarm else p_value), found.deviance
    return Diagnosis(
        verdict='unexplained',
        p_value=p_value,
        dependences=fit.dependences,
        remaining=after.dependences,
        remaining_p_value=after.p_value,
        ranking=ranking,
        refitted=refitted,
        advice=implausible or gross or advice.unexplained(c, fit.dependences),
    ), found.deviance


def _with_extended_model(
    c: Calibration, p_value: float, dependences: tuple[Dependence, ...], found: Search, known: tuple[Effect, ...]
) -> Diagnosis:
    """The diagnosis with an extended model: verdict, effects, rivals, what would decide between them.

    Args:
        c: the base model.
        p_value: of "it is complete".
        dependences: what its residual depends on.
        found: the effects that are named.
        known: the catalogue.
    """
    likely = Rivals()
    if found.rivals:
        found, likely = fit_rivals(found, known)
    when = moments(found.fit)
    # in the union of rivals one may stand for the other at any place; each by itself has its own
    fit = _with_moments(found.fit, [item for item in when if item.effect.label in found.in_every_model])
    after = adequacy(fit)
    every = [_with_moments(one.fit, moments(one.fit)) for one in (*likely.models, *likely.more_general)]
    rivals, general = every[: len(likely.models)], every[len(likely.models) :]
    fit = with_large_effects(averaged(fit, rivals, general, likely.weights), found.model)
    effects = _describe(fit, found.in_every_model, rivals)
    verdict = _verdict(found, effects, after)
    if verdict == 'unexplained':
        # beside what is missing a name is no more than possible; a fitted curve names nothing
        effects = tuple(item._replace(is_possible=item.effect.is_physical) for item in effects)
    touches = discriminating_touches(c, rivals) if len(rivals) > 1 else None
    possible = tuple(item.effect.label for item in effects if item.is_possible)
    return Diagnosis(
        verdict=verdict,
        p_value=p_value,
        found=effects,
        rivals=found.rivals,
        extended=fit,
        dependences=dependences,
        remaining=after.dependences,
        remaining_p_value=after.p_value,
        ranking=_ranking(found.problem, found.scored_subsets, found, possible),
        advice=advice.joined(
            advice.moments(effects, when),
            advice.open_questions(verdict, effects, found.rivals, after.dependences, known, touches),
            advice.large_noise(fit),
        ),
        discriminating=touches,
    )


def _with_moments(fit: Calibration, when: Sequence[Moment]) -> Calibration:
    """A calibration with the uncertainty of the places of its effects on their grids."""
    for moment in when:
        effect = moment.effect
        if len(moment.change):
            fit = with_places(fit, effect, moment.change, moment.weight)
        at = fit.model.names.index(f'{effect.label}.{effect.grid_parameter}') - fit.model.base_count
        std = fit.effect_std.copy()
        std[at] = np.fmax(std[at], moment.std)
        fit = with_projection(replace(fit, effect_std=std), fit.projection)
    return fit


def _verdict(found: Search, effects: Sequence[Found], after: Adequacy) -> str:
    """``unexplained`` where a lack of fit remains, or where every credible model has a fitted curve in it."""
    curves = {item.effect.label for item in effects if not item.effect.is_physical}
    is_described = bool(curves & set(found.in_every_model)) or any(set(group) <= curves for group in found.rivals)
    if after.p_value < SIGNIFICANCE or is_described:
        return 'unexplained'
    return 'ambiguous' if found.rivals else 'explained'


def _describe(extended: Calibration, in_every_model: Sequence[str], rivals: Sequence[Calibration]) -> tuple[Found, ...]:
    """All named effects with their values in the extended model; a rival has those of the model with it alone."""
    alone = {fitted[0].label: _values(*fitted, rival) for rival in reversed(rivals) for fitted in fitted_effects(rival)}
    items = []
    for effect, estimates, std in fitted_effects(extended):
        values = _values(effect, estimates, std, extended)
        if effect.label not in extended.held_effects:
            is_certain = effect.label in in_every_model
            items.append(Found(effect, values if is_certain else alone.get(effect.label, values), is_certain))
    return tuple(items)


def _values(effect: Effect, values: Floats, stds: Floats, calibration: Calibration) -> tuple[Value, ...]:
    """The parameters of an effect with their estimates; of random off-normal angles their standard deviation."""
    if size := effect.off_normal_std:
        std = float(size / np.sqrt(2 * calibration.used.sum()))
        return (Value('off_normal_angle', size, std, 'rad', 'of the force from the normal, root mean square'),)
    return tuple(
        Value(p.name, float(v), float(s), p.unit, p.meaning)
        for p, v, s in zip(effect.parameters, values, stds, strict=True)
    )


def suspects(final: Calibration, least: float = 1.0) -> tuple[Found, ...]:
    """The effects of the catalogue that are not named, with an amplitude beyond their typical size, or so many times
    that size: of each its largest column.
    """
    random, arm = final.random, final.cell.uncertainty.effects.arm
    if random is None:
        return ()
    value, std = random.size * final.random_values, np.sqrt(np.diag(final.covariance_with_errors))
    std, found = random.size * std[len(std) - len(value) :], dict[str, Found]()
    ratio = np.abs(value) / [typical_size(column.effect, column.parameter, arm) for column in random.columns]
    for k in np.argsort(-ratio, kind='stable').tolist():
        effect, form, _ = random.columns[k]
        if ratio[k] <= least or effect.label in found:
            continue
        parts = [
            (effect.parameters[column.parameter], j)
            for j, column in enumerate(random.columns)
            if column[:2] == (effect, form)
        ]
        values = tuple(Value(p.name, float(value[j]), float(std[j]), p.unit, p.meaning) for p, j in parts)
        found[effect.label] = Found(effect, values, in_every_model=False, is_possible=True)
    return tuple(found.values())


def _ranking(
    problem: Problem, sets: ScoredSubsets, found: Search | None = None, possible: Sequence[str] = ()
) -> tuple[Ranked, ...]:
    """Every effect by itself: its scores and its role; `possible` are the labels of suspicions."""
    rivals = {label for group in (found.rivals if found else ()) for label in group}
    roles = dict.fromkeys(rivals, 'rival') | dict.fromkeys(found.in_every_model if found else (), 'found')
    roles |= {label: 'possible' for label in possible if roles.get(label) == 'found'}
    empty, ranked = sets.empty.score, dict[str, Ranked]()
    for subset in sets.subsets:  # the best first
        if len(subset.members) == 1 and subset.labels[0] not in ranked:
            (label,), (candidate,) = subset.labels, subset.members
            scores = (*significance(problem, candidate), empty - subset.score, candidate.independent_part)
            ranked[label] = Ranked(candidate.effect, roles.get(label, 'rejected'), *scores)
    return (*ranked.values(), *sets.unidentifiable)
