"""Corrections of the joint angles of the nominal arm, over workspace and load."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.tip_uncertainty import NEARLY_STRETCHED
from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.compensation.predictions import Predictor
from scara_kinetostatic.files.export.facts import ExportFacts
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.kinematics import inverse, wrap

_DIRECTIONS = 8
"""Directions of the force in a correction table."""
_ELBOWS = {1: 'left', -1: 'right'}


class Grid(NamedTuple):
    """The poses of a correction table.

    Attributes:
        step: distance of its places along x and y, m.
        forces: magnitudes of the force, N; 0 has one row per place, the others one per direction.
    """

    step: float
    forces: tuple[float, ...]


def correction_text(arm: CalibratedArm, facts: ExportFacts, grid: Grid) -> str:
    """The correction table as CSV: what to add to the joint angles of the nominal arm.

    A row has the place of the tip, the force, the elbow, the joint angles by the nominal rigid arm, the correction of
    each, the error of the tip without it, and the standard uncertainty of the tip along the force, in the worst
    direction without one. Places out of reach of either arm are left out.
    """
    lines = [
        *(f'# {line}' for line in facts.lines),
        '# Command q1_nominal_rad + dq1_rad and q2_nominal_rad + dq2_rad to have the tip at x_m, y_m under the force.',
        'x_m,y_m,fx_N,fy_N,elbow,q1_nominal_rad,q2_nominal_rad,dq1_rad,dq2_rad,miss_m,std_normal_m,status',
    ]
    return '\n'.join([*lines, *(_row(row) for row in _corrections(arm, grid))]) + '\n'


def _row(values: tuple[object, ...]) -> str:
    return ','.join(value if isinstance(value, str) else f'{value:.10g}' for value in values)


def _corrections(arm: CalibratedArm, grid: Grid) -> Iterator[tuple[object, ...]]:
    places, forces = _places(arm, grid.step), _forces(grid.forces)
    tip, force = np.repeat(places, len(forces), axis=0), np.tile(forces, (len(places), 1))
    predictor = Predictor(arm)
    for posture in arm.used.postures:
        nominal = inverse(arm.cell.nominal, tip, posture)
        found = predictor.compensate(tip, force, np.full(len(tip), posture))
        change = wrap(found.joints - nominal)
        miss = np.linalg.norm(predictor.locate(nominal, force).position - tip, axis=1)
        for k in np.flatnonzero(np.isfinite(change).all(axis=1)):
            std = found.std_normal[k]
            yield (
                *tip[k].tolist(), *force[k].tolist(), _ELBOWS[posture], *nominal[k].tolist(), *change[k].tolist(),
                float(miss[k]), float(std) if np.isfinite(std) else '', str(found.status[k]),
            )  # fmt: skip


def _places(arm: CalibratedArm, step: float) -> Floats:
    """Places of a grid through the base that the nominal arm reaches, (n, 2), m."""
    p = arm.cell.nominal
    longest = NEARLY_STRETCHED * (p.l1 + p.l2)
    shortest = abs(p.l1 - p.l2) + (1 - NEARLY_STRETCHED) * (p.l1 + p.l2)
    number = int(longest / step)
    line = step * np.arange(-number, number + 1)
    offsets = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    distance = np.hypot(*offsets.T)
    return np.asarray((p.x0, p.y0) + offsets[(distance <= longest) & (distance >= shortest)])


def _forces(magnitudes: tuple[float, ...]) -> Floats:
    angles = 2 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.concatenate([np.zeros((1, 2)) if size == 0 else size * unit for size in magnitudes])
