"""Noise levels: variance components of the residuals by REML, and what the steps of the encoders make.

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

import numpy as np

from scara_kinetostatic.calibration.fit_point import Point, select
from scara_kinetostatic.calibration.gauss_helmert import Linearisation, whiten_by, whitened_square
from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.calibration.outliers import find_good
from scara_kinetostatic.calibration.solver import ActivePrior, Subspace
from scara_kinetostatic.gaussian import least_squares
from scara_kinetostatic.model.arrays import Floats, Mask, rms
from scara_kinetostatic.model.cell import Cell, Noise

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
    """A noise with all that the cell description states; of what is estimated one level for both joints, or axes."""
    if stated is None:
        return noise._replace(joint=noise.joint_rms, force=noise.force_rms)
    if stated.force_relative is not None:
        return stated
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
