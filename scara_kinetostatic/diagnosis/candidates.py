"""Candidates: every effect as columns of the linear problem, at its best trial; where fits of some of them begin, and
the places of the fitted ones on their grids.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.linear_problem import (
    INDEPENDENT_PART,
    LinearProblem,
    TrialColumns,
    fitted_effects,
    pose_problem,
)
from scara_kinetostatic.diagnosis.result import Ranked
from scara_kinetostatic.effects.base import Effect, Trial
from scara_kinetostatic.effects.unnamed import empirical_effects
from scara_kinetostatic.gaussian.linear_model import Additions, orthonormal
from scara_kinetostatic.gaussian.p_values import f_test
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.extended_model import ExtendedModel

_PEAKS = 8
"""Places of a grid about which a moment, a frequency or a friction is compared at least."""
_UNLIKELY = 1e-3
"""Of the weight of the likeliest place of a grid, below which a place does not count."""


class Candidate(NamedTuple):
    """An effect at one of its trials.

    Attributes:
        effect: the effect.
        trial: the trial.
        changes: of the whitened misclosures by its columns, (2n, m), not multiplied by M.
        explained: decrease of the sum of squares by it alone, beside the base model.
        rank: of what its columns add to those of the base model.
        independent_part: largest part of a unit column of it that is independent of the base model.
        tried: how many trials the effect has.
        share: of the trial, with those about it, in all that the effect has.
    """

    effect: Effect
    trial: Trial
    changes: Floats
    explained: float
    rank: int
    independent_part: float
    tried: int
    share: float = 1.0


class Scan(NamedTuple):
    """An effect with many trials.

    Attributes:
        effect: the effect.
        trials: the trials.
        columns: of all trials.
        kept: which of them count, (t, m): not the only one of a trial where these touches do not tell it from the base
            model.
        tried: how many trials the effect has in all.
        independent_part: largest part of a column that is independent of the base model.
        square: inner products of the columns of each trial, (t, m, m).
        gram: inner products of the columns of each trial, projected off the base model, (t, m, m).
        projected: inner products of the columns with y, (t, m).
    """

    effect: Effect
    trials: Sequence[Trial]
    columns: TrialColumns
    kept: Mask
    tried: int
    independent_part: float
    square: Floats
    gram: Floats
    projected: Floats

    def candidate(self, problem: LinearProblem, k: int, share: float) -> Candidate:
        """The effect at one of the trials, of some share."""
        gram, projected, square = (part[k : k + 1] for part in (self.gram, self.projected, self.square))
        (explained,), (rank,), (part,) = Additions.of(gram, projected, square, problem.least_independent_part)
        changes = self.columns.of_trial(k)
        return Candidate(self.effect, self.trials[k], changes, explained, rank, part, self.tried, share)

    def best(self, problem: LinearProblem, taken: set[int], beside: Floats | None = None) -> Candidate | None:
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


def gather(problem: LinearProblem, effects: Iterable[Effect]) -> CandidateSet:
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
        if (scan.gram * scan.kept[..., None]).any():
            scans.append(scan)
        else:
            unidentifiable.append(Ranked.unidentifiable(effect, scan.independent_part))
    changes, additions = problem.additions(single)
    for (effect, trial), changed, explained, rank, part in zip(single, changes, *additions, strict=True):
        if rank:
            found.append(Candidate(effect, trial, changed, explained, rank, part, 1))
        else:
            unidentifiable.append(Ranked.unidentifiable(effect, part))
    taken = [set[int]() for _ in scans]
    alone = [scan.best(problem, some) for scan, some in zip(scans, taken, strict=True)]
    partners = [(item.effect, problem.independent_part(item.trial)) for item in found if item.effect in fitted]
    for scan, some, first in zip(scans, taken, alone, strict=True):
        beside = [scan.best(problem, some, unit) for effect, unit in partners if effect != scan.effect]
        found += filter(None, (first, *beside))
        if usual := scan.effect.usual_trials(problem.touch_state):
            few = scan_trials(problem, scan.effect, usual, len(usual))
            share = 0.5 / len(usual)  # all others together are as likely
            found += [item for k in range(len(usual)) if (item := few.candidate(problem, k, share)).rank]
    labels = {candidate.effect.label for candidate in found}
    others = {item.effect.label: item for item in unidentifiable if item.effect.label not in labels}
    return CandidateSet(tuple(found), tuple(others.values()))


def as_fitted(problem: LinearProblem, effect: Effect, values: Floats) -> Candidate:
    """An effect of the fit at its values: at its place on the grid, or linearised."""
    at = problem.touch_state
    trials, usual = effect.trials(at, problem.force), effect.usual_trials(at)
    if len(trials) == 1:
        trial = trials[0]
        if not effect.grid_parameter:  # a disc of few touches has one moment, at which a shift is linear
            errors = effect.sensor_error_derivative(problem.force, values, at.metadata)
            trial = Trial(effect.derivative(at, values), errors)
        return scan_trials(problem, effect, [trial], 1).candidate(problem, 0, 1.0)
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


def gains(problem: LinearProblem, scan: Scan, beside: Floats | None = None) -> Floats:
    """Decrease of the sum of squares by each trial beside an orthonormal basis (2n, r), (t,)."""
    gram, projected = scan.gram * scan.kept[..., None], scan.projected * scan.kept
    if beside is not None and beside.size:
        part = scan.columns.products(problem.marginal.apply(beside)) * scan.kept[..., None]
        gram = gram - part @ part.transpose(0, 2, 1)
        projected = projected - part @ (beside.T @ problem.left)
    size = np.trace(gram, axis1=1, axis2=2)
    # a ridge keeps the trials solvable whose columns are parallel, or are all among those beside but for rounding
    rounding = 1e-15 * np.trace(scan.gram, axis1=1, axis2=2).max()
    least = max(1e-6 * size.max(), rounding) or 1.0  # where no trial explains anything, any
    ridge = least * np.eye(projected.shape[1])
    coefficients = np.linalg.solve(gram + ridge, projected[..., None])[..., 0]
    return np.asarray((projected * coefficients).sum(axis=1))


def scan_trials(problem: LinearProblem, effect: Effect, trials: Sequence[Trial], tried: int) -> Scan:
    """Trials of an effect, of `tried` in all."""
    columns = problem.of_trials(trials)
    square, gram, left = problem.beside_base(columns)
    whole, independent = (np.diagonal(part, axis1=1, axis2=2) for part in (square, gram))
    part = np.sqrt(np.clip(np.divide(independent, whole, out=np.zeros_like(whole), where=whole > 0), 0, 1))
    kept = (part > problem.least_independent_part) | (part.shape[1] > 1)
    return Scan(effect, trials, columns, kept, tried, float(part.max(initial=0.0)), square, gram, left)


def all_candidates(problem: LinearProblem, effects: Sequence[Effect]) -> CandidateSet:
    """The catalogue and the fitted curves as candidates; arguments as of `gather`."""
    discs = [disc.name for disc in problem.calibration.cell.discs]
    curves = empirical_effects(problem.touch_state, discs, problem.one_level)
    return gather(problem, [*effects, *curves])


def significance(problem: LinearProblem, candidate: Candidate) -> tuple[float, float]:
    """F-test of one candidate (Bonferroni over its trials), and the part of the sum of squares it explains.

    A fitted effect may add nothing that is independent of the base model; then it is not significant.
    """
    total, rows = float(problem.left @ problem.left), len(problem.left)
    tested = f_test(candidate.explained, candidate.rank, total, rows, problem.freedoms)
    p_value, share = tested or (1.0, 0.0)
    return min(1.0, candidate.tried * p_value), share


def start_from(problem: LinearProblem, members: Sequence[Candidate]) -> ExtendedModel:
    """L̄ and effects that fit the linear problem of the touches best, to start from."""
    columns = [problem.columns(member.trial) for member in members]
    together = np.concatenate(columns, axis=1)
    scale = np.linalg.norm(together, axis=0)
    scale[scale == 0] = 1.0
    projected = (together - problem.base @ (problem.base.T @ together)) / scale
    found = -np.linalg.lstsq(projected, problem.left, rcond=INDEPENDENT_PART)[0] / scale
    parts = np.split(found, np.cumsum([part.shape[1] for part in columns])[:-1])
    values = [member.trial.values(part) for member, part in zip(members, parts, strict=True)]
    moved = problem.without_effects + problem.response @ together @ found
    base = problem.point.parameters.with_array(problem.point.parameters.as_array() + moved)
    return ExtendedModel(base, tuple(member.effect for member in members), tuple(map(tuple, values)))


class Moment(NamedTuple):
    """The place of one effect of a fit on its grid: a moment, a frequency, a friction.

    Attributes:
        effect: the effect.
        text: between which touches a moment is, with a probability of 95 %; empty for others.
        std: its standard deviation.
        change: of L̄, and of the amplitudes of the effect, from the place of the fit to each of some places,
            (t, 12 + k); other effects are as fitted. Empty where the law is smooth in it.
        weight: of these places, (t,).
    """

    effect: Effect
    text: str
    std: float
    change: Floats
    weight: Floats


def moments(fit: Calibration) -> tuple[Moment, ...]:
    """When the stepwise effects of a fit begin or end, and the frequency or friction of others, on which it depends in
    waves and kinks.

    Places of the grid are compared in the linear problem at the fit, about the likeliest of all: with χ²_k the least
    sum of squares with the place k, in units of s², its weight is exp(-χ²_k/2), as all are equally likely before.
    """
    named = [item for item in fitted_effects(fit) if item[0].label not in fit.held_effects]
    if not any(effect.grid_parameter for effect, _ in named):
        return ()
    problem, found = pose_problem(fit), []
    candidates = [as_fitted(problem, effect, values) for effect, values in named]
    scale = max(1.0 if problem.noise_given else 0.0, fit.reduced_chi_square, 1e-300)
    for number, (effect, values) in enumerate(named):
        at = problem.touch_state
        trials = effect.trials(at, problem.force) if effect.grid_parameter else ()
        if len(trials) < 2 or any(f'{effect.label}.{p.name}' in fit.fixed for p in effect.parameters):
            continue
        others = [item.trial for k, item in enumerate(candidates) if k != number and item.rank]
        beside = orthonormal(np.concatenate([*map(problem.independent_part, others)], axis=1)) if others else None

        def gained(some: Sequence[Trial], effect: Effect = effect, beside: Floats | None = beside) -> Floats:
            return gains(problem, scan_trials(problem, effect, some, len(some)), beside)

        gain = gained(trials)
        least = min(np.sort(gain)[-_PEAKS:][0], gain.max() + 2 * scale * np.log(_UNLIKELY))
        nearest = np.flatnonzero(gain >= least).tolist()
        width = 3.0 if effect.is_stepwise else 1.0
        trials = [trial for k in nearest for trial in effect.finer(at, trials[k], width)] or trials
        trials = list({round(trial.place, 12): trial for trial in trials}.values())  # the grids overlap
        gain, places = gained(trials), np.array([trial.place for trial in trials])
        weight = np.exp((gain - gain.max()) / (2 * scale))
        # a wave is near to linear in its frequency; beside a curve any would do
        has_kinks = effect.is_stepwise or not effect.is_smooth
        likely = np.flatnonzero(weight > _UNLIKELY) if has_kinks else np.empty(0, dtype=np.intp)
        weight /= weight.sum()
        off = np.abs(places - values[effect.grid_parameter_index])
        text, std = '', float(np.sqrt(weight @ off**2))
        if effect.is_stepwise:
            text, std = _when(fit, problem, effect, places, weight)
        every = [list(candidates) for _ in range(len(likely) + 1)]
        for one, k in zip(every, (*likely.tolist(), int(np.argmin(off))), strict=True):
            one[number] = one[number]._replace(trial=trials[k])
        *with_each, here = (start_from(problem, one).as_array() for one in every)
        change = np.array([one - here for one in with_each])
        found.append(Moment(effect, text, std, change, weight[likely] / weight[likely].sum()))
    return tuple(found)


def _when(
    fit: Calibration, problem: LinearProblem, effect: Effect, places: Floats, weight: Floats
) -> tuple[str, float]:
    """Between which touches an effect begins or ends, and the standard deviation of that moment."""
    touches, known = fit.touches, problem.touch_state.metadata.order
    order = np.sort(touches.order[fit.used])
    acts = order if known is None else np.sort(known[effect.acts_on(problem.touch_state)])
    best = np.argsort(-weight)
    likely = places[best[: int(np.searchsorted(np.cumsum(weight[best]), 0.95)) + 1]]
    low = float(acts[acts < likely.min()].max(initial=order[0]))
    high = float(acts[acts > likely.max()].min(initial=order[-1]))
    two = [int(np.flatnonzero(touches.order == one)[0]) for one in (low, high)]
    first, second = touches.recording[two].tolist()
    where = ['numbered in the order of time'] if np.any(touches.index[two] != touches.order[two]) else []
    where += [f'that is between the recordings {first + 1} and {second + 1}'] if first != second else []
    mean = float(weight @ places)
    after = np.clip(np.searchsorted(acts, places), 1, len(acts) - 1)
    between = (acts[after] - acts[after - 1]) ** 2 / 12  # a moment may lie anywhere between its two touches
    text = ', '.join([f'{effect.title} between the touches {low:.0f} and {high:.0f}', *where])
    return text, float(np.sqrt(weight @ ((places - mean) ** 2 + between)))
