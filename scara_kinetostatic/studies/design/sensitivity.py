"""What the accuracy depends on: the number of touches, the discs, the force levels, the postures.

Every row is a prediction for the same number of touches, spread evenly over all that can be touched, so that rows
differ in one thing only; the curve over the number of touches compares that with the sets chosen, with
random ones and with what cannot be beaten.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import CellError, UnsupportedDataError
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import Pool, candidate_plan
from scara_kinetostatic.studies.design.disc_layout import clash
from scara_kinetostatic.studies.design.lower_bound import Bound
from scara_kinetostatic.studies.design.prediction import Prediction, Robot, predict
from scara_kinetostatic.studies.design.selection import best_set, largest_of_sets, random_sets
from scara_kinetostatic.studies.design.workspace import Tip, TipStd, tip_std

Floats = NDArray[np.float64]

SCALINGS = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
NUMBERS = (16, 20, 24, 30, 36, 48, 72, 108)
STARTS, LARGE = 2, 30
BAND = (0.05, 0.5, 0.95)
POSTURE_NAMES = {(1,): 'left', (-1,): 'right', (1, -1): 'both', (-1, 1): 'both'}


class Row(NamedTuple):
    """One prediction in a table.

    Attributes:
        label: what is special about it.
        prediction: of L̄.
        free: of the free tip.
        loaded: of the tip under load.
    """

    label: str
    prediction: Prediction
    free: TipStd
    loaded: TipStd


class Tips(NamedTuple):
    """The tip that is asked for in every row: free, and under the load."""

    free: Tip
    loaded: Tip

    def row(self, label: str, robot: Robot, plan: Plan, number: int | None = None) -> Row:
        """The prediction for a plan."""
        prediction = predict(robot, plan, number)
        return Row(label, prediction, tip_std(self.free, prediction), tip_std(self.loaded, prediction))


class Curve(NamedTuple):
    """Largest standard deviation of the tip by the number of touches, (k,) unless said otherwise, m.

    Attributes:
        number: of touches.
        chosen: the best set found.
        spread: touches spread evenly.
        random: quantiles `BAND` of random sets, (k, 3).
        bound: no set can be better.
    """

    number: NDArray[np.intp]
    chosen: Floats
    spread: Floats
    random: Floats
    bound: Floats


def study_levels(robot: Robot, tips: Tips, levels: Sequence[float], postures: Sequence[int], number: int) -> list[Row]:
    """Every choice of the force levels."""
    rows = []
    for count in range(1, len(levels) + 1):
        for some in combinations(levels, count):
            label = ', '.join(f'{level:g}' for level in some) + ' N'
            rows.append(tips.row(label, robot, candidate_plan(robot, some, postures), number))
    return rows


def study_postures(robot: Robot, tips: Tips, levels: Sequence[float], number: int) -> list[Row]:
    """Each posture alone, and both."""
    rows = []
    for postures in ((1,), (-1,), (1, -1)):
        try:
            plan = candidate_plan(robot, levels, postures)
        except (CellError, UnsupportedDataError):
            continue
        rows.append(tips.row(POSTURE_NAMES[postures], robot, plan, number))
    return rows


def study_discs(
    robot: Robot, tips: Tips, levels: Sequence[float], postures: Sequence[int], number: int
) -> tuple[list[Row], list[Row]]:
    """Every choice of the cell's discs (of more than four, the first few), and all of them smaller and larger."""
    discs = robot.cell.discs
    some = [chosen for count in range(1, len(discs) + 1) for chosen in combinations(discs, count)]
    if len(discs) > 4:
        some = [discs[:count] for count in range(1, len(discs) + 1)]
    number_rows = [
        row_of_discs(robot, tips, ', '.join(disc.name for disc in chosen), chosen, levels, postures, number)
        for chosen in some
    ]
    radius_rows = []
    for scaling in SCALINGS:
        scaled = tuple(disc._replace(radius=scaling * disc.radius) for disc in discs)
        layout = np.array([disc[1:] for disc in scaled])[None]
        if scaling <= 1 or clash(robot, layout)[0] <= 0:
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
    """The prediction with other discs in the cell; None if one cannot be touched."""
    other = replace(robot, cell=replace(robot.cell, discs=discs))
    try:
        return tips.row(label, other, candidate_plan(other, levels, postures), number)
    except (CellError, UnsupportedDataError):
        return None


def study_number(
    robot: Robot, tip: Tip, pool: Pool, bound: Bound, best: Sequence[tuple[int, float]], seed: int = 0
) -> Curve:
    """The accuracy by the number of touches.

    Args:
        robot: the robot.
        tip: whose largest standard deviation counts.
        pool: the candidates.
        bound: theirs.
        best: numbers for which the best set has been looked for already, and what it reached, m.
        seed: of random sets and starts.
    """
    reached = dict(best)
    for number in NUMBERS:
        if max(reached, default=0) < number <= len(pool.plan):
            reached[number] = best_set(pool, bound, number, seed=seed, starts=STARTS if number < LARGE else 1).value
    numbers = np.array(sorted(reached))
    one = tip_std(tip, predict(robot, pool.plan, 1)).largest
    random = [np.quantile(largest_of_sets(pool, random_sets(pool, int(n), seed=seed)), BAND) for n in numbers]
    return Curve(
        numbers,
        np.array([reached[int(number)] for number in numbers]),
        one / np.sqrt(numbers),
        np.array(random),
        np.sqrt(bound.least / numbers),
    )
