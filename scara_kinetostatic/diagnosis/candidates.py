"""The candidates of a diagnosis: every effect as columns of the linear problem."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.identifiability import NOISE_SHARE
from scara_kinetostatic.diagnosis.linear_problem import Problem
from scara_kinetostatic.effects.base import Effect, LinearEffect, Trial

Floats = NDArray[np.float64]

PARTNERS = 12
"""Beside how many of the other candidates the frequency of an effect is searched for again."""
RIDGE = 1e-6
FINEST = 4
"""Grids, each finer than the one before, on which a frequency is looked for."""
EVEN = 0.3
"""Part of the variance of the noise that a better frequency must explain to be worth another grid."""
LEAST_INDEPENDENT_PART = 0.012
"""Part of a unit column that must be new beside the twelve; less is the noise of the measured force."""
LEAST_INDEPENDENT_PART_AT_ONE_LEVEL = 0.03
"""The same where all forces are alike."""


class Candidate(NamedTuple):
    """One way in which one effect may be present.

    Attributes:
        effect: the effect.
        trial: the way.
        unit: orthonormal basis of what its columns add to the twelve, (2n, r).
        tried: how many trials the effect has.
    """

    effect: Effect
    trial: Trial
    unit: Floats
    tried: int

    @property
    def freedoms(self) -> int:
        """Parameters of the effect that can show beside the twelve."""
        return self.unit.shape[1] + len(self.effect.parameters) - len(self.trial.columns)


class Unidentifiable(NamedTuple):
    """An effect that these touches cannot show.

    Attributes:
        effect: the effect.
        new: largest part of a unit column of it that is new beside the twelve.
    """

    effect: Effect
    independent_part: float


class Scan(NamedTuple):
    """An effect with many trials.

    Attributes:
        effect: the effect.
        trials: the ways in which it may be present.
        columns: of all trials, less what the twelve take up, (2n, t, m).
        tried: how many trials the effect has in all.
    """

    effect: Effect
    trials: Sequence[Trial]
    columns: Floats
    tried: int


class CandidateSet(NamedTuple):
    """All that competes.

    Attributes:
        candidates: the best way of each effect, and further ways of those with many.
        unseen: effects that these touches cannot show.
    """

    candidates: tuple[Candidate, ...]
    unidentifiable: tuple[Unidentifiable, ...]

    @property
    def number(self) -> int:
        """How many different effects compete."""
        return len({candidate.effect.label for candidate in self.candidates})


def gather(
    problem: Problem,
    effects: Iterable[Effect],
    fitted: Mapping[str, Floats] = MappingProxyType({}),
    together: bool = True,
) -> CandidateSet:
    """The candidates among effects.

    An effect with many trials (a frequency to be found) takes part with the one that explains
    most by itself, with those that explain most beside one of the other candidates, and with the one already fitted.

    Args:
        problem: the touches.
        effects: who may take part.
        fitted: values of the parameters of effects that the last fit had, by label.
        together: whether several effects are to act at once; else the best way of each by itself will do.
    """
    found: list[Candidate] = []
    unidentifiable, scans = [], []
    for effect in effects:
        trials = effect.trials(problem.touch_state, problem.force)
        if len(trials) > 1:
            scans.append(scan_trials(problem, effect, trials, len(trials)))
            continue
        unit, part = independent_part(problem, problem.columns(trials[0]), problem.noise_columns(effect, trials[0]))
        if effect.label in fitted and not isinstance(effect, LinearEffect):
            found.append(as_fitted(problem, effect, fitted[effect.label], 1))
        elif unit.shape[1]:
            found.append(Candidate(effect, trials[0], unit, 1))
        else:
            unidentifiable.append(Unidentifiable(effect, part))
    alone = [best_trial(problem, scan) for scan in scans]
    partners = sorted(found + alone, key=lambda c: -explained(problem, c))[: PARTNERS if together else 0]
    for scan, first in zip(scans, alone, strict=True):
        beside = [best_trial(problem, scan, partner.unit) for partner in partners if partner.effect != scan.effect]
        if scan.effect.label in fitted:
            beside.append(as_fitted(problem, scan.effect, fitted[scan.effect.label], scan.tried))
        found += list({id(c.trial): c for c in (first, *beside)}.values())
    seen = {candidate.effect.label for candidate in found}
    hidden = {item.effect.label: item for item in unidentifiable if item.effect.label not in seen}
    return CandidateSet(tuple(found), tuple(hidden.values()))


def as_fitted(problem: Problem, effect: Effect, values: Floats, tried: int) -> Candidate:
    """A nonlinear effect as the last fit had it, free to move about these values."""
    at, reported = problem.touch_state, problem.force
    trial = Trial(effect.derivative(at, values), effect.sensor_error_derivative(reported, values), lambda _: values)
    return Candidate(effect, trial, independent_part(problem, problem.columns(trial))[0], tried)


def explained(problem: Problem, candidate: Candidate) -> float:
    """What of the sum of squares a candidate takes away by itself."""
    return float(np.sum((candidate.unit.T @ problem.left) ** 2))


def independent_part(problem: Problem, columns: Floats, noise: Floats | None = None) -> tuple[Floats, float]:
    """Orthonormal basis of what columns (2n, m) add to the twelve, and the largest part of a unit column that does.

    A direction counts as new only if no more than `NOISE_SHARE` of it is made by the noise of the forces; `noise` is
    the change of the columns by one standard deviation of that, (2n, m), None for nothing.
    """
    scale = np.linalg.norm(columns, axis=0)
    visible = scale > 0
    columns = columns[:, visible] / scale[visible]
    if not columns.size:
        return np.empty((len(columns), 0)), 0.0
    left = columns - problem.base @ (problem.base.T @ columns)
    u, values, vt = np.linalg.svd(left, full_matrices=False)
    independent_part = values > (LEAST_INDEPENDENT_PART_AT_ONE_LEVEL if problem.one_level else LEAST_INDEPENDENT_PART)
    if noise is not None:
        made = np.linalg.norm(noise[:, visible] / scale[visible] @ vt.T, axis=0)
        independent_part &= made**2 <= NOISE_SHARE * values**2
    return u[:, independent_part], min(1.0, float(values[0]))


def best_trial(problem: Problem, scan: Scan, beside: Floats | None = None) -> Candidate:
    """The trial that explains most, by itself or beside an orthonormal basis (2n, r); between those of a grid, too."""
    return refined(problem, scan, int(np.argmax(gains(problem, scan, beside))), beside)


def refined(problem: Problem, scan: Scan, k: int, beside: Floats | None = None) -> Candidate:
    """The best trial near that with number k.

    It is looked for on ever finer grids, until a step changes what is explained by less than `EVEN` of the
    noise that would be left.
    """
    taken = 0.0 if beside is None else float(np.sum((beside.T @ problem.left) ** 2))
    most = float(gains(problem, scan, beside)[k])
    width = 1.0
    for _ in range(FINEST):
        finer = scan.effect.finer(problem.touch_state, scan.trials[k], width)
        if not finer:
            break
        before = most
        scan = scan_trials(problem, scan.effect, finer, scan.tried)
        gained = gains(problem, scan, beside)
        k = int(np.argmax(gained))
        most = float(gained[k])
        if most - before < EVEN * max(float(problem.left @ problem.left) - taken - most, 0.0) / problem.freedoms:
            break
        width *= 2 / (len(finer) - 1)
    return Candidate(scan.effect, scan.trials[k], independent_part(problem, scan.columns[:, k])[0], scan.tried)


def gains(problem: Problem, scan: Scan, beside: Floats | None = None) -> Floats:
    """What of the sum of squares each trial takes away beside an orthonormal basis (2n, r), (t,)."""
    left, columns = problem.left, scan.columns
    if beside is not None:
        left = left - beside @ (beside.T @ left)
        columns = columns - np.einsum('rk,ktm->rtm', beside, np.einsum('rk,rtm->ktm', beside, columns))
    gram = np.einsum('rtm,rtk->tmk', columns, columns)
    projected = np.einsum('r,rtm->tm', left, columns)
    size = np.trace(gram, axis1=1, axis2=2)
    ridge = (RIDGE * size.max())[..., None, None] * np.eye(columns.shape[2])
    coefficients = np.linalg.solve(gram + ridge, projected[..., None])[..., 0]
    return np.einsum('tm,tm->t', projected, coefficients)


def scan_trials(problem: Problem, effect: Effect, trials: Sequence[Trial], tried: int) -> Scan:
    """Trials of an effect, of `tried` in all, without what the twelve take up of them."""
    columns = np.stack([problem.columns(trial) for trial in trials], axis=1)
    flat = columns.reshape(len(problem.left), -1)
    flat = flat - problem.base @ (problem.base.T @ flat)
    return Scan(effect, trials, flat.reshape(columns.shape), tried)
