"""Diagnosis: whether the base model is complete, what it lacks, and the extended model with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import advice, noise_advice
from scara_kinetostatic.diagnosis.alternatives import (
    alternative_places,
    fit_alternative_frequencies,
    fit_alternative_laws,
    widened_by,
    widened_by_constants,
    widened_to_each,
)
from scara_kinetostatic.diagnosis.candidates import CandidateSet
from scara_kinetostatic.diagnosis.contact_angle import (
    growing_p_value,
    off_normal_p_value,
    with_free_off_normal_angles,
)
from scara_kinetostatic.diagnosis.discriminating_touches import discriminating_touches
from scara_kinetostatic.diagnosis.effort import MOST_STEPS, WITH_OTHER_NOISE, Effort
from scara_kinetostatic.diagnosis.hypotheses import select_hypothesis
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence, find_dependences
from scara_kinetostatic.diagnosis.linear_problem import Problem, pose_problem
from scara_kinetostatic.diagnosis.model_selection import rank_singles
from scara_kinetostatic.diagnosis.moments import at_best_moments, find_moments, widened_by_moments
from scara_kinetostatic.diagnosis.noise_structure import likelier, noise_candidate
from scara_kinetostatic.diagnosis.ranking import score_singles, significance, undetected_bias
from scara_kinetostatic.diagnosis.refit import FittedEffect, fitted_effects
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked, Value
from scara_kinetostatic.diagnosis.search import Search, all_candidates
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE, SIGNIFICANCE, STRICT_SIGNIFICANCE
from scara_kinetostatic.diagnosis.trusted import Contradiction, contradictions, without_trust
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.parameters import NAMES


def diagnose(calibration: Calibration, effects: Sequence[Effect] | None = None) -> Diagnosis:
    """Test whether the base model is complete, and find what it lacks.

    Assumes Gaussian noise and independent touches. The p-value is Bonferroni-corrected over all tests: the F-tests of
    `find_dependences` and of every effect, the score test of off-normal angles, and, where the noise was given, the
    chi-square test of the residual. Where the stated noise is too large, the noise is estimated; where the touches
    show noise that grows with the force or differs from axis to axis (`noise_structure`), with these components.

    Args:
        calibration: the base model.
        effects: the catalogue; None for all that `effects.registry` lists.
    """
    offered = catalogue(calibration.cell) if effects is None else effects
    known = tuple(effect for effect in offered if effect.label not in calibration.held_effects)
    found = _diagnose_noise_and_effects(calibration, known)
    return _with_trusted_tested(calibration, found, known) if calibration.trusted else found


def _with_trusted_tested(calibration: Calibration, first: Diagnosis, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis without the trusted nominal values that the touches contradict, the worst taken out first.

    Args:
        calibration: the base model with all of them.
        first: its diagnosis.
        known: the catalogue.
    """
    found, base, left_out = first, calibration, list[Contradiction]()
    shares = 2 * _shares(calibration)
    while tests := contradictions(found.extended or found.refitted or base):
        p_value = shares * tests[0].p_value
        found = replace(found, p_value=min(found.p_value, p_value) if p_value < SIGNIFICANCE else found.p_value)
        fit = without_trust(base, tests[0].name) if p_value < SIGNIFICANCE else None
        if fit is None:
            if p_value < SIGNIFICANCE:
                left_out.append(tests[0])
            break
        base = fit
        left_out.append(tests[0])
        again = _diagnose_noise_and_effects(base, known)
        found = replace(again, p_value=min(found.p_value, again.p_value), refitted=again.refitted or base)
    if not left_out:
        return found
    named = tuple(Dependence(advice.contradicted(test), test.p_value, 0.0) for test in left_out)
    return replace(
        found,
        verdict='unexplained' if found.verdict == 'none' else found.verdict,
        contradicted=tuple(left_out),
        dependences=(*named, *found.dependences),
        advice=advice.joined(advice.of_contradicted(left_out), found.advice),
    )


def _shares(c: Calibration) -> int:
    """Among how many kinds of tests of what is declared their half of the false alarms is divided."""
    return int(len(c.errors) > 0) + int(c.trusted > 0)


def _diagnose_noise_and_effects(calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise as stated or estimated, or with the components that the touches ask for."""
    left = MOST_STEPS - calibration.iterations
    effort = Effort(left - WITH_OTHER_NOISE)
    found = _diagnose_within(effort, calibration, known)
    effort = Effort(min(MOST_STEPS // 3, max(left - effort.steps, WITH_OTHER_NOISE)))
    refitted = noise_candidate(calibration, found, effort)
    if refitted is None:
        return found
    return likelier(found, calibration, _diagnose_within(effort, refitted, known), refitted)


def _diagnose_within(effort: Effort, calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise of a calibration; its names are suspicions where fits were left out."""
    found = _diagnose_with_noise(calibration, known, effort)
    return _cut_short(found) if effort.has_left_out else found


def _cut_short(found: Diagnosis) -> Diagnosis:
    """A diagnosis in which fits were left out: others may explain the touches as well, so its names are suspicions."""
    is_named = found.verdict in {'explained', 'ambiguous'}
    return replace(
        found,
        verdict='unexplained' if is_named else found.verdict,
        found=tuple(_as_suspicion(item) if item.in_every_model else item for item in found.found),
        ranking=tuple(item._replace(role='possible') if item.role == 'found' else item for item in found.ranking),
        advice=advice.joined(advice.cut_short(), found.advice),
    )


def _diagnose_with_noise(calibration: Calibration, known: tuple[Effect, ...], effort: Effort) -> Diagnosis:
    """The diagnosis with the noise of a calibration, or with estimated noise where it is stated too large."""
    overstated = noise_advice.overstated_noise(calibration)
    found = _diagnose(_with_estimated_noise(calibration) if overstated else calibration, known, effort)
    if not overstated and found.extended is not None:
        overstated = noise_advice.overstated_noise(found.extended)
        if overstated:
            found = _diagnose(_with_estimated_noise(calibration), known, effort)
    final = found.extended or calibration
    noise = noise_advice.noise_found(final)
    growing = '' if noise or final.model.off_normal_std else noise_advice.growing_noise(growing_p_value(final))
    fixed = advice.fixed_parameters(calibration) if found.verdict != 'none' else ''
    negative = advice.negative_backlash(final)
    unknown = advice.unknown_history(calibration.touches, found)
    premises = advice.premises(found)
    return replace(
        found, advice=advice.joined(overstated, noise, found.advice, fixed, growing, negative, unknown, premises)
    )


def _with_estimated_noise(calibration: Calibration) -> Calibration:
    """The same fit with the noise estimated from its touches; itself where that has no fit."""
    c = calibration
    try:
        warm_start = WarmStart(c.model, c.noise, c.used, c.errors)
        return calibrate(c.touches, replace(c.cell, noise=None), c.model.effects, fixed=c.fixed, warm_start=warm_start)
    except UnsupportedDataError:
        return c


def _diagnose(c: Calibration, known: tuple[Effect, ...], effort: Effort) -> Diagnosis:
    """Test the base model, select the likeliest hypothesis, and report nothing, a lack of fit or an extended model."""
    tests = _test_base_model(c, known)
    found, lead = select_hypothesis(c, known, tests.alarm, tests.off_normal_p_value < SIGNIFICANCE / 2, effort)
    if found is not None and tests.p_value >= SIGNIFICANCE:
        tests = tests._replace(p_value=min(tests.p_value, float(np.exp(-lead / 2))))
    if found is None:
        return _nothing_missing(c, tests)
    if not tests.implausible_noise and tests.p_value >= STRICT_SIGNIFICANCE and found.gain < CREDIBLE:
        return _nothing_missing(c, tests, advice.weak_evidence(tests.p_value, tests.dependences))
    if found.extended is None:
        return _unexplained(c, tests, found)
    return _extended(c, tests, found, found.extended, known, effort)


class _BaseTests(NamedTuple):
    """The tests of the base model.

    Attributes:
        problem: its linear problem.
        candidate_set: every effect by itself.
        p_value: of "the base model is complete".
        dependences: what its residual depends on significantly.
        off_normal_p_value: of "the off-normal angles are noise".
        implausible_noise: why estimated noise is too large to be noise; else empty.
    """

    problem: Problem
    candidate_set: CandidateSet
    p_value: float
    dependences: tuple[Dependence, ...]
    off_normal_p_value: float
    implausible_noise: str

    @property
    def alarm(self) -> bool:
        """Whether the base model is not complete."""
        return self.p_value < SIGNIFICANCE or bool(self.implausible_noise)


def _test_base_model(c: Calibration, known: tuple[Effect, ...]) -> _BaseTests:
    """The tests of the base model.

    Where uncertainties are declared, half of the false alarms that are accepted are those of tests of what they are
    about (weighted Bonferroni: Genovese, Roeder and Wasserman, Biometrika 93 (2006) 509).
    """
    problem = pose_problem(c)
    candidate_set = all_candidates(c, problem, known, together=False)
    fit = _adequacy(c, problem, candidate_set)
    off_normal = off_normal_p_value(c)
    halves = 2 if fit.declared_p_value is not None or c.trusted else 1
    declared = 1.0 if fit.declared_p_value is None else fit.declared_p_value
    p_value = min(1.0, 2 * halves * min(fit.p_value, off_normal), halves * max(_shares(c), 1) * declared)
    return _BaseTests(problem, candidate_set, p_value, fit.dependences, off_normal, noise_advice.implausible_noise(c))


def _nothing_missing(c: Calibration, tests: _BaseTests, evidence: str = '') -> Diagnosis:
    """The diagnosis of a complete base model, with the detection limit."""
    singles = Search(tests.problem, rank_singles(tests.problem, tests.candidate_set), None)
    ranking = _ranking(singles, c)
    text = advice.joined(evidence, advice.detection_limit(c, ranking))
    return Diagnosis('none', tests.p_value, remaining_p_value=tests.p_value, ranking=ranking, advice=text)


def _unexplained(c: Calibration, tests: _BaseTests, found: Search) -> Diagnosis:
    """The diagnosis of a lack of fit that no effect explains."""
    return Diagnosis(
        verdict='unexplained',
        p_value=tests.p_value,
        dependences=tests.dependences,
        remaining=tests.dependences,
        remaining_p_value=tests.p_value,
        ranking=_ranking(found, c),
        advice=tests.implausible_noise or advice.unexplained(c, tests.dependences),
    )


def _extended(
    c: Calibration,
    tests: _BaseTests,
    found: Search,
    fitted: Calibration,
    known: tuple[Effect, ...],
    effort: Effort,
) -> Diagnosis:
    """The diagnosis with an extended model: verdict, effects, standard deviations that cover rivals and alternatives.

    Args:
        c: the base model.
        tests: of the base model.
        found: the selected hypothesis.
        fitted: its fit.
        known: the catalogue.
        effort: of the diagnosis.
    """
    fitted = at_best_moments(fitted)
    after = _adequacy(fitted)
    rivals = _fit_rivals(c, found, fitted, effort)
    moments = find_moments(fitted)
    frequencies = fit_alternative_frequencies(fitted, found.in_every_model, effort)
    frequencies += alternative_places(fitted)
    extended = widened_by(fitted, rivals)
    extended = widened_to_each(extended, [*fit_alternative_laws(fitted, effort), *frequencies])
    extended = widened_by_constants(widened_by_moments(extended, moments), [extended, *rivals])
    rivals = [widened_by_moments(rival, find_moments(rival)) for rival in rivals]
    effects = _describe(extended, found.in_every_model, rivals)
    verdict = _verdict(found, effects, after)
    effects = tuple(_as_suspicion(item) for item in effects) if verdict == 'unexplained' else effects
    touches = discriminating_touches(c, rivals) if len(rivals) > 1 else None
    return Diagnosis(
        verdict=verdict,
        p_value=tests.p_value,
        found=effects,
        rivals=found.rivals,
        extended=extended,
        dependences=tests.dependences,
        remaining=after.dependences,
        remaining_p_value=after.p_value,
        ranking=_ranking(found, c, tuple(item.effect.label for item in effects if item.is_possible)),
        advice=advice.joined(
            advice.moments(effects, moments),
            advice.open_questions(verdict, effects, found.rivals, after.dependences, known, touches),
            advice.alternative_frequencies(fitted, frequencies),
            advice.alternative_laws(fitted, extended),
            noise_advice.large_noise(fitted),
        ),
        discriminating=touches,
    )


def _fit_rivals(c: Calibration, found: Search, fitted: Calibration, effort: Effort) -> list[Calibration]:
    """The touches fitted with each credible set by itself, where there are several; off-normal angles stay."""
    if not found.rivals:
        return []
    held = fitted.held_effects
    kept = tuple(effect for effect in fitted.model.effects if effect.off_normal_std or effect.label in held)
    return found.fit_rivals(replace(c, model=c.model.with_effects(kept)), effort)


class _Adequacy(NamedTuple):
    """The test of a model.

    Attributes:
        p_value: of "it is complete", Bonferroni-corrected over all tests but those of the next.
        dependences: what the residual depends on, significant ones only, the most significant first.
        declared_p_value: of "nothing exceeds its declared uncertainty", Bonferroni-corrected; None without any.
    """

    p_value: float
    dependences: tuple[Dependence, ...]
    declared_p_value: float | None = None


def _adequacy(
    calibration: Calibration, problem: Problem | None = None, candidate_set: CandidateSet | None = None
) -> _Adequacy:
    """Test a model against all that its residual could depend on.

    Args:
        calibration: with or without effects.
        problem: its linear problem.
        candidate_set: effects to test as well; None for none.
    """
    c = calibration
    dependences, declared = list(find_dependences(with_free_off_normal_angles(c))), list[Dependence]()
    if problem is not None and candidate_set is not None:
        best_first = {candidate.effect.label: candidate for candidate in reversed(candidate_set.candidates)}
        for candidate in best_first.values():
            tested = Dependence(candidate.effect.title, *significance(problem, candidate))
            (declared if problem.is_declared(candidate.effect) else dependences).append(tested)
    given = c.noise_source == 'given'
    if not given and problem is not None and c.prior_cost:
        beyond = float(special.chdtrc(len(c.errors) + c.trusted, c.prior_cost))
        declared.append(Dependence('errors beyond what is declared', beyond, c.prior_cost / c.chi_square))
    size = float(special.chdtrc(c.degrees_of_freedom, c.chi_square)) if given else 1.0
    tests = max(len(dependences) + given, 1)
    smallest = tests * min([size, *(item.p_value for item in dependences)])
    counted = [(item, tests) for item in dependences] + [(item, len(declared)) for item in declared]
    significant = [item for item, number in counted if item.p_value * number < SIGNIFICANCE]
    return _Adequacy(
        min(1.0, smallest),
        tuple(sorted(significant, key=lambda item: item.p_value)),
        len(declared) * min(item.p_value for item in declared) if declared else None,
    )


def _verdict(found: Search, effects: Sequence[Found], after: _Adequacy) -> str:
    """``unexplained`` where a lack of fit remains, or where every credible model has a fitted curve in it."""
    curves = {c.effect.label for c in found.scored_subsets.candidate_set.candidates if not c.effect.is_physical}
    curves |= {item.effect.label for item in effects if not item.effect.is_physical}
    is_described = bool(curves & set(found.in_every_model)) or any(set(group) <= curves for group in found.rivals)
    if after.p_value < SIGNIFICANCE or is_described:
        return 'unexplained'
    return 'ambiguous' if found.rivals else 'explained'


def _as_suspicion(item: Found) -> Found:
    """An effect beside which something is missing: its name is no more than possible; a fitted curve names nothing."""
    return item._replace(is_possible=item.effect.is_physical)


def _describe(extended: Calibration, in_every_model: Sequence[str], rivals: Sequence[Calibration]) -> tuple[Found, ...]:
    """The effects of the extended model with their values; a rival has those of the model with it alone."""
    alone = [(item.effect.label, _values(item, rival)) for rival in reversed(rivals) for item in fitted_effects(rival)]
    by_label = dict(alone)
    items = []
    for item in fitted_effects(extended):
        if item.effect.label in extended.held_effects:
            continue
        effect, values, is_certain = item.effect, _values(item, extended), item.effect.label in in_every_model
        if not is_certain:
            unknown = tuple(value._replace(value=np.nan, std=np.nan) for value in values)
            values = by_label.get(effect.label, unknown)
            if (
                effect.grid_parameter and not effect.is_stepwise
            ):  # alternative frequencies of this fit were not looked for
                values = tuple(value._replace(std=np.nan) for value in values)
        items.append(Found(effect, values, is_certain))
    return tuple(items)


def _values(item: FittedEffect, calibration: Calibration) -> tuple[Value, ...]:
    """The parameters of an effect with their estimates; of random off-normal angles their standard deviation."""
    size = item.effect.off_normal_std
    if size:
        std = float(size / np.sqrt(2 * calibration.used.sum()))
        return (Value('off_normal_angle', size, std, 'rad', 'of the force from the normal, root mean square'),)
    return tuple(
        Value(p.name, float(v), float(s), p.unit, p.meaning)
        for p, v, s in zip(item.effect.parameters, item.values, item.std, strict=True)
    )


def _ranking(found: Search, calibration: Calibration, possible: Sequence[str] = ()) -> tuple[Ranked, ...]:
    """Every effect by itself: its scores and its role; `possible` are the labels of suspicions."""
    rivals = {label for group in found.rivals for label in group}
    std = (found.extended or calibration).std
    ranked = []
    for score in score_singles(found.problem, found.scored_subsets):
        label = score.candidate.effect.label
        role = 'found' if label in found.in_every_model else 'rival' if label in rivals else 'rejected'
        role = 'possible' if role == 'found' and label in possible else role
        bias, place = undetected_bias(found.problem, score.candidate, std)
        scores = score.p_value, score.share, score.gain, score.held_out
        ranked.append(Ranked(score.candidate.effect, role, *scores, score.independent_part, bias, NAMES[place]))
    for item in found.scored_subsets.candidate_set.unidentifiable:
        ranked.append(Ranked(item.effect, 'unidentifiable', np.nan, 0.0, 0.0, 0.0, item.independent_part))
    return tuple(ranked)
