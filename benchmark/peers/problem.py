"""The touches on which this package and its peers are timed: the paper's cell, simulated with noise, any number.

The torque of every joint in every touch is clearly not zero, so that a solver that does not model the dead band of
the backlash has a smooth problem; it is given the signs of the torques.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmark.common import CELL, NOISE
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.plan import Plan, default_plan

LEAST_LEVER = 0.02
"""Shortest lever arm of the force about either joint at L̄n, m."""


class Problem(NamedTuple):
    """n touches.

    Attributes:
        touches: as `calibrate` takes them.
        signs: of the torque of each joint, (n, 2).
        centers: of the touched disc, (n, 2), m.
        radii: its radius, (n,), m.
    """

    touches: TouchSet
    signs: Floats
    centers: Floats
    radii: Floats


class Solution(NamedTuple):
    """The result of a contender.

    Attributes:
        values: L̄, (12,).
        iterations: by its own count.
        success: whether it reports convergence.
    """

    values: Floats
    iterations: int
    success: bool


class Prepared(NamedTuple):
    """A contender ready to be timed.

    Attributes:
        solve: estimates L̄; this is timed.
        build: processor time of its preparation, s; 0 where there is none.
    """

    solve: Callable[[], Solution]
    build: float = 0.0


def simulated(count: int, seed: int = 0) -> Problem:
    """Touches of L̄a on the paper's three discs, one posture, three force levels, with the cell's noise."""
    plan = default_plan(CELL, per_disc=-(-count // 2), postures=(1,))
    plan = plan.select(_lever(plan) > LEAST_LEVER).select(np.arange(count))
    force = -plan.force[:, None] * plan.normal()
    joints, torques = inverse_kinetostatics(PAPER_ACTUAL, plan.contact(CELL), force, plan.posture)
    joint_errors, force_errors = np.random.default_rng(seed).standard_normal((2, count, 2))
    touches = TouchSet(
        joints=joints + NOISE.joint * joint_errors,
        force=force + NOISE.force * force_errors,
        disc=plan.disc,
        posture=plan.posture,
    )
    return Problem(touches, np.sign(torques), CELL.centers[plan.disc], CELL.radii[plan.disc])


def _lever(plan: Plan) -> Floats:
    """The shorter of the lever arms of the force about both axes, (m,), m."""
    tip, normal = plan.contact(CELL), plan.normal()
    _, link2 = kinematics.link_vectors(PAPER_NOMINAL, kinematics.inverse(PAPER_NOMINAL, tip, plan.posture))
    arms = [part[:, 0] * normal[:, 1] - part[:, 1] * normal[:, 0] for part in (tip, link2)]
    return np.asarray(np.min(np.abs(arms), axis=0))
