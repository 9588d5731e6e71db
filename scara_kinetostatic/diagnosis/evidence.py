"""Bad touches or a missing effect? Fits that differ in both, on one scale.

An effect can make a few touches look bad: a displaced disc of which there are few, a gain that matters far out only.
Then the fit to the twelve parameters rejects them and calls the rest clean. So a rejected touch has its price, too: the
squared distance beyond which touches are rejected, no matter how bad it is. What a fit says of all touches is

    Σ_used d² / s² + Σ_rejected price + Σ ln det V + prices of its effects,

and the lower sum is the likelier story.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.outliers import FALSE_REJECTIONS
from scara_kinetostatic.calibration.prediction import observe
from scara_kinetostatic.calibration.projection import project
from scara_kinetostatic.calibration.result import Calibration


def penalised_deviance(calibration: Calibration, penalty: float, scale: float) -> float:
    """The sum above, up to a constant of the touches.

    Args:
        calibration: with or without effects.
        price: of its effects.
        scale: s², the size of the noise in which distances are counted.
    """
    c = calibration
    point = project(observe(c.touches, c.cell), c.model, c.noise)
    l11, _, l22 = point.whitened.root
    rejection = -2 * np.log(FALSE_REJECTIONS / len(c.touches))
    distance = np.where(c.used, point.distance / scale, rejection)
    return float(np.sum(distance + 2 * np.log(l11 * l22))) + penalty
