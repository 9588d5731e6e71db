"""Placement of discs: a new layout of a few discs, or one additional disc in the cell.

Layouts are optimised by differential evolution over centres (polar about the base) and radii, seeded, so that the same
cell gives the same discs. Where the whole reach counts, turning a layout about the base changes nothing; the first disc
is then put on the y axis.

Source: Storn and Price, J. Global Optimization 11 (1997) 341.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.studies.design.disc_layout import (
    LEAST_SHARE,
    TouchPattern,
    disc_stds,
    even_touches,
    largest_std,
    overlap,
    typical_stds,
    with_declared,
    within_reach_of,
)
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.design.workspace import Region, Tip, reach

INFEASIBLE = 1.0
"""Value of the criterion for a layout that violates a constraint, m, to which the violation is added."""
_GENERATIONS, _POPULATION = 120, 48
"""Of the differential evolution."""
_GRID = 1e-3
"""Centres and radii are rounded to this, m."""


class Layout(NamedTuple):
    """A layout of discs.

    Attributes:
        discs: the discs.
        largest: largest standard deviation of the tip for the required number of touches, evenly distributed, m.
    """

    discs: tuple[Disc, ...]
    largest: float


class DiscMap(NamedTuple):
    """Accuracy with one additional disc, by the place of its centre.

    Attributes:
        x: of the grid's columns, (k,), m.
        y: of its rows, (k,), m.
        largest: largest standard deviation of the tip, (k, k), m; NaN where the disc cannot be.
        without: that for the same total number of touches on the discs of the cell, m.
        radius: of the disc, m.
        touches: number on the discs of the cell, and number on the additional one.
    """

    x: Floats
    y: Floats
    largest: Floats
    without: float
    radius: float
    touches: tuple[int, int]


def evaluate_layouts(
    robot: Robot, layouts: Floats, tip: Tip, pattern: TouchPattern, number: int, region: Region
) -> Floats:
    """Largest standard deviation of the tip for layouts (b, d, 3), (b,), m; above `INFEASIBLE` where infeasible."""
    b, d, _ = layouts.shape
    others = np.stack([np.delete(layouts, i, axis=1) for i in range(d)], axis=1).reshape(b * d, d - 1, 3)
    even = even_touches(robot, layouts.reshape(b * d, 3), others, pattern)
    share = even.share.reshape(b, d)
    weight = share / np.maximum(share.sum(axis=1, keepdims=True), 1e-9)
    by_disc = even.of_number(number * weight.ravel())
    information = with_declared(robot, by_disc.reshape(b, d, *by_disc.shape[1:]).sum(axis=1))
    violation = overlap(robot, layouts) + np.maximum(LEAST_SHARE - share, 0).sum(axis=1)
    violation += (~region.holds(layouts[..., :2])).sum(axis=1)
    return np.where(violation > 0, INFEASIBLE + violation, np.minimum(largest_std(information, tip), INFEASIBLE))


def place_discs(
    robot: Robot,
    count: int,
    radii: tuple[float, float],
    tip: Tip,
    *,
    pattern: TouchPattern | None = None,
    number: int = 36,
    region: Region | None = None,
    seed: int = 0,
    generations: int = _GENERATIONS,
) -> Layout | None:
    """The best centres and radii found for a number of discs.

    Args:
        robot: the robot; the discs of its cell do not count.
        count: number of discs.
        radii: smallest and largest radius, m.
        tip: the tip whose variance counts.
        pattern: how the discs are touched.
        number: of touches, evenly distributed.
        region: where the centres may be.
        seed: of the search.
        generations: of the search.

    Returns:
        The layout, or None if no feasible one was found.
    """
    pattern, whole = pattern or TouchPattern(), region is None or region == Region()
    least, most = reach(robot)
    bounds = [(least, most), (0.0, 2 * np.pi), radii] * count
    if whole:
        bounds[1] = (np.pi / 2, np.pi / 2 + 1e-9)
    base = np.array([robot.cell.nominal.x0, robot.cell.nominal.y0])

    def layouts(x: Floats) -> Floats:
        polar = x.T.reshape(-1, count, 3)
        shift = polar[..., :1] * np.stack([np.cos(polar[..., 1]), np.sin(polar[..., 1])], axis=-1)
        return np.concatenate([shift + base, polar[..., 2:]], axis=-1)

    def objective(x: Floats) -> Floats:
        return evaluate_layouts(robot, layouts(x), tip, pattern, number, region or Region())

    found = differential_evolution(
        objective, bounds, maxiter=generations, popsize=max(5, _POPULATION // (3 * count)), seed=seed, polish=False,
        tol=1e-4, updating='deferred', vectorized=True, init='sobol',
    )  # fmt: skip
    if found.fun >= INFEASIBLE:
        return None
    best = np.round(layouts(found.x[:, None]) / _GRID) * _GRID + 0.0  # no -0
    largest = float(evaluate_layouts(robot, best, tip, pattern, number, region or Region())[0])
    order = best[0][np.argsort(-best[0][:, 2])]
    place, _, radius = typical_stds(robot.cell).tolist()
    discs = (Disc(f'disc_{i}', x, y, r, place, radius) for i, (x, y, r) in enumerate(order.tolist(), 1))
    return Layout(tuple(discs), largest)


def map_additional_disc(
    robot: Robot,
    tip: Tip,
    *,
    pattern: TouchPattern | None = None,
    numbers: tuple[int, int] = (36, 12),
    radius: float,
    region: Region | None = None,
    grid: int = 73,
) -> DiscMap:
    """Accuracy with one additional disc over the place of its centre.

    Args:
        robot: the robot with its cell.
        tip: the tip whose variance counts.
        pattern: how the discs are touched.
        numbers: of touches on the discs of the cell, and on the additional one.
        radius: of the additional disc, m.
        region: where its centre may be.
        grid: points along x and along y.
    """
    pattern, region, cell = pattern or TouchPattern(), region or Region(), robot.cell
    most = reach(robot)[1]
    x, y = (at + np.linspace(-most, most, grid) for at in (cell.nominal.x0, cell.nominal.y0))
    places = np.stack(np.meshgrid(x, y), axis=-1)
    fixed = np.column_stack([cell.centers, cell.radii])
    before, as_many = (_information(robot, fixed, pattern, count) for count in (numbers[0], sum(numbers)))
    layouts = np.concatenate(
        [np.broadcast_to(fixed, (grid * grid, *fixed.shape)), np.full((grid * grid, 1, 3), radius)], axis=1
    )
    layouts[:, -1, :2] = places.reshape(-1, 2)
    # discs of the cell may be closer together than the search would place them
    possible = overlap(robot, layouts) <= overlap(robot, fixed[None])[0] + 1e-12
    possible &= (region.holds(places) & within_reach_of(robot, places)).ravel()
    largest = np.full(grid * grid, np.nan)
    if possible.any():
        beside = np.broadcast_to(fixed, (int(possible.sum()), *fixed.shape))
        new = even_touches(robot, layouts[possible, -1], beside, pattern)
        added = new.of_number(np.full(len(new.share), numbers[1]))
        values = largest_std(with_declared(robot, before + added), tip)
        largest[possible] = np.where(new.share >= LEAST_SHARE, values, np.nan)
    without = float(largest_std(with_declared(robot, as_many[None]), tip)[0])
    return DiscMap(x, y, largest.reshape(grid, grid), without, radius, numbers)


def _information(robot: Robot, discs: Floats, pattern: TouchPattern, number: int) -> Floats:
    """Information of a number of touches evenly distributed on the discs of a cell, (12 + c, 12 + c)."""
    others = np.stack([np.delete(discs, i, axis=0) for i in range(len(discs))])
    even = even_touches(robot, discs, others, pattern, disc_stds(robot.cell))
    return np.asarray(even.of_number(number * even.share / even.share.sum()).sum(axis=0))
