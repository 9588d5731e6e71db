"""The mistakes that people make in a cell description or in touches, each as a change that would mend it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from enum import Enum
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.parameters import L1, L2, NAMES, THETA1, THETA2, UNITS

_STEP = 30
"""Rotations of sensor and base are tried in steps of so many degrees,"""
_ROTATION = float(np.deg2rad(12.0))
"""and fitted about each with this standard deviation, rad."""
_ALIKE = 1e-3
"""Lengths that differ by less than this are not worth swapping, m."""


class Origin(Enum):
    """What holds the touches: it decides on what in them is as the cell description says.

    In a recording that is frame and sign of the force, in arrays the frame; a table has the force on the object in the
    base frame.
    """

    RECORDING = 'recording'
    TABLE = 'table'
    ARRAYS = 'arrays'


class Reading(NamedTuple):
    """One way to read the touches and the cell; n touches, m discs.

    Attributes:
        joints: Q, (n, 2), rad.
        force: F on the object, in the frame of the sensor, (n, 2), N.
        tool: whether that frame turns with link 2.
        centers: of the discs, (m, 2), m.
        radii: of the discs, (m,), m.
        nominal: the twelve parameters, (12,).
        free: which of them are fitted, (12,), 1 or 0.
        rotation: standard deviation of an unknown rotation of the sensor, rad; 0 for none.
    """

    joints: Floats
    force: Floats
    tool: bool
    centers: Floats
    radii: Floats
    nominal: Floats
    free: Floats
    rotation: float = 0.0


class Source(NamedTuple):
    """Where the touches come from, which decides on what the remedy is.

    Attributes:
        origin: what holds them.
        tool: whether forces are in the frame of link 2.
        on_robot: whether the cell description says that the sensor reports the force on the robot.
        discs: names of the discs.
        joint_names: of q1 and q2.
    """

    origin: Origin
    tool: bool
    on_robot: bool
    discs: tuple[str, ...]
    joint_names: tuple[str, str]


class Hypothesis(NamedTuple):
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


def hypotheses(reading: Reading, source: Source) -> list[Hypothesis]:
    """All mistakes that may have been made in a reading."""
    kinds: tuple[Callable[[Reading, Source], Iterator[Hypothesis]], ...] = (
        _sensors,
        _joints,
        _discs,
        _radii,
        _nominal,
        _fixed,
    )
    return [item for kind in kinds for item in kind(reading, source)]


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


def _sensors(r: Reading, source: Source) -> Iterator[Hypothesis]:
    """Sign, frame, axes and rotation of the force sensor."""
    for tool in (r.tool, not r.tool):
        for matrix, statement, action in _FORCES:
            yield _sensor(r, source, tool, np.reshape(matrix, (2, 2)), statement, action)
        if tool != r.tool:
            yield _sensor(r, source, tool, np.eye(2), '', '')
        for degrees in range(_STEP, 360, _STEP):
            if degrees != 180:
                yield _turned(r, source, tool, degrees)


def _sensor(r: Reading, source: Source, tool: bool, matrix: Floats, statement: str, action: str) -> Hypothesis:
    mended = r._replace(tool=tool, force=r.force @ matrix.T)
    flipped, plain = bool(np.array_equal(matrix, -np.eye(2))), not statement
    recorded = source.origin is Origin.RECORDING
    if (recorded and (flipped or plain)) or (source.origin is Origin.ARRAYS and plain):
        return _convention(r, source, mended, flipped)
    action = f'let the driver of the sensor {action}' if recorded else action
    if tool == r.tool:
        return Hypothesis('sensor' if recorded else 'force', statement, action, mended)
    frames = _frames(tool)
    both = f'the forces are in the {frames[0]} frame, not in the {frames[1]} frame'
    statement = f'{both}, and {statement}' if statement else both
    if source.origin is Origin.TABLE:
        return Hypothesis('force', statement, 'give the force on the object in the base frame', mended, common=plain)
    action = f'set sensor.frame to {frames[0]}, and {action}'
    return Hypothesis('sensor.frame', statement, action, mended, common=plain)


def _frames(tool: bool) -> tuple[str, str]:
    return ('tool', 'base') if tool else ('base', 'tool')


def _convention(r: Reading, source: Source, mended: Reading, flipped: bool) -> Hypothesis:
    """Another frame or sign of the cell description's sensor."""
    changed = []
    if mended.tool != r.tool:
        changed.append(('frame', *reversed(_frames(mended.tool))))
    if flipped:
        signs = ('on_robot', 'on_object') if source.on_robot else ('on_object', 'on_robot')
        changed.append(('sign', *signs))
    keys = ', '.join(f'sensor.{key}' for key, _, _ in changed)
    statement = ' and '.join(f'the {key} of the sensor is {right!r}, not {stated!r}' for key, stated, right in changed)
    action = 'set ' + ' and '.join(f'sensor.{key} to {right}' for key, _, right in changed)
    return Hypothesis(keys, statement, action, mended)


def _turned(r: Reading, source: Source, tool: bool, degrees: int) -> Hypothesis:
    angle = float(np.deg2rad(degrees))
    c, s = np.cos(angle), np.sin(angle)
    mended = r._replace(tool=tool, force=r.force @ np.array([[c, s], [-s, c]]), rotation=_ROTATION)
    frame = '' if tool == r.tool else f', in the {_frames(tool)[0]} frame'
    where = 'sensor' if source.origin is Origin.RECORDING else 'force'
    statement = f'the axes of the force sensor are turned by {{rotation}}{frame}'
    return Hypothesis(where, statement, 'turn the forces by {rotation}', mended, rotation=angle, common=degrees == 90)


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


def _joints(r: Reading, source: Source) -> Iterator[Hypothesis]:
    """Order, sense and unit of the joint angles."""
    for number, (matrix, statement, action) in enumerate(_JOINTS):
        mended, where = r._replace(joints=r.joints @ np.reshape(matrix, (2, 2)).T), 'joint angles'
        if source.origin is Origin.RECORDING and number == 0:
            where, names = 'robot.joint_names', ', '.join(reversed(source.joint_names))
            action = f'set robot.joint_names to [{names}]'
        elif source.origin is Origin.RECORDING:
            action = f'let the driver of the joints {action}'
        yield Hypothesis(where, statement, action, mended, common=number < 4)
    for factor, statement, action in _UNITS:
        yield Hypothesis('joint angles', statement, action, r._replace(joints=r.joints * factor))
    for place in (0, 1):
        scale = np.where(np.arange(2) == place, np.deg2rad(1.0), 1.0)
        statement = f'the angle of joint {place + 1} is in degrees, not in rad'
        yield Hypothesis('joint angles', statement, f'give q{place + 1} in rad', r._replace(joints=r.joints * scale))


_PLACES = (
    ((0.0, 1.0, 1.0, 0.0), 'x and y are swapped', 'exchange the two numbers of center'),
    ((-1.0, 0.0, 0.0, 1.0), 'x has the wrong sign', 'change the sign of the first number of center'),
    ((1.0, 0.0, 0.0, -1.0), 'y has the wrong sign', 'change the sign of the second number of center'),
    ((-1.0, 0.0, 0.0, -1.0), 'x and y have the wrong sign', 'change the signs of center'),
)
"""Changes of the centres by rows, with words for each."""


def _discs(r: Reading, source: Source) -> Iterator[Hypothesis]:
    """Axes of the centres of all discs, or of one."""
    m = len(r.centers)
    for matrix, statement, action in _PLACES:
        moved = r.centers @ np.reshape(matrix, (2, 2)).T
        of_all = f'{statement} in the centers of all discs' if m > 1 else f'{statement} in the center of the disc'
        yield Hypothesis('objects', of_all, f'{action} of every disc' if m > 1 else action, r._replace(centers=moved))
        for d in range(m) if m > 1 else ():
            centers = np.where((np.arange(m) == d)[:, None], moved, r.centers)
            if np.abs(centers - r.centers).max() > _ALIKE:
                name = source.discs[d]
                yield Hypothesis(
                    f'objects: {name}', f'{statement} in the center of {name}', action, r._replace(centers=centers)
                )


def _radii(r: Reading, source: Source) -> Iterator[Hypothesis]:
    """Diameters for radii, and radii at the wrong discs."""
    m, names = len(r.radii), source.discs
    for factor, word, action in (
        (0.5, 'radius is the diameter of {}', 'halve it and add the radius of the tip if it is not contained'),
        (2.0, 'radius of {} is half of what it should be', 'double it'),
    ):
        every = word.format('every disc' if m > 1 else 'the disc')
        yield Hypothesis('objects', every, action, r._replace(radii=r.radii * factor))
        for d in range(m) if m > 1 else ():
            radii = np.where(np.arange(m) == d, factor * r.radii, r.radii)
            where = f'objects: {names[d]}'
            yield Hypothesis(where, word.format(names[d]), action, r._replace(radii=radii))
    for order in _orders(m):
        radii = r.radii[order]
        moved = tuple(d for d in range(m) if abs(radii[d] - r.radii[d]) > _ALIKE)
        if moved and all(order[d] == d for d in range(m) if d not in moved):
            statement = exchanged('radii', moved, names)
            yield Hypothesis('objects', statement, 'exchange them', r._replace(radii=radii), discs=moved)


def _orders(m: int) -> list[Indices]:
    """Permutations of m discs but the identity: all of few, the pairs of many."""
    # 4: of so many discs every permutation is tried, of more only the pairs
    if m <= 4:
        return [np.array(order) for order in permutations(range(m)) if order != tuple(range(m))]
    orders = [np.arange(m) for _ in combinations(range(m), 2)]
    for order, (i, j) in zip(orders, combinations(range(m), 2), strict=True):
        order[[i, j]] = j, i
    return orders


def exchanged(what: str, discs: Sequence[int], names: Sequence[str]) -> str:
    """That radii or centers stand at the wrong discs, one clause."""
    how = 'swapped' if len(discs) == 2 else 'in the wrong order'
    return f'the {what} of {listed([names[d] for d in discs])} are {how}'


def listed(names: Sequence[str]) -> str:
    """Names in a sentence."""
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'


def _nominal(r: Reading, source: Source) -> Iterator[Hypothesis]:
    """Offsets of joints and lengths of links in the nominal parameters."""
    # 0.1: an offset of a joint above this may be one in degrees, rad
    angles = [j for j in (THETA1, THETA2) if abs(r.nominal[j]) > 0.1]
    if angles and r.free[angles].all():
        where = ', '.join(f'robot.nominal.{NAMES[j]}' for j in angles)
        nominal = r.nominal.copy()
        nominal[angles] = np.deg2rad(nominal[angles])
        yield Hypothesis(where, 'the angle is in degrees, not in rad', 'give it in rad', r._replace(nominal=nominal))
    if abs(r.nominal[L1] - r.nominal[L2]) > _ALIKE and r.free[[L1, L2]].all():
        nominal = r.nominal.copy()
        nominal[[L1, L2]] = nominal[[L2, L1]]
        statement = 'the lengths of the two links are swapped'
        yield Hypothesis('robot.nominal: l1, l2', statement, 'exchange them', r._replace(nominal=nominal))
    for j in (THETA1, THETA2) if r.free[[THETA1, THETA2]].all() else ():
        for degrees in range(_STEP, 360, _STEP):
            nominal = r.nominal.copy()
            nominal[j] += np.deg2rad(degrees)
            by = degrees if degrees <= 180 else degrees - 360
            statement = f'the offset of joint {j // 2} is wrong by about {by}°'
            action = f'give {NAMES[j]} in rad, about {np.arctan2(np.sin(nominal[j]), np.cos(nominal[j])):.2f}'
            where = f'robot.nominal.{NAMES[j]}'
            yield Hypothesis(where, statement, action, r._replace(nominal=nominal), common=degrees in (90, 180, 270))


def _fixed(r: Reading, source: Source) -> Iterator[Hypothesis]:
    """Values at which a parameter is held."""
    for j in np.flatnonzero(r.free == 0):
        free = r.free.copy()
        free[j] = 1.0
        name, value = NAMES[j], r.nominal[j]
        statement = f'the fixed value {value:g} {UNITS[name]} of {name} contradicts the touches'
        yield Hypothesis(f'fixed {name}', statement, 'correct it, or leave the parameter free', r._replace(free=free))
