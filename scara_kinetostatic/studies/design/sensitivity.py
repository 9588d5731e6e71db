"""Dependence of the accuracy on the number of touches, the discs, the force levels and the postures.

Every row of a table is a prediction for the same number of touches, evenly distributed over all candidates, so that
rows differ in one factor only. Over the number of touches, evenly distributed touches are compared with the best sets
found, with random sets and with the lower bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import CellError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import CandidateTouches, candidate_plan
from scara_kinetostatic.studies.design.layouts import overlap
from scara_kinetostatic.studies.design.prediction import Prediction, Robot, Tip, TipStd, predict, tip_std
from scara_kinetostatic.studies.design.search import LowerBound, best_set, largest_of_sets, random_sets

BAND = (0.05, 0.5, 0.95)
"""Quantiles of random sets."""


class Row(NamedTuple):
    """One prediction in a table.

    Attributes:
        label: what is varied.
        prediction: of L̄.
        free: standard deviation of the free tip.
        loaded: that of the tip under load.
    """

    label: str
    prediction: Prediction
    free: TipStd
    loaded: TipStd


class Tips(NamedTuple):
    """The tip that is predicted in every row: free, and under the load."""

    free: Tip
    loaded: Tip

    def row(self, label: str, robot: Robot, plan: Plan, number: int | None = None) -> Row:
        """The prediction for a plan, or for a number of touches evenly distributed over it."""
        prediction = predict(robot, plan, number)
        return Row(label, prediction, tip_std(self.free, prediction), tip_std(self.loaded, prediction))


class Curve(NamedTuple):
    """Largest standard deviation of the tip by the number of touches, (k,) unless said otherwise, m.

    Attributes:
        number: of touches.
        chosen: the best set found.
        even: touches evenly distributed.
        random: quantiles `BAND` of random sets, (k, 3).
        bound: lower bound for any set.
    """

    number: NDArray[np.intp]
    chosen: Floats
    even: Floats
    random: Floats
    bound: Floats


def study_factors(
    robot: Robot, tips: Tips, levels: Sequence[float], postures: Sequence[int], number: int
) -> dict[str, list[Row]]:
    """The tables of predictions for a number of touches, by what is varied.

    ``levels``: every subset of the force levels; ``postures``: each alone, and both; ``discs``: subsets of the cell's
    discs (of more than four: the first one, two, …); ``radius``: all radii smaller or larger.
    """
    discs = robot.cell.discs
    some = [chosen for count in range(1, len(discs) + 1) for chosen in combinations(discs, count)]
    if len(discs) > 4:
        some = [discs[:count] for count in range(1, len(discs) + 1)]
    subsets = [some for count in range(1, len(levels) + 1) for some in combinations(levels, count)]
    varied: dict[str, list[tuple[str, tuple[Disc, ...], Sequence[float], Sequence[int]]]] = {
        'discs': [(', '.join(disc.name for disc in chosen), chosen, levels, postures) for chosen in some],
        'radius': [],
        'levels': [(', '.join(f'{level:g}' for level in some) + ' N', discs, some, postures) for some in subsets],
        'postures': [(name, discs, levels, p) for name, p in (('left', (1,)), ('right', (-1,)), ('both', (1, -1)))],
    }
    for factor in (0.25, 0.5, 0.75, 1.0, 1.25, 1.5):
        scaled = tuple(disc._replace(radius=factor * disc.radius) for disc in discs)
        layout = np.array([[disc.x, disc.y, disc.radius] for disc in scaled])[None]
        if factor <= 1 or overlap(robot, layout)[0] <= 0:
            varied['radius'].append((f'radii × {factor:g}', scaled, levels, postures))
    return {
        name: [row for factors in rows if (row := row_of_discs(robot, tips, *factors, number)) is not None]
        for name, rows in varied.items()
    }


def row_of_discs(
    robot: Robot,
    tips: Tips,
    label: str,
    discs: tuple[Disc, ...],
    levels: Sequence[float],
    postures: Sequence[int],
    number: int,
) -> Row | None:
    """Prediction with other discs in the cell; None if one of them cannot be touched."""
    other = replace(robot, cell=replace(robot.cell, discs=discs))
    try:
        return tips.row(label, other, candidate_plan(other, levels, postures), number)
    except (CellError, UnsupportedDataError):
        return None


def study_number(robot: Robot, tip: Tip, candidates: CandidateTouches, bound: LowerBound, seed: int = 0) -> Curve:
    """The accuracy by the number of touches.

    Args:
        robot: the robot.
        tip: whose largest standard deviation counts.
        candidates: the candidates.
        bound: lower bound for them.
        seed: of random sets and starts.
    """
    numbers = np.array([number for number in (16, 20, 24, 30, 36, 48, 72, 108) if number <= len(candidates.plan)])
    chosen = [
        best_set(candidates, bound, number, seed=seed, starts=2 if number < 30 else 1).value
        for number in numbers.tolist()
    ]
    random = [
        np.quantile(largest_of_sets(candidates, random_sets(candidates, number, seed=seed)), BAND)
        for number in numbers.tolist()
    ]
    if robot.declared is None:
        even = tip_std(tip, predict(robot, candidates.plan, 1)).largest / np.sqrt(numbers)
    else:
        even = np.array([tip_std(tip, predict(robot, candidates.plan, number)).largest for number in numbers.tolist()])
    variances = [bound.variance(number) for number in numbers.tolist()]
    return Curve(numbers, np.array(chosen), even, np.array(random), np.sqrt(variances))
