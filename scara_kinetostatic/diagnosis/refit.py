"""A calibration fitted again, and how likely a fit is.

Fits may differ in the touches that they reject. So a rejected touch has a penalty, the squared distance d² beyond which
touches are rejected. Over all touches,

    D = Σ_used d² / s² + Σ_declared e² / s² + Σ_rejected d²_rejection + Σ ln det V,

and the smaller D is the likelier model.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import FALSE_REJECTIONS, WarmStart
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel


def fit_again(
    c: Calibration,
    *,
    model: ExtendedModel | None = None,
    noise: Noise | None = None,
    cell: Cell | None = None,
    **options: Any,
) -> Calibration | None:
    """A calibration fitted anew, close to where it is; None where the touches have no such fit.

    Args:
        c: the calibration.
        model: to start from, with the effects to fit; that of the calibration by default.
        noise: to start from; likewise.
        cell: another description of the cell; likewise.
        options: `errors` of the warm start, and further arguments of the fit.
    """
    model, errors = model or c.model, options.pop('errors', c.errors)
    warm_start = WarmStart(model, noise or c.noise, c.used, errors)
    try:
        return calibrate(c.touches, cell or c.cell, model.effects, fixed=c.fixed, warm_start=warm_start, **options)
    except UnsupportedDataError:
        return None


def with_rejections_of(found: Calibration, before: Calibration) -> Calibration:
    """A new fit of the touches of another, with the touches that were rejected before any fit."""
    places = set(before.touches.index.tolist())
    left_out = [item for item in before.rejected if item.index not in places]
    return replace(found, rejected=tuple(sorted((*left_out, *found.rejected), key=lambda item: item.index)))


def deviance(calibration: Calibration) -> float:
    """D above, up to a constant of the touches."""
    c = calibration
    l11, _, l22 = c.projection.whitened.root
    rejection = -2 * np.log(FALSE_REJECTIONS / len(c.touches))
    distance = np.where(c.used, c.projection.distance, rejection)
    return float(np.sum(distance + 2 * np.log(l11 * l22))) + c.prior_cost
