"""Lower bound of the number of touches for an accuracy, from the theory of optimal approximate designs.

An approximate design distributes the touches over the candidates by weights ξ, fractions and repetitions allowed: the
information of N touches is N Σ ξ_i I_i + P, with P the prior of the errors that the cell declares; P = 0 where it
declares none. No real set of N touches is better than the best approximate design. Its largest variance of the tip is
bounded from below: for any weights λ of the places, L = Σ λ_g T_gᵀT_g, and any symmetric C, the Cauchy–Schwarz
inequality gives for every design ξ', with covariance C' = (N Σ ξ'_i I_i + P)⁻¹,

    tr(L C') ≥ tr(L C)² / tr(C L C C'⁻¹) ≥ tr(L C)² / (N max_i tr(C L C I_i) + tr(C L C P)),

and the largest variance is no less than the mean weighted by λ. So N touches reach a variance v only if
N ≥ (tr(L C)²/v - tr(C L C P)) / max_i tr(C L C I_i). ξ, C = (N Σ ξ_i I_i + P)⁻¹ and λ that make the bound tight are
found by multiplicative iterations; every iteration leaves a bound, and the best one counts. With P = 0 the iterations
do not depend on N; else they are made for the number of touches that the accuracy takes, as far as it can be reached,
and the bound is less tight, but still valid, for other numbers.

Sets for the exchange are drawn by ξ.

Sources: Kiefer, Annals of Statistics 2 (1974) 849; Silvey, Titterington and Torsney, Communications in
Statistics A 7 (1978) 1379, for the iteration.

Fedorov's exchange: a set of touches is improved by replacing one touch at a time.

The criterion is the largest variance of the tip over the workspace. Adding a touch changes the covariance C = I⁻¹ by -C
Jᵀ (1 + J C Jᵀ)⁻¹ J C, so that all candidates for one position in the set are evaluated by a few matrix products. The
largest variance is not smooth, and exchange stops early at its edges; a mean of high power of the variances is smooth
and is minimised first.

For a set that checks itself (`self_check`) the criterion is the largest variance after the loss of any one touch, times
a penalty for the largest leverage. An exchange is sought for the worst few losses and accepted if it lowers the
criterion over all of them; every disc keeps its touches.

Source: Fedorov, Theory of Optimal Experiments (1972), chapter 3.

The smallest set of touches that reaches an accuracy, and checks of it.

The criterion is the largest standard deviation of the tip over the workspace. Numbers of touches are tried from the
lower bound (`lower_bound`) upwards. For each, sets are drawn at random by the weights of the optimal approximate design
and improved by exchange (`exchange`). The first number at which a set reaches the accuracy is taken, with the best set
of that number; its distance from the lower bound limits what a better search could save.

A set that checks itself (`self_check`) is sought in the same way, with another criterion.

A set found is checked by leaving out each of its touches, against random sets of the same size, and for a robot with
larger compliances or more noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import (
    MOST_LEVERAGE,
    PRIOR,
    CandidateTouches,
    held_out_ratio,
    least_on_discs,
    leverage_with_each,
    leverages,
    may_be_added,
    pack,
    penalty,
    prepare_candidates,
)
from scara_kinetostatic.studies.design.prediction import Robot, Tip, predict, tip_std

_ITERATIONS = 400
"""More iterations tighten the bound; it is valid after any number."""
_STEP_SIZE = 6.0
"""Step of the logarithms of the weights λ in the first iteration; it decreases with the root of the iterations."""
_REGULARISATION = 1e-9
"""Part of the prior that is added so that matrices are regular where the rank is less than 12."""
MOST_TOUCHES = 200
"""Largest set that is searched for."""
_FEWEST = 7
"""Smallest number of touches for which the iterations are made."""


class LowerBound(NamedTuple):
    """Bounds of the largest variance of the tip for all designs, and the approximate design found.

    Attributes:
        mean: tr(L C) of each iteration, (s,), m².
        gain: max_i tr(C L C I_i), (s,), m².
        prior: tr(C L C P), (s,), m²; 0 without declared uncertainties.
        reached: largest variance of the approximate design found, for `touches`, m².
        touches: number of touches for which the iterations were made; 1 without declared uncertainties.
        weights: of the candidates in that design, ξ, (n,).
    """

    mean: Floats
    gain: Floats
    prior: Floats
    reached: float
    touches: float
    weights: Floats

    def variance(self, number: float) -> float:
        """The largest variance of the tip with this many touches is at least this, m²."""
        return float((self.mean**2 / (number * self.gain + self.prior)).max())

    def number(self, target: float) -> int:
        """Number of touches below which no set reaches a largest standard deviation of the tip of `target`, m."""
        needed = float(((self.mean**2 / target**2 - self.prior) / self.gain).max())
        return max(0, int(np.ceil(needed - 1e-9)))


def find_lower_bound(candidates: CandidateTouches, target: float, iterations: int = _ITERATIONS) -> LowerBound:
    """Bounds the largest variance of the tip.

    Args:
        candidates: the candidates and the tip.
        target: largest standard deviation of the tip for which the bound is to be tight, m.
        iterations: more make the bound tighter; it is valid after any number.
    """
    number = _number_for(candidates, target) if len(candidates.declared) else 1.0
    declared = candidates.declared.T @ candidates.declared
    regular = declared.copy()
    regular[: len(PRIOR), : len(PRIOR)] += _REGULARISATION * PRIOR
    design = np.full(len(candidates.plan), 1 / len(candidates.plan))  # ξ
    places = np.full(candidates.quadric.shape[1], 1 / candidates.quadric.shape[1])  # λ
    bounds, reached = [], np.inf
    for step in range(iterations):
        information = number * np.tensordot(design, candidates.information, axes=1) + regular
        covariance: Floats = np.asarray(np.linalg.inv(information), dtype=float)
        variance = candidates.variance(covariance)
        squares = _unpack(candidates.quadric @ places)
        through = candidates.derivative @ covariance[:, candidates.rows]
        gain = np.einsum('nik,kl,nil->n', through, squares, through, optimize=True)
        known = candidates.declared @ covariance[:, candidates.rows]
        by_prior = float(np.einsum('pk,kl,pl->', known, squares, known))
        mean, largest = float(places @ variance), float(variance.max())
        bounds.append((mean, float(gain.max()), by_prior))
        reached = min(reached, largest)
        design = _normalised(design * np.sqrt(gain))
        places = _normalised(places * np.exp(_STEP_SIZE / np.sqrt(step + 1) * (variance / largest - 1)))
    mean_of_each, gain_of_each, prior_of_each = np.array(bounds).T
    return LowerBound(mean_of_each, gain_of_each, prior_of_each, reached, number, design)


def _number_for(candidates: CandidateTouches, target: float) -> float:
    """Number of touches, evenly distributed, that reach the target; `MOST_TOUCHES` where more would be needed."""
    mean = candidates.information.mean(axis=0)
    for number in np.geomspace(_FEWEST, MOST_TOUCHES, 24):
        covariance: Floats = np.asarray(np.linalg.inv(number * mean + candidates.prior), dtype=float)
        if candidates.variance(covariance).max() <= target**2:
            break
    return float(number)


def _normalised(values: Floats) -> Floats:
    return values / values.sum()


def _unpack(packed: Floats) -> Floats:
    """The symmetric matrix of a vector made by `pack(…, twice=True)`."""
    k = int((np.sqrt(8 * len(packed) + 1) - 1) / 2)
    lower = np.zeros((k, k))
    lower[np.tril_indices(k)] = packed
    return (lower + lower.T) / 2


Counts: TypeAlias = NDArray[np.intp]
"""A number for each disc."""

_LEAST_GAIN = 1e-4
"""Smallest relative decrease of the criterion for which touches are exchanged."""
_SWEEPS = 12
"""Largest number of passes over all positions of a set."""
_DOUBLINGS = 4
"""The smooth criterion is the mean of power 2**DOUBLINGS."""
_WORST_CASES = 3
"""Number of the worst losses for which an exchange is sought."""


def largest_variance(
    candidates: CandidateTouches, chosen: list[int], checked: bool = False, *, smooth: bool = False
) -> float:
    """Largest variance of the tip over the workspace, m².

    Args:
        candidates: the candidates.
        chosen: the set, indices of candidates.
        checked: whether the variance after the loss of the touch that matters most is meant, times the penalty for the
            largest leverage.
        smooth: whether the smooth criterion is meant.
    """
    largest = float(_criterion(candidates.variance(_inverse(_cases(candidates, chosen, checked))), smooth).max())
    return largest * float(penalty(leverages(candidates, chosen)).max()) if checked else largest


def improve(candidates: CandidateTouches, chosen: list[int], least: Counts | None = None) -> list[int]:
    """Exchanges touches until none lowers the smooth criterion, then the largest variance, then that with checks.

    Args:
        candidates: the candidates.
        chosen: the set to start from, indices of candidates.
        least: smallest number of touches on each disc, (D,), in a set that checks itself; None for any set.
    """
    chosen = _improve(candidates, chosen, _Stage(False, True), least)
    chosen = _improve(candidates, chosen, _Stage(False, False), least)
    return chosen if least is None else _improve(candidates, chosen, _Stage(True, False), least)


class _Stage(NamedTuple):
    checked: bool
    smooth: bool


def _improve(candidates: CandidateTouches, chosen: list[int], stage: _Stage, least: Counts | None) -> list[int]:
    checked, smooth = stage
    chosen, best = list(chosen), largest_variance(candidates, chosen, checked, smooth=smooth)
    for _ in range(_SWEEPS):
        before = best
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            values = variance_with_each(candidates, others, checked, smooth=smooth)
            values[chosen] = np.inf
            if least is not None:
                values[~may_be_added(candidates, others, least)] = np.inf
            found = int(np.argmin(values))
            if values[found] < best * (1 - _LEAST_GAIN):
                trial = [*others[:place], found, *others[place:]]
                reached = largest_variance(candidates, trial, True) if checked else float(values[found])
                if reached < best * (1 - _LEAST_GAIN):
                    chosen, best = trial, reached
        if best > before * (1 - 10 * _LEAST_GAIN):
            break
    return chosen


def variance_with_each(
    candidates: CandidateTouches, chosen: list[int], checked: bool = False, *, smooth: bool = False
) -> Floats:
    """The criterion with each candidate added to a set, (n,), m²; with checks a lower bound of it."""
    covariances = _inverse(_cases(candidates, chosen, checked))
    if checked:
        order = np.argsort(_criterion(candidates.variance(covariances), False))
        covariances = covariances[order[-_WORST_CASES:]]
    values = np.max([_criterion(_added(candidates, covariance), smooth) for covariance in covariances], axis=0)
    return np.asarray(values * penalty(leverage_with_each(candidates, chosen)) if checked else values)


def _inverse(information: Floats) -> Floats:
    return np.asarray(np.linalg.inv(information), dtype=float)


def _cases(candidates: CandidateTouches, chosen: list[int], checked: bool) -> Floats:
    """Information of the set, or, with checks, of the set without each of its touches, (c, 12 + m, 12 + m)."""
    together = candidates.information_of(chosen)[None]
    return together - candidates.information[chosen] if checked else together


def _added(candidates: CandidateTouches, covariance: Floats) -> Floats:
    """Variance of the tip at each place with each candidate added, (n, g), m²."""
    through = candidates.derivative @ covariance
    innovation = np.eye(2) + through @ np.swapaxes(candidates.derivative, 1, 2)
    root = np.linalg.cholesky(np.linalg.inv(innovation))
    gain = np.swapaxes(root, 1, 2) @ through[:, :, candidates.rows]
    less = candidates.traces(pack(np.swapaxes(gain, 1, 2) @ gain))
    return np.asarray(np.maximum(candidates.variance(covariance) - less, 0.0))


def _criterion(variance: Floats, smooth: bool) -> Floats:
    """The largest over the places, (…), or the smooth criterion."""
    largest = variance.max(axis=-1)
    if not smooth:
        return np.asarray(largest)
    part = variance / largest[..., None]
    for _ in range(_DOUBLINGS):
        part *= part
    return np.asarray(largest * part.mean(axis=-1) ** (0.5**_DOUBLINGS))


NumberProgress = Callable[[int], None]
"""Receives the number of touches for which sets are being sought."""

FEWEST_TOUCHES = 7
"""Smallest number of touches with which the calibration estimates twelve parameters: two equations each."""
_EFFORT = 350
"""Number of starts times number of touches: a few seconds for each number."""
_CHECKED_EFFORT = 60
"""The same for sets that check themselves, whose criterion costs more."""
_FULL_EFFORT_SIZE = 6000
"""Size of `CandidateTouches.quadric` up to which the effort is full; beyond, it decreases in proportion."""
_TRIAL_STARTS, _GIVE_UP_RATIO = 4, 1.06
"""If this many starts all stay above the target by this factor, the number of touches is given up."""
_RANDOM_SETS = 300
"""Number of random sets that a set is compared with."""
COMPLIANCE_FACTOR = 1.5
"""Factor on the expected compliances in the check."""
NOISE_FACTOR = 2.0
"""Factor on the noise of the joints, and on that of the force, in the check."""


class FoundSet(NamedTuple):
    """A set of touches found by the search.

    Attributes:
        chosen: indices of candidates, in increasing order.
        value: largest standard deviation of the tip, m; of a set that checks itself that after the worst loss, and
            infinite if a leverage is too large.
        tried: that of the best sets of smaller numbers of touches, by number, m.
    """

    chosen: tuple[int, ...]
    value: float
    tried: dict[int, float]


def smallest_set(
    candidates: CandidateTouches,
    bound: LowerBound,
    target: float,
    *,
    checked: bool = False,
    least: int = 0,
    seed: int = 0,
    effort: int | None = None,
    report: NumberProgress | None = None,
) -> FoundSet:
    """The smallest set found whose largest standard deviation of the tip is at most the target.

    Args:
        candidates: the candidates.
        bound: lower bound for them.
        target: largest standard deviation of the tip, m.
        checked: whether the set has to check itself, and to keep the target after the loss of any one touch.
        least: smallest number of touches to try.
        seed: of the sets drawn.
        effort: number of starts times number of touches; None: what a few seconds allow.
        report: receives the number of touches being tried.

    Raises:
        UnsupportedDataError: the target is out of reach.
    """
    number, tried = max(FEWEST_TOUCHES + checked, least, bound.number(target) + checked), dict[int, float]()
    while number <= min(MOST_TOUCHES, len(candidates.plan)):
        if report:
            report(number)
        starts = _starts(candidates, number, effort or (_CHECKED_EFFORT if checked else _EFFORT))
        found = best_set(candidates, bound, number, checked=checked, seed=seed, starts=starts, target=target)
        if found.value <= target:
            return found._replace(tried=tried)
        tried[number] = found.value
        number += max(1, number // 40)
    needed = bound.number(target)
    raise UnsupportedDataError(
        f'an accuracy of {target:.3g} m is out of reach: no set of {min(MOST_TOUCHES, len(candidates.plan))} of the '
        f'{len(candidates.plan)} candidate touches reaches it'
        + (f', at least {needed} are needed' if needed > 0 else ''),
        'ask for a larger standard deviation, repeat touches, or move the discs',
    )


def best_set(
    candidates: CandidateTouches,
    bound: LowerBound,
    number: int,
    *,
    checked: bool = False,
    seed: int = 0,
    starts: int,
    target: float = np.inf,
) -> FoundSet:
    """The best set found of a given number of touches.

    Args:
        candidates: the candidates.
        bound: sets are drawn by its weights.
        number: of touches.
        checked: whether the set has to check itself.
        seed: of the sets drawn.
        starts: number of sets to improve.
        target: m; if the first few sets stay far above it, no more are tried.
    """
    random = np.random.default_rng([seed, number, int(checked)])
    least = least_on_discs(candidates, bound.weights, number) if checked else None
    best, lowest = list[int](), np.inf
    for start in range(starts):
        chosen = improve(candidates, _draw(candidates, bound.weights, number, random, least), least)
        reached = float(np.sqrt(largest_variance(candidates, chosen, checked)))
        if reached < lowest:
            best, lowest = chosen, reached
        if start + 1 >= _TRIAL_STARTS and lowest > _GIVE_UP_RATIO * target:
            break
    if checked and leverages(candidates, best).max() > MOST_LEVERAGE:
        lowest = np.inf
    return FoundSet(tuple(sorted(best)), lowest, {})


def _starts(candidates: CandidateTouches, number: int, effort: int) -> int:
    """Number of sets to improve for a number of touches; fewer where each costs more."""
    return max(2, int(effort * min(1.0, _FULL_EFFORT_SIZE / candidates.quadric.size)) // number)


def _draw(
    candidates: CandidateTouches, weights: Floats, number: int, random: np.random.Generator, least: Counts | None
) -> list[int]:
    """A set to start from, with enough touches on each disc."""
    weights = weights + 1e-6 * weights.max()  # so that enough candidates have a weight above 0
    chosen = list[int]()
    for disc, count in enumerate([] if least is None else least.tolist()):
        chosen += _drawn(np.where(candidates.plan.disc == disc, weights, 0.0), count, random)
    weights[chosen] = 0.0
    return chosen + _drawn(weights, number - len(chosen), random)


def _drawn(weights: Floats, number: int, random: np.random.Generator) -> list[int]:
    return random.choice(len(weights), number, replace=False, p=weights / weights.sum()).tolist() if number else []


class SetCheck(NamedTuple):
    """Checks of a set of touches.

    Attributes:
        without_each: largest standard deviation of the tip without each touch, (n,), m.
        growth: largest factor by which the loss of each touch increases the standard deviation of a parameter, (n,).
        random: largest standard deviation of the tip of random sets of the same size, in increasing order, (k,), m.
        more_compliant: that for a robot with compliances `COMPLIANCE_FACTOR` times as large, m.
        more_joint_noise: that with a joint noise `NOISE_FACTOR` times as large, m.
        more_force_noise: that with a force noise `NOISE_FACTOR` times as large, m.
        held_out: force error on touches not seen, in that of the fit.
    """

    without_each: Floats
    growth: Floats
    random: Floats
    more_compliant: float
    more_joint_noise: float
    more_force_noise: float
    held_out: float


def check_set(
    robot: Robot, candidates: CandidateTouches, chosen: Sequence[int], plan: Plan, tip: Tip, seed: int = 0
) -> SetCheck:
    """Checks a set.

    Args:
        robot: the robot.
        candidates: from which it was chosen.
        chosen: the set, indices of candidates.
        plan: its touches.
        tip: the tip whose variance counts.
        seed: of the random sets.
    """
    p, noise = robot.parameters, robot.noise
    more = p.replace(p_ee=COMPLIANCE_FACTOR * p.p_ee, p1=COMPLIANCE_FACTOR * p.p1, p2=COMPLIANCE_FACTOR * p.p2)
    joint = noise._replace(joint=noise.scaled(NOISE_FACTOR).joint)
    force = noise.scaled(NOISE_FACTOR)._replace(joint=noise.joint)
    others = (replace(robot, parameters=more), replace(robot, noise=joint), replace(robot, noise=force))
    compliant, more_joint, more_force = (tip_std(tip, predict(other, plan)).largest for other in others)
    return SetCheck(
        without_each=without_each(robot, plan, tip),
        growth=_growth(prepare_candidates(robot, plan, tip)),
        random=np.sort(largest_of_sets(candidates, random_sets(candidates, len(chosen), seed=seed))),
        more_compliant=compliant,
        more_joint_noise=more_joint,
        more_force_noise=more_force,
        held_out=held_out_ratio(robot, plan),
    )


def without_each(robot: Robot, plan: Plan, tip: Tip) -> Floats:
    """Largest standard deviation of the tip without each touch of a plan, (n,), m."""
    every = np.arange(len(plan))
    return largest_of_sets(prepare_candidates(robot, plan, tip), np.stack([np.delete(every, k) for k in every]))


def _growth(candidates: CandidateTouches) -> Floats:
    """Largest factor on the standard deviation of a parameter without each candidate, of all of them, (n,)."""
    together = candidates.information_of(range(len(candidates.plan)))
    both = np.linalg.inv(np.concatenate([together[None], together - candidates.information]))
    own = np.diagonal(both, axis1=1, axis2=2)[:, : len(PRIOR)]
    return np.asarray(np.sqrt((own[1:] / own[0]).max(axis=1)))


def random_sets(
    candidates: CandidateTouches, number: int, count: int = _RANDOM_SETS, seed: int = 0
) -> NDArray[np.intp]:
    """Sets drawn from the candidates with equal probabilities, (count, number)."""
    random = np.random.default_rng([seed, number])
    return np.asarray(np.argsort(random.random((count, len(candidates.plan))), axis=1)[:, :number])


def largest_of_sets(candidates: CandidateTouches, sets: NDArray[np.intp]) -> Floats:
    """Largest standard deviation of the tip for sets of touches (b, m), (b,), m; by singular values."""
    k = candidates.derivative.shape[2]
    prior = np.concatenate([np.eye(len(PRIOR), k), candidates.declared])
    rows = candidates.derivative[sets].reshape(len(sets), -1, k)
    rows = np.concatenate([rows, np.broadcast_to(prior, (len(sets), *prior.shape))], axis=1)
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    root = np.swapaxes(right, 1, 2) / values[:, None, :]
    return np.asarray(np.sqrt(candidates.variance(root @ np.swapaxes(root, 1, 2)).max(axis=1)))
