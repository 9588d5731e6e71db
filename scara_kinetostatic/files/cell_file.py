"""The cell description as a file: `cell.yaml` to `Cell` and back.

Each section of the file has a function here that reads it. What is not valid is refused with one line that names the
key: unknown keys, wrong types, impossible values, discs that overlap or cannot be reached. The layout is checked on
the contact circles (radius: disc centre to TIP centre):

- two circles that intersect are an error: the tip would touch both discs there;
- a circle around the robot's base is an error;
- a circle outside the nominal reach, |l1 - l2| to l1 + l2 from the base, is an error: it cannot be touched.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.errors import CellError
from scara_kinetostatic.files.yaml_file import POSITIVE, Section, Within, dump_yaml, parse_yaml, read_text, shown
from scara_kinetostatic.model import cell as cells
from scara_kinetostatic.model.cell import Plane, axes_problem
from scara_kinetostatic.model.effect_law import Parameter
from scara_kinetostatic.model.outline import Outline, outline_problem
from scara_kinetostatic.model.parameters import MOMENTS, MOST_GRAVITY, NAMES, UNITS, Parameters

CELL_TOPIC = '/cell_description'
"""Topic of the cell description in a recording, `std_msgs/msg/String`."""

OPTIONAL = ('plates', 'uncertainty', 'tolerance', 'region', 'tip', 'gravity', 'obstacles', 'touch', 'identification')
"""Keys that may be left out, beside `sensor`, `noise` and `model`."""
_TOPIC = re.compile(r'/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*\Z')

_LENGTH = Within(0.0, 2e-3, 'it is in m: 1.5e-5 for 15 µm', unit='m')
"""Standard uncertainties that are accepted: what is known worse than that is not known."""
_ANGLE = Within(0.0, 0.2, 'it is in rad: 1.0e-3 for 0.06 deg', unit='rad')
_COMMON = {
    'radius': _LENGTH,
    'force_gain': Within(0.0, 0.2, 'it is a part of 1: 0.005 for 0.5 %'),
    'force_rotation': _ANGLE,
}
"""Keys of the section `uncertainty` beside `nominal` and `effects`, with their limits."""


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
    top = Section(CellError, str(where), '', data, ('robot', 'objects'), ('sensor', 'noise', 'model', *OPTIONAL))
    of_arm = ('joint_names', 'coupling', 'direction', 'plane', 'moments')
    robot = top.section('robot', ('nominal',), (*of_arm, 'limits', 'lift', 'hold'))
    joint_names, direction = _joint_names(robot), _direction(robot)
    ratio = Within(-2.0, 2.0, 'it is a ratio of angles: 0.2105 for pulleys of 16 and 76 teeth')
    # any calibration meets a larger one
    tolerance = Within(0.0, 5e-3, 'give it in m: 5.0e-5 for 50 µm', positive=True, unit='m')
    lift = _lift(robot, joint_names)
    model = top.section('model', (), ('gripper_sign', 'gripper_excess'))
    plates, base = _plates(top), _nominal(top, robot)
    named = top.section('identification', (), cells.Identification._fields)
    # a number must be in quotes, so that no digit of it is lost
    texts = {key: named.word(key) for key in named.data if named.data[key] is not None}
    cell = cells.Cell(
        nominal=base,
        discs=() if may_be_empty and top.data['objects'] == [] else _discs(top, plates),
        joint_names=joint_names,
        coupling=robot.optional('coupling', within=ratio) or 0.0,
        direction=direction,
        plane=_plane(robot),
        sensor=_sensor(top.section('sensor', (), cells.Sensor._fields)),
        noise=_noise(top),
        gripper_sign=model.choice('gripper_sign', cells.GripperSign.PHYSICAL),
        gripper_excess=_excess(model),
        plates=plates,
        uncertainty=_uncertainty(top.section('uncertainty', (), (*_COMMON, 'nominal', 'effects')), base.names),
        tolerance=top.section('tolerance', (), ('tip',)).optional('tip', within=tolerance),
        tip_radius=_tip_radius(top),
        region=_region(top),
        limits=turned_limits(_limits(robot, joint_names), direction),
        lift=lift,
        hold=_hold(robot, (*joint_names, *([lift.joint] if lift else []))),
        obstacles=_obstacles(top),
        touch=_touch(top),
        identification=cells.Identification(**texts),
    )
    cell = replace(cell, uncertainty=replace(cell.uncertainty, effects=_effects(top, cell)))
    if check_layout and cell.discs:
        _check_layout(cell, top)
    return cell


def cell_description(cell: cells.Cell) -> dict[str, Any]:
    """The keys of a cell description; what is not stated is left out."""
    nominal, u, sizes = cell.nominal, cell.uncertainty, cell.uncertainty.effects
    sensor = cell.sensor._asdict() | {'frame': cell.sensor.frame.value, 'sign': cell.sensor.sign.value}
    sensor['axes'] = cell.sensor.axes and dict(zip('xy', map(list, cell.sensor.axes), strict=True))
    limits, plane = turned_limits(cell.limits, cell.direction) or (), cell.plane
    axes = {name: list(getattr(plane, name)) for name in ('origin', 'x', 'y')}
    motion = _given(
        coupling=cell.coupling,
        direction=list(cell.direction) if cell.direction != (1, 1) else None,
        plane={'frame': plane.frame, **axes, **_given(tip=plane.tip)} if plane.is_stated else {},
        moments={name: getattr(nominal, name) for name in nominal.names[len(NAMES) :]}
        | _given(phi1=nominal.phi1, phi2=nominal.phi2),
        limits={name: list(pair) for name, pair in zip(cell.joint_names, limits, strict=False)},
        lift=cell.lift and cell.lift._asdict(),
        hold=dict(cell.hold),
    )
    arm = {} if sizes.arm is cells.EffectSizes().arm else {'arm': sizes.arm.value}
    stated = {'sizes': sizes.sizes.value, **arm, **sizes.stated} if arm or sizes.stated else sizes.sizes.value
    return {
        'robot': {
            'joint_names': list(cell.joint_names),
            'nominal': {name: getattr(nominal, name) for name in NAMES},
            **motion,
        },
        'objects': [_object_description(disc) | _given(plate=disc.plate) for disc in cell.discs],
        'sensor': {key: v for key, v in sensor.items() if v or (key == 'time_offset' and v is not None)},
        **_given(
            gravity=list(nominal.gravity) if nominal.has_gravity else None,
            noise=cell.noise and cell.noise.as_dict(as_stated=True),
            model={'gripper_sign': cell.gripper_sign.value}
            | ({} if cell.gripper.isotropic else {'gripper_excess': [list(row) for row in cell.gripper_excess]}),
            plates=[
                {'name': plate.name, 'origin': [plate.x, plate.y]}
                | _given(uncertainty=_given(center=plate.center_std, angle=plate.angle_std))
                for plate in cell.plates
            ],
            uncertainty=_given(
                **{name: getattr(u, name) for name in _COMMON},
                nominal=dict(u.nominal),
                effects=stated if sizes != cells.EffectSizes() else None,
            ),
            tolerance=_given(tip=cell.tolerance),
            tip=_given(radius=cell.tip_radius),
            obstacles=[{'outline': [list(corner) for corner in outline]} for outline in cell.obstacles],
            touch={name: list(v) if isinstance(v, tuple) else v for name, v in cell.touch._asdict().items()}
            if cell.touch != cells.TouchMotion()
            else None,
            region={'x': list(cell.region[:2]), 'y': list(cell.region[2:])} if cell.region != cells.Region() else None,
            identification=cell.identification.given(),
        ),
    }


def _given(**values: Any) -> dict[str, Any]:
    """What is stated: values other than nothing and zero."""
    return {name: value for name, value in values.items() if value}


def _object_description(disc: cells.Disc | Outline) -> dict[str, Any]:
    if isinstance(disc, Outline):
        return {
            'name': disc.name,
            'outline': [list(corner) for corner in disc.corners],
            **_given(corner_radius=disc.corner_radius, open=disc.is_open),
            **_given(uncertainty=_given(center=disc.center_std, angle=disc.angle_std, offset=disc.radius_std)),
        }
    stated = _given(uncertainty=_given(center=disc.center_std, radius=disc.radius_std))
    return {'name': disc.name, 'center': [disc.x, disc.y], 'radius': disc.radius} | stated


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


_PHI = ('phi1', 'phi2')
"""Directions of the centres of mass from those of the links, rad."""


def _nominal(top: Section, robot: Section) -> Parameters:
    section = robot.section('nominal', NAMES)
    limits = dict.fromkeys(('l1', 'l2'), POSITIVE)
    limits |= dict.fromkeys(('p_ee', 'p1', 'p2', 'g_ee', 'g1', 'g2'), Within(0.0))
    values = {name: section.number(name, UNITS[name], limits.get(name, Within())) for name in NAMES}
    gx, gy = (0.0, 0.0) if top.data.get('gravity') is None else top.vector('gravity', ('x', 'y'), 'm/s²')
    if (gx * gx + gy * gy) ** 0.5 > MOST_GRAVITY:
        problem = f'expected at most {MOST_GRAVITY:g} m/s² in size, got {shown([gx, gy])}'
        raise top.error('gravity', problem, 'give it in m/s²: [0.0, -9.81]')
    moments = robot.section('moments', (), (*MOMENTS, *_PHI))
    if moments.data and not (gx or gy):
        raise robot.error('moments', 'without gravity they are no parameters', 'give `gravity` or leave them out')
    usual = Within(-1e4, 1e4, 'it is in kg m: mass times distance from the joint', unit='kg m')
    held = {name: moments.number(name, *(('rad',) if name in _PHI else ('kg m', usual))) for name in moments.data}
    return Parameters.from_mapping(values).replace(**held, gravity=(gx + 0.0, gy + 0.0))


def _joint_names(robot: Section) -> tuple[str, str]:
    names = robot.data.get('joint_names', ['joint1', 'joint2'])
    if not isinstance(names, list) or len(names) != 2:
        raise robot.error('joint_names', f'expected the two names of q1 and q2 in JointState, got {shown(names)}')
    entries = robot.entries('joint_names', {'q1': names[0], 'q2': names[1]})
    names = [entries.word('q1'), entries.word('q2')]
    if names[0] == names[1]:
        raise robot.error('joint_names', f'both joints are named {names[0]!r}', 'name q1 and q2 as JointState does')
    return names[0], names[1]


def _direction(robot: Section) -> tuple[int, int]:
    signs = robot.data.get('direction', [1, 1])
    if not isinstance(signs, list) or len(signs) != 2 or any(sign not in (1, -1) or sign is True for sign in signs):
        raise robot.error('direction', f'expected two of 1 and -1, got {shown(signs)}', 'write [1, -1]')
    return int(signs[0]), int(signs[1])


def turned_limits(limits: cells.Limits | None, direction: tuple[int, int]) -> cells.Limits | None:
    """Limits of the readings as those of the angles, or back: turned round where a joint turns clockwise."""
    if limits is None:
        return None
    one, other = (pair if sign > 0 else (-pair[1], -pair[0]) for pair, sign in zip(limits, direction, strict=True))
    return one, other


def _plane(robot: Section) -> Plane:
    if robot.data.get('plane') is None:
        return Plane()
    section = robot.section('plane', ('frame', 'origin', 'x', 'y'), ('tip',))
    origin = section.vector('origin', ('x', 'y', 'z'), 'm')
    return Plane(section.word('frame'), origin, *_axes(section), section.word('tip') if 'tip' in section.data else '')


def _axes(section: Section) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The unit vectors x and y of a section."""
    x, y = (section.vector(name, ('x', 'y', 'z')) for name in ('x', 'y'))
    if problem := axes_problem(x, y):
        raise section.error('', problem, 'give two unit vectors, such as x: [1.0, 0.0, 0.0], y: [0.0, 0.0, 1.0]')
    return x, y


def _sensor_axes(sensor: Section) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    if sensor.data.get('axes') is None:
        return None
    if sensor.choice('frame', cells.SensorFrame.BASE) is not cells.SensorFrame.TOOL or sensor.data.get('rotation'):
        raise sensor.error('axes', 'they are those of link 2 in the sensor', 'set frame to tool and leave out rotation')
    return _axes(sensor.section('axes', ('x', 'y')))


def _limits(robot: Section, names: tuple[str, str]) -> cells.Limits | None:
    if robot.data.get('limits') is None:
        return None
    section = robot.section('limits', names)
    within = Within(-12.6, 12.6, 'it is in rad: 2.6 for 150 degrees', unit='rad')
    one, other = (_interval(section, name, ('lower limit', 'upper limit'), within) for name in names)
    return one, other


def _interval(
    section: Section, key: str, labels: tuple[str, str], within: Within, unit: str = ''
) -> tuple[float, float]:
    """Two numbers, the smaller one first."""
    low, high = section.vector(key, labels, unit, within)
    if low >= high:
        raise section.error(key, f'expected the {labels[0]} first, got {shown([low, high])}')
    return low, high


def _lift(robot: Section, names: tuple[str, str]) -> cells.Lift | None:
    if robot.data.get('lift') is None:
        return None
    section = robot.section('lift', ('joint', 'up', 'down'))
    joint, (up, down) = section.word('joint'), (section.number(name, 'm') for name in ('up', 'down'))
    if joint in names:
        raise section.error('joint', f'{joint!r} is one of joint_names', 'name the joint that raises the tip')
    if up == down:
        raise section.error('up', f'up and down are both {up:g}: it does not lift', 'give two positions, m')
    return cells.Lift(joint, up, down)


def _hold(robot: Section, others: tuple[str, ...]) -> dict[str, float]:
    held = robot.data.get('hold')
    section = robot.section('hold', (), held if isinstance(held, dict) else ('joint4',))
    for name in section.data:
        if name in others:
            raise section.error(name, 'it is a joint of the plane or the lift', 'name the other joints only')
        if not name.strip() or not name.isprintable():
            raise section.error('', f'expected names of joints, got {shown(name)}')
    return {name: section.number(name) for name in section.data}


def _tip_radius(top: Section) -> float | None:
    return top.section('tip', (), ('radius',)).optional('radius', 'm', POSITIVE)


def _obstacles(top: Section) -> tuple[tuple[tuple[float, float], ...], ...]:
    given = bool(top.data.get('obstacles'))
    sections = top.items('obstacles', 'outlines', ('outline',), (), _MOST_OBSTACLES) if given else ()
    return tuple(_corners(section, 3) for section in sections)


def _corners(section: Section, least: int) -> tuple[tuple[float, float], ...]:
    """The corners under the key `outline`, m."""
    corners = section.data['outline']
    if not isinstance(corners, list) or not least <= len(corners) <= _MOST_CORNERS:
        raise section.error('outline', f'expected {least} to {_MOST_CORNERS} corners [x, y], got {shown(corners)}')
    places = section.entries('outline', {f'corner {k}': corner for k, corner in enumerate(corners)})
    pairs = (places.vector(label, ('x', 'y'), 'm') for label in places.data)
    return tuple((x, y) for x, y in pairs)


_MOST_OBSTACLES, _MOST_CORNERS = 20, 50
"""Obstacles that are accepted, and corners of each: ways round more take long to plan."""
_TOUCH = {
    'max_force': Within(0.0, 5e3, positive=True, unit='N'),
    'speed': Within(0.0, 2.0, positive=True, unit='m/s'),
    'contact_speed': Within(0.0, 0.05, positive=True, unit='m/s'),
    'clearance': Within(1e-3, 0.1, 'it is in m: 0.012 for 12 mm', unit='m'),
    'hold': Within(0.2, 10.0, 'a hold of 0.2 s or more is found', unit='s'),
    'search': Within(1e-3, 0.05, 'it is in m: 0.01 for 10 mm', unit='m'),
}


def _touch(top: Section) -> cells.TouchMotion:
    section, usual = top.section('touch', (), cells.TouchMotion._fields), cells.TouchMotion()
    force = usual.force
    if section.data.get('force') is not None:
        force = _interval(section, 'force', ('smallest force', 'largest force'), _TOUCH['max_force'])
    given = (section.optional(name, within=within) for name, within in _TOUCH.items())
    found = cells.TouchMotion(
        force, *(default if v is None else v for v, default in zip(given, usual[1:], strict=True))
    )
    if force[1] >= found.max_force:
        raise section.error('max_force', f'expected more than the largest force of {force[1]:g} N')
    return found


def _region(top: Section) -> cells.Region:
    if top.data.get('region') is None:
        return cells.Region()
    section = top.section('region', ('x', 'y'))
    x, y = (_interval(section, axis, ('lower limit', 'upper limit'), Within(), 'm') for axis in ('x', 'y'))
    return cells.Region(*x, *y)


def _discs(top: Section, plates: tuple[cells.Plate, ...]) -> tuple[cells.Disc | Outline, ...]:
    discs, known = list[cells.Disc | Outline](), [plate.name for plate in plates]
    keys, optional = ('name', 'center', 'radius'), ('uncertainty', 'plate')
    other = ('name', 'outline'), ('corner_radius', 'open', *optional)
    for section in top.items('objects', 'discs', keys, optional, other=other):
        name = section.word('name')
        if name in (disc.name for disc in discs):
            raise section.error('name', f'another disc is named {name!r}, too', 'give every disc its own name')
        plate = '' if section.data.get('plate') is None else section.word('plate')
        if plate and plate not in known:
            remedy = f'the plates are {", ".join(known)}' if known else 'describe it under plates'
            raise section.error('plate', f'no plate is named {plate!r}', remedy)
        if 'outline' in section.data:
            discs.append(_outline(section, top, name, plate))
            continue
        (x, y), radius = section.vector('center', ('x', 'y'), 'm'), section.number('radius', 'm', POSITIVE)
        center_std, radius_std = _stds(section, center=_LENGTH, radius=_LENGTH)
        discs.append(cells.Disc(name, x, y, radius, center_std, radius_std, plate))
    if empty := [plate.name for plate in plates if plate.name not in {disc.plate for disc in discs}]:
        raise top.error('plates', f'no disc is on plate {empty[0]!r}', 'leave it out, or name it at its discs')
    return tuple(discs)


def _outline(section: Section, top: Section, name: str, plate: str) -> Outline:
    is_open = section.data.get('open', False)
    if not isinstance(is_open, bool):
        raise section.error('open', f'expected true or false, got {shown(is_open)}')
    corners = _corners(section, 2 if is_open else 3)
    radius = section.optional('corner_radius', 'm', Within(0.0)) or 0.0
    center, angle, offset = _stds(section, center=_LENGTH, angle=_ANGLE, offset=_LENGTH)
    outline = Outline(name, corners, radius, is_open, center, offset, angle, plate)
    if (tip := _tip_radius(top)) is None:
        problem = f'{name} is an outline: the radius of the tip is missing'
        raise top.error('tip', problem, 'add tip: {radius: 0.005}, m')
    if (problem_of := outline_problem(outline, tip)) is not None:
        raise section.error('outline', *problem_of)
    return outline


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
    return (e11, e12), (e21, e22)


def _sensor(section: Section) -> cells.Sensor:
    default = cells.Sensor()
    topics = {name: section.word(name, getattr(default, name)) for name in ('joint_states', 'wrench')}
    service = section.word('zero_service', '') if section.data.get('zero_service') else ''
    if service and not _TOPIC.match(service):
        raise section.error('zero_service', f'{service!r} is no name of a service', 'write it like /sensor/zero')
    for name, topic in topics.items():
        if not _TOPIC.match(topic):
            raise section.error(name, f'{topic!r} is not a topic name', f'write it like {getattr(default, name)}')
        if '/' + topic.lstrip('/') == CELL_TOPIC:
            raise section.error(name, f'{CELL_TOPIC} carries the cell description', 'choose another topic')
    if topics['joint_states'].lstrip('/') == topics['wrench'].lstrip('/'):
        raise section.error('wrench', f'both topics are named {topics["wrench"]}', 'they carry different messages')
    turn = Within(-6.3, 6.3, 'it is in rad: 1.5708 for 90 degrees', unit='rad')
    return cells.Sensor(
        topics['joint_states'],
        topics['wrench'],
        section.choice('frame', default.frame),
        section.choice('sign', default.sign),
        section.optional('time_offset', within=Within(-4e9, 4e9, unit='s')),
        section.optional('rotation', within=turn) or 0.0,
        _sensor_axes(section),
        service,
    )


def _plates(top: Section) -> tuple[cells.Plate, ...]:
    if top.data.get('plates') is None:
        return ()
    plates: list[cells.Plate] = []
    for section in top.items('plates', 'plates', ('name', 'origin'), ('uncertainty',), most=16):
        name = section.word('name')
        if name in (plate.name for plate in plates):
            raise section.error('name', f'another plate is named {name!r}, too', 'give every plate its own name')
        stds = _stds(section, center=_LENGTH._replace(most=0.02), angle=_ANGLE)  # its place is found by touch
        plates.append(cells.Plate(name, *section.vector('origin', ('x', 'y'), 'm'), *stds))
    return tuple(plates)


def _stds(section: Section, **limits: Within) -> list[float]:
    """Standard uncertainties under the key `uncertainty`, 0 where absent."""
    inner = section.section('uncertainty', (), limits)
    return [inner.optional(name, within=limit) or 0.0 for name, limit in limits.items()]


def _uncertainty(section: Section, names: tuple[str, ...]) -> cells.Uncertainty:
    """What is common to all touches."""
    nominal = section.section('nominal', (), names)
    radius, gain, rotation = (section.optional(name, within=within) or 0.0 for name, within in _COMMON.items())
    stated = {name: nominal.number(name, UNITS[name], POSITIVE) for name in nominal.data}
    return cells.Uncertainty(radius, gain, rotation, stated)


def _effects(top: Section, cell: cells.Cell) -> cells.EffectSizes:
    """How large undetected effects are: one word, or words and single sizes, of the effects that the cell may have."""
    section, usual = top.section('uncertainty', (), (*_COMMON, 'nominal', 'effects')), cells.EffectSizes()
    if not isinstance(section.data.get('effects', {}), dict):
        return cells.EffectSizes(section.choice('effects', usual.sizes))
    known = dict[str, list[Parameter]]()
    for effect in (effect for effect in catalogue(cell) if effect.parameters):
        for key in {effect.name, effect.label}:
            known.setdefault(key, []).append(effect.parameters[0])
    inner = section.section('effects', (), ('sizes', 'arm', *known))
    stated = {}
    for name in (name for name in inner.data if name in known):
        if len({parameter.unit for parameter in known[name]}) > 1:
            raise inner.error(name, 'is a size in several units', f'give {name}[joint1] and others by themselves')
        stated[name] = inner.number(name, '', Within(0.0, min(parameter.scale for parameter in known[name])))
    sizes, arm = inner.choice('sizes', usual.sizes), inner.choice('arm', usual.arm)
    if 'arm' in inner.data and sizes is cells.SizeMode.NONE:
        raise inner.error('arm', 'has no meaning with sizes: none', 'write sizes: estimated, or typical')
    return cells.EffectSizes(sizes, arm, stated)


def _noise(top: Section) -> cells.Noise | None:
    """The noise: one number per kind or axis, and a part that grows with the force; None where it gives none."""
    if top.data.get('noise') is None:
        return None
    section = top.section('noise', (), ('joint', 'force', 'force_relative'))
    if missing := [key for key in ('joint', 'force') if section.data.get(key) is None]:
        problem = f'{" and ".join(missing)} {"is" if len(missing) == 1 else "are"} missing'
        remedy = 'joint and force are given together or not at all; leave out noise to have both estimated'
        raise section.error('', problem, f'{remedy}; force_relative may be left out')
    repeatability = 'give the repeatability of one touch, or leave out noise'
    return cells.Noise(
        _level(section, 'joint', ('joint 1', 'joint 2'), Within(1e-15, 1e-2, repeatability, unit='rad')),
        _level(section, 'force', ('x', 'y'), Within(1e-12, 100.0, repeatability, unit='N')),
        section.optional('force_relative', within=Within(0.0, 0.2, 'give it as a part of the force: 0.01 for 1 %')),
    )


def _level(section: Section, key: str, axes: tuple[str, str], within: Within) -> cells.Level:
    """One number, or one per axis."""
    unit = within.unit.removesuffix('N')  # forces are limited by `within` alone
    if not isinstance(section.data[key], list):
        return section.number(key, unit, within)
    first, second = section.vector(key, axes, unit, within)
    return first, second


def _check_layout(cell: cells.Cell, top: Section) -> None:
    """Refuses discs that cannot be touched, or not without touching another one."""
    if not (problems := cells.layout_problems(cell, cell.centers, cell.radii)):
        return
    remedy = 'check center and radius (in m, to the centre of the tip)'
    if not cell.has_outlines and not cells.layout_problems(cell, cell.centers, cell.radii / 2):
        halve = 'halve it, and add the radius of the tip if it is not contained'
        if len(problems) > 1:
            raise top.error('objects', f'{problems[0]}: radius seems to be the diameter of every disc', halve)
        remedy += f'; if radius is the diameter of every disc, {halve}'
    raise top.error('objects', problems[0], remedy)
