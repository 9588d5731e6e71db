"""Accuracy of many layouts of discs at once, each with touches evenly distributed over it.

A layout is a few discs, which need not be in the cell. Its touches are evenly distributed around every disc, in the
given postures and with the force levels in turn, wherever the arm reaches, no other disc is in the way and no joint's
axis is close to the line of force. The criterion is the largest standard deviation of the tip for a given number of
touches.

Where the cell declares its discs as uncertain, each disc has errors of its own, of its place and its radius, which only
its own touches show: they are eliminated disc by disc. Errors that all discs share, such as that of the tip's radius,
are eliminated from the sum. Here the discs of several plates count as independent of each other.

Placement of discs: a new layout of a few discs, or one additional disc in the cell.

Layouts are optimised by differential evolution over centres (polar about the base) and radii, seeded, so that the same
cell gives the same discs. Where the whole reach counts, turning a layout about the base changes nothing; the first disc
is then put on the y axis.

Source: Storn and Price, J. Global Optimization 11 (1997) 341.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.simulation.plan import BASE_MARGIN, CLEARANCE
from scara_kinetostatic.studies.design.candidates import LEAST_ARM, PRIOR, pack
from scara_kinetostatic.studies.design.prediction import Region, Robot, Tip, Where, exact_touches, reach

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
    points: int = 24


class EvenTouches(NamedTuple):
    """Information of touches evenly distributed over b discs.

    Attributes:
        information: mean over the touches of each disc that can be made, in `SCALES`, then the errors of the disc, then
            those common to all, (b, 12 + o + c, 12 + o + c).
        share: share of each disc's touches that can be made, (b,).
        own: number of errors of a disc, o.
    """

    information: Floats
    share: Floats
    own: int = 0

    def of_number(self, touches: Floats) -> Floats:
        """Information of a number of touches on each disc, (b,), its own errors eliminated, (b, 12 + c, 12 + c)."""
        total = np.asarray(touches)[:, None, None] * self.information
        return total if not self.own else _eliminate(total, np.arange(len(NAMES), len(NAMES) + self.own))


def _eliminate(information: Floats, which: NDArray[np.intp]) -> Floats:
    """Information (…, k, k) of what is left when unknowns whose prior has variance 1 are eliminated."""
    rest = np.setdiff1d(np.arange(information.shape[-1]), which)
    block = information[..., which[:, None], which] + np.eye(len(which))
    beside = information[..., rest[:, None], which]
    return np.asarray(
        information[..., rest[:, None], rest] - beside @ np.linalg.solve(block, np.swapaxes(beside, -1, -2))
    )


def with_declared(robot: Robot, information: Floats) -> Floats:
    """Information on L̄ alone, (…, 12, 12): common errors eliminated, what is known of nominal values added."""
    if robot.declared is None:
        return information
    prior, own = robot.declared.prior, np.arange(len(NAMES))
    information = _eliminate(information, np.arange(len(NAMES), information.shape[-1]))
    trusted = prior.rows(len(NAMES))[: len(prior.trusted), : len(NAMES)] * SCALES
    return np.asarray(information[..., own[:, None], own] + trusted.T @ trusted)


def disc_stds(cell: Cell) -> Floats:
    """Standard uncertainty of x, y and radius of each disc in the base frame, its plate included, (d, 3), m."""
    plates = {plate.name: plate for plate in cell.plates}
    rows = []
    for disc in cell.discs:
        x = y = disc.center_std**2
        if disc.plate:
            plate = plates[disc.plate]
            x += plate.center_std**2 + (plate.angle_std * (disc.y - plate.y)) ** 2
            y += plate.center_std**2 + (plate.angle_std * (disc.x - plate.x)) ** 2
        rows.append([np.sqrt(x), np.sqrt(y), disc.radius_std])
    return np.array(rows)


def typical_stds(cell: Cell) -> Floats:
    """Those of a disc that is not in the cell: as well known as the cell's discs in the median, (3,), m."""
    x, y, radius = np.median(disc_stds(cell), axis=0)
    place = float(np.hypot(x, y) / np.sqrt(2))
    return np.array([place, place, radius])


def even_touches(
    robot: Robot, discs: Floats, others: Floats, pattern: TouchPattern, stds: Floats | None = None
) -> EvenTouches:
    """Information of evenly distributed touches.

    Args:
        robot: the robot; the discs of its cell do not count.
        discs: x, y, radius, (b, 3), m.
        others: the other discs of each one's layout, (b, k, 3), m; NaN for none.
        pattern: how the discs are touched.
        stds: standard uncertainties of x, y and radius, (b, 3), m; None: those of a typical disc of the cell.
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
    where = Where(
        discs[disc, :2], discs[disc, 2], angle[touch], posture[touch], force[touch], np.zeros(len(disc), dtype=np.intp)
    )
    exact = exact_touches(robot, where, _of_any_disc(robot))
    good = (exact.arms >= LEAST_ARM).all(axis=1)
    jacobian = exact.point.whitened.jacobian[good]
    jacobian[:, :, : len(NAMES)] *= SCALES
    own = 0 if robot.declared is None else 3
    if own:
        stds = np.broadcast_to(typical_stds(robot.cell), (b, 3)) if stds is None else stds
        jacobian[:, :, len(NAMES) : len(NAMES) + own] *= stds[disc[good], None]
    rows = np.zeros((b, m, 2, jacobian.shape[2]))
    rows[disc[good], touch[good]] = jacobian
    flat = rows.reshape(b, -1, jacobian.shape[2])
    count = np.bincount(disc[good], minlength=b)
    information = np.swapaxes(flat, 1, 2) @ flat / np.maximum(count, 1)[:, None, None]
    return EvenTouches(information, count / m, own)


def _of_any_disc(robot: Robot) -> DeclaredErrors | None:
    """Errors of one disc, by 1 m each, and of what is common to all as declared."""
    if robot.declared is None:
        return None
    disc = Disc('any', 0.0, 0.0, 1.0, center_std=1.0, radius_std=1.0)
    return DeclaredErrors.of(replace(robot.cell, discs=(disc,), plates=()))


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


INFEASIBLE = 1.0
"""Value of the criterion for a layout that violates a constraint, m, to which the violation is added."""
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

    @property
    def best(self) -> tuple[float, float, float] | None:
        """The best place, x and y in m, and the tip's largest standard deviation with it, m; None without any."""
        if np.isnan(self.largest).all():
            return None
        row, column = np.unravel_index(int(np.nanargmin(self.largest)), self.largest.shape)
        return float(self.x[column]), float(self.y[row]), float(self.largest[row, column])


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
    generations: int = 120,
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
        objective, bounds, maxiter=generations, popsize=max(5, 48 // (3 * count)), seed=seed, polish=False,
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
