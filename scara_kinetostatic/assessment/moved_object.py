"""Whether rejected touches of one object agree with each other once that object is displaced.

All touches are fitted together, with the displacement of the object in the rejected ones estimated along. If none of
them is rejected any more, and their distances are those of noise, the object stood there when it was touched. Declared
errors of its place and radius are common to all its touches: the displacement is that from its true place.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import special

from scara_kinetostatic.assessment.thresholds import CONSISTENT, FEWEST_MOVED
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.effects.object_position import ObjectPosition
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.model.arrays import Mask
from scara_kinetostatic.model.effect_law import Shift, TouchState
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


@dataclass(frozen=True)
class _Displaced(ObjectPosition):
    """The displacement of an object in some of its touches.

    Attributes:
        touches: places of these in the order of time.
    """

    touches: frozenset[int] = frozenset()

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        there = self.acts_on(at)[:, None]
        return tuple(Shift(place=place * there) for place in self.places(at))

    def acts_on(self, at: TouchState) -> Mask:
        order = at.metadata.order
        return np.zeros(len(at.magnitude), dtype=bool) if order is None else np.isin(order, [*self.touches])


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
    """The fit of used and rejected touches, these with their object displaced; None where there is none."""
    effects = (*c.model.effects, _displaced(c, disc, there))
    start = ExtendedModel(c.parameters, effects, (*c.model.effect_values, (0.0, 0.0)))
    cell = replace(c.cell, noise=c.noise)
    try:
        return calibrate(c.touches.select(c.used | there), cell, effects, start=start, fixed=c.fixed)
    except ScaraKinetostaticError:
        return None


def _displaced(c: Calibration, disc: int, where: Mask) -> _Displaced:
    """The displacement of an object in some of its touches, (n,)."""
    touches = frozenset(c.touches.order[where].tolist())
    return _Displaced(f'{c.cell.discs[disc].name} displaced', disc, touches=touches)


def _not_there(fit: Calibration, c: Calibration, disc: int) -> Mask:
    """The used touches of an object that do not agree with its displaced place, (n,)."""
    own = c.touches.disc == disc
    places = np.flatnonzero(c.used & own)
    moved = np.zeros(len(c.used), dtype=bool)
    if len(places):
        model = replace(fit.model, effects=(*fit.model.effects[:-1], _displaced(c, disc, own)))
        point = project(observe(c.touches.select(places), fit.cell, fit.errors), model, fit.noise)
        moved[places] = special.chdtrc(2, point.distance) < CONSISTENT
    return moved
