"""Optimal design of a calibration for one cell, the design question of section 5.1.

`optimal_design` gives the smallest set of touches that reaches an accuracy of the tip and checks itself, and the
accuracy by the number of touches.

**Declared uncertainties.** However many touches are made, an error that is an alias of parameters stays as large as it
was declared: with one error of all radii, say, g_ee is never known better. Other errors, such as those of the places of
the discs, could be reduced, but only by very many touches. So the standard deviation of the tip soon hardly depends on
the number of touches, and what is left with the largest number that a design considers is the limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.planning.candidate_touches import (
    FEWEST_TOUCHES,
    MOST_HELD_OUT,
    MOST_LEVERAGE,
    MOST_TOUCHES,
    PER_DISC,
    PRELOAD,
    TOUCHES_PER_DISC,
    CandidateTouches,
    candidate_plan,
    checked,
    choose,
    held_out_ratio,
    largest_variance,
    prepare_candidates,
    without_each,
)
from scara_kinetostatic.planning.prediction import MANY, Prediction, RobotModel, Statement, predict, tip_in_use, tip_std
from scara_kinetostatic.simulation.plan import Plan

_LEVELS = (10.0, 25.0, 40.0)
"""Usual force levels, N."""
_USUAL = 36
"""Number of touches by whose uncertainties the parameters are weighted in the criterion."""
_NUMBERS = (16, 20, 24, 30, _USUAL, 48, 2 * _USUAL, MANY)
"""Numbers of touches for which the accuracy is worked out."""
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
    """

    accuracy: float | None = None
    levels: tuple[float, ...] = _LEVELS
    postures: tuple[int, ...] = (1, -1)
    per_disc: int = PER_DISC
    load: float = _LEVELS[-1]
    under_load: bool = False


class Curve(NamedTuple):
    """Largest standard deviation of the tip by the number of touches, (k,), m.

    Attributes:
        touches: their number.
        chosen: the best set found.
        evenly_distributed: touches evenly distributed.
    """

    touches: Indices
    chosen: Floats
    evenly_distributed: Floats


@dataclass(frozen=True)
class Design:
    """The result.

    Attributes:
        robot: the robot with its cell.
        requirements: of the design.
        tip: the free tip over the workspace and that under load, as of `tip_in_use`.
        accuracy: largest standard deviation of the tip that counts as required, m.
        plan: the touches to make, in their order: the smallest set found that reaches the accuracy and keeps it after
            the loss of any one touch, without a leverage that is too large, and with touches on every disc.
        prediction: for them.
        without_each: largest standard deviation of the tip without each of them, (n,), m.
        held_out: force error on touches that a fit has not seen, in that of the fit.
        curve: accuracy by the number of touches.
        least_possible: largest standard deviation of the tip that very many touches leave, m; 0 where the cell
            declares no uncertainties.
    """

    robot: RobotModel
    requirements: Requirements
    tip: Floats
    accuracy: float
    plan: Plan
    prediction: Prediction
    without_each: Floats
    held_out: float
    curve: Curve
    least_possible: float

    @property
    def tip_std(self) -> float:
        """Largest standard deviation of the tip of which the accuracy is required, with the recommended set, m."""
        return float(tip_std(required(self.tip, self.requirements), self.prediction).max())

    @property
    def contributions(self) -> dict[str, float]:
        """What noise and each kind of declared uncertainty contribute to the tip at its worst place, m."""
        return self.prediction.contributions(required(self.tip, self.requirements))

    @cached_property
    def statement(self) -> Statement:
        """What a calibration with the recommended touches is expected to state."""
        return Statement.of(self.robot, self.plan)

    @cached_property
    def many(self) -> tuple[int, Statement]:
        """As `Statement.of_many`."""
        every = candidate_plan(self.robot, self.requirements.levels, self.requirements.postures)
        return Statement.of_many(self.robot, every, int(self.curve.touches[-1]))


def required(tip: Floats, requirements: Requirements) -> Floats:
    """The tip of which the accuracy is required, of all loads of `tip_in_use`."""
    return tip[:, 1:] if requirements.under_load else tip[:, :1]


def optimal_design(
    robot: RobotModel, requirements: Requirements | None = None, report: Progress | None = None
) -> Design:
    """The optimal design for a cell.

    Args:
        robot: the robot with its cell and noise.
        requirements: by default those of `Requirements`.
        report: receives the progress.

    Raises:
        CellError: a disc is out of reach.
        UnsupportedDataError: the accuracy is out of reach, or the touches do not determine the tip.
    """
    q, report = requirements or Requirements(), report or (lambda *_: None)
    of_all = tip_in_use(robot, q.load)
    tip = required(of_all, q)
    report('candidate touches', 0.0)
    every = candidate_plan(robot, q.levels, q.postures, q.per_disc)
    very_many = predict(robot, every, MOST_TOUCHES)
    reached = float(tip_std(tip, very_many).max())
    if not np.isfinite(reached):
        remedy = 'add a second disc: touches of one disc do not determine the rotation of the robot about its centre'
        if len(robot.cell.discs) > 1:
            remedy = 'choose more force levels, the load among them, or move the discs apart'
        raise UnsupportedDataError('the candidate touches do not determine the tip, however many are made', remedy)
    lowest = 0.0 if robot.declared is None else reached
    tolerance = robot.cell.tolerance
    accuracy = q.accuracy or (tolerance / 2 if tolerance else max(1e-5, _ABOVE_LIMIT * lowest))
    candidates = prepare_candidates(robot, every, tip)
    if accuracy < lowest:
        raise _out_of_reach(robot, lowest, accuracy, very_many.contributions(tip))
    judged = prepare_candidates(robot, every, tip, mean=True)
    judged = judged.counting(np.arange(len(robot.model.names)), _SHARE_OF_PARAMETERS, _USUAL)
    report('accuracy by the number of touches', 0.0)
    numbers = [n for n in _NUMBERS if n <= len(every)]
    chosen = [largest_variance(candidates, choose(judged, n)) for n in numbers]
    even = [tip_std(tip, predict(robot, every, n)).max() for n in numbers]
    curve = Curve(np.array(numbers), np.sqrt(chosen), np.array(even))
    too_few = curve.touches[curve.chosen > accuracy].max(initial=FEWEST_TOUCHES)
    plan = _smallest_set(robot, tip, accuracy, judged, int(too_few), very_many.rank, report)
    return Design(
        robot=robot,
        requirements=q,
        tip=of_all,
        accuracy=accuracy,
        plan=plan,
        prediction=predict(robot, plan),
        without_each=without_each(robot, plan, tip),
        held_out=held_out_ratio(robot, plan),
        curve=curve,
        least_possible=lowest,
    )


def _out_of_reach(
    robot: RobotModel, lowest: float, accuracy: float, parts: Mapping[str, float]
) -> UnsupportedDataError:
    """That what the cell declares does not allow the accuracy, and what limits it."""
    kind, part = max(parts.items(), key=lambda item: item[1])
    enough = float(f'{_ABOVE_LIMIT * lowest:.2g}')
    half = ' (half of tolerance.tip: k = 2)' if robot.cell.tolerance == 2 * accuracy else ''
    return UnsupportedDataError(
        f'an accuracy of {quantity(accuracy, "m")}{half} is out of reach: {MOST_TOUCHES} even touches leave '
        f'{quantity(lowest, "m")}, {kind} alone {quantity(part, "m")} of it as the cell declares it',
        f'ask for {quantity(enough, "m")} (--accuracy {np.format_float_positional(enough)}), or reduce '
        'that uncertainty: more touches do not; without that of a plate under all objects the accuracy is that on the '
        'plate',
    )


def _smallest_set(
    robot: RobotModel,
    tip: Floats,
    accuracy: float,
    candidates: CandidateTouches,
    too_few: int,
    rank: int,
    report: Progress,
) -> Plan:
    """The smallest set found that checks itself and keeps the accuracy.

    Raises:
        UnsupportedDataError: the accuracy is out of reach.
    """
    best, most, number = None, min(MOST_TOUCHES, len(candidates.plan)), too_few + 1
    while number <= (most if best is None else len(best) - 1):
        report(f'sets of {number} touches', 0.5)
        chosen = checked(candidates, choose(candidates, number, TOUCHES_PER_DISC))
        plan = _mixed(candidates.plan.select(np.array(chosen)))
        prediction, is_smaller = predict(robot, plan), best is None or len(plan) < len(best)
        checks = prediction.rank >= rank and prediction.leverage.max() <= MOST_LEVERAGE
        if is_smaller and checks and held_out_ratio(robot, plan) <= MOST_HELD_OUT:
            best = plan if without_each(robot, plan, tip).max() <= accuracy else best
        number += max(1, number // 40)
    if best is not None:
        return best
    raise UnsupportedDataError(
        f'an accuracy of {accuracy:.3g} m is out of reach: no set of {most} of the {len(candidates.plan)} candidate '
        f'touches reaches it',
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
