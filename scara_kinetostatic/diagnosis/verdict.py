"""What the diagnosis says: nothing is missing, a lack of fit is unexplained, or effects extend the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import advice, noise_advice
from scara_kinetostatic.diagnosis.adequacy import Adequacy, BaseTests, adequacy
from scara_kinetostatic.diagnosis.alternatives import (
    alternative_places,
    fit_alternative_frequencies,
    fit_alternative_laws,
    widened_by,
    widened_by_constants,
    widened_to_each,
)
from scara_kinetostatic.diagnosis.discriminating_touches import discriminating_touches
from scara_kinetostatic.diagnosis.effort import Effort
from scara_kinetostatic.diagnosis.model_selection import rank_singles
from scara_kinetostatic.diagnosis.moments import at_best_moments, find_moments, widened_by_moments
from scara_kinetostatic.diagnosis.ranking import score_singles, undetected_bias
from scara_kinetostatic.diagnosis.refit import FittedEffect, fitted_effects
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked, Value
from scara_kinetostatic.diagnosis.search import Search
from scara_kinetostatic.diagnosis.thresholds import SIGNIFICANCE
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.model.parameters import NAMES


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
    c: Calibration,
    tests: BaseTests,
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
