"""Plans as files: a YAML list, one touch or one slide per entry, in the order of time.

```yaml
- {disc: disc_1, angle_deg: 30, posture: left, force: 25}
- {disc: disc_2, angle_deg: -90, posture: right, force: 40, preload: 0.3}
```
`angle_deg` is the direction from the disc's centre to the contact in the base frame, degrees from x;
`posture` is `left` (sin(q2 + theta2) > 0, the elbow on the right of the line from the base
to the tip, the fore-arm bent to the left), `right`, +1 or -1; `force` in N; `preload`,
which may be left out, is the part of the force by which the press first goes beyond it.

```yaml
- {slide: disc_2, force: 15, friction: 0.1}                                 # a disc of the cell
- {slide: {center: [0.20, 0.35], radius: 0.06}, force: 15, posture: left}   # a disc that is not in the cell
- {slide: {center: [-0.20, 0.35], radius: 0.05}, force: 20, from: 0, to: 1.05}
- {slide: {outline: [[0.10, 0.30], [0.20, 0.30], [0.20, 0.40]], corner_radius: 0.01, closed: false}, force: 10}
```
Outlines are those of the surface, the tip's radius is the cell's (`tip: {radius}`); the radius of a disc of the cell
contains it. Corners are counter-clockwise, the tip slides outside, on the right of an open line. `from` and `to` are in
lengths of the outline: of a closed one 0 to 1 is one turn, `to: 1.05` overlaps, `from: 1` `to: 0` slides clockwise.
`force` is the normal force in N, `friction` the coefficient, `speed` that of the tip in m/s; all but `slide` may be
left out.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from scara_kinetostatic.errors import InputError, ParameterError, did_you_mean
from scara_kinetostatic.files.yaml_file import MappingReader, Within, parse_yaml, read_text, shown
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import inverse
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.simulation.plan import LARGEST_PRELOAD, REACH_MARGIN, Plan, within_reach
from scara_kinetostatic.simulation.slides import Circle, Slide, polygon

POSTURES = {'left': 1, 'right': -1, 1: 1, -1: -1}
POSTURE_NAMES = {1: 'left', -1: 'right'}
_SLIDE_VALUES = {'force': 'force', 'friction': 'friction', 'speed': 'speed', 'from': 'begin', 'to': 'end'}
"""Fields of a slide by key."""
_FORCE = Within(0.0, 10_000.0, positive=True, unit='N')
_RADIUS = Within(0.0, 10.0, positive=True, unit='m')
_PRELOAD = Within(0.0, LARGEST_PRELOAD, unit='of the force')


class PlanError(InputError):
    """A plan that cannot be read or is not valid."""


def load_plan(path: str | Path, cell: Cell) -> Plan | tuple[Slide, ...]:
    """Read a plan of touches, or one of slides, whose first entry has the key `slide`.

    Args:
        path: the file.
        cell: its discs, tip and nominal arm.

    Raises:
        PlanError: the file cannot be read, or an entry is not valid or out of reach.
    """
    return parse_plan(read_text(path, PlanError), cell, path)


def parse_plan(text: str, cell: Cell, where: str | Path = 'plan') -> Plan | tuple[Slide, ...]:
    """The plan that a YAML text holds; see `load_plan`."""
    data = parse_yaml(text, where, PlanError)
    if not isinstance(data, list) or not data:
        raise PlanError(where, 'expected a list with one touch or slide per entry', 'see docs/reference/formats.md')
    required: tuple[str, ...]
    optional: tuple[str, ...]
    if slides := isinstance(data[0], dict) and 'slide' in data[0]:
        what, required, optional = 'slide', ('slide',), (*_SLIDE_VALUES, 'posture')
    else:
        what, required, optional = 'touch', ('disc', 'angle_deg', 'posture', 'force'), ('preload',)
    entries = [
        MappingReader(PlanError, f'{where}: {what} {k}', '', entry, required, optional) for k, entry in enumerate(data)
    ]
    return tuple(_slide(entry, cell) for entry in entries) if slides else _touches(entries, cell, where)


def _touches(entries: list[MappingReader], cell: Cell, where: str | Path) -> Plan:
    rows = []
    names = [disc.name for disc in cell.discs]
    for entry in entries:
        name, preload = entry.word('disc'), entry.optional('preload', within=_PRELOAD)
        if name not in names:
            raise entry.error('disc', f'the cell has no disc {name!r}', did_you_mean(name, names, 'its discs are'))
        angle, force = math.radians(entry.number('angle_deg')), entry.number('force', within=_FORCE)
        rows.append((names.index(name), angle, _posture(entry), force, preload or 0.0))
    plan = Plan(*(np.array(column) for column in zip(*rows, strict=True)))
    possible = cell.can_take(inverse(cell.nominal, plan.contact(cell), plan.posture))
    lost = np.flatnonzero(~(within_reach(cell, plan) & possible))
    if len(lost):
        problem = f'the arm does not reach it with a margin of {1e3 * REACH_MARGIN:.0f} mm'
        remedy = 'choose another angle_deg or posture, or correct robot.limits'
        raise PlanError(f'{where}: touch {lost[0]}', f'{problem}, or another disc stands before it', remedy)
    return plan


def _posture(entry: MappingReader) -> int:
    given = entry.data.get('posture', 'left')
    if type(given) not in (int, str) or given not in POSTURES:
        raise entry.error('posture', f'expected left, right, 1 or -1, got {shown(given)}')
    return POSTURES[given]


def dump_plan(plan: Plan, cell: Cell, remarks: tuple[str, ...] = ()) -> str:
    """The plan as YAML, one touch per line, in the order of time.

    Args:
        plan: the touches.
        cell: names the discs.
        remarks: lines of comment at the top.
    """
    lines = [f'# {" ".join(remark.split())}' for remark in remarks]
    columns = (plan.disc, plan.angle, plan.posture, plan.force, plan.preload)
    for disc, angle, posture, force, preload in zip(*columns, strict=True):
        # a string of JSON is one of YAML, whatever the name holds
        name = json.dumps(cell.discs[disc].name, ensure_ascii=False)
        values = f'posture: {POSTURE_NAMES[int(posture)]}, force: {_decimal(force)}'
        values += f', preload: {_decimal(preload)}' if preload > 0 else ''
        lines.append(f'- {{disc: {name}, angle_deg: {_decimal(np.degrees(angle))}, {values}}}')
    return '\n'.join(lines) + '\n'


def _decimal(value: float) -> str:
    return np.format_float_positional(round(float(value), 9), trim='-')


def _slide(entry: MappingReader, cell: Cell) -> Slide:
    values = {name: entry.number(key) for key, name in _SLIDE_VALUES.items() if key in entry.data}
    if 'force' in values:
        entry.number('force', within=_FORCE)
    try:
        return Slide(_outline(entry, cell), posture=_posture(entry), **values)
    except ParameterError as error:
        raise entry.error('', error.problem, error.remedy) from error


def _outline(entry: MappingReader, cell: Cell) -> Outline | Circle:
    """The outline under the key `slide`: of a disc of the cell, by its name, of another disc, or of corners."""
    given = entry.data['slide']
    if isinstance(given, str):
        discs = {disc.name: disc for disc in cell.discs}
        if given not in discs:
            raise entry.error('slide', f'the cell has no disc {given!r}', did_you_mean(given, discs, 'its discs are'))
        disc = discs[given]
        if isinstance(disc, Outline):
            return disc
        if (radius := disc.radius - (cell.tip_radius or 0.0)) <= 0:
            raise entry.error('slide', f'{given!r} is smaller than the tip', 'correct its radius, or tip.radius')
        return Circle((disc.x, disc.y), radius)
    if not (isinstance(given, dict) and 'outline' in given):
        shape = entry.section('slide', ('center', 'radius'))
        return Circle(_pair(shape, 'center'), shape.number('radius', within=_RADIUS))
    shape = entry.section('slide', ('outline',), ('corner_radius', 'closed'))
    corners, closed = shape.data['outline'], shape.data.get('closed', True)
    if not isinstance(corners, list):
        raise shape.error('outline', f'expected a list of corners [x, y], got {shown(corners)}')
    if not isinstance(closed, bool):
        raise shape.error('closed', f'expected true or false, got {shown(closed)}')
    points = shape.vector('outline', list(map(str, range(len(corners)))), _pair)
    return polygon(points, shape.optional('corner_radius') or 0.0, closed)


def _pair(shape: MappingReader, name: str) -> tuple[float, float]:
    x, y = shape.vector(name, ('x', 'y'))
    return x, y
