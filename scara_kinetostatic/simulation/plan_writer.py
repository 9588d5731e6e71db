"""A plan of touches put into the form that `plan_file` reads."""

from __future__ import annotations

import json

import numpy as np

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.plan import Plan

POSTURES = {1: 'left', -1: 'right'}
DIGITS = 9
"""Of angles in degrees, forces in N and preload, after the point: far below what an arm can do."""


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
        side = POSTURES[int(posture)]
        lines.append(
            f'- {{disc: {name}, angle_deg: {_decimal(np.degrees(angle))}, posture: {side}, '
            f'force: {_decimal(force)}{more}}}'
        )
    return '\n'.join(lines) + '\n'


def _decimal(value: float) -> str:
    return np.format_float_positional(round(float(value), DIGITS), trim='-')
