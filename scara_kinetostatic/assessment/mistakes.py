"""The mistake in a cell description or in touches that explains why they do not agree, by name.

The touches are fitted as stated and as they would be without each of the mistakes that people make (`_candidates`;
`mistake_fit`). One is named where the touches disagree grossly with what is stated, and agree with it without that
mistake; several, where these explain the touches alike; none, where none does.

Two mistakes are exact aliases of parameters and never spoil a fit. Radii that are all stated too small by the same
length, as where the radius of the tip is missing, give a negative backlash g_ee of that size; all too large, a large
positive one. Forces in kN give compliances a thousand times too large.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.mistake_fit import Agreement, Reading, fit_readings
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import CellError, InputError
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign, layout_problems
from scara_kinetostatic.model.parameters import G_EE, L1, L2, NAMES, THETA1, THETA2, UNITS
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
    """A mistake is named only if without it the misfit is at most this."""
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
    step: int = 30
    """Rotations of sensor and base are tried in steps of so many degrees,"""
    rotation: float = float(np.deg2rad(12.0))
    """and fitted about each with this standard deviation, rad."""
    same_length: float = 1e-3
    """Lengths that differ by less than this are not worth swapping, m."""


_LIMITS = _Limits()


class Origin(Enum):
    """What holds the touches: it decides on what in them is as the cell description says.

    In a recording that is frame and sign of the force, in arrays the frame; a table has the force on the object in the
    base frame.
    """

    RECORDING = 'recording'
    TABLE = 'table'
    ARRAYS = 'arrays'


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


class Check(NamedTuple):
    """What touches say of a cell before they are calibrated.

    Attributes:
        cell: the cell.
        found: the mistake that explains why they do not agree; None where they do, or none explains it.
        misfit: how badly they agree as stated (`mistake_fit`).
        backlash: g_ee of the coarse fit, m.
    """

    cell: Cell
    found: Mistake | None = None
    misfit: float = np.inf
    backlash: float = 0.0

    @property
    def agrees(self) -> bool:
        """Whether there are enough touches and they agree as stated, but for what a calibration corrects."""
        return self.misfit < _LIMITS.agrees

    def mistake(self, calibration: Calibration | None = None) -> Mistake | None:
        """The mistake found, or one of all radii, of which a calibration of the touches says more."""
        return self.found or _common_radius(self, calibration)


def check_touches(
    touches: TouchSet, cell: Cell, *, fixed: Mapping[str, float] | None = None, origin: Origin = Origin.ARRAYS
) -> Check:
    """Look for the mistake that explains why touches and cell do not agree.

    Args:
        touches: all of them, with those that seem to meet no object.
        cell: the cell.
        fixed: parameters held, by name.
        origin: where they come from, on which the remedy depends.
    """
    force = np.hypot(*touches.force.T)
    touches = touches.select(force > 1e-3 * np.median(force)) if len(touches) else touches
    n = len(touches)
    if n < FEWEST_TOUCHES:
        return Check(cell)
    where = np.unique(np.linspace(0, n - 1, min(n, _LIMITS.touches)).round().astype(np.intp))
    reading = _reading(touches.select(where), cell, fixed or {})
    stated, named = fit_readings([reading]), touches.disc[where]
    if stated.misfit[0] > _LIMITS.gross:
        found = _gross(reading, stated, cell, named, origin)
    else:
        found = _mislabelled(named, stated.disc[0], cell) or _force_unit(touches)
    return Check(cell, found, float(stated.misfit[0]), float(stated.parameters[0, G_EE]))


def _reading(touches: TouchSet, cell: Cell, fixed: Mapping[str, float]) -> Reading:
    fixed = {name: value for name, value in fixed.items() if name in NAMES and isinstance(value, (int, float))}
    nominal = cell.nominal.replace(**fixed).as_array()
    free = np.array([float(name not in fixed) for name in NAMES])
    tool, unturned = np.float64(cell.sensor.frame is SensorFrame.TOOL), np.float64(0.0)
    return Reading(touches.joints, touches.force, tool, cell.centers, cell.radii, nominal, free, unturned)


def _gross(reading: Reading, stated: Agreement, cell: Cell, named: Indices, origin: Origin) -> Mistake | None:
    """The mistake without which the touches agree, where they do not as stated."""
    tried = [c for c in _candidates(reading, cell, origin) if _is_possible(cell, c.mended)]
    if not tried:
        return None
    found = fit_readings([candidate.mended for candidate in tried])
    before, best = float(stated.misfit[0]), float(found.misfit.min())
    if best > min(_LIMITS.agrees, _LIMITS.part * before):
        return None
    alike = np.flatnonzero(found.misfit <= min(best + _LIMITS.alike, _LIMITS.part * before)).tolist()
    # common ones before others, those without a rotation that is fitted before those with one: of these the smallest
    plain = [k for k in alike if tried[k].rotation is None]
    chosen = [k for k in plain if tried[k].common] or plain
    chosen = chosen or sorted(alike, key=lambda k: abs(float(found.rotation[k])))[:1]
    if len(chosen) > _LIMITS.named:
        return None
    mistakes = []
    for k in sorted(chosen, key=lambda k: float(found.misfit[k])):
        candidate = tried[k]
        if candidate.rotation is not None:
            turned = candidate.rotation + float(found.rotation[k])
            turned = float(np.arctan2(np.sin(turned), np.cos(turned)))
            if abs(turned) < _LIMITS.least_rotation:
                return None
            candidate = _with_rotation(candidate, turned)
        if candidate.discs:
            wrong = np.mean(found.disc[k] != named) > _LIMITS.mislabelled
            what = 'centers' if wrong else 'radii, or the centers,'
            candidate = candidate._replace(statement=_exchanged(what, candidate.discs, cell))
        in_cell = not candidate.where.startswith(('force', 'joint', 'fixed'))
        evidence = _evidence(stated, found.distance[k], found.angle[k])
        mistakes.append(Mistake(candidate.where, candidate.statement, candidate.action, evidence, in_cell))
    return replace(
        mistakes[0],
        statement=', or '.join(dict.fromkeys(item.statement for item in mistakes)),
        action=', or '.join(dict.fromkeys(item.action for item in mistakes)),
        in_cell=all(item.in_cell for item in mistakes),
        is_gross=before > _LIMITS.hopeless,
    )


def _is_possible(cell: Cell, mended: Reading) -> bool:
    """Whether a cell with these discs would be accepted."""
    return not layout_problems(cell, mended.centers, mended.radii)


def _with_rotation(candidate: Candidate, angle: float) -> Candidate:
    """With the rotation of the sensor in words, rad."""
    right = round(angle / (np.pi / 2)) * np.pi / 2
    degrees = f'{np.rad2deg(right if abs(angle - right) < _LIMITS.right_angle else angle):.0f}°'
    statement, action = (text.format(rotation=degrees) for text in (candidate.statement, candidate.action))
    return candidate._replace(statement=statement, action=action)


def _evidence(stated: Agreement, distance: Floats, angle: Floats) -> str:
    """By how much the touches miss the discs, or the forces their normals, as stated and without the mistake."""
    before, after = (1e3 * float(np.sqrt(np.mean(d * d))) for d in (stated.distance[0], distance))
    turned, left = (np.rad2deg(float(np.median(np.abs(a)))) for a in (stated.angle[0], angle))
    if before > 10 * after and before > 1.0:
        stated_text, mended = (f'{miss:.0f}' if miss >= 10 else f'{miss:.2g}' for miss in (before, after))
        return f'as stated the touches miss the discs by {stated_text} mm, without the mistake by {mended} mm'
    return f'as stated the forces point {turned:.0f}° beside the discs, without the mistake {left:.1f}°'


def _mislabelled(named: Indices, met: Indices, cell: Cell) -> Mistake | None:
    """Touches that name another object than the one they meet."""
    wrong = np.flatnonzero(named != met)
    if len(wrong) <= _LIMITS.mislabelled * len(named):
        return None
    pairs = sorted({(int(named[k]), int(met[k])) for k in wrong})
    names = [disc.name for disc in cell.discs]
    if all((b, a) in pairs for a, b in pairs):
        both = _listed([names[a] for a, _ in pairs])
        statement = f'{both} are swapped: touches that name one of them meet the other'
        return Mistake('objects', statement, 'exchange their names, in the cell description or in the touches')
    a, b = pairs[0]
    statement = f'{len(wrong)} of {len(named)} touches name a wrong object: {names[a]} where they meet {names[b]}'
    return Mistake(
        'object', statement, 'correct the names, or leave them out: objects are found by place', in_cell=False
    )


def _force_unit(touches: TouchSet) -> Mistake | None:
    """Forces in kN or mN."""
    size = float(np.median(np.hypot(*touches.force.T)))
    if _LIMITS.faint < size < _LIMITS.huge:
        return None
    unit, in_newton = ('kN', 1e3 * size) if size <= _LIMITS.faint else ('mN', 1e-3 * size)
    statement = f'the forces are in {unit}, not in N: the median force would be {size:.2g} N'
    return Mistake('force', statement, f'give them in N (then {in_newton:.2g} N)', in_cell=False)


def _common_radius(check: Check, calibration: Calibration | None) -> Mistake | None:
    """An error of all radii, which is a backlash g_ee that no gripper has."""
    cell, value, std, least = check.cell, check.backlash, 0.0, _LIMITS.coarse_radius
    if check.misfit > _LIMITS.slight or (calibration is not None and calibration.status['g_ee'] == 'fixed'):
        return None
    if calibration is not None and np.isfinite(calibration.std_of('g_ee')):
        value, std, least = calibration.parameters.g_ee, calibration.std_of('g_ee'), 0.0
    declared = [cell.uncertainty.radius, *(disc.radius_std for disc in cell.discs)]
    least = max(least, _LIMITS.sigmas * float(np.hypot(std, max(declared))))
    if -least <= value < max(_LIMITS.largest_backlash, least):
        return None
    given = f' ± {1e3 * std:.2g}' if std else ''
    why = 'a backlash is not negative' if value < 0 else 'a backlash is not so large'
    evidence = f'else the backlash of the gripper, g_ee, would be {1e3 * value:.3g}{given} mm; {why}'
    return Mistake('objects', *(_too_small(cell, -value) if value < 0 else _too_large(cell, value)), evidence)


def _too_small(cell: Cell, error: float) -> tuple[str, str]:
    """Statement and action."""
    statement = f'all radii are stated {1e3 * error:.3g} mm too small'
    action = 'measure the discs and the tip again, and add the difference to every radius'
    tip = cell.tip_radius
    if tip is not None and abs(error - tip) < _LIMITS.same_radii * tip:
        statement = f'the radii do not contain the radius of the tip, {1e3 * tip:.3g} mm'
        action = 'add it to every radius: it reaches to the centre of the tip'
    elif error > _LIMITS.least_tip:
        statement += ', or the radius of the tip is missing'
        action = 'add the radius of the tip to every radius: it reaches to the centre of the tip'
    return statement, action


def _too_large(cell: Cell, error: float) -> tuple[str, str]:
    """The same of radii that are too large."""
    halves = np.abs(error / cell.radii - 0.5)
    statement, action = f'all radii are stated {1e3 * error:.3g} mm too large', 'measure the discs and the tip again'
    if halves.max() <= _LIMITS.same_radii:
        word = (
            'every radius is the diameter of its disc' if len(cell.discs) > 1 else 'radius is the diameter of the disc'
        )
        return word, 'halve it, and add the radius of the tip if it is not contained'
    if halves.max() <= 0.5 and np.ptp(cell.radii) < _LIMITS.least_tip:
        tip = 1e3 * (float(cell.radii.mean()) / 2 - error)
        statement += f', or they are diameters, without the radius of the tip (then {tip:.2g} mm)' if tip > 0 else ''
    return statement, action


class Candidate(NamedTuple):
    """A mistake that may have been made.

    Attributes:
        where: the key of the cell description, or the quantity, at fault.
        statement: the mistake, one clause.
        action: what to do about it.
        mended: the reading without the mistake.
        rotation: ahead of a fitted rotation of the sensor: that of the reading, rad; else None.
        common: whether people often make it: where two explain the touches alike, the common one is named.
        discs: those whose radii change places.
    """

    where: str
    statement: str
    action: str
    mended: Reading
    rotation: float | None = None
    common: bool = True
    discs: tuple[int, ...] = ()


def _candidates(r: Reading, cell: Cell, origin: Origin) -> list[Candidate]:
    """All mistakes that may have been made in a reading."""
    kinds = (_sensors, _joints, _discs, _radii, _nominal, _fixed)
    return [candidate for kind in kinds for candidate in kind(r, cell, origin)]


_FORCES = (
    (
        (-1.0, 0.0, 0.0, -1.0),
        'the sign of the force is wrong: it points away from the discs',
        'change the signs of fx and fy',
    ),
    ((0.0, 1.0, 1.0, 0.0), 'x and y of the force are swapped', 'exchange fx and fy'),
    ((-1.0, 0.0, 0.0, 1.0), 'x of the force has the wrong sign', 'change the sign of fx'),
    ((1.0, 0.0, 0.0, -1.0), 'y of the force has the wrong sign', 'change the sign of fy'),
    (
        (0.0, -1.0, -1.0, 0.0),
        'x and y of the force are swapped, and both have the wrong sign',
        'exchange fx and fy, and change their signs',
    ),
)
"""Changes of the force by rows, with words for each."""


def _sensors(r: Reading, cell: Cell, origin: Origin) -> Iterator[Candidate]:
    """Sign, frame, axes and rotation of the force sensor."""
    for tool in (r.tool, 1.0 - r.tool):
        for matrix, statement, action in _FORCES:
            yield _sensor(r, cell, origin, tool, np.reshape(matrix, (2, 2)), statement, action)
        if tool != r.tool:
            yield _sensor(r, cell, origin, tool, np.eye(2), '', '')
        for degrees in range(_LIMITS.step, 360, _LIMITS.step):
            if degrees != 180:
                yield _turned(r, origin, tool, degrees)


def _sensor(
    r: Reading, cell: Cell, origin: Origin, tool: Floats, matrix: Floats, statement: str, action: str
) -> Candidate:
    mended = r._replace(tool=tool, force=r.force @ matrix.T)
    flipped, plain = bool(np.array_equal(matrix, -np.eye(2))), not statement
    recorded = origin is Origin.RECORDING
    if (recorded and (flipped or plain)) or (origin is Origin.ARRAYS and plain):
        return _convention(r, cell, mended, flipped)
    action = f'let the driver of the sensor {action}' if recorded else action
    if tool == r.tool:
        return Candidate('sensor' if recorded else 'force', statement, action, mended)
    frames = _frames(tool)
    both = f'the forces are in the {frames[0]} frame, not in the {frames[1]} frame'
    statement = f'{both}, and {statement}' if statement else both
    if origin is Origin.TABLE:
        return Candidate('force', statement, 'give the force on the object in the base frame', mended, common=plain)
    action = f'set sensor.frame to {frames[0]}, and {action}'
    return Candidate('sensor.frame', statement, action, mended, common=plain)


def _frames(tool: Floats) -> tuple[str, str]:
    return ('tool', 'base') if tool else ('base', 'tool')


def _convention(r: Reading, cell: Cell, mended: Reading, flipped: bool) -> Candidate:
    """Another frame or sign of the cell description's sensor."""
    changed = []
    if mended.tool != r.tool:
        changed.append(('frame', *reversed(_frames(mended.tool))))
    if flipped:
        signs = ('on_robot', 'on_object') if cell.sensor.sign is SensorSign.ON_ROBOT else ('on_object', 'on_robot')
        changed.append(('sign', *signs))
    keys = ', '.join(f'sensor.{key}' for key, _, _ in changed)
    statement = ' and '.join(f'the {key} of the sensor is {right!r}, not {stated!r}' for key, stated, right in changed)
    action = 'set ' + ' and '.join(f'sensor.{key} to {right}' for key, _, right in changed)
    return Candidate(keys, statement, action, mended)


def _turned(r: Reading, origin: Origin, tool: Floats, degrees: int) -> Candidate:
    angle = float(np.deg2rad(degrees))
    c, s = np.cos(angle), np.sin(angle)
    mended = r._replace(tool=tool, force=r.force @ np.array([[c, s], [-s, c]]), rotation=np.float64(_LIMITS.rotation))
    frame = '' if tool == r.tool else f', in the {_frames(tool)[0]} frame'
    where = 'sensor' if origin is Origin.RECORDING else 'force'
    statement = f'the axes of the force sensor are turned by {{rotation}}{frame}'
    return Candidate(where, statement, 'turn the forces by {rotation}', mended, rotation=angle, common=degrees == 90)


_JOINTS = (
    ((0.0, 1.0, 1.0, 0.0), 'the two joints are in the wrong order', 'exchange q1 and q2'),
    ((-1.0, 0.0, 0.0, 1.0), 'joint 1 turns the other way', 'change the sign of q1'),
    ((1.0, 0.0, 0.0, -1.0), 'joint 2 turns the other way', 'change the sign of q2'),
    ((-1.0, 0.0, 0.0, -1.0), 'both joints turn the other way', 'change the signs of q1 and q2'),
    ((1.0, 0.0, -1.0, 1.0), 'joint 2 is measured from the base, not from link 1', 'give q2 less q1 for q2'),
    (
        (0.0, -1.0, -1.0, 0.0),
        'the two joints are in the wrong order and turn the other way',
        'exchange q1 and q2 and change their signs',
    ),
)
"""Changes of the joint angles by rows, with words for each."""
_UNITS = (
    (np.deg2rad(1.0), 'the joint angles are in degrees, not in rad', 'give them in rad'),
    (np.rad2deg(1.0), 'the joint angles were converted to rad twice', 'give them in rad'),
    (2e-3 * np.pi, 'the joint angles are in thousandths of a turn, not in rad', 'give them in rad'),
    (2 * np.pi, 'the joint angles are in turns, not in rad', 'give them in rad'),
    (1e-3, 'the joint angles are in mrad, not in rad', 'give them in rad'),
)


def _joints(r: Reading, cell: Cell, origin: Origin) -> Iterator[Candidate]:
    """Order, sense and unit of the joint angles."""
    for number, (matrix, statement, action) in enumerate(_JOINTS):
        mended, where = r._replace(joints=r.joints @ np.reshape(matrix, (2, 2)).T), 'joint angles'
        if origin is Origin.RECORDING and number == 0:
            where, names = 'robot.joint_names', ', '.join(reversed(cell.joint_names))
            action = f'set robot.joint_names to [{names}]'
        elif origin is Origin.RECORDING:
            action = f'let the driver of the joints {action}'
        yield Candidate(where, statement, action, mended, common=number < 4)
    for factor, statement, action in _UNITS:
        yield Candidate('joint angles', statement, action, r._replace(joints=r.joints * factor))
    for place in (0, 1):
        scale = np.where(np.arange(2) == place, np.deg2rad(1.0), 1.0)
        statement = f'the angle of joint {place + 1} is in degrees, not in rad'
        yield Candidate('joint angles', statement, f'give q{place + 1} in rad', r._replace(joints=r.joints * scale))


_PLACES = (
    ((0.0, 1.0, 1.0, 0.0), 'x and y are swapped', 'exchange the two numbers of center'),
    ((-1.0, 0.0, 0.0, 1.0), 'x has the wrong sign', 'change the sign of the first number of center'),
    ((1.0, 0.0, 0.0, -1.0), 'y has the wrong sign', 'change the sign of the second number of center'),
    ((-1.0, 0.0, 0.0, -1.0), 'x and y have the wrong sign', 'change the signs of center'),
)
"""Changes of the centres by rows, with words for each."""


def _discs(r: Reading, cell: Cell, origin: Origin) -> Iterator[Candidate]:
    """Axes of the centres of all discs, or of one."""
    m = len(r.centers)
    for matrix, statement, action in _PLACES:
        moved = r.centers @ np.reshape(matrix, (2, 2)).T
        of_all = f'{statement} in the centers of all discs' if m > 1 else f'{statement} in the center of the disc'
        yield Candidate('objects', of_all, f'{action} of every disc' if m > 1 else action, r._replace(centers=moved))
        for d in range(m) if m > 1 else ():
            centers = np.where((np.arange(m) == d)[:, None], moved, r.centers)
            if np.abs(centers - r.centers).max() > _LIMITS.same_length:
                name = cell.discs[d].name
                yield Candidate(
                    f'objects: {name}', f'{statement} in the center of {name}', action, r._replace(centers=centers)
                )


def _radii(r: Reading, cell: Cell, origin: Origin) -> Iterator[Candidate]:
    """Diameters for radii, and radii at the wrong discs."""
    m, names = len(r.radii), [disc.name for disc in cell.discs]
    for factor, word, action in (
        (0.5, 'radius is the diameter of {}', 'halve it and add the radius of the tip if it is not contained'),
        (2.0, 'radius of {} is half of what it should be', 'double it'),
    ):
        every = word.format('every disc' if m > 1 else 'the disc')
        yield Candidate('objects', every, action, r._replace(radii=r.radii * factor))
        for d in range(m) if m > 1 else ():
            radii = np.where(np.arange(m) == d, factor * r.radii, r.radii)
            where = f'objects: {names[d]}'
            yield Candidate(where, word.format(names[d]), action, r._replace(radii=radii))
    for order in _orders(m):
        radii = r.radii[order]
        moved = tuple(d for d in range(m) if abs(radii[d] - r.radii[d]) > _LIMITS.same_length)
        if moved and all(order[d] == d for d in range(m) if d not in moved):
            statement = _exchanged('radii', moved, cell)
            yield Candidate('objects', statement, 'exchange them', r._replace(radii=radii), discs=moved)


def _orders(m: int) -> list[Indices]:
    """Permutations of m discs but the identity: all of few, the pairs of many."""
    # 4: of so many discs every permutation is tried, of more only the pairs
    if m <= 4:
        return [np.array(order) for order in permutations(range(m)) if order != tuple(range(m))]
    orders = [np.arange(m) for _ in combinations(range(m), 2)]
    for order, (i, j) in zip(orders, combinations(range(m), 2), strict=True):
        order[[i, j]] = j, i
    return orders


def _exchanged(what: str, discs: Sequence[int], cell: Cell) -> str:
    """That radii or centers stand at the wrong discs, one clause."""
    how = 'swapped' if len(discs) == 2 else 'in the wrong order'
    return f'the {what} of {_listed([cell.discs[d].name for d in discs])} are {how}'


def _listed(names: Sequence[str]) -> str:
    """Names in a sentence."""
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'


def _nominal(r: Reading, cell: Cell, origin: Origin) -> Iterator[Candidate]:
    """Offsets of joints and lengths of links in the nominal parameters."""
    # 0.1: an offset of a joint above this may be one in degrees, rad
    angles = [j for j in (THETA1, THETA2) if abs(r.nominal[j]) > 0.1]
    if angles and r.free[angles].all():
        where = ', '.join(f'robot.nominal.{NAMES[j]}' for j in angles)
        nominal = r.nominal.copy()
        nominal[angles] = np.deg2rad(nominal[angles])
        yield Candidate(where, 'the angle is in degrees, not in rad', 'give it in rad', r._replace(nominal=nominal))
    if abs(r.nominal[L1] - r.nominal[L2]) > _LIMITS.same_length and r.free[[L1, L2]].all():
        nominal = r.nominal.copy()
        nominal[[L1, L2]] = nominal[[L2, L1]]
        statement = 'the lengths of the two links are swapped'
        yield Candidate('robot.nominal: l1, l2', statement, 'exchange them', r._replace(nominal=nominal))
    for j in (THETA1, THETA2) if r.free[[THETA1, THETA2]].all() else ():
        for degrees in range(_LIMITS.step, 360, _LIMITS.step):
            nominal = r.nominal.copy()
            nominal[j] += np.deg2rad(degrees)
            by = degrees if degrees <= 180 else degrees - 360
            statement = f'the offset of joint {j // 2} is wrong by about {by}°'
            action = f'give {NAMES[j]} in rad, about {np.arctan2(np.sin(nominal[j]), np.cos(nominal[j])):.2f}'
            where = f'robot.nominal.{NAMES[j]}'
            yield Candidate(where, statement, action, r._replace(nominal=nominal), common=degrees in (90, 180, 270))


def _fixed(r: Reading, cell: Cell, origin: Origin) -> Iterator[Candidate]:
    """Values at which a parameter is held."""
    for j in np.flatnonzero(r.free == 0):
        free = r.free.copy()
        free[j] = 1.0
        name, value = NAMES[j], r.nominal[j]
        statement = f'the fixed value {value:g} {UNITS[name]} of {name} contradicts the touches'
        yield Candidate(f'fixed {name}', statement, 'correct it, or leave the parameter free', r._replace(free=free))
