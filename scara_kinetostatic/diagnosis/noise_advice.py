"""Messages of a diagnosis about the noise: too large, too small, growing with the force, different axes."""

from __future__ import annotations

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.thresholds import STRICT_SIGNIFICANCE
from scara_kinetostatic.model.cell import Noise

_LARGEST_JOINT_NOISE = 2e-4
"""Estimated repeatability of a joint beyond which it is a model error, rad."""
_LARGEST_ERROR_SHARE = 0.2
"""Force error, as a part of the force, beyond which it is a model error."""
_LARGE_JOINT_NOISE = 5e-5
"""Estimated repeatability of a joint from which on there is a message, rad: most robots repeat better."""


def implausible_noise(c: Calibration) -> str:
    """Why estimated noise is too large to be noise, such as a gross model error makes it; empty if it is not."""
    if c.cell.noise is not None:
        return ''
    share = c.force_error / float(np.hypot(c.force[:, 0], c.force[:, 1]).mean())
    if c.noise.joint_rms <= _LARGEST_JOINT_NOISE and share <= _LARGEST_ERROR_SHARE:
        return ''
    return (
        f'the force error is {c.force_error:.2g} N, {100 * share:.0f} % of the force, which as noise would be a joint '
        f'repeatability of {c.noise.joint_rms:.1e} rad: this is a model error; check the positions and radii of '
        'the discs, the fixed parameters, and whether a joint lost its zero'
    )


def large_noise(c: Calibration) -> str:
    """Message where estimated noise is large but plausible."""
    if c.cell.noise is not None or c.noise.joint_rms <= _LARGE_JOINT_NOISE:
        return ''
    return (
        f'the estimated joint repeatability is {c.noise.joint_rms:.1e} rad; if the robot repeats better, a model error '
        'is counted as noise here: give the noise in the cell file if it is known'
    )


def noise_found(c: Calibration) -> str:
    """What the touches have shown of the noise that the cell description does not state, and how to state it."""
    stated = c.cell.noise or Noise(0.0, 0.0)
    parts = []
    if stated.force_relative is None and c.noise.growth:
        parts.append(f'grows with the force, by {100 * c.noise.growth:.2g} % of it')
    for text, level, given, unit in (
        ('of the joints differs', c.noise.joint, stated.joint, 'rad'),
        ('of the force differs between x and y', c.noise.force, stated.force, 'N'),
    ):
        if isinstance(level, tuple) and not isinstance(given, tuple):
            parts.append(f'{text}: {level[0]:.2g} and {level[1]:.2g} {unit}')
    if not parts:
        return ''
    entries = {key: _rounded(value) for key, value in c.noise.as_dict().items()}
    line = ', '.join(f'{key}: {value}' for key, value in entries.items())
    return (
        f'the noise of the touches {"; it ".join(parts)} (estimated, and used for all standard deviations); '
        f'if that is so, state it in the cell file: noise: {{{line}}}'
    )


def _rounded(value: float | list[float]) -> str:
    """Two digits, as YAML."""
    if isinstance(value, list):
        return f'[{", ".join(map(_rounded, value))}]'
    return f'{value:.1e}' if value < 1e-3 else f'{value:.2g}'


def growing_noise(p_value: float) -> str:
    """Message where the scatter of the force depends on the force.

    Args:
        p_value: of "it does not".
    """
    if p_value >= STRICT_SIGNIFICANCE:
        return ''
    return (
        f'the scatter of the force increases with the force (p = {p_value:.1g}), whereas all tests assume it constant: '
        'a dependence on the size of the force may be due to that alone'
    )


def overstated_noise(c: Calibration) -> str:
    """Message where the residuals are significantly smaller than the stated noise."""
    too_small = special.chdtr(c.degrees_of_freedom, c.chi_square) < STRICT_SIGNIFICANCE
    if c.noise_source != 'given' or not too_small:
        return ''
    return (
        f'the residuals are {c.reduced_chi_square**0.5:.2g} times the stated noise: it is stated too large, and so '
        'are the standard deviations of the base model; effects were tested with the noise estimated from the touches. '
        'Leave the noise out of the cell file to have it estimated'
    )
