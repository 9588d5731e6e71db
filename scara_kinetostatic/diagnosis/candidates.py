"""Candidates: every effect as columns of the linear problem, at its best trial."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.diagnosis.linear_problem import Problem, fitted_effects
from scara_kinetostatic.diagnosis.result import Ranked
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.effects.unnamed import empirical_effects
from scara_kinetostatic.gaussian.linear_model import f_test
from scara_kinetostatic.model.arrays import Floats


class Candidate(NamedTuple):
    """An effect at one of its trials.

    Attributes:
        effect: the effect.
        trial: the trial.
        unit: orthonormal basis of what its columns add to those of the base model, (2n, r).
        independent_part: largest part of a unit column of it that is independent of the base model.
        tried: how many trials the effect has.
        share: of the trial, with those about it, in all that the effect has.
    """

    effect: Effect
    trial: Trial
    unit: Floats
    independent_part: float
    tried: int
    share: float = 1.0


class Scan(NamedTuple):
    """An effect with many trials.

    Attributes:
        effect: the effect.
        trials: the trials.
        columns: of all trials, (t, m, 2n).
        tried: how many trials the effect has in all.
        independent_part: largest part of a column that is independent of the base model.
        gram: inner products of the columns of each trial, projected off the base model, (t, m, m).
        projected: inner products of the columns with y, (t, m).
    """

    effect: Effect
    trials: Sequence[Trial]
    columns: Floats
    tried: int
    independent_part: float
    gram: Floats
    projected: Floats

    def candidate(self, problem: Problem, k: int, share: float) -> Candidate:
        """The effect at one of the trials, of some share."""
        return Candidate(self.effect, self.trials[k], *problem.independent_part(self.columns[k].T), self.tried, share)

    def best(self, problem: Problem, taken: set[int], beside: Floats | None = None) -> Candidate | None:
        """The trial that explains most, by itself or beside an orthonormal basis (2n, r); None where it is among those
        taken.

        It is looked for on ever finer grids, until a step changes what is explained by less than 0.3 of the residual
        variance. Steps within four touches count as one: the fit refines the moment.
        """
        scan, gained = self, gains(problem, self, beside)
        k = int(np.argmax(gained))
        place = round(scan.trials[k].place / 4.0) if scan.effect.is_stepwise else k
        if place in taken:
            return None
        taken.add(place)
        coarse = gained
        known = 0.0 if beside is None else float(np.sum((beside.T @ problem.left) ** 2))
        total, most, width = float(problem.left @ problem.left) - known, float(gained[k]), 1.0
        for _ in range(4):
            finer = scan.effect.finer(problem.touch_state, scan.trials[k], width)
            if not finer:
                break
            scan = scan_trials(problem, scan.effect, finer, scan.tried)
            gained = gains(problem, scan, beside)
            k, before = int(np.argmax(gained)), most
            most = float(gained[k])
            if most - before < 0.3 * max(total - most, 0.0) / problem.freedoms:
                break
            width *= 2 / (len(finer) - 1)
        part = 0.5 if scan.effect.usual_trials(problem.touch_state) else 1.0
        return scan.candidate(problem, k, part * _share(coarse, most))


class CandidateSet(NamedTuple):
    """All candidates.

    Attributes:
        candidates: each effect at its best trial, and at further trials of those with many.
        unidentifiable: effects that these touches cannot determine.
    """

    candidates: tuple[Candidate, ...]
    unidentifiable: tuple[Ranked, ...]


def gather(problem: Problem, effects: Iterable[Effect]) -> CandidateSet:
    """The candidates among effects.

    An effect with many trials (an unknown frequency) is a candidate at the trial that explains
    most by itself, at those that explain most beside one of the effects of the fit, and at its usual ones; an effect of
    the fit is one as it is there.

    Args:
        problem: the touches.
        effects: the effects.
    """
    fitted = {effect: values for effect, values in fitted_effects(problem.calibration) if len(values)}
    found: list[Candidate] = []
    unidentifiable, scans, single = [], [], []
    for effect in effects:
        if effect in fitted:
            found.append(as_fitted(problem, effect, fitted[effect]))
            continue
        trials = effect.trials(problem.touch_state, problem.force)
        if len(trials) == 1:
            single.append((effect, trials[0]))
            continue
        scan = scan_trials(problem, effect, trials, len(trials))
        if scan.columns.any():
            scans.append(scan)
        else:
            unidentifiable.append(Ranked.unidentifiable(effect, scan.independent_part))
    for (effect, trial), (unit, part) in zip(single, problem.independent_parts(single), strict=True):
        if unit.shape[1]:
            found.append(Candidate(effect, trial, unit, part, 1))
        else:
            unidentifiable.append(Ranked.unidentifiable(effect, part))
    taken = [set[int]() for _ in scans]
    alone = [scan.best(problem, some) for scan, some in zip(scans, taken, strict=True)]
    partners = [item for item in found if item.effect in fitted]
    for scan, some, first in zip(scans, taken, alone, strict=True):
        beside = [scan.best(problem, some, partner.unit) for partner in partners if partner.effect != scan.effect]
        found += filter(None, (first, *beside))
        if usual := scan.effect.usual_trials(problem.touch_state):
            few = scan_trials(problem, scan.effect, usual, len(usual))
            share = 0.5 / len(usual)  # all others together are as likely
            found += [item for k in range(len(usual)) if (item := few.candidate(problem, k, share)).unit.size]
    labels = {candidate.effect.label for candidate in found}
    others = {item.effect.label: item for item in unidentifiable if item.effect.label not in labels}
    return CandidateSet(tuple(found), tuple(others.values()))


def as_fitted(problem: Problem, effect: Effect, values: Floats) -> Candidate:
    """An effect of the fit at its values: at its place on the grid, or linearised."""
    at = problem.touch_state
    trials, usual = effect.trials(at, problem.force), effect.usual_trials(at)
    if len(trials) == 1:
        trial = trials[0]
        if not effect.grid_parameter:  # a disc of few touches has one moment, at which a shift is linear
            errors = effect.sensor_error_derivative(problem.force, values, at.metadata)
            trial = Trial(effect.derivative(at, values), errors)
        return Candidate(effect, trial, *problem.independent_part(problem.columns(trial)), 1)
    place = float(values[effect.grid_parameter_index])

    def off(trial: Trial) -> float:
        return abs(trial.place - place)

    nearest = min(trials, key=off)
    nearest = min((nearest, *effect.finer(at, nearest._replace(place=place), 0.0)), key=off)
    scan = scan_trials(problem, effect, [*trials, *usual, nearest], len(trials))
    gained = gains(problem, scan)
    here, part = float(gained[-1]), 0.5 if usual else 1.0
    share = part * _share(gained[: len(trials)], here)
    share += (1 - part) * float(np.exp(np.minimum(gained[len(trials) : -1] - here, 0.0) / 2).sum()) / max(len(usual), 1)
    return scan.candidate(problem, len(gained) - 1, share)


def _share(gained: Floats, here: float) -> float:
    """Of a place on a grid and those about it in the prior of all, by the gains at the grid and at the place.

    A peak between two places of the grid is narrower than these are apart: at half a step a wave loses 14 %.
    """
    near = float(np.exp(np.minimum(gained - here, 0.0) / 2).sum())
    return max(near, min(1.0, (11.0 / max(here, 1e-9)) ** 0.5)) / len(gained)


def gains(problem: Problem, scan: Scan, beside: Floats | None = None) -> Floats:
    """Decrease of the sum of squares by each trial beside an orthonormal basis (2n, r), (t,)."""
    gram, projected = scan.gram, scan.projected
    if beside is not None and beside.size:
        part = scan.columns @ beside
        gram = gram - part @ part.transpose(0, 2, 1)
        projected = projected - part @ (beside.T @ problem.left)
    size = np.trace(gram, axis1=1, axis2=2)
    # a ridge keeps the trials solvable whose columns are parallel, or are all among those beside but for rounding
    rounding = 1e-15 * np.trace(scan.gram, axis1=1, axis2=2).max()
    least = max(1e-6 * size.max(), rounding) or 1.0  # where no trial explains anything, any
    ridge = least * np.eye(projected.shape[1])
    coefficients = np.linalg.solve(gram + ridge, projected[..., None])[..., 0]
    return np.asarray((projected * coefficients).sum(axis=1))


def scan_trials(problem: Problem, effect: Effect, trials: Sequence[Trial], tried: int) -> Scan:
    """Trials of an effect, of `tried` in all.

    A column that these touches do not tell from the base model is 0 where it is the only one of its trial.
    """
    columns = problem.of_trials(trials)
    along, left = columns @ problem.base, columns @ problem.left
    gram = columns @ columns.transpose(0, 2, 1)
    square = np.diagonal(gram, axis1=1, axis2=2)
    gram = gram - along @ along.transpose(0, 2, 1)
    independent = np.diagonal(gram, axis1=1, axis2=2)
    part = np.sqrt(np.clip(np.divide(independent, square, out=np.zeros_like(square), where=square > 0), 0, 1))
    if part.shape[1] == 1:
        kept = part > problem.least_independent_part
        columns, gram, left = columns * kept[:, :, None], gram * kept[:, :, None], left * kept
    return Scan(effect, trials, columns, tried, float(part.max()), gram, left)


def all_candidates(problem: Problem, effects: Sequence[Effect]) -> CandidateSet:
    """The catalogue and the fitted curves as candidates; arguments as of `gather`."""
    discs = [disc.name for disc in problem.calibration.cell.discs]
    curves = empirical_effects(problem.touch_state, discs, problem.one_level)
    return gather(problem, [*effects, *curves])


def significance(problem: Problem, candidate: Candidate) -> tuple[float, float]:
    """F-test of one candidate (Bonferroni over its trials), and the part of the sum of squares it explains.

    A fitted effect may add nothing that is independent of the base model; then it is not significant.
    """
    p_value, share = f_test(candidate.unit, problem.left, problem.freedoms) or (1.0, 0.0)
    return min(1.0, candidate.tried * p_value), share
