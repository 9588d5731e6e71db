"""Which edge or corner of an outline a touch is of.

Edges and corners are tangent-continuous: where a touch lies a distance δ beyond the end of its edge, a corner of radius
r is δ²/2r away from it. So a first choice by nominal place and direction of the force is good enough for a fit, and the
place of the tip by the fit decides.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.kinematics import forward, rotate

PER_ANGLE = 0.1
"""What an angle between force and normal counts beside a distance while the place is the nominal one, m/rad."""
PER_ANGLE_FITTED = 1e-3
"""The same by the place of a fit."""


def touched_surfaces(cell: Cell, joints: Floats, force: Floats, disc: Indices, known: Indices) -> Indices:
    """Numbers of the touched surfaces among `Cell.surfaces`, (n,), by the nominal arm where they are not known.

    Args:
        cell: nominal arm, objects, frame of the sensor.
        joints: Q, (n, 2), rad.
        force: F on the object in the frame of the sensor, (n, 2), N.
        disc: number of the touched object, (n,).
        known: numbers that are known, -1 elsewhere, (n,).
    """
    p, todo, found = cell.nominal, known < 0, known.copy()
    if todo.any():
        if cell.sensor.frame is SensorFrame.TOOL:
            force = rotate(force, joints.sum(axis=1) + p.theta1 + p.theta2)
        tips, unit = forward(p, joints[todo]), force[todo] / np.maximum(np.hypot(*force[todo].T), 1e-300)[:, None]
        misses = cell.surfaces.misses(tips, unit, PER_ANGLE)[0]
        size = np.where(unit.any(axis=1)[:, None], np.hypot(*misses.transpose(2, 0, 1)), cell.surfaces.distances(tips))
        found[todo] = nearest_surfaces(cell, size, disc[todo])
    return found


def settled_surfaces(cell: Cell, tips: Floats, normals: Floats, disc: Indices) -> Indices:
    """Numbers of the touched surfaces, (n,), by tips and directions of the forces in a fit, (n, 2)."""
    size = cell.surfaces.distances(tips) + PER_ANGLE_FITTED * cell.surfaces.beside(normals)
    return nearest_surfaces(cell, size, disc)


def nearest_surfaces(cell: Cell, size: Floats, disc: Indices) -> Indices:
    """The surface of each touch's object with the smallest of sizes (n, E)."""
    return np.argmin(np.where(cell.surfaces.object == disc[:, None], size, np.inf), axis=1)
