"""The force error on touches that took no part in the fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import FINAL, select
from scara_kinetostatic.calibration.prediction import force_error, force_residual, observe
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import minimise

_SEED = 0


class HeldOut(NamedTuple):
    """e_f (10) over touches each predicted by a fit without it.

    Attributes:
        force_error: N.
        folds: into how many parts the touches were split.
    """

    force_error: float
    folds: int


def held_out_force_error(calibration: Calibration, folds: int = 5) -> HeldOut:
    """Split the used touches at random into folds; predict each fold by a fit to the others.

    Noise levels, outliers and unidentifiable directions are those of the whole fit.

    Args:
        calibration: the result whose touches, noise and free parameters are used.
        folds: how many; fewer where there are too few touches for it.
    """
    c = calibration
    places = np.flatnonzero(c.used)
    touches, n = c.touches.select(places), len(places)
    spare = n - (c.subspace.basis.shape[1] // 2 + 1)
    folds = max(2, min(folds, n)) if spare < 1 else min(n, max(folds, -(-n // spare)))
    part = np.random.default_rng(_SEED).permutation(n) % folds
    residual = np.empty((n, 2))
    for fold in range(folds):
        kept = observe(touches.select(part != fold), c.cell, c.errors)
        start = select(c.projection, places[part != fold]).adjusted
        fit = minimise(kept, c.model, start, c.subspace, c.noise, FINAL)
        left = observe(touches.select(part == fold), c.cell, fit.point.errors)
        residual[part == fold] = force_residual(left, fit.point.model)
    return HeldOut(force_error(residual), folds)
