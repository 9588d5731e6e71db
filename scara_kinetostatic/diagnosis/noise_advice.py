"""What there is to say of the noise: too large to be noise, large, too small, growing with the force."""

from __future__ import annotations

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.result import Calibration

LARGEST_JOINT_NOISE = 2e-4
"""Estimated repeatability of a joint beyond which it is an error of the model, rad."""
LARGEST_ERROR_SHARE = 0.2
"""The same for the force error as a part of the force."""
LARGE_JOINT_NOISE = 5e-5
"""Estimated repeatability of a joint from which on it is said, rad: most robots do better."""
GROWING = 1e-3
"""P-value below which it is said that the noise grows with the force."""


def incredible(c: Calibration) -> str:
    """Why estimated noise cannot be noise; empty if it can. A gross error of the model passes for noise otherwise."""
    if c.noise_source == 'given':
        return ''
    share = c.force_error / float(np.hypot(c.force[:, 0], c.force[:, 1]).mean())
    if c.noise.joint <= LARGEST_JOINT_NOISE and share <= LARGEST_ERROR_SHARE:
        return ''
    return (
        f'the touches miss the model by {c.force_error:.2g} N, {100 * share:.0f} % of the force, as if the joints '
        f'repeated to {c.noise.joint:.1e} rad only: no noise is like that; check the places and radii of '
        'the discs, the fixed parameters, and whether a joint lost its zero'
    )


def large_noise(c: Calibration) -> str:
    """What to say where estimated noise is large, if not incredible."""
    if c.noise_source == 'given' or c.noise.joint <= LARGE_JOINT_NOISE:
        return ''
    return (
        f'by this fit the joints repeat to {c.noise.joint:.1e} rad only; a robot that repeats better has an error that '
        'passes for noise here, so give the noise in the cell file if it is known'
    )


def growing_noise(p_value: float) -> str:
    """What to say where the scatter of the force is not the same at all forces."""
    if p_value >= GROWING:
        return ''
    return (
        f'the scatter of the force grows with the force (p = {p_value:.1g}), and all tests take it for the same: '
        'structure over the size of the force may be no more than that'
    )


def too_quiet(c: Calibration) -> str:
    """Where the residuals are smaller than the stated noise."""
    if c.noise_source == 'given' and special.chdtr(c.degrees_of_freedom, c.chi_square) < 1e-3:
        return (
            f'the residuals are {c.reduced_chi_square**0.5:.2g} times the stated noise: it is stated too large, and so '
            'are the standard deviations of the twelve alone; what was looked for beyond them was looked for with the '
            'noise that the touches show. Leave the noise out of the cell file to have it estimated'
        )
    return ''
