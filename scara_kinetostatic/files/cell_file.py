"""The cell description as a file: `cell.yaml` to `Cell` and back.

Everything that makes no sense is refused with one line that names the key:
unknown keys, wrong types, impossible values, discs that overlap or cannot be
reached. Distances are judged on the touch circles (disc centre to TIP centre,
as `radius` is defined):

- two circles that cross are an error, since at the crossing the tip would
  touch both discs and no touch there could be told apart;
- a circle around the robot's base is an error, since the robot stands there;
- a circle wholly outside the nominal reach, |l1 - l2| to l1 + l2 from the
  base, is an error, since it could never be touched.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.files.yaml_text import parse_yaml, read_text
from scara_kinetostatic.model.cell import Cell, Disc, GripperSign, Noise, Sensor
from scara_kinetostatic.model.parameters import NAMES, UNITS, Parameters

CELL_TOPIC = '/cell_description'
"""Topic on which the cell description travels in a recording, `std_msgs/msg/String`."""

_TOPIC = re.compile(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z')
_LARGEST = {'m': 100.0, 'rad': 2 * math.pi, 'm/N': 1.0, 'rad/Nm': 1.0}
_HINT = {'m': 'lengths are in m, not mm', 'rad': 'angles are in rad, not degrees'}
_BELIEVABLE = ((1e-15, 1e-2), (1e-12, 100.0))
"""Noise of one touch, from and to: joint angle, rad, and force, N."""
_LONGEST_NAME = 200
_E = TypeVar('_E', bound=Enum)


def load_cell(path: str | Path) -> Cell:
    """Read a cell description.

    Raises:
        CellError: the file cannot be read, or says something senseless.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> [disc.name for disc in cell.discs]
        ['disc_1', 'disc_2', 'disc_3']
        >>> cell.nominal.l1
        0.33
    """
    return parse_cell(read_text(path, CellError), path)


def parse_cell(text: str, where: str | Path = 'cell description') -> Cell:
    """The cell that a YAML text describes.

    Args:
        text: the YAML, in the form of `config/cell.yaml`.
        where: the file it comes from, for messages.

    Raises:
        CellError: the text is no YAML, or says something senseless.
    """
    data = parse_yaml(text, where, CellError)
    top = _Section(str(where), '', data, required=('robot', 'objects'), optional=('sensor', 'noise', 'model'))
    robot = top.section('robot', required=('nominal',), optional=('joint_names',))
    model = top.section('model', optional=('gripper_sign', 'gripper_excess'))
    nominal = _nominal(robot)
    cell = Cell(
        nominal=nominal,
        discs=_discs(top),
        joint_names=_joint_names(robot),
        sensor=_sensor(top.section('sensor', optional=('joint_states', 'wrench', 'frame', 'sign'))),
        noise=_noise(top),
        gripper_sign=model.choice('gripper_sign', GripperSign.PHYSICAL),
        gripper_excess=_excess(model),
    )
    _check_layout(cell, top)
    return cell


def dump_cell(cell: Cell) -> str:
    """The YAML text of a cell; `parse_cell` gives the same cell back."""
    sensor = cell.sensor
    lines = [
        'robot:',
        f'  joint_names: {_flow(list(cell.joint_names))}',
        f'  nominal: {_flow(cell.nominal.as_dict())}',
        'objects:',
        *(f'  - {_flow({"name": d.name, "center": [d.x, d.y], "radius": d.radius})}' for d in cell.discs),
        'sensor:',
        f'  joint_states: {_flow(sensor.joint_states)}',
        f'  wrench: {_flow(sensor.wrench)}',
        f'  frame: {sensor.frame.value}',
        f'  sign: {sensor.sign.value}',
    ]
    if cell.noise is not None:
        lines.append(f'noise: {_flow({"joint": cell.noise.joint, "force": cell.noise.force})}')
    model: dict[str, Any] = {'gripper_sign': cell.gripper_sign.value}
    if not cell.gripper.isotropic:
        model['gripper_excess'] = [list(row) for row in cell.gripper_excess]
    lines.append(f'model: {_flow(model)}')
    return '\n'.join(lines) + '\n'


class _Section:
    """One mapping of the file, with its place, so that every complaint names the key."""

    def __init__(
        self, where: str, key: str, data: Any, required: Iterable[str] = (), optional: Iterable[str] = ()
    ) -> None:
        self.where = where
        self.key = key
        required, known = tuple(required), (*required, *optional)
        if data is None and not required:
            data = {}
        if not isinstance(data, Mapping):
            raise self.error('', f'expected a mapping with {_listed(known)}, got {_shown(data)}')
        self.data = data
        for name in data:
            if name not in known:
                close = difflib.get_close_matches(name, known, 1)
                remedy = f'did you mean {close[0]!r}?' if close else f'the keys here are {_listed(known)}'
                raise self.error('', f'unknown key {name!r}', remedy)
        for name in required:
            if data.get(name) is None:
                raise self.error('', f'the key {name!r} is missing', 'add it')

    def error(self, name: str, problem: str, remedy: str = '') -> CellError:
        """An error that names the key."""
        key = '.'.join(part for part in (self.key, name) if part)
        return CellError(f'{self.where}: {key}' if key else self.where, problem, remedy)

    def section(self, name: str, required: Iterable[str] = (), optional: Iterable[str] = ()) -> _Section:
        """A mapping inside this one."""
        key = '.'.join(part for part in (self.key, name) if part)
        return _Section(self.where, key, self.data.get(name), required, optional)

    def number(self, name: str, unit: str = '') -> float:
        """A finite number of a believable size."""
        value = self.data[name]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(name, f'expected a number, got {_shown(value)}')
        if not math.isfinite(value):
            raise self.error(name, f'expected a finite number, got {value}')
        if abs(value) > _LARGEST.get(unit, math.inf):
            problem = f'expected at most {_LARGEST[unit]:.4g} {unit} in size, got {_shown(value)}'
            raise self.error(name, problem, _HINT.get(unit, 'give it in SI units'))
        return float(value)

    def positive(self, name: str, unit: str = '') -> float:
        """A number above zero."""
        value = self.number(name, unit)
        if value <= 0:
            raise self.error(name, f'expected a number above 0, got {value:g}')
        return value

    def word(self, name: str, default: str) -> str:
        """A string that is not empty."""
        value = self.data.get(name, default)
        if not isinstance(value, str):
            raise self.error(name, f'expected a string, got {_shown(value)}', 'put it in quotes')
        if not value.strip() or value != value.strip() or not value.isprintable():
            raise self.error(name, f'expected a name, got {_shown(value)}')
        if len(value) > _LONGEST_NAME:
            raise self.error(name, f'expected at most {_LONGEST_NAME} characters, got {len(value)}')
        return value

    def choice(self, name: str, default: _E) -> _E:
        """One value of an enumeration."""
        value = self.word(name, str(default.value))
        choices = [str(item.value) for item in type(default)]
        if value not in choices:
            raise self.error(name, f'expected {" or ".join(choices)}, got {_shown(value)}')
        return type(default)(value)


def _nominal(robot: _Section) -> Parameters:
    section = robot.section('nominal', required=NAMES)
    values = {name: section.number(name, UNITS[name]) for name in NAMES}
    for name in ('l1', 'l2'):
        section.positive(name, 'm')
    for name in ('p_ee', 'p1', 'p2', 'g_ee', 'g1', 'g2'):
        if values[name] < 0:
            raise section.error(name, f'expected 0 or more, got {values[name]:g}')
    return Parameters.from_mapping(values)


def _joint_names(robot: _Section) -> tuple[str, str]:
    names = robot.data.get('joint_names', ['joint1', 'joint2'])
    two = isinstance(names, list) and len(names) == 2
    if not two or not all(isinstance(name, str) and name.strip() and name.isprintable() for name in names):
        raise robot.error('joint_names', f'expected the two names of q1 and q2 in JointState, got {_shown(names)}')
    if names[0] == names[1]:
        raise robot.error('joint_names', f'both joints are named {names[0]!r}', 'name q1 and q2 as JointState does')
    return names[0], names[1]


def _discs(top: _Section) -> tuple[Disc, ...]:
    items = top.data['objects']
    if not isinstance(items, list) or not items:
        raise top.error('objects', f'expected a list of discs, got {_shown(items)}', 'give at least one')
    discs: list[Disc] = []
    for number, item in enumerate(items):
        section = _Section(top.where, f'objects[{number}]', item, required=('name', 'center', 'radius'))
        name = section.word('name', '')
        if name in (disc.name for disc in discs):
            raise section.error('name', f'another disc is named {name!r}, too', 'give every disc its own name')
        discs.append(Disc(name, *_center(section), section.positive('radius', 'm')))
    return tuple(discs)


def _center(section: _Section) -> tuple[float, float]:
    center = section.data['center']
    if not isinstance(center, list) or len(center) != 2:
        raise section.error('center', f'expected [x, y], got {_shown(center)}')
    pair = _Section(section.where, f'{section.key}.center', dict(zip('xy', center, strict=True)), optional='xy')
    return pair.number('x', 'm'), pair.number('y', 'm')


def _excess(section: _Section) -> tuple[tuple[float, float], tuple[float, float]]:
    """P - p_ee I of the general gripper, by rows."""
    rows = section.data.get('gripper_excess')
    if rows is None:
        return ((0.0, 0.0), (0.0, 0.0))
    if not isinstance(rows, list) or len(rows) != 2 or not all(isinstance(row, list) and len(row) == 2 for row in rows):
        raise section.error('gripper_excess', f'expected [[e11, e12], [e21, e22]], got {_shown(rows)}')
    entries = {f'e{i}{j}': rows[i - 1][j - 1] for i in (1, 2) for j in (1, 2)}
    matrix = _Section(section.where, f'{section.key}.gripper_excess', entries, optional=tuple(entries))
    e11, e12, e21, e22 = (matrix.number(name, 'm/N') for name in entries)
    return ((e11, e12), (e21, e22))


def _sensor(section: _Section) -> Sensor:
    default = Sensor()
    topics = {name: section.word(name, getattr(default, name)) for name in ('joint_states', 'wrench')}
    for name, topic in topics.items():
        if not _TOPIC.match(topic):
            raise section.error(name, f'{topic!r} is no name of a topic', f'write it like {getattr(default, name)}')
        topics[name] = '/' + topic.lstrip('/')
    if topics['joint_states'] == topics['wrench']:
        raise section.error('wrench', f'both topics are named {topics["wrench"]}', 'they carry different messages')
    for name, topic in topics.items():
        if topic == CELL_TOPIC:
            raise section.error(name, f'{CELL_TOPIC} carries the cell description', 'choose another topic')
    return Sensor(
        topics['joint_states'],
        topics['wrench'],
        section.choice('frame', default.frame),
        section.choice('sign', default.sign),
    )


def _noise(top: _Section) -> Noise | None:
    if top.data.get('noise') is None:
        return None
    section = top.section('noise', required=('joint', 'force'))
    noise = Noise(section.positive('joint', 'rad'), section.positive('force'))
    for key, value, (least, most), unit in zip(noise._fields, noise, _BELIEVABLE, ('rad', 'N'), strict=True):
        if not least <= value <= most:
            problem = f'expected {least:g} to {most:g} {unit}, got {value:g}'
            raise section.error(key, problem, 'give the repeatability of one touch, or leave out noise')
    return noise


def _check_layout(cell: Cell, top: _Section) -> None:
    """Whether every disc can be touched, and touched alone."""
    base = np.array([cell.nominal.x0, cell.nominal.y0])
    farthest, nearest = cell.nominal.l1 + cell.nominal.l2, abs(cell.nominal.l1 - cell.nominal.l2)
    remedy = 'check center and radius (in m, to the centre of the tip)'
    for disc, away in zip(cell.discs, np.linalg.norm(cell.centers - base, axis=1), strict=True):
        if away <= disc.radius:
            raise top.error('objects', f'disc {disc.name!r} lies over the base of the robot', remedy)
        if away - disc.radius > farthest or away + disc.radius < nearest:
            problem = f'disc {disc.name!r} is out of reach, {away:.4g} m from the base'
            raise top.error('objects', f'{problem} where the tip reaches {nearest:.4g} to {farthest:.4g} m', remedy)
    for i, disc in enumerate(cell.discs[1:], start=1):
        gaps = np.linalg.norm(cell.centers[:i] - cell.centers[i], axis=1) - cell.radii[:i] - disc.radius
        worst = int(np.argmin(gaps))
        if gaps[worst] < 0:
            both = f'discs {cell.discs[worst].name!r} and {disc.name!r}'
            raise top.error('objects', f'{both} overlap by {-gaps[worst]:.4g} m', remedy)


def _flow(value: Any) -> str:
    text: str = yaml.safe_dump(value, default_flow_style=True, width=math.inf, sort_keys=False, allow_unicode=True)
    return text.removesuffix('\n').removesuffix('\n...')


def _listed(names: Iterable[str]) -> str:
    return ', '.join(names)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + '...'
