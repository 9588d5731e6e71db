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

_RADIUS_FACTORS = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
"""Factors on the radii of the cell's discs."""
_NUMBERS = (16, 20, 24, 30, 36, 48, 72, 108)
"""Numbers of touches in the curve, beside those that the search for the smallest set has evaluated."""
_STARTS, _LARGE = 2, 30
"""Starts of the search for the best set of a number; one only from `_LARGE` touches on."""
BAND = (0.05, 0.5, 0.95)
"""Quantiles of random sets."""
_POSTURES = {(1,): 'left', (-1,): 'right', (1, -1): 'both', (-1, 1): 'both'}


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


def study_levels(robot: Robot, tips: Tips, levels: Sequence[float], postures: Sequence[int], number: int) -> list[Row]:
    """Predictions for every subset of the force levels."""
    rows = []
    for count in range(1, len(levels) + 1):
        for some in combinations(levels, count):
            label = ', '.join(f'{level:g}' for level in some) + ' N'
            rows.append(tips.row(label, robot, candidate_plan(robot, some, postures), number))
    return rows


def study_postures(robot: Robot, tips: Tips, levels: Sequence[float], number: int) -> list[Row]:
    """Predictions for each posture alone, and for both."""
    rows = []
    for postures in ((1,), (-1,), (1, -1)):
        try:
            plan = candidate_plan(robot, levels, postures)
        except (CellError, UnsupportedDataError):
            continue
        rows.append(tips.row(_POSTURES[postures], robot, plan, number))
    return rows


def study_discs(
    robot: Robot, tips: Tips, levels: Sequence[float], postures: Sequence[int], number: int
) -> tuple[list[Row], list[Row]]:
    """Predictions for subsets of the cell's discs (of more than four: the first one, two, …), and for other radii."""
    discs = robot.cell.discs
    some = [chosen for count in range(1, len(discs) + 1) for chosen in combinations(discs, count)]
    if len(discs) > 4:
        some = [discs[:count] for count in range(1, len(discs) + 1)]
    number_rows = [
        row_of_discs(robot, tips, ', '.join(disc.name for disc in chosen), chosen, levels, postures, number)
        for chosen in some
    ]
    radius_rows = []
    for scaling in _RADIUS_FACTORS:
        scaled = tuple(disc._replace(radius=scaling * disc.radius) for disc in discs)
        layout = np.array([[disc.x, disc.y, disc.radius] for disc in scaled])[None]
        if scaling <= 1 or overlap(robot, layout)[0] <= 0:
            row = row_of_discs(robot, tips, f'radii × {scaling:g}', scaled, levels, postures, number)
            radius_rows.append(row)
    return [row for row in number_rows if row], [row for row in radius_rows if row]


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


def study_number(
    robot: Robot,
    tip: Tip,
    candidates: CandidateTouches,
    bound: LowerBound,
    best: Sequence[tuple[int, float]],
    seed: int = 0,
) -> Curve:
    """The accuracy by the number of touches.

    Args:
        robot: the robot.
        tip: whose largest standard deviation counts.
        candidates: the candidates.
        bound: lower bound for them.
        best: numbers of touches for which the best set is known already, with its largest standard deviation, m.
        seed: of random sets and starts.
    """
    reached = dict(best)
    for number in _NUMBERS:
        if max(reached, default=0) < number <= len(candidates.plan):
            reached[number] = best_set(
                candidates, bound, number, seed=seed, starts=_STARTS if number < _LARGE else 1
            ).value
    numbers = np.array(sorted(reached))
    random = [
        np.quantile(largest_of_sets(candidates, random_sets(candidates, int(n), seed=seed)), BAND) for n in numbers
    ]
    return Curve(
        numbers,
        np.array([reached[int(number)] for number in numbers]),
        _evenly_distributed(robot, tip, candidates.plan, numbers),
        np.array(random),
        np.sqrt([bound.variance(int(number)) for number in numbers]),
    )


def _evenly_distributed(robot: Robot, tip: Tip, plan: Plan, numbers: NDArray[np.intp]) -> Floats:
    """Largest standard deviation of the tip for numbers of touches evenly distributed over a plan, (k,), m."""
    if robot.declared is None:
        return np.asarray(tip_std(tip, predict(robot, plan, 1)).largest / np.sqrt(numbers))
    return np.array([tip_std(tip, predict(robot, plan, int(number))).largest for number in numbers])
