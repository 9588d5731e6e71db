"""The cell description as a file: `cell.yaml` to `Cell` and back.

Each section of the file has a table here, of its keys with what reads them; a key that is absent leaves the value that
`Cell` and its parts have by themselves. What is not valid is refused with one line that names the key: unknown keys,
wrong types, impossible values, discs that overlap or cannot be reached. The layout is checked on the contact circles
(radius: disc centre to TIP centre):

- two circles that intersect are an error: the tip would touch both discs there;
- a circle around the robot's base is an error;
- a circle outside the nominal reach, |l1 - l2| to l1 + l2 from the base, is an error: it cannot be touched.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from enum import Enum
from functools import partial
from math import inf
from pathlib import Path
from typing import Any

from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import CellError, ParameterError
from scara_kinetostatic.files.yaml_file import (
    ANY,
    MappingReader,
    Reader,
    Within,
    choice,
    dump_yaml,
    parse_yaml,
    read_text,
    shown,
)
from scara_kinetostatic.model import cell as cells
from scara_kinetostatic.model.cell import Plane, axes_problem
from scara_kinetostatic.model.extended_model import Parameter
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import LEVEL, MILLI, MOMENTS, NAMES, P_EE, UNITS, Parameters

CELL_TOPIC = '/cell_description'
"""Topic of the cell description in a recording, `std_msgs/msg/String`."""

MOST_TURN = 12.6
"""Limits beyond two turns are not those of an arm, rad."""
OPTIONAL = ('plates', 'uncertainty', 'tolerance', 'region', 'tip', 'gravity', 'obstacles', 'touch', 'identification')
"""Keys that may be left out, beside `sensor`, `noise` and `model`."""


def load_cell(path: str | Path) -> cells.Cell:
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


def parse_cell(text: str, where: str | Path = 'cell description') -> cells.Cell:
    """The cell that a YAML text describes.

    Args:
        text: the YAML, in the form of `config/cell.yaml`.
        where: the file, for messages.

    Raises:
        CellError: the text is not YAML, or its content is not valid.
    """
    return read_cell(parse_yaml(text, where, CellError), where)


def read_cell(data: Any, where: str | Path, *, check_layout: bool = True, may_be_empty: bool = False) -> cells.Cell:
    """The cell of a parsed description.

    Args:
        data: as `parse_yaml` gives it.
        where: the file, for messages.
        check_layout: whether to refuse discs that cannot be touched.
        may_be_empty: whether there may be no discs, as where only the nominal arm is asked for.

    Raises:
        CellError: the content is not valid.
    """
    top = MappingReader(CellError, str(where), '', data, ('robot', 'objects'), ('sensor', 'noise', 'model', *OPTIONAL))
    found = top.record('robot', _READERS['robot'], ('nominal',), ('joint_names', 'direction')) | top.read(
        _READERS['cell']
    )
    found |= top.record('model', _READERS['model'], stated=('gripper_sign',))
    moments, gravity = found.pop('moments', {}), found.pop('gravity', LEVEL)
    if moments and gravity == LEVEL:
        reason = 'without gravity they are no parameters'
        raise top.error('robot.moments', reason, 'give `gravity` or leave them out')
    sensor = found.get('sensor', cells.Sensor())
    if sensor.tool_weight is not None and (gravity == LEVEL or sensor.frame is cells.SensorFrame.BASE):
        reason = 'it shows under gravity alone, in the frame of the tool'
        raise top.error('sensor.tool_weight', reason, 'leave it out: the zero before each touch contains the weight')
    found['tip_radius'] = found.pop('tip', None)
    others = [*([found['lift'].joint] if found.get('lift') else []), *found.get('hold', ())]
    joints = [*found.get('joint_names', cells.Cell.joint_names), *others]
    if twice := [name for name in joints if joints.count(name) > 1]:
        raise top.error('robot', f'{twice[0]!r} is named twice', 'joint_names, lift and hold are different joints')
    found['limits'] = cells.turned_limits(found.get('limits'), found.get('direction', (1, 1)))
    discs = () if may_be_empty and top.data['objects'] == [] else _discs(top)
    try:
        nominal = found.pop('nominal').replace(**moments, gravity=gravity)
        cell = cells.Cell(nominal, discs, **found)
    except ParameterError as error:
        raise top.error(error.where, error.problem, error.remedy) from error
    if empty := {plate.name for plate in cell.plates} - {disc.plate for disc in discs}:
        raise top.error('plates', f'no disc is on plate {min(empty)!r}', 'leave it out, or name it at its discs')
    if check_layout and discs and (problems := cells.layout_problems(cell, cell.centers, cell.radii)):
        remedy = 'check center and radius (in m, to the centre of the tip; not the diameter)'
        raise top.error('objects', problems[0], remedy)
    return replace(cell, uncertainty=_uncertainty(top, cell))


def cell_description(cell: cells.Cell) -> dict[str, Any]:
    """The keys of a cell description; what is not stated is left out."""
    nominal, u, sizes, region = cell.nominal, cell.uncertainty, cell.uncertainty.effects, cell.region
    sensor = cell.sensor._asdict() | {'axes': cell.sensor.axes and dict(zip('xy', cell.sensor.axes, strict=True))}
    limits = cells.turned_limits(cell.limits, cell.direction) or ()
    stated = {**({} if sizes.arm is cells.EffectSizes().arm else {'arm': sizes.arm}), **sizes.stated}
    found = {
        'robot': {
            'joint_names': cell.joint_names,
            'nominal': {name: getattr(nominal, name) for name in NAMES},
            **_given(
                coupling=cell.coupling,
                direction=cell.direction if cell.direction != (1, 1) else None,
                plane=cell.plane.is_stated and _given(**cell.plane._asdict()),
                moments=nominal.has_gravity and {name: getattr(nominal, name) for name in _MOMENTS},
                limits=dict(zip(cell.joint_names, limits, strict=False)),
                lift=cell.lift and cell.lift._asdict(),
                hold=cell.hold,
            ),
        },
        'objects': [_object_description(disc) | _given(plate=disc.plate) for disc in cell.discs],
        'sensor': {
            key: v for key, v in sensor.items() if v or (key in ('time_offset', 'tool_weight') and v is not None)
        },
        **_given(
            gravity=nominal.gravity if nominal.has_gravity else None,
            noise=cell.noise and cell.noise.as_dict(),
            model={'gripper_sign': cell.gripper_sign},
            plates=[{'name': plate.name, 'origin': (plate.x, plate.y)} | _stated_stds(plate) for plate in cell.plates],
            uncertainty=_given(
                **{name: getattr(u, name) for name in _READERS['uncertainty']},
                nominal=u.nominal,
                effects=sizes != cells.EffectSizes() and ({'sizes': sizes.sizes, **stated} if stated else sizes.sizes),
            ),
            tolerance=_given(tip=cell.tolerance),
            tip=_given(radius=cell.tip_radius),
            obstacles=[{'outline': outline} for outline in cell.obstacles],
            touch=cell.touch != cells.TouchMotion() and cell.touch._asdict(),
            region=region != cells.Region() and {'x': region[:2], 'y': region[2:]},
            identification=cell.identification.given(),
        ),
    }
    plain: dict[str, Any] = _plain(found)
    return plain


def _given(**values: Any) -> dict[str, Any]:
    """What is stated: values other than nothing and zero."""
    return {name: value for name, value in values.items() if value}


def _plain(value: Any) -> Any:
    """Values as YAML and JSON have them: tuples as lists, enumerations by their values."""
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(each) for each in value]
    return value.value if isinstance(value, Enum) else value


def _stated_stds(item: cells.Disc | Outline | cells.Plate) -> dict[str, Any]:
    """The key `uncertainty` of an object or a plate, where it has one."""
    return _given(uncertainty=_given(**{key: getattr(item, name) for key, (name, _) in _STDS[type(item)].items()}))


def _object_description(disc: cells.Disc | Outline) -> dict[str, Any]:
    if isinstance(disc, Outline):
        shape = {'outline': disc.corners, **_given(corner_radius=disc.corner_radius, open=disc.is_open)}
    else:
        shape = {'center': (disc.x, disc.y), 'radius': disc.radius}
    return {'name': disc.name, **shape, **_stated_stds(disc)}


def dump_cell(cell: cells.Cell) -> str:
    """The YAML text of a cell; `parse_cell` gives the same cell back."""
    lines = []
    for key, value in cell_description(cell).items():
        if key in ('robot', 'sensor'):
            lines += [f'{key}:', *(f'  {name}: {dump_yaml(part, flow=True)}' for name, part in value.items())]
        elif key == 'objects':
            lines += [f'{key}:', *(f'  - {dump_yaml(part, flow=True)}' for part in value)]
        else:
            lines.append(f'{key}: {dump_yaml(value, flow=True)}')
    return '\n'.join(lines) + '\n'


def _vector(*labels: str, unit: str = '') -> Reader:
    return lambda section, name: section.vector(name, labels, Within(unit=unit))


def _interval(first: str, last: str, within: Within) -> Reader:
    """Two numbers, the smaller one first."""

    def read(section: MappingReader, name: str) -> tuple[float, float]:
        low, high = section.vector(name, (first, last), within)
        if low >= high:
            raise section.error(name, f'expected the {first} first, got {shown([low, high])}')
        return low, high

    return read


def _record(
    make: Callable[..., Any], readers: Mapping[str, Reader], required: Iterable[str] = (), stated: Iterable[str] = ()
) -> Reader:
    """Reads a mapping: what `make` gives of its keys."""
    return lambda section, name: make(**section.record(name, readers, required, stated))


def _only(key: str, within: Within) -> Reader:
    """Reads a mapping of one number; None where it is missing."""
    return lambda section, name: section.record(name, {key: within}).get(key)


def _nominal(name: str) -> Within:
    """Of compliances and backlashes 0 is the least."""
    least = 0.0 if name in NAMES[P_EE:] else -inf
    return Within(least, positive=name in ('l1', 'l2'), unit=UNITS[name])


def _sign(section: MappingReader, name: str) -> int:
    sign = section.number(name)
    if sign not in (1, -1):
        raise section.error(name, f'expected 1 or -1, got {sign:g}')
    return int(sign)


def _axes(
    section: MappingReader, name: str, readers: Mapping[str, Reader], required: tuple[str, ...]
) -> dict[str, Any]:
    """A mapping with the unit vectors x and y."""
    readers = {**readers, 'x': _vector('x', 'y', 'z'), 'y': _vector('x', 'y', 'z')}
    found = section.record(name, readers, required, readers)
    if problem := axes_problem(found['x'], found['y']):
        remedy = 'give two unit vectors, such as x: [1.0, 0.0, 0.0], y: [0.0, 0.0, 1.0]'
        raise section.error(name, problem, remedy)
    return found


def _plane(robot: MappingReader, key: str) -> Plane:
    readers = {'frame': MappingReader.word, 'origin': _vector('x', 'y', 'z', unit='m'), 'tip': MappingReader.word}
    return Plane(**_axes(robot, key, readers, ('frame', 'origin', 'x', 'y')))


def _sensor_axes(sensor: MappingReader, key: str) -> tuple[tuple[float, ...], ...]:
    if sensor.data.get('frame') != cells.SensorFrame.TOOL.value or sensor.data.get('rotation'):
        raise sensor.error(key, 'they are those of link 2 in the sensor', 'set frame to tool and leave out rotation')
    found = _axes(sensor, key, {}, ('x', 'y'))
    return found['x'], found['y']


def _limits(robot: MappingReader, key: str) -> tuple[tuple[float, float], ...]:
    of_joint = _interval(
        'lower limit', 'upper limit', Within.size(MOST_TURN, 'it is in rad: 2.6 for 150 degrees', unit='rad')
    )
    names = robot.read({'joint_names': _READERS['robot']['joint_names']}).get('joint_names', cells.Cell.joint_names)
    return tuple(robot.record(key, dict.fromkeys(names, of_joint), names).values())


def _lift(robot: MappingReader, key: str) -> cells.Lift:
    readers: dict[str, Reader] = {'joint': MappingReader.word, 'up': Within(unit='m'), 'down': Within(unit='m')}
    lift = cells.Lift(**robot.record(key, readers, tuple(readers)))
    if lift.up == lift.down:
        problem = f'up and down are both {lift.up:g}: it does not lift'
        raise robot.error(f'{key}.up', problem, 'give two positions, m')
    return lift


def _hold(robot: MappingReader, key: str) -> dict[str, float]:
    held = robot.data[key]
    names = list(held) if isinstance(held, dict) else ['joint4']
    if wrong := [name for name in names if not name.strip() or not name.isprintable()]:
        raise robot.error(key, f'expected names of joints, got {shown(wrong[0])}')
    return robot.record(key, dict.fromkeys(names, ANY), stated=names)


def _obstacles(top: MappingReader, key: str) -> tuple[tuple[tuple[float, float], ...], ...]:
    sections = top.items(key, 'outlines', ('outline',), (), 20) if top.data[key] else ()  # more take long to plan
    return tuple(_corners(section, 'outline') for section in sections)


def _corners(section: MappingReader, key: str) -> tuple[tuple[float, float], ...]:
    """The corners of an outline, m."""
    corners, least, most = section.data[key], 2 if section.data.get('open') is True else 3, 50
    if not isinstance(corners, list) or not least <= len(corners) <= most:
        raise section.error(key, f'expected {least} to {most} corners [x, y], got {shown(corners)}')
    return section.vector(key, [f'corner {k}' for k in range(len(corners))], _vector('x', 'y', unit='m'))


def _touch(top: MappingReader, key: str) -> cells.TouchMotion:
    motion = cells.TouchMotion(**top.record(key, _READERS['touch']))
    if motion.force[1] >= motion.max_force:
        raise top.error(f'{key}.max_force', f'expected more than the largest force of {motion.force[1]:g} N')
    return motion


def _region(top: MappingReader, key: str) -> cells.Region:
    of_axis = _interval('lower limit', 'upper limit', Within(unit='m'))
    bounds = top.record(key, {'x': of_axis, 'y': of_axis}, ('x', 'y'))
    return cells.Region(*bounds['x'], *bounds['y'])


def _own_name(section: MappingReader, what: str, others: Iterable[Any]) -> str:
    name = section.word('name')
    if name in (other.name for other in others):
        raise section.error('name', f'another {what} is named {name!r}, too', f'give every {what} its own name')
    return name


def _plates(top: MappingReader, key: str) -> tuple[cells.Plate, ...]:
    plates: list[cells.Plate] = []
    for section in top.items(key, 'plates', ('name', 'origin'), ('uncertainty',), most=16):
        name = _own_name(section, 'plate', plates)
        x, y = section.vector('origin', ('x', 'y'), Within(unit='m'))
        plates.append(cells.Plate(name, x, y, **_stds(section, cells.Plate)))
    return tuple(plates)


def _discs(top: MappingReader) -> tuple[cells.Disc | Outline, ...]:
    discs = list[cells.Disc | Outline]()
    optional = ('uncertainty', 'plate')
    other = ('name', 'outline'), ('corner_radius', 'open', *optional)
    for section in top.items('objects', 'discs', ('name', 'center', 'radius'), optional, other=other):
        name = _own_name(section, 'disc', discs)
        if 'outline' in section.data:
            given = section.read(_READERS['outline'], ('open',))
            more = {'is_open': given.get('open', False), 'corner_radius': given.get('corner_radius', 0.0)}
            disc: cells.Disc | Outline = Outline(name, given['outline'], **more, **_stds(section, Outline))
        else:
            x, y = section.vector('center', ('x', 'y'), Within(unit='m'))
            radius = section.number('radius', Within(positive=True, unit='m'))
            disc = cells.Disc(name, x, y, radius, **_stds(section, cells.Disc))
        discs.append(disc._replace(**section.read({'plate': MappingReader.word})))
    return tuple(discs)


def _stds(section: MappingReader, kind: type) -> dict[str, Any]:
    """Standard uncertainties under the key `uncertainty`, by field of an object or a plate."""
    given = section.record('uncertainty', {key: within for key, (_, within) in _STDS[kind].items()})
    return {_STDS[kind][key][0]: std for key, std in given.items()}


def _topic(sensor: MappingReader, key: str) -> str:
    """The name of a topic or service."""
    name = sensor.word(key)
    if not _TOPIC.match(name) or '/' + name.lstrip('/') == CELL_TOPIC:
        raise sensor.error(key, f'expected a topic other than {CELL_TOPIC}, got {name!r}', 'write it like /arm/wrench')
    return name


def _sensor(top: MappingReader, key: str) -> cells.Sensor:
    sensor = cells.Sensor(**top.record(key, _READERS['sensor'], stated=('frame', 'sign', 'joint_states', 'wrench')))
    if sensor.topics[0] == sensor.topics[1]:
        raise top.error(f'{key}.wrench', f'both topics are named {sensor.wrench}', 'they carry different messages')
    return sensor


def _uncertainty(top: MappingReader, cell: cells.Cell) -> cells.Uncertainty:
    """What is common to all touches, of the parameters and the effects that the cell may have."""
    nominal: dict[str, Reader] = {name: Within(positive=True, unit=UNITS[name]) for name in cell.nominal.names}
    readers: dict[str, Reader] = {
        **_READERS['uncertainty'],
        'nominal': _record(dict, nominal, stated=nominal),
        'effects': partial(_effects, cell),
    }
    return cells.Uncertainty(**top.record('uncertainty', readers, stated=('effects',)))


def _effects(cell: cells.Cell, section: MappingReader, key: str) -> cells.EffectSizes:
    """How large undetected effects are: one word, or words and single sizes."""
    if not isinstance(section.data[key], dict):
        return cells.EffectSizes(choice(cells.SizeMode)(section, key))
    known = dict[str, list[Parameter]]()
    for effect in (effect for effect in catalogue(cell) if effect.parameters):
        for name in {effect.name, effect.label}:
            known.setdefault(name, []).append(effect.parameters[0])
    inner = section.section(key, (), ('sizes', 'arm', *known))
    stated = {}
    for name in (name for name in inner.data if name in known):
        if len({parameter.unit for parameter in known[name]}) > 1:
            raise inner.error(name, 'is a size in several units', f'give {name}[joint1] and others by themselves')
        stated[name] = inner.number(name, Within(0.0, min(parameter.scale for parameter in known[name])))
    modes = inner.read({'sizes': choice(cells.SizeMode), 'arm': choice(cells.ArmClass)}, ('sizes', 'arm'))
    return cells.EffectSizes(**modes, stated=stated)


def _level(first: str, second: str, least: float, most: float, unit: str) -> Reader:
    """One number, or one per axis."""
    within = Within(least, most, 'give the repeatability of one touch, or leave out noise', unit=unit)

    def read(section: MappingReader, name: str) -> cells.Level:
        if not isinstance(section.data[name], list):
            return section.number(name, within)
        one, other = section.vector(name, (first, second), within)
        return one, other

    return read


_TOPIC = re.compile(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z')
_LENGTH = Within(0.0, 2 * MILLI, 'it is in m: 1.5e-5 for 15 µm', unit='m')
"""Standard uncertainties that are accepted: what is known worse than that is not known."""
_PART = Within(0.0, 0.2)
_ANGLE = replace(_PART, remedy='it is in rad: 1.0e-3 for 0.06 deg', unit='rad')
_STDS = {
    cells.Disc: {'center': ('center_std', _LENGTH), 'radius': ('radius_std', _LENGTH)},
    Outline: {'center': ('center_std', _LENGTH), 'angle': ('angle_std', _ANGLE), 'offset': ('radius_std', _LENGTH)},
    # the place of a plate is found by touch
    cells.Plate: {'center': ('center_std', replace(_LENGTH, most=0.02)), 'angle': ('angle_std', _ANGLE)},
}
"""Field and limits of each key of `uncertainty`, by what has it."""
_NOISE: dict[str, Reader] = {
    'joint': _level('joint 1', 'joint 2', 1e-15, 1e-2, 'rad'),
    'force': _level('x', 'y', 1e-12, 100.0, 'N'),
    'force_relative': replace(_PART, remedy='give it as a part of the force: 0.01 for 1 %'),
}
_FORCE = Within(0.0, 5e3, positive=True, unit='N')
_MOMENTS = {name: Within(unit=UNITS.get(name, 'rad')) for name in (*MOMENTS, 'phi1', 'phi2')}
_READERS: dict[str, dict[str, Reader]] = {
    'cell': {
        'sensor': _sensor,
        'noise': _record(cells.Noise, _NOISE, ('joint', 'force')),
        'plates': _plates,
        # any calibration meets a larger one
        'tolerance': _only('tip', Within(0.0, 5 * MILLI, 'give it in m: 5.0e-5 for 50 µm', positive=True, unit='m')),
        'region': _region,
        'tip': _only('radius', Within(positive=True, unit='m')),
        'obstacles': _obstacles,
        'gravity': _vector('x', 'y', unit='m/s²'),
        'touch': _touch,
        # a number must be in quotes, so that no digit of it is lost
        'identification': _record(
            cells.Identification, dict.fromkeys(cells.Identification._fields, MappingReader.word)
        ),
    },
    'robot': {
        'nominal': _record(Parameters, {name: _nominal(name) for name in NAMES}, NAMES),
        'joint_names': lambda robot, key: robot.vector(key, ('q1', 'q2'), MappingReader.word),
        'coupling': Within.size(2.0, 'it is a ratio of angles: 0.2105 for pulleys of 16 and 76 teeth'),
        'direction': lambda robot, key: robot.vector(key, ('joint 1', 'joint 2'), _sign),
        'plane': _plane,
        # phi: directions of the centres of mass from those of the links
        'moments': _record(dict, _MOMENTS, stated=_MOMENTS),
        'limits': _limits,
        'lift': _lift,
        'hold': _hold,
    },
    'model': {'gripper_sign': choice(cells.GripperSign)},
    'sensor': {
        'joint_states': _topic,
        'wrench': _topic,
        'frame': choice(cells.SensorFrame),
        'sign': choice(cells.SensorSign),
        'time_offset': Within.size(4e9, unit='s'),
        'rotation': Within.size(MOST_TURN / 2, 'it is in rad: 1.5708 for 90 degrees', unit='rad'),
        'axes': _sensor_axes,
        'tool_weight': Within.size(50.0, 'it is in kg: 0.15 for 150 g', unit='kg'),
        'zero_service': lambda sensor, key: _topic(sensor, key) if sensor.data[key] else '',
        'base_frame': MappingReader.word,
        'tool_frame': MappingReader.word,
    },
    'outline': {'open': MappingReader.flag, 'outline': _corners, 'corner_radius': Within(0.0, unit='m')},
    'touch': {
        'force': _interval('smallest force', 'largest force', _FORCE),
        'max_force': _FORCE,
        'speed': Within(0.0, 2.0, positive=True, unit='m/s'),
        'contact_speed': Within(0.0, 0.05, positive=True, unit='m/s'),
        'clearance': Within(MILLI, 0.1, 'it is in m: 0.012 for 12 mm', unit='m'),
        'hold': Within(0.2, 10.0, 'a hold of 0.2 s or more is found', unit='s'),
        'search': Within(MILLI, 0.05, 'it is in m: 0.01 for 10 mm', unit='m'),
    },
    'uncertainty': {
        'radius': _LENGTH,
        'force_gain': replace(_PART, remedy='it is a part of 1: 0.005 for 0.5 %'),
        'force_rotation': _ANGLE,
    },
}
"""What reads each key, by section; of the cell the sections that are fields of `Cell`."""
