"""The estimation in rounds: fit, noise levels, outliers, identifiable directions, until none of them changes.

Each round fits the model (`solver`) with what the one before has found: the noise levels where they are not given, the
outliers, and the directions of the model that the data do not determine. The first fit is that of the robust loss.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.fit_point import (
    COARSE,
    FINAL,
    ROBUST,
    Point,
    Stage,
    evaluate,
    fitted_surfaces,
    project,
    select,
)
from scara_kinetostatic.calibration.gauss_helmert import as_radial, first_guess
from scara_kinetostatic.calibration.identifiability import scales_of, unidentifiable_directions
from scara_kinetostatic.calibration.noise import USUAL_NOISE, as_stated, estimated_levels, noise_of_residuals
from scara_kinetostatic.calibration.observations import NO_ERRORS, JointPrior, Observations, Prior
from scara_kinetostatic.calibration.outliers import find_good, studentised
from scara_kinetostatic.calibration.solver import Fit, Subspace, Termination, minimise
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.gaussian import least_squares
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel

_ROUNDS = 20
"""Rounds after the first at most."""


class WarmStart(NamedTuple):
    """An earlier fit that is close to the one wanted.

    Attributes:
        model: where to begin; its effects are those to be fitted.
        noise: σ_q and σ_f.
        used: touches that took part, (n,).
        errors: declared errors of the cell, (m,); None to begin without.
    """

    model: ExtendedModel
    noise: Noise
    used: Mask
    errors: Floats | None = None


class Estimation(NamedTuple):
    """Where the rounds of the estimation ended.

    Attributes:
        fit: the last one; it is that of `used`, `noise` and `subspace`.
        used: touches that took part, (n,).
        noise: given or estimated.
        subspace: the changes of the model allowed.
        unidentifiable: directions left out, (k, d), in units of the scales.
        distance: squared studentised distances of all touches, (n,).
        iterations: steps of all rounds.
        observations: the touches, each of an outline on the edge or corner where the coarse fit has it.
    """

    fit: Fit
    used: Mask
    noise: Noise
    subspace: Subspace
    unidentifiable: Floats
    distance: Floats
    iterations: int
    observations: Observations


class _Round(NamedTuple):
    """What a round takes as given.

    Attributes:
        stage: what is minimised.
        used: touches that take part, (n,).
        noise: σ_q and σ_f.
        off_normal: standard deviation of the off-normal angles, rad; 0 without.
        subspace: the changes of the model allowed.
        unidentifiable: directions left out, (k, d).
    """

    stage: Stage
    used: Mask
    noise: Noise
    off_normal: float
    subspace: Subspace
    unidentifiable: Floats

    def is_similar(self, following: _Round, tolerance: float) -> bool:
        """Whether the outliers are as before, and the noise levels but for a relative change."""
        levels, others = ((*one.noise.levels, one.off_normal) for one in (self, following))
        pairs = zip(levels, others, strict=True)
        same = all(abs(after - before) <= tolerance * before for before, after in pairs)
        return same and bool((self.used == following.used).all())


def estimate(
    observations: Observations, cell: Cell, start: ExtendedModel, free: Indices, warm_start: WarmStart | None = None
) -> Estimation:
    """Fit a model to touches, round by round.

    Args:
        observations: the touches.
        cell: its noise, if given, is taken as true.
        start: the model to start from; fixed parameters at their values.
        free: positions of the others, (k,).
        warm_start: an earlier fit close by, from which no coarse stage is needed.

    Raises:
        UnsupportedDataError: too few touches fit for the free parameters, or touches so much alike
            that they determine less than half of them.
    """
    everything = Subspace.of_free(start, free, scales_of(start))
    observations, point, now, iterations = _begin(observations, cell, start, everything, warm_start)
    limits, most = 0, 60 if warm_start is None else 30  # one that converges takes ten or less, mostly
    for number in range(_ROUNDS + 1):
        fit = minimise(observations, point, now.subspace, now.noise, now.stage, now.used, most)
        point, iterations = fit.point, iterations + fit.iterations
        observations = observations.with_errors(point.errors)
        distance = studentised(point.whitened, covariance_of_fit(fit, now.subspace), now.used)
        at_limit = warm_start is not None and fit.termination is not Termination.CONVERGED
        limits = limits + 1 if at_limit else 0
        if limits == 2:
            break
        following = _next_round(observations, cell, everything, free, now, fit, distance, number)
        # after so many steps a warm fit is given up: its noise levels and outliers alternate
        is_last = number == _ROUNDS or (warm_start is not None and iterations > 240)
        if is_last and not now.is_similar(following, 0.05):  # levels that are hard to tell apart converge slowly
            fit = fit._replace(termination=Termination.ITERATION_LIMIT)
        is_same = following.subspace is now.subspace
        # the fit has changed nothing of what it took as given, but for noise levels that have converged
        if is_last or (is_same and now.stage is FINAL and now.is_similar(following, 1e-3)):
            break
        model = point.model
        if not is_same:
            parameters, lost = following.unidentifiable.shape
            if 2 * lost > parameters:
                raise UnsupportedDataError(
                    f'the touches are too much alike: they determine {parameters - lost} of {parameters} parameters',
                    'touch several discs, from all sides, in both postures and at two or more force levels',
                )
            model = following.subspace.project(model, scales_of(start))
        model = model.with_off_normal_std(following.off_normal)
        if model is not point.model:
            point = evaluate(observations, model, point.adjusted, following.noise)
        elif following.noise is not now.noise:
            point = point.with_noise(following.noise)
        now = following
        if now.used.sum() < fewest_touches(parameters := now.subspace.basis.shape[1], observations.known):
            raise UnsupportedDataError(
                f'{now.used.sum()} of {len(now.used)} touches fit a model at a noise of {now.noise.joint_rms:.2g} rad '
                f'per joint and {now.noise.force_rms:.2g} N, too few for {parameters} parameters',
                'check the noise in the cell description, the places of the discs, frame, sign and axes of the sensor',
            )
    return Estimation(fit, now.used, now.noise, now.subspace, now.unidentifiable, distance, iterations, observations)


def _begin(
    observations: Observations, cell: Cell, start: ExtendedModel, everything: Subspace, warm_start: WarmStart | None
) -> tuple[Observations, Point, _Round, int]:
    """Touches and point to begin with, the first round, and the steps so far."""
    none = np.empty((everything.basis.shape[1], 0))
    if warm_start is not None:
        noise = as_stated(warm_start.noise, cell.noise)
        first = _Round(FINAL, warm_start.used, noise, warm_start.model.off_normal_std, everything, none)
        errors = observations.errors if warm_start.errors is None else warm_start.errors
        observations = observations.with_errors(errors)
        return observations, project(observations, warm_start.model, noise), first, 0
    noise = cell.noise or USUAL_NOISE
    # at first all that the cell description says counts as exactly known
    stated = observations._replace(declared=None, errors=NO_ERRORS, reported=None, random=None, shift=None)
    some = _few_of_each(observations)
    near = evaluate(stated, start, first_guess(stated, start), noise, COARSE)
    fit = minimise(stated, near, everything, noise, COARSE, some)
    first = _Round(ROBUST, some, noise, start.off_normal_std, everything, none)
    if cell.has_outlines:
        observations = observations.on_surfaces(cell.surfaces, fitted_surfaces(stated, cell, fit.point))
    adjusted = as_radial(observations, fit.point.model, fit.point.adjusted.state)
    observations = observations.with_errors(observations.errors)
    return observations, evaluate(observations, fit.point.model, adjusted, noise), first, fit.iterations


def _few_of_each(observations: Observations) -> Mask:
    """The first three of touches that are alike, in a cell of a grid of 0.02 rad and 10 N, (n,).

    A few places touched again and again, more than half of all touches together, would else be fitted alone by the
    robust runs, by whatever parameters, and all others be the outliers.
    """
    cells = np.round(np.concatenate([observations.joints / 0.02, observations.force / 10.0], axis=1))
    order, few = np.lexsort(cells.T), np.ones(len(cells), dtype=bool)
    few[order[3:]] = (cells[order[3:]] != cells[order[:-3]]).any(axis=1)
    return few


def _next_round(
    observations: Observations,
    cell: Cell,
    everything: Subspace,
    free: Indices,
    now: _Round,
    fit: Fit,
    distance: Floats,
    number: int,
) -> _Round:
    """What the fit of a round says of noise, outliers and directions; the subspace is the same object if it stays."""
    noise, off_normal = now.noise, now.off_normal
    if off_normal or estimated_levels(noise, cell.noise):
        noise, off_normal = noise_of_residuals(observations, fit.point, now.used, now.subspace, now.noise, cell)
    # while the noise converges a direction may be freed, an outlier taken back; later the two could alternate for ever
    good, late = find_good(distance), number >= 4
    if late:
        good &= now.used
    some = (observations, fit.point) if good.all() else (observations.select(good), select(fit.point, good))
    # what noise makes is asked at the optimum
    directions = unidentifiable_directions(*some, free, now.noise if now.stage is FINAL else None)
    if late and directions.shape[1] < now.unidentifiable.shape[1]:
        directions = now.unidentifiable
    before = now.unidentifiable
    if directions.shape == before.shape and (  # in late rounds, as many are the same
        late or float(np.abs(directions - before @ (before.T @ directions)).max(initial=0.0)) <= 1e-3
    ):
        return _Round(FINAL, good, noise, off_normal, now.subspace, now.unidentifiable)
    return _Round(FINAL, good, noise, off_normal, everything.without(directions), directions)


def covariance_of_fit(fit: Fit, subspace: Subspace) -> Floats:
    """Covariance of all values of a model and the declared errors at a fit, (12 + k + m, 12 + k + m); zero along what
    the subspace leaves out.
    """
    basis = subspace.with_errors(len(fit.point.errors))
    return basis @ least_squares.covariance(fit.system) @ basis.T


def fewest_touches(parameters: int, known: Prior | JointPrior | None = None) -> int:
    """Touches that give more equations than there are parameters; two where an earlier calibration is the prior."""
    return 2 if isinstance(known, JointPrior) else parameters // 2 + 1
