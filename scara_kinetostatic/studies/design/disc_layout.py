"""Discs that need not be there yet: many layouts at once, judged by touches spread evenly over them.

A layout is a few discs. Its touches go evenly around every disc, in the given postures, the force levels in turn,
wherever the arm reaches, no other disc stands before the point and no joint's axis is close to the line of force.
What is judged is the largest standard deviation of the tip for a given number of touches spread evenly over these.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.simulation.plan import BASE_MARGIN, CLEARANCE
from scara_kinetostatic.studies.design.candidates import LEAST_ARM, PRIOR, pack
from scara_kinetostatic.studies.design.prediction import Robot, exact_touches
from scara_kinetostatic.studies.design.workspace import Tip, reach

Floats = NDArray[np.float64]

POINTS = 24
"""Around a disc."""
LEAST_SHARE = 0.15
"""A disc of which less can be touched is of no use."""


class Touching(NamedTuple):
    """How discs are touched.

    Attributes:
        levels: force levels, N.
        postures: +1, -1.
        points: around a disc.
    """

    levels: Sequence[float] = (10.0, 25.0, 40.0)
    postures: Sequence[int] = (1, -1)
    points: int = POINTS


class Spread(NamedTuple):
    """Information of touches spread evenly over b discs.

    Attributes:
        information: mean over what can be touched of each disc, in `SCALES`, (b, 12, 12).
        share: part of each disc's touches that can be made, (b,).
    """

    information: Floats
    share: Floats


def spread_over(robot: Robot, discs: Floats, others: Floats, touching: Touching) -> Spread:
    """What even touches of discs tell.

    Args:
        robot: the robot; the discs of its cell do not count.
        discs: (b, 3): x, y, radius, m.
        others: the discs that stand beside each, (b, k, 3), m; NaN for none.
        touching: how.
    """
    angle, posture, force = _pattern(touching)
    b, m = len(discs), len(angle)
    outward = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    contact = discs[:, None, :2] + discs[:, None, 2:] * outward
    free = within_reach_of(robot, contact) & within_reach_of(robot, contact + CLEARANCE * outward)
    for place in (contact, contact + CLEARANCE * outward):
        apart = np.linalg.norm(place[:, :, None] - others[:, None, :, :2], axis=-1) - others[:, None, :, 2]
        free &= ~(apart <= CLEARANCE / 2).any(axis=2)
    disc, touch = np.nonzero(free)
    exact = exact_touches(robot, discs[disc, :2], discs[disc, 2], angle[touch], posture[touch], force[touch])
    good = (exact.arms >= LEAST_ARM).all(axis=1)
    rows = np.zeros((b, m, 2, len(NAMES)))
    rows[disc[good], touch[good]] = exact.point.whitened.derivative[good] * SCALES
    flat = rows.reshape(b, -1, len(NAMES))
    count = np.bincount(disc[good], minlength=b)
    information = np.swapaxes(flat, 1, 2) @ flat / np.maximum(count, 1)[:, None, None]
    return Spread(information, count / m)


def largest_std(information: Floats, tip: Tip) -> Floats:
    """Largest standard deviation of the tip for information (b, 12, 12) in `SCALES`, (b,), m."""
    scaled = (tip.derivative * SCALES).reshape(-1, 2, len(NAMES))
    squares = pack(np.einsum('gik,gil->gkl', scaled, scaled), twice=True)
    covariance: Floats = np.asarray(np.linalg.inv(information + PRIOR), dtype=float)
    return np.asarray(np.sqrt((pack(covariance) @ squares.T).max(axis=-1)))


def within_reach_of(robot: Robot, places: Floats) -> NDArray[np.bool_]:
    """Which places, (…, 2), the nominal arm reaches with a margin, (…)."""
    nominal = robot.cell.nominal
    distance = np.hypot(places[..., 0] - nominal.x0, places[..., 1] - nominal.y0)
    least, most = reach(robot)
    return np.asarray((distance >= least) & (distance <= most))


def clash(robot: Robot, layouts: Floats) -> Floats:
    """By how much discs of each layout (b, d, 3) stand in one another or in the base, (b,), m; 0 where they do not."""
    nominal = robot.cell.nominal
    to_base = np.hypot(layouts[..., 0] - nominal.x0, layouts[..., 1] - nominal.y0) - layouts[..., 2]
    wrong = np.maximum(BASE_MARGIN - to_base, 0).sum(axis=1)
    for i in range(layouts.shape[1]):
        for j in range(i):
            gap = np.linalg.norm(layouts[:, i, :2] - layouts[:, j, :2], axis=-1)
            gap = gap - layouts[:, i, 2] - layouts[:, j, 2] - 2 * CLEARANCE
            wrong += np.maximum(-gap, 0)
    return np.asarray(wrong)


def _pattern(touching: Touching) -> tuple[Floats, NDArray[np.intp], Floats]:
    """Angle, posture and force of the touches of a disc, the levels in turn along it."""
    point, side = np.meshgrid(np.arange(touching.points), np.arange(len(touching.postures)), indexing='ij')
    levels = np.asarray(touching.levels, dtype=float)
    angle = 2 * np.pi * point.ravel() / touching.points
    return angle, np.asarray(touching.postures)[side.ravel()], levels[(point + side).ravel() % len(levels)]
