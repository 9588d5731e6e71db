"""Alternative laws and frequencies of the effects found, and standard deviations that cover them.

The law of an effect is an assumption. A contact that yields by f^(2/3) and one that yields by f^(1/2) fit a few force
levels alike, and differ in what they leave to p_ee and g_ee. The frequency of a wave may be wrong as well: the offsets
and link lengths take up most of a slow wave, and the residual resembles one of another frequency; of a small wave a
neighbouring peak may be higher by chance. Every law and every frequency that fit the touches equally well are fitted,
and the standard deviations of the extended model are widened to cover them.

**Moments.** An effect may begin or end in a step between two touches. Nothing changes between two touches, so a fit
holds the moment (`Effect.is_stepwise`). Every moment is compared in the linear problem at the fit: with χ²_k the least
sum of squares with the moment k, in units of s², its weight is exp(-χ²_k/2), as all are equally likely before. What
the choice adds to the covariance is the scatter of the estimates over the moments, and a moment itself may lie
anywhere between its two touches.
"""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import ALTERNATIVES, Calibration, Contribution
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.candidates import Candidate, Scan, as_fitted, explained, gains, refined, scan_trials
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    DISTINCT,
    Problem,
    fitted_effects,
    orthonormal,
    pose_problem,
)
from scara_kinetostatic.diagnosis.refit import (
    Effort,
    Rival,
    fit_again,
    penalised_deviance,
    start_from,
    with_rejections_of,
)
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G1, G2, G_EE, NAMES, P1, P2, P_EE


def cover_alternatives(
    extended: Calibration, rivals: Sequence[Rival], in_every_model: Container[str], effort: Effort
) -> tuple[Calibration, list[Calibration]]:
    """The extended model with standard deviations that cover all that is credible beside it, but for moments.

    Args:
        extended: the extended model.
        rivals: the touches fitted with each credible set of effects.
        in_every_model: labels of effects without rivals; the frequency of a rival, which explains a part, is vague.
        effort: of the diagnosis.

    Returns:
        The model, and its alternatives with other frequencies or places on their grids.
    """
    frequencies = _fit_variants(extended, _other_frequencies(extended, in_every_model), effort)
    frequencies += alternative_places(extended)
    laws = _fit_variants(extended, _other_laws(extended), effort)
    fits = [rival.fit for rival in rivals]
    wide = _widened_to_each(widened_by(extended, fits, [rival.weight for rival in rivals]), [*laws, *frequencies])
    return widened_by_constants(wide, [wide, *fits]), frequencies


def _other_laws(extended: Calibration) -> list[ExtendedModel]:
    """The model with alternative laws of its effects, to start from."""
    model, variants = extended.model, []
    for place, (effect, _, _) in enumerate(fitted_effects(extended)):
        for other in effect.alternative_laws():
            effects, values = list(model.effects), list(model.effect_values)
            effects[place], values[place] = other, other.start
            variants.append(ExtendedModel(model.parameters, tuple(effects), tuple(values)))
    return variants


def _other_frequencies(extended: Calibration, in_every_model: Container[str]) -> list[ExtendedModel]:
    """The model with other frequencies of its effects that explain nearly as much, to start from."""
    fitted, variants = fitted_effects(extended), []
    waves = [
        k
        for k, (effect, _, _) in enumerate(fitted)
        if effect.grid_parameter and effect.is_smooth and not effect.is_stepwise and effect.label in in_every_model
    ]
    if not waves:
        return []
    problem, found = _linear(extended)
    for place in waves:
        k = fitted[place].effect.grid_parameter_index
        frequency, std = fitted[place].values[k], fitted[place].std[k]
        for peak in _peaks(problem, found, place, max(1.0, extended.reduced_chi_square)):
            if abs(peak.trial.place - frequency) > DISTINCT * std:
                variants.append(_start_with(problem, found, place, peak))
    return variants


def alternative_places(extended: Calibration) -> list[Calibration]:
    """An extended model with its effects at other places of their grids, where the touches are explained equally well.

    For laws with kinks, whose optimum along the grid is a valley with many small ones in it: the curvature at one of
    them says nothing of the width of the valley. They are not fitted anew, which would lead to the nearest optimum,
    but are those of the linear problem, with all other parameters at their best.
    """
    fitted = fitted_effects(extended)
    places = [k for k, (effect, _, _) in enumerate(fitted) if effect.grid_parameter and not effect.is_smooth]
    if not places:
        return []
    problem, found = _linear(extended)
    models = [
        _start_with(problem, found, place, other)
        for place in places
        for other in _credible_trials(problem, found, place, max(1.0, extended.reduced_chi_square))
    ]
    others = [replace(extended, model=model) for model in models]
    return [other for other in others if _has_physical_compliances(other) and _is_plausible(other)]


def _credible_trials(problem: Problem, found: list[Candidate], place: int, scale: float) -> list[Candidate]:
    """The trials of an effect that explain the touches as well as its fit, or the best trial, beside other effects."""
    scan, beside = _scan_beside(problem, found, place)
    if not scan.columns.any():
        return []
    gained = gains(problem, scan, beside)
    best = max(float(gained.max()), _explained_beside(problem, found[place], beside))
    near = np.flatnonzero(gained > best - CREDIBLE * scale)
    candidates = [scan.candidate(problem, k) for k in near.tolist()]
    return [candidate for candidate in candidates if candidate.unit.shape[1]]


def _is_plausible(fit: Calibration) -> bool:
    return all(effect.is_plausible(values) for effect, values, _ in fitted_effects(fit))


def _scan_beside(
    problem: Problem, found: list[Candidate], place: int, trials: Sequence[Trial] = ()
) -> tuple[Scan, Floats | None]:
    """Trials of an effect, by default all that it has, and an orthonormal basis of the other effects."""
    effect = found[place].effect
    trials = trials or effect.trials(problem.touch_state, problem.force)
    others = [candidate.unit for k, candidate in enumerate(found) if k != place]
    beside = orthonormal(np.concatenate(others, axis=1)) if any(unit.size for unit in others) else None
    return scan_trials(problem, effect, trials, len(trials)), beside


def _explained_beside(problem: Problem, candidate: Candidate, beside: Floats | None) -> float:
    """Decrease of the sum of squares by an effect as fitted beside the others."""
    unit = candidate.unit
    unit = unit if beside is None or not unit.size else orthonormal(unit, beside)
    return float(np.sum((unit.T @ problem.left) ** 2))


def _peaks(problem: Problem, found: list[Candidate], place: int, scale: float) -> list[Candidate]:
    """The frequencies of an effect that explain nearly as much as the best, beside the other effects."""
    scan, beside = _scan_beside(problem, found, place)
    gained = gains(problem, scan, beside)
    padded = np.concatenate([[-np.inf], gained, [-np.inf]])
    tops = np.flatnonzero((gained >= padded[:-2]) & (gained >= padded[2:]))
    # so much of what a wave explains may be lost at the nearest frequency of the grid, with a margin
    least = (1 - 0.2) * float(gained.max()) - CREDIBLE * scale
    peaks = [refined(problem, scan, k, gained, beside) for k in tops.tolist() if gained[k] > least]
    return sorted(peaks, key=lambda peak: -explained(problem, peak))[:4]


def _fit_variants(extended: Calibration, variants: Sequence[ExtendedModel], effort: Effort) -> list[Calibration]:
    """Fits that start from other models, where they are credible beside the extended one.

    Args:
        extended: the extended model.
        variants: the models to start from.
        effort: of the diagnosis; variants beyond it are left out.
    """
    scale = max(1.0, extended.reduced_chi_square)
    limit = penalised_deviance(extended, 0.0, scale) + CREDIBLE
    fits = [
        fit
        for variant in variants
        if effort.allows()
        and (fit := fit_again(extended, effort.fit, model=variant))
        and fit.termination is Termination.CONVERGED
    ]
    return [fit for fit in fits if _has_physical_compliances(fit) and penalised_deviance(fit, 0.0, scale) < limit]


def _has_physical_compliances(fit: Calibration) -> bool:
    """Whether no compliance and no backlash is significantly negative."""
    which = np.array([P_EE, P1, P2, G_EE, G1, G2])
    values, std = fit.parameters.as_array()[which], fit.std[which]
    return not np.any(values < -3.0 * std)


def _widened_to_each(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with standard deviations within one of which every other fit lies.

    Args:
        extended: the extended model.
        others: the alternatives; the farthest is taken first.
    """

    def distance(other: Calibration) -> float:
        off = other.parameters.as_array() - extended.parameters.as_array()
        return float(np.nanmax(np.abs(off) / np.where(extended.std > 0, extended.std, np.inf), initial=0.0))

    wide = extended
    for other in sorted(others, key=distance, reverse=True):
        off = np.abs(other.model.as_array() - extended.model.as_array())
        same_effects = other.model.effects == extended.model.effects
        std = np.concatenate([wide.std, wide.effect_std])
        beyond = off > np.where(std > 0, std, np.inf)
        if beyond[: len(std) if same_effects else extended.model.base_count].any():
            wide = widened_by(wide, [other])
    return wide


def widened_by(
    extended: Calibration, others: Sequence[Calibration], weights: Sequence[float] | None = None
) -> Calibration:
    """The extended model with the scatter of other fits about it, by their weights, added to its covariance.

    It is added to the base parameters, and to those of the effects if all fits have the same.
    """
    if not others:
        return extended
    same_effects = all(other.model.effects == extended.model.effects for other in others)
    count = len(extended.covariance) if same_effects else extended.model.base_count
    off = np.array([other.model.as_array()[:count] - extended.model.as_array()[:count] for other in others])
    more = np.zeros_like(extended.covariance)
    weight = np.ones(len(off)) if weights is None else np.array(weights)
    more[:count, :count] = (weight * off.T) @ off / weight.sum()
    return _widened(extended, more)


def _widened(extended: Calibration, more: Floats, with_moments: bool = False) -> Calibration:
    """An extended model with something added to its covariance, as the contribution of other credible models; what is
    confounded or held stays so, but for moments that are being added.
    """
    covariance = extended.covariance + more
    known = [part for part in extended.contributions if part.label != ALTERNATIVES]
    rest = covariance - np.sum([part.covariance for part in known], axis=0)
    before, std = np.concatenate([extended.std, extended.effect_std]), np.sqrt(np.diag(covariance))
    std = np.where((before > 0) | (with_moments & (before == 0)), std, before)
    return replace(
        extended,
        covariance=covariance,
        contributions=(*known, Contribution(ALTERNATIVES, None, '', rest)),
        std=std[: extended.model.base_count],
        effect_std=std[extended.model.base_count :],
    )


def widened_by_constants(extended: Calibration, fits: Sequence[Calibration]) -> Calibration:
    """The extended model with the undetermined constants of fitted curves added to its covariance.

    A constant added to a curve changes a base parameter instead of the fit (`Effect.undetermined_constant`); of several
    curves the largest counts.

    Args:
        extended: the extended model.
        fits: it and those of rivals.
    """
    largest: dict[str, float] = {}
    for fit in fits:
        curves = [(effect, values) for effect, values, _ in fitted_effects(fit) if not effect.is_physical]
        at = pose_problem(fit).touch_state if curves else None
        for effect, values in curves:
            constant = effect.undetermined_constant(at, values) if at is not None else None
            if constant is not None:
                name, size = constant
                largest[name] = max(size, largest.get(name, 0.0))
    more = np.zeros_like(extended.covariance)
    for name, size in largest.items():
        place = NAMES.index(name)
        more[place, place] += size**2 if extended.std[place] > 0 else 0.0
    return _widened(extended, more) if largest else extended


class Moment(NamedTuple):
    """The moment of one stepwise effect of a fit.

    Attributes:
        effect: the effect.
        text: between which touches it is, with a probability of 95 %.
        covariance: what the choice adds to that of all values of the model, (12 + k, 12 + k).
    """

    effect: Effect
    text: str
    covariance: Floats


_Scanned = tuple[Scan, Floats, float]
"""All moments of one effect, the decrease of χ² by each in units of s², and that by the moment of the fit."""


def find_moments(extended: Calibration, refit: bool = True) -> tuple[Calibration, tuple[Moment, ...]]:
    """The moments of the stepwise effects of an extended model.

    Args:
        extended: the extended model.
        refit: whether it is fitted again, up to three times, where the linear problem at its fit has a better moment.

    Returns:
        The model at its best moments, and these.
    """
    left = 3 if refit else 0
    if not any(effect.is_stepwise for effect, _, _ in fitted_effects(extended)):
        return extended, ()
    while True:
        problem, found = _linear(extended)
        scans = {
            place: scanned
            for place, (effect, _, _) in enumerate(fitted_effects(extended))
            if effect.is_stepwise and (scanned := _scan_moments(extended, problem, found, place)) is not None
        }
        # χ² has to decrease for a further fit
        better = [place for place, (_, gained, fitted) in scans.items() if gained.max() >= fitted + 0.2]
        again = _at_better_moment(extended, problem, found, better[0], scans[better[0]]) if better and left else None
        if again is None or penalised_deviance(again, 0.0, 1.0) >= penalised_deviance(extended, 0.0, 1.0):
            break
        extended, left = again, left - 1
    return extended, tuple(_moment(extended, problem, found, *item) for item in scans.items())


def _scan_moments(extended: Calibration, problem: Problem, found: list[Candidate], place: int) -> _Scanned | None:
    """All moments of one effect of a fit, the others held as they are; None where none is identifiable."""
    effect, values, _ = fitted_effects(extended)[place]
    moment = float(values[effect.grid_parameter_index])
    trials = effect.trials(problem.touch_state, problem.force)
    nearest = min(trials, key=lambda trial: abs(trial.place - moment))
    # where the grid does not hold all moments, those within three of its steps count
    trials = effect.finer(problem.touch_state, nearest, 3.0) or trials
    scan, beside = _scan_beside(problem, found, place, trials)
    if not scan.columns.any():
        return None
    scale = max(1.0, extended.reduced_chi_square) if problem.noise_given else extended.reduced_chi_square
    scale = max(scale, 1e-300)
    return scan, gains(problem, scan, beside) / scale, _explained_beside(problem, found[place], beside) / scale


def _at_better_moment(
    extended: Calibration, problem: Problem, found: list[Candidate], place: int, scanned: _Scanned
) -> Calibration | None:
    """The fit with the likeliest moment of one effect; None if it does not converge."""
    scan, gained, _ = scanned
    other = scan.candidate(problem, int(np.argmax(gained)))
    fit = fit_again(extended, calibrate, model=_start_with(problem, found, place, other), errors=None)
    if fit is None or fit.termination is not Termination.CONVERGED:
        return None
    return with_rejections_of(fit, extended)


def _moment(extended: Calibration, problem: Problem, found: list[Candidate], place: int, scanned: _Scanned) -> Moment:
    scan, gained, _ = scanned
    effect, touches, weight = scan.effect, extended.touches, np.exp((gained - gained.max()) / 2)
    moments = np.array([trial.place for trial in scan.trials])
    order = np.sort(touches.order[extended.used])
    known = problem.touch_state.metadata.order
    acts = order if known is None else np.sort(known[effect.acts_on(problem.touch_state)])
    likeliest = np.argsort(-weight)
    likely = moments[likeliest[: int(np.searchsorted(np.cumsum(weight[likeliest]) / weight.sum(), 0.95)) + 1]]
    low = float(acts[acts < likely.min()].max(initial=order[0]))
    high = float(acts[acts > likely.max()].min(initial=order[-1]))
    two = [int(np.flatnonzero(touches.order == one)[0]) for one in (low, high)]
    first, second = touches.recording[two].tolist()
    renumbered = np.any(touches.index[two] != touches.order[two])
    where = ['numbered in the order of time'] if renumbered else []
    where += [f'that is between the recordings {first + 1} and {second + 1}'] if first != second else []
    covariance = _scatter(extended, problem, found, place, scan, weight)
    row = sum(map(len, extended.model.effect_values[:place])) + extended.model.base_count + effect.grid_parameter_index
    # a moment may lie anywhere between its two touches
    after = np.clip(np.searchsorted(acts, moments), 1, len(acts) - 1)
    covariance[row, row] += float(np.sum(weight * (acts[after] - acts[after - 1]) ** 2 / 12) / weight.sum())
    text = ', '.join([f'{effect.title} between the touches {low:.0f} and {high:.0f}', *where])
    return Moment(effect, text, covariance)


def _linear(extended: Calibration) -> tuple[Problem, list[Candidate]]:
    """The linear problem at a fit, and its effects as fitted."""
    problem = pose_problem(extended)
    return problem, [as_fitted(problem, effect, values, 1) for effect, values, _ in fitted_effects(extended)]


def _start_with(problem: Problem, found: list[Candidate], place: int, other: Candidate) -> ExtendedModel:
    """The model of the linear problem with another candidate in place of one effect."""
    return start_from(problem, [*found[:place], other, *found[place + 1 :]])[0]


def widened_by_moments(extended: Calibration, moments: tuple[Moment, ...]) -> Calibration:
    """An extended model with a covariance that covers the choice of its moments."""
    if not moments:
        return extended
    return _widened(extended, np.sum([moment.covariance for moment in moments], axis=0), with_moments=True)


def _scatter(
    extended: Calibration, problem: Problem, found: list[Candidate], place: int, scan: Scan, weight: Floats
) -> Floats:
    """Weighted mean square of the estimates at other moments less those of the fit, (12 + k, 12 + k)."""
    own = extended.model.as_array()
    here = start_from(problem, found)[0].as_array()
    scatter, total = np.zeros((len(own), len(own))), float(weight.sum())
    for k in np.flatnonzero(weight > 1e-3):
        candidate = scan.candidate(problem, int(k))
        if not candidate.unit.shape[1]:
            continue
        off = _start_with(problem, found, place, candidate).as_array() - here
        off[np.isnan(np.concatenate([extended.std, extended.effect_std]))] = 0.0
        scatter += weight[k] / total * np.outer(off, off)
    fixed = np.concatenate([extended.std == 0, np.zeros(len(own) - extended.model.base_count, dtype=bool)])
    scatter[fixed] = scatter[:, fixed] = 0.0
    return scatter
