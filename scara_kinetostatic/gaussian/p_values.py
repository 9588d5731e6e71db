"""P-values of χ² and F tests, beside noise that is known or estimated."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, fdtrc, fdtri

from scara_kinetostatic.model.arrays import Floats

_TINY = 1e-300
"""Keeps quotients finite."""


def f_test(
    explained: float, rank: int, total: float, rows: int, freedoms: int, least: float = 0.0
) -> tuple[float, float] | None:
    """p-value of "the columns explain nothing", and the part of the sum of squares that they explain; None if they add
    nothing testable.

    Args:
        explained: the decrease of the sum of squares.
        rank: of what they add to the fit.
        total: sum of squares of the fit.
        rows: of whitened measurements.
        freedoms: degrees of freedom without them.
        least: mean square that the residual has at least.
    """
    if rank == 0 or freedoms <= rank or total < 1e-8 * rows:  # whitened, less is rounding
        return None
    ratio = (explained / rank) / max((total - explained) / (freedoms - rank), least, _TINY)
    return float(fdtrc(rank, freedoms - rank, ratio)), explained / total


def p_values(chi_square: Floats | float, freedoms: int, noise_freedoms: float) -> Floats:
    """Probability of a larger chi-square by chance.

    Args:
        chi_square: one or several, any shape.
        freedoms: degrees of freedom of each; without any, 1 is returned.
        noise_freedoms: those of the noise; infinite where it is known, and the F distribution takes the place of χ².
    """
    if not freedoms:
        return np.ones(np.shape(chi_square))
    if np.isinf(noise_freedoms):
        return np.asarray(chdtrc(freedoms, chi_square))
    return np.asarray(fdtrc(freedoms, noise_freedoms, np.asarray(chi_square) / freedoms))


def as_rare(chi_square: float, freedoms: int, noise_freedoms: float) -> float:
    """What is exceeded as rarely as a chi-square where the noise is known; `noise_freedoms` as in `p_values`."""
    if np.isinf(noise_freedoms):
        return chi_square
    return float(freedoms * fdtri(freedoms, noise_freedoms, 1.0 - chdtrc(freedoms, chi_square)))
