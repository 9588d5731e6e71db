r"""The smallest set of touches that reaches an accuracy and checks itself: lower bound, exchange, checks.

**Lower bound**, from the theory of optimal approximate designs. Such a design distributes the touches over the
candidates by weights ξ, fractions and repetitions allowed: the information of N touches is N Σ ξ_i I_i + P, with P the
prior of the errors that the cell declares; P = 0 where it declares none. No real set of N touches is better than the
best approximate design. Its largest variance of the tip is bounded from below: for any weights λ of the places,
L = Σ λ_g T_gᵀT_g, and any symmetric C, the Cauchy–Schwarz inequality gives for every design ξ', with covariance
C' = (N Σ ξ'_i I_i + P)⁻¹,

    tr(L C') ≥ tr(L C)² / tr(C L C C'⁻¹) ≥ tr(L C)² / (N max_i tr(C L C I_i) + tr(C L C P)),

and the largest variance is no less than the mean weighted by λ. So N touches reach a variance v only if
N ≥ (tr(L C)²/v - tr(C L C P)) / max_i tr(C L C I_i). ξ, C = (N Σ ξ_i I_i + P)⁻¹ and λ that make the bound tight are
found by multiplicative iterations; every iteration leaves a bound, and the best one counts. With P = 0 the iterations
do not depend on N; else they are made for the number of touches that the accuracy takes, as far as it can be reached,
and the bound is less tight, but still valid, for other numbers.

**Exchange** (Fedorov): a set drawn at random by ξ is improved by replacing one touch at a time. The criterion is the
largest variance of the tip over the workspace. Adding a touch changes the covariance C = I⁻¹ by
-C Jᵀ (1 + J C Jᵀ)⁻¹ J C, so that all candidates for one position in the set are evaluated by a few matrix products. The
largest variance is not smooth, and exchange stops early at its edges; a mean of high power of the variances is smooth
and is minimised first. For a set that checks itself (`candidates`) the criterion is then the largest variance after the
loss of any one touch, times a penalty for the largest leverage; an exchange is sought for the worst few losses and
accepted if it lowers the criterion over all of them; every disc keeps its touches.

Numbers of touches are tried from the lower bound upwards. The first number at which a set reaches the accuracy is
taken; its distance from the lower bound limits what a better search could save.

Sources: Kiefer, Annals of Statistics 2 (1974) 849; Silvey, Titterington and Torsney, Communications in
Statistics A 7 (1978) 1379, for the iteration; Fedorov, Theory of Optimal Experiments (1972), chapter 3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.planning.candidates import (
    MOST_LEVERAGE,
    CandidateTouches,
    least_on_discs,
    leverage_with_each,
    leverages,
    may_be_added,
    pack,
    penalty,
    prepare_candidates,
    unpack,
)
from scara_kinetostatic.planning.prediction import Robot, Tip
from scara_kinetostatic.simulation.plan import Plan

MOST_TOUCHES = 200
"""Largest set that is searched for."""
FEWEST_TOUCHES = 7
"""Smallest number of touches with which the calibration estimates twelve parameters: two equations each."""


class LowerBound(NamedTuple):
    """Bounds of the largest variance of the tip for all designs, and the approximate design found.

    Attributes:
        mean: tr(L C) of each iteration, (s,), m².
        gain: max_i tr(C L C I_i), (s,), m².
        prior: tr(C L C P), (s,), m²; 0 without declared uncertainties.
        weights: of the candidates in that design, ξ, (n,).
    """

    mean: Floats
    gain: Floats
    prior: Floats
    weights: Floats

    def variance(self, number: float) -> float:
        """The largest variance of the tip with this many touches is at least this, m²."""
        return float((self.mean**2 / (number * self.gain + self.prior)).max())

    def number(self, target: float) -> int:
        """Number of touches below which no set reaches a largest standard deviation of the tip of `target`, m."""
        needed = float(((self.mean**2 / target**2 - self.prior) / self.gain).max())
        return max(0, int(np.ceil(needed - 1e-9)))


def find_lower_bound(candidates: CandidateTouches, target: float, iterations: int = 400) -> LowerBound:
    """Bounds the largest variance of the tip.

    Args:
        candidates: the candidates and the tip.
        target: largest standard deviation of the tip for which the bound is to be tight, m.
        iterations: more make the bound tighter; it is valid after any number.
    """
    number = 1.0
    if len(candidates.declared):  # evenly distributed, they reach the target, as far as it can be reached
        numbers = np.geomspace(FEWEST_TOUCHES, MOST_TOUCHES, 24).tolist()
        number = next((n for n in numbers if candidates.evenly_distributed(n) <= target), numbers[-1])
    declared = candidates.declared.T @ candidates.declared
    regular = declared.copy()
    regular[: candidates.values, : candidates.values] += 1e-6 * np.eye(candidates.values)  # where the rank is less
    design = np.full(len(candidates.plan), 1 / len(candidates.plan))  # ξ
    places = np.full(candidates.quadric.shape[1], 1 / candidates.quadric.shape[1])  # λ
    bounds = []
    for step in range(iterations):
        information = number * np.tensordot(design, candidates.information, axes=1) + regular
        covariance: Floats = np.asarray(np.linalg.inv(information), dtype=float)
        variance = candidates.variance(covariance)
        squares = unpack(candidates.quadric @ places)
        through = candidates.derivative @ covariance[:, candidates.rows]
        gain = np.einsum('nik,kl,nil->n', through, squares, through, optimize=True)
        known = candidates.declared @ covariance[:, candidates.rows]
        by_prior = float(np.einsum('pk,kl,pl->', known, squares, known))
        mean, largest = float(places @ variance), float(variance.max())
        bounds.append((mean, float(gain.max()), by_prior))
        design = design * np.sqrt(np.maximum(gain, 0.0))  # less is rounding
        design /= design.sum()
        places = places * np.exp(6.0 / np.sqrt(step + 1) * (variance / largest - 1))
        places /= places.sum()
    mean_of_each, gain_of_each, prior_of_each = np.array(bounds).T
    return LowerBound(mean_of_each, gain_of_each, prior_of_each, design)


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
    largest = float(_criterion(candidates.variance(_covariances(candidates, chosen, checked)), smooth).max())
    return largest * float(penalty(leverages(candidates, chosen)).max()) if checked else largest


def improve(
    candidates: CandidateTouches, chosen: list[int], least: Indices | None = None, *, least_gain: float = 1e-4
) -> list[int]:
    """Exchanges touches until none lowers the smooth criterion, then the largest variance, then that with checks.

    Args:
        candidates: the candidates.
        chosen: the set to start from, indices of candidates.
        least: smallest number of touches on each disc, (D,), in a set that checks itself; None for any set.
        least_gain: smallest relative decrease of the criterion for which touches are exchanged.
    """
    for checked, smooth in ((False, True), (False, False), *([] if least is None else [(True, False)])):
        chosen, best = list(chosen), largest_variance(candidates, chosen, checked, smooth=smooth)
        for _ in range(12):  # passes over all positions of the set
            before = best
            for place in range(len(chosen)):
                others = chosen[:place] + chosen[place + 1 :]
                values = variance_with_each(candidates, others, checked, smooth=smooth)
                values[chosen] = np.inf
                if least is not None:
                    values[~may_be_added(candidates, others, least)] = np.inf
                found = int(np.argmin(values))
                if values[found] < best * (1 - least_gain):
                    trial = [*others[:place], found, *others[place:]]
                    reached = largest_variance(candidates, trial, True) if checked else float(values[found])
                    if reached < best * (1 - least_gain):
                        chosen, best = trial, reached
            if best > before * (1 - 10 * least_gain):
                break
    return chosen


def variance_with_each(
    candidates: CandidateTouches, chosen: list[int], checked: bool = False, *, smooth: bool = False
) -> Floats:
    """The criterion with each candidate added to a set, (n,), m²; with checks a lower bound of it."""
    covariances = _covariances(candidates, chosen, checked)
    if checked:  # the three worst losses
        order = np.argsort(_criterion(candidates.variance(covariances), False))
        covariances = covariances[order[-3:]]
    values = np.max([_criterion(_added(candidates, covariance), smooth) for covariance in covariances], axis=0)
    return np.asarray(values * penalty(leverage_with_each(candidates, chosen)) if checked else values)


def _covariances(candidates: CandidateTouches, chosen: list[int], checked: bool) -> Floats:
    """Covariance with the set, or, with checks, with the set without each of its touches, (c, 12 + m, 12 + m)."""
    together = candidates.information_of(chosen)[None]
    return np.asarray(np.linalg.inv(together - candidates.information[chosen] if checked else together), dtype=float)


def _added(candidates: CandidateTouches, covariance: Floats) -> Floats:
    """Variance of the tip at each place with each candidate added, (n, g), m²."""
    through = candidates.derivative @ covariance
    innovation = np.eye(2) + through @ np.swapaxes(candidates.derivative, 1, 2)
    root = np.linalg.cholesky(np.linalg.inv(innovation))
    gain = np.swapaxes(root, 1, 2) @ through[:, :, candidates.rows]
    less = candidates.traces(pack(np.swapaxes(gain, 1, 2) @ gain))
    return np.asarray(np.maximum(candidates.variance(covariance) - less, 0.0))


def _criterion(variance: Floats, smooth: bool, doublings: int = 4) -> Floats:
    """The largest over the places, (…), or the smooth criterion: the mean of power 2**doublings."""
    largest = variance.max(axis=-1)
    if not smooth:
        return np.asarray(largest)
    part = variance / largest[..., None]
    for _ in range(doublings):
        part *= part
    return np.asarray(largest * part.mean(axis=-1) ** (0.5**doublings))


def best_set(
    candidates: CandidateTouches,
    bound: LowerBound,
    number: int,
    *,
    checked: bool = False,
    seed: int = 0,
    starts: int,
    target: float = np.inf,
) -> tuple[list[int], float]:
    """The best set found of a given number of touches: indices of candidates, in increasing order, and its largest
    standard deviation of the tip, m; of a set that checks itself that after the worst loss, and infinite if a leverage
    is too large.

    Args:
        candidates: the candidates.
        bound: sets are drawn by its weights.
        number: of touches.
        checked: whether the set has to check itself.
        seed: of the sets drawn.
        starts: number of sets to improve.
        target: m; if the first four sets all stay 6 % above it, no more are tried.
    """
    random = np.random.default_rng([seed, number, int(checked)])
    least = least_on_discs(candidates, bound.weights, number) if checked else None
    best, lowest = list[int](), np.inf
    for start in range(starts):
        chosen = improve(candidates, _draw(candidates, bound.weights, number, random, least), least)
        reached = float(np.sqrt(largest_variance(candidates, chosen, checked)))
        if reached < lowest:
            best, lowest = chosen, reached
        if start >= 3 and lowest > 1.06 * target:
            break
    if checked and leverages(candidates, best).max() > MOST_LEVERAGE:
        lowest = np.inf
    return sorted(best), lowest


def _draw(
    candidates: CandidateTouches, weights: Floats, number: int, random: np.random.Generator, least: Indices | None
) -> list[int]:
    """A set to start from, with enough touches on each disc."""

    def drawn(weights: Floats, count: int) -> list[int]:
        return random.choice(len(weights), count, replace=False, p=weights / weights.sum()).tolist() if count else []

    weights = weights + 1e-6 * weights.max()  # so that enough candidates have a weight above 0
    chosen = list[int]()
    for disc, count in enumerate([] if least is None else least.tolist()):
        chosen += drawn(np.where(candidates.plan.disc == disc, weights, 0.0), count)
    weights[chosen] = 0.0
    return chosen + drawn(weights, number - len(chosen))


def without_each(robot: Robot, plan: Plan, tip: Tip) -> Floats:
    """Largest standard deviation of the tip without each touch of a plan, (n,), m."""
    of_plan = prepare_candidates(robot, plan, tip)
    return np.asarray(np.sqrt(of_plan.variance(_covariances(of_plan, list(range(len(plan))), True)).max(axis=1)))
