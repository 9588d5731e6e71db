"""What each source of uncertainty contributes to the covariance of a fit (GUM, 5.2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from scara_kinetostatic.calibration.estimate import Estimation
from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.calibration.subspace import ActivePrior
from scara_kinetostatic.model.arrays import Floats

ALTERNATIVES = 'alternative_models'
"""Label of what the choice among credible models contributes."""
_MISFIT = 1e-3
"""p-value of chi-square below which the stated noise does not cover the residuals and sigmas are enlarged."""


class Contribution(NamedTuple):
    """What one source of uncertainty contributes to the covariance of a fit (GUM, 5.2 and annex H).

    Attributes:
        label: ``noise`` (type A), that of a declared source (type B), such as ``object_position[disc_1]``, or
            ``alternative_models``.
        declared: its declared standard uncertainty; None for noise.
        unit: of `declared`.
        covariance: its part of the covariance of all values of the model, (12 + k, 12 + k).
    """

    label: str
    declared: float | None
    unit: str
    covariance: Floats


def contributions_of(
    found: Estimation, observations: Observations, covariance: Floats
) -> tuple[tuple[Contribution, ...], float, int]:
    """What noise and each declared source contribute to the covariance, chi-square, degrees of freedom.

    With C the covariance of the fit and P the rows of the prior, the estimate moves by -C P_sᵀ e_s with the true errors
    e_s of a source, so that this contributes C P_sᵀ P_s C, and noise the rest. Where the residuals are larger than
    noise and declared errors can be, all are enlarged alike.
    """
    fit, values = found.fit, len(found.subspace.origin)
    prior = ActivePrior.of(observations, found.subspace)
    chi_square = float(fit.point.distance[found.used].sum()) + fit.prior_cost
    freedoms = 2 * int(found.used.sum()) - found.subspace.basis.shape[1]
    parts = []
    if prior is not None:
        freedoms += int(prior.active.sum()) - prior.prior.errors
        moved = covariance[:values] @ prior.prior.rows(values).T
        for source, where in prior.prior.by_source():
            part = moved[:, where]
            parts.append(Contribution(source.label, source.std, source.unit, part @ part.T))
    noise = covariance[:values, :values] - np.sum([part.covariance for part in parts], axis=0) if parts else covariance
    enlarged = enlargement_of(chi_square, freedoms)
    every = (Contribution('noise', None, '', noise), *parts)
    return tuple(part._replace(covariance=enlarged * part.covariance) for part in every), chi_square, freedoms


def enlargement_of(chi_square: float, freedoms: int) -> float:
    """By what a covariance is enlarged: where the stated noise does not cover the residuals, reduced chi-square."""
    return chi_square / freedoms if chdtrc(freedoms, chi_square) < _MISFIT else 1.0
