"""The verdict on the twelve-parameter model, and on the one that the search extends it to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.alternatives import fit_alternative_laws, widened, widened_for_each, with_free_zeros
from scara_kinetostatic.diagnosis.candidates import CandidateSet
from scara_kinetostatic.diagnosis.contact_angle import growing_p_value, off_normal_p_value, without_direction
from scara_kinetostatic.diagnosis.discrimination import DiscriminatingTouch, discriminating_touches
from scara_kinetostatic.diagnosis.hypotheses import select_hypothesis
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence, find_dependences
from scara_kinetostatic.diagnosis.linear_problem import Problem, pose_problem
from scara_kinetostatic.diagnosis.model_selection import rank_singles
from scara_kinetostatic.diagnosis.peaks import fit_alternative_frequencies
from scara_kinetostatic.diagnosis.refit import effect_values
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked, Value
from scara_kinetostatic.diagnosis.scores import score_singles, significance, undetected_bias
from scara_kinetostatic.diagnosis.search import Search, all_candidates
from scara_kinetostatic.diagnosis.thresholds import CREDIBLE, SIGNIFICANCE, STRICT_SIGNIFICANCE
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.parameters import NAMES


class Adequacy(NamedTuple):
    """Whether a model is enough.

    Attributes:
        p_value: of "it is", Bonferroni's over all tests.
        traces: what the residual depends on, significant ones only, the most significant first.
    """

    p_value: float
    dependences: tuple[Dependence, ...]


def diagnose(calibration: Calibration, effects: Sequence[Effect] | None = None) -> Diagnosis:
    """Test whether anything is left in the residual, and find what.

    Assumes Gaussian noise and independent touches. The p-value is Bonferroni's over all tests: the F-tests of
    `find_traces` and of every effect, the score test of leaning forces, and, where the noise was given, chi-square of
    the residual.

    Args:
        calibration: of the twelve parameters.
        effects: the catalogue; None for all that `effects.registry` lists.
    """
    known = tuple(catalogue(calibration.cell) if effects is None else effects)
    quiet = advice.overstated_noise(calibration)
    found = _diagnose(_with_own_noise(calibration) if quiet else calibration, known)
    if not quiet and found.extended is not None and advice.overstated_noise(found.extended):
        quiet = advice.overstated_noise(found.extended)
        found = _diagnose(_with_own_noise(calibration), known)
    final = found.extended or calibration
    off_normal_fit = any(effect.off_normal_std for effect in final.model.effects)
    growing = 1.0 if off_normal_fit else growing_p_value(final)
    held = advice.fixed_parameters(calibration) if found.verdict != 'none' else ''
    return replace(found, advice=advice.joined(quiet, found.advice, held, advice.growing_noise(growing)))


def _with_own_noise(calibration: Calibration) -> Calibration:
    """The fit with the noise that the touches show, where the cell states too much: under it nothing would stand out
    but what its errors do beyond first order.
    """
    c = calibration
    try:
        warm_start = WarmStart(c.model, c.noise, c.used)
        return calibrate(c.touches, replace(c.cell, noise=None), fixed=c.fixed, warm_start=warm_start)
    except UnsupportedDataError:
        return c


def _diagnose(calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    c = calibration
    problem = pose_problem(c)
    candidate_set = all_candidates(c, problem, known, together=False)
    before = adequacy(c, problem, candidate_set)
    off_normal = off_normal_p_value(c)
    p_value = min(1.0, 2 * min(before.p_value, off_normal))
    incredible = advice.implausible_noise(c)
    alarm = p_value < SIGNIFICANCE or bool(incredible)
    found, lead = select_hypothesis(c, known, alarm, off_normal < SIGNIFICANCE / 2)
    if found is not None and p_value >= SIGNIFICANCE:
        p_value = min(p_value, float(np.exp(-lead / 2)))
    hint = found is not None and not incredible and p_value >= STRICT_SIGNIFICANCE and found.gain < CREDIBLE
    if found is None or hint:
        nothing = Search(problem, rank_singles(problem, candidate_set), None, 0.0, (), ())
        ranking = _ranking(nothing, c)
        text = advice.joined(
            advice.weak_evidence(p_value, before.dependences) if hint else '', advice.detection_limit(c, ranking)
        )
        return Diagnosis('none', p_value, remaining_p_value=p_value, ranking=ranking, advice=text)
    ranking = _ranking(found, c)
    if found.extended is None:
        text = incredible or advice.unexplained(c, before.dependences)
        return Diagnosis(
            verdict='unexplained',
            p_value=p_value,
            dependences=before.dependences,
            remaining=before.dependences,
            remaining_p_value=p_value,
            ranking=ranking,
            advice=text,
        )
    return _extend(Diagnosis('explained', p_value, dependences=before.dependences, ranking=ranking), c, found, known)


def _extend(base: Diagnosis, calibration: Calibration, found: Search, known: tuple[Effect, ...]) -> Diagnosis:
    """A diagnosis with what was found: the verdict, the extended model with its standard deviations, advice."""
    assert found.extended is not None
    after = adequacy(found.extended)
    rivals = _fit_rivals(found, calibration)
    extended = widened(found.extended, rivals)
    peaks = fit_alternative_frequencies(found.extended, found.in_every_model)
    extended = widened_for_each(extended, [*fit_alternative_laws(found.extended), *peaks])
    extended = with_free_zeros(extended, [extended, *rivals])
    described = _describe(found._replace(extended=extended), rivals)
    verdict = _verdict(found, described, after)
    discriminating = _discriminating_touches(calibration, rivals)
    return replace(
        base,
        verdict=verdict,
        found=described,
        rivals=found.rivals,
        extended=extended,
        remaining=after.dependences,
        remaining_p_value=after.p_value,
        advice=advice.joined(
            advice.open_questions(verdict, described, found.rivals, after.dependences, known, discriminating),
            advice.alternative_frequencies(found.extended, peaks),
            advice.alternative_laws(found.extended, extended),
            advice.large_noise(found.extended),
        ),
    )


def _fit_rivals(found: Search, calibration: Calibration) -> list[Calibration]:
    """The touches fitted with each credible set by itself, where there are several."""
    if not found.rivals:
        return []
    kept = found.extended.model.effects if found.extended else ()
    off_normal_fit = tuple(effect for effect in kept if effect.off_normal_std)
    return found.fit_rivals(replace(calibration, model=calibration.model.with_effects(off_normal_fit)))


def _discriminating_touches(
    calibration: Calibration, rivals: Sequence[Calibration]
) -> tuple[DiscriminatingTouch, ...] | None:
    """The touches that would tell rivals apart; None where there are no two to compare."""
    return discriminating_touches(calibration, rivals) if len(rivals) > 1 else None


def adequacy(
    calibration: Calibration, problem: Problem | None = None, candidate_set: CandidateSet | None = None
) -> Adequacy:
    """Test a model against all that its residual could depend on.

    Args:
        calibration: with or without effects.
        problem: the linear problem it leaves.
        field: further candidates to test; None for none.
    """
    c = calibration
    dependences = list(find_dependences(without_direction(c)))
    if problem is not None and candidate_set is not None:
        dependences += [
            Dependence(candidate.effect.title, *significance(problem, candidate))
            for candidate in {
                candidate.effect.label: candidate for candidate in reversed(candidate_set.candidates)
            }.values()
        ]
    given = c.noise_source == 'given'
    size = float(special.chdtrc(c.degrees_of_freedom, c.chi_square)) if given else 1.0
    tests = max(len(dependences) + given, 1)
    smallest = min([size, *(dependence.p_value for dependence in dependences)])
    found = sorted(
        (dependence for dependence in dependences if dependence.p_value * tests < SIGNIFICANCE), key=lambda t: t.p_value
    )
    return Adequacy(min(1.0, smallest * tests), tuple(found))


def _verdict(found: Search, described: Sequence[Found], after: Adequacy) -> str:
    if after.p_value < SIGNIFICANCE or any(not item.effect.is_physical and item.in_every_model for item in described):
        return 'unexplained'
    return 'ambiguous' if found.rivals else 'explained'


def _describe(found: Search, rivals: Sequence[Calibration]) -> tuple[Found, ...]:
    """The effects of the extended model with their values; those of a rival are what it has if it is this one."""
    assert found.extended is not None
    items = []
    for effect, values in _with_values(found.extended):
        in_every_model = effect.label in found.in_every_model
        if not in_every_model:
            alone = [rows for rival in rivals for other, rows in _with_values(rival) if other.label == effect.label]
            values = alone[0] if alone else tuple(value._replace(value=np.nan, std=np.nan) for value in values)
            if effect.grid_parameter:  # nobody has looked for other frequencies of this fit
                values = tuple(value._replace(std=np.nan) for value in values)
        items.append(Found(effect, values, in_every_model))
    return tuple(items)


def _with_values(calibration: Calibration) -> list[tuple[Effect, tuple[Value, ...]]]:
    """The effects of a calibration with their estimates."""
    items = []
    for effect, (values, stds) in zip(calibration.model.effects, effect_values(calibration), strict=True):
        assert isinstance(effect, Effect)
        rows = tuple(
            Value(p.name, float(v), float(s), p.unit, p.meaning)
            for p, v, s in zip(effect.parameters, values, stds, strict=True)
        )
        if effect.off_normal_std:
            std = effect.off_normal_std / np.sqrt(2 * calibration.used.sum())
            rows = (
                Value(
                    'off_normal_angle',
                    effect.off_normal_std,
                    float(std),
                    'rad',
                    'of the force from the normal, root mean square',
                ),
            )
        items.append((effect, rows))
    return items


def _ranking(found: Search, calibration: Calibration) -> tuple[Ranked, ...]:
    """Every effect by itself: its scores and what became of it."""
    rivals = {label for group in found.rivals for label in group}
    std = (found.extended or calibration).std
    ranked = []
    for score in score_singles(found.problem, found.scored_subsets):
        label = score.candidate.effect.label
        role = 'found' if label in found.in_every_model else 'rival' if label in rivals else 'rejected'
        bias, place = undetected_bias(found.problem, score.candidate, std)
        scores = score.p_value, score.share, score.gain, score.held_out
        ranked.append(Ranked(score.candidate.effect, role, *scores, score.independent_part, bias, NAMES[place]))
    for item in found.scored_subsets.candidate_set.unidentifiable:
        ranked.append(Ranked(item.effect, 'unidentifiable', np.nan, 0.0, 0.0, 0.0, item.independent_part))
    return tuple(ranked)
