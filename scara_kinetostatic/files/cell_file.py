"""The cell description as a file: `cell.yaml` to `Cell` and back.

Each section of the file has a function here that reads it. What is not valid is refused with one line that names the
key: unknown keys, wrong types, impossible values, discs that overlap or cannot be reached. The layout is checked on
the contact circles (radius: disc centre to TIP centre):

- two circles that intersect are an error: the tip would touch both discs there;
- a circle around the robot's base is an error;
- a circle outside the nominal reach, |l1 - l2| to l1 + l2 from the base, is an error: it cannot be touched.
"""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import yaml

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.files.declared_uncertainty import (
    COMMON,
    disc_entry,
    read_optional,
    read_plates,
    read_stds,
    read_tolerance,
    read_uncertainty,
    uncertainty_entries,
)
from scara_kinetostatic.files.noise_section import parse_noise
from scara_kinetostatic.files.yaml_section import Section, shown
from scara_kinetostatic.files.yaml_text import parse_yaml, read_text
from scara_kinetostatic.model.cell import Cell, Disc, GripperSign, Identification, Plate, Sensor, layout_problems
from scara_kinetostatic.model.parameters import NAMES, UNITS, Parameters

CELL_TOPIC = '/cell_description'
"""Topic of the cell description in a recording, `std_msgs/msg/String`."""

_TOPIC = re.compile(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z')


def load_cell(path: str | Path) -> Cell:
    """Reads a cell description.

    Args:
        path: the file.

    Raises:
        CellError: the file cannot be read, or its content is not valid.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> [disc.name for disc in cell.discs]
        ['disc_1', 'disc_2', 'disc_3']
        >>> cell.nominal.l1
        0.33
    """
    if not isinstance(path, (str, Path)):
        raise CellError('path', f'expected the path of a file, got {type(path).__name__}', 'give such as cell.yaml')
    return parse_cell(read_text(path, CellError), path)


def parse_cell(text: str, where: str | Path = 'cell description') -> Cell:
    """The cell that a YAML text describes.

    Args:
        text: the YAML, in the form of `config/cell.yaml`.
        where: the file, for messages.

    Raises:
        CellError: the text is not YAML, or its content is not valid.
    """
    return read_cell(parse_yaml(text, where, CellError), where)


def read_cell(data: Any, where: str | Path, *, check_layout: bool = True) -> Cell:
    """The cell of a parsed description.

    Args:
        data: as `parse_yaml` gives it.
        where: the file, for messages.
        check_layout: whether to refuse discs that cannot be touched.

    Raises:
        CellError: the content is not valid.
    """
    optional = ('sensor', 'noise', 'model', 'plates', 'uncertainty', 'tolerance', 'tip', 'gravity', 'identification')
    top = Section(CellError, str(where), '', data, ('robot', 'objects'), optional)
    robot = top.section('robot', ('nominal',), ('joint_names',))
    model = top.section('model', (), ('gripper_sign', 'gripper_excess'))
    plates = read_plates(top)
    cell = Cell(
        nominal=_nominal(robot),
        discs=_discs(top, plates),
        joint_names=_joint_names(robot),
        sensor=_sensor(top.section('sensor', (), ('joint_states', 'wrench', 'frame', 'sign', 'time_offset'))),
        noise=parse_noise(top),
        gripper_sign=model.choice('gripper_sign', GripperSign.PHYSICAL),
        gripper_excess=_excess(model),
        plates=plates,
        uncertainty=read_uncertainty(top.section('uncertainty', (), (*COMMON, 'nominal'))),
        tolerance=read_tolerance(top),
        tip_radius=read_optional(top.section('tip', (), ('radius',)), 'radius'),
        identification=_identification(top.section('identification', (), Identification._fields)),
    )
    _check_gravity(top)
    if check_layout:
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
        *(f'  - {_flow(disc_entry(disc))}' for disc in cell.discs),
        'sensor:',
        f'  joint_states: {_flow(sensor.joint_states)}',
        f'  wrench: {_flow(sensor.wrench)}',
        f'  frame: {sensor.frame.value}',
        f'  sign: {sensor.sign.value}',
        *([] if sensor.time_offset is None else [f'  time_offset: {_flow(sensor.time_offset)}']),
    ]
    if cell.noise is not None:
        lines.append(f'noise: {_flow(cell.noise.as_dict(as_stated=True))}')
    model: dict[str, Any] = {'gripper_sign': cell.gripper_sign.value}
    if not cell.gripper.isotropic:
        model['gripper_excess'] = [list(row) for row in cell.gripper_excess]
    lines.append(f'model: {_flow(model)}')
    lines += [f'{key}: {_flow(value)}' for key, value in uncertainty_entries(cell).items()]
    if given := cell.identification.given():
        lines.append(f'identification: {_flow(given)}')
    return '\n'.join(lines) + '\n'


def _nominal(robot: Section) -> Parameters:
    section = robot.section('nominal', NAMES)
    read = dict.fromkeys(NAMES, section.number)
    read |= dict.fromkeys(('l1', 'l2'), section.positive)
    read |= dict.fromkeys(('p_ee', 'p1', 'p2', 'g_ee', 'g1', 'g2'), section.not_negative)
    return Parameters.from_mapping({name: read[name](name, UNITS[name]) for name in NAMES})


def _joint_names(robot: Section) -> tuple[str, str]:
    names = robot.data.get('joint_names', ['joint1', 'joint2'])
    two = isinstance(names, list) and len(names) == 2
    if not two or not all(isinstance(name, str) and name.strip() and name.isprintable() for name in names):
        raise robot.error('joint_names', f'expected the two names of q1 and q2 in JointState, got {shown(names)}')
    if names[0] == names[1]:
        raise robot.error('joint_names', f'both joints are named {names[0]!r}', 'name q1 and q2 as JointState does')
    return names[0], names[1]


def _check_gravity(top: Section) -> None:
    if top.data.get('gravity') is not None and any(top.vector('gravity', ('x', 'y'))):
        raise top.error('gravity', 'an upright arm is not supported', 'give [0.0, 0.0]')


def _discs(top: Section, plates: tuple[Plate, ...]) -> tuple[Disc, ...]:
    discs: list[Disc] = []
    known = [plate.name for plate in plates]
    for section in top.items('objects', 'discs', ('name', 'center', 'radius'), ('uncertainty', 'plate')):
        name = section.word('name')
        if name in (disc.name for disc in discs):
            raise section.error('name', f'another disc is named {name!r}, too', 'give every disc its own name')
        x, y = section.vector('center', ('x', 'y'), 'm')
        radius = section.positive('radius', 'm')
        plate = '' if section.data.get('plate') is None else section.word('plate')
        if plate and plate not in known:
            remedy = f'the plates are {", ".join(known)}' if known else 'describe it under plates'
            raise section.error('plate', f'no plate is named {plate!r}', remedy)
        center_std, radius_std = read_stds(section, {'center': 'm', 'radius': 'm'})
        discs.append(Disc(name, x, y, radius, center_std, radius_std, plate))
    return tuple(discs)


def _excess(model: Section) -> tuple[tuple[float, float], tuple[float, float]]:
    """P - p_ee I of the general gripper, by rows, m/N."""
    rows = model.data.get('gripper_excess')
    if rows is None:
        return ((0.0, 0.0), (0.0, 0.0))
    if not isinstance(rows, list) or len(rows) != 2 or not all(isinstance(row, list) and len(row) == 2 for row in rows):
        raise model.error('gripper_excess', f'expected [[e11, e12], [e21, e22]], got {shown(rows)}')
    entries = {f'e{i}{j}': rows[i - 1][j - 1] for i in (1, 2) for j in (1, 2)}
    matrix = model.entries('gripper_excess', entries)
    e11, e12, e21, e22 = (matrix.number(name, 'm/N') for name in entries)
    return ((e11, e12), (e21, e22))


def _sensor(section: Section) -> Sensor:
    default = Sensor()
    topics = {name: section.word(name, getattr(default, name)) for name in ('joint_states', 'wrench')}
    for name, topic in topics.items():
        if not _TOPIC.match(topic):
            raise section.error(name, f'{topic!r} is not a topic name', f'write it like {getattr(default, name)}')
        if '/' + topic.lstrip('/') == CELL_TOPIC:
            raise section.error(name, f'{CELL_TOPIC} carries the cell description', 'choose another topic')
    if topics['joint_states'].lstrip('/') == topics['wrench'].lstrip('/'):
        raise section.error('wrench', f'both topics are named {topics["wrench"]}', 'they carry different messages')
    offset = section.number('time_offset') if 'time_offset' in section.data else None
    if offset is not None and abs(offset) > 4e9:
        raise section.error('time_offset', f'expected seconds, at most 4e9 in size, got {offset:g}')
    return Sensor(
        topics['joint_states'],
        topics['wrench'],
        section.choice('frame', default.frame),
        section.choice('sign', default.sign),
        offset,
    )


def _identification(section: Section) -> Identification:
    """The texts that are given; a number must be in quotes, so that no digit of it is lost."""
    return Identification(**{name: section.word(name) for name in section.data if section.data[name] is not None})


def _check_layout(cell: Cell, top: Section) -> None:
    """Refuses discs that cannot be touched, or not without touching another one."""
    problems = layout_problems(cell, cell.centers, cell.radii)
    if not problems:
        return
    remedy = 'check center and radius (in m, to the centre of the tip)'
    if not layout_problems(cell, cell.centers, cell.radii / 2):
        halve = 'halve it, and add the radius of the tip if it is not contained'
        if len(problems) > 1:
            raise top.error('objects', f'{problems[0]}: radius seems to be the diameter of every disc', halve)
        remedy += f'; if radius is the diameter of every disc, {halve}'
    raise top.error('objects', problems[0], remedy)


class _Dumper(yaml.SafeDumper):
    """Puts what `parse_yaml` would read as a number in quotes: 1e3 is one in YAML 1.2, and a string for PyYAML."""


_Dumper.add_implicit_resolver('tag:yaml.org,2002:float', re.compile(r'[-+]?[0-9]+[eE][-+]?[0-9]+\Z'), [*'-+0123456789'])


def _flow(value: Any) -> str:
    text: str = yaml.dump(
        value, Dumper=_Dumper, default_flow_style=True, width=math.inf, sort_keys=False, allow_unicode=True
    )
    return text.removesuffix('\n').removesuffix('\n...')
