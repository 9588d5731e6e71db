"""CasADi with IPOPT: one NLP over all touches, exact sparse derivatives, in two formulations.

The least change of Q and F, in standard deviations, that makes every touch obey the model, with L̄ and the state of
each touch as unknowns. The signs of the torques are given.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmark.peers_problem import CELL, NOISE, Answer, Problem, Ready
from scara_kinetostatic.calibration.identifiability import SCALES

START = CELL.nominal.as_array()
ANGLE, METRE = 1e-3, 1e-3
"""Units in which IPOPT sees changes of angles, rad, and misclosures, m."""


def casadi_angles(problem: Problem) -> Ready:
    """Unknown per touch: both link angles and the size of the force, whose direction follows; one constraint."""
    return _casadi(problem, 3, _by_angles)


def casadi_forces(problem: Problem) -> Ready:
    """Unknown per touch: both link angles and both components of the force; two constraints."""
    return _casadi(problem, 4, _by_forces)


def _casadi(problem: Problem, unknowns: int, formulate: Callable[..., tuple[Any, Any, Any, Any]]) -> Ready:
    import casadi as ca

    begin = time.process_time()
    touches, (s1, s2) = problem.touches, problem.signs.T
    y, z = ca.SX.sym('y', 12), ca.SX.sym('z', len(touches), unknowns)
    values = ca.vertsplit(ca.DM(START) + ca.DM(SCALES) * y)
    x0, y0, theta1, l1, theta2, l2, _, p1, p2, _, g1, g2 = values
    change1, change2 = ANGLE * z[:, 0], ANGLE * z[:, 1]
    first = touches.joints[:, 0] + change1 + theta1
    second = first + touches.joints[:, 1] + change2 + theta2
    kx, ky = l2 * ca.cos(second), l2 * ca.sin(second)
    ex, ey = l1 * ca.cos(first) + kx, l1 * ca.sin(first) + ky
    apart = problem.centers[:, 0] - x0 - ex, problem.centers[:, 1] - y0 - ey
    fx, fy, misclosure, start = formulate(ca, problem, values, apart, z[:, 2:])
    row1 = change1 + p1 * (ex * fy - ey * fx) + g1 * s1
    row2 = change2 + p2 * (kx * fy - ky * fx) + g2 * s2
    off = [part / NOISE.joint for part in (row1, row2)]
    off += [(fx - touches.force[:, 0]) / NOISE.force, (fy - touches.force[:, 1]) / NOISE.force]
    nlp = {'x': ca.veccat(y, z), 'f': sum(ca.sumsqr(part) for part in off), 'g': misclosure / METRE}
    solver = ca.nlpsol('solver', 'ipopt', nlp, {'ipopt.print_level': 0, 'print_time': 0, 'ipopt.sb': 'yes'})
    begin_values = np.concatenate([np.zeros(12 + 2 * len(touches)), start])
    build = time.process_time() - begin

    def solve() -> Answer:
        found = solver(x0=begin_values, lbg=0, ubg=0)
        state = solver.stats()
        return Answer(START + SCALES * found['x'].full()[:12, 0], state['iter_count'], state['success'])

    return Ready(solve, build)


def _by_angles(ca: Any, problem: Problem, values: Any, apart: Any, z: Any) -> tuple[Any, Any, Any, Any]:
    p_ee, g_ee = values[6], values[9]
    measured = problem.touches.force
    magnitude = np.hypot(measured[:, 0], measured[:, 1]) + z
    distance = ca.sqrt(apart[0] ** 2 + apart[1] ** 2)
    fx, fy = magnitude * apart[0] / distance, magnitude * apart[1] / distance
    return fx, fy, distance - problem.radii + g_ee + p_ee * magnitude, np.zeros(len(measured))


def _by_forces(ca: Any, problem: Problem, values: Any, apart: Any, z: Any) -> tuple[Any, Any, Any, Any]:
    p_ee, g_ee = values[6], values[9]
    measured = problem.touches.force
    fx, fy = measured[:, 0] + z[:, 0], measured[:, 1] + z[:, 1]
    reach = (problem.radii - g_ee) / ca.sqrt(fx**2 + fy**2) - p_ee
    return fx, fy, ca.veccat(reach * fx - apart[0], reach * fy - apart[1]), np.zeros(2 * len(measured))
