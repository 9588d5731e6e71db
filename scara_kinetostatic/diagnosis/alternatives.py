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
from scara_kinetostatic.diagnosis.candidates import (
    Candidate,
    Scan,
    ScannedTrial,
    as_fitted,
    explained,
    gains,
    refined,
    scan_trials,
)
from scara_kinetostatic.diagnosis.linear_problem import (
    CREDIBLE,
    DISTINCT,
    Problem,
    fitted_effects,
    orthonormal,
    pose_problem,
)
from scara_kinetostatic.diagnosis.refit import Effort, fit_again, penalised_deviance, start_from, with_rejections_of
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import G1, G2, G_EE, NAMES, P1, P2, P_EE


def fit_alternative_laws(extended: Calibration, effort: Effort) -> list[Calibration]:
    """The touches of an extended model fitted with alternative laws of its effects, where these fit equally well."""
    model, variants = extended.model, []
    for place, (effect, _, _) in enumerate(fitted_effects(extended)):
        for other in effect.alternative_laws():
            effects, values = list(model.effects), list(model.effect_values)
            effects[place], values[place] = other, other.start
            variants.append(ExtendedModel(model.parameters, tuple(effects), tuple(values)))
    return _fit_variants(extended, variants, effort)


def fit_alternative_frequencies(
    extended: Calibration, in_every_model: Container[str], effort: Effort
) -> list[Calibration]:
    """The touches of an extended model fitted with other frequencies of its effects, where these fit equally well.

    Args:
        extended: the extended model.
        in_every_model: labels of effects without rivals; the frequency of a rival, which explains a part, is vague.
        effort: of the diagnosis.
    """
    fitted = fitted_effects(extended)
    waves = [
        k
        for k, (effect, _, _) in enumerate(fitted)
        if effect.grid_parameter and effect.is_smooth and not effect.is_stepwise and effect.label in in_every_model
    ]
    if not waves:
        return []
    problem, found = _linear(extended)
    variants = []
    for place in waves:
        k = fitted[place].effect.grid_parameter_index
        frequency, std = fitted[place].values[k], fitted[place].std[k]
        for peak in _peaks(problem, found, place, max(1.0, extended.reduced_chi_square)):
            if abs(peak.trial.place - frequency) > DISTINCT * std:
                variants.append(start_from(problem, [*found[:place], peak, *found[place + 1 :]])[0])
    return _fit_variants(extended, variants, effort)


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
        start_from(problem, [*found[:place], other, *found[place + 1 :]])[0]
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
    candidates = [ScannedTrial(scan, k).candidate(problem) for k in near.tolist()]
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
    found_at = [ScannedTrial(scan, k) for k in tops.tolist() if gained[k] > least]
    peaks = [refined(problem, top, float(gained[top.k]), beside).candidate(problem) for top in found_at]
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


def widened_to_each(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
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
        if beyond[: len(std) if same_effects else len(NAMES)].any():
            wide = widened_by(wide, [other])
    return wide


def widened_by(extended: Calibration, others: Sequence[Calibration]) -> Calibration:
    """The extended model with the scatter of other fits about it added to its covariance.

    It is added to the base parameters, and to those of the effects if all fits have the same.
    """
    if not others:
        return extended
    same_effects = all(other.model.effects == extended.model.effects for other in others)
    count = len(extended.covariance) if same_effects else len(NAMES)
    off = np.array([other.model.as_array()[:count] - extended.model.as_array()[:count] for other in others])
    more = np.zeros_like(extended.covariance)
    more[:count, :count] = off.T @ off / len(off)
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
        std=std[: len(NAMES)],
        effect_std=std[len(NAMES) :],
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


_COVERAGE = 0.95
"""Of the interval that is stated."""


class Moment(NamedTuple):
    """The moment of one effect of a fit.

    Attributes:
        effect: the effect.
        low: the last touch that is before it with a probability of `_COVERAGE`, place in the order of time.
        high: the first touch that is after it, likewise.
        recordings: the numbers of the recordings of these two.
        is_renumbered: whether the place in time of one of the two is not its number.
        covariance: what the choice adds to that of all values of the model, (12 + k, 12 + k).
    """

    effect: Effect
    low: float
    high: float
    recordings: tuple[int, int]
    is_renumbered: bool
    covariance: Floats

    @property
    def text(self) -> str:
        """What is said of it; empty where the effect says nothing."""
        first, second = (number + 1 for number in self.recordings)
        where = 'numbered in the order of time' if self.is_renumbered else ''
        if first != second:
            where += (', ' if where else '') + f'that is between the recordings {first} and {second}'
        if not self.effect.is_stepwise:
            return ''
        return f'{self.effect.title} between the touches {self.low:.0f} and {self.high:.0f}{where and ", "}{where}'


class _Scanned(NamedTuple):
    """All moments of one effect of a fit, the others held as they are.

    Attributes:
        scan: the effect and the moments.
        gains: decrease of χ² by each, in units of s².
        fitted: that of the moment of the fit.
    """

    scan: Scan
    gains: Floats
    fitted: float


def at_best_moments(extended: Calibration) -> Calibration:
    """The extended model fitted again at better moments, where the linear problem at its fit has any."""
    for _ in range(3):
        better = _at_better_moment(extended)
        if better is None or penalised_deviance(better, 0.0, 1.0) >= penalised_deviance(extended, 0.0, 1.0):
            break
        extended = better
    return extended


def _at_better_moment(extended: Calibration) -> Calibration | None:
    """The fit with the first moment changed for which another one is better; None if there is none."""
    fitted = fitted_effects(extended)
    if not any(effect.is_stepwise for effect, _, _ in fitted):
        return None
    problem, found = _linear(extended)
    for place, (effect, _, _) in enumerate(fitted):
        scanned = _scan(extended, problem, found, place) if effect.is_stepwise else None
        # χ² has to decrease for a further fit
        if scanned is None or scanned.gains.max() < scanned.fitted + 0.2:
            continue
        other = ScannedTrial(scanned.scan, int(np.argmax(scanned.gains))).candidate(problem)
        start = start_from(problem, [*found[:place], other, *found[place + 1 :]])[0]
        fit = fit_again(extended, calibrate, model=start, errors=None)
        if fit is None:
            return None
        return with_rejections_of(fit, extended) if fit.termination is Termination.CONVERGED else None
    return None


def find_moments(extended: Calibration) -> tuple[Moment, ...]:
    """The moments of the stepwise effects of an extended model."""
    fitted = fitted_effects(extended)
    if not any(effect.is_stepwise for effect, _, _ in fitted):
        return ()
    problem, found = _linear(extended)
    moments = []
    for place, (effect, _, _) in enumerate(fitted):
        scanned = _scan(extended, problem, found, place) if effect.is_stepwise else None
        if scanned is not None:
            moments.append(_moment(extended, problem, found, place, scanned))
    return tuple(moments)


def widened_by_moments(extended: Calibration, moments: tuple[Moment, ...]) -> Calibration:
    """An extended model with a covariance that covers the choice of its moments."""
    if not moments:
        return extended
    return _widened(extended, np.sum([moment.covariance for moment in moments], axis=0), with_moments=True)


def _linear(extended: Calibration) -> tuple[Problem, list[Candidate]]:
    """The linear problem at a fit, and its effects as fitted."""
    problem = pose_problem(extended)
    return problem, [as_fitted(problem, effect, values, 1) for effect, values, _ in fitted_effects(extended)]


def _scan(extended: Calibration, problem: Problem, found: list[Candidate], place: int) -> _Scanned | None:
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
    fitted = _explained_beside(problem, found[place], beside) / scale
    return _Scanned(scan, gains(problem, scan, beside) / scale, fitted)


def _moment(extended: Calibration, problem: Problem, found: list[Candidate], place: int, scanned: _Scanned) -> Moment:
    weight = np.exp((scanned.gains - scanned.gains.max()) / 2)
    moments = np.array([trial.place for trial in scanned.scan.trials])
    effect = scanned.scan.effect
    order = np.sort(extended.touches.order[extended.used])
    known = problem.touch_state.metadata.order
    acts = order if known is None else np.sort(known[effect.acts_on(problem.touch_state)])
    likeliest = np.argsort(-weight)
    enough = int(np.searchsorted(np.cumsum(weight[likeliest]) / weight.sum(), _COVERAGE)) + 1
    likely = moments[likeliest[:enough]]
    low = float(acts[acts < likely.min()].max(initial=order[0]))
    high = float(acts[acts > likely.max()].min(initial=order[-1]))
    two = [int(np.flatnonzero(extended.touches.order == one)[0]) for one in (low, high)]
    first, second = extended.touches.recording[two].tolist()
    is_renumbered = bool(np.any(extended.touches.index[two] != extended.touches.order[two]))
    covariance = _scatter(extended, problem, found, place, scanned, weight)
    row = len(NAMES) + sum(len(values) for values in extended.model.effect_values[:place]) + effect.grid_parameter_index
    covariance[row, row] += _gap(acts, moments, weight)
    return Moment(effect, low, high, (first, second), is_renumbered, covariance)


def _gap(acts: Floats | Indices, moments: Floats, weight: Floats) -> float:
    """Mean variance of a moment that may lie anywhere between its two touches."""
    after = np.clip(np.searchsorted(acts, moments), 1, len(acts) - 1)
    return float(np.sum(weight * (acts[after] - acts[after - 1]) ** 2 / 12) / weight.sum())


def _scatter(
    extended: Calibration, problem: Problem, found: list[Candidate], place: int, scanned: _Scanned, weight: Floats
) -> Floats:
    """Weighted mean square of the estimates at other moments less those of the fit, (12 + k, 12 + k)."""
    own = extended.model.as_array()
    here = start_from(problem, found)[0].as_array()
    scatter, total = np.zeros((len(own), len(own))), float(weight.sum())
    for k in np.flatnonzero(weight > 1e-3):
        candidate = ScannedTrial(scanned.scan, int(k)).candidate(problem)
        if not candidate.unit.shape[1]:
            continue
        members = [*found[:place], candidate, *found[place + 1 :]]
        off = start_from(problem, members)[0].as_array() - here
        off[np.isnan(np.concatenate([extended.std, extended.effect_std]))] = 0.0
        scatter += weight[k] / total * np.outer(off, off)
    fixed = np.concatenate([extended.std == 0, np.zeros(len(own) - len(NAMES), dtype=bool)])
    scatter[fixed] = scatter[:, fixed] = 0.0
    return scatter
