"""The touches that a design may choose from, ready for the search.

A candidate is a point of a disc, a posture and a force level. Left out is what the arm does not reach, and every
touch whose line of force passes close to a joint's axis: which flank of the backlash such a joint rests on would
be settled by noise, or by the few millimetres that the robot is not where its nominal parameters say, and the
prediction would be about another touch.

For the search alone every parameter is taken as known to within its plausible range (`SCALES`) beforehand. That keeps
every matrix regular, makes no difference to what touches determine well, and bounds what they do not
determine. The numbers that are reported come from `design_prediction`, without it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.studies.design.prediction import Robot, exact_plan
from scara_kinetostatic.studies.design.workspace import Tip

Floats = NDArray[np.float64]

LEAST_ARM = 0.02
"""Least distance of the line of force from each joint's axis, m."""
PER_DISC = 36
SERIAL = 200_000
"""Multiplications that BLAS does in one thread."""
PRIOR = np.eye(len(NAMES))
"""The plausible range as information, in `SCALES`."""


class Pool(NamedTuple):
    """Candidates and what is asked of them; parameters in `SCALES`.

    Attributes:
        plan: the n candidates.
        derivative: whitened Jacobian of each, (n, 2, 12).
        information: of each, (n, 12, 12).
        rows: the parameters that the tip depends on, (k,).
        quadric: TᵀT over these at each place, packed, (k (k + 1) / 2, g).
    """

    plan: Plan
    derivative: Floats
    information: Floats
    rows: NDArray[np.intp]
    quadric: Floats

    def variance(self, covariance: Floats) -> Floats:
        """Variance of the tip at each place for covariances of L̄ (…, 12, 12), (…, g), m²."""
        return self.traces(pack(covariance[..., self.rows[:, None], self.rows]))

    def traces(self, packed: Floats) -> Floats:
        """Trace of TᵀT times packed matrices (…, k (k + 1) / 2) at each place, (…, g).

        In pieces so small that BLAS starts no threads for them: on a busy machine those cost far more than they gain.
        """
        piece = max(1, SERIAL // self.quadric.size)
        if packed.ndim < 2 or len(packed) <= piece:
            return packed @ self.quadric
        return np.concatenate([packed[i : i + piece] @ self.quadric for i in range(0, len(packed), piece)])

    def of(self, chosen: Sequence[int]) -> Floats:
        """The information of chosen candidates and of the plausible range, (12, 12)."""
        return PRIOR + self.information[list(chosen)].sum(axis=0)


def candidate_plan(
    robot: Robot, levels: Sequence[float], postures: Sequence[int] = (1, -1), per_disc: int = PER_DISC
) -> Plan:
    """All candidates of the robot's cell.

    Raises:
        CellError: a disc has no point within reach.
        UnsupportedDataError: no candidate is left.
    """
    points = default_plan(robot.cell, per_disc, levels[:1], postures)
    points = points.select(np.flatnonzero((exact_plan(robot, points).arms >= LEAST_ARM).all(axis=1)))
    if not len(points):
        raise UnsupportedDataError(
            f'at every point within reach the line of force passes an axis by less than {LEAST_ARM} m',
            'move the discs, or allow both postures',
        )
    count = len(levels)
    return Plan(
        np.tile(points.disc, count),
        np.tile(points.angle, count),
        np.tile(points.posture, count),
        np.repeat(np.asarray(levels, dtype=float), len(points)),
    )


def make_pool(robot: Robot, plan: Plan, tip: Tip) -> Pool:
    """The candidates of a plan, and the tip whose uncertainty is to be small."""
    derivative = exact_plan(robot, plan).point.whitened.derivative * SCALES
    scaled = (tip.derivative * SCALES).reshape(-1, 2, len(NAMES))
    rows = np.flatnonzero(np.abs(scaled).max(axis=(0, 1)) > 0)
    scaled = scaled[:, :, rows]
    squares = pack(np.einsum('gik,gil->gkl', scaled, scaled), twice=True)
    return Pool(plan, derivative, np.einsum('nik,nil->nkl', derivative, derivative), rows, squares.T.copy())


def pack(matrices: Floats, *, twice: bool = False) -> Floats:
    """The lower triangle of symmetric matrices (…, k, k), (…, k (k + 1) / 2); `twice` doubles what is off the diagonal.

    So `pack(a) @ pack(b, twice=True)` is the trace of a b.
    """
    i, j = np.tril_indices(matrices.shape[-1])
    packed = matrices[..., i, j]
    return packed * np.where(i == j, 1.0, 2.0) if twice else packed
