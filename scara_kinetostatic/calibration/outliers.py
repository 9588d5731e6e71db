"""Single bad touches: found by their distance from what all the others predict.

A touch is judged by its studentised distance: the squared Mahalanobis distance of
its misclosure under the covariance it has as a residual of the fit (for a used touch, smaller
than V by its leverage; for an unused one, larger). Where all is well it is chi-square with 2 degrees of
freedom; the bound is set so that one good touch is lost in a thousand recordings.
If the bulk of the touches is worse than the noise says, the bound grows with it: then the
model or the noise is wrong, which is not the touches' fault.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.adjustment import Whitened
from scara_kinetostatic.calibration.steps import typical_scale
from scara_kinetostatic.model.touch import Rejection

Floats = NDArray[np.float64]

FALSE_REJECTIONS = 1e-3
"""Expected number of good touches rejected in one recording."""
MOST_REJECTED = 0.2
"""If more than this part seems bad, the touches disagree with the model, not single ones with the rest."""


def studentised(whitened: Whitened, covariance: Floats, used: NDArray[np.bool_]) -> Floats:
    """Squared studentised distance of each touch, (n,).

    Args:
        whitened: residuals and Jacobian of all touches, each at its adjusted observations.
        covariance: of the parameters, in the units of the Jacobian, (12, 12).
        used: which touches took part in the fit.
    """
    leverage = np.einsum('nik,kl,njl->nij', whitened.derivative, covariance, whitened.derivative)
    spread = np.eye(2) + np.where(used, -1.0, 1.0)[:, None, None] * leverage
    # a touch the fit cannot do without has leverage 1 and no say of its own
    values, vectors = np.linalg.eigh(spread)
    rotated = np.einsum('nij,ni->nj', vectors, whitened.residual)
    return (rotated**2 / np.maximum(values, 1e-3)).sum(axis=1)


def find_good(distance: Floats) -> NDArray[np.bool_]:
    """Which touches are no outliers, (n,); all, if too many would be.

    Args:
        distance: squared studentised distances.
    """
    bound = -2 * np.log(FALSE_REJECTIONS / len(distance)) * typical_scale(distance)
    good = distance <= bound
    return good if (~good).mean() <= MOST_REJECTED else np.ones_like(good)


def explain(index: int, distance: float, residual: Floats) -> Rejection:
    """The rejection of one touch in words."""
    size = float(np.hypot(*residual))
    return Rejection(
        index,
        f'disagrees with the other touches: its force is {size:.2g} N off, {np.sqrt(distance):.1f} standard deviations',
    )
