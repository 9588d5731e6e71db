"""How well touches would predict those that a fit has not seen: what the assessment of a calibration asks, predicted.

With B the whitened derivative of a touch's equations by its force, C' the covariance of a fit without the touch and J
its whitened Jacobian, the error of its predicted force has the covariance B⁻¹ (I + J C' Jᵀ) B⁻ᵀ; in a fit with the
touch and the covariance C, the residual has B⁻¹ (I - J C Jᵀ) B⁻ᵀ. As in the assessment, a fifth of the touches is left
out at a time, and the error is compared with that of the fit, or the noise of the force where that is larger. Averaged
over random divisions of the touches.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.assessment.thresholds import HELD_OUT_CAUTION
from scara_kinetostatic.calibration.whitening import whiten_by
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.studies.design.candidates import PRIOR, declared_rows
from scara_kinetostatic.studies.design.prediction import Robot, exact_plan

MOST_HELD_OUT = HELD_OUT_CAUTION / 1.15
"""Largest error of touches not seen, in that of the fit, in a set that checks itself. A result above `HELD_OUT_CAUTION`
is not fit for use; the factor leaves room for the scatter of that error. Source: with twenty touches the simulated
error is 0.85 times the predicted one, and scatters by a sixth.
"""
_FOLDS, _DIVISIONS = 5, 20
_REGULAR = 1e-4
"""Part of the prior of the search that keeps fits of few touches regular."""


def held_out_ratio(robot: Robot, plan: Plan) -> float:
    """Force error on touches not seen, in that of the fit to all touches of a plan."""
    exact, (scales, declared) = exact_plan(robot, plan), declared_rows(robot)
    n, rows = len(plan), exact.point.whitened.jacobian * scales
    by_force = np.linalg.inv(whiten_by(exact.point.linear.by_force, exact.point.whitened.root))
    weight = np.swapaxes(by_force, 1, 2) @ by_force
    information = np.einsum('nik,nil->nkl', rows, rows)
    together = information.sum(axis=0) + declared.T @ declared
    together[: len(PRIOR), : len(PRIOR)] += _REGULAR * PRIOR

    def spread(which: NDArray[np.intp], covariance: Floats, sign: int) -> Floats:
        blocks = np.eye(2) + sign * rows[which] @ covariance @ np.swapaxes(rows[which], 1, 2)
        return np.sqrt(np.einsum('nij,nji->n', weight[which], blocks))

    fitted = float(spread(np.arange(n), np.linalg.inv(together), -1).mean())
    random, errors = np.random.default_rng(0), np.empty((_DIVISIONS, n))
    for k in range(_DIVISIONS):
        part = random.permutation(n) % _FOLDS
        for fold in range(_FOLDS):
            left = np.flatnonzero(part == fold)
            errors[k, left] = spread(left, np.linalg.inv(together - information[left].sum(axis=0)), 1)
    return float(errors.mean()) / max(fitted, robot.noise.force_rms)
