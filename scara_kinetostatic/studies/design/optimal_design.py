"""Optimal design of a calibration for one cell, the design question of section 5.1.

`optimal_design` gives the smallest set of touches that reaches an accuracy of the tip and checks itself, with the lower
bound of their number and checks, the dependence of the accuracy on number, discs, force levels and postures, and the
best places for discs.

**Declared uncertainties.** However many touches are made, an error that is an alias of parameters stays as large as it
was declared: with one error of all radii, say, g_ee is never known better. Other errors, such as those of the places of
the discs, could be reduced, but only by very many touches. So the standard deviation of the tip soon hardly depends on
the number of touches, and what is left with the largest number that a design considers is the limit.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Plate
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import (
    MOST_HELD_OUT,
    MOST_LEVERAGE,
    PER_DISC,
    CandidateTouches,
    candidate_plan,
    held_out_ratio,
    prepare_candidates,
)
from scara_kinetostatic.studies.design.layouts import DiscMap, Layout, TouchPattern, map_additional_disc, place_discs
from scara_kinetostatic.studies.design.prediction import (
    Prediction,
    Region,
    Robot,
    Tip,
    TipStd,
    Workspace,
    free_tip,
    loaded_tip,
    make_workspace,
    predict,
    tip_std,
)
from scara_kinetostatic.studies.design.search import (
    FEWEST_TOUCHES,
    MOST_TOUCHES,
    FoundSet,
    LowerBound,
    SetCheck,
    check_set,
    find_lower_bound,
    smallest_set,
    without_each,
)
from scara_kinetostatic.studies.design.sensitivity import Curve, Row, Tips, row_of_discs, study_factors, study_number

_EVERYWHERE = Region()


USUAL_ACCURACY = 1e-5
"""Largest standard deviation of the tip where none is required, m."""


class AccuracySource(str, Enum):
    """Where the accuracy comes from that a design has to reach."""

    REQUIRED = 'required'
    TOLERANCE = 'tolerance'
    USUAL = 'usual'
    ATTAINABLE = 'attainable'


@dataclass(frozen=True)
class Requirements:
    """What the design has to reach, and what it may choose from.

    Attributes:
        accuracy: largest standard deviation of the tip over the workspace, m.
        accuracy_source: where that comes from.
        levels: force levels to choose from, N.
        postures: elbow postures to choose from, +1 and -1.
        per_disc: points around a disc to choose from.
        load: force under which the loaded tip is predicted, N.
        under_load: whether the accuracy is required of the loaded tip.
        region: the part of the base frame that counts, and where discs may be placed.
        number: of touches in comparisons.
        radii: smallest and largest radius of a disc that is placed, m; None: as those of the cell.
        most_discs: largest number of discs in new layouts; 0 for no layouts.
        seed: of all random numbers.
    """

    accuracy: float = USUAL_ACCURACY
    accuracy_source: AccuracySource = AccuracySource.REQUIRED
    levels: tuple[float, ...] = (10.0, 25.0, 40.0)
    postures: tuple[int, ...] = (1, -1)
    per_disc: int = PER_DISC
    load: float = 40.0
    under_load: bool = False
    region: Region = _EVERYWHERE
    number: int = 36
    radii: tuple[float, float] | None = None
    most_discs: int = 3
    seed: int = 0


class DesignedSet(NamedTuple):
    """The smallest set of touches found that reaches the required accuracy and checks itself.

    It keeps the accuracy after the loss of any one touch, no leverage is too large, and every disc is touched.

    Attributes:
        plan: the touches, in the order in which to make them.
        row: their prediction.
        check: checks of the set.
        tried: largest standard deviation of the tip after the worst loss of the best smaller sets, by number of
            touches, m; infinite where a leverage is too large.
        least: lower bound of the number of touches.
        value: largest standard deviation of the tip after the worst loss, m.
    """

    plan: Plan
    row: Row
    check: SetCheck
    tried: dict[int, float]
    least: int
    value: float


class DiscUse(NamedTuple):
    """How the recommended set uses a disc of the cell.

    Attributes:
        name: of the disc.
        touches: number of touches on it.
        candidates: number of touches on it that could be chosen.
    """

    name: str
    touches: int
    candidates: int


class PlacedDiscs(NamedTuple):
    """A new layout of discs.

    Attributes:
        layout: the discs.
        row: prediction for evenly distributed touches on them.
    """

    layout: Layout
    row: Row | None


@dataclass(frozen=True)
class Design:
    """The result.

    Attributes:
        robot: the robot with its cell; with all discs on one plate, in the frame of that plate.
        requirements: of the design.
        workspace: where the tip is evaluated.
        recommended: the touches to make.
        curve: accuracy by the number of touches.
        tables: predictions by what is varied: ``levels``, ``postures``, ``discs``, ``radius``.
        placed: new layouts of one disc, two, ….
        additional_disc: accuracy with one additional disc.
        tip: of which the accuracy is required, over the workspace.
        plate: in whose frame the tip is, because it carries all discs; None for the base frame.
        discs: how the recommended set uses the discs of the cell.
        least_possible: largest standard deviation of the tip that very many touches leave (`limit`), m; 0 where
            the cell declares no uncertainties.
        in_base_frame: that of the recommended set in the base frame, m; None where no plate stands between.
    """

    robot: Robot
    requirements: Requirements
    workspace: Workspace
    recommended: DesignedSet
    curve: Curve
    tables: dict[str, list[Row]]
    placed: tuple[PlacedDiscs, ...]
    additional_disc: DiscMap
    tip: Tip
    plate: Plate | None = None
    discs: tuple[DiscUse, ...] = ()
    least_possible: float = 0.0
    in_base_frame: float | None = None

    @property
    def tip_std(self) -> TipStd:
        """Standard deviation of the tip of which the accuracy is required, with the recommended set."""
        row = self.recommended.row
        return row.loaded if self.requirements.under_load else row.free


_ABOVE_LIMIT = 1.1
"""Accuracy over the limit where none is required and the usual one is out of reach; more touches could gain a tenth."""


def required_tip(robot: Robot, requirements: Requirements) -> Tip:
    """The tip of which the accuracy is required, over the whole workspace."""
    workspace = make_workspace(robot, requirements.region)
    return loaded_tip(robot, workspace, requirements.load) if requirements.under_load else free_tip(robot, workspace)


def limit(robot: Robot, requirements: Requirements, tip: Tip) -> tuple[float, Prediction | None]:
    """Largest standard deviation of the tip that very many touches leave, m, and the prediction for it.

    Zero, and no prediction, where the cell declares no uncertainties.
    """
    if robot.declared is None:
        return 0.0, None
    plan = candidate_plan(robot, requirements.levels, requirements.postures, requirements.per_disc)
    prediction = predict(robot, plan, MOST_TOUCHES)
    return tip_std(tip, prediction).largest, prediction


def with_usual_accuracy(robot: Robot, requirements: Requirements) -> Requirements:
    """The requirements with the accuracy that counts where none is required.

    It is half the tolerance of the cell (k = 2) if there is one; else `USUAL_ACCURACY`, or somewhat more than
    the declared uncertainties leave where that is out of reach.

    Args:
        robot: the robot.
        requirements: without an accuracy.
    """
    tolerance = robot.cell.tolerance
    if tolerance is not None:
        return replace(requirements, accuracy=tolerance / 2, accuracy_source=AccuracySource.TOLERANCE)
    robot = robot.on_plate() if robot.common_plate else robot
    lowest, _ = limit(robot, requirements, required_tip(robot, requirements))
    attainable = _ABOVE_LIMIT * lowest
    if not np.isfinite(attainable) or attainable <= USUAL_ACCURACY:
        return replace(requirements, accuracy=USUAL_ACCURACY, accuracy_source=AccuracySource.USUAL)
    digits = 10 ** (np.floor(np.log10(attainable)) - 1)
    rounded = float(f'{np.ceil(attainable / digits) * digits:.2g}')
    return replace(requirements, accuracy=rounded, accuracy_source=AccuracySource.ATTAINABLE)


def check_attainable(robot: Robot, requirements: Requirements, tip: Tip, bound: LowerBound) -> float:
    """The limit, m.

    Raises:
        UnsupportedDataError: the accuracy is out of reach for any touches, by what the cell declares.
    """
    lowest, prediction = limit(robot, requirements, tip)
    if prediction is not None and bound.variance(MOST_TOUCHES) > requirements.accuracy**2:
        kind, part = max(contributions(prediction, tip).items(), key=lambda item: item[1])
        enough = float(f'{_ABOVE_LIMIT * lowest:.2g}')
        half = requirements.accuracy_source is AccuracySource.TOLERANCE
        why = ' (half of tolerance.tip: k = 2)' if half else ''
        raise UnsupportedDataError(
            f'an accuracy of {quantity(requirements.accuracy, "m")}{why} is out of reach: {MOST_TOUCHES} touches leave '
            f'{quantity(lowest, "m")}, {kind} alone {quantity(part, "m")} of it as the cell declares it',
            f'ask for {quantity(enough, "m")} (--accuracy {np.format_float_positional(enough)}), or reduce what limits '
            'it: that is where more touches help least',
        )
    return lowest


def contributions(prediction: Prediction, tip: Tip) -> dict[str, float]:
    """What noise and each kind of declared uncertainty contribute to the tip at its worst place, m, by their names.

    Their squares add up to the square of the whole. The places of all discs are one kind, and so on.
    """
    place = np.einsum('gdik,kl,gdil->gd', tip.derivative, prediction.covariance, tip.derivative, optimize=True)
    worst = tip.derivative[np.unravel_index(int(np.argmax(place)), place.shape)]
    found: defaultdict[str, float] = defaultdict(float)
    for source, covariance in prediction.by_source:
        found[KINDS.get(source.label.split('[')[0], source.label)] += float(
            np.einsum('ik,kl,il->', worst, covariance, worst)
        )
    found['noise'] = max(0.0, float(place.max()) - sum(found.values()))
    return {kind: float(np.sqrt(variance)) for kind, variance in found.items()}


KINDS = {
    'object_position': 'the places of the discs',
    'object_radius': 'the radii of the discs',
    'plate_position': 'the places of the plates',
    'plate_angle': 'the rotation of the plates',
    'radius': 'the error common to all radii',
    'force_gain': 'the gain of the force sensor',
    'force_rotation': 'the rotation of the force sensor',
    'nominal': 'the nominal values',
}
"""Kinds of declared uncertainties, in words."""


Progress = Callable[[str, float], None]
"""Receives what is being done, and the share of all that is done, 0 to 1."""


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
    recommended = _recommended(task, candidates, bound, report)
    report('accuracy by the number of touches', 0.6)
    curve = study_number(robot, task.tip, candidates, bound, requirements.seed)
    report('force levels, postures, discs', 0.7)
    tables = study_factors(robot, tips, requirements.levels, requirements.postures, requirements.number)
    placed = tuple(_placed(task, report))
    report('additional disc', 0.95)
    chosen, every = (
        np.bincount(plan.disc, minlength=len(robot.cell.discs)).tolist() for plan in (recommended.plan, candidates.plan)
    )
    return Design(
        robot=robot,
        requirements=requirements,
        workspace=workspace,
        recommended=recommended,
        curve=curve,
        tables=tables,
        placed=placed,
        additional_disc=_additional_disc(robot, requirements),
        tip=task.tip,
        plate=in_base.common_plate,
        discs=tuple(DiscUse(disc.name, *used) for disc, *used in zip(robot.cell.discs, chosen, every, strict=True)),
        least_possible=lowest,
        in_base_frame=None if robot is in_base else tip_std(task.tip, predict(in_base, recommended.plan)).largest,
    )


def _candidates(robot: Robot, requirements: Requirements) -> CandidateTouches:
    """The candidates with the tip on a coarse grid for the search: both limits of the reach and the middle."""
    if requirements.under_load:
        tip = loaded_tip(robot, make_workspace(robot, requirements.region, 3, 12), requirements.load, 4)
    else:
        tip = free_tip(robot, make_workspace(robot, requirements.region, 3))
    plan = candidate_plan(robot, requirements.levels, requirements.postures, requirements.per_disc)
    return prepare_candidates(robot, plan, tip)


def _recommended(task: _Task, candidates: CandidateTouches, bound: LowerBound, report: Progress) -> DesignedSet:
    """The smallest set found that checks itself and keeps the accuracy on the full workspace, with its checks."""
    robot, requirements, tip = task.robot, task.requirements, task.tip
    every = predict(robot, candidates.plan)
    _check_determined(tip_std(tip, every).largest, robot, requirements)
    target, least, evaluated = requirements.accuracy, 0, dict[int, float]()
    while True:
        found = smallest_set(
            candidates, bound, target, least=least, seed=requirements.seed,
            report=lambda number: report(f'sets of {number} touches', 0.1),
        )  # fmt: skip
        evaluated = {**found.tried, **evaluated}  # values on the full workspace replace those of the search
        chosen = _mixed_order(found, candidates)
        plan = candidates.plan.select(np.array(chosen))
        reached = _after_a_loss(robot, plan, tip, every.rank)
        if reached <= requirements.accuracy:
            break
        # the full workspace has more places than the search; a set may have a lower rank than all candidates
        evaluated[len(chosen)] = min(reached, evaluated.get(len(chosen), np.inf))
        if np.isfinite(reached):
            target, least = min(0.999, 0.999 * requirements.accuracy / reached) * target, len(chosen)
        else:
            least = len(chosen) + 1
    return DesignedSet(
        plan=plan,
        row=task.tips.row('recommended set', robot, plan),
        check=check_set(robot, candidates, chosen, plan, tip, requirements.seed),
        tried={number: value for number, value in evaluated.items() if number < len(plan)},
        least=max(FEWEST_TOUCHES, bound.number(requirements.accuracy)) + 1,
        value=reached,
    )


def _after_a_loss(robot: Robot, plan: Plan, tip: Tip, rank: int) -> float:
    """Largest standard deviation of the tip over the full workspace after the worst loss, m.

    Infinite where the rank is too low, and of a set that does not check itself.
    """
    prediction = predict(robot, plan)
    too_low = prediction.rank < rank or prediction.leverage.max() > MOST_LEVERAGE
    if too_low or held_out_ratio(robot, plan) > MOST_HELD_OUT:
        return float('inf')
    return float(without_each(robot, plan, tip).max())


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
    golden_ratio = 0.6180339887498949  # steps of a low-discrepancy order
    return around[np.argsort(np.arange(len(around)) * golden_ratio % 1.0, kind='stable')].tolist()


def _placed(task: _Task, report: Progress, searches: int = 2) -> list[PlacedDiscs]:
    """New layouts of one disc, two, …, the best of some searches; a number without a feasible layout is left out."""
    (robot, q, tips), found = task, []
    tip = free_tip(robot, make_workspace(robot, q.region, 3, 24))
    pattern = TouchPattern(q.levels, q.postures)
    for number in range(1, q.most_discs + 1):
        report(f'places for {number} {"disc" if number == 1 else "discs"}', 0.75 + 0.2 * (number - 1) / q.most_discs)
        layouts = [
            place_discs(
                robot, number, _radius_limits(q, robot), tip, pattern=pattern, number=q.number, region=q.region,
                seed=q.seed + k,
            )
            for k in range(searches)
        ]  # fmt: skip
        if feasible := [layout for layout in layouts if layout]:
            layout = min(feasible, key=lambda layout: layout.largest)
            row = row_of_discs(robot, tips, f'{number} placed', layout.discs, q.levels, q.postures, q.number)
            found.append(PlacedDiscs(layout, row))
    return found


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
