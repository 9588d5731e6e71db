"""Dependence of a residual on variables of the motion: curves fitted to half of the cycles, tested on the other half.

The residual of the odd cycles is averaged in bins of a variable; this curve predicts the residual of the even cycles,
and the other way round. The share of the squared residual that it explains measures the dependence. The p-value is that
of a one-sided t-test of the correlation between residual and curve over the sweeps (the smaller of both halves,
doubled). It assumes that for a sufficient law the residuals of different sweeps are independent with a symmetric
distribution; within a sweep they may be correlated. Displacement alone cannot explain hysteresis: where a variable
explains more together with the sense of the motion, no elastic law is sufficient.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.hysteresis.motion import Motion, Rows

_BINS = 16
VARIABLES = {
    'displacement': 'displacement',
    'displacement_sense': 'displacement, by sense of motion',
    'speed': 'speed',
    'distance_sense': 'distance since the reversal, by sense of motion',
    'time': 'time',
}


class Dependence(NamedTuple):
    """Dependence on one variable.

    Attributes:
        variable: a key of `VARIABLES`.
        share: explained share of the squared residual on the half held out; below 0 if the curve increases it.
        p_value: of no dependence.
    """

    variable: str
    share: float
    p_value: float


def dependences(motion: Motion, residual: Floats) -> tuple[Dependence, ...]:
    """Dependence on all variables, in decreasing order of the explained share.

    Args:
        motion: the record.
        residual: (n,), N; the first sweep does not count.
    """
    found = [_dependence(motion, residual, variable) for variable in VARIABLES]
    return tuple(sorted(found, key=lambda each: -each.share))


def p_independent(found: tuple[Dependence, ...]) -> float:
    """p-value of no dependence on any variable (Bonferroni)."""
    return min(1.0, len(found) * min(each.p_value for each in found))


def _dependence(motion: Motion, residual: Floats, variable: str) -> Dependence:
    place = _bin(motion, variable)
    odd = motion.cycle % 2 == 1
    unexplained, p_values = residual.copy(), []
    for fitted in (odd & motion.scored, ~odd & motion.scored):
        held_out = motion.scored & ~fitted
        curve = _curve(place, residual, fitted)[place]
        unexplained[held_out] -= curve[held_out]
        sums = [_by_sweep(motion, values, held_out) for values in (residual * curve, residual**2, curve**2)]
        size = np.sqrt(sums[1] * sums[2])
        p_values.append(_p_positive_mean(sums[0][size > 0] / size[size > 0]))
    rows = motion.scored
    share = 1 - float((unexplained[rows] ** 2).sum() / (residual[rows] ** 2).sum()) if np.any(residual[rows]) else 0.0
    return Dependence(variable, share, min(1.0, 2 * min(p_values)))


def _by_sweep(motion: Motion, values: Floats, rows: Rows) -> Floats:
    """Sum over the rows of each sweep, (sweeps,)."""
    return np.asarray(np.bincount(motion.sweep[rows], weights=values[rows], minlength=motion.sweeps), dtype=float)


def _bin(motion: Motion, variable: str) -> NDArray[np.int64]:
    by_sense = variable.endswith('_sense')
    values: Floats = getattr(motion, variable.removesuffix('_sense'))
    steps = _BINS * (values - values.min()) / (np.ptp(values) or 1.0)
    place = np.minimum(steps.astype(np.int64), _BINS - 1)
    return place + _BINS * (motion.sense > 0) if by_sense else place


def _curve(place: NDArray[np.int64], residual: Floats, rows: Rows) -> Floats:
    """Mean of each bin, (2 bins,), N; 0 for an empty one."""
    count = np.bincount(place[rows], minlength=2 * _BINS)
    total = np.bincount(place[rows], weights=residual[rows], minlength=2 * _BINS)
    return np.asarray(total / np.maximum(count, 1))


def _p_positive_mean(values: Floats) -> float:
    """p-value of a mean of zero or less."""
    if len(values) < 2 or not np.ptp(values) > 0:
        return 1.0
    return float(stats.ttest_1samp(values, 0.0, alternative='greater').pvalue)
