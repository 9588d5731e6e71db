"""The estimation in rounds: fit, noise levels, outliers, identifiable directions, until none of them changes.

Each round fits the model (`solver`) with what the one before has found: the noise levels where they are not given, the
outliers, and the directions of the model that the data do not determine. The first fit is that of the robust loss.

**Outliers** are touches far from what all the others predict. The measure is the studentised distance: the squared
Mahalanobis distance of its misclosure under the covariance it has as a residual of the fit (for a used touch, smaller
than V by its leverage; for an unused one, larger). Where all is well it is chi-square with 2 degrees of freedom; the
bound is set so that one good touch is lost in a thousand recordings. If the bulk of the touches is worse than the
noise says, the bound grows with it: then the model or the noise is wrong, which is not the touches' fault.

**Noise levels** are estimated from the residuals: variance components by REML.

The covariance of a misclosure is V = Σ_l σ_l² V_l with known V_l: h_Q h_Qᵀ of the joints, h_F h_Fᵀ of the force,
‖F‖² h_F h_Fᵀ of noise that grows with the force, and h_α h_αᵀ of random off-normal angles. Restricted
maximum likelihood finds the levels from the residuals of the fit, accounting for the parameters fitted.
One round solves

    Σ_l tr(P V_k P V_l) σ_l² = rᵀ V⁻¹ V_k V⁻¹ r,   P = V⁻¹ - V⁻¹ J C Jᵀ V⁻¹,

and rounds are repeated with the fit until it converges. Joints and force are well separated: along the
force both act, across it the force's noise alone. Off-normal angles act across it, by the more the larger the disc,
the force's noise the less the larger the force. What is stated makes up the rest of V.

Source: Förstner's and Helmert's variance component estimation; Koch, Parameter
Estimation and Hypothesis Testing in Linear Models (1999), section 3.6.
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
from scara_kinetostatic.calibration.gauss_helmert import (
    Linearisation,
    Whitened,
    as_radial,
    first_guess,
    whiten_by,
    whitened_square,
)
from scara_kinetostatic.calibration.identifiability import scales_of, unidentifiable_directions
from scara_kinetostatic.calibration.observations import NO_ERRORS, Observations
from scara_kinetostatic.calibration.solver import ActivePrior, Fit, Subspace, Termination, minimise
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.gaussian import least_squares
from scara_kinetostatic.gaussian.least_squares import typical_scale
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, as_complex, rms
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel

USUAL_NOISE = Noise(joint=1e-5, force=0.3)
"""Where the cell does not give it: the first guess of an estimation, and the noise of simulated touches."""
_LEAST = {'joint': 1e-8, 'force': 1e-5, 'force_relative': 1e-6, 'off_normal': 1e-4}
"""The least that a noise level is taken to be, rad, N, 1 and rad: joint readings may repeat to the last bit, and below
this the weights would be those of rounding errors; no sensor resolves smaller off-normal angles."""

_FINEST_STEP = float(np.sqrt(12.0)) * 1e-5
"""Finer steps of the readings are harmless, rad: their noise is below the usual one."""
_CLEAR = 0.7
"""Mean cosine of the differences between neighbouring readings, in turns per step, from which on they are a grid."""
_CHANCE = 1e-4
"""Of as clear a grid among readings without one."""


def reading_noise(cell: Cell, joints: Floats) -> Floats:
    """Standard deviation of both angles by the steps of the encoders, step / √12, (2,), rad; 0 where there are none.

    A joint at rest repeats its reading, so the mean over a hold is no better than one. Where noise spreads the readings
    over several steps, their means are on no grid, and nothing is found. Each of the smallest differences between the
    readings may be several steps: the largest step counts of which nearly all differences are multiples, with less than
    `_CHANCE` by chance (Rayleigh's test; Mardia, Jupp, Directional Statistics, 2000, section 6.3.1).

    Args:
        cell: its readings have the steps.
        joints: Q of all touches, (n, 2), rad.
    """
    first, second = (_step(column) / np.sqrt(12.0) for column in cell.readings(joints).T)
    return np.array([first, np.hypot(second, cell.coupling * first)])


def raised(noise: Noise, cell: Cell, joints: Floats) -> Noise:
    """A noise of the joints of no less than `reading_noise`; one number for both where it is estimated."""
    least = reading_noise(cell, joints)
    least = least if cell.noise else np.full(2, rms(least))
    first, second = np.maximum(noise.joint_levels, least).tolist()
    return noise._replace(joint=first if first == second else (first, second))


def _step(readings: Floats) -> float:
    """The step of which readings (n,) are multiples, rad; 0 where there is none."""
    gaps = np.diff(np.unique(np.round(readings, 9)))
    parts = [gap / np.arange(1, 1 + int(gap / _FINEST_STEP)) for gap in np.sort(gaps)[:2].tolist() if gap < 0.05]
    steps = np.sort(np.concatenate([np.zeros(0), *parts]))[::-1]
    clear, chance = steps, len(steps) / _CHANCE
    for part in (gaps[::10], gaps):  # a few of them exclude most steps
        clear = np.cos(2 * np.pi * part / steps[:, None]).mean(axis=1) if len(steps) else steps
        steps, clear = steps[clear > _CLEAR], clear[clear > _CLEAR]
    return float(steps[0]) if len(steps) and len(gaps) * clear[0] ** 2 > np.log(chance) else 0.0


def estimated_levels(noise: Noise, stated: Noise | None) -> list[str]:
    """The levels of a noise that are to be estimated: ``joint`` and ``force`` where the cell description states
    nothing, ``force_relative`` where the noise has it and the description has not.
    """
    known = stated is not None
    grows = noise.force_relative is not None and (stated is None or stated.force_relative is None)
    return ([] if known else ['joint', 'force']) + (['force_relative'] if grows else [])


def as_stated(noise: Noise, stated: Noise | None) -> Noise:
    """A noise with all that the cell description states."""
    if stated is None or stated.force_relative is not None:
        return stated or noise
    return stated._replace(force_relative=noise.force_relative)


def estimate_noise(
    point: Point, covariance: Floats, noise: Noise, stated: Noise | None = None, prior: Floats | None = None
) -> tuple[Noise, float]:
    """One round of REML at a fit.

    Args:
        point: the used touches, whitened with `noise`; where its model has random off-normal angles, their standard
            deviation is estimated as well.
        covariance: C of the parameters in the scale of its Jacobian, (12 + k + m, 12 + k + m).
        noise: the levels so far.
        stated: what the cell description says of them, which is kept; None for nothing.
        prior: derivatives of what is known besides, with unit variances, (p, 12 + k + m); None for nothing.

    Returns:
        The levels that the residuals call for, and the standard deviation of the off-normal angles, rad, each within a
        factor of 10 of before.
    """
    linear, whitened, off_normal = point.linear, point.whitened, point.model.off_normal_std
    by = {'joint': linear.by_joints, 'force': linear.by_force, 'force_relative': growing(linear)}
    old = {key: getattr(noise, key) for key in estimated_levels(noise, stated)}
    if linear.by_off_normal is not None:
        old['off_normal'], by['off_normal'] = off_normal, linear.by_off_normal[..., None] / off_normal
    size = np.array([max(level, _LEAST[key]) ** 2 for key, level in old.items()])
    parts = [whitened_square(by[key], whitened.root) for key in old]
    parts.append(np.eye(2) - np.tensordot(size, np.array(parts), 1))  # V less these
    r, jacobian, count = whitened.residual, whitened.jacobian, len(old)
    weighted = [part @ jacobian for part in parts]
    normals = [np.einsum('nik,nil->kl', jacobian, w) @ covariance for w in weighted]
    if prior is None:
        freedoms = r.size - float(np.linalg.matrix_rank(covariance))
    else:  # tr(I - J C Jᵀ): more is known of the parameters than the touches say
        freedoms = r.size - float(np.einsum('nik,nil,kl->', jacobian, jacobian, covariance, optimize=True))
    factor = float(np.sqrt(float((r**2).sum()) / max(freedoms, 1)))
    # the ratio of the levels is kept, and only their size estimated
    same_ratio = np.array(list(old.values())) * (1.0 if stated else factor)
    if freedoms < 10:
        return _bounded(noise, old, same_ratio)
    matrix = np.empty((count, count + 1))
    for k in range(count):
        for j in range(count + 1):
            crossed = np.einsum('nik,nil->kl', weighted[k], weighted[j]) @ covariance
            product = np.einsum('nij,nij->', parts[k], parts[j])
            matrix[k, j] = product - 2 * np.trace(crossed) + np.trace(normals[k] @ normals[j])
    vector = np.array([np.einsum('ni,nij,nj->', r, part, r) for part in parts[:count]]) - matrix[:, count]
    if prior is not None:  # the errors that it bounds are of known size
        vector -= [np.trace(normal @ prior.T @ prior @ covariance) for normal in normals[:count]]
    matrix = matrix[:, :count]
    if np.linalg.eigvalsh(matrix * np.outer(size, size)).min() <= 0:  # some act alike: no telling them apart
        return _bounded(noise, old, same_ratio)
    return _bounded(noise, old, np.sqrt(_distinguishable(matrix, vector)))


def off_normal_uncertainty(point: Point) -> float:
    """Standard uncertainty of the standard deviation σ_α of the off-normal angles, rad, by Fisher's information.

    With the part ρ of the variance of a touch that its angle makes, it is σ_α / √(2 Σ ρ²): of n touches without noise
    σ_α / √(2n). What the parameters and the other levels take from it is left out.

    Args:
        point: the used touches, of a model with such angles.
    """
    assert point.linear.by_off_normal is not None
    part = (whiten_by(point.linear.by_off_normal, point.whitened.root) ** 2).sum(axis=1)
    return float(point.model.off_normal_std / np.sqrt(2 * (part**2).sum()))


def growing(linear: Linearisation) -> Floats:
    """B of V_l = B Bᵀ of noise as large as the force, (n, 2, 2)."""
    return linear.by_force * np.hypot(*linear.force.T)[:, None, None]


def _distinguishable(matrix: Floats, vector: Floats) -> Floats:
    """Solve for variances, none smaller than what the residuals could distinguish from zero.

    An estimate at or below zero says that a noise does not show, not that there is none: a weight
    without bound would make sigmas too small. Such a variance is set to half of its own
    standard deviation, and the others are solved for.
    """
    solution = np.asarray(np.linalg.solve(matrix, vector), dtype=float)
    least = 0.5 * np.sqrt(2 * np.diag(np.linalg.inv(matrix)))
    others: Mask = np.ones(len(solution), dtype=bool)
    while np.any(too_small := others & (solution < least)):
        hidden = int(np.argmin(np.where(too_small, solution / least, np.inf)))
        others[hidden], solution[hidden] = False, least[hidden]
        if others.any():
            rest = vector[others] - matrix[np.ix_(others, ~others)] @ solution[~others]
            solution[others] = np.linalg.solve(matrix[np.ix_(others, others)], rest)
    return solution


def _bounded(noise: Noise, old: dict[str, float], levels: Floats) -> tuple[Noise, float]:
    """A noise with new levels, (l,), each within a factor of 10 of the old one and not below the least; and that of the
    off-normal angles, 0 where there are none.
    """
    pairs = zip(old.items(), levels.tolist(), strict=True)
    found = {key: max(_LEAST[key], min(max(new, before / 10.0), before * 10.0)) for (key, before), new in pairs}
    off_normal = found.pop('off_normal', 0.0)
    return noise._replace(**found), off_normal


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
        if now.used.sum() < fewest_touches(parameters := now.subspace.basis.shape[1]):
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


def noise_of_residuals(
    observations: Observations, point: Point, used: Mask, subspace: Subspace, noise: Noise, cell: Cell
) -> tuple[Noise, float]:
    """The noise levels by the residuals of the good touches, those that the cell states are kept; and the standard
    deviation of the off-normal angles, rad.

    Args:
        observations: the touches.
        point: the fit, whitened with `noise`.
        used: touches that took part, (n,).
        subspace: the changes that it could make.
        noise: the levels so far.
        cell: which levels are stated.
    """
    good = used & find_good(point.distance)
    if good.sum() > subspace.basis.shape[1] // 2 + 1:
        point = select(point, good)
    basis = subspace.with_errors(len(point.errors))
    prior = ActivePrior.of(observations, subspace)
    known = None if prior is None else prior.system(point)
    system = least_squares.compress(point.whitened.jacobian, point.whitened.residual, basis=basis, prior=known)
    fitted = basis @ least_squares.covariance(system, least=1.0) @ basis.T
    rows = None if known is None else known[:, :-1]
    found, off_normal = estimate_noise(point, fitted, noise, cell.noise, rows)
    return raised(found, cell, observations.joints), off_normal


def covariance_of_fit(fit: Fit, subspace: Subspace) -> Floats:
    """Covariance of all values of a model and the declared errors at a fit, (12 + k + m, 12 + k + m); zero along what
    the subspace leaves out.
    """
    basis = subspace.with_errors(len(fit.point.errors))
    return basis @ least_squares.covariance(fit.system) @ basis.T


def fewest_touches(parameters: int) -> int:
    """Touches that give more equations than there are parameters."""
    return parameters // 2 + 1


FALSE_REJECTIONS = 1e-3
"""Expected number of good touches rejected in one recording."""


def studentised(whitened: Whitened, covariance: Floats, used: Mask) -> Floats:
    """Squared studentised distance of each touch, (n,).

    Args:
        whitened: residuals and Jacobian of all touches, each at its adjusted observations.
        covariance: of all values of the model and the declared errors, (12 + k + m, 12 + k + m).
        used: which touches took part in the fit.
    """
    jacobian, sign = whitened.jacobian.T, np.where(used, -1.0, 1.0)
    moved = np.tensordot(covariance, jacobian, 1)
    s11, s21, s22 = (sign * (moved[:, i] * jacobian[:, j]).sum(axis=0) for i, j in ((0, 0), (1, 0), (1, 1)))
    mean, half = 1.0 + (s11 + s22) / 2, (s11 - s22) / 2
    turned = as_complex(whitened.residual) * np.exp(-0.5j * np.arctan2(s21, half))  # along the principal axes
    # a touch without which a parameter is undetermined has leverage 1: its residual is zero whatever it measured
    first, second = np.maximum(mean + np.multiply.outer((1.0, -1.0), np.hypot(half, s21)), 1e-3)
    return np.asarray(turned.real**2 / first + turned.imag**2 / second)


def find_good(distance: Floats) -> Mask:
    """Which touches are no outliers, (n,); all, if too many would be.

    Args:
        distance: squared studentised distances.
    """
    bound = -2 * np.log(FALSE_REJECTIONS / len(distance)) * typical_scale(distance)
    good = distance <= bound
    # where more seem bad, the touches disagree with the model, not single ones with the rest
    return good if (~good).mean() <= 0.2 else np.ones_like(good)
