"""Straight lines by least squares, and what a gauge's steps do to them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError

Floats = NDArray[np.float64]

ROUNDING = 1e-9
"""Residuals below this part of the largest displacement are rounding."""


class Estimate(NamedTuple):
    """A value with its standard deviation."""

    value: float
    std: float


class Solution(NamedTuple):
    """Least squares: coefficients, (XᵀX)⁻¹, basis of the columns, residual, σ and its least, degrees of freedom."""

    beta: Floats
    unscaled: Floats
    basis: Floats
    residual: Floats
    sigma: float
    floor: float
    dof: int

    def of(self, row: Floats) -> Estimate:
        """A linear function of the coefficients."""
        return Estimate(float(row @ self.beta), self.sigma * float(np.sqrt(row @ self.unscaled @ row)))


def solve(design: Floats, moved: Floats) -> Solution:
    """Least squares of one run.

    Args:
        design: (n, k).
        moved: displacement, (n,), m.

    Raises:
        UnsupportedDataError: too few rows, or columns that cannot be told apart.
    """
    dof = len(moved) - design.shape[1]
    if dof < 1:
        need = design.shape[1] + 1
        raise UnsupportedDataError(
            f'{len(moved)} rows under load are too few, this run needs {need} or more', 'take more loads in each sense'
        )
    scale = np.linalg.norm(design, axis=0)
    basis, triangle = np.linalg.qr(design / scale)
    if np.abs(np.diag(triangle)).min() < 1e-8:
        raise UnsupportedDataError('one sense of the load has a single level', 'take two or more loads in each sense')
    inverse = np.linalg.inv(triangle) / scale[:, None]
    beta = inverse @ (basis.T @ moved)
    residual = moved - basis @ (basis.T @ moved)
    sigma = float(np.sqrt(residual @ residual / dof))
    floor = ROUNDING * float(np.abs(moved).max())
    return Solution(beta, inverse @ inverse.T, basis, residual, max(sigma, floor), floor, dof)


def find_step(displacement: Floats) -> float:
    """The largest of 1, 2, 5, 10, … × 10ⁿ m of which all readings are multiples; 0 if it is below 10 nm."""
    for exponent in range(-3, -9, -1):
        for digit in (5, 2, 1):
            multiple = displacement / (digit * 10.0**exponent)
            if np.all(np.abs(multiple - np.round(multiple)) < 1e-5):
                return digit * 10.0**exponent
    return 0.0
