"""The noise levels estimated from the residuals: variance components by REML.

The covariance of a misclosure is V = Σ_l σ_l² V_l with known V_l: h_Q h_Qᵀ of the joints and h_F h_Fᵀ of the force,
or the parts of these that belong to one axis each, and ‖F‖² h_F h_Fᵀ of noise that grows with the force. Restricted
maximum likelihood finds the levels from the residuals of the fit, accounting for the parameters fitted.
One round solves

    Σ_l tr(P V_k P V_l) σ_l² = rᵀ V⁻¹ V_k V⁻¹ r,   P = V⁻¹ - V⁻¹ J C Jᵀ V⁻¹,

and rounds are repeated with the fit until it converges. Joints and force are well separated: along the
force both act, across it the force's noise alone.

Where one level of two axes is stated, it is taken as their root mean square: the component of the axes is then the
difference of their variances.

Source: Förstner's and Helmert's variance component estimation; Koch, Parameter
Estimation and Hypothesis Testing in Linear Models (1999), section 3.6.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.gauss_helmert import Linearisation, Whitened, outer
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.cell import Level, Noise

USUAL_NOISE = Noise(joint=1e-5, force=0.3)
"""Where the cell does not give it: the first guess of an estimation, and the noise of simulated touches."""
_LEAST_JOINT, _LEAST_FORCE = 1e-8, 1e-5
"""The least that a noise level is taken to be, rad and N: joint readings may repeat to the last bit, and below this
the weights would be those of rounding errors."""
_LEAST_RELATIVE = 1e-6
"""The same of the part that grows with the force."""
_LARGEST_DIFFERENCE = 0.98
"""Largest difference of the variances of two axes, as a part of their sum: a ratio of the levels of ten."""


def is_estimated(noise: Noise, stated: Noise | None) -> bool:
    """Whether any part of the noise is to be estimated.

    Args:
        noise: its components: one level of both axes or one of each, with a part that grows with the force or not.
        stated: what the cell description says; None for nothing.
    """
    if stated is None:
        return True
    by_axis = any(
        isinstance(now, tuple) and not isinstance(given, tuple)
        for now, given in ((noise.joint, stated.joint), (noise.force, stated.force))
    )
    return by_axis or (noise.force_relative is not None and stated.force_relative is None)


def as_stated(noise: Noise, stated: Noise | None) -> Noise:
    """A noise with all that the cell description states: one level of two axes is their root mean square."""
    if stated is None:
        return noise
    by_axis = noise.with_rms(_pair(stated.joint)[0], _pair(stated.force)[0])
    return Noise(
        stated.joint if isinstance(stated.joint, tuple) else by_axis.joint,
        stated.force if isinstance(stated.force, tuple) else by_axis.force,
        noise.force_relative if stated.force_relative is None else stated.force_relative,
    )


def estimate_noise(
    linear: Linearisation,
    whitened: Whitened,
    covariance: Floats,
    noise: Noise,
    stated: Noise | None = None,
    prior: Floats | None = None,
) -> Noise:
    """One round of REML at a fit.

    Args:
        linear: the equations of the used touches.
        whitened: the same, whitened with `noise`.
        covariance: C of the parameters in the scale of `whitened.jacobian`, (12 + k + m, 12 + k + m).
        noise: the levels so far; its components are those that are estimated.
        stated: what the cell description says of them, which is kept; None for nothing.
        prior: derivatives of what is known besides, with unit variances, (p, 12 + k + m); None for nothing.

    Returns:
        The levels that the residuals call for, each within a factor of 10 of before.
    """
    free, known = _components(linear, noise, stated)
    parts = [whiten_matrix(entries, whitened.root) for entries in (*(part.entries for part in free), *known)]
    r, jacobian, count = whitened.residual, whitened.jacobian, len(free)
    freedoms = _freedoms(whitened, covariance, prior is not None)
    factor = float(np.sqrt(float((r**2).sum()) / max(freedoms, 1)))
    same_ratio = noise if stated else _bounded(noise, noise.scaled(factor))
    # the ratio of the levels is kept, and only their size estimated
    if freedoms < 10:
        return same_ratio
    weighted = [np.einsum('nij,njk->nik', part, jacobian) for part in parts]
    normals = [np.einsum('nik,nil->kl', jacobian, w) @ covariance for w in weighted]
    matrix, vector = np.empty((count, len(parts))), np.empty(count)
    for k in range(count):
        vector[k] = np.einsum('ni,nij,nj->', r, parts[k], r)
        for j in range(len(parts)):
            crossed = np.einsum('nik,nil->kl', weighted[k], weighted[j]) @ covariance
            matrix[k, j] = (
                np.einsum('nij,nij->', parts[k], parts[j]) - 2 * np.trace(crossed) + np.trace(normals[k] @ normals[j])
            )
    matrix, vector = matrix[:, :count], vector - matrix[:, count:].sum(axis=1)
    if prior is not None:  # the errors that it bounds are of known size
        vector -= [np.trace(normal @ prior.T @ prior @ covariance) for normal in normals[:count]]
    scale = np.array([part.scale for part in free])
    if np.linalg.eigvalsh(matrix * np.outer(scale, scale)).min() <= 0:  # some act alike: no telling them apart
        return same_ratio
    signed = np.array([part.is_difference for part in free])
    return _bounded(noise, _with_variances(noise, free, _distinguishable(matrix, vector, signed)))


def _freedoms(whitened: Whitened, covariance: Floats, has_prior: bool) -> float:
    """Expected sum of the squared residuals of the touches: 2n less the number of parameters fitted, and less only a
    part of that where more is known of them than the touches say: tr(I - J C Jᵀ).
    """
    if not has_prior:
        return whitened.residual.size - int(np.linalg.matrix_rank(covariance))
    jacobian = whitened.jacobian.reshape(whitened.residual.size, -1)
    return whitened.residual.size - float(np.einsum('ik,kl,il->', jacobian, covariance, jacobian, optimize=True))


class _Component(NamedTuple):
    """A variance that is estimated.

    Attributes:
        key: the level that it belongs to, ``joint``, ``force`` or ``force_relative``.
        entries: V_l of each touch: the entries 11, 21, 22, (n, 3).
        scale: its size so far.
        is_difference: whether it is half the difference of the variances of two axes whose sum is known.
    """

    key: str
    entries: Floats
    scale: float
    is_difference: bool = False


def _components(linear: Linearisation, noise: Noise, stated: Noise | None) -> tuple[list[_Component], list[Floats]]:
    """The parts of V: those to be estimated, and the known ones with their size."""
    free, known = list[_Component](), list[Floats]()
    for key in ('joint', 'force'):
        level: Level = getattr(noise, key)
        given: Level | None = None if stated is None else getattr(stated, key)
        axes = by_axis(linear, key) if isinstance(level, tuple) else None
        together = outer(linear.by_joints if key == 'joint' else linear.by_force)
        if axes is None:
            assert not isinstance(level, tuple)
            free += [_Component(key, together, level**2)] if given is None else []
            known += [level**2 * together] if given is not None else []
        elif given is None:
            free += [_Component(key, axis, one**2) for axis, one in zip(axes, _pair(level), strict=True)]
        elif isinstance(given, tuple):
            known += [one**2 * axis for axis, one in zip(axes, given, strict=True)]
        else:
            free.append(_Component(key, axes[0] - axes[1], given**2, is_difference=True))
            known.append(given**2 * together)
    if noise.force_relative is not None:
        entries = growing(linear)
        if stated is None or stated.force_relative is None:
            free.append(_Component('force_relative', entries, max(noise.force_relative, _LEAST_RELATIVE) ** 2))
        else:
            known.append(noise.force_relative**2 * entries)
    if linear.by_off_normal is not None:
        known.append(outer(linear.by_off_normal[:, :, None]))
    return free, known


def by_axis(linear: Linearisation, key: str) -> tuple[Floats, Floats]:
    """V_l of each joint, or of each axis of the force, of unit variance, (n, 3) each."""
    if key == 'joint':
        return outer(linear.by_joints[:, :, :1]), outer(linear.by_joints[:, :, 1:])
    unit = linear.force / np.hypot(linear.force[:, 0], linear.force[:, 1])[:, None]
    x, y = unit[:, :1], unit[:, 1:]
    along, across = linear.by_force[:, :, 0], linear.by_force[:, :, 1]
    return outer((along * x - across * y)[:, :, None]), outer((along * y + across * x)[:, :, None])


def growing(linear: Linearisation) -> Floats:
    """V_l of noise as large as the force, (n, 3)."""
    square = (linear.force**2).sum(axis=1)
    return outer(linear.by_force) * square[:, None]


def _with_variances(noise: Noise, components: list[_Component], variances: Floats) -> Noise:
    """The noise with the variances of its components; two of one key are those of its axes."""
    found: dict[str, list[float]] = {}
    for part, variance in zip(components, variances.tolist(), strict=True):
        if part.is_difference:
            half = float(np.clip(variance, -_LARGEST_DIFFERENCE * part.scale, _LARGEST_DIFFERENCE * part.scale))
            found[part.key] = [part.scale + half, part.scale - half]
        else:
            found.setdefault(part.key, []).append(variance)
    levels = {key: np.sqrt(values).tolist() for key, values in found.items()}
    return Noise(
        _level(levels['joint']) if 'joint' in levels else noise.joint,
        _level(levels['force']) if 'force' in levels else noise.force,
        levels['force_relative'][0] if 'force_relative' in levels else noise.force_relative,
    )


def _level(axes: list[float]) -> Level:
    return axes[0] if len(axes) == 1 else (axes[0], axes[1])


def _distinguishable(matrix: Floats, vector: Floats, signed: Mask) -> Floats:
    """Solve for variances, none smaller than what the residuals could distinguish from zero.

    An estimate at or below zero says that a noise does not show, not that there is none: a weight
    without bound would make sigmas too small. Such a variance is set to half of its own
    standard deviation, and the others are solved for. A difference of two variances may have either sign.
    """
    solution = np.asarray(np.linalg.solve(matrix, vector), dtype=float)
    least = 0.5 * np.sqrt(2 * np.diag(np.linalg.inv(matrix)))
    others: Mask = np.ones(len(solution), dtype=bool)
    while np.any(too_small := others & ~signed & (solution < least)):
        hidden = int(np.argmin(np.where(too_small, solution / least, np.inf)))
        others[hidden], solution[hidden] = False, least[hidden]
        if others.any():
            rest = vector[others] - matrix[np.ix_(others, ~others)] @ solution[~others]
            solution[others] = np.linalg.solve(matrix[np.ix_(others, others)], rest)
    return solution


def _bounded(old: Noise, new: Noise) -> Noise:
    """The new levels, each within a factor of the old one and not below the least."""
    grown = new.force_relative
    if grown is not None:
        grown = _within(old.growth, grown, _LEAST_RELATIVE)
    joint = _levels_within(old.joint, new.joint, _LEAST_JOINT)
    return Noise(joint, _levels_within(old.force, new.force, _LEAST_FORCE), grown)


def _levels_within(old: Level, new: Level, floor: float) -> Level:
    if not isinstance(new, tuple):
        return _within(_pair(old)[0], new, floor)
    first, second = (_within(before, after, floor) for before, after in zip(_pair(old), new, strict=True))
    return first, second


def _within(before: float, after: float, floor: float) -> float:
    return max(floor, min(max(after, before / 10.0), before * 10.0))


def _pair(level: Level) -> tuple[float, float]:
    return level if isinstance(level, tuple) else (level, level)


def whiten_matrix(entries: Floats, root: tuple[Floats, Floats, Floats]) -> Floats:
    """L⁻¹ V L⁻ᵀ for symmetric (n, 3) entries 11, 21, 22, as (n, 2, 2)."""
    l11, l21, l22 = root
    v11, v21, v22 = np.moveaxis(entries, -1, 0)
    a11 = v11 / l11**2
    a21 = (v21 - l21 * v11 / l11) / (l11 * l22)
    a22 = (v22 - 2 * l21 * v21 / l11 + (l21 / l11) ** 2 * v11) / l22**2
    return np.stack([np.stack([a11, a21], axis=-1), np.stack([a21, a22], axis=-1)], axis=-2)
