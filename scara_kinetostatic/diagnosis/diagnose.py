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

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.calibration.tip_uncertainty import tip_uncertainty
from scara_kinetostatic.diagnosis import advice
from scara_kinetostatic.diagnosis.alternatives import cover_alternatives, find_moments, widened_by, widened_by_moments
from scara_kinetostatic.diagnosis.candidates import all_candidates
from scara_kinetostatic.diagnosis.comparison import discriminating_touches
from scara_kinetostatic.diagnosis.lack_of_fit import Adequacy, Dependence, adequacy, off_normal_p_value
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    SIGNIFICANCE,
    STRICT_SIGNIFICANCE,
    FittedEffect,
    fitted_effects,
    pose_problem,
)
from scara_kinetostatic.diagnosis.mixed_model import with_undetected
from scara_kinetostatic.diagnosis.model_selection import rank_singles, score_singles
from scara_kinetostatic.diagnosis.noise_structure import likelier, noise_candidate
from scara_kinetostatic.diagnosis.refit import Effort, Rival, fit_again
from scara_kinetostatic.diagnosis.result import Contradiction, Diagnosis, Found, Ranked, Value
from scara_kinetostatic.diagnosis.search import Search, fit_rivals, select_hypothesis
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.cell import SizeMode

_FAR = 3.0
"""Ratio of two uncertainties of the tip above which one is far better."""


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
    known = tuple(effect for effect in offered if effect.label not in calibration.held_effects)
    found = _named(calibration, known)
    return _with_undetected(calibration, found, known)


def _with_undetected(c: Calibration, found: Diagnosis, known: Sequence[Effect]) -> Diagnosis:
    """The diagnosis with what undetected effects contribute to the uncertainty of the models that it gives."""
    if not c.cell.uncertainty.effects.in_use:
        return found
    found = replace(found, refitted=with_undetected(found.refitted or c, known))
    if found.extended is None:
        return found
    extended = with_undetected(found.extended, known)
    stds = {label: {name: part.std for name, part in of.items()} for label, of in extended.effects.items()}
    items = [
        item._replace(values=tuple(v._replace(std=stds[item.effect.label].get(v.name, v.std)) for v in item.values))
        if item.in_every_model and item.effect.label in stds
        else item
        for item in found.found
    ]
    return replace(found, extended=extended, found=tuple(items))


def _named(calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with a test of the trusted nominal values."""
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
    fit = fit_again(c, calibrate, cell=cell)
    return fit if fit is not None and fit.termination is Termination.CONVERGED else None


def _shares(c: Calibration) -> int:
    """Among how many kinds of tests of what is declared their half of the false alarms is divided."""
    return int(len(c.errors) > 0) + int(c.trusted > 0)


def _with_likeliest_noise(calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise as stated or estimated, or with the component that the touches ask for."""
    found = _bounded(Effort(), calibration, known)
    effort = Effort(280.0)
    refitted = noise_candidate(calibration, found, effort)
    if refitted is None:
        return found
    return likelier(found, calibration, _bounded(effort, refitted, known), refitted)


def _bounded(effort: Effort, calibration: Calibration, known: tuple[Effect, ...]) -> Diagnosis:
    """The diagnosis with the noise of a calibration, estimated where it is stated too large.

    Where fits were left out, others may explain the touches as well: its names are then suspicions.
    """
    overstated = advice.overstated_noise(calibration)
    found = None if overstated else _examine(calibration, known, effort)
    if found is not None and found.extended is not None:
        overstated = advice.overstated_noise(found.extended)
    if found is None or overstated:
        cell = replace(calibration.cell, noise=None)
        found = _examine(fit_again(calibration, calibrate, cell=cell) or calibration, known, effort)
    noise = advice.noise_found(found.extended or calibration)
    fixed = advice.fixed_parameters(calibration) if found.verdict != 'none' else ''
    unknown, premises = advice.unknown_history(calibration.touches, found), advice.premises(found)
    found = replace(found, advice=advice.joined(overstated, noise, found.advice, fixed, unknown, premises))
    if not effort.has_left_out:
        return found
    is_named = found.verdict in {'explained', 'ambiguous'}
    return replace(
        found,
        verdict='unexplained' if is_named else found.verdict,
        found=tuple(_as_suspicion(item) if item.in_every_model else item for item in found.found),
        ranking=tuple(item._replace(role='possible') if item.role == 'found' else item for item in found.ranking),
        advice=advice.joined(advice.CUT_SHORT, found.advice),
    )


def _examine(c: Calibration, known: tuple[Effect, ...], effort: Effort) -> Diagnosis:
    """Test the base model, select the likeliest hypothesis, and report nothing, a lack of fit or an extended model.

    Where uncertainties are declared, half of the false alarms that are accepted are those of tests of what they are
    about (weighted Bonferroni: Genovese, Roeder and Wasserman, Biometrika 93 (2006) 509).
    """
    problem = pose_problem(c)
    candidate_set = all_candidates(c, problem, known, together=False)
    fit, off_normal = adequacy(c, problem, candidate_set), off_normal_p_value(c)
    halves = 2 if fit.declared_p_value is not None or c.trusted else 1
    declared = 1.0 if fit.declared_p_value is None else fit.declared_p_value
    p_value = min(1.0, 2 * halves * min(fit.p_value, off_normal), halves * max(_shares(c), 1) * declared)
    implausible = '; '.join(advice.implausible_noise(c) or ())
    alarm = p_value < SIGNIFICANCE or bool(implausible)
    found, lead = select_hypothesis(c, known, alarm, off_normal < SIGNIFICANCE / 2, effort)
    if found is not None and p_value >= SIGNIFICANCE:
        p_value = min(p_value, float(np.exp(-lead / 2)))
    is_weak = not implausible and p_value >= STRICT_SIGNIFICANCE and found is not None and found.gain < CREDIBLE
    if found is None or is_weak:
        ranking = _ranking(Search(problem, rank_singles(problem, candidate_set), None))
        evidence = advice.weak_evidence(p_value, fit.dependences) if is_weak else ''
        return Diagnosis('none', p_value, remaining_p_value=p_value, ranking=ranking, advice=evidence)
    if found.extended is not None:
        return _with_extended_model(c, p_value, fit.dependences, found, found.extended, known, effort)
    return Diagnosis(
        verdict='unexplained',
        p_value=p_value,
        dependences=fit.dependences,
        remaining=fit.dependences,
        remaining_p_value=p_value,
        ranking=_ranking(found),
        advice=implausible or advice.unexplained(c, fit.dependences),
    )


def _with_extended_model(
    c: Calibration,
    p_value: float,
    dependences: tuple[Dependence, ...],
    found: Search,
    fitted: Calibration,
    known: tuple[Effect, ...],
    effort: Effort,
) -> Diagnosis:
    """The diagnosis with an extended model: verdict, effects, standard deviations that cover rivals and alternatives.

    Args:
        c: the base model.
        p_value: of "it is complete".
        dependences: what its residual depends on.
        found: the selected hypothesis.
        fitted: its fit.
        known: the catalogue.
        effort: of the diagnosis.
    """
    held = fitted.held_effects  # each credible set is fitted by itself; off-normal angles stay
    kept = tuple(effect for effect in fitted.model.effects if effect.off_normal_std or effect.label in held)
    weighted = fit_rivals(found, replace(c, model=c.model.with_effects(kept)), effort) if found.rivals else []
    rivals = [rival.fit for rival in weighted]
    together, (fitted, moments) = fitted, find_moments(_better_known(fitted, weighted))
    after = adequacy(fitted)
    extended, frequencies = cover_alternatives(fitted, weighted, found.in_every_model, effort)
    extended = widened_by_moments(extended, moments)
    rivals_at_moments = [widened_by_moments(rival, find_moments(rival, refit=False)[1]) for rival in rivals]
    effects = _describe(extended, together, found.in_every_model, rivals_at_moments)
    verdict = _verdict(found, effects, after)
    if verdict == 'unexplained':
        effects, extended = tuple(_as_suspicion(item) for item in effects), _covering_no_curve(extended, effort)
    touches = discriminating_touches(c, rivals) if len(rivals) > 1 else None
    return Diagnosis(
        verdict=verdict,
        p_value=p_value,
        found=effects,
        rivals=found.rivals,
        extended=extended,
        dependences=dependences,
        remaining=after.dependences,
        remaining_p_value=after.p_value,
        ranking=_ranking(found, tuple(item.effect.label for item in effects if item.is_possible)),
        advice=advice.joined(
            advice.moments(effects, moments),
            advice.open_questions(verdict, effects, found.rivals, after.dependences, known, touches),
            advice.alternative_frequencies(fitted, frequencies),
            advice.alternative_laws(fitted, extended),
            advice.large_noise(fitted),
        ),
        discriminating=touches,
    )


def _covering_no_curve(extended: Calibration, effort: Effort) -> Calibration:
    """An extended model whose standard deviations cover the fit without its curves, which may take up parameters."""
    physical = tuple(effect for effect, _, _ in fitted_effects(extended) if effect.is_physical)
    if len(physical) == len(extended.model.effects):
        return extended
    without = fit_again(extended, effort.fit, model=extended.model.with_effects(physical))
    return extended if without is None else widened_by(extended, [without])


def _better_known(together: Calibration, rivals: Sequence[Rival]) -> Calibration:
    """The fit with all credible effects, or that with the likeliest set where the tip is far better known by it,
    although its rivals count: together, such as two of three discs free, they may leave hardly anything determined.
    """
    if together.cell.uncertainty.effects.sizes is not SizeMode.ESTIMATED or not rivals:
        return together
    fits, weights = [rival.fit for rival in rivals], [rival.weight for rival in rivals]
    likeliest = fits[int(np.argmax(weights))]
    every, one = (tip_uncertainty(widened_by(fit, fits, weights)).median for fit in (together, likeliest))
    return likeliest if np.isfinite(one) and not every <= _FAR * one else together


def _verdict(found: Search, effects: Sequence[Found], after: Adequacy) -> str:
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


def _describe(
    extended: Calibration, together: Calibration, in_every_model: Sequence[str], rivals: Sequence[Calibration]
) -> tuple[Found, ...]:
    """All credible effects with their values in the extended model; a rival has those of the model with it alone."""
    own = {item.effect.label: item for item in fitted_effects(extended)}
    alone = [(item.effect.label, _values(item, rival)) for rival in reversed(rivals) for item in fitted_effects(rival)]
    by_label = dict(alone)
    items = []
    for item in (own.get(one.effect.label, one) for one in fitted_effects(together)):
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


def _ranking(found: Search, possible: Sequence[str] = ()) -> tuple[Ranked, ...]:
    """Every effect by itself: its scores and its role; `possible` are the labels of suspicions."""
    rivals = {label for group in found.rivals for label in group}
    ranked = []
    for candidate, scores in score_singles(found.problem, found.scored_subsets):
        label = candidate.effect.label
        role = 'found' if label in found.in_every_model else 'rival' if label in rivals else 'rejected'
        role = 'possible' if role == 'found' and label in possible else role
        ranked.append(Ranked(candidate.effect, role, *scores))
    for item in found.scored_subsets.candidate_set.unidentifiable:
        ranked.append(Ranked(item.effect, 'unidentifiable', np.nan, 0.0, 0.0, item.independent_part))
    return tuple(ranked)
