"""Optimal design of a calibration for one cell, the design question of section 5.1.

`optimal_design` gives the smallest set of touches that reaches an accuracy of the tip and checks itself, with the lower
bound of their number; the dependence of the accuracy on number, force levels, postures and discs; and the best place
for one more disc. Rows of the tables are predictions for the same number of touches, evenly distributed over all
candidates, so that they differ in one factor only.

**Declared uncertainties.** However many touches are made, an error that is an alias of parameters stays as large as it
was declared: with one error of all radii, say, g_ee is never known better. Other errors, such as those of the places of
the discs, could be reduced, but only by very many touches. So the standard deviation of the tip soon hardly depends on
the number of touches, and what is left with the largest number that a design considers is the limit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import CellError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Disc, Plate
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import quantity
from scara_kinetostatic.planning.candidates import (
    FEWEST_TOUCHES,
    MOST_HELD_OUT,
    MOST_LEVERAGE,
    MOST_TOUCHES,
    PER_DISC,
    PRELOAD,
    TOUCHES_PER_DISC,
    CandidateTouches,
    LowerBound,
    candidate_plan,
    checked,
    choose,
    find_lower_bound,
    held_out_ratio,
    largest_variance,
    prepare_candidates,
    without_each,
)
from scara_kinetostatic.planning.prediction import Prediction, Robot, TipStd, predict, tip_in_use, tip_std
from scara_kinetostatic.simulation.plan import BASE_MARGIN, CLEARANCE, Plan, reach

_ABOVE_LIMIT = 1.1
"""Accuracy over the limit that can be reached with a reasonable number of touches: more could gain a tenth."""
_SHARE_OF_PARAMETERS = 0.1
"""Of the parameters in the criterion. With none, sets for the free tip are of one force level, which leaves p_ee and
g_ee confounded; from 0.03 to 0.3 the tip's standard deviation hardly depends on it.
"""
Progress = Callable[[str, float], None]
"""Receives what is being done, and the share of all that is done, 0 to 1."""


@dataclass(frozen=True)
class Requirements:
    """What the design has to reach, and what it may choose from.

    Attributes:
        accuracy: largest standard deviation of the tip over the workspace, m; None: half the tolerance of the cell,
            which holds for k = 2; without one 10 µm, or a tenth more than the declared uncertainties leave.
        levels: force levels to choose from, N.
        postures: elbow postures to choose from, +1 and -1.
        per_disc: points around a disc to choose from.
        load: force under which the loaded tip is predicted, N.
        under_load: whether the accuracy is required of the loaded tip.
        number: of touches in comparisons.
    """

    accuracy: float | None = None
    levels: tuple[float, ...] = (10.0, 25.0, 40.0)
    postures: tuple[int, ...] = (1, -1)
    per_disc: int = PER_DISC
    load: float = 40.0
    under_load: bool = False
    number: int = 36


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


class Curve(NamedTuple):
    """Largest standard deviation of the tip by the number of touches, (k,), m.

    Attributes:
        touches: their number.
        chosen: the best set found.
        evenly_distributed: touches evenly distributed.
        lower_bound: for any set.
    """

    touches: Indices
    chosen: Floats
    evenly_distributed: Floats
    lower_bound: Floats


class DiscMap(NamedTuple):
    """Accuracy with one additional disc, by the place of its centre.

    Attributes:
        x: of the grid's columns, (k,), m.
        y: of its rows, (k,), m.
        largest: largest standard deviation of the tip, (k, k), m; NaN where the disc cannot be.
        without: that for the same number of touches on the discs of the cell, m.
        radius: of the disc, m.
        touches: their number, evenly distributed over all discs.
    """

    x: Floats
    y: Floats
    largest: Floats
    without: float
    radius: float
    touches: int

    @property
    def best(self) -> tuple[float, float, float] | None:
        """The best place, x and y in m, and the tip's largest standard deviation with it, m; None without any."""
        if np.isnan(self.largest).all():
            return None
        row, column = np.unravel_index(int(np.nanargmin(self.largest)), self.largest.shape)
        return float(self.x[column]), float(self.y[row]), float(self.largest[row, column])


@dataclass(frozen=True)
class Task:
    """What is designed.

    Attributes:
        robot: the robot with its cell; with all discs on one plate, in the frame of that plate.
        requirements: of the design.
        free: the free tip over the workspace, as of `tip_in_use`.
        loaded: the tip under load, likewise.
    """

    robot: Robot
    requirements: Requirements
    free: Floats
    loaded: Floats

    @property
    def tip(self) -> Floats:
        """The tip of which the accuracy is required."""
        return self.loaded if self.requirements.under_load else self.free

    def predicted(self, label: str, robot: Robot, plan: Plan, number: int | None = None) -> Row:
        """The prediction for a plan, or for a number of touches evenly distributed over it."""
        prediction = predict(robot, plan, number)
        return Row(label, prediction, tip_std(self.free, prediction), tip_std(self.loaded, prediction))


@dataclass(frozen=True)
class Design(Task):
    """The result.

    Attributes:
        accuracy: largest standard deviation of the tip that counts as required, m.
        plan: the touches to make, in their order: the smallest set found that reaches the accuracy and keeps it after
            the loss of any one touch, without a leverage that is too large, and with touches on every disc.
        row: their prediction.
        without_each: largest standard deviation of the tip without each of them, (n,), m.
        held_out: force error on touches that a fit has not seen, in that of the fit.
        tried: largest standard deviation of the tip after the worst loss of the best smaller sets, by number of
            touches, m; infinite where a set does not check itself.
        least: lower bound of the number of touches.
        curve: accuracy by the number of touches.
        tables: predictions by what is varied: ``levels``, ``postures``, ``discs``.
        additional_disc: accuracy with one additional disc.
        plate: in whose frame the tip is, because it carries all discs; None for the base frame.
        least_possible: largest standard deviation of the tip that very many touches leave, m; 0 where the cell
            declares no uncertainties.
        in_base_frame: that of the recommended set in the base frame, m; None where no plate stands between.
    """

    accuracy: float
    plan: Plan
    row: Row
    without_each: Floats
    held_out: float
    tried: dict[int, float]
    least: int
    curve: Curve
    tables: dict[str, list[Row]]
    additional_disc: DiscMap
    plate: Plate | None
    least_possible: float
    in_base_frame: float | None

    @property
    def tip_std(self) -> TipStd:
        """Standard deviation of the tip of which the accuracy is required, with the recommended set."""
        return self.row.loaded if self.requirements.under_load else self.row.free

    @property
    def contributions(self) -> dict[str, float]:
        """What noise and each kind of declared uncertainty contribute to the tip at its worst place, m."""
        return self.row.prediction.contributions(self.tip)


def optimal_design(robot: Robot, requirements: Requirements | None = None, report: Progress | None = None) -> Design:
    """The optimal design for a cell.

    Args:
        robot: the robot with its cell and noise.
        requirements: by default those of `Requirements`.
        report: receives the progress.

    Raises:
        CellError: a disc is out of reach.
        UnsupportedDataError: the accuracy is out of reach, or the touches do not determine the tip.
    """
    q, report, in_base, plate = requirements or Requirements(), report or (lambda *_: None), robot, robot.common_plate
    robot = robot.on_plate() if plate else robot
    tip = tip_in_use(robot, q.load)
    task = Task(robot, q, tip[:, :1], tip[:, 1:])
    report('candidate touches', 0.0)
    every = candidate_plan(robot, q.levels, q.postures, q.per_disc)
    very_many = predict(robot, every, MOST_TOUCHES)
    lowest = 0.0 if robot.declared is None else tip_std(task.tip, very_many).largest
    if not np.isfinite(tip_std(task.tip, very_many).largest):
        remedy = 'add a second disc: touches of one disc do not determine the rotation of the robot about its centre'
        if len(robot.cell.discs) > 1:
            remedy = 'choose more force levels, the load among them, or move the discs apart'
        raise UnsupportedDataError('the candidate touches do not determine the tip, however many are made', remedy)
    tolerance = robot.cell.tolerance
    accuracy = q.accuracy or (tolerance / 2 if tolerance else max(1e-5, _ABOVE_LIMIT * lowest))
    candidates = prepare_candidates(robot, every, task.tip)
    bound = find_lower_bound(candidates, accuracy)
    if robot.declared and bound.variance(MOST_TOUCHES) > accuracy**2:
        raise _out_of_reach(task, accuracy, very_many)
    weighted = candidates.weighted((bound.places + 1 / len(bound.places)) / 2)
    judged = weighted.counting(np.arange(candidates.values), _SHARE_OF_PARAMETERS, q.number)
    plan, tried = _smallest_set(task, accuracy, judged, bound, very_many.rank, report)
    report('accuracy by the number of touches', 0.6)
    numbers = [n for n in (16, 20, 24, 30, 36, 48, 72, 108) if n <= len(every)]
    chosen = [largest_variance(candidates, choose(judged, n)) for n in numbers]
    even = [tip_std(task.tip, predict(robot, every, n)).largest for n in numbers]
    least = [bound.variance(n) for n in numbers]
    curve = Curve(np.array(numbers), np.sqrt(chosen), np.array(even), np.sqrt(least))
    report('force levels, postures, discs', 0.8)
    return Design(
        **vars(task),
        accuracy=accuracy,
        plan=plan,
        row=task.predicted('recommended set', robot, plan),
        without_each=without_each(robot, plan, task.tip),
        held_out=held_out_ratio(robot, plan),
        tried=tried,
        least=max(FEWEST_TOUCHES, bound.number(accuracy)) + 1,
        curve=curve,
        tables=_tables(task),
        additional_disc=_additional_disc(task),
        plate=plate,
        least_possible=lowest,
        in_base_frame=tip_std(task.tip, predict(in_base, plan)).largest if plate else None,
    )


def _out_of_reach(task: Task, accuracy: float, very_many: Prediction) -> UnsupportedDataError:
    """That what the cell declares does not allow the accuracy, and what limits it."""
    lowest = tip_std(task.tip, very_many).largest
    kind, part = max(very_many.contributions(task.tip).items(), key=lambda item: item[1])
    enough = float(f'{_ABOVE_LIMIT * lowest:.2g}')
    half = ' (half of tolerance.tip: k = 2)' if task.robot.cell.tolerance == 2 * accuracy else ''
    return UnsupportedDataError(
        f'an accuracy of {quantity(accuracy, "m")}{half} is out of reach: {MOST_TOUCHES} touches leave '
        f'{quantity(lowest, "m")}, {kind} alone {quantity(part, "m")} of it as the cell declares it',
        f'ask for {quantity(enough, "m")} (--accuracy {np.format_float_positional(enough)}), or reduce '
        'that uncertainty: more touches do not',
    )


def _smallest_set(
    task: Task, accuracy: float, candidates: CandidateTouches, bound: LowerBound, rank: int, report: Progress
) -> tuple[Plan, dict[int, float]]:
    """The smallest set found that checks itself and keeps the accuracy, and what smaller ones reach.

    Raises:
        UnsupportedDataError: the accuracy is out of reach.
    """
    best, tried = None, dict[int, float]()
    needed, most = bound.number(accuracy), min(MOST_TOUCHES, len(candidates.plan))
    number = max(FEWEST_TOUCHES, needed) + 1
    while number <= (most if best is None else len(best) - 1):
        report(f'sets of {number} touches', 0.1)
        chosen = checked(candidates, choose(candidates, number, TOUCHES_PER_DISC))
        plan = _mixed(candidates.plan.select(np.array(chosen)))
        prediction, reached = predict(task.robot, plan), np.inf  # of a set that does not check itself
        checks = prediction.rank >= rank and prediction.leverage.max() <= MOST_LEVERAGE
        if checks and held_out_ratio(task.robot, plan) <= MOST_HELD_OUT:
            reached = float(without_each(task.robot, plan, task.tip).max())
        if reached > accuracy:
            tried[len(plan)] = min(reached, tried.get(len(plan), np.inf))
        elif best is None or len(plan) < len(best):
            best = plan
        number += max(1, number // 40)
    if best is not None:
        return best, {fewer: value for fewer, value in tried.items() if fewer < len(best)}
    least = f', at least {needed} are needed' if needed else ''
    raise UnsupportedDataError(
        f'an accuracy of {accuracy:.3g} m is out of reach: no set of {most} of the {len(candidates.plan)} candidate '
        f'touches reaches it{least}',
        'ask for a larger standard deviation, repeat touches, or move the discs',
    )


def _mixed(plan: Plan) -> Plan:
    """The touches in an order that mixes places and force levels, so that drift in time is correlated with neither;
    every other one of each disc and posture has a preload of 30 %, without which friction and hysteresis do not show.
    """
    around = np.lexsort((plan.angle, plan.posture, plan.disc))
    side = 2 * plan.disc[around] + (plan.posture[around] > 0)
    number = np.arange(len(plan)) - np.searchsorted(side, side)  # from 0 in each disc and posture
    plan = replace(plan.select(around), preload=np.where(number % 2 == 0, PRELOAD, 0.0))
    around = np.lexsort((plan.posture, plan.angle, plan.disc))
    golden_ratio = 0.6180339887498949  # steps of a low-discrepancy order
    return plan.select(around[np.argsort(np.arange(len(plan)) * golden_ratio % 1.0, kind='stable')])


def _tables(task: Task) -> dict[str, list[Row]]:
    """Predictions for every subset of the force levels, each posture and both, all discs and all but one."""
    robot, q, discs = task.robot, task.requirements, task.robot.cell.discs
    subsets = [some for count in range(1, len(q.levels) + 1) for some in combinations(q.levels, count)]
    groups = [some for some in (*combinations(discs, len(discs) - 1), discs) if some]
    rows: list[tuple[str, str, tuple[Disc | Outline, ...], Sequence[float], Sequence[int]]] = [
        *(('levels', ', '.join(f'{f:g}' for f in some) + ' N', discs, some, q.postures) for some in subsets),
        *(('postures', name, discs, q.levels, p) for name, p in (('left', (1,)), ('right', (-1,)), ('both', (1, -1)))),
        *(('discs', ', '.join(disc.name for disc in some), some, q.levels, q.postures) for some in groups),
    ]
    tables = {name: list[Row]() for name in ('levels', 'postures', 'discs')}
    for name, label, some, levels, postures in rows:
        other = replace(robot, cell=replace(robot.cell, discs=some))
        with suppress(CellError, UnsupportedDataError):  # a disc that cannot be touched so
            plan = candidate_plan(other, levels, postures, q.per_disc)
            tables[name].append(task.predicted(label, other, plan, q.number))
    return tables


def _additional_disc(task: Task, grid: int = 25, per_disc: int = 12) -> DiscMap:
    """Accuracy with one additional disc of medium radius, as well known as the first one and on its plate."""
    robot, q, cell = task.robot, task.requirements, task.robot.cell
    number, radius = q.number + max(1, q.number // len(cell.discs)), float(np.median(cell.radii))

    def largest(discs: tuple[Disc | Outline, ...]) -> float:
        other = replace(robot, cell=replace(cell, discs=discs))
        plan = candidate_plan(other, q.levels, q.postures, per_disc)
        return prepare_candidates(other, plan, task.tip).evenly_distributed(number)

    base, (least, most) = np.array([cell.nominal.x0, cell.nominal.y0]), reach(cell.nominal)
    x, y = (at + np.linspace(-most, most, grid) for at in base)
    values = np.full((grid, grid), np.nan)
    for row, column in np.ndindex(grid, grid):
        center = np.array([x[column], y[row]])
        from_base = float(np.hypot(*(center - base)))
        apart = np.hypot(*(cell.centers - center).T) - cell.radii - radius
        can_be = max(least, radius + BASE_MARGIN) <= from_base <= most and apart.min() >= 2 * CLEARANCE
        if can_be and robot.cell.region.holds(center):
            like = cell.discs[0]
            disc = Disc('additional', center[0], center[1], radius, like.center_std, like.radius_std, like.plate)
            with suppress(CellError, UnsupportedDataError):
                values[row, column] = largest((*cell.discs, disc))
    return DiscMap(x, y, values, largest(cell.discs), radius, number)
