"""What a residual depends on: curves learned on half of the cycles, asked of the other half.

The residual is averaged in bins of a variable over the odd cycles; that curve is what the even cycles are predicted
to have left, and the other way round. The share of the residual's square that it explains tells how much the
variable betrays. The p-value is that of a one-sided t-test that the correlation of residual and curve has mean zero
over the sweeps (the smaller of both halves, doubled). It assumes that, if nothing is missing, the residuals of
different sweeps are independent and as likely with the one sign as with the other; within a sweep they may hang
together. Displacement alone cannot explain hysteresis: where the same variable explains more once the sense of the
motion is known, no elastic law will do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.studies.hysteresis.motion import Floats, Motion, Rows

BINS = 16
VARIABLES = {
    'displacement': 'displacement',
    'displacement_sense': 'displacement, by sense of motion',
    'speed': 'speed',
    'distance_sense': 'distance since the reversal, by sense of motion',
    'time': 'time',
}


class Dependence(NamedTuple):
    """What one variable explains.

    Attributes:
        variable: a key of `VARIABLES`.
        share: of the square of the residual, on the half that the curve was not learned from; below 0: worse than none.
        p_value: that the residual does not depend on it.
    """

    variable: str
    share: float
    p_value: float


def dependences(motion: Motion, residual: Floats) -> tuple[Dependence, ...]:
    """All variables, the one that explains most first.

    Args:
        motion: the record.
        residual: (n,), N; the first sweep is left out.
    """
    found = [_dependence(motion, residual, variable) for variable in VARIABLES]
    return tuple(sorted(found, key=lambda each: -each.share))


def anything_left(found: tuple[Dependence, ...]) -> float:
    """p-value that the residual depends on none of them (Bonferroni)."""
    return min(1.0, len(found) * min(each.p_value for each in found))


def _dependence(motion: Motion, residual: Floats, variable: str) -> Dependence:
    place = _bin(motion, variable)
    odd = motion.cycle % 2 == 1
    left, chances = residual.copy(), []
    for learned in (odd & motion.scored, ~odd & motion.scored):
        asked = motion.scored & ~learned
        curve = _curve(place, residual, learned)[place]
        left[asked] -= curve[asked]
        sums = [_by_sweep(motion, values, asked) for values in (residual * curve, residual**2, curve**2)]
        size = np.sqrt(sums[1] * sums[2])
        chances.append(_above_zero(sums[0][size > 0] / size[size > 0]))
    rows = motion.scored
    share = 1 - float((left[rows] ** 2).sum() / (residual[rows] ** 2).sum()) if np.any(residual[rows]) else 0.0
    return Dependence(variable, share, min(1.0, 2 * min(chances)))


def _by_sweep(motion: Motion, values: Floats, rows: Rows) -> Floats:
    """Sum over the rows of each sweep, (sweeps,)."""
    return np.asarray(np.bincount(motion.sweep[rows], weights=values[rows], minlength=motion.sweeps), dtype=float)


def _bin(motion: Motion, variable: str) -> NDArray[np.int64]:
    by_sense = variable.endswith('_sense')
    values: Floats = getattr(motion, variable.removesuffix('_sense'))
    steps = BINS * (values - values.min()) / (np.ptp(values) or 1.0)
    place = np.minimum(steps.astype(np.int64), BINS - 1)
    return place + BINS * (motion.sense > 0) if by_sense else place


def _curve(place: NDArray[np.int64], residual: Floats, rows: Rows) -> Floats:
    """Mean of each bin; 0 where there is nothing, (2 bins,)."""
    count = np.bincount(place[rows], minlength=2 * BINS)
    total = np.bincount(place[rows], weights=residual[rows], minlength=2 * BINS)
    return np.asarray(total / np.maximum(count, 1))


def _above_zero(values: Floats) -> float:
    """p-value of a mean of zero or less."""
    if len(values) < 2 or not np.ptp(values) > 0:
        return 1.0
    return float(stats.ttest_1samp(values, 0.0, alternative='greater').pvalue)
