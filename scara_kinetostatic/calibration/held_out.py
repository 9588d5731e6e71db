"""The force error on touches that took no part in the fit: each predicted by a fit to the others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.estimate import fewest_touches
from scara_kinetostatic.calibration.fit_point import FINAL, force_error, force_residual, select
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import minimise

_FOLDS = 5
"""Unless more are needed to leave enough touches to each fit."""


class HeldOut(NamedTuple):
    """e_f (10) over touches each predicted by a fit without it.

    Attributes:
        force_error: N.
        folds: into how many parts the touches were split.
    """

    force_error: float
    folds: int


def held_out_force_error(calibration: Calibration) -> HeldOut:
    """Split the used touches at random into five folds; predict each fold by a fit to the others.

    Noise levels, outliers and unidentifiable directions are those of the whole fit.

    Args:
        calibration: the result whose touches, noise and free parameters are used.
    """
    c = calibration
    places = np.flatnonzero(c.used)
    n = len(places)
    spare = n - fewest_touches(c.subspace.basis.shape[1])
    folds = (
        max(2, min(_FOLDS, n)) if spare < 1 else min(n, max(_FOLDS, -(-n // spare)))
    )  # as many as leave enough to each fit
    part = np.random.default_rng(0).permutation(n) % folds
    residual = np.empty((n, 2))
    for fold in range(folds):
        kept = c.observe(places[part != fold])
        start = select(c.projection, places[part != fold])
        fit = minimise(kept, start, c.subspace, c.noise, FINAL)
        left = c.observe(places[part == fold]).with_errors(fit.point.errors)
        residual[part == fold] = force_residual(left, fit.point.model)
    return HeldOut(force_error(residual), folds)
