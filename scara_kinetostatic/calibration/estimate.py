"""The rounds of the estimation: start, stages, noise, what is seen, outliers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration import outliers, steps
from scara_kinetostatic.calibration.gauss_helmert import Adjusted, Observations, first_guess
from scara_kinetostatic.calibration.identifiability import scales_of, unidentifiable_directions
from scara_kinetostatic.calibration.projection import project, select, turn_radial
from scara_kinetostatic.calibration.solver import (
    COARSE,
    FINAL,
    ROBUST,
    Fit,
    Point,
    Subspace,
    Termination,
    minimise,
)
from scara_kinetostatic.calibration.variance import estimate_noise
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel

USUAL_NOISE = Noise(joint=1e-5, force=0.3)
"""Where the noise is to be estimated, the first guess."""
ROUNDS = 20
SETTLING = 4
"""Rounds in which an unseen direction may still be freed and a bad touch taken back, as the noise finds its place."""
STUCK = 2
"""Rounds in a row without an end after which a fit that began close by is given up."""
SAME_DIRECTION = 1e-3
NOISE_TOLERANCE = 1e-3
NEARLY = 0.05
"""The same at the last round: two noise levels that are hard to tell apart come to rest slowly."""


class WarmStart(NamedTuple):
    """An earlier fit that is close to the one wanted.

    Attributes:
        model: where to begin; the effects are those to be fitted.
        noise: σ_q and σ_f.
        used: touches that took part, (n,).
    """

    model: ExtendedModel
    noise: Noise
    used: Mask


class Estimation(NamedTuple):
    """Where the rounds of the estimation ended.

    Attributes:
        fit: the last one; it is that of `used`, `noise` and `subspace`.
        used: touches that took part, (n,).
        noise: given or estimated.
        subspace: the changes of L̄ allowed.
        unseen: directions left out, (k, d), in units of `SCALES`.
        distance: squared studentised distances of all touches, (n,).
        iterations: steps of all rounds.
    """

    fit: Fit
    used: Mask
    noise: Noise
    subspace: Subspace
    unidentifiable: Floats
    distance: Floats
    iterations: int


def check_number(touches: int, parameters: int, left_out: Sequence[str] = ()) -> None:
    """Whether there are more equations than parameters.

    Args:
        touches: how many there are.
        parameters: how many are free.
        left_out: why others were left out beforehand.

    Raises:
        UnsupportedDataError: too few touches.
    """
    needed = parameters // 2 + 1
    if touches < needed:
        problem = f'{touches} touches give {2 * touches} equations, too few for {parameters} parameters'
        remedy = f'record {needed} touches at the very least, 36 or more for a good result'
        if left_out:
            problem += f'; {len(left_out)} were left out, the first: {left_out[0]}'
            remedy = f'see what was left out, or {remedy}'
        raise UnsupportedDataError(problem, remedy)


def _check_left(good: Mask, parameters: int, noise: Noise) -> None:
    """Whether the touches that fit are enough."""
    if int(good.sum()) < parameters // 2 + 1:
        raise UnsupportedDataError(
            f'{int(good.sum())} of {len(good)} touches fit a model at a noise of {noise.joint:.2g} rad per joint and '
            f'{noise.force:.2g} N, too few for {parameters} parameters',
            'check the noise in the cell description, the places of the discs, frame, sign and axes of the sensor',
        )


def check_rank(unidentifiable: Floats) -> None:
    """Whether at least half of the free parameters are determined; `unseen` is (k, d)."""
    parameters, lost = unidentifiable.shape
    if 2 * lost > parameters:
        raise UnsupportedDataError(
            f'the touches are too much alike: they determine {parameters - lost} of {parameters} parameters',
            'touch several discs, from all sides, in both postures and at two or more force levels',
        )


def estimate(
    observations: Observations,
    cell: Cell,
    start: ExtendedModel,
    free: Indices,
    warm_start: WarmStart | None = None,
) -> Estimation:
    """Coarse, robust, then final rounds until noise, bad touches and unseen directions stay as they are.

    Args:
        observations: the touches.
        cell: whose noise is taken as true, if given.
        start: the model to start from; fixed parameters at their values.
        free: positions of the others, (k,).
        warm_start: an earlier fit close by, from which no coarse stage is needed.

    Raises:
        UnsupportedDataError: too few touches for the free parameters, or touches so much alike
            that they determine less than half of them.
    """
    scales = scales_of(start)
    basis = np.zeros((len(scales), len(free)))
    basis[free, np.arange(len(free))] = scales[free]
    everything = subspace = Subspace(start.as_array(), basis)
    unidentifiable = np.empty((len(free), 0))
    model, adjusted, noise, used, iterations = _begin(observations, cell, start, everything, warm_start)
    stage = ROBUST if warm_start is None else FINAL
    limits = 0
    for number in range(ROUNDS + 1):
        fit = minimise(observations, model, adjusted, subspace, noise, stage, used)
        model, adjusted, iterations = fit.point.model, fit.point.adjusted, iterations + fit.iterations
        distance = outliers.studentised(fit.point.whitened, covariance_of_fit(fit, subspace), used)
        updated = noise if cell.noise else _update_noise(fit.point, used, subspace, noise)
        good = outliers.find_good(distance)
        stuck = warm_start is not None and fit.termination is Termination.ITERATION_LIMIT
        limits = limits + 1 if stuck else 0
        if limits == STUCK:
            break
        if number == ROUNDS:
            if not (_same(good & used, used) and _close(noise, updated, NEARLY)):
                fit = fit._replace(termination=Termination.ITERATION_LIMIT)
            break
        if number >= SETTLING:
            good &= used  # nor is a bad touch taken back, for the same reason
        now_unidentifiable = unidentifiable_directions(*_only(good, observations, fit.point), free, noise)
        if number >= SETTLING and now_unidentifiable.shape[1] < unidentifiable.shape[1]:
            now_unidentifiable = (
                unidentifiable  # what was unseen is not freed again: the judgements could take turns for ever
            )
        if (
            stage is FINAL
            and _same(good, used)
            and not _differ(now_unidentifiable, unidentifiable, number)
            and _close(noise, updated)
        ):
            break
        if _differ(now_unidentifiable, unidentifiable, number):
            check_rank(now_unidentifiable)
            subspace, unidentifiable = restrict(everything, now_unidentifiable), now_unidentifiable
            model = subspace.project(model)
        used, noise, stage = good, updated, FINAL
        _check_left(good, subspace.basis.shape[1], noise)
    return Estimation(fit, used, noise, subspace, unidentifiable, distance, iterations)


def _begin(
    observations: Observations, cell: Cell, start: ExtendedModel, everything: Subspace, warm_start: WarmStart | None
) -> tuple[ExtendedModel, Adjusted, Noise, Mask, int]:
    """Where the rounds begin: L̄, adjusted observations, noise, touches that count, steps so far."""
    if warm_start is not None:
        noise = cell.noise or warm_start.noise
        return (
            warm_start.model,
            project(observations, warm_start.model, noise).adjusted,
            noise,
            warm_start.used,
            0,
        )
    noise = cell.noise or USUAL_NOISE
    fit = minimise(observations, start, first_guess(observations, start), everything, noise, COARSE)
    used = np.ones(len(observations.joints), dtype=bool)
    return fit.point.model, turn_radial(observations, fit.point), noise, used, fit.iterations


def _only(good: Mask, observations: Observations, point: Point) -> tuple[Observations, Point]:
    """The good touches; without a copy where all are."""
    return (observations, point) if good.all() else (observations.select(good), select(point, good))


def _update_noise(point: Point, used: Mask, subspace: Subspace, noise: Noise) -> Noise:
    """The noise levels that the residuals of good touches call for."""
    good = used & outliers.find_good(point.distance)
    if good.sum() > subspace.basis.shape[1] // 2 + 1:
        point = select(point, good)
    system = steps.compress(point.whitened.derivative @ subspace.basis, point.whitened.residual)
    fitted = subspace.basis @ steps.covariance(system, least=1.0) @ subspace.basis.T
    return estimate_noise(point.linear, point.whitened, fitted, noise)


def covariance_of_fit(fit: Fit, subspace: Subspace) -> Floats:
    """Covariance of the twelve at a fit, (12, 12); no statement about what the subspace leaves out."""
    return subspace.basis @ steps.covariance(fit.system) @ subspace.basis.T


def restrict(everything: Subspace, unidentifiable: Floats) -> Subspace:
    """The subspace without the unseen directions: along those, L̄ stays at the origin."""
    k, d = unidentifiable.shape
    complement = np.linalg.qr(np.concatenate([unidentifiable, np.eye(k)], axis=1))[0][:, d:k]
    return everything._replace(basis=everything.basis @ complement)


def _differ(now: Floats, before: Floats, number: int) -> bool:
    """Whether other directions are unseen than before; once settled, whether their number is another."""
    if now.shape != before.shape:
        return True
    return number < SETTLING and float(np.abs(now - before @ (before.T @ now)).max(initial=0.0)) > SAME_DIRECTION


def _same(a: Mask, b: Mask) -> bool:
    return bool((a == b).all())


def _close(old: Noise, new: Noise, tolerance: float = NOISE_TOLERANCE) -> bool:
    return all(abs(b - a) <= tolerance * a for a, b in zip(old, new, strict=True))
