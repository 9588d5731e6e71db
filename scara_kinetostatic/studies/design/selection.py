"""The smallest set of touches that reaches an accuracy.

What is to be small is the largest standard deviation of the tip over the workspace. Numbers of touches are tried
from the proven bound (`design_bound`) upwards; for each, sets are drawn at random by the optimal parts of the
candidates and improved by exchange (`design_exchange`). The first number at which a set
reaches the accuracy is taken, with the best set of that number. The bound says how much a perfect
search could still save.

Is the chosen set as small and as good as it seems? Without each touch; beside random sets; with a softer robot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import PRIOR, Pool
from scara_kinetostatic.studies.design.exchange import improve, largest_variance
from scara_kinetostatic.studies.design.lower_bound import Bound
from scara_kinetostatic.studies.design.prediction import Robot, predict
from scara_kinetostatic.studies.design.workspace import Tip, tip_std

Floats = NDArray[np.float64]
Tell = Callable[[int], None]

FEWEST = 7
"""The calibration takes no fewer for twelve parameters."""
MOST = 200
"""No larger set is looked for."""
EFFORT = 350
"""Number of starts times number of touches."""
SPARE_EFFORT = 60
CHEAP = 6000
"""Size of the places times parameters up to which the effort is full."""
FIRST_FEW, HOPELESS = 4, 1.06
"""If so many starts stay above the target by this factor, the number is given up."""


class Selection(NamedTuple):
    """A set of touches found.

    Attributes:
        chosen: positions in the pool, in increasing order.
        value: its largest standard deviation of the tip, m; with a spare, after the worst loss.
        tried: what the best sets of smaller numbers reached, by number, m.
    """

    chosen: tuple[int, ...]
    value: float
    tried: dict[int, float]


def smallest_set(
    pool: Pool,
    bound: Bound,
    target: float,
    *,
    spare: int = 0,
    least: int = 0,
    seed: int = 0,
    effort: int | None = None,
    tell: Tell | None = None,
) -> Selection:
    """The smallest set found whose largest standard deviation of the tip is at most the target.

    Args:
        pool: the candidates.
        bound: theirs.
        target: m.
        spare: 0, or 1 if any one touch may be lost.
        least: try no smaller number.
        seed: of the sets drawn.
        effort: number of starts times number of touches; None: what a few seconds allow.
        tell: is told the number of touches being tried.

    Raises:
        UnsupportedDataError: the target is out of reach.
    """
    number, tried = max(FEWEST + spare, least, bound.number(target) + spare), dict[int, float]()
    while number <= min(MOST, len(pool.plan)):
        if tell:
            tell(number)
        starts = _starts(pool, number, effort or (SPARE_EFFORT if spare else EFFORT))
        found = best_set(pool, bound, number, spare=spare, seed=seed, starts=starts, target=target)
        if found.value <= target:
            return found._replace(tried=tried)
        tried[number] = found.value
        number += max(1, number // 40)
    raise UnsupportedDataError(
        f'an accuracy of {target:.3g} m is out of reach: no set of {min(MOST, len(pool.plan))} of the '
        f'{len(pool.plan)} touches to choose from gives it, {bound.number(target)} would be needed at the very least',
        'ask for less, repeat touches, or move the discs',
    )


def best_set(
    pool: Pool,
    bound: Bound,
    number: int,
    *,
    spare: int = 0,
    seed: int = 0,
    starts: int,
    target: float = np.inf,
) -> Selection:
    """The best set found of a given number of touches.

    Args:
        pool: the candidates.
        bound: their parts are what sets are drawn by.
        number: of touches.
        spare: 0, or 1 if any one touch may be lost.
        seed: of the sets drawn.
        starts: how many sets to improve.
        target: m; if the first few sets stay far above it, no more are tried.
    """
    random = np.random.default_rng([seed, number, spare])
    best, lowest = list[int](), np.inf
    for start in range(starts):
        chosen = improve(pool, _draw(bound.parts, number, random), spare)
        reached = float(np.sqrt(largest_variance(pool, chosen, spare)))
        if reached < lowest:
            best, lowest = chosen, reached
        if start + 1 >= FIRST_FEW and lowest > HOPELESS * target:
            break
    return Selection(tuple(sorted(best)), lowest, {})


def _starts(pool: Pool, number: int, effort: int) -> int:
    """How many sets of a number to improve; fewer where each costs more."""
    return max(2, int(effort * min(1.0, CHEAP / pool.quadric.size)) // number)


def _draw(parts: Floats, number: int, random: np.random.Generator) -> list[int]:
    parts = parts + 1e-6 * parts.max()
    return random.choice(len(parts), number, replace=False, p=parts / parts.sum()).tolist()


RANDOM_SETS = 300
SOFTER = 1.5


class Check(NamedTuple):
    """What speaks for a set of touches.

    Attributes:
        without_each: largest standard deviation of the tip without each touch, (n,), m.
        random: the same for random sets of as many touches, in increasing order, (k,), m.
        softer: the same for a robot with compliances `SOFTER` times as large, m.
    """

    without_each: Floats
    random: Floats
    softer: float


def check(robot: Robot, pool: Pool, chosen: Sequence[int], plan: Plan, tip: Tip, seed: int = 0) -> Check:
    """Check a chosen set.

    Args:
        robot: the robot.
        pool: what was chosen from.
        chosen: the set, positions in the pool.
        plan: its touches.
        tip: whose uncertainty is to be small.
        seed: of the random sets.
    """
    each = np.stack([np.delete(np.asarray(chosen), k) for k in range(len(chosen))])
    p = robot.parameters
    soft = Robot(robot.cell, p.replace(p_ee=SOFTER * p.p_ee, p1=SOFTER * p.p1, p2=SOFTER * p.p2), robot.noise)
    return Check(
        largest_of_sets(pool, each),
        np.sort(largest_of_sets(pool, random_sets(pool, len(chosen), seed=seed))),
        tip_std(tip, predict(soft, plan)).largest,
    )


def random_sets(pool: Pool, number: int, count: int = RANDOM_SETS, seed: int = 0) -> NDArray[np.intp]:
    """Sets drawn from the pool, all touches alike, (count, number)."""
    random = np.random.default_rng([seed, number])
    return np.asarray(np.argsort(random.random((count, len(pool.plan))), axis=1)[:, :number])


def largest_of_sets(pool: Pool, sets: NDArray[np.intp]) -> Floats:
    """Largest standard deviation of the tip for sets of touches (b, m), by singular values, (b,), m."""
    rows = pool.derivative[sets].reshape(len(sets), -1, len(PRIOR))
    rows = np.concatenate([rows, np.broadcast_to(PRIOR, (len(sets), *PRIOR.shape))], axis=1)
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    root = np.swapaxes(right, 1, 2) / values[:, None, :]
    return np.asarray(np.sqrt(pool.variance(root @ np.swapaxes(root, 1, 2)).max(axis=1)))
