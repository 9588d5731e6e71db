"""SciPy: residual F - A(Q, L̄), (9) of the paper, with A by an `fsolve` per touch and 2-point differences over L̄.

Every `fsolve` starts at the measured angles and force; the signs of the torques are given.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import fsolve, least_squares

from benchmark.peers_problem import CELL, Answer, Problem, Ready
from scara_kinetostatic.calibration.identifiability import SCALES

Floats = NDArray[np.float64]


def scipy_arrays(problem: Problem) -> Ready:
    """The equations of a touch as they stand in the paper: Q* and F unknown, vectors and matrices."""
    touches = problem.touches
    starts = np.concatenate([touches.joints, touches.force], axis=1)
    known = list(zip(touches.joints, problem.signs, problem.centers, problem.radii, strict=True))

    def residual(values: Floats) -> Floats:
        pairs = zip(starts, known, strict=True)
        return (touches.force - [fsolve(_vectors, start, (values, *touch))[2:] for start, touch in pairs]).ravel()

    return _ready(residual)


def scipy_scalars(problem: Problem) -> Ready:
    """The same for speed: link angles and size of the force unknown, its direction eliminated, plain numbers."""
    touches = problem.touches
    rows = np.column_stack([touches.joints, problem.signs, problem.centers, problem.radii]).tolist()
    starts = np.column_stack([touches.joints, np.hypot(touches.force[:, 0], touches.force[:, 1])])

    def residual(values: Floats) -> Floats:
        listed = values.tolist()
        force = [
            _force(fsolve(_scalars, start, (listed, touch)), listed, touch)
            for start, touch in zip(starts, rows, strict=True)
        ]
        return (touches.force - np.array(force)).ravel()

    return _ready(residual)


def _ready(residual: Callable[[Floats], Floats]) -> Ready:
    def solve() -> Answer:
        found = least_squares(residual, CELL.nominal.as_array(), jac='2-point', x_scale=SCALES)
        return Answer(found.x, int(found.nfev), bool(found.success))

    return Ready(solve)


def _vectors(state: Floats, values: Floats, joints: Floats, signs: Floats, center: Floats, radius: float) -> Floats:
    """(6), (7), (8) and (11) of one touch at Q* and F."""
    links, force = state[:2], state[2:]
    x0, y0, theta1, l1, theta2, l2, p_ee, p1, p2, g_ee, g1, g2 = values
    first = links[0] + theta1
    second = first + links[1] + theta2
    link1 = l1 * np.array([np.cos(first), np.sin(first)])
    link2 = l2 * np.array([np.cos(second), np.sin(second)])
    both = link1 + link2
    jacobian = np.array([[-both[1], -link2[1]], [both[0], link2[0]]])
    unit = force / np.linalg.norm(force)
    rows = links + np.array([p1, p2]) * (jacobian.T @ force) + np.array([g1, g2]) * signs - joints
    tip = np.array([x0, y0]) + both - p_ee * force - g_ee * unit
    return np.concatenate([rows, tip + radius * unit - center])


def _scalars(state: Floats, values: list[float], touch: list[float]) -> list[float]:
    """(6), (7), (8) and (11) of one touch at link angles and force."""
    link1, link2, magnitude = state.tolist()
    q1, q2, s1, s2, _, _, radius = touch
    ex, ey, kx, ky, dx, dy = _arms(link1, link2, values, touch)
    distance = math.hypot(dx, dy)
    fx, fy = magnitude * dx / distance, magnitude * dy / distance
    return [
        link1 + values[7] * (ex * fy - ey * fx) + values[10] * s1 - q1,
        link2 + values[8] * (kx * fy - ky * fx) + values[11] * s2 - q2,
        distance - radius + values[9] + values[6] * magnitude,
    ]


def _arms(link1: float, link2: float, values: list[float], touch: list[float]) -> tuple[float, ...]:
    """From both axes to the rigid tip, and from there to the disc's centre."""
    x0, y0, theta1, l1, theta2, l2 = values[:6]
    first = link1 + theta1
    second = first + link2 + theta2
    kx, ky = l2 * math.cos(second), l2 * math.sin(second)
    ex, ey = l1 * math.cos(first) + kx, l1 * math.sin(first) + ky
    return ex, ey, kx, ky, touch[4] - x0 - ex, touch[5] - y0 - ey


def _force(state: Floats, values: list[float], touch: list[float]) -> tuple[float, float]:
    link1, link2, magnitude = state.tolist()
    *_, dx, dy = _arms(link1, link2, values, touch)
    distance = math.hypot(dx, dy)
    return magnitude * dx / distance, magnitude * dy / distance
