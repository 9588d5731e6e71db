"""Where discs should stand: one to three of them placed anew, or one more beside those that are there.

The search is differential evolution over centres (polar about the base) and radii, seeded, so that the same cell
gives the same discs. Where the whole reach counts, a layout may be turned about the base without any change; the
first disc is then put on the y axis.

Source: Storn and Price, J. Global Optimization 11 (1997) 341.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.studies.design.disc_layout import (
    LEAST_SHARE,
    Touching,
    clash,
    largest_std,
    spread_over,
    within_reach_of,
)
from scara_kinetostatic.studies.design.prediction import Robot
from scara_kinetostatic.studies.design.workspace import Region, Tip, reach

Floats = NDArray[np.float64]

FORBIDDEN = 1.0
"""What stands for the accuracy of a layout that cannot be, m; plus how far it is from one that can."""
GENERATIONS, CROWD = 120, 48
STEP = 1e-3
"""The places found are rounded to this, m."""


class Layout(NamedTuple):
    """Discs and what they give.

    Attributes:
        discs: placed.
        largest: largest standard deviation of the tip for the number of touches asked for, spread evenly, m.
    """

    discs: tuple[Disc, ...]
    largest: float


class Map(NamedTuple):
    """What one more disc would do, by its place.

    Attributes:
        x: of the grid's columns, (k,), m.
        y: of its rows, (k,), m.
        largest: largest standard deviation of the tip, (k, k), m; NaN where no disc can stand.
        without: the same for as many touches on the discs that are there, m.
        radius: of the disc, m.
        touches: number that the discs that are there get, and number that the new one gets.
    """

    x: Floats
    y: Floats
    largest: Floats
    without: float
    radius: float
    touches: tuple[int, int]


def judge(robot: Robot, layouts: Floats, tip: Tip, touching: Touching, number: int, region: Region) -> Floats:
    """Largest standard deviation of the tip for layouts (b, d, 3), (b,), m; above `FORBIDDEN` where one cannot be."""
    b, d, _ = layouts.shape
    others = np.stack([np.delete(layouts, i, axis=1) for i in range(d)], axis=1).reshape(b * d, d - 1, 3)
    spread = spread_over(robot, layouts.reshape(b * d, 3), others, touching)
    share = spread.share.reshape(b, d)
    weight = share / np.maximum(share.sum(axis=1, keepdims=True), 1e-9)
    information = number * np.einsum('bd,bdij->bij', weight, spread.information.reshape(b, d, 12, 12))
    wrong = clash(robot, layouts) + np.maximum(LEAST_SHARE - share, 0).sum(axis=1)
    wrong += (~region.holds(layouts[..., :2])).sum(axis=1)
    return np.where(wrong > 0, FORBIDDEN + wrong, np.minimum(largest_std(information, tip), FORBIDDEN))


def place_discs(
    robot: Robot,
    count: int,
    radii: tuple[float, float],
    tip: Tip,
    *,
    touching: Touching | None = None,
    number: int = 36,
    region: Region | None = None,
    seed: int = 0,
    generations: int = GENERATIONS,
    tell: Callable[[float], None] | None = None,
) -> Layout | None:
    """The best places and radii for discs.

    Args:
        robot: the robot; the discs of its cell do not count.
        count: of discs.
        radii: least and largest, m.
        tip: at the places that count.
        touching: how the discs are touched.
        number: of touches, spread evenly.
        region: where the centres may be.
        seed: of the search.
        generations: of the search.
        tell: is told the part done.

    Returns:
        The layout, or None if none was found that can be.
    """
    touching, whole = touching or Touching(), region is None or region == Region()
    least, most = reach(robot)
    bounds = [(least, most), (0.0, 2 * np.pi), radii] * count
    if whole:
        bounds[1] = (np.pi / 2, np.pi / 2 + 1e-9)
    base, done = np.array([robot.cell.nominal.x0, robot.cell.nominal.y0]), [0]

    def layouts(x: Floats) -> Floats:
        polar = x.T.reshape(-1, count, 3)
        shift = polar[..., :1] * np.stack([np.cos(polar[..., 1]), np.sin(polar[..., 1])], axis=-1)
        return np.concatenate([shift + base, polar[..., 2:]], axis=-1)

    def objective(x: Floats) -> Floats:
        done[0] += 1
        if tell:
            tell(min(1.0, done[0] / (generations + 1)))
        return judge(robot, layouts(x), tip, touching, number, region or Region())

    found = differential_evolution(
        objective, bounds, maxiter=generations, popsize=max(5, CROWD // (3 * count)), seed=seed, polish=False,
        tol=1e-4, updating='deferred', vectorized=True, init='sobol',
    )  # fmt: skip
    if found.fun >= FORBIDDEN:
        return None
    best = np.round(layouts(found.x[:, None]) / STEP) * STEP + 0.0  # no -0
    largest = float(judge(robot, best, tip, touching, number, region or Region())[0])
    order = best[0][np.argsort(-best[0][:, 2])]
    return Layout(tuple(Disc(f'disc_{i}', *row.tolist()) for i, row in enumerate(order, 1)), largest)


def map_of_one_more(
    robot: Robot,
    tip: Tip,
    *,
    touching: Touching | None = None,
    numbers: tuple[int, int] = (36, 12),
    radius: float,
    region: Region | None = None,
    grid: int = 73,
) -> Map:
    """Where one more disc would help most.

    Args:
        robot: the robot with its cell.
        tip: at the places that count.
        touching: how the discs are touched.
        numbers: of touches on the discs that are there, and on the new one.
        radius: of the new one, m.
        region: where its centre may be.
        grid: points along x and along y.
    """
    touching, region, cell = touching or Touching(), region or Region(), robot.cell
    most = reach(robot)[1]
    x, y = (at + np.linspace(-most, most, grid) for at in (cell.nominal.x0, cell.nominal.y0))
    places = np.stack(np.meshgrid(x, y), axis=-1)
    fixed = np.column_stack([cell.centers, cell.radii])
    before = _spread_of(robot, fixed, touching)
    layouts = np.concatenate(
        [np.broadcast_to(fixed, (grid * grid, *fixed.shape)), np.full((grid * grid, 1, 3), radius)], axis=1
    )
    layouts[:, -1, :2] = places.reshape(-1, 2)
    # discs that are there may stand closer than a search would put them
    possible = clash(robot, layouts) <= clash(robot, fixed[None])[0] + 1e-12
    possible &= (region.holds(places) & within_reach_of(robot, places)).ravel()
    largest = np.full(grid * grid, np.nan)
    if possible.any():
        beside = np.broadcast_to(fixed, (int(possible.sum()), *fixed.shape))
        new = spread_over(robot, layouts[possible, -1], beside, touching)
        judged = largest_std(numbers[0] * before + numbers[1] * new.information, tip)
        largest[possible] = np.where(new.share >= LEAST_SHARE, judged, np.nan)
    without = float(largest_std(sum(numbers) * before[None], tip)[0])
    return Map(x, y, largest.reshape(grid, grid), without, radius, numbers)


def _spread_of(robot: Robot, discs: Floats, touching: Touching) -> Floats:
    """Mean information of even touches on the discs of a cell, (12, 12)."""
    others = np.stack([np.delete(discs, i, axis=0) for i in range(len(discs))])
    spread = spread_over(robot, discs, others, touching)
    return np.asarray(np.tensordot(spread.share / spread.share.sum(), spread.information, axes=1))
