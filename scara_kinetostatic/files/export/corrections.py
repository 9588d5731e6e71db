"""Corrections of the joint angles of the nominal arm, over workspace and load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.tip_uncertainty import NEARLY_STRETCHED
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import inverse, wrap

MOST_ROWS = 1_000_000
"""Of a table, some 100 MB."""


class Grid(NamedTuple):
    """The poses of a correction table.

    Attributes:
        step: distance of its places along x and y, m; None: as the accuracy needs.
        forces: magnitudes of the force, N; 0 has one row per place, the others one per direction.
        accuracy: error of the tip by interpolation that 95 % of the middles between places keep, m.
    """

    step: float | None
    forces: tuple[float, ...]
    accuracy: float = np.inf


class _Table(NamedTuple):
    """The rows of one elbow posture: p places by f forces.

    Attributes:
        posture: +1 left, -1 right.
        nominal: joint angles of the nominal rigid arm, in the turn of the commands, (p, f, 2), rad.
        change: what to add, (p, f, 2), rad; NaN where one of the arms does not reach, or not within its limits.
        miss: error of the tip without it, (p, f), m.
        std: standard uncertainty of the tip, (p, f), m.
        status: (p, f).
    """

    posture: int
    nominal: Floats
    change: Floats
    miss: Floats
    std: Floats
    status: NDArray[Any]


def correction_file(arm: CalibratedArm, head: Sequence[str], grid: Grid) -> tuple[str, list[str]]:
    """The correction table as CSV: what to add to the joint angles of the nominal arm; and what to know of it.

    A row has the place of the tip, the force, the elbow, the joint angles by the nominal rigid arm, the correction of
    each, the error of the tip without it, and the standard uncertainty of the tip along the force, in the worst
    direction without one. Places out of reach of either arm, or beyond robot.limits, are left out. The head states the
    error of the tip halfway between places, by bilinear interpolation.

    Raises:
        ParameterError: step or accuracy make more than `MOST_ROWS` rows.
        UnsupportedDataError: there is no row.
    """
    forces, step = _forces(grid.forces), grid.step or 0.1
    while True:
        cells = _cells(arm, step)
        count = len(cells) * len(forces) * len(arm.used.postures)
        if count > MOST_ROWS:
            name, value = ('--step', grid.step) if grid.step else ('--accuracy', grid.accuracy)
            problem = f'{value:g} m needs a table of up to {count:.2g} rows, {MOST_ROWS:.2g} are the most'
            raise ParameterError(name, problem, 'give more, choose fewer forces, or bound the region of the cell')
        places = _places(arm, step, cells)
        tables = [_table(arm, places, forces, posture) for posture in arm.used.postures]
        if not any(np.isfinite(table.change).all(axis=2).any() for table in tables):
            problem = 'no place of the grid can be reached under these forces, within robot.limits'
            raise UnsupportedDataError(problem, 'choose a smaller --step or smaller forces')
        errors = _errors_between(arm, step, cells, forces, tables)
        if grid.step or (len(errors) and np.quantile(errors, 0.95) <= grid.accuracy):
            break
        step /= 2
    between = _in_words(errors)
    lines = [
        *(f'# {line}' for line in head),
        '# Command q1_nominal_rad + dq1_rad and q2_nominal_rad + dq2_rad to have the tip at x_m, y_m under the force.',
        f'# Places {step:g} m apart; {between}.',
        'x_m,y_m,fx_N,fy_N,elbow,q1_nominal_rad,q2_nominal_rad,dq1_rad,dq2_rad,miss_m,std_normal_m,status',
    ]
    rows = (row for table in tables for row in _rows(arm.cell, table, places, forces))
    notes, low, high = [f'places {step:g} m apart; {between}'], arm.used.lowest_force, arm.used.highest_force
    if beyond := [f'{size:g}' for size in grid.forces if size > high or 0 < size < low]:
        touched = f'the forces of the calibration, {low:.3g} to {high:.3g} N'
        notes.append(f'{", ".join(beyond)} N is outside of {touched}: extrapolated')
    return '\n'.join([*lines, *rows]) + '\n', notes


def _table(arm: CalibratedArm, places: Floats, forces: Floats, posture: int) -> _Table:
    count = len(forces)
    tip, force = np.repeat(places, count, axis=0), np.tile(forces, (len(places), 1))
    rigid, predictor = np.repeat(inverse(arm.cell.nominal, places, posture), count, axis=0), Predictor(arm)
    found = predictor.compensate(tip, force, np.full(len(tip), posture))
    miss = np.linalg.norm(predictor.locate(rigid, force).position - tip, axis=1)
    per_force = (miss.reshape(-1, count), found.std_normal.reshape(-1, count), found.status.reshape(-1, count))
    change = np.where(arm.cell.can_take(found.joints)[:, None], wrap(found.joints - rigid), np.nan)
    return _Table(posture, (found.joints - change).reshape(-1, count, 2), change.reshape(-1, count, 2), *per_force)


def _rows(cell: Cell, table: _Table, places: Floats, forces: Floats) -> Iterator[str]:
    nominal, change = cell.readings(table.nominal), cell.readings(table.change)
    for k, j in np.argwhere(np.isfinite(table.change).all(axis=2)).tolist():
        std = table.std[k, j] if np.isfinite(table.std[k, j]) else ''
        angles = *nominal[k, j].tolist(), *change[k, j].tolist()
        elbow = 'left' if table.posture > 0 else 'right'
        row = (*places[k].tolist(), *forces[j].tolist(), elbow, *angles, table.miss[k, j], std, table.status[k, j])
        yield ','.join(value if isinstance(value, str) else f'{value:.10g}' for value in row)


def _errors_between(arm: CalibratedArm, step: float, cells: Indices, forces: Floats, tables: list[_Table]) -> Floats:
    """How far interpolated corrections miss the tip in the middles between four places, (k,), m."""
    number = {cell: k for k, cell in enumerate(map(tuple, cells.tolist()))}
    square = ((0, 0), (1, 0), (0, 1), (1, 1))
    corners = [[number.get((x + dx, y + dy), -1) for dx, dy in square] for x, y in cells.tolist()]
    whole = np.array(corners, dtype=np.intp).reshape(-1, 4)
    whole = whole[(whole >= 0).all(axis=1)]
    middle = np.repeat(_places(arm, step, cells)[whole[:, 0]] + step / 2, len(forces), axis=0)
    force, predictor, missed = np.tile(forces, (len(whole), 1)), Predictor(arm), [np.zeros(0)]
    for table in tables:
        change = table.change[whole].mean(axis=1).reshape(-1, 2)
        joints = inverse(arm.cell.nominal, middle, table.posture) + change
        known = np.isfinite(joints).all(axis=1)
        found = predictor.locate(joints[known], force[known]).position
        missed.append(np.linalg.norm(found - middle[known], axis=1))
    errors = np.concatenate(missed)
    return np.asarray(errors[np.isfinite(errors)])


def _in_words(errors: Floats) -> str:
    if not len(errors):
        return 'the places are too far apart to interpolate between them'
    largest, most = (f'{1e3 * value:.2g}' for value in (errors.max(), np.quantile(errors, 0.95)))
    return (
        f'halfway between places, bilinear interpolation of dq misses the tip by less than {most} mm in 95 % of the '
        f'middles, by up to {largest} mm where the arm is nearly stretched or folded or a backlash changes sides'
    )


def _cells(arm: CalibratedArm, step: float) -> Indices:
    """The places of a grid through the base, within reach of the nominal arm and in the region, in steps, (n, 2)."""
    p = arm.cell.nominal
    longest = NEARLY_STRETCHED * (p.l1 + p.l2)
    shortest = abs(p.l1 - p.l2) + (1 - NEARLY_STRETCHED) * (p.l1 + p.l2)
    number = int(longest / step)
    line = np.arange(-number, number + 1)
    cells = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    cells = cells[arm.cell.region.holds(_places(arm, step, cells))]
    distance = step * np.hypot(*cells.T)
    return cells[(distance <= longest) & (distance >= shortest)]


def _places(arm: CalibratedArm, step: float, cells: Indices) -> Floats:
    """The tip at cells, (n, 2), m."""
    return np.asarray((arm.cell.nominal.x0, arm.cell.nominal.y0) + step * cells)


def _forces(magnitudes: tuple[float, ...]) -> Floats:
    directions = 8
    angles = 2 * np.pi / directions * np.arange(directions)
    unit = np.stack([np.cos(angles), np.sin(angles)], axis=1).round(15) + 0.0
    return np.concatenate([np.zeros((1, 2)) if size == 0 else size * unit for size in magnitudes])
