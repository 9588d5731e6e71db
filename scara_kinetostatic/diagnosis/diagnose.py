"""Diagnosis: whether the base model is complete, what it lacks, and the extended model with its uncertainty.

It says that nothing is missing, that a lack of fit is unexplained, or which effects extend the model.

**Trusted nominal values** (`Cell.uncertainty.nominal`) are tested against what the touches say of them. A trusted
value L_n is a row of the fit, of standard uncertainty u. Without this row the touches give L̂' with σ, and

    t = (L̂' - L_n) / sqrt(u² + σ²)

is standard normal if the value is right. It follows from the fit with the row by downdating: with the row's residual r
= (L̂ - L_n)/u and its leverage h = C/u², C the variance of L̂, t = r/sqrt(1 - h). Where the noise is estimated, it is
that of a fit without any of these rows: a wrong one makes the noise larger until it is believed.

Source: Belsley, Kuh and Welsch, Regression Diagnostics (1980), section 2.1 (studentised residuals).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.alternatives import (
    alternative_places,
    at_best_moments,
    find_moments,
    fit_alternative_frequencies,
    fit_alternative_laws,
    widened_by,
    widened_by_constants,
    widened_by_moments,
    widened_to_each,
)
from scara_kinetostatic.diagnosis.candidates import CandidateSet, all_candidates
from scara_kinetostatic.diagnosis.comparison import discriminating_touches
from scara_kinetostatic.diagnosis.lack_of_fit import Adequacy, Dependence, adequacy, growing_p_value, off_normal_p_value
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    SIGNIFICANCE,
    STRICT_SIGNIFICANCE,
    FittedEffect,
    Problem,
    fitted_effects,
    pose_problem,
)
from scara_kinetostatic.diagnosis.model_selection import rank_singles, score_singles, undetected_bias
from scara_kinetostatic.diagnosis.noise_structure import likelier, noise_candidate
from scara_kinetostatic.diagnosis.refit import MOST_STEPS, WITH_OTHER_NOISE, Effort, fit_again, steps_of
from scara_kinetostatic.diagnosis.result import Contradiction, Diagnosis, Found, Ranked, Value
from scara_kinetostatic.diagnosis.search import Search, select_hypothesis
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
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
    found = _with_likeliest_noise(calibration, known)
    return _without_contradicted(calibration, found, known) if calibration.trusted else found


def _without_contradicted(calibration: Calibration, first: Diagnosis, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis without the trusted nominal values that the touches contradict, the worst taken out first.

    Args:
        calibration: the base model with all of them.
        first: its diagnosis.
        known: the catalogue.
    """
    found, base, left_out = first, calibration, list[Contradiction]()
    parts = 2 * shares(calibration)
    while tests := contradictions(found.extended or found.refitted or base):
        p_value = parts * tests[0].p_value
        found = replace(found, p_value=min(found.p_value, p_value) if p_value < SIGNIFICANCE else found.p_value)
        fit = without_trust(base, tests[0].name) if p_value < SIGNIFICANCE else None
        if fit is None:
            if p_value < SIGNIFICANCE:
                left_out.append(tests[0])
            break
        base = fit
        left_out.append(tests[0])
        again = _with_likeliest_noise(base, known)
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


def _with_likeliest_noise(calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise as stated or estimated, or with the components that the touches ask for."""
    left = MOST_STEPS - steps_of(calibration)
    effort = Effort(left - WITH_OTHER_NOISE)
    found = _bounded(effort, calibration, known)
    effort = Effort(min(MOST_STEPS / 3, max(left - effort.steps, WITH_OTHER_NOISE)))
    refitted = noise_candidate(calibration, found, effort)
    if refitted is None:
        return found
    return likelier(found, calibration, _bounded(effort, refitted, known), refitted)


def _bounded(effort: Effort, calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise of a calibration; its names are suspicions where fits were left out."""
    found = _with_plausible_noise(calibration, known, effort)
    return _cut_short(found) if effort.has_left_out else found


def _cut_short(found: Diagnosis) -> Diagnosis:
    """A diagnosis in which fits were left out: others may explain the touches as well, so its names are suspicions."""
    is_named = found.verdict in {'explained', 'ambiguous'}
    return replace(
        found,
        verdict='unexplained' if is_named else found.verdict,
        found=tuple(as_suspicion(item) if item.in_every_model else item for item in found.found),
        ranking=tuple(item._replace(role='possible') if item.role == 'found' else item for item in found.ranking),
        advice=advice.joined(advice.cut_short(), found.advice),
    )


def _with_plausible_noise(calibration: Calibration, known: tuple[Effect, ...], effort: Effort) -> Diagnosis:
    """The diagnosis with the noise of a calibration, or with estimated noise where it is stated too large."""
    overstated = advice.overstated_noise(calibration)
    found = _examine(_with_estimated_noise(calibration) if overstated else calibration, known, effort)
    if not overstated and found.extended is not None:
        overstated = advice.overstated_noise(found.extended)
        if overstated:
            found = _examine(_with_estimated_noise(calibration), known, effort)
    final = found.extended or calibration
    noise = advice.noise_found(final)
    growing = '' if noise or final.model.off_normal_std else advice.growing_noise(growing_p_value(final))
    fixed = advice.fixed_parameters(calibration) if found.verdict != 'none' else ''
    negative = advice.negative_backlash(final)
    unknown = advice.unknown_history(calibration.touches, found)
    premises = advice.premises(found)
    return replace(
        found, advice=advice.joined(overstated, noise, found.advice, fixed, growing, negative, unknown, premises)
    )


def _with_estimated_noise(calibration: Calibration) -> Calibration:
    """The same fit with the noise estimated from its touches; itself where that has no fit."""
    return fit_again(calibration, calibrate, cell=replace(calibration.cell, noise=None)) or calibration


def _examine(c: Calibration, known: tuple[Effect, ...], effort: Effort) -> Diagnosis:
    """Test the base model, select the likeliest hypothesis, and report nothing, a lack of fit or an extended model."""
    tests = examine_base_model(c, known)
    found, lead = select_hypothesis(c, known, tests.alarm, tests.off_normal_p_value < SIGNIFICANCE / 2, effort)
    if found is not None and tests.p_value >= SIGNIFICANCE:
        tests = tests._replace(p_value=min(tests.p_value, float(np.exp(-lead / 2))))
    if found is None:
        return nothing_missing(c, tests)
    if not tests.implausible_noise and tests.p_value >= STRICT_SIGNIFICANCE and found.gain < CREDIBLE:
        return nothing_missing(c, tests, advice.weak_evidence(tests.p_value, tests.dependences))
    if found.extended is None:
        return unexplained(c, tests, found)
    return with_extended_model(c, tests, found, found.extended, known, effort)


def nothing_missing(c: Calibration, tests: BaseTests, evidence: str = '') -> Diagnosis:
    """The diagnosis of a complete base model, with the detection limit."""
    singles = Search(tests.problem, rank_singles(tests.problem, tests.candidate_set), None)
    ranking = _ranking(singles, c)
    text = advice.joined(evidence, advice.detection_limit(c, ranking))
    return Diagnosis('none', tests.p_value, remaining_p_value=tests.p_value, ranking=ranking, advice=text)


def unexplained(c: Calibration, tests: BaseTests, found: Search) -> Diagnosis:
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


def with_extended_model(
    c: Calibration, tests: BaseTests, found: Search, fitted: Calibration, known: tuple[Effect, ...], effort: Effort
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
    after = adequacy(fitted)
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
    effects = tuple(as_suspicion(item) for item in effects) if verdict == 'unexplained' else effects
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
            advice.large_noise(fitted),
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


def _verdict(found: Search, effects: Sequence[Found], after: Adequacy) -> str:
    """``unexplained`` where a lack of fit remains, or where every credible model has a fitted curve in it."""
    curves = {c.effect.label for c in found.scored_subsets.candidate_set.candidates if not c.effect.is_physical}
    curves |= {item.effect.label for item in effects if not item.effect.is_physical}
    is_described = bool(curves & set(found.in_every_model)) or any(set(group) <= curves for group in found.rivals)
    if after.p_value < SIGNIFICANCE or is_described:
        return 'unexplained'
    return 'ambiguous' if found.rivals else 'explained'


def as_suspicion(item: Found) -> Found:
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
    for candidate, scores in score_singles(found.problem, found.scored_subsets):
        label = candidate.effect.label
        role = 'found' if label in found.in_every_model else 'rival' if label in rivals else 'rejected'
        role = 'possible' if role == 'found' and label in possible else role
        bias, place = undetected_bias(found.problem, candidate, std)
        ranked.append(Ranked(candidate.effect, role, *scores, bias, NAMES[place]))
    for item in found.scored_subsets.candidate_set.unidentifiable:
        ranked.append(Ranked(item.effect, 'unidentifiable', np.nan, 0.0, 0.0, 0.0, item.independent_part))
    return tuple(ranked)


def contradictions(c: Calibration) -> tuple[Contradiction, ...]:
    """The tests of all trusted nominal values that the touches check, the worst first."""
    names = [name for name in NAMES if name in c.cell.uncertainty.nominal and name not in c.fixed]
    if not names:
        return ()
    fit, freedoms = _with_noise_of_free(c)
    tests = [test for name in names if (test := _test(fit, name, freedoms, len(names))) is not None]
    return tuple(sorted(tests, key=lambda test: (test.p_value, -test.deviation)))


def _test(fit: Calibration, name: str, freedoms: float, count: int) -> Contradiction | None:
    place, u = NAMES.index(name), fit.cell.uncertainty.nominal[name]
    variance = float(fit.covariance_with_errors[place, place]) / fit.enlargement
    checked = 1 - variance / u**2
    # the touches say nothing of it
    if checked < 1e-9:
        return None
    off = getattr(fit.cell.nominal, name) - getattr(fit.parameters, name)
    deviation = abs(off) / u / np.sqrt(checked)
    p_value = 2 * float(special.ndtr(-deviation) if np.isinf(freedoms) else special.stdtr(freedoms, -deviation))
    return Contradiction(name, off / checked, u, float(deviation), min(1.0, count * p_value))


def _with_noise_of_free(c: Calibration) -> tuple[Calibration, float]:
    """The fit with noise that no trusted value has made larger, and the degrees of freedom of this noise."""
    if c.noise_source == 'given':
        return c, np.inf
    free = _refitted(c, _trusting(c.cell, {}))
    fit = None if free is None else _refitted(c, replace(c.cell, noise=free.noise))
    if free is None or fit is None:
        return c, max(c.degrees_of_freedom, 1)
    return fit, max(free.degrees_of_freedom, 1)


def without_trust(c: Calibration, name: str) -> Calibration | None:
    """The same fit without one trusted nominal value; None where it has none."""
    kept = {other: std for other, std in c.cell.uncertainty.nominal.items() if other != name}
    return _refitted(c, _trusting(c.cell, kept))


def _trusting(cell: Cell, nominal: dict[str, float]) -> Cell:
    return replace(cell, uncertainty=replace(cell.uncertainty, nominal=nominal))


def _refitted(c: Calibration, cell: Cell) -> Calibration | None:
    """The same fit in another description of the cell; from the start where a warm start does not converge."""
    effects = c.model.effects
    warm = WarmStart(c.model, cell.noise or c.noise, c.used, c.errors)
    for warm_start in (warm, None):
        try:
            fit = calibrate(c.touches, cell, effects, fixed=c.fixed, warm_start=warm_start)
        except UnsupportedDataError:
            continue
        if fit.termination is Termination.CONVERGED and len(fit.errors) == len(c.errors):
            return fit
    return None


def shares(c: Calibration) -> int:
    """Among how many kinds of tests of what is declared their half of the false alarms is divided."""
    return int(len(c.errors) > 0) + int(c.trusted > 0)


class BaseTests(NamedTuple):
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


def examine_base_model(c: Calibration, known: tuple[Effect, ...]) -> BaseTests:
    """The tests of the base model.

    Where uncertainties are declared, half of the false alarms that are accepted are those of tests of what they are
    about (weighted Bonferroni: Genovese, Roeder and Wasserman, Biometrika 93 (2006) 509).
    """
    problem = pose_problem(c)
    candidate_set = all_candidates(c, problem, known, together=False)
    fit = adequacy(c, problem, candidate_set)
    off_normal = off_normal_p_value(c)
    halves = 2 if fit.declared_p_value is not None or c.trusted else 1
    declared = 1.0 if fit.declared_p_value is None else fit.declared_p_value
    p_value = min(1.0, 2 * halves * min(fit.p_value, off_normal), halves * max(shares(c), 1) * declared)
    return BaseTests(
        problem, candidate_set, p_value, fit.dependences, off_normal, '; '.join(advice.implausible_noise(c) or ())
    )
