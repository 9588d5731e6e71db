"""The candidate touches of a design, with their information and the tip whose variance is to be minimised.

A candidate is a point on a disc, a posture and a force level. Points out of reach are left out, and touches whose line
of force passes close to a joint's axis: there the torque is so small that noise, or a geometry some millimetres off the
nominal one, decides on which flank of the backlash the joint rests, and the prediction would not hold for the touch
made.

For the search alone every parameter has a prior: its plausible range (`SCALES`) as standard deviation. It keeps all
matrices regular, does not change what touches determine well, and bounds what they do not determine. The reported
numbers come from `prediction`, without this prior. What the cell description declares as uncertain is a prior of
another kind: it holds in the calibration, and in every number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.studies.design.prediction import Robot, exact_plan
from scara_kinetostatic.studies.design.workspace import Tip

LEAST_ARM = 0.02
"""Smallest distance of the line of force from each joint's axis, m; well above usual errors of the nominal geometry."""
PER_DISC = 36
"""Points around a disc."""
_SINGLE_THREAD = 200_000
"""Size of a matrix product up to which OpenBLAS works in one thread, multiplications."""
PRIOR = np.eye(len(NAMES))
"""Information of the prior of the search, in `SCALES`, (12, 12)."""


class CandidateTouches(NamedTuple):
    """Candidates and the tip whose variance counts; parameters in `SCALES`, then m declared errors in their own units.

    Attributes:
        plan: the n candidates.
        derivative: whitened Jacobian J of each, (n, 2, 12 + m).
        information: JᵀJ of each, (n, 12 + m, 12 + m).
        rows: indices of the parameters on which the tip depends, (k,).
        quadric: TᵀT over these at each place, packed, (k (k + 1) / 2, g).
        declared: rows of the prior of what the cell declares as uncertain, (p, 12 + m).
        prior: information of that prior and of the search's, (12 + m, 12 + m).
    """

    plan: Plan
    derivative: Floats
    information: Floats
    rows: NDArray[np.intp]
    quadric: Floats
    declared: Floats
    prior: Floats

    def variance(self, covariance: Floats) -> Floats:
        """Variance of the tip at each place for covariances of L̄ (…, 12, 12), (…, g), m²."""
        return self.traces(pack(covariance[..., self.rows[:, None], self.rows]))

    def traces(self, packed: Floats) -> Floats:
        """Trace of TᵀT times packed matrices (…, k (k + 1) / 2) at each place, (…, g).

        Computed in pieces small enough for a single BLAS thread: threads cost more than they gain on such products.
        """
        piece = max(1, _SINGLE_THREAD // self.quadric.size)
        if packed.ndim < 2 or len(packed) <= piece:
            return packed @ self.quadric
        return np.concatenate([packed[i : i + piece] @ self.quadric for i in range(0, len(packed), piece)])

    def information_of(self, chosen: Sequence[int]) -> Floats:
        """Information of a set of candidates and of the prior, (12 + m, 12 + m)."""
        return self.prior + self.information[list(chosen)].sum(axis=0)


def candidate_plan(
    robot: Robot, levels: Sequence[float], postures: Sequence[int] = (1, -1), per_disc: int = PER_DISC
) -> Plan:
    """All candidates in the robot's cell.

    Args:
        robot: the robot with its cell.
        levels: force levels, N.
        postures: of the elbow, +1 and -1.
        per_disc: points around a disc.

    Raises:
        CellError: a disc has no point within reach.
        UnsupportedDataError: every point is excluded by its line of force.
    """
    points = default_plan(robot.cell, per_disc, levels[:1], postures)
    points = points.select(np.flatnonzero((exact_plan(robot, points).arms >= LEAST_ARM).all(axis=1)))
    if not len(points):
        raise UnsupportedDataError(
            f'at every point within reach the line of force passes a joint axis at less than {LEAST_ARM} m',
            'move the discs, or allow both postures',
        )
    count = len(levels)
    return Plan(
        np.tile(points.disc, count),
        np.tile(points.angle, count),
        np.tile(points.posture, count),
        np.repeat(np.asarray(levels, dtype=float), len(points)),
    )


def prepare_candidates(robot: Robot, plan: Plan, tip: Tip) -> CandidateTouches:
    """Candidates from a plan.

    Args:
        robot: the robot.
        plan: all touches to choose from.
        tip: the tip whose variance is to be minimised.
    """
    scales, declared = declared_rows(robot)
    derivative = exact_plan(robot, plan).point.whitened.jacobian * scales
    scaled = (tip.derivative * SCALES).reshape(-1, 2, len(NAMES))
    rows = np.flatnonzero(np.abs(scaled).max(axis=(0, 1)) > 0)
    scaled = scaled[:, :, rows]
    squares = pack(np.einsum('gik,gil->gkl', scaled, scaled), twice=True)
    information = np.einsum('nik,nil->nkl', derivative, derivative)
    prior = declared.T @ declared
    prior[: len(NAMES), : len(NAMES)] += PRIOR
    return CandidateTouches(plan, derivative, information, rows, squares.T.copy(), declared, prior)


def declared_rows(robot: Robot) -> tuple[Floats, Floats]:
    """Units of L̄ and the declared errors, (12 + m,), and in them the rows of their prior, (p, 12 + m)."""
    if robot.declared is None:
        return SCALES, np.zeros((0, len(NAMES)))
    scales = np.concatenate([SCALES, np.ones(robot.declared.count)])
    return scales, robot.declared.prior.rows(len(NAMES)) * scales


def pack(matrices: Floats, *, twice: bool = False) -> Floats:
    """Lower triangles of symmetric matrices (…, k, k) as vectors, (…, k (k + 1) / 2).

    With `twice` the elements off the diagonal are doubled, so that `pack(a) @ pack(b, twice=True)` is trace(a b).
    """
    i, j = np.tril_indices(matrices.shape[-1])
    packed = matrices[..., i, j]
    return packed * np.where(i == j, 1.0, 2.0) if twice else packed
