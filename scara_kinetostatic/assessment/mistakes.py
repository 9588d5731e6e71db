"""The mistake in a cell description or in touches that explains why they do not agree, by name.

The touches are fitted as stated and as they would be without each of the mistakes that people make (`_hypotheses`); a
coupling of the joints, a parameter of that fit, is tried where none of the others explains them (`_coupled`). A mistake
is named where the touches disagree grossly with what is stated, and agree with it without that mistake; several, where
these explain the touches alike; none, where none does.

The fit is coarse and robust. With the link angles that the measured torques give, Q* = Q - p c - g sign(c), c = JᵀF,
every touch puts the rigid tip at S* = H(Q*), and of the touched disc two numbers have to vanish,

    d = |c_d - S*| - (r_d - p_ee f - g_ee),        the distance from the circle of contact (5) (7), m,
    a = angle(F) - angle(c_d - S*),                the off-normal angle of the force, rad.

The disc is the one with the smallest miss. The base model is fitted by iteratively reweighted least squares
(Cauchy's loss) with a prior about the nominal values that is as wide as the errors of real cells; the backlash of the
gripper is nearly free, as it stands for an error of all radii. What is left is measured by the misfit, the mean of
log(1 + (d/D)²) + log(1 + (a/A)²): about 0 for a right reading, above 5 for one that has nothing to do with the touches.

Two mistakes are exact aliases of parameters and never spoil a fit. Radii that are all stated too small by the same
length, as where the radius of the tip is missing, give a negative backlash g_ee of that size; all too large, a large
positive one. Forces in kN give compliances a thousand times too large: units are told by sizes alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import combinations, product
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import CellError, InputError
from scara_kinetostatic.model.arrays import TINY, Floats, Indices
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign, layout_problems
from scara_kinetostatic.model.joint_law import deflection, joint_torques, rounded_sign
from scara_kinetostatic.model.kinematics import LoadedJoints, forward, quarter_turn, rotate, tip_by_parameters, wrap
from scara_kinetostatic.model.outline import EDGE_RADIUS, Outline, Surfaces
from scara_kinetostatic.model.parameters import G_EE, L1, L2, MILLI, NAMES, P_EE, THETA1, THETA2, UNITS, Parameters
from scara_kinetostatic.model.quantities import quantity
from scara_kinetostatic.model.touch import TouchSet

_SIGN_WIDTH = 0.01
"""Torques over which sign(c) is continuous, Nm."""
FEWEST_TOUCHES = 8
"""Fewer do not tell one mistake from another."""


class _Limits:
    """From where on something is taken for a mistake."""

    touches: int = 60
    """Of more touches so many are taken, spread over all of them."""
    distance: float = 2e-4
    """D: distances from the circle of contact of this size are those of ordinary model errors, m."""
    angle: float = 0.15
    """A: the same of off-normal angles, such as those of friction and noise, rad."""
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
    sigmas: float = 4.0
    """A backlash of the gripper below zero by so many standard uncertainties is none."""
    gross_distance: float = 1e-3
    """Distances of this size are those of mistakes; a backlash of the gripper as far below zero is none where there is
    no calibration, m.
    """
    largest_backlash: float = 3e-3
    """A backlash of the gripper above this is none, m."""
    least_tip: float = 4e-4
    """Least radius of a tip, m."""
    faint: float = 0.2
    """Force below which the forces may be in kN, N."""
    huge: float = 5e3
    """Force above which the forces may be in mN, N."""
    largest_angle: float = 4 * np.pi
    """Joint angles beyond this are in degrees, rad."""
    least_coupling: float = 0.02
    """Less of joint 1's reading in that of joint 2 is the effect `joint_coupling`."""
    same_length: float = 1e-3
    """Lengths that differ by less than this are not worth swapping, m."""


_PLACE, _OFFSET, _COMPLIANCE, _BACKLASH = 0.015, np.deg2rad(2.5), 3e-4, 5e-3
_PRIOR = np.array([_PLACE, _PLACE, *(_OFFSET, _PLACE) * 2, 1e-4, *[_COMPLIANCE] * 2, 0.05, *[_BACKLASH] * 2, 0.1])
"""Standard deviation of the error of each nominal value, SI units, and of a coupling of the joints."""


class Origin(Enum):
    """What holds the touches: it decides on what in them is as the cell description says.

    In a recording that is frame and sign of the force, in arrays the frame; a table has the force on the object, its
    headings say the frame.
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
        misfit: how badly they agree as stated.
        backlash: g_ee of the coarse fit, m.
        unexplained: the touches and how they agree as stated, where they do not and no mistake explains it.
    """

    cell: Cell
    found: Mistake | None = None
    misfit: float = np.inf
    backlash: float = 0.0
    unexplained: tuple[_Reading, _Agreement] | None = None

    def displaced(self) -> Mistake | None:
        """A disc without whose displacement the touches agree, where no mistake is found.

        It is one where the fit fails, and an effect where the fit corrects it.
        """
        if self.unexplained is None:
            return None
        return _named(self.unexplained[1], list(_displaced(*self.unexplained, self.cell)))

    def mistake(self, calibration: Calibration | None = None) -> Mistake | None:
        """The mistake found, or an error of all radii, which is a backlash g_ee that no gripper has.

        A calibration of the touches says more of the latter.
        """
        if self.found:
            return self.found
        cell, value, std, least = self.cell, self.backlash, 0.0, _Limits.gross_distance
        if self.misfit > _Limits.slight or (calibration is not None and calibration.status['g_ee'] == 'fixed'):
            return None
        if calibration is not None and np.isfinite(calibration.std_of('g_ee')):
            value, std, least = calibration.parameters.g_ee, calibration.std_of('g_ee'), 0.0
        declared = [cell.uncertainty.radius, *(disc.radius_std for disc in cell.discs)]
        least = max(least, _Limits.sigmas * float(np.hypot(std, max(declared))))
        if -least <= value < max(_Limits.largest_backlash, least):
            return None
        off = f'stated {abs(value) / MILLI:.3g} mm too {"small" if value < 0 else "large"}'
        where, statement, action = 'objects', f'all radii are {off}', 'measure the discs and the tip again'
        if cell.has_outlines:
            where, statement = 'tip.radius', f'the radius of the tip is {off}'
            action = 'measure the objects and the tip again'
        elif value < -_Limits.least_tip:
            statement += ', or the radius of the tip is missing'
            action = 'add the radius of the tip to every radius: it reaches to the centre of the tip'
        given = f'{value / MILLI:.3g}{f" ± {std / MILLI:.2g}" if std else ""} mm'
        why = f'a backlash is not {"negative" if value < 0 else "so large"}'
        evidence = f'else the backlash of the gripper, g_ee, would be {given}; {why}'
        return Mistake(where, statement, action, evidence)


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
    if (unit := wrong_unit(touches.joints, float(np.median(force)))) is not None:
        return Check(cell, unit)
    which = _spread(n)
    reading = _reading(touches.joints[which], touches.force[which], cell, fixed or {})
    stated = _fit(reading)
    check = Check(cell, None, stated.misfit, float(stated.parameters[G_EE]))
    if stated.misfit <= _Limits.gross:
        return check._replace(found=_mislabelled(touches.disc[which], stated.object, cell))
    tried = [(mistake, _fit(mended)) for mistake, mended in _hypotheses(reading, cell, origin)]
    if not any(fit.misfit <= _Limits.alike for _, fit in tried):
        tried += _coupled(reading, cell, origin)
    found = _named(stated, tried)
    return check._replace(found=found, unexplained=None if found else (reading, stated))


def _spread(count: int) -> Indices:
    """Which of so many touches are fitted."""
    return np.unique(np.linspace(0, count - 1, min(count, _Limits.touches)).round().astype(np.intp))


def coarse_parameters(joints: Floats, force: Floats, cell: Cell) -> Parameters:
    """The base model fitted coarsely and robustly to touches of objects, some of which nobody may know.

    Args:
        joints: Q, (n, 2), rad.
        force: F on the object in the frame of the sensor, (n, 2), N.
        cell: the cell.
    """
    which = _spread(len(joints))
    fitted = _fit(_reading(joints[which], force[which], cell, {})).parameters
    return cell.nominal.replace(**dict(zip(NAMES, fitted.tolist(), strict=False)))


def wrong_unit(joints: Floats, force: float) -> Mistake | None:
    """Joint angles in degrees, or forces in kN or mN; None where they are in rad and N.

    Args:
        joints: Q, (n, 2), rad.
        force: a force that is usual in a touch, N.
    """
    degrees = [f'joint {k + 1}' for k in (0, 1) if np.abs(joints[:, k]).max(initial=0.0) > _Limits.largest_angle]
    if degrees:
        statement = f'the angles of {" and ".join(degrees)} are in degrees, not in rad'
        return Mistake('joint angles', statement, 'give them in rad', in_cell=False, is_gross=True)
    if _Limits.faint < force < _Limits.huge:
        return None
    unit, newton = ('kN', 1 / MILLI) if force <= _Limits.faint else ('mN', MILLI)
    statement = f'the forces are in {unit}, not in N: a touch would have {force:.2g} N'
    action = f'give them in N (then {newton * force:.2g} N)'
    return Mistake('force', statement, action, in_cell=False, is_gross=True)


class _Reading(NamedTuple):
    """A way to read n touches of objects.

    Attributes:
        joints: Q, (n, 2), rad.
        force: F on the object in the frame of the sensor, (n, 2), N.
        tool: whether that frame turns with link 2.
        surfaces: of the objects; of a disc its circle.
        nominal: parameters of the base model, and the part of joint 1 in the angle of joint 2, (13,).
        free: which of them are fitted, (13,).
    """

    joints: Floats
    force: Floats
    tool: bool
    surfaces: Surfaces
    nominal: Floats
    free: Floats

    def with_surfaces(self, **parts: Any) -> _Reading:
        """The reading with other centers, radii, … of the surfaces."""
        return self._replace(surfaces=self.surfaces._replace(**parts))


class _Agreement(NamedTuple):
    """How well a reading agrees with n touches.

    Attributes:
        parameters: the fitted ones, (13,).
        object: the touched one, (n,).
        distance: d, (n,), m.
        angle: a, (n,), rad.
        miss: from the place of contact to the disc less its radius along the force, (n, 2), m.
        misfit: the mean of log(1 + (d/D)²) + log(1 + (a/A)²); infinite where it cannot be evaluated.
        by_distance: derivatives of d by the parameters, (n, 13).
        by_angle: those of a.
    """

    parameters: Floats
    object: Indices
    distance: Floats
    angle: Floats
    miss: Floats
    misfit: float
    by_distance: Floats
    by_angle: Floats


def _reading(joints: Floats, force: Floats, cell: Cell, fixed: Mapping[str, float]) -> _Reading:
    fixed = {name: value for name, value in fixed.items() if name in NAMES}
    free = np.array([*(float(name not in fixed) for name in NAMES), 0.0])
    nominal = np.append(cell.nominal.replace(**fixed).as_array()[: len(NAMES)], 0.0)
    tool = cell.sensor.frame is SensorFrame.TOOL
    return _Reading(joints, force, tool, cell.surfaces, nominal, free)


@np.errstate(all='ignore')
def _fit(r: _Reading) -> _Agreement:
    """Fit a reading to the touches."""
    change, prior = np.zeros(len(_PRIOR)), _PRIOR * r.free
    for step in range(12):  # the scales of the loss shrink to D and A
        found = _misses(r, r.nominal + change)
        rows, right = [np.eye(len(_PRIOR))], [np.zeros(len(_PRIOR))]
        for value, derivative, first, last in (
            (found.distance, found.by_distance, 100 * _Limits.distance, _Limits.distance),
            (found.angle, found.by_angle, 2 * _Limits.angle, _Limits.angle),
        ):
            scale = max(last, first * 0.5**step)
            weight = 1.0 / (scale * np.sqrt(1.0 + (value / scale) ** 2))
            rows.append(weight[:, None] * derivative * prior)
            right.append(weight * (derivative @ change - value))
        system = np.concatenate(rows)
        if not np.isfinite(system).all():
            break
        change = prior * np.linalg.lstsq(system, np.concatenate(right), rcond=None)[0]
    return _misses(r, r.nominal + change)


def _misses(r: _Reading, values: Floats) -> _Agreement:
    """How the touches agree with values of the parameters, (13,).

    The disc is that of the nearest surface. The normal of a circle turns as the tip moves along it, by its radius; that
    of an edge does not, and the distance from it grows beyond its ends.
    """
    p, joints = Parameters.from_array(values[:-1]), _applied((1.0, 0.0, -values[-1], 1.0), r.joints)
    force = rotate(r.force, joints.sum(axis=1) + p.theta1 + p.theta2) if r.tool else r.force
    size = np.maximum(np.linalg.norm(force, axis=1), TINY)
    rigid = joint_torques(p, joints, force)
    compliances, backlashes = np.array([[p.p1, p.p2], [p.g1, p.g2]])
    links = joints - deflection(compliances, backlashes, rigid, rounded_sign(rigid, _SIGN_WIDTH))
    torque, tip = joint_torques(p, links, force), forward(p, links)
    press, unit, every = p.p_ee * size + p.g_ee, force / size[:, None], np.arange(len(size))
    misses = r.surfaces.misses(tip - press[:, None] * unit, unit, EDGE_RADIUS)
    k = np.argmin(np.hypot(misses[..., 0], misses[..., 1]), axis=1)
    here, miss = r.surfaces.select(k), -misses[every, k]
    off, edge = tip - here.centers, here.is_edge
    signed = np.sign(here.radii) * np.maximum(np.hypot(*off.T), 1e-9)
    inward = -np.where(edge[:, None], here.normals, off / signed[:, None])
    past = np.maximum(np.abs((off * here.tangents).sum(axis=1)) - here.halves, 0.0) * edge
    away = np.where(edge, (off * here.normals).sum(axis=1), signed) + past
    angle = wrap(np.arctan2(force[:, 1], force[:, 0]) - np.arctan2(inward[:, 1], inward[:, 0]))
    at = LoadedJoints(torque=tuple(torque.T), sense=tuple(rounded_sign(torque, _SIGN_WIDTH).T))
    moves = tip_by_parameters(p, links, force, 0.0, at)
    moves[..., G_EE] = 0.0
    by_distance = -np.einsum('nk,nkj->nj', inward, moves)
    by_distance[:, P_EE], by_distance[:, G_EE] = size, 1.0
    by_angle = np.einsum('nk,nkj->nj', quarter_turn(inward), moves) / np.where(edge, np.inf, signed)[:, None]
    by_angle[:, [THETA1, THETA2]] += float(r.tool)
    by = (np.column_stack([each, -r.joints[:, 0] * each[:, THETA2]]) for each in (by_distance, by_angle))
    distance = away - (here.radii - press)
    loss = np.log1p((distance / _Limits.distance) ** 2) + np.log1p((angle / _Limits.angle) ** 2)
    misfit = float(np.nan_to_num(loss.mean(), nan=np.inf))
    return _Agreement(values, here.object, distance, angle, miss, misfit, *by)


def _named(stated: _Agreement, tried: Sequence[tuple[Mistake, _Agreement]]) -> Mistake | None:
    """The mistake without which the touches agree, where they do not as stated; of those tried."""
    found = sorted(tried, key=lambda item: item[1].misfit)
    best = found[0][1].misfit if found else np.inf
    if best > min(_Limits.agrees, _Limits.part * stated.misfit):
        return None
    most = min(best + _Limits.alike, _Limits.part * stated.misfit)
    chosen = [item for item in found if item[1].misfit <= most]
    if len(chosen) > _Limits.named:
        return None
    fits = stated, chosen[0][1]
    before, after = (float(np.sqrt(np.mean(fit.distance**2))) for fit in fits)
    far, near = quantity(before, 'm'), quantity(after, 'm')
    evidence = f'as stated the touches miss the discs by {far}, without the mistake by {near}'
    if not before > max(10 * after, _Limits.gross_distance):
        before, after = (np.rad2deg(float(np.median(np.abs(fit.angle)))) for fit in fits)
        evidence = f'as stated the forces point {before:.0f}° beside the discs, without the mistake {after:.1f}°'
    said = (dict.fromkeys(getattr(one, what) for one, _ in chosen) for what in ('statement', 'action'))
    statement, action = map(', or '.join, said)
    in_cell = not any(one.where.startswith(('force', 'joint', 'fixed')) for one, _ in chosen)
    return Mistake(chosen[0][0].where, statement, action, evidence, in_cell, stated.misfit > _Limits.hopeless)


def _mislabelled(named: Indices, met: Indices, cell: Cell) -> Mistake | None:
    """Touches that name another object than the one they meet."""
    wrong = np.flatnonzero(named != met)
    if len(wrong) <= _Limits.mislabelled * len(named):
        return None
    a, b = (cell.discs[int(objects[wrong[0]])].name for objects in (named, met))
    statement = f'{len(wrong)} of {len(named)} touches name a wrong object, such as {a} where they meet {b}'
    action = 'correct the names, or leave them out: objects are found by place'
    return Mistake('object', statement, action, in_cell=False)


_Hypothesis = tuple[Mistake, _Reading]
"""A mistake that may have been made, and the reading without it."""


def _hypotheses(r: _Reading, cell: Cell, origin: Origin) -> Iterator[_Hypothesis]:
    """All mistakes that may have been made in a reading, but for a coupling of the joints."""
    yield from _of_sensor(r, cell, origin)
    yield from _of_joints(r, cell, origin)
    if cell.has_outlines:
        yield from _of_tip(r, cell)
    first = np.unique(r.surfaces.object, return_index=True)[1]  # of a disc its circle
    for mistake, mended in _of_discs(r, cell):
        places = mended.surfaces.select(first)
        if not layout_problems(cell, places.centers, places.radii):
            yield mistake, mended
    yield from _of_nominal(r)


def _applied(matrix: tuple[float, ...], pairs: Floats) -> Floats:
    """A matrix by rows applied to pairs, (n, 2)."""
    return pairs @ np.reshape(matrix, (2, 2)).T


_FORCES = (
    ((-1, 0, 0, -1), 'the sign of the force is wrong: it points away from the discs', 'change the signs of fx and fy'),
    ((0, 1, 1, 0), 'x and y of the force are swapped', 'exchange fx and fy'),
    ((-1, 0, 0, 1), 'x of the force has the wrong sign', 'change the sign of fx'),
    ((1, 0, 0, -1), 'y of the force has the wrong sign', 'change the sign of fy'),
    ((0, -1, 1, 0), 'the axes of the force sensor are turned by 90°', 'turn the forces by 90°'),
    ((0, 1, -1, 0), 'the axes of the force sensor are turned by -90°', 'turn the forces by -90°'),
)
"""Changes of the force by rows, with words for each."""
_JOINTS = (
    ((0, 1, 1, 0), 'the two joints are in the wrong order', 'exchange q1 and q2'),
    ((-1, 0, 0, 1), 'joint 1 turns the other way', 'change the sign of q1'),
    ((1, 0, 0, -1), 'joint 2 turns the other way', 'change the sign of q2'),
    ((-1, 0, 0, -1), 'both joints turn the other way', 'change the signs of q1 and q2'),
)
"""Changes of the joint angles by rows, with words for each."""
_PLACES = (
    ((0, 1, 1, 0), 'x and y are swapped', 'exchange the two numbers of center'),
    ((-1, 0, 0, 1), 'x has the wrong sign', 'change the sign of the first number of center'),
    ((1, 0, 0, -1), 'y has the wrong sign', 'change the sign of the second number of center'),
    ((-1, 0, 0, -1), 'x and y have the wrong sign', 'change the signs of center'),
)
"""Changes of the centres by rows, with words for each."""


def _of_sensor(r: _Reading, cell: Cell, origin: Origin) -> Iterator[_Hypothesis]:
    """Sign, frame and axes of the force sensor."""
    right, wrong = ('base', 'tool') if r.tool else ('tool', 'base')
    frame = f'the forces are in the {right} frame, not in the {wrong} frame'
    place, remedy = 'sensor.frame', f'set sensor.frame to {right}'
    if origin is Origin.TABLE:
        place, remedy = 'force', f'name the columns {"fx_N and fy_N" if r.tool else "fx_tool_N and fy_tool_N"}'
    yield Mistake(place, frame, remedy), r._replace(tool=not r.tool)
    for number, (matrix, statement, action) in enumerate(_FORCES):
        where, mended = 'force', r._replace(force=_applied(matrix, r.force))
        if number == 0 and origin is Origin.RECORDING:
            other = 'on_object' if cell.sensor.sign is SensorSign.ON_ROBOT else 'on_robot'
            where, action = 'sensor.sign', f'set sensor.sign to {other}'
        yield Mistake(where, statement, action), mended
        if number == 0:
            both = mended._replace(tool=not r.tool)
            yield Mistake(where, f'{frame}, and {statement}', f'{remedy}, and {action}'), both


def _of_joints(r: _Reading, cell: Cell, origin: Origin) -> Iterator[_Hypothesis]:
    """Order and senses of the joints."""
    for number, (matrix, statement, action) in enumerate(_JOINTS):
        where = 'joint angles'
        if origin is Origin.RECORDING and number == 0:
            where, action = 'robot.joint_names', f'set robot.joint_names to [{", ".join(reversed(cell.joint_names))}]'
        elif origin is not Origin.ARRAYS and number > 0:
            signs = [sign * turned for sign, turned in zip(cell.direction, matrix[::3], strict=True)]
            where, action = 'robot.direction', f'set robot.direction to {signs}'
        yield Mistake(where, statement, action), r._replace(joints=_applied(matrix, r.joints))


def _coupled(r: _Reading, cell: Cell, origin: Origin) -> Iterator[tuple[Mistake, _Agreement]]:
    """Joint 1 turns the reading of joint 2 as well, by the part with which the touches agree best."""
    free = np.append(r.free[:-1], 1.0)
    starts = (r._replace(nominal=np.append(r.nominal[:-1], part), free=free) for part in np.linspace(-2.0, 2.0, 21))
    fit = min(map(_fit, starts), key=lambda fit: fit.misfit)
    part = float(fit.parameters[-1])
    if abs(part) < _Limits.least_coupling:
        return
    ratio = round(part if origin is Origin.ARRAYS else cell.direction[0] * cell.direction[1] * part + cell.coupling, 4)
    statement = f'the reading of joint 2 contains {ratio:g} of that of joint 1'
    where, action = 'robot.coupling', f'set robot.coupling to {ratio:g}, better to the exact ratio of the drive'
    if abs(ratio - 1) < _Limits.least_coupling:
        ratio, statement = 1.0, 'joint 2 is measured from the base, not from link 1'
        action = 'set robot.coupling to 1'
    if abs(ratio) < _Limits.least_coupling:
        statement, action = 'the reading of joint 2 does not contain that of joint 1', 'leave out robot.coupling'
    if origin is Origin.ARRAYS:
        where, action = 'joint angles', f'give q2 less {ratio:g} q1 for q2'
    yield Mistake(where, statement, action), fit


def _of_discs(r: _Reading, cell: Cell) -> Iterator[_Hypothesis]:
    """Axes of the centres, diameters for radii, of all discs or of one; radii at the wrong discs."""
    centers, radii, own = r.surfaces.centers, r.surfaces.radii, r.surfaces.object
    round_ones = [(d, disc.name) for d, disc in enumerate(cell.discs) if not isinstance(disc, Outline)]
    each = [(f'objects: {name}', name, own == d) for d, name in round_ones]
    every = [('objects', 'every disc', np.isin(own, [d for d, _ in round_ones]))]
    for where, name, here in [*every[: len(each) > 1], *each]:
        for matrix, statement, action in _PLACES:
            moved = np.where(here[:, None], _applied(matrix, centers), centers)
            if np.abs(moved - centers).max() > _Limits.same_length:
                which = 'centers of all discs' if where == 'objects' else f'center of {name}'
                yield Mistake(where, f'{statement} in the {which}', action), r.with_surfaces(centers=moved)
        value = float(radii[here][0])
        stated, halved = ('', 'halve it') if where == 'objects' else (f' {value:g}', f'set it to {0.5 * value:g}')
        halved += ' and add the radius of the tip if it is not contained'
        for factor, statement, action in (
            (0.5, f'radius{stated} is the diameter of {name}', halved),
            (2.0, f'radius of {name} is half of what it should be', 'double it'),
        ):
            yield Mistake(where, statement, action), r.with_surfaces(radii=np.where(here, factor * radii, radii))
    for (i, one), (j, other) in combinations(round_ones, 2):
        first, second = own == i, own == j
        if abs(radii[first][0] - radii[second][0]) > _Limits.same_length:
            swapped = np.where(first, radii[second][0], np.where(second, radii[first][0], radii))
            statement = f'the radii, or the centers, of {one} and {other} are swapped'
            yield Mistake('objects', statement, 'exchange them'), r.with_surfaces(radii=swapped)


def _of_tip(r: _Reading, cell: Cell) -> Iterator[_Hypothesis]:
    """A diameter for the radius of the tip, or none: it displaces the edges and corners of outlines."""
    is_outline = np.array([isinstance(disc, Outline) for disc in cell.discs])[r.surfaces.object]
    corner, edge = is_outline & ~r.surfaces.is_edge, r.surfaces.is_edge[:, None] * r.surfaces.normals
    tip = cell.tip_radius or 0.0
    changes = [('radius of the tip is its diameter', 'halve it', -0.5 * tip)]
    if tip < _Limits.least_tip:  # what is left of it is a backlash
        changes += [('the radius of the tip is missing', 'measure it, m', size) for size in (2e-3, 5e-3, 1e-2)]
    for statement, action, more in changes:
        mended = r.with_surfaces(radii=r.surfaces.radii + more * corner, centers=r.surfaces.centers + more * edge)
        yield Mistake('tip.radius', statement, action), mended


def _displaced(r: _Reading, stated: _Agreement, cell: Cell) -> Iterator[tuple[Mistake, _Agreement]]:
    """Each of three discs or more displaced by the median miss of its touches, again and again as the fit follows."""
    for number, disc in enumerate(cell.discs if len(cell.discs) > 2 else ()):
        mended, found = r, stated
        own = r.surfaces.object == number
        for _ in range(4):
            miss = found.miss[found.object == number]
            off = np.median(miss, axis=0) if len(miss) else np.zeros(2)
            mended = mended.with_surfaces(centers=mended.surfaces.centers - own[:, None] * off)
            found = _fit(mended)
        far = np.hypot(*(mended.surfaces.centers - r.surfaces.centers)[own][0]) / MILLI
        statement = f'{disc.name} stands about {far:.0f} mm from where it is stated'
        yield Mistake(f'objects: {disc.name}', statement, f'measure the place of {disc.name} again'), found


def _of_nominal(r: _Reading) -> Iterator[_Hypothesis]:
    """Lengths of links and offsets of joints in the nominal parameters; values at which a parameter is held."""

    def mended(where: str, statement: str, action: str, at: list[int], value: Floats) -> _Hypothesis:
        nominal = r.nominal.copy()
        nominal[at] = value
        return Mistake(where, statement, action), r._replace(nominal=nominal)

    lengths, offsets = [L1, L2], [THETA1, THETA2]
    if abs(np.diff(r.nominal[lengths])[0]) > _Limits.same_length and r.free[lengths].all():
        statement = 'the lengths of the two links are swapped'
        yield mended('robot.nominal: l1, l2', statement, 'exchange them', lengths, r.nominal[lengths[::-1]])
    for j, quarters in product(offsets, (1, 2, -1)) if r.free[offsets].all() else ():
        right = wrap(r.nominal[[j]] + quarters * np.pi / 2)
        statement, action = f'the offset {NAMES[j]} is wrong by {90 * quarters}°', f'give {right[0]:.2f} rad'
        yield mended(f'robot.nominal.{NAMES[j]}', statement, action, [j], right)
    for some in (offsets[:1], offsets[1:], offsets) if r.free[offsets].all() else ():
        right = np.deg2rad(r.nominal[some])
        if right.all():
            stated, action = (
                ' and '.join(f'{NAMES[j]}: {value:.6g}' for j, value in zip(some, each, strict=True))
                for each in (r.nominal[some], right)
            )
            yield mended('robot.nominal', f'{stated}: in degrees, not in rad', f'set {action}', some, right)
    for j in np.flatnonzero(r.free[:-1] == 0).tolist():
        name, free = NAMES[j], np.where(np.arange(len(r.free)) == j, 1.0, r.free)
        statement = f'the fixed value {r.nominal[j]:g} {UNITS[name]} of {name} contradicts the touches'
        yield Mistake(f'fixed {name}', statement, 'correct it, or leave the parameter free'), r._replace(free=free)
