"""Accuracy of many layouts of discs at once, each with touches evenly distributed over it.

A layout is a few discs, which need not be in the cell. Its touches are evenly distributed around every disc, in the
given postures and with the force levels in turn, wherever the arm reaches, no other disc is in the way and no joint's
axis is close to the line of force. The criterion is the largest standard deviation of the tip for a given number of
touches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.simulation.plan import BASE_MARGIN, CLEARANCE
from scara_kinetostatic.studies.design.candidates import LEAST_ARM, PRIOR, pack
from scara_kinetostatic.studies.design.prediction import Robot, exact_touches
from scara_kinetostatic.studies.design.workspace import Tip, reach

_POINTS = 24
"""Touches around a disc from which its information is averaged."""
LEAST_SHARE = 0.15
"""A disc of which a smaller share of the touches can be made is not placed."""


class TouchPattern(NamedTuple):
    """How discs are touched.

    Attributes:
        levels: force levels, N.
        postures: +1, -1.
        points: around a disc.
    """

    levels: Sequence[float] = (10.0, 25.0, 40.0)
    postures: Sequence[int] = (1, -1)
    points: int = _POINTS


class EvenTouches(NamedTuple):
    """Information of touches evenly distributed over b discs.

    Attributes:
        information: mean over the touches of each disc that can be made, in `SCALES`, (b, 12, 12).
        share: share of each disc's touches that can be made, (b,).
    """

    information: Floats
    share: Floats


def even_touches(robot: Robot, discs: Floats, others: Floats, pattern: TouchPattern) -> EvenTouches:
    """Information of evenly distributed touches.

    Args:
        robot: the robot; the discs of its cell do not count.
        discs: x, y, radius, (b, 3), m.
        others: the other discs of each one's layout, (b, k, 3), m; NaN for none.
        pattern: how the discs are touched.
    """
    angle, posture, force = _pattern(pattern)
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
    return EvenTouches(information, count / m)


def largest_std(information: Floats, tip: Tip) -> Floats:
    """Largest standard deviation of the tip for information (b, 12, 12) in `SCALES`, (b,), m."""
    scaled = (tip.derivative * SCALES).reshape(-1, 2, len(NAMES))
    squares = pack(np.einsum('gik,gil->gkl', scaled, scaled), twice=True)
    covariance: Floats = np.asarray(np.linalg.inv(information + PRIOR), dtype=float)
    return np.asarray(np.sqrt((pack(covariance) @ squares.T).max(axis=-1)))


def within_reach_of(robot: Robot, places: Floats) -> NDArray[np.bool_]:
    """Whether the nominal arm reaches places, (…, 2), m, with a margin, (…)."""
    nominal = robot.cell.nominal
    distance = np.hypot(places[..., 0] - nominal.x0, places[..., 1] - nominal.y0)
    least, most = reach(robot)
    return np.asarray((distance >= least) & (distance <= most))


def overlap(robot: Robot, layouts: Floats) -> Floats:
    """Sum of the overlaps of discs with one another or with the base in layouts (b, d, 3), (b,), m; 0 without any."""
    nominal = robot.cell.nominal
    to_base = np.hypot(layouts[..., 0] - nominal.x0, layouts[..., 1] - nominal.y0) - layouts[..., 2]
    wrong = np.maximum(BASE_MARGIN - to_base, 0).sum(axis=1)
    for i in range(layouts.shape[1]):
        for j in range(i):
            gap = np.linalg.norm(layouts[:, i, :2] - layouts[:, j, :2], axis=-1)
            gap = gap - layouts[:, i, 2] - layouts[:, j, 2] - 2 * CLEARANCE
            wrong += np.maximum(-gap, 0)
    return np.asarray(wrong)


def _pattern(pattern: TouchPattern) -> tuple[Floats, NDArray[np.intp], Floats]:
    """Angle (rad), posture and force (N) of the touches of a disc, the force levels in turn."""
    point, side = np.meshgrid(np.arange(pattern.points), np.arange(len(pattern.postures)), indexing='ij')
    levels = np.asarray(pattern.levels, dtype=float)
    angle = 2 * np.pi * point.ravel() / pattern.points
    return angle, np.asarray(pattern.postures)[side.ravel()], levels[(point + side).ravel() % len(levels)]
