"""What is to be known of a contour: poses beyond the calibration, uncertainties that are not known, assumptions."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.compensation.predictions import Predictor
from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.model.kinematics import posture

NO_RADIUS = (
    'the cell description states no radius of the tip (tip: {radius: …}): the outline is that of the centre of the '
    'tip, not of the surface'
)
_LIGHTEST = 0.5
"""A force below this part of the lightest touch is beyond those of the calibration."""
_SOME = 0.05
"""So few points beyond the calibration are not worth a remark, as a part of all."""


def remarks_on(contour: Contour, arm: CalibratedArm) -> tuple[str, ...]:
    """The remarks, one sentence each; empty if there is nothing to be known."""
    assumed = Predictor(arm).assumptions
    found = (
        _force_beyond(contour, arm),
        _elbow_beyond(contour, arm),
        _unknown(contour),
        f'taken, as no recording says it: {assumed}' if assumed else '',
        *arm.reservations,
    )
    return tuple(filter(None, found))


def _force_beyond(contour: Contour, arm: CalibratedArm) -> str:
    size, used = np.hypot(*contour.force.T), arm.used
    beyond = float(np.mean((size < _LIGHTEST * used.lowest_force) | (size > 1.1 * used.highest_force)))
    if beyond <= _SOME:
        return ''
    return (
        f'{_percent(beyond)} of the points have a force outside of that of the calibration, '
        f'{used.lowest_force:.0f} to {used.highest_force:.0f} N: there the model is extrapolated'
    )


def _elbow_beyond(contour: Contour, arm: CalibratedArm) -> str:
    beyond = float(np.mean(~np.isin(posture(arm.model.parameters, contour.joints), arm.used.postures)))
    if not beyond:
        return ''
    return f'{_percent(beyond)} of the points have an elbow posture without a touch of the calibration'


def _unknown(contour: Contour) -> str:
    unknown = float(np.mean(np.isnan(contour.std_normal)))
    if not unknown:
        return ''
    return (
        f'{_percent(unknown)} of the points have no stated uncertainty: the touches of the calibration do not '
        'determine the place of the tip there'
    )


def _percent(part: float) -> str:
    return f'{100 * part:.0f} %' if part >= 0.01 else 'less than 1 %'
