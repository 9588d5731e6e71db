"""A plan of touches as a file: a YAML list, one touch per entry, in the order of time.

```yaml
- {disc: disc_1, angle_deg: 30, posture: left, force: 25}
- {disc: disc_2, angle_deg: -90, posture: right, force: 40, preload: 0.3}
```
`angle_deg` is the direction from the disc's centre to the contact in the base frame, degrees from x;
`posture` is `left` (sin(q2 + theta2) > 0, the elbow on the right of the line from the base
to the tip, the fore-arm bent to the left), `right`, +1 or -1; `force` in N; `preload`,
which may be left out, is the part of the force by which the press first goes beyond it.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.yaml_text import parse_yaml, read_text
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.plan import LARGEST_PRELOAD, REACH_MARGIN, Plan, within_reach

KEYS = ('disc', 'angle_deg', 'posture', 'force')
PRELOAD = 'preload'
POSTURES = {'left': 1, 'right': -1, 1: 1, -1: -1}
POSTURE_NAMES = {1: 'left', -1: 'right'}
DIGITS = 9
"""Decimals of angles in degrees, forces in N and preload in a written plan: far below what an arm can do."""
EXAMPLE = 'write {disc: NAME, angle_deg: 30, posture: left, force: 25}'
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
    entries = parse_yaml(text, where, PlanError)
    if not isinstance(entries, list) or not entries:
        raise PlanError(where, 'expected a list of touches', EXAMPLE)
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


def _entry(entry: Any, cell: Cell, where: str) -> tuple[int, float, int, float, float]:
    """Disc, angle in rad, posture, force and preload of one entry."""
    if not isinstance(entry, dict):
        raise PlanError(where, f'expected a mapping with {", ".join(KEYS)}, got {entry!r}', EXAMPLE)
    for key in entry:
        if key not in (*KEYS, PRELOAD):
            raise PlanError(where, f'unknown key {key!r}', f'the keys are {", ".join((*KEYS, PRELOAD))}')
    for key in KEYS:
        if entry.get(key) is None:
            raise PlanError(where, f'the key {key!r} is missing', EXAMPLE)
    names = [disc.name for disc in cell.discs]
    if entry['disc'] not in names:
        raise PlanError(where, f'unknown disc {entry["disc"]!r}', f'the discs of the cell are {", ".join(names)}')
    posture = entry['posture']
    if type(posture) not in (int, str) or posture not in POSTURES:
        raise PlanError(where, f'posture: expected left, right, 1 or -1, got {posture!r}')
    angle, force = (_number(entry, key, where) for key in ('angle_deg', 'force'))
    if not 0 < force <= LARGEST_FORCE:
        raise PlanError(where, f'force: expected N above 0 and up to {LARGEST_FORCE:.0f}, got {force:g}')
    preload = _number(entry, PRELOAD, where) if PRELOAD in entry else 0.0
    if not 0 <= preload <= LARGEST_PRELOAD:
        raise PlanError(where, f'preload: expected 0 to {LARGEST_PRELOAD:g} of the force, got {preload:g}')
    return names.index(entry['disc']), math.radians(angle), POSTURES[posture], force, preload


def _number(entry: dict[str, Any], key: str, where: str) -> float:
    value = entry[key]
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise PlanError(where, f'{key}: expected a number, got {value!r}')
    return float(value)


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
    return np.format_float_positional(round(float(value), DIGITS), trim='-')
