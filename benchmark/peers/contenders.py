"""The solvers that are compared. Each starts at L̄n, is given the noise, and returns L̄.

- `package`: `calibrate` as a whole: sensor errors, three stages, outliers, identifiability, covariance, residuals.
- `minimisation`: the solver of this package alone, which does what the peers do and no more.
- `casadi angles`, `casadi forces`: one NLP over all touches with exact derivatives, by IPOPT, in two formulations.
- `scipy`: the usual formulation: residual F - A(Q, L̄), A by an `fsolve` per touch, 2-point differences.
- `scipy scalars`: the same with the equations of a touch written for speed, in three unknowns and plain numbers.

CasADi and `minimisation` solve the same problem: the least change of Q and F, in standard deviations, that makes
every touch satisfy the model. SciPy has the easier one without weights, (9) of the paper:
every `fsolve` starts at the measured angles and force. All peers are given the signs of the torques.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import fsolve, least_squares

from benchmark.common import CELL, NOISE, peak_memory, repeat, reset_peak_memory
from benchmark.peers.problem import Prepared, Problem, Solution, simulated
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.fit_point import COARSE, FINAL, evaluate
from scara_kinetostatic.calibration.gauss_helmert import as_radial, first_guess
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.solver import Subspace, minimise
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import ExtendedModel

START = CELL.nominal.as_array()
ANGLE, METRE = 1e-3, 1e-3
"""Units in which IPOPT sees changes of angles, rad, and misclosures, m."""


def package(problem: Problem) -> Prepared:
    """All that `calibrate` does."""

    def solve() -> Solution:
        found = calibrate(problem.touches, CELL)
        return Solution(found.parameters.as_array(), found.iterations, found.termination.value == 'converged')

    return Prepared(solve)


def minimisation(problem: Problem) -> Prepared:
    """The coarse stage and the sum of squares, all touches taken as good."""

    def solve() -> Solution:
        observations = observe(problem.touches, CELL)
        everything = Subspace(START, np.diag(SCALES))
        start = ExtendedModel(CELL.nominal)
        first = evaluate(observations, start, first_guess(observations, start), NOISE, COARSE)
        near = minimise(observations, first, everything, NOISE, COARSE)
        adjusted = as_radial(observations, near.point.model, near.point.adjusted.state)
        point = evaluate(observations, near.point.model, adjusted, NOISE)
        fit = minimise(observations, point, everything, NOISE, FINAL)
        iterations = near.iterations + fit.iterations
        return Solution(fit.point.parameters.as_array(), iterations, fit.termination.value == 'converged')

    return Prepared(solve)


def casadi_angles(problem: Problem) -> Prepared:
    """Unknown per touch: both link angles and the size of the force, whose direction follows; one constraint."""
    return _casadi(problem, 3, _by_angles)


def casadi_forces(problem: Problem) -> Prepared:
    """Unknown per touch: both link angles and both components of the force; two constraints."""
    return _casadi(problem, 4, _by_forces)


def _casadi(problem: Problem, unknowns: int, formulate: Callable[..., tuple[Any, Any, Any, Any]]) -> Prepared:
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

    def solve() -> Solution:
        found = solver(x0=begin_values, lbg=0, ubg=0)
        state = solver.stats()
        return Solution(START + SCALES * found['x'].full()[:12, 0], state['iter_count'], state['success'])

    return Prepared(solve, build)


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


def scipy_arrays(problem: Problem) -> Prepared:
    """The equations of a touch as they stand in the paper: Q* and F unknown, vectors and matrices."""
    touches = problem.touches
    starts = np.concatenate([touches.joints, touches.force], axis=1)
    known = list(zip(touches.joints, problem.signs, problem.centers, problem.radii, strict=True))

    def residual(values: Floats) -> Floats:
        pairs = zip(starts, known, strict=True)
        return (touches.force - [fsolve(_vectors, start, (values, *touch))[2:] for start, touch in pairs]).ravel()

    return _least_squares(residual)


def scipy_scalars(problem: Problem) -> Prepared:
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

    return _least_squares(residual)


def _least_squares(residual: Callable[[Floats], Floats]) -> Prepared:
    def solve() -> Solution:
        found = least_squares(residual, CELL.nominal.as_array(), jac='2-point', x_scale=SCALES)
        return Solution(found.x, int(found.nfev), bool(found.success))

    return Prepared(solve)


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


CONTENDERS: dict[str, Callable[[Problem], Prepared]] = {
    'package': package,
    'minimisation': minimisation,
    'casadi angles': casadi_angles,
    'casadi forces': casadi_forces,
    'scipy': scipy_arrays,
    'scipy scalars': scipy_scalars,
}


def measure(job: tuple[str, int]) -> dict[str, Any]:
    """Time one contender on one number of touches; runs in a process of its own."""
    warnings.simplefilter('ignore', RuntimeWarning)  # of fsolve, at intermediate points
    name, count = job
    prepared = CONTENDERS[name](simulated(count))
    reset_peak_memory()
    solution = prepared.solve()
    return {
        'contender': name,
        'touches': count,
        'build': prepared.build,
        **repeat(prepared.solve),
        'peak': peak_memory(),
        'iterations': solution.iterations,
        'success': solution.success,
        'values': solution.values.tolist(),
    }
