"""What undetected effects contribute to the uncertainty: random effects in one linear mixed model.

At a fit the whitened misclosures of the touches are, to first order,

    y + J Δ + N e + Σ_g τ_g X_g u_g = ε,    u_g ~ N(0, I),    e ~ N(0, I),    ε ~ N(0, V),

with J the derivatives by what the fit has estimated, N those by the declared errors, and X_g the columns of the effects
of one name that the fit does not have, in units of their typical sizes (`effects.undetected`). V is that of noise of
the joints and of the force, whose levels are free here where the fit has estimated them: there they contain what is
undetected.

**Sizes.** The τ are found by restricted likelihood (REML; Patterson and Thompson, Biometrika 58 (1971) 545), by Fisher
scoring in log τ. A robot is good or bad as a whole, so they have a common size τ_0 beforehand; τ_g / τ_0 and τ_0 have a
half-Cauchy prior with scale 1 each (Gelman, Bayesian Analysis 1 (2006) 515), and its density in log τ counts: what the
touches say nothing of has the common size, not none. Effects that the fit has count for τ_0 by their amplitudes. The
mean of τ is taken, exp(log τ + v/2) with the variance v of log τ by Laplace's approximation, v at most 1. Where the
fit has enlarged its covariance, the noise is the enlarged one. Sizes that the cell
description declares are held.

**Contribution.** The estimate stays what it is: least squares without these effects. With C the covariance of the
fit and J' its derivatives by all values and declared errors, they move it by C J'ᵀ X u, and what they do to the tip is
not predicted at all: the errors of the values and of the effects' own columns are (C J'ᵀ X, -I) u τ. To predict them
as well, shrunk towards zero (BLUP), displaced the tip of simulated robots no less.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy import linalg

from scara_kinetostatic.calibration.gauss_helmert import outer
from scara_kinetostatic.calibration.noise_estimation import whiten_matrix
from scara_kinetostatic.calibration.result import UNDETECTED, Calibration, Contribution
from scara_kinetostatic.diagnosis.linear_problem import Problem, fitted_effects, pose_problem
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.undetected import (
    Column,
    Undetected,
    columns_of,
    derivatives,
    sizes_in_typical,
    typical_size,
)
from scara_kinetostatic.model.arrays import Floats, Indices
from scara_kinetostatic.model.cell import EffectSizes, SizeMode

_LARGEST_STEP = 1.5
"""Of log τ."""
_LARGEST_HALF_VARIANCE = 0.5
"""Of log τ: the mean of a size of which nothing is known is at most 1.65 times the common one."""
_ROUNDS, _STEPS = 6, 12
"""Of the noise levels, and of the sizes between them."""


class RandomEffects(NamedTuple):
    """The random effects of a fit.

    Attributes:
        columns: of all of them.
        matrix: X, whitened, in units of the typical sizes, (2n, k).
        typical: these sizes, (k,).
        group: number of the group of each column, (k,).
        names: of the groups: those of the effects.
        held: log τ of each column where it is declared, (k,); NaN where it is to be estimated.
    """

    columns: tuple[Column, ...]
    matrix: Floats
    typical: Floats
    group: Indices
    names: tuple[str, ...]
    held: Floats


def with_undetected(c: Calibration, known: Sequence[Effect]) -> Calibration:
    """A calibration with what undetected effects contribute to its uncertainty.

    Args:
        c: without; one that has them stays as it is.
        known: the catalogue.
    """
    if c.has_undetected:
        return c
    declared = c.cell.uncertainty.effects
    problem = pose_problem(c)
    random = _random_effects(problem, c, known, declared)
    if not random.columns:
        return c
    sizes = random.typical * np.exp(_log_sizes(problem, c, random))
    jacobian = problem.point.whitened.jacobian
    share = c.used.sum() / len(jacobian)  # of very many touches the problem has some
    fit = c.covariance_with_errors / c.enlargement
    moved = share * (fit @ jacobian.reshape(len(random.matrix), -1).T @ (random.matrix / random.typical)) * sizes
    return _contributed(c, random, sizes, moved[: len(c.covariance)])


def _random_effects(problem: Problem, c: Calibration, known: Sequence[Effect], declared: EffectSizes) -> RandomEffects:
    """All columns of the effects that are neither in the fit nor declared, those of the robot first."""
    fitted = {item.effect.label if len(item.values) else item.effect.name for item in fitted_effects(c)}
    at, found = problem.touch_state, list[tuple[Column, float, float]]()
    for effect in known:
        stated = declared.stated.get(effect.label, declared.stated.get(effect.name))
        absent = stated == 0.0 or (stated is None and declared.sizes is SizeMode.NONE)
        if absent or effect.label in fitted or effect.name in fitted or problem.is_declared(effect):
            continue
        columns = columns_of(effect, at)
        forms = max(len({column.values for column in columns}), 1)
        for column in columns:
            size = typical_size(effect, column.parameter, declared.arm)
            first = typical_size(effect, 0, declared.arm)  # others in proportion
            held = np.log(stated / first) if stated else 0.0 if declared.sizes is SizeMode.TYPICAL else np.nan
            found.append((column, size / forms**0.5, held))
    found.sort(key=lambda item: (not item[0].moves_robot, item[0].effect.force_dependence))
    columns, typical = [column for column, _, _ in found], np.array([size for _, size, _ in found])
    names = tuple(dict.fromkeys(column.effect.name for column in columns))
    errors = [_sensor_error(problem, column) for column in columns]
    matrix = problem.changes(derivatives(columns, at), errors) * typical
    group = np.array([names.index(column.effect.name) for column in columns], dtype=np.intp)
    return RandomEffects(tuple(columns), matrix, typical, group, names, np.array([held for _, _, held in found]))


def _sensor_error(problem: Problem, column: Column) -> Floats | None:
    errors = column.effect.sensor_error_derivative(problem.force, np.array(column.values), problem.touch_state.metadata)
    return errors[column.parameter] if errors else None


def _log_sizes(problem: Problem, c: Calibration, random: RandomEffects) -> Floats:
    """Log τ of each column, (k,), by restricted likelihood."""
    free = np.isnan(random.held)
    if not free.any():
        return random.held
    w, n = problem.point.whitened, len(problem.force)
    fitted = (w.derivative @ c.subspace.basis).reshape(2 * n, -1)
    known = [random.matrix[:, ~free] * np.exp(random.held[~free])]
    residual = w.residual.ravel()
    if w.by_errors is not None:
        errors = w.by_errors.reshape(2 * n, -1)
        known.append(errors)
        residual = residual - errors @ problem.point.errors
    known.append(random.matrix[:, free])
    columns, fixed = np.concatenate(known, axis=1), sum(part.shape[1] for part in known[:-1])
    names, group = np.unique(random.group[free], return_inverse=True)
    of_joints = whiten_matrix(outer(problem.point.linear.by_joints) * c.noise.joint_rms**2, w.root)
    levels, found, sizes_found = np.full(2, c.enlargement), np.zeros(len(names) + 1), _log_sizes_found(c)
    for _ in range(_ROUNDS if c.noise_source == 'estimated' else 1):
        inner = _Whitened.of(of_joints, levels, fitted, columns, residual)
        found, half_variance, weights = _scored(inner, fixed, group, sizes_found, found)
        before, levels = levels, _levels(inner, of_joints, levels, weights)
        if c.noise_source != 'estimated' or np.abs(np.log(levels / before)).max() < 0.05:
            break
    log_sizes = random.held.copy()
    log_sizes[free] = (found + np.minimum(half_variance, _LARGEST_HALF_VARIANCE))[:-1][group]
    return log_sizes


def _log_sizes_found(c: Calibration) -> Floats:
    """Log of the amplitudes of the effects that the fit has, in typical sizes, rms of each name."""
    found = dict[str, list[float]]()
    for effect, values, _ in fitted_effects(c):
        found.setdefault(effect.name, []).extend(sizes_in_typical(effect, values, c.cell.uncertainty.effects.arm))
    return np.array([0.5 * np.log(np.mean(np.square(sizes))) for sizes in found.values() if sizes])


class _Whitened(NamedTuple):
    """The problem in the metric of noise levels, projected off J.

    Attributes:
        inverse: L⁻¹ of each touch with L Lᵀ = V, (n, 2, 2).
        base: orthonormal basis of J, (2n, r).
        columns: (2n, k).
        residual: (2n,).
        gram: inner products of the columns, (k, k).
        projected: those with the residual, (k,).
    """

    inverse: Floats
    base: Floats
    columns: Floats
    residual: Floats
    gram: Floats
    projected: Floats

    @classmethod
    def of(cls, of_joints: Floats, levels: Floats, fitted: Floats, columns: Floats, residual: Floats) -> _Whitened:
        """At variances `levels` of joints and force, in those of the fit."""
        inverse = np.linalg.inv(np.linalg.cholesky(levels[0] * of_joints + levels[1] * (np.eye(2) - of_joints)))
        every = np.concatenate([fitted, columns, residual[:, None]], axis=1)
        every = (inverse @ every.reshape(len(inverse), 2, -1)).reshape(every.shape)
        base = np.linalg.qr(every[:, : fitted.shape[1]])[0]
        rest = every[:, fitted.shape[1] :]
        rest = rest - base @ (base.T @ rest)
        x, y = rest[:, :-1], rest[:, -1]
        return cls(inverse, base, x, y, x.T @ x, x.T @ y)


def _scored(
    inner: _Whitened, fixed: int, group: Indices, sizes_found: Floats, start: Floats
) -> tuple[Floats, Floats, Floats]:
    """Log sizes of the groups and the common one, (G + 1,), half of their variances, and τ of each column, (k,), at
    given noise levels.
    """
    count = len(start) - 1

    def weights_of(logs: Floats) -> Floats:
        return np.concatenate([np.ones(fixed), np.exp(logs[:-1][group])])

    def value(logs: Floats) -> tuple[float, Floats, Floats]:
        weights = weights_of(logs)
        matrix = np.eye(len(weights)) + weights[:, None] * inner.gram * weights
        factor = linalg.cholesky(matrix, lower=True, check_finite=False)
        inverse = linalg.lapack.dpotri(factor, lower=1)[0]
        inverse = inverse + np.tril(inverse, -1).T
        h = weights * inner.projected
        effects = inverse @ h
        off = np.concatenate([logs[:-1] - logs[-1], sizes_found - logs[-1], logs[-1:]])
        penalty = 2 * (np.log1p(np.exp(2 * off)) - off).sum()
        deviance = 2 * np.log(np.diag(factor)).sum() - h @ effects + penalty
        return float(deviance), np.eye(len(weights)) - inverse, effects

    logs, (lowest, part, effects) = start, value(start)
    for _ in range(_STEPS):
        steep = np.concatenate([logs[:-1] - logs[-1], sizes_found - logs[-1], logs[-1:]])
        share = 1 / (1 + np.exp(-2 * steep))
        slope, curve = 2 * (2 * share - 1), 8 * share * (1 - share)
        gradient = np.append(slope[:count], slope[-1] - slope[:-1].sum())
        hessian = np.diag(np.append(curve[:count], curve.sum()))
        hessian[-1, :-1] = hessian[:-1, -1] = -curve[:count]
        of_each = np.diag(part) - effects**2
        gradient[:-1] += 2 * np.bincount(group, of_each[fixed:], count)
        member = np.zeros((len(group), count))
        member[np.arange(len(group)), group] = 1.0
        hessian[:-1, :-1] += 4 * member.T @ np.square(part[fixed:, fixed:]) @ member
        step = -np.linalg.solve(hessian + 1e-3 * np.eye(count + 1), gradient)
        step *= min(1.0, _LARGEST_STEP / np.abs(step).max())
        for _ in range(5):
            tried = value(logs + step)
            if tried[0] <= lowest:
                break
            step = step / 3
        else:
            break
        decrease, logs, (lowest, part, effects) = lowest - tried[0], logs + step, tried
        if decrease < 0.01:
            break
    return logs, np.diag(np.linalg.inv(hessian)), weights_of(logs)


def _levels(inner: _Whitened, of_joints: Floats, levels: Floats, weights: Floats) -> Floats:
    """The noise variances after one step of expectation and maximisation at given sizes, (2,)."""
    n = len(of_joints)
    scaled = inner.columns * weights
    factor = linalg.cholesky(np.eye(len(weights)) + scaled.T @ scaled, lower=True, check_finite=False)
    rows = linalg.solve_triangular(factor, scaled.T, lower=True, check_finite=False).T
    rest = (inner.residual - rows @ (rows.T @ inner.residual)).reshape(n, 2)
    taken = np.concatenate([inner.base, rows], axis=1).reshape(n, 2, -1)
    kept = np.eye(2) - taken @ taken.swapaxes(1, 2)
    found = levels.copy()
    for k, part in enumerate((of_joints, np.eye(2) - of_joints)):
        whitened = levels[k] * inner.inverse @ part @ inner.inverse.swapaxes(1, 2)
        found[k] *= np.einsum('ni,nij,nj->', rest, whitened, rest) / np.einsum('nij,nji->', whitened, kept)
    return np.clip(found, 1e-3, 2.0)


def _contributed(c: Calibration, random: RandomEffects, sizes: Floats, moved: Floats) -> Calibration:
    """The calibration with the contributions of the groups, and the columns of the robot as values of their own.

    Args:
        c: without.
        random: the random effects.
        sizes: standard deviation of each column, (k,), in its unit.
        moved: change of all values of the model by one of these, (12 + k, k).
    """
    own, values = sum(column.moves_robot for column in random.columns), len(c.covariance)
    total = np.zeros((values + own, len(sizes)))
    total[:values] = moved
    total[values:, :own] = -np.diag(sizes[:own])
    parts = [part._replace(covariance=np.pad(part.covariance, (0, own))) for part in c.contributions]
    for number, name in enumerate(random.names):
        some = total[:, random.group == number]
        stated = c.cell.uncertainty.effects.stated.get(name)
        unit = next(column.effect.parameters[0].unit for column in random.columns if column.effect.name == name)
        parts.append(Contribution(f'{UNDETECTED}[{name}]', stated, unit if stated else '', some @ some.T))
    covariance = np.sum([part.covariance for part in parts], axis=0)
    std, before = np.sqrt(np.diag(covariance))[:values], np.concatenate([c.std, c.effect_std])
    std = np.where(before > 0, std, before)
    return replace(
        c,
        undetected=Undetected.of(c.cell, random.columns[:own]),
        covariance=covariance,
        contributions=tuple(parts),
        std=std[: len(c.std)],
        effect_std=std[len(c.std) :],
    )
