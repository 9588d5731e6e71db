"""The accuracy that touches can reach where the cell declares uncertainties.

However many touches are made, an error that is an alias of parameters stays as large as it was declared: with one error
of all radii, say, g_ee is never known better. Other errors, such as those of the places of the discs, could be reduced,
but only by very many touches. So the standard deviation of the tip soon hardly depends on the number of touches, and
what is left with the largest number that a design considers is the limit.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.studies.design.candidates import candidate_plan
from scara_kinetostatic.studies.design.lower_bound import MOST_TOUCHES, LowerBound
from scara_kinetostatic.studies.design.prediction import Prediction, Robot, predict
from scara_kinetostatic.studies.design.result import USUAL_ACCURACY, AccuracySource, Requirements
from scara_kinetostatic.studies.design.workspace import Tip, free_tip, loaded_tip, make_workspace, tip_std

_ABOVE_LIMIT = 1.1
"""Accuracy over the limit where none is required and the usual one is out of reach; more touches could gain a tenth."""
_COVERAGE = 2.0
"""Coverage factor of a tolerance."""


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

    It is the tolerance of the cell in standard deviations if there is one; else `USUAL_ACCURACY`, or somewhat more than
    the declared uncertainties leave where that is out of reach.

    Args:
        robot: the robot.
        requirements: without an accuracy.
    """
    tolerance = robot.cell.tolerance
    if tolerance is not None:
        return replace(requirements, accuracy=tolerance / _COVERAGE, accuracy_source=AccuracySource.TOLERANCE)
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
