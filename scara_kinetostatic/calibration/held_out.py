"""The force error on touches that took no part in the fit: each predicted by a fit to the others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.estimate import fewest_touches
from scara_kinetostatic.calibration.fit_point import FINAL, force_error, force_residual, select
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import minimise

_FOLDS = 5
"""Unless more are needed to leave enough touches to each fit; fewer of fewer touches."""
_STAGE = FINAL._replace(tolerance=1e-2)
"""Exact to a hundredth of a standard deviation of all predictions together: of their rms the fourth digit."""


class HeldOut(NamedTuple):
    """e_f (10) over touches each predicted by a fit without it.

    Attributes:
        force_error: N.
        folds: into how many parts the touches were split.
    """

    force_error: float
    folds: int


def held_out_force_error(calibration: Calibration) -> HeldOut:
    """Split the used touches at random into five folds, or more where few are spare; predict each by a fit to the
    others, from the fit to all.

    Noise levels, outliers and unidentifiable directions are those of the whole fit.

    Args:
        calibration: the result whose touches, noise and free parameters are used.
    """
    c = calibration
    places = np.flatnonzero(c.used)
    n = len(places)
    spare = n - fewest_touches(c.subspace.basis.shape[1], c.known)
    # as many as leave enough to each fit
    folds = max(2, min(_FOLDS, n)) if spare < 1 else min(n, max(_FOLDS, -(-n // spare)))
    part = np.random.default_rng(0).permutation(n) % folds
    residual = np.empty((n, 2))
    for fold in range(folds):
        kept, start = c.observe(places[part != fold]), select(c.projection, places[part != fold])
        fit = minimise(kept, start, c.subspace, c.noise, _STAGE)
        left = c.observe(places[part == fold]).with_errors(fit.point.errors)
        residual[part == fold] = force_residual(left, fit.point.model)
    return HeldOut(force_error(residual), folds)
