"""The force error on touches that took no part in the fit: each predicted by a step to the fit to the others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.estimate import fewest_touches
from scara_kinetostatic.calibration.fit_point import force_error, force_residual, select
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import ActivePrior
from scara_kinetostatic.gaussian.least_squares import compress, damped_step

_FOLDS = 5
"""Unless more are needed to leave enough touches to each fit; fewer of fewer touches."""


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
    others, one Gauss–Newton step from the fit to all.

    Noise levels, outliers and unidentifiable directions are those of the whole fit.

    Args:
        calibration: the result whose touches, noise and free parameters are used.
    """
    c = calibration
    places = np.flatnonzero(c.used)
    n = len(places)
    spare = n - fewest_touches(c.subspace.basis.shape[1])
    # as many as leave enough to each fit
    folds = max(2, min(_FOLDS, n)) if spare < 1 else min(n, max(_FOLDS, -(-n // spare)))
    part = np.random.default_rng(0).permutation(n) % folds
    residual, basis = np.empty((n, 2)), c.subspace.with_errors(len(c.projection.errors))
    prior = ActivePrior.of(c.observe(), c.subspace)
    known = None if prior is None else prior.system(c.projection)
    for fold in range(folds):
        point = select(c.projection, places[part != fold])
        system = compress(point.whitened.jacobian, point.whitened.residual, basis=basis, prior=known)
        model, errors = point.changed(basis @ damped_step(system, 0.0))
        residual[part == fold] = force_residual(c.observe(places[part == fold]).with_errors(errors), model)
    return HeldOut(force_error(residual), folds)
