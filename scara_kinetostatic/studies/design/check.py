"""Is the chosen set as small and as good as it seems? Without each touch; beside random sets; with a softer robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.pool import PRIOR, Pool
from scara_kinetostatic.studies.design.prediction import Robot, predict
from scara_kinetostatic.studies.design.workspace import Tip, tip_std

Floats = NDArray[np.float64]

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
