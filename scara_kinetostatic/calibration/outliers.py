"""Outliers: touches far from what all the others predict.

The measure is the studentised distance: the squared Mahalanobis distance of a touch's misclosure under the covariance
it has as a residual of the fit (for a used touch, smaller than V by its leverage; for an unused one, larger). Where all
is well it is chi-square with 2 degrees of freedom; the bound is set so that one good touch is lost in a thousand
recordings. If the bulk of the touches is worse than the noise says, the bound grows with it: then the model or the
noise is wrong, which is not the touches' fault.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.gauss_helmert import Whitened
from scara_kinetostatic.gaussian.least_squares import typical_scale
from scara_kinetostatic.model.arrays import Floats, Mask, as_complex

FALSE_REJECTIONS = 1e-3
"""Expected number of good touches rejected in one recording."""


def studentised(whitened: Whitened, covariance: Floats, used: Mask) -> Floats:
    """Squared studentised distance of each touch, (n,).

    Args:
        whitened: residuals and Jacobian of all touches, each at its adjusted observations.
        covariance: of all values of the model and the declared errors, (12 + k + m, 12 + k + m).
        used: which touches took part in the fit.
    """
    jacobian, sign = whitened.jacobian.T, np.where(used, -1.0, 1.0)
    moved = np.tensordot(covariance, jacobian, 1)
    s11, s21, s22 = (sign * (moved[:, i] * jacobian[:, j]).sum(axis=0) for i, j in ((0, 0), (1, 0), (1, 1)))
    mean, half = 1.0 + (s11 + s22) / 2, (s11 - s22) / 2
    turned = as_complex(whitened.residual) * np.exp(-0.5j * np.arctan2(s21, half))  # along the principal axes
    # a touch without which a parameter is undetermined has leverage 1: its residual is zero whatever it measured
    first, second = np.maximum(mean + np.multiply.outer((1.0, -1.0), np.hypot(half, s21)), 1e-3)
    return np.asarray(turned.real**2 / first + turned.imag**2 / second)


def find_good(distance: Floats) -> Mask:
    """Which touches are no outliers, (n,); all, if too many would be.

    Args:
        distance: squared studentised distances.
    """
    bound = -2 * np.log(FALSE_REJECTIONS / len(distance)) * typical_scale(distance)
    good = distance <= bound
    # where more seem bad, the touches disagree with the model, not single ones with the rest
    return good if (~good).mean() <= 0.2 else np.ones_like(good)
