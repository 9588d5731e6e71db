"""Leverage: how far a touch decides by itself about the result.

The block of a used touch on the diagonal of the hat matrix is H_k = J_k Σ J_kᵀ, (2, 2), with J_k its whitened Jacobian
and Σ the covariance of the fit, everything estimated along with the parameters included. Of an error of the touch in
the direction of an eigenvector with eigenvalue λ, the residual shows the part 1 - λ, the parameters absorb the rest.
With λ = 1 the touch is fitted whatever it measured: nothing checks it, and without it a parameter has no value.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.fit_point import project
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import ActivePrior
from scara_kinetostatic.diagnosis.linear_problem import orthonormal
from scara_kinetostatic.model.arrays import Floats, read_only


def leverages(calibration: Calibration) -> Floats:
    """The largest eigenvalue of each used touch's block of the hat matrix, 0 to 1, (n,).

    What the cell description declares is estimated along, with rows of its own: they count in Σ, but are no touches.
    """
    c = calibration
    observations = observe(c.touches.select(c.used), c.cell, c.errors)
    point = project(observations, c.model, c.noise)
    n, basis = len(point.distance), c.subspace.with_errors(len(c.errors))
    rows = point.whitened.jacobian.reshape(2 * n, -1) @ basis
    prior = ActivePrior.of(observations, c.subspace)
    if prior is not None:
        rows = np.concatenate([rows, prior.rows @ basis])
    blocks = orthonormal(rows)[: 2 * n].reshape(n, 2, -1)
    return read_only(np.clip(np.linalg.eigvalsh(np.einsum('nik,njk->nij', blocks, blocks))[:, -1], 0.0, 1.0))
