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
- {slide: {center: [-0.20, 0.35], semi_axes: [0.08, 0.05], angle_deg: 20}, force: 20, from: 0, to: 1.05}
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
from typing import Any

import numpy as np

from scara_kinetostatic.errors import InputError, ParameterError, did_you_mean
from scara_kinetostatic.files.yaml_file import parse_yaml, read_text
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.outline import Outline, circle, ellipse, polygon
from scara_kinetostatic.simulation.plan import LARGEST_PRELOAD, REACH_MARGIN, Plan, within_reach
from scara_kinetostatic.simulation.slides import Slide

_KEYS = ('disc', 'angle_deg', 'posture', 'force')
POSTURES = {'left': 1, 'right': -1, 1: 1, -1: -1}
POSTURE_NAMES = {1: 'left', -1: 'right'}
_SLIDE_KEYS = ('slide', 'force', 'friction', 'speed', 'posture', 'from', 'to')
_TOUCH = 'write {disc: NAME, angle_deg: 30, posture: left, force: 25}'
_SLIDE = 'write {slide: {center: [0.2, 0.35], radius: 0.06}, force: 15}'
_FORMS = {
    'radius': ({'center', 'radius'}, set[str]()),
    'semi_axes': ({'center', 'semi_axes'}, {'angle_deg'}),
    'outline': ({'outline'}, {'corner_radius', 'closed'}),
}
"""Keys that each form of an outline must and may have, by the key that tells it."""
LARGEST_FORCE = 10_000.0
"""Largest force of a planned touch, N."""


class PlanError(InputError):
    """A plan that cannot be read or is not valid."""


def load_plan(path: str | Path, cell: Cell) -> Plan:
    """Read a plan.

    Args:
        path: the file.
        cell: its discs and nominal arm.

    Raises:
        PlanError: the file cannot be read, or an entry is not valid or out of reach.
    """
    return parse_plan(read_text(path, PlanError), cell, path)


def parse_plan(text: str, cell: Cell, where: str | Path = 'plan') -> Plan:
    """The plan that a YAML text holds; see `load_plan`."""
    entries = _entries(text, where, 'touches', _TOUCH)
    rows = [_entry(entry, cell, f'{where}: touch {number}') for number, entry in enumerate(entries)]
    plan = Plan(*(np.array(column) for column in zip(*rows, strict=True)))
    lost = np.flatnonzero(~within_reach(cell, plan))
    if len(lost):
        raise PlanError(
            f'{where}: touch {lost[0]}',
            f'the arm does not reach it with a margin of {1e3 * REACH_MARGIN:.0f} mm, or another disc stands before it',
            'choose another angle_deg',
        )
    return plan


def _entries(text: str, where: str | Path, what: str, example: str) -> list[Any]:
    entries = parse_yaml(text, where, PlanError)
    if not isinstance(entries, list) or not entries:
        raise PlanError(where, f'expected a list of {what}', example)
    return entries


def _entry(entry: Any, cell: Cell, where: str) -> tuple[int, float, int, float, float]:
    """Disc, angle in rad, posture, force and preload of one entry."""
    if not isinstance(entry, dict):
        raise PlanError(where, f'expected a mapping with {", ".join(_KEYS)}, got {entry!r}', _TOUCH)
    _check_keys(entry, (*_KEYS, 'preload'), where)
    for key in _KEYS:
        if entry.get(key) is None:
            raise PlanError(where, f'the key {key!r} is missing', _TOUCH)
    names = [disc.name for disc in cell.discs]
    if entry['disc'] not in names:
        raise PlanError(where, f'unknown disc {entry["disc"]!r}', f'the discs of the cell are {", ".join(names)}')
    posture = _posture(entry['posture'], where)
    angle, force = (_number(entry[key], f'{where}: {key}') for key in ('angle_deg', 'force'))
    if not 0 < force <= LARGEST_FORCE:
        raise PlanError(where, f'force: expected N above 0 and up to {LARGEST_FORCE:.0f}, got {force:g}')
    preload = _number(entry.get('preload', 0.0), f'{where}: preload')
    if not 0 <= preload <= LARGEST_PRELOAD:
        raise PlanError(where, f'preload: expected 0 to {LARGEST_PRELOAD:g} of the force, got {preload:g}')
    return names.index(entry['disc']), math.radians(angle), posture, force, preload


def _check_keys(entry: dict[Any, Any], keys: tuple[str, ...], where: str) -> None:
    for key in entry:
        if key not in keys:
            raise PlanError(where, f'unknown key {key!r}', did_you_mean(key, keys, 'the keys are'))


def _posture(given: Any, where: str) -> int:
    if type(given) not in (int, str) or given not in POSTURES:
        raise PlanError(where, f'posture: expected left, right, 1 or -1, got {given!r}')
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
        more = f', preload: {_decimal(preload)}' if preload > 0 else ''
        side = POSTURE_NAMES[int(posture)]
        lines.append(
            f'- {{disc: {name}, angle_deg: {_decimal(np.degrees(angle))}, posture: {side}, '
            f'force: {_decimal(force)}{more}}}'
        )
    return '\n'.join(lines) + '\n'


def _decimal(value: float) -> str:
    return np.format_float_positional(round(float(value), 9), trim='-')


def holds_slides(path: str | Path) -> bool:
    """Whether a plan is one of slides: its first entry has the key `slide`.

    Raises:
        PlanError: the file cannot be read.
    """
    entries = parse_yaml(read_text(path, PlanError), path, PlanError)
    return isinstance(entries, list) and bool(entries) and isinstance(entries[0], dict) and 'slide' in entries[0]


def load_slides(path: str | Path, cell: Cell) -> tuple[Slide, ...]:
    """Read a plan of slides.

    Args:
        path: the file.
        cell: its discs and tip.

    Raises:
        PlanError: the file cannot be read, or an entry is not valid.
    """
    entries = _entries(read_text(path, PlanError), path, 'slides', _SLIDE)
    return tuple(_slide(entry, cell, f'{path}: slide {number}') for number, entry in enumerate(entries))


def _slide(entry: Any, cell: Cell, where: str) -> Slide:
    if not isinstance(entry, dict) or 'slide' not in entry:
        raise PlanError(where, f'expected a mapping with the key {"slide"!r}, got {entry!r}', _SLIDE)
    _check_keys(entry, _SLIDE_KEYS, where)
    posture = _posture(entry.get('posture', 'left'), where)
    names = {'force': 'force', 'friction': 'friction', 'speed': 'speed', 'from': 'begin', 'to': 'end'}
    values = {name: _number(entry[key], f'{where}: {key}') for key, name in names.items() if key in entry}
    if values.get('force', 0.0) > LARGEST_FORCE:
        raise PlanError(where, f'force: expected up to {LARGEST_FORCE:.0f} N, got {values["force"]:g}')
    try:
        return Slide(_outline(entry['slide'], cell, where), posture=posture, **values)
    except ParameterError as error:
        raise PlanError(where, error.problem, error.remedy) from error


def _outline(given: Any, cell: Cell, where: str) -> Outline:
    if isinstance(given, str):
        return _disc(given, cell, where)
    form = next((key for key in _FORMS if isinstance(given, dict) and key in given), None)
    if form is None:
        raise PlanError(where, f'slide: expected a disc of the cell or an outline, got {given!r}', _SLIDE)
    needed, optional = _FORMS[form]
    for key in [*(needed - given.keys()), *(given.keys() - needed - optional)]:
        problem = f'slide: the key {key!r} is missing' if key in needed else f'slide: unknown key {key!r}'
        raise PlanError(where, problem, f'its keys are {", ".join(sorted(needed | optional))}')
    if form == 'outline':
        corners = given['outline']
        if not isinstance(corners, list):
            raise PlanError(where, f'outline: expected a list of corners [x, y], got {corners!r}')
        closed = given.get('closed', True)
        if not isinstance(closed, bool):
            raise PlanError(where, f'closed: expected true or false, got {closed!r}')
        points = [_pair(corner, f'{where}: outline') for corner in corners]
        return polygon(points, _number(given.get('corner_radius', 0.0), f'{where}: corner_radius'), closed)
    center = _pair(given['center'], f'{where}: center')
    if form == 'radius':
        return circle(center, _number(given['radius'], f'{where}: radius'))
    angle = math.radians(_number(given.get('angle_deg', 0.0), f'{where}: angle_deg'))
    return ellipse(center, _pair(given['semi_axes'], f'{where}: semi_axes'), angle)


def _disc(name: str, cell: Cell, where: str) -> Outline:
    for disc in cell.discs:
        if disc.name == name:
            return circle((disc.x, disc.y), disc.radius - (cell.tip_radius or 0.0))
    names = [disc.name for disc in cell.discs]
    raise PlanError(where, f'the cell has no disc {name!r}', did_you_mean(name, names, 'its discs are'))


def _pair(value: Any, where: str) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise PlanError(where, f'expected two numbers, got {value!r}')
    return _number(value[0], where), _number(value[1], where)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise PlanError(where, f'expected a number, got {value!r}')
    return float(value)
