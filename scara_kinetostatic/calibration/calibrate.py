"""From touches to L̄: start, stages, noise, what is seen, outliers, final estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.calibration import outliers, steps
from scara_kinetostatic.calibration.adjustment import Observations, first_guess
from scara_kinetostatic.calibration.identifiability import (
    SCALES,
    Identifiability,
    advise,
    condition_number,
    determined_pairs,
    group_names,
    unseen_directions,
)
from scara_kinetostatic.calibration.plausibility import check_plausible
from scara_kinetostatic.calibration.prediction import base_force, force_error, force_residual, observe
from scara_kinetostatic.calibration.projection import select, turn_radial
from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.calibration.solver import (
    COARSE,
    FINAL,
    ROBUST,
    Fit,
    Point,
    Subspace,
    minimise,
)
from scara_kinetostatic.calibration.variance import estimate_noise
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.parameters import NAMES, Parameters
from scara_kinetostatic.model.touch import TouchSet

Floats = NDArray[np.float64]

USUAL_NOISE = Noise(joint=1e-5, force=0.3)
"""Where the noise is to be estimated, the first guess."""
ROUNDS = 20
NOISE_TOLERANCE = 1e-3
MISFIT = 1e-3
"""p-value of chi-square below which the stated noise does not cover the residuals and sigmas are enlarged."""


class _Progress(NamedTuple):
    """What the rounds of the estimation hand on."""

    fit: Fit
    used: NDArray[np.bool_]
    noise: Noise
    subspace: Subspace
    unseen: Floats
    distance: Floats
    iterations: int


def calibrate(touches: TouchSet, cell: Cell, *, fixed: Mapping[str, float] | None = None) -> Calibration:
    """Estimate L̄ from touches.

    Args:
        touches: what the sensor measured, in the sensor's frame.
        cell: the cell; its noise, if given, is taken as true.
        fixed: parameters to hold, by name, at these values.

    Returns:
        The calibration. Parameters that the data cannot tell apart are held, together,
        as near to their nominal values as the data allow, and marked ``confounded``.

    Raises:
        ParameterError: `fixed` names no parameter, or gives no finite value.
        UnsupportedDataError: too few touches for the free parameters, or touches so much
            alike that they determine less than half of them.
        CellError: the forces contradict the cell's sensor sign or frame.
    """
    fixed = dict(fixed or {})
    start = _start(cell, fixed)
    free = np.array([j for j, name in enumerate(NAMES) if name not in fixed], dtype=np.intp)
    observations = observe(touches, cell)
    _check_number(len(touches), len(free))
    check_plausible(observations, cell)
    progress = _estimate(observations, cell, start, free)
    _check_rank(progress.unseen)
    return _finish(touches, cell, fixed, free, observations, progress)


def _start(cell: Cell, fixed: Mapping[str, float]) -> Parameters:
    for name in fixed:
        if name not in NAMES:
            raise ParameterError(f'fixed parameter {name!r}', 'no such parameter', f'the names are {" ".join(NAMES)}')
    return cell.nominal.replace(**fixed)


def _check_number(touches: int, parameters: int) -> None:
    needed = parameters // 2 + 1
    if touches < needed:
        raise UnsupportedDataError(
            f'{touches} touches give {2 * touches} equations, too few for {parameters} parameters',
            f'record {needed} touches at the very least, 36 or more for a good result',
        )


def _check_rank(unseen: Floats) -> None:
    parameters, lost = unseen.shape
    if 2 * lost > parameters:
        raise UnsupportedDataError(
            f'the touches are too much alike: they determine {parameters - lost} of {parameters} parameters',
            'touch several discs, from all sides, in both postures and at two or more force levels',
        )


def _estimate(observations: Observations, cell: Cell, start: Parameters, free: NDArray[np.intp]) -> _Progress:
    """Coarse, robust, then final rounds until noise, bad touches and unseen directions stay as they are."""
    noise, stage = cell.noise or USUAL_NOISE, ROBUST
    basis = np.zeros((len(NAMES), len(free)))
    basis[free, np.arange(len(free))] = SCALES[free]
    everything = subspace = Subspace(start.as_array(), basis)
    used, unseen = np.ones(len(observations.joints), dtype=bool), np.empty((len(free), 0))
    fit = minimise(observations, start, first_guess(observations, start), everything, noise, COARSE)
    adjusted, iterations = turn_radial(observations, fit.point, noise), fit.iterations
    for last_round in [False] * ROUNDS + [True]:
        fit = minimise(observations, fit.point.parameters, adjusted, subspace, noise, stage, used)
        adjusted, iterations = fit.point.adjusted, iterations + fit.iterations
        distance = outliers.studentised(fit.point.whitened, _covariance(fit, subspace), used)
        if last_round:
            break
        renewed = noise if cell.noise else _renew_noise(fit.point, used, basis, noise)
        good = outliers.find_good(distance)
        now_unseen = unseen_directions(observations.select(good), select(fit.point, good), free, renewed)
        if stage is FINAL and _same(good, used) and now_unseen.shape == unseen.shape and _close(noise, renewed):
            break
        if now_unseen.shape != unseen.shape:
            subspace, unseen = _restrict(everything, now_unseen), now_unseen
            fit = fit._replace(point=fit.point._replace(parameters=subspace.project(fit.point.parameters)))
        used, noise, stage = good, renewed, FINAL
        _check_number(int(used.sum()), subspace.basis.shape[1])
    return _Progress(fit, used, noise, subspace, unseen, distance, iterations)


def _renew_noise(point: Point, used: NDArray[np.bool_], basis: Floats, noise: Noise) -> Noise:
    """The noise levels that the residuals of good touches call for."""
    good = used & outliers.find_good(point.distance)
    if good.sum() > basis.shape[1] // 2 + 1:
        point = select(point, good)
    system = steps.compress(point.whitened.derivative @ basis, point.whitened.residual)
    return estimate_noise(point.linear, point.whitened, basis @ steps.covariance(system) @ basis.T, noise)


def _covariance(fit: Fit, subspace: Subspace) -> Floats:
    return subspace.basis @ steps.covariance(fit.system) @ subspace.basis.T


def _restrict(everything: Subspace, unseen: Floats) -> Subspace:
    """The subspace without the unseen directions: along those, L̄ stays at the origin."""
    k, d = unseen.shape
    complement = np.linalg.qr(np.concatenate([unseen, np.eye(k)], axis=1))[0][:, d:k]
    return everything._replace(basis=everything.basis @ complement)


def _same(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> bool:
    return bool((a == b).all())


def _close(old: Noise, new: Noise) -> bool:
    return all(abs(b - a) <= NOISE_TOLERANCE * a for a, b in zip(old, new, strict=True))


def _finish(
    touches: TouchSet,
    cell: Cell,
    fixed: Mapping[str, float],
    free: NDArray[np.intp],
    observations: Observations,
    progress: _Progress,
) -> Calibration:
    fit, used = progress.fit, progress.used
    parameters = fit.point.parameters
    chi_square = float(fit.point.distance[used].sum())
    freedoms = 2 * int(used.sum()) - progress.subspace.basis.shape[1]
    covariance = _covariance(fit, progress.subspace)
    if stats.chi2.sf(chi_square, freedoms) < MISFIT:
        covariance = covariance * (chi_square / freedoms)
    groups = group_names(progress.unseen, free)
    confounded = {name for group in groups for name in group}
    std = np.sqrt(np.diag(covariance))
    std[[name in confounded for name in NAMES]] = np.nan
    status = {name: 'fixed' if name in fixed else 'confounded' if name in confounded else 'estimated' for name in NAMES}
    residual = force_residual(observations, parameters)
    nominal = force_residual(observations, _start(cell, fixed))
    magnitude = float(np.hypot(observations.force[:, 0], observations.force[:, 1]).mean())
    return Calibration(
        cell=cell,
        fixed=dict(fixed),
        subspace=progress.subspace,
        parameters=parameters,
        covariance=covariance,
        std=std,
        status=status,
        touches=touches,
        used=used,
        rejected=tuple(
            outliers.explain(int(touches.index[i]), float(progress.distance[i]), residual[i])
            for i in np.flatnonzero(~used)
        ),
        noise=progress.noise,
        noise_source='given' if cell.noise else 'estimated',
        force=base_force(observations, parameters),
        residual=residual,
        nominal_residual=nominal,
        standardized=np.sqrt(progress.distance),
        force_error=force_error(residual[used]),
        force_error_nominal=force_error(nominal[used]),
        chi_square=chi_square,
        degrees_of_freedom=freedoms,
        identifiability=Identifiability(
            rank=len(free) - progress.unseen.shape[1],
            condition=condition_number(fit.point.whitened.derivative[used] @ progress.subspace.basis),
            confounded=groups,
            combinations=determined_pairs(progress.unseen, free, parameters.as_array(), covariance),
            advice=advise(groups, magnitude),
        ),
        iterations=progress.iterations,
        termination=fit.termination,
        history=fit.history,
    )
