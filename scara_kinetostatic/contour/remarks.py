"""What is to be known of a contour: poses beyond the calibration, uncertainties that are not known, assumptions."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.contour.result import Contour
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.kinematics import posture
from scara_kinetostatic.touches.signals import runs

NO_RADIUS = (
    'the cell description states no radius of the tip (tip: {radius: …}): the outline is that of the centre of the '
    'tip, not of the surface'
)
_LIGHTEST = 0.5
"""A force below this part of the lightest touch is beyond those of the calibration."""
FARTHEST_APART = 1e-3
"""Points that are farther apart, m, leave gaps that are worth a remark."""
_BACKWARD = 1e-3
"""A surface that goes backward by more, m, and by more than `_BACKWARD_PART` of the tip's radius, is none."""
_BACKWARD_PART = 0.2
_LAG = 1e-3
"""Over so much of the path, m, a motion backward is looked for: less is noise."""
_MOST_FRICTION = 1.0
"""A larger coefficient of friction is doubtful."""
_SOME = 0.05
"""So few points beyond the calibration are not worth a remark, as a part of all."""


def remarks_on(contour: Contour, arm: CalibratedArm) -> tuple[str, ...]:
    """The remarks, one sentence each; empty if there is nothing to be known."""
    assumed = Predictor(arm).assumptions
    found = (
        _force_beyond(contour, arm),
        _elbow_beyond(contour, arm),
        _unknown(contour),
        _far_apart(contour),
        _backward(contour),
        _inner_corners(contour),
        _friction(contour),
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


def _far_apart(contour: Contour) -> str:
    same = np.diff(contour.passes) == 0
    step = np.hypot(*np.diff(contour.surface, axis=0).T)[same]
    usual = float(np.median(step)) if len(step) else 0.0
    if usual <= FARTHEST_APART:
        return ''
    return (
        f'the points are {1e3 * usual:.1f} mm apart: what lies between is not seen, and edges are cut off; slide '
        'slower or record joint states at a higher rate'
    )


def _backward(contour: Contour) -> str:
    """That the tip is said to be larger than the radius of its path about the object allows."""
    worst = max((_motion_backward(contour, k) for k in range(int(contour.passes.max()) + 1)), default=0.0)
    if worst <= max(_BACKWARD, _BACKWARD_PART * contour.tip_radius):
        return ''
    return (
        f'the surface runs backward by {1e3 * worst:.1f} mm: the tip goes round the object in a narrower curve than a '
        f'tip of {1e3 * contour.tip_radius:.3g} mm can; check its radius'
    )


def _motion_backward(contour: Contour, number: int) -> float:
    """How far the surface of a pass runs against the motion of the tip's centre, in all, m."""
    here = np.flatnonzero(contour.passes == number)
    tip, surface = contour.tip[here], contour.surface[here]
    travelled = np.append(0.0, np.cumsum(np.hypot(*np.diff(tip, axis=0).T)))
    marks = np.unique(np.searchsorted(travelled, np.arange(0.0, travelled[-1], _LAG)))
    way = np.diff(tip[marks], axis=0)
    ahead = (np.diff(surface[marks], axis=0) * way).sum(axis=1) / np.maximum(np.hypot(*way.T), 1e-12)
    return float(-np.minimum(ahead, 0.0).sum())


def _inner_corners(contour: Contour) -> str:
    begins, _ = runs(contour.inner_corner)
    if not len(begins):
        return ''
    where = 'an inner corner' if len(begins) == 1 else f'{len(begins)} inner corners'
    return f'{where} hardly wider than the tip: there the outline has the radius of the tip, the object may be sharper'


def _friction(contour: Contour) -> str:
    found = contour.friction.coefficient
    if not found > _MOST_FRICTION:
        return ''
    return (
        f'a coefficient of friction of {found:.2g} is hardly one of a tip on metal: check frame and sign of the sensor'
    )


def _percent(part: float) -> str:
    return f'{100 * part:.0f} %' if part >= 0.01 else 'less than 1 %'
