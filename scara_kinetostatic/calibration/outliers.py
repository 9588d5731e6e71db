"""Outliers: touches far from what all the others predict.

The measure is the studentised distance: the squared Mahalanobis distance of
its misclosure under the covariance it has as a residual of the fit (for a used touch, smaller
than V by its leverage; for an unused one, larger). Where all is well it is chi-square with 2 degrees of
freedom; the bound is set so that one good touch is lost in a thousand recordings.
If the bulk of the touches is worse than the noise says, the bound grows with it: then the
model or the noise is wrong, which is not the touches' fault.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.blocks import in_blocks, pick
from scara_kinetostatic.calibration.least_squares import typical_scale
from scara_kinetostatic.calibration.whitening import Whitened
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.touch import Rejection

FALSE_REJECTIONS = 1e-3
"""Expected number of good touches rejected in one recording."""
_MOST_REJECTED = 0.2
"""If more than this part seems bad, the touches disagree with the model, not single ones with the rest."""
_LEAST_VARIANCE = 1e-3
"""The least variance of a residual, in units of that of its observation, that is assumed."""


def studentised(whitened: Whitened, covariance: Floats, used: Mask) -> Floats:
    """Squared studentised distance of each touch, (n,).

    Args:
        whitened: residuals and Jacobian of all touches, each at its adjusted observations.
        covariance: of all values of the model and the declared errors, (12 + k + m, 12 + k + m).
        used: which touches took part in the fit.
    """
    return in_blocks(
        len(used), lambda part: _studentised(pick(whitened, part), covariance, np.where(used[part], -1.0, 1.0))
    )


def _studentised(whitened: Whitened, covariance: Floats, sign: Floats) -> Floats:
    jacobian = whitened.jacobian
    n, _, k = jacobian.shape
    rows = jacobian.transpose(2, 1, 0).reshape(k, 2 * n)
    moved, rows = (covariance @ rows).reshape(k, 2, n), rows.reshape(k, 2, n)
    s11, s21, s22 = (sign * (moved[:, i] * rows[:, j]).sum(axis=0) for i, j in ((0, 0), (1, 0), (1, 1)))
    s11, s22 = 1.0 + s11, 1.0 + s22
    r1, r2 = whitened.residual[:, 0], whitened.residual[:, 1]
    # a touch without which a parameter is undetermined has leverage 1: its residual is zero whatever it measured
    middle = (s11 + s22) / 2
    apart = np.hypot((s11 - s22) / 2, s21)
    dull = middle - apart < _LEAST_VARIANCE
    distance = (s22 * r1 * r1 - 2 * s21 * r1 * r2 + s11 * r2 * r2) / np.where(dull, 1.0, s11 * s22 - s21 * s21)
    for i in np.flatnonzero(dull):
        values, vectors = np.linalg.eigh([[s11[i], s21[i]], [s21[i], s22[i]]])
        distance[i] = ((whitened.residual[i] @ vectors) ** 2 / np.maximum(values, _LEAST_VARIANCE)).sum()
    return np.asarray(distance)


def find_good(distance: Floats) -> Mask:
    """Which touches are no outliers, (n,); all, if too many would be.

    Args:
        distance: squared studentised distances.
    """
    bound = -2 * np.log(FALSE_REJECTIONS / len(distance)) * typical_scale(distance)
    good = distance <= bound
    return good if (~good).mean() <= _MOST_REJECTED else np.ones_like(good)


def explain(index: int, distance: float, residual: Floats) -> Rejection:
    """The rejection of one touch, with its reason."""
    size = float(np.hypot(*residual))
    return Rejection(
        index,
        f'disagrees with the other touches: its force is {size:.2g} N off, {np.sqrt(distance):.1f} standard deviations',
    )
