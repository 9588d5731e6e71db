"""A plan of slides as a file: a YAML list, one slide per entry, in the order of time.

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

import math
from pathlib import Path
from typing import Any

from scara_kinetostatic.errors import ParameterError, did_you_mean
from scara_kinetostatic.files.yaml_text import parse_yaml, read_text
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.plan_file import LARGEST_FORCE, POSTURES, PlanError
from scara_kinetostatic.simulation.sliding.outline import Outline, circle, ellipse, polygon
from scara_kinetostatic.simulation.sliding.slide import Slide

KEY = 'slide'
KEYS = (KEY, 'force', 'friction', 'speed', 'posture', 'from', 'to')
EXAMPLE = 'write {slide: {center: [0.2, 0.35], radius: 0.06}, force: 15}'
_FORMS = {
    'radius': ({'center', 'radius'}, set[str]()),
    'semi_axes': ({'center', 'semi_axes'}, {'angle_deg'}),
    'outline': ({'outline'}, {'corner_radius', 'closed'}),
}
"""Keys that each form of an outline must and may have, by the key that tells it."""


def holds_slides(path: str | Path) -> bool:
    """Whether a plan is one of slides: its first entry has the key `slide`.

    Raises:
        PlanError: the file cannot be read.
    """
    entries = parse_yaml(read_text(path, PlanError), path, PlanError)
    return isinstance(entries, list) and bool(entries) and isinstance(entries[0], dict) and KEY in entries[0]


def load_slides(path: str | Path, cell: Cell) -> tuple[Slide, ...]:
    """Read a plan of slides.

    Args:
        path: the file.
        cell: its discs and tip.

    Raises:
        PlanError: the file cannot be read, or an entry is not valid.
    """
    entries = parse_yaml(read_text(path, PlanError), path, PlanError)
    if not isinstance(entries, list) or not entries:
        raise PlanError(path, 'expected a list of slides', EXAMPLE)
    return tuple(_slide(entry, cell, f'{path}: slide {number}') for number, entry in enumerate(entries))


def _slide(entry: Any, cell: Cell, where: str) -> Slide:
    if not isinstance(entry, dict) or KEY not in entry:
        raise PlanError(where, f'expected a mapping with the key {KEY!r}, got {entry!r}', EXAMPLE)
    for key in entry:
        if key not in KEYS:
            raise PlanError(where, f'unknown key {key!r}', did_you_mean(key, KEYS, 'the keys are'))
    posture = entry.get('posture', 'left')
    if type(posture) not in (int, str) or posture not in POSTURES:
        raise PlanError(where, f'posture: expected left, right, 1 or -1, got {posture!r}')
    names = {'force': 'force', 'friction': 'friction', 'speed': 'speed', 'from': 'begin', 'to': 'end'}
    values = {name: _number(entry[key], f'{where}: {key}') for key, name in names.items() if key in entry}
    if values.get('force', 0.0) > LARGEST_FORCE:
        raise PlanError(where, f'force: expected up to {LARGEST_FORCE:.0f} N, got {values["force"]:g}')
    try:
        return Slide(_outline(entry[KEY], cell, where), posture=POSTURES[posture], **values)
    except ParameterError as error:
        raise PlanError(where, error.problem, error.remedy) from error


def _outline(given: Any, cell: Cell, where: str) -> Outline:
    if isinstance(given, str):
        return _disc(given, cell, where)
    form = next((key for key in _FORMS if isinstance(given, dict) and key in given), None)
    if form is None:
        raise PlanError(where, f'slide: expected a disc of the cell or an outline, got {given!r}', EXAMPLE)
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
