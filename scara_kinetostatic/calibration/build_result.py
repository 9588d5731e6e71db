"""From the end of the estimation to the result that leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from scara_kinetostatic.calibration import outliers
from scara_kinetostatic.calibration.estimate import Estimate, covariance_of_fit
from scara_kinetostatic.calibration.gauss_helmert import Observations
from scara_kinetostatic.calibration.identifiability import (
    Identifiability,
    advise,
    condition_number,
    determined_pairs,
    group_names,
    scales_of,
)
from scara_kinetostatic.calibration.prediction import base_force, force_residual
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import Rejection, TouchSet

Floats = NDArray[np.float64]

MISFIT = 1e-3
"""p-value of chi-square below which the stated noise does not cover the residuals and sigmas are enlarged."""


def build_result(
    touches: TouchSet,
    cell: Cell,
    start: Parameters,
    fixed: Mapping[str, float],
    observations: Observations,
    found: Estimate,
    left_out: Sequence[Rejection] = (),
) -> Calibration:
    """The result of an estimation.

    Args:
        touches: all touches of the fit.
        cell: the cell.
        start: L̄ where the fit began.
        fixed: parameters held, by name.
        observations: the touches as the fit took them.
        found: where it ended.
        left_out: touches that were not even given to the fit.
    """
    fit, used = found.fit, found.used
    parameters = fit.point.parameters
    covariance, chi_square, freedoms = _covariance(found)
    std = np.sqrt(np.diag(covariance))
    names = NAMES + tuple(label for law in cell.effects for label in law.labels)
    identifiability = _identifiability(found, observations, covariance, std, fixed, names)
    confounded = {name for group in identifiability.confounded for name in group}
    std[[name in confounded for name in names]] = np.nan
    status = {name: 'fixed' if name in fixed else 'confounded' if name in confounded else 'estimated' for name in NAMES}
    return Calibration(
        cell=cell,
        fixed=dict(fixed),
        subspace=found.subspace,
        start=start,
        parameters=parameters,
        covariance=covariance,
        std=std[: len(NAMES)],
        extra_std=std[len(NAMES) :],
        status=status,
        touches=touches,
        used=used,
        rejected=_rejections(touches, found, observations, left_out),
        noise=found.noise,
        noise_source='given' if cell.noise else 'estimated',
        force=base_force(observations, parameters),
        standardized=np.sqrt(found.distance),
        chi_square=chi_square,
        degrees_of_freedom=freedoms,
        identifiability=identifiability,
        iterations=found.iterations,
        termination=fit.termination,
        history=fit.history,
    )


def _covariance(found: Estimate) -> tuple[Floats, float, int]:
    """Covariance of L̄, enlarged where the stated noise does not cover the residuals; chi-square and its freedoms."""
    chi_square = float(found.fit.point.distance[found.used].sum())
    freedoms = 2 * int(found.used.sum()) - found.subspace.basis.shape[1]
    covariance = covariance_of_fit(found.fit, found.subspace)
    enlarged = chdtrc(freedoms, chi_square) < MISFIT
    return covariance * (chi_square / freedoms if enlarged else 1.0), chi_square, freedoms


def _rejections(
    touches: TouchSet, found: Estimate, observations: Observations, left_out: Sequence[Rejection]
) -> tuple[Rejection, ...]:
    """Touches that the fit does not believe, and those never given to it, in the order of their numbers."""
    bad = np.flatnonzero(~found.used)
    if not len(bad):
        return tuple(left_out)
    residual = force_residual(observations.select(bad), found.fit.point.parameters)
    rejected = [
        outliers.explain(int(touches.index[i]), float(found.distance[i]), off)
        for i, off in zip(bad, residual, strict=True)
    ]
    return tuple(sorted((*left_out, *rejected), key=lambda item: item.index))


def _identifiability(
    found: Estimate,
    observations: Observations,
    covariance: Floats,
    std: Floats,
    fixed: Mapping[str, float],
    names: tuple[str, ...],
) -> Identifiability:
    free = np.array([j for j, name in enumerate(names) if name not in fixed], dtype=np.intp)
    groups = group_names(found.unidentifiable, free, std, scales_of(observations), names)
    magnitude = float(np.hypot(observations.force[:, 0], observations.force[:, 1]).mean())
    values = found.fit.point.parameters.as_array()
    return Identifiability(
        rank=len(free) - found.unidentifiable.shape[1],
        condition=condition_number(found.fit.point.whitened.derivative[found.used] @ found.subspace.basis),
        confounded=groups,
        combinations=determined_pairs(found.unidentifiable, free, values, covariance),
        advice=advise(groups, magnitude),
    )
