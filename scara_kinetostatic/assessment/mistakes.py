"""The mistake in a cell description or in touches that explains why they do not agree, by name.

The touches are fitted as stated and as they would be without each of the mistakes that people make (`mistake_fit`,
`mistake_hypotheses`). One is named where the touches disagree grossly with what is stated, and agree with it without
that mistake; several, where these explain the touches alike; none, where none does.

Two mistakes are exact aliases of parameters and never spoil a fit. Radii that are all stated too small by the same
length, as where the radius of the tip is missing, give a negative backlash g_ee of that size; all too large, a large
positive one. Forces in kN give compliances a thousand times too large.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.mistake_fit import Agreement, Statements, fit_statements
from scara_kinetostatic.assessment.mistake_hypotheses import (
    Hypothesis,
    Origin,
    Reading,
    Source,
    exchanged,
    hypotheses,
    listed,
)
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import CellError, InputError
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign, layout_problems
from scara_kinetostatic.model.parameters import G_EE, NAMES
from scara_kinetostatic.model.touch import TouchSet

FEWEST_TOUCHES = 8
"""Fewer do not tell one mistake from another."""


@dataclass(frozen=True)
class _Limits:
    """From where on something is taken for a mistake."""

    touches: int = 60
    """Of more touches so many are taken, spread over all of them."""
    gross: float = 0.8
    """Misfit of the stated description above which a mistake is looked for."""
    slight: float = 0.15
    """Misfit above which another model error may have made the backlash of the gripper what it is."""
    hopeless: float = 2.5
    """Misfit of the stated description above which a calibration is not even tried, if a mistake explains it."""
    part: float = 0.3
    """A mistake is named only if without it the misfit is at most this part of the stated one."""
    agrees: float = 1.2
    """Misfit up to which touches agree with a description; a mistake is named only if without it they do."""
    alike: float = 0.3
    """Mistakes without which the misfit is larger by no more than this than without the best are its alternatives."""
    named: int = 3
    """Of more alternatives none is named: then the touches do not tell."""
    mislabelled: float = 0.1
    """Touches of a wrong object are a mistake if they are more than this part of all."""
    same_radii: float = 0.1
    """An error common to all radii that is this near to the half of each, relative, makes them diameters."""
    sigmas: float = 4.0
    """A backlash of the gripper below zero by so many standard uncertainties is none."""
    coarse_radius: float = 1e-3
    """A backlash of the gripper below zero by so much is none, where there is no calibration, m."""
    largest_backlash: float = 3e-3
    """A backlash of the gripper above this is none, m."""
    least_tip: float = 4e-4
    """Least radius of a tip, m."""
    least_rotation: float = float(np.deg2rad(20.0))
    """A rotation of the sensor below this is an effect, which is fitted, not a mistake, rad."""
    right_angle: float = float(np.deg2rad(3.0))
    """A rotation this near to a right angle is one, rad."""
    faint: float = 0.2
    """Median force below which the forces may be in kN, N."""
    huge: float = 5e3
    """Median force above which the forces may be in mN, N."""


_LIMITS = _Limits()


@dataclass(frozen=True)
class Mistake:
    """A mistake with what speaks for it.

    Attributes:
        where: the key of the cell description, or the quantity, at fault.
        statement: the mistake, one clause.
        action: what to do about it.
        evidence: how well the touches agree with and without it; empty where a value in the statement says so.
        in_cell: whether it is one of the cell description; else it is one of the touches.
        is_gross: whether with it the touches have hardly anything to do with the cell: no result of them is of use.
    """

    where: str
    statement: str
    action: str
    evidence: str = ''
    in_cell: bool = True
    is_gross: bool = False

    @property
    def text(self) -> str:
        """Statement and evidence."""
        return f'{self.statement} ({self.evidence})' if self.evidence else self.statement

    def error(self, source: str) -> InputError:
        """The mistake as an error; `source` names where the touches come from."""
        if self.in_cell:
            return CellError(self.where, self.text, self.action)
        return InputError(source, self.text, self.action)


def find_mistake(
    touches: TouchSet,
    cell: Cell,
    calibration: Calibration | None = None,
    *,
    fixed: Mapping[str, float] | None = None,
    origin: Origin | None = None,
) -> Mistake | None:
    """The mistake that explains why touches and cell do not agree; None where they do, or none explains it.

    Args:
        touches: all of them, with those that seem to meet no object.
        cell: the cell.
        calibration: the base model's fit of the touches, where there is one.
        fixed: parameters held, by name; those of `calibration` where it is given.
        origin: where they come from, on which the remedy depends; None: by the number of samples of a touch, recordings
            or arrays.
    """
    force = np.hypot(*touches.force.T)
    touches = touches.select(force > 1e-3 * np.median(force)) if len(touches) else touches
    if len(touches) < FEWEST_TOUCHES:
        return None
    origin = origin or (Origin.RECORDING if np.any(touches.samples > 1) else Origin.ARRAYS)
    held = dict(calibration.fixed if calibration is not None else fixed or {})
    where = _spread(len(touches))
    reading = _reading(touches.select(where), cell, held)
    stated = _fit([reading])
    if stated.misfit[0] > _LIMITS.gross:
        return _gross(reading, stated, cell, touches.disc[where], origin)
    return (
        _mislabelled(touches.disc[where], stated.disc[0], cell)
        or _force_unit(touches, stated)
        or _common_radius(cell, stated, calibration)
    )


def agree(touches: TouchSet, cell: Cell) -> bool:
    """Whether touches lie on the objects with their forces along the normals, but for what a calibration corrects."""
    if len(touches) < FEWEST_TOUCHES:
        return False
    return bool(_fit([_reading(touches.select(_spread(len(touches))), cell, {})]).misfit[0] < _LIMITS.agrees)


def _spread(n: int) -> Indices:
    return np.unique(np.linspace(0, n - 1, min(n, _LIMITS.touches)).round().astype(np.intp))


def _reading(touches: TouchSet, cell: Cell, fixed: Mapping[str, float]) -> Reading:
    fixed = {name: value for name, value in fixed.items() if name in NAMES and isinstance(value, (int, float))}
    nominal = cell.nominal.replace(**fixed).as_array()
    free = np.array([float(name not in fixed) for name in NAMES])
    tool = cell.sensor.frame is SensorFrame.TOOL
    return Reading(touches.joints, touches.force, tool, cell.centers, cell.radii, nominal, free)


def _fit(readings: Sequence[Reading]) -> Agreement:
    columns = [np.array(column, dtype=float) for column in zip(*readings, strict=True)]
    return fit_statements(Statements(*columns))


class _Explanation(NamedTuple):
    """A mistake with the fit without it."""

    hypothesis: Hypothesis
    misfit: float
    rotation: float
    distance: Floats
    angle: Floats
    disc: Indices


def _gross(reading: Reading, stated: Agreement, cell: Cell, named: Indices, origin: Origin) -> Mistake | None:
    """The mistake without which the touches agree, where they do not as stated."""
    on_robot = cell.sensor.sign is SensorSign.ON_ROBOT
    names = tuple(disc.name for disc in cell.discs)
    tried = hypotheses(reading, Source(origin, reading.tool, on_robot, names, cell.joint_names))
    tried = [h for h in tried if not layout_problems(cell, h.mended.centers, h.mended.radii)]
    if not tried:
        return None
    found = _fit([hypothesis.mended for hypothesis in tried])
    before, best = float(stated.misfit[0]), float(found.misfit.min())
    if best > min(_LIMITS.agrees, _LIMITS.part * before):
        return None
    bound = min(best + _LIMITS.alike, _LIMITS.part * before)
    alike = [
        _Explanation(tried[k], found.misfit[k], found.rotation[k], found.distance[k], found.angle[k], found.disc[k])
        for k in np.flatnonzero(found.misfit <= bound)
    ]
    chosen = _alternatives(alike)
    if len(chosen) > _LIMITS.named or any(abs(_turned_by(item)) < _LIMITS.least_rotation for item in chosen):
        return None
    mistake = _joined([_named(item, stated, named, names) for item in chosen])
    return replace(mistake, is_gross=before > _LIMITS.hopeless)


def _alternatives(alike: Sequence[_Explanation]) -> list[_Explanation]:
    """Explanations that differ: common ones before others, and of fitted rotations the smallest correction."""
    common = [item for item in alike if item.hypothesis.common and item.hypothesis.rotation is None]
    plain = common or [item for item in alike if item.hypothesis.rotation is None]
    plain = plain or sorted(alike, key=lambda item: abs(item.rotation))[:1]
    return sorted(plain, key=lambda item: item.misfit)


def _named(item: _Explanation, stated: Agreement, named: Indices, names: Sequence[str]) -> Mistake:
    """An explanation as a mistake."""
    h = item.hypothesis
    statement, action = h.statement, h.action
    if h.rotation is not None:
        angle = _turned_by(item)
        right = round(angle / (np.pi / 2)) * np.pi / 2
        degrees = f'{np.rad2deg(right if abs(angle - right) < _LIMITS.right_angle else angle):.0f}°'
        statement, action = statement.format(rotation=degrees), action.format(rotation=degrees)
    if h.discs:
        what = 'centers' if np.mean(item.disc != named) > _LIMITS.mislabelled else 'radii, or the centers,'
        statement = exchanged(what, h.discs, names)
    in_cell = not h.where.startswith(('force', 'joint', 'fixed'))
    return Mistake(h.where, statement, action, _evidence(stated, item), in_cell)


def _turned_by(item: _Explanation) -> float:
    """The rotation of the sensor that explains the touches, rad; a straight angle where it is none."""
    if item.hypothesis.rotation is None:
        return float(np.pi)
    angle = item.hypothesis.rotation + item.rotation
    return float(np.arctan2(np.sin(angle), np.cos(angle)))


def _evidence(stated: Agreement, item: _Explanation) -> str:
    """By how much the touches miss the discs, or the forces their normals, as stated and without the mistake."""
    before, after = (1e3 * float(np.sqrt(np.mean(d * d))) for d in (stated.distance[0], item.distance))
    turned, left = (np.rad2deg(float(np.median(np.abs(a)))) for a in (stated.angle[0], item.angle))
    if before > 10 * after and before > 1.0:
        stated_text, mended = (f'{miss:.0f}' if miss >= 10 else f'{miss:.2g}' for miss in (before, after))
        return f'as stated the touches miss the discs by {stated_text} mm, without the mistake by {mended} mm'
    return f'as stated the forces point {turned:.0f}° beside the discs, without the mistake {left:.1f}°'


def _joined(mistakes: Sequence[Mistake]) -> Mistake:
    """Alternatives in one."""
    first = mistakes[0]
    statement = ', or '.join(dict.fromkeys(item.statement for item in mistakes))
    action = ', or '.join(dict.fromkeys(item.action for item in mistakes))
    return Mistake(first.where, statement, action, first.evidence, all(item.in_cell for item in mistakes))


def _mislabelled(named: Indices, met: Indices, cell: Cell) -> Mistake | None:
    """Touches that name another object than the one they meet."""
    wrong = np.flatnonzero(named != met)
    if len(wrong) <= _LIMITS.mislabelled * len(named):
        return None
    pairs = sorted({(int(named[k]), int(met[k])) for k in wrong})
    names = [disc.name for disc in cell.discs]
    if all((b, a) in pairs for a, b in pairs):
        both = listed([names[a] for a, _ in pairs])
        statement = f'{both} are swapped: touches that name one of them meet the other'
        return Mistake('objects', statement, 'exchange their names, in the cell description or in the touches')
    a, b = pairs[0]
    statement = f'{len(wrong)} of {len(named)} touches name a wrong object: {names[a]} where they meet {names[b]}'
    return Mistake(
        'object', statement, 'correct the names, or leave them out: objects are found by place', in_cell=False
    )


def _force_unit(touches: TouchSet, stated: Agreement) -> Mistake | None:
    """Forces in kN or mN."""
    size = float(np.median(np.hypot(*touches.force.T)))
    if _LIMITS.faint < size < _LIMITS.huge:
        return None
    unit, in_newton = ('kN', 1e3 * size) if size <= _LIMITS.faint else ('mN', 1e-3 * size)
    statement = f'the forces are in {unit}, not in N: the median force would be {size:.2g} N'
    return Mistake('force', statement, f'give them in N (then {in_newton:.2g} N)', in_cell=False)


def _common_radius(cell: Cell, stated: Agreement, calibration: Calibration | None) -> Mistake | None:
    """An error of all radii, which is a backlash g_ee that no gripper has."""
    value, std, least = float(stated.parameters[0, G_EE]), 0.0, _LIMITS.coarse_radius
    if calibration is not None and np.isfinite(calibration.std_of('g_ee')):
        value, std, least = calibration.parameters.g_ee, calibration.std_of('g_ee'), 0.0
    if stated.misfit[0] > _LIMITS.slight or (calibration is not None and calibration.status['g_ee'] == 'fixed'):
        return None
    declared = [cell.uncertainty.radius, *(disc.radius_std for disc in cell.discs)]
    least = max(least, _LIMITS.sigmas * float(np.hypot(std, max(declared))))
    if value < -least:
        return _too_small(cell, -value, _backlash(value, std, 'a backlash is not negative'))
    if value < max(_LIMITS.largest_backlash, least):
        return None
    return _too_large(cell, value, _backlash(value, std, 'a backlash is not so large'))


def _backlash(value: float, std: float, why: str) -> str:
    given = f' ± {1e3 * std:.2g}' if std else ''
    return f'else the backlash of the gripper, g_ee, would be {1e3 * value:.3g}{given} mm; {why}'


def _too_small(cell: Cell, error: float, evidence: str) -> Mistake:
    statement = f'all radii are stated {1e3 * error:.3g} mm too small'
    action = 'measure the discs and the tip again, and add the difference to every radius'
    tip = cell.tip_radius
    if tip is not None and abs(error - tip) < _LIMITS.same_radii * tip:
        statement = f'the radii do not contain the radius of the tip, {1e3 * tip:.3g} mm'
        action = 'add it to every radius: it reaches to the centre of the tip'
    elif error > _LIMITS.least_tip:
        statement += ', or the radius of the tip is missing'
        action = 'add the radius of the tip to every radius: it reaches to the centre of the tip'
    return Mistake('objects', statement, action, evidence)


def _too_large(cell: Cell, error: float, evidence: str) -> Mistake:
    halves = np.abs(error / cell.radii - 0.5)
    statement, action = f'all radii are stated {1e3 * error:.3g} mm too large', 'measure the discs and the tip again'
    if halves.max() <= _LIMITS.same_radii:
        word = (
            'every radius is the diameter of its disc' if len(cell.discs) > 1 else 'radius is the diameter of the disc'
        )
        return Mistake('objects', word, 'halve it, and add the radius of the tip if it is not contained', evidence)
    if halves.max() <= 0.5 and np.ptp(cell.radii) < _LIMITS.least_tip:
        tip = 1e3 * (float(cell.radii.mean()) / 2 - error)
        statement += f', or they are diameters, without the radius of the tip (then {tip:.2g} mm)' if tip > 0 else ''
    return Mistake('objects', statement, action, evidence)
