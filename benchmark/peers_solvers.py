"""The contenders. Each starts at L̄n, knows the noise, and gives L̄.

- `package`: `calibrate`, whole: bad readings, three stages, outliers, what is identifiable, covariance, residuals.
- `minimisation`: the solver loop of this package alone, which does what the peers do and no more.
- `casadi angles`, `casadi forces`: one NLP over all touches with exact derivatives, by IPOPT, in two formulations.
- `scipy`: the way the problem is usually put: residual F - A(Q, L̄), A by an `fsolve` per touch, 2-point differences.
- `scipy scalars`: the same with the equations of a touch written for speed, in three unknowns and plain numbers.

CasADi and `minimisation` solve the same problem: the least change of Q and F, in standard deviations, that makes
every touch obey the model. SciPy has the easier one without weights, (9) of the paper.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmark.peers_casadi import casadi_angles, casadi_forces
from benchmark.peers_problem import CELL, NOISE, Answer, Problem, Ready
from benchmark.peers_scipy import scipy_arrays, scipy_scalars
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.gauss_helmert import first_guess
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import turn_radial
from scara_kinetostatic.calibration.solver import COARSE, FINAL, Subspace, minimise
from scara_kinetostatic.model.extended_model import ExtendedModel

Floats = NDArray[np.float64]
START = CELL.nominal.as_array()


def package(problem: Problem) -> Ready:
    """All that `calibrate` does."""

    def solve() -> Answer:
        found = calibrate(problem.touches, CELL)
        return Answer(found.parameters.as_array(), found.iterations, found.termination.value == 'converged')

    return Ready(solve)


def minimisation(problem: Problem) -> Ready:
    """The coarse stage and the sum of squares, all touches taken as good."""

    def solve() -> Answer:
        observations = observe(problem.touches, CELL)
        everything = Subspace(START, np.diag(SCALES))
        start = ExtendedModel(CELL.nominal)
        near = minimise(observations, start, first_guess(observations, start), everything, NOISE, COARSE)
        adjusted = turn_radial(observations, near.point)
        fit = minimise(observations, near.point.model, adjusted, everything, NOISE, FINAL)
        iterations = near.iterations + fit.iterations
        return Answer(fit.point.parameters.as_array(), iterations, fit.termination.value == 'converged')

    return Ready(solve)


CONTENDERS: dict[str, Callable[[Problem], Ready]] = {
    'package': package,
    'minimisation': minimisation,
    'casadi angles': casadi_angles,
    'casadi forces': casadi_forces,
    'scipy': scipy_arrays,
    'scipy scalars': scipy_scalars,
}
