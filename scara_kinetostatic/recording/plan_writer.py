"""A plan of touches put into the form that `plan_file` reads."""

from __future__ import annotations

import json

import numpy as np

from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.simulation.plan import Plan

POSTURES = {1: 'left', -1: 'right'}
DIGITS = 9
"""Of angles in degrees and forces in N, after the point: far below what an arm can do."""


def dump_plan(plan: Plan, cell: Cell, remarks: tuple[str, ...] = ()) -> str:
    """The plan as YAML, one touch per line, in the order of time.

    Args:
        plan: the touches.
        cell: names the discs.
        remarks: lines of comment at the top.
    """
    lines = [f'# {" ".join(remark.split())}' for remark in remarks]
    for disc, angle, posture, force in zip(plan.disc, plan.angle, plan.posture, plan.force, strict=True):
        # a string of JSON is one of YAML, whatever the name holds
        name = json.dumps(cell.discs[disc].name, ensure_ascii=False)
        degrees = round(float(np.degrees(angle)), DIGITS)
        angle_deg, newtons = (np.format_float_positional(v, trim='-') for v in (degrees, round(float(force), DIGITS)))
        lines.append(f'- {{disc: {name}, angle_deg: {angle_deg}, posture: {POSTURES[int(posture)]}, force: {newtons}}}')
    return '\n'.join(lines) + '\n'
