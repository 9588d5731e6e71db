"""What is wrong with the places and sizes of the discs of a cell, in words."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell


def layout_problems(cell: Cell, centers: Floats, radii: Floats) -> list[str]:
    """Why discs cannot be touched, or not without touching another one, one clause each; empty where they can.

    Args:
        cell: for the names and the nominal arm.
        centers: of the m discs, base frame, (m, 2), m.
        radii: of them, to the centre of the tip, (m,), m.
    """
    base = np.array([cell.nominal.x0, cell.nominal.y0])
    farthest, nearest = cell.nominal.l1 + cell.nominal.l2, abs(cell.nominal.l1 - cell.nominal.l2)
    names, found = [disc.name for disc in cell.discs], []
    for name, radius, away in zip(names, radii, np.linalg.norm(centers - base, axis=1), strict=True):
        if away <= radius:
            found.append(f'disc {name!r} covers the base of the robot')
        elif away - radius > farthest or away + radius < nearest:
            reach = f'the tip reaches {nearest:.4g} to {farthest:.4g} m'
            found.append(f'disc {name!r} is out of reach, {away:.4g} m from the base where {reach}')
    for i in range(1, len(radii)):
        gaps = np.linalg.norm(centers[:i] - centers[i], axis=1) - radii[:i] - radii[i]
        found += [
            f'discs {names[j]!r} and {names[i]!r} overlap by {-gaps[j]:.4g} m' for j in np.argsort(gaps) if gaps[j] < 0
        ]
    return found
