"""Optimal design of a calibration for one cell, the design question of section 5.1.

`optimal_design` gives the smallest set of touches that reaches an accuracy of the tip and checks itself, beside it the
smallest set at all, the lower bound of their number and checks, the dependence of the accuracy on number, discs, force
levels and postures, and the best places for discs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.attainable import check_attainable
from scara_kinetostatic.studies.design.candidates import CandidateTouches, candidate_plan, prepare_candidates
from scara_kinetostatic.studies.design.disc_layout import TouchPattern
from scara_kinetostatic.studies.design.disc_placement import DiscMap, Layout, map_additional_disc, place_discs
from scara_kinetostatic.studies.design.held_out import MOST_HELD_OUT, held_out_ratio
from scara_kinetostatic.studies.design.lower_bound import LowerBound, find_lower_bound
from scara_kinetostatic.studies.design.prediction import Robot, predict
from scara_kinetostatic.studies.design.result import Design, DesignedSet, DiscUse, PlacedDiscs, Requirements
from scara_kinetostatic.studies.design.selection import (
    FEWEST_TOUCHES,
    FoundSet,
    NumberProgress,
    check_set,
    smallest_set,
    without_each,
)
from scara_kinetostatic.studies.design.self_check import MOST_LEVERAGE
from scara_kinetostatic.studies.design.sensitivity import (
    Row,
    Tips,
    row_of_discs,
    study_discs,
    study_levels,
    study_number,
    study_postures,
)
from scara_kinetostatic.studies.design.workspace import Tip, free_tip, loaded_tip, make_workspace, tip_std

Progress = Callable[[str, float], None]
"""Receives what is being done, and the share of all that is done, 0 to 1."""

_GOLDEN_RATIO = 0.6180339887498949
"""Step of the low-discrepancy order of the touches."""
_TIGHTENING = 0.999
"""Factor by which the target of the search is lowered when a set misses the accuracy on the full workspace."""
_LAYOUT_EFFORT = 60
"""Effort for the smallest set of a new layout; see `smallest_set`."""
_LAYOUT_SEARCHES = 2
"""Searches for a layout with different seeds; the best result counts."""
_WITHIN_REACH = 10
"""For a new layout that misses the accuracy by more than this factor no smallest set is searched for."""


class _Task(NamedTuple):
    """What is designed: the robot with its cell, the requirements, and the tip over the full workspace."""

    robot: Robot
    requirements: Requirements
    tips: Tips

    @property
    def tip(self) -> Tip:
        """The tip of which the accuracy is required."""
        return self.tips.loaded if self.requirements.under_load else self.tips.free


def optimal_design(robot: Robot, requirements: Requirements | None = None, report: Progress | None = None) -> Design:
    """The optimal design for a cell.

    Args:
        robot: the robot with its cell and noise.
        requirements: by default those of `Requirements`.
        report: receives the progress.

    Raises:
        CellError: a disc is out of reach.
        UnsupportedDataError: the accuracy is out of reach.
    """
    requirements, report = requirements or Requirements(), report or (lambda what, part: None)
    in_base = robot
    if robot.common_plate:
        robot = robot.on_plate()
    workspace = make_workspace(robot, requirements.region)
    tips = Tips(free_tip(robot, workspace), loaded_tip(robot, workspace, requirements.load))
    task = _Task(robot, requirements, tips)
    report('candidate touches', 0.0)
    candidates = _candidates(robot, requirements)
    bound = find_lower_bound(candidates, requirements.accuracy)
    lowest = check_attainable(robot, requirements, task.tip, bound)
    smallest, recommended = _both_sets(task, candidates, bound, report)
    report('accuracy by the number of touches', 0.6)
    found = {**smallest.tried, len(smallest.plan): smallest.value}
    known = [(number, value) for number, value in found.items() if np.isfinite(value)]
    curve = study_number(robot, task.tip, candidates, bound, known, requirements.seed)
    report('force levels, postures, discs', 0.7)
    tables = _tables(task)
    placed = tuple(_placed(task, report))
    report('additional disc', 0.95)
    return Design(
        robot=robot,
        requirements=requirements,
        workspace=workspace,
        recommended=recommended,
        smallest=smallest,
        curve=curve,
        tables=tables,
        placed=placed,
        additional_disc=_additional_disc(robot, requirements),
        tip=task.tip,
        plate=in_base.common_plate,
        discs=_disc_use(robot, candidates, recommended.plan),
        least_possible=lowest,
        in_base_frame=None if robot is in_base else tip_std(task.tip, predict(in_base, recommended.plan)).largest,
    )


def _disc_use(robot: Robot, candidates: CandidateTouches, plan: Plan) -> tuple[DiscUse, ...]:
    chosen, every = (np.bincount(disc, minlength=len(robot.cell.discs)) for disc in (plan.disc, candidates.plan.disc))
    return tuple(DiscUse(disc.name, int(chosen[k]), int(every[k])) for k, disc in enumerate(robot.cell.discs))


def _candidates(robot: Robot, requirements: Requirements) -> CandidateTouches:
    """The candidates with the tip on a coarse grid for the search: both limits of the reach and the middle."""
    if requirements.under_load:
        tip = loaded_tip(robot, make_workspace(robot, requirements.region, 3, 12), requirements.load, 4)
    else:
        tip = free_tip(robot, make_workspace(robot, requirements.region, 3))
    plan = candidate_plan(robot, requirements.levels, requirements.postures, requirements.per_disc)
    return prepare_candidates(robot, plan, tip)


def _both_sets(
    task: _Task, candidates: CandidateTouches, bound: LowerBound, report: Progress
) -> tuple[DesignedSet, DesignedSet]:
    """The smallest set, and the smallest that checks itself."""
    first = _designed_set(task, candidates, bound, report=lambda n: report(f'sets of {n} touches', 0.05))
    second = _designed_set(
        task, candidates, bound, checked=True, least=len(first.plan) + 1,
        report=lambda n: report(f'sets of {n} touches that check themselves', 0.3),
    )  # fmt: skip
    return first, second


def _designed_set(
    task: _Task,
    candidates: CandidateTouches,
    bound: LowerBound,
    *,
    checked: bool = False,
    least: int = 0,
    effort: int | None = None,
    report: NumberProgress | None = None,
) -> DesignedSet:
    """The smallest set found that reaches the accuracy on the full workspace, with its checks."""
    robot, requirements, tip = task.robot, task.requirements, task.tip
    every = predict(robot, candidates.plan)
    _check_determined(tip_std(tip, every).largest, robot, requirements)
    target, evaluated = requirements.accuracy, dict[int, float]()
    while True:
        found = smallest_set(
            candidates, bound, target, checked=checked, least=least, seed=requirements.seed, effort=effort,
            report=report,
        )  # fmt: skip
        evaluated = {**found.tried, **evaluated}  # values on the full workspace replace those of the search
        chosen = _mixed_order(found, candidates)
        plan = candidates.plan.select(np.array(chosen))
        reached = _reached(robot, plan, tip, checked, every.rank)
        if reached <= requirements.accuracy:
            break
        # the full workspace has more places than the search; a set may have a lower rank than all candidates
        evaluated[len(chosen)] = min(reached, evaluated.get(len(chosen), np.inf))
        if np.isfinite(reached):
            target, least = min(_TIGHTENING, _TIGHTENING * requirements.accuracy / reached) * target, len(chosen)
        else:
            least = len(chosen) + 1
    return DesignedSet(
        plan=plan,
        row=task.tips.row('recommended set' if checked else 'smallest set', robot, plan),
        check=check_set(robot, candidates, chosen, plan, tip, requirements.seed),
        tried={number: value for number, value in evaluated.items() if number < len(plan)},
        least=max(FEWEST_TOUCHES, bound.number(requirements.accuracy)) + checked,
        value=reached,
    )


def _reached(robot: Robot, plan: Plan, tip: Tip, checked: bool, rank: int) -> float:
    """Largest standard deviation of the tip over the full workspace; with checks after the worst loss, m.

    Infinite where the rank is too low, and of a set that does not check itself.
    """
    prediction = predict(robot, plan)
    if prediction.rank < rank:
        return float('inf')
    if checked and (prediction.leverage.max() > MOST_LEVERAGE or held_out_ratio(robot, plan) > MOST_HELD_OUT):
        return float('inf')
    return float(without_each(robot, plan, tip).max()) if checked else tip_std(tip, prediction).largest


def _check_determined(largest: float, robot: Robot, requirements: Requirements) -> None:
    """Whether all candidates together determine the tip."""
    if np.isfinite(largest):
        return
    remedy = 'add a second disc: touches of one disc do not determine the rotation of the robot about its centre'
    if len(robot.cell.discs) > 1:
        remedy = 'choose more force levels, the load among them' if requirements.under_load else 'move the discs apart'
    raise UnsupportedDataError('the candidate touches do not determine the tip, however many are made', remedy)


def _mixed_order(found: FoundSet, candidates: CandidateTouches) -> list[int]:
    """The touches in an order that mixes places and force levels, so that drift in time is correlated with neither."""
    plan = candidates.plan
    chosen = np.array(found.chosen)
    around = chosen[np.lexsort((plan.posture[chosen], plan.angle[chosen], plan.disc[chosen]))]
    return around[np.argsort(np.arange(len(around)) * _GOLDEN_RATIO % 1.0, kind='stable')].tolist()


def _tables(task: _Task) -> dict[str, list[Row]]:
    """The tables of predictions, by what is varied."""
    robot, requirements, tips = task
    levels, postures, number = requirements.levels, requirements.postures, requirements.number
    discs, radius = study_discs(robot, tips, levels, postures, number)
    return {
        'discs': discs,
        'radius': radius,
        'levels': study_levels(robot, tips, levels, postures, number),
        'postures': study_postures(robot, tips, levels, number),
    }


def _placed(task: _Task, report: Progress) -> list[PlacedDiscs]:
    """New layouts of one disc, two, …; a number of discs without a feasible layout is left out."""
    robot, requirements, _ = task
    found = []
    tip = free_tip(robot, make_workspace(robot, requirements.region, 3, 24))
    pattern = TouchPattern(requirements.levels, requirements.postures)
    for count in range(1, requirements.most_discs + 1):
        part = 0.75 + 0.2 * (count - 1) / requirements.most_discs
        report(f'places for {count} {"disc" if count == 1 else "discs"}', part)
        layouts = [
            place_discs(
                robot, count, _radius_limits(requirements, robot), tip, pattern=pattern, number=requirements.number,
                region=requirements.region, seed=requirements.seed + k,
            )
            for k in range(_LAYOUT_SEARCHES)
        ]  # fmt: skip
        feasible = [layout for layout in layouts if layout]
        if feasible:
            found.append(_with_smallest_set(task, min(feasible, key=lambda layout: layout.largest)))
    return found


def _with_smallest_set(task: _Task, layout: Layout) -> PlacedDiscs:
    """A new layout with the prediction for it and the number of touches that it needs."""
    robot, requirements, tips = task
    label = f'{len(layout.discs)} placed'
    row = row_of_discs(
        robot, tips, label, layout.discs, requirements.levels, requirements.postures, requirements.number
    )
    if row is None or row.free.largest > _WITHIN_REACH * requirements.accuracy:
        return PlacedDiscs(layout, row, None)
    other = replace(robot, cell=replace(robot.cell, discs=layout.discs))
    candidates = _candidates(other, requirements)
    try:
        designed = _designed_set(
            task._replace(robot=other),
            candidates,
            find_lower_bound(candidates, requirements.accuracy),
            effort=_LAYOUT_EFFORT,
        )
    except UnsupportedDataError:
        return PlacedDiscs(layout, row, None)
    return PlacedDiscs(layout, row, len(designed.plan))


def _radius_limits(requirements: Requirements, robot: Robot) -> tuple[float, float]:
    """Smallest and largest radius of a disc that is placed, m."""
    radii = robot.cell.radii
    return requirements.radii or (float(radii.min()), float(radii.max()))


def _additional_disc(robot: Robot, requirements: Requirements) -> DiscMap:
    """Accuracy with one additional disc of medium radius, which gets as many touches as each disc of the cell has."""
    least, most = _radius_limits(requirements, robot)
    return map_additional_disc(
        robot,
        free_tip(robot, make_workspace(robot, requirements.region, 3, 24)),
        pattern=TouchPattern(requirements.levels, requirements.postures),
        numbers=(requirements.number, max(1, requirements.number // max(1, len(robot.cell.discs)))),
        radius=float(np.median(robot.cell.radii)) if requirements.radii is None else (least + most) / 2,
        region=requirements.region,
    )
