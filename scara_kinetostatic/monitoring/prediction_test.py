"""The chi-square of touches that a calibration has not seen.

With r and J of `linear`, r ~ N(0, I + J C₀ Jᵀ). C₀ is the joint covariance with the errors of the cell, so that touches
on the objects of the calibration are predicted better than touches on new ones.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.monitoring.linear import Information, Measured
from scara_kinetostatic.monitoring.significance import p_values, quantile

QUANTILE = 0.99
"""Probability of the quantile that is stated beside the chi-square."""


class PredictionTest(NamedTuple):
    """Chi-square of all touches, and each of them by itself.

    Attributes:
        chi_square: of all.
        freedoms: two per touch.
        p_value: of the calibration being right.
        quantile: of the distribution of `chi_square` at `QUANTILE`.
        distances: of each touch from its prediction, in standard deviations, (n,).
        p_values: of each touch, (n,).
        expected: standard deviation of the error of the tip, (n,), m.
    """

    chi_square: float
    freedoms: int
    p_value: float
    quantile: float
    distances: Floats
    p_values: Floats
    expected: Floats

    @classmethod
    def of(cls, measured: Measured, covariance: Floats, noise: float) -> PredictionTest:
        """With noise that is known with so many degrees of freedom."""
        spread = _spread(measured, covariance)
        chi_square, freedoms = _chi_square(measured, covariance), measured.residual.size
        distances = _distances(measured, spread)
        return cls(
            chi_square=chi_square,
            freedoms=freedoms,
            p_value=float(p_values(chi_square, freedoms, noise)),
            quantile=quantile(QUANTILE, freedoms, noise),
            distances=distances,
            p_values=p_values(distances**2, 2, noise),
            expected=np.sqrt(np.einsum('ni,nij,nj->n', measured.normal, spread, measured.normal)),
        )


def _spread(measured: Measured, covariance: Floats) -> Floats:
    """I + J C Jᵀ touch by touch, (n, 2, 2)."""
    return np.eye(2) + measured.jacobian @ covariance @ measured.jacobian.swapaxes(1, 2)


def _chi_square(measured: Measured, covariance: Floats) -> float:
    """rᵀ (I + J C Jᵀ)⁻¹ r of all touches together, by rᵀr - uᵀ (I + C P)⁻¹ C u."""
    found = Information.of(measured)
    gained = np.linalg.solve(np.eye(len(covariance)) + covariance @ found.matrix, covariance @ found.score)
    return float((measured.residual**2).sum() - found.score @ gained)


def _distances(measured: Measured, spread: Floats) -> Floats:
    """Distance of each touch from its prediction, in standard deviations, (n,)."""
    solved = np.linalg.solve(spread, measured.residual[:, :, None])[:, :, 0]
    return np.sqrt((measured.residual * solved).sum(axis=1))
