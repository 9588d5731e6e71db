"""p-values and quantiles of a chi-square whose noise is known, or was estimated with some degrees of freedom."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtrc, chdtri, fdtrc, fdtri

from scara_kinetostatic.model.arrays import Floats


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


def quantile(probability: float, freedoms: int, noise_freedoms: float) -> float:
    """The chi-square that is exceeded with 1 - `probability`; `noise_freedoms` as in `p_values`."""
    if np.isinf(noise_freedoms):
        return float(chdtri(freedoms, 1 - probability))
    return float(freedoms * fdtri(freedoms, noise_freedoms, probability))
