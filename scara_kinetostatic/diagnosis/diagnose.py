"""Diagnosis: whether the base model is complete, what it lacks, and the extended model with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import advice, noise_advice
from scara_kinetostatic.diagnosis.adequacy import examine_base_model
from scara_kinetostatic.diagnosis.contact_angle import growing_p_value
from scara_kinetostatic.diagnosis.effort import MOST_STEPS, WITH_OTHER_NOISE, Effort, steps_of
from scara_kinetostatic.diagnosis.hypotheses import select_hypothesis
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.diagnosis.noise_structure import likelier, noise_candidate
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE, SIGNIFICANCE, STRICT_SIGNIFICANCE
from scara_kinetostatic.diagnosis.trusted import Contradiction, contradictions, shares, without_trust
from scara_kinetostatic.diagnosis.verdict import as_suspicion, nothing_missing, unexplained, with_extended_model
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import UnsupportedDataError


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


def _diagnose_noise_and_effects(calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise as stated or estimated, or with the components that the touches ask for."""
    left = MOST_STEPS - steps_of(calibration)
    effort = Effort(left - WITH_OTHER_NOISE)
    found = _diagnose_within(effort, calibration, known)
    effort = Effort(min(MOST_STEPS / 3, max(left - effort.steps, WITH_OTHER_NOISE)))
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
        found=tuple(as_suspicion(item) if item.in_every_model else item for item in found.found),
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
