"""The moment of an effect that begins or ends in a step between two touches, and how well it is known.

Nothing changes between two touches, so a fit holds the moment (`Effect.is_stepwise`). Every moment is compared in the
linear problem at the fit: with χ²_k the least sum of squares with the moment k, in units of s², its weight is
exp(-χ²_k/2), as all are equally likely before. What the choice adds to the covariance is the scatter of the estimates
over the moments, and a moment itself may lie anywhere between its two touches.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.alternatives import with_alternatives
from scara_kinetostatic.diagnosis.candidates import Candidate, Scan, ScannedTrial, as_fitted, gains, scan_trials
from scara_kinetostatic.diagnosis.linear_problem import Problem, orthonormal, pose_problem
from scara_kinetostatic.diagnosis.refit import fitted_effects, penalised_deviance, start_from, with_rejections_of
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.parameters import NAMES

_ROUNDS = 3
"""Times that a fit is repeated at a better moment, at most."""
_BETTER = 0.2
"""Decrease of χ² by a better moment below which the fit is not repeated."""
_LEAST_WEIGHT = 1e-3
"""Of a moment that counts, over that of the best."""
_COVERAGE = 0.95
"""Of the interval that is stated."""
_NEAR = 3.0
"""Steps of the grid on both sides of the fit within which other moments count, where the grid does not hold all."""


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
        return self.effect.place_text(self.low, self.high, where)


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
    for _ in range(_ROUNDS):
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
        if scanned is None or scanned.gains.max() < scanned.fitted + _BETTER:
            continue
        other = ScannedTrial(scanned.scan, int(np.argmax(scanned.gains))).candidate(problem)
        start = start_from(problem, [*found[:place], other, *found[place + 1 :]])[0]
        warm_start = WarmStart(start, extended.noise, extended.used)
        try:
            fit = calibrate(extended.touches, extended.cell, start.effects, fixed=extended.fixed, warm_start=warm_start)
        except UnsupportedDataError:
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
    covariance = extended.covariance + np.sum([moment.covariance for moment in moments], axis=0)
    std, known = np.sqrt(np.diag(covariance)), np.concatenate([extended.std, extended.effect_std])
    std[np.isnan(known)] = np.nan
    return replace(
        extended,
        covariance=covariance,
        contributions=with_alternatives(extended, covariance),
        std=std[: len(NAMES)],
        effect_std=std[len(NAMES) :],
    )


def _linear(extended: Calibration) -> tuple[Problem, list[Candidate]]:
    """The linear problem at a fit, and its effects as fitted."""
    problem = pose_problem(extended)
    return problem, [as_fitted(problem, effect, values, 1) for effect, values, _ in fitted_effects(extended)]


def _scan(extended: Calibration, problem: Problem, found: list[Candidate], place: int) -> _Scanned | None:
    effect, values, _ = fitted_effects(extended)[place]
    moment = float(values[effect.grid_parameter_index])
    trials = effect.trials(problem.touch_state, problem.force)
    nearest = min(trials, key=lambda trial: abs(trial.place - moment))
    trials = effect.finer(problem.touch_state, nearest, _NEAR) or trials
    others = [candidate.unit for k, candidate in enumerate(found) if k != place]
    beside = orthonormal(np.concatenate(others, axis=1)) if any(unit.size for unit in others) else None
    scan = scan_trials(problem, effect, trials, len(trials))
    if not scan.columns.any():
        return None
    scale = max(1.0, extended.reduced_chi_square) if problem.noise_given else extended.reduced_chi_square
    scale = max(scale, 1e-300)
    unit = found[place].unit
    unit = unit if beside is None or not unit.size else orthonormal(unit - beside @ (beside.T @ unit))
    fitted = float(np.sum((unit.T @ problem.left) ** 2)) / scale
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
    for k in np.flatnonzero(weight > _LEAST_WEIGHT):
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
