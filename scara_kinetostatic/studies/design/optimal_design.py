"""The design question of section 5.1: how many touches, on which discs, where, how hard, in which posture.

`design` answers it for one cell: the smallest set of touches for an accuracy of the tip and what proves it,
what the accuracy depends on, and where discs should stand.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.studies.design.candidates import Pool, candidate_plan, make_pool
from scara_kinetostatic.studies.design.disc_layout import Touching
from scara_kinetostatic.studies.design.disc_placement import Layout, Map, map_of_one_more, place_discs
from scara_kinetostatic.studies.design.lower_bound import Bound, find_bound
from scara_kinetostatic.studies.design.prediction import Robot, predict
from scara_kinetostatic.studies.design.result import Choice, Design, Placed, Question
from scara_kinetostatic.studies.design.selection import Selection, check, smallest_set
from scara_kinetostatic.studies.design.sensitivity import (
    Row,
    Tips,
    row_of_discs,
    study_discs,
    study_levels,
    study_number,
    study_postures,
)
from scara_kinetostatic.studies.design.workspace import (
    free_tip,
    loaded_tip,
    make_workspace,
    tip_std,
)

Floats = NDArray[np.float64]
Tell = Callable[[str, float], None]

GOLDEN = 0.6180339887498949
SHARPER = 0.999
QUICK = 60
"""Effort spent on the smallest set of a layout."""
SEEDS = 2
"""Searches for a layout; the best counts."""


def design(robot: Robot, question: Question | None = None, tell: Tell | None = None) -> Design:
    """Answer the design question for a cell.

    Args:
        robot: the robot with its cell and noise.
        question: what is asked.
        tell: is told what is being done, and the part of all that is done.

    Raises:
        CellError: a disc is out of reach.
        UnsupportedDataError: the accuracy is.
    """
    question, tell = question or Question(), tell or (lambda what, part: None)
    workspace = make_workspace(robot, question.region)
    tips = Tips(free_tip(robot, workspace), loaded_tip(robot, workspace, question.load))
    tell('what touches tell', 0.0)
    pool = _pool(robot, question)
    bound = find_bound(pool)
    smallest, spare = _choose_both(robot, question, pool, bound, tips, tell)
    tell('accuracy by the number of touches', 0.6)
    found = {**smallest.tried, len(smallest.plan): smallest.value}
    known = [(number, value) for number, value in found.items() if np.isfinite(value)]
    asked = tips.loaded if question.under_load else tips.free
    curve = study_number(robot, asked, pool, bound, known, question.seed)
    tell('force levels, postures, discs', 0.7)
    tables = _tables(robot, question, tips)
    placed = tuple(_placed(robot, question, tips, tell))
    tell('one more disc', 0.95)
    return Design(robot, question, workspace, smallest, spare, curve, tables, placed, _map(robot, question))


def _pool(robot: Robot, question: Question) -> Pool:
    """The candidates, judged at the rims of the workspace and between: coarse, for the search."""
    if question.under_load:
        tip = loaded_tip(robot, make_workspace(robot, question.region, 3, 12), question.load, 4)
    else:
        tip = free_tip(robot, make_workspace(robot, question.region, 3))
    return make_pool(robot, candidate_plan(robot, question.levels, question.postures, question.per_disc), tip)


def _choose_both(
    robot: Robot, question: Question, pool: Pool, bound: Bound, tips: Tips, tell: Tell
) -> tuple[Choice, Choice]:
    first = _choose(robot, question, pool, bound, tips, 0, 0, lambda n: tell(f'sets of {n} touches', 0.05))
    least = len(first.plan) + 1
    second = _choose(
        robot, question, pool, bound, tips, 1, least, lambda n: tell(f'sets of {n} with one to spare', 0.3)
    )
    return first, second


def _choose(
    robot: Robot,
    question: Question,
    pool: Pool,
    bound: Bound,
    tips: Tips,
    spare: int,
    least: int,
    tell: Callable[[int], None] | None = None,
    effort: int | None = None,
) -> Choice:
    """The smallest set, checked on the full workspace and by singular values."""
    asked, tip = question.accuracy, tips.loaded if question.under_load else tips.free
    every = predict(robot, pool.plan)
    _check_determined(tip_std(tip, every).largest, robot, question)
    rank, tried = every.rank, dict[int, float]()
    while True:
        found = smallest_set(pool, bound, asked, spare=spare, least=least, seed=question.seed, effort=effort, tell=tell)
        # what was checked in full counts before what the search says
        tried = {**found.tried, **tried}
        chosen = ordered(found, pool)
        plan = pool.plan.select(np.array(chosen))
        prediction = predict(robot, plan)
        reached = tip_std(tip, prediction).largest if prediction.rank >= rank else np.inf
        if reached <= question.accuracy:
            break
        # the workspace is a little wider than that of the search, and a set may not show all that the touches can
        tried = {**tried, len(chosen): min(reached, tried.get(len(chosen), np.inf))}
        if np.isfinite(reached):
            asked, least = min(SHARPER, SHARPER * question.accuracy / reached) * asked, len(chosen)
        else:
            least = len(chosen) + 1
    tried = {number: value for number, value in tried.items() if number < len(plan)}
    row = tips.row('smallest set, with one to spare' if spare else 'smallest set', robot, plan)
    value = found.value if spare else reached
    proven = bound.number(question.accuracy) + spare
    return Choice(plan, row, check(robot, pool, chosen, plan, tip, question.seed), tried, proven, value)


def _check_determined(largest: float, robot: Robot, question: Question) -> None:
    """Whether all touches together determine the tip."""
    if np.isfinite(largest):
        return
    remedy = 'touch a second disc: about the centre of one, the whole robot may be turned'
    if len(robot.cell.discs) > 1:
        remedy = 'choose more force levels, the load among them' if question.under_load else 'move the discs apart'
    raise UnsupportedDataError('the touches to choose from do not determine the tip, however many', remedy)


def ordered(found: Selection, pool: Pool) -> list[int]:
    """The touches in an order that jumps around the cell, so that a drift in time looks like no place or level."""
    plan = pool.plan
    chosen = np.array(found.chosen)
    around = chosen[np.lexsort((plan.posture[chosen], plan.angle[chosen], plan.disc[chosen]))]
    return around[np.argsort(np.arange(len(around)) * GOLDEN % 1.0, kind='stable')].tolist()


def _tables(robot: Robot, question: Question, tips: Tips) -> dict[str, list[Row]]:
    levels, postures, number = question.levels, question.postures, question.number
    discs, radius = study_discs(robot, tips, levels, postures, number)
    return {
        'discs': discs,
        'radius': radius,
        'levels': study_levels(robot, tips, levels, postures, number),
        'postures': study_postures(robot, tips, levels, number),
    }


def _placed(robot: Robot, question: Question, tips: Tips, tell: Tell) -> list[Placed]:
    """Layouts of one disc, two, …."""
    found = []
    tip = free_tip(robot, make_workspace(robot, question.region, 3, 24))
    touching = Touching(question.levels, question.postures)
    for count in range(1, question.most_discs + 1):
        tell(f'places for {count} {"disc" if count == 1 else "discs"}', 0.75 + 0.2 * (count - 1) / question.most_discs)
        layouts = [
            place_discs(
                robot, count, radii_of(question, robot), tip, touching=touching, number=question.number,
                region=question.region, seed=question.seed + k,
            )
            for k in range(SEEDS)
        ]  # fmt: skip
        possible = [layout for layout in layouts if layout]
        if possible:
            found.append(_placed_one(robot, question, tips, min(possible, key=lambda layout: layout.largest)))
    return found


def _placed_one(robot: Robot, question: Question, tips: Tips, layout: Layout) -> Placed:
    names = f'{len(layout.discs)} placed'
    row = row_of_discs(robot, tips, names, layout.discs, question.levels, question.postures, question.number)
    if row is None or row.free.largest > 10 * question.accuracy:
        return Placed(layout, row, None)
    other = replace(robot, cell=replace(robot.cell, discs=layout.discs))
    pool = _pool(other, question)
    try:
        choice = _choose(other, question, pool, find_bound(pool), tips, 0, 0, effort=QUICK)
    except UnsupportedDataError:
        return Placed(layout, row, None)
    return Placed(layout, row, len(choice.plan))


def radii_of(question: Question, robot: Robot) -> tuple[float, float]:
    """Least and largest radius of a disc that is placed, m."""
    radii = robot.cell.radii
    return question.radii or (float(radii.min()), float(radii.max()))


def _map(robot: Robot, question: Question) -> Map:
    least, most = radii_of(question, robot)
    return map_of_one_more(
        robot,
        free_tip(robot, make_workspace(robot, question.region, 3, 24)),
        touching=Touching(question.levels, question.postures),
        numbers=(question.number, max(1, question.number // max(1, len(robot.cell.discs)))),
        radius=float(np.median(robot.cell.radii)) if question.radii is None else (least + most) / 2,
        region=question.region,
    )
