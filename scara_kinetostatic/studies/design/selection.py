"""The smallest set of touches that reaches an accuracy, and checks of it.

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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import PRIOR, CandidateTouches, prepare_candidates
from scara_kinetostatic.studies.design.exchange import Counts, improve, largest_variance
from scara_kinetostatic.studies.design.held_out import held_out_ratio
from scara_kinetostatic.studies.design.lower_bound import MOST_TOUCHES, LowerBound
from scara_kinetostatic.studies.design.prediction import Robot, predict
from scara_kinetostatic.studies.design.self_check import MOST_LEVERAGE, least_on_discs, leverages
from scara_kinetostatic.studies.design.workspace import Tip, tip_std

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
