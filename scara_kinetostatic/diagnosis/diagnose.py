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
from scara_kinetostatic.diagnosis.lack_of_fit import PENALTY, fit_again, noise_candidate
from scara_kinetostatic.diagnosis.linear_problem import SIGNIFICANCE
from scara_kinetostatic.diagnosis.mixed_model import HEAVY_TAILS, fit_mixed
from scara_kinetostatic.diagnosis.result import Contradiction, Dependence, Diagnosis
from scara_kinetostatic.diagnosis.search import likeliest
from scara_kinetostatic.diagnosis.verdict import mean_over_sets, report
from scara_kinetostatic.diagnosis.weighing import weigh
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.registry import catalogue


def diagnose(calibration: Calibration, effects: Sequence[Effect] | None = None) -> Diagnosis:
    """Test whether the base model is complete, and find what it lacks.

    Assumes Gaussian noise and independent touches. The p-value is that of `report`. Where the stated noise is too
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
            diagnosis, deviance = report(base, likeliest(base, known))
            # undetected errors take from the residual; without them it is as large at least as the noise
            if diagnosis.extended is not None and advice.overstated_noise(diagnosis.extended):
                plain = fit_again(diagnosis.extended)
                overstated = '' if plain is None else advice.overstated_noise(plain)
        if diagnosis is None or overstated:
            free = fit_again(base, cell=replace(base.cell, noise=None)) or base
            diagnosis, deviance = report(free, likeliest(free, known))
        if overstated and diagnosis.verdict == 'none' and diagnosis.refitted is not None:
            stated = weigh(fit_mixed(base, known, freedoms=HEAVY_TAILS), known)
            diagnosis = replace(diagnosis, refitted=mean_over_sets(stated, stated.model.fit))
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
