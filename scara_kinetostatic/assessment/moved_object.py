"""Whether rejected touches of one object agree with each other once that object is displaced.

All touches are fitted together, with the rejected ones on an object of their own: a copy of theirs whose place is
estimated along (effect `object_position`). If none of them is rejected any more, and their distances are those of
noise, the object stood there when it was touched.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.assessment.thresholds import CONSISTENT, FEWEST_MOVED
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.effects.object_position import ObjectPosition
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Mask
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.model.extended_model import ExtendedModel


class MovedObject(NamedTuple):
    """An object that stood elsewhere for some touches.

    Attributes:
        disc: its index.
        x: displacement, m.
        y: the same.
        std: standard uncertainty of the displacement in its own direction, m.
        there: the rejected touches, which found it there, of all of the calibration, (n,).
        stated: those that found it where it is stated, and not there, (n,); others of the object agree with both.
    """

    disc: int
    x: float
    y: float
    std: float
    there: Mask
    stated: Mask


def find_moved_object(c: Calibration, disc: int) -> MovedObject | None:
    """The displacement of an object that explains its rejected touches; None where none does.

    Args:
        c: the calibration.
        disc: index of the object.
    """
    there = ~c.used & (c.touches.disc == disc)
    if there.sum() < FEWEST_MOVED:
        return None
    fit = _fit_displaced(c, disc, there)
    rejected = there[c.used | there]
    if fit is None or not fit.used[rejected].all():
        return None
    if special.chdtrc(2 * rejected.sum() - 2, np.sum(fit.standardized[rejected] ** 2)) < CONSISTENT:
        return None
    x, y = fit.model.effect_values[-1]
    unit = np.array([x, y]) / max(float(np.hypot(x, y)), 1e-300)
    values = slice(len(fit.model.names) - 2, len(fit.model.names))
    std = float(np.sqrt(unit @ fit.covariance[values, values] @ unit))
    return MovedObject(disc, x, y, std, there, _not_there(fit, c, disc))


def _fit_displaced(c: Calibration, disc: int, there: Mask) -> Calibration | None:
    """The fit of used and rejected touches, these on a displaced copy of their object; None where there is none."""
    stated = c.cell.discs[disc]
    copy = Disc(f'{stated.name} displaced', stated.x, stated.y, stated.radius)
    cell = replace(c.cell, discs=(*c.cell.discs, copy), noise=c.noise)
    number = len(c.cell.discs)
    touches = c.touches.replace(disc=np.where(there, number, c.touches.disc)).select(c.used | there)
    effects = (*c.model.effects, ObjectPosition.of(number, copy.name))
    start = ExtendedModel(c.parameters, effects, (*c.model.effect_values, (0.0, 0.0)))
    try:
        return calibrate(touches, cell, effects, start=start, fixed=c.fixed)
    except ScaraKinetostaticError:
        return None


def _not_there(fit: Calibration, c: Calibration, disc: int) -> Mask:
    """The used touches of an object that do not agree with its displaced copy, (n,)."""
    places = np.flatnonzero(c.used & (c.touches.disc == disc))
    moved = np.zeros(len(c.used), dtype=bool)
    if len(places):
        touches = c.touches.select(places).replace(disc=np.full(len(places), len(fit.cell.discs) - 1))
        point = project(observe(touches, fit.cell, fit.errors), fit.model, fit.noise)
        moved[places] = special.chdtrc(2, point.distance) < CONSISTENT
    return moved
