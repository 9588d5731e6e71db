"""The linearised adjustment in units of standard deviations: V of each touch's misclosure and its root."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import ForceCovariance, Noise, force_covariance


class Linearisation(NamedTuple):
    """The adjustment's equations at a point; before whitening.

    Attributes:
        misclosure: w, (n, 2), m, along and across the force.
        derivative: h_L̄, (n, 2, 12 + k), in the order of `ExtendedModel.names`.
        by_joints: h_Q, (n, 2, 2), m/rad.
        by_force: h_F in radial and tangential components of F̂, (n, 2, 2), m/N.
        force: F̂ in the sensor's frame, (n, 2), N.
        by_off_normal: h_α times the standard deviation of the off-normal angle, (n, 2), m; None without.
        by_errors: h_e by the declared errors of the cell, (n, 2, m), m; None without.
    """

    misclosure: Floats
    derivative: Floats
    by_joints: Floats
    by_force: Floats
    force: Floats
    by_off_normal: Floats | None = None
    by_errors: Floats | None = None


class Whitened(NamedTuple):
    """The same in units of standard deviations.

    Attributes:
        residual: (n, 2).
        derivative: (n, 2, 12 + k).
        root: lower Cholesky factor of V, as (l11, l21, l22), (n,) each.
        by_errors: (n, 2, m); None without declared errors.
    """

    residual: Floats
    derivative: Floats
    root: tuple[Floats, Floats, Floats]
    by_errors: Floats | None = None

    @property
    def jacobian(self) -> Floats:
        """The derivatives by all values of the model and the declared errors, (n, 2, 12 + k + m)."""
        if self.by_errors is None:
            return self.derivative
        n, _, k = self.derivative.shape
        both = by_touch(k + self.by_errors.shape[2], 2, n)
        both[:, :, :k], both[:, :, k:] = self.derivative, self.by_errors
        return both


def by_touch(*shape: int) -> Floats:
    """A new array whose first axis is the last of `shape`: one value of all touches lies in one piece of memory."""
    return np.empty(shape).transpose()


def _covariance_of(linear: Linearisation, noise: Noise) -> tuple[Floats, Floats, Floats]:
    """V of each touch's misclosure: the entries 11, 21, 22, (n,) each, m²."""
    v11, v21, v22 = _plain_covariance(linear, noise) if noise.is_plain else _covariance_by_axis(linear, noise)
    if linear.by_off_normal is None:
        return v11, v21, v22
    off_normal1, off_normal2 = linear.by_off_normal[:, 0], linear.by_off_normal[:, 1]
    return v11 + off_normal1 * off_normal1, v21 + off_normal1 * off_normal2, v22 + off_normal2 * off_normal2


def _plain_covariance(linear: Linearisation, noise: Noise) -> tuple[Floats, Floats, Floats]:
    """σ_q² h_Q h_Qᵀ + σ_f² h_F h_Fᵀ."""
    q, f = noise.joint_rms**2, noise.force_rms**2
    joints, force = _products(linear.by_joints), _products(linear.by_force)
    v11, v21, v22 = (q * a + f * b for a, b in zip(joints, force, strict=True))
    return v11, v21, v22


def _covariance_by_axis(linear: Linearisation, noise: Noise) -> tuple[Floats, Floats, Floats]:
    """h_Q diag(σ_1², σ_2²) h_Qᵀ + h_F Σ_F h_Fᵀ with Σ_F of `force_covariance`."""
    joints = _products(linear.by_joints * noise.joint_levels)
    force = _in_between(linear.by_force, force_covariance(noise, linear.force))
    v11, v21, v22 = (a + b for a, b in zip(joints, force, strict=True))
    return v11, v21, v22


def _in_between(matrices: Floats, covariance: ForceCovariance) -> tuple[Floats, Floats, Floats]:
    """B Σ Bᵀ of (n, 2, 2) matrices: the entries 11, 21, 22, (n,) each."""
    b11, b12, b21, b22 = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1]
    along, crossed, across = covariance
    first1, first2 = b11 * along + b12 * crossed, b11 * crossed + b12 * across
    second1, second2 = b21 * along + b22 * crossed, b21 * crossed + b22 * across
    return first1 * b11 + first2 * b12, second1 * b11 + second2 * b12, second1 * b21 + second2 * b22


def _products(matrices: Floats) -> tuple[Floats, Floats, Floats]:
    """B Bᵀ of (n, 2, 2) matrices: the entries 11, 21, 22, (n,) each."""
    b11, b12, b21, b22 = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1]
    return b11 * b11 + b12 * b12, b11 * b21 + b12 * b22, b21 * b21 + b22 * b22


def outer(matrices: Floats) -> Floats:
    """B Bᵀ of (n, 2, k) matrices, (n, 3): the entries 11, 21, 22."""
    first, second = matrices[:, 0], matrices[:, 1]
    return np.stack([(first * first).sum(-1), (first * second).sum(-1), (second * second).sum(-1)], axis=-1)


def whiten(linear: Linearisation, noise: Noise, extra: Floats | float = 0.0) -> Whitened:
    """Divide by the Cholesky root of V, touch by touch; `extra` is added to V11."""
    v11, v21, v22 = _covariance_of(linear, noise)
    l11 = np.sqrt(v11 + extra)
    l21 = v21 / l11
    l22 = np.sqrt(np.maximum(v22 - l21 * l21, 1e-12 * v22))
    root = (l11, l21, l22)
    by_errors = None if linear.by_errors is None else whiten_by(linear.by_errors, root)
    return Whitened(whiten_by(linear.misclosure, root), whiten_by(linear.derivative, root), root, by_errors)


def whiten_by(array: Floats, root: tuple[Floats, Floats, Floats]) -> Floats:
    """L⁻¹ applied to arrays (n, 2) or (n, 2, k), touch by touch."""
    l11, l21, l22 = root
    columns = array.transpose()  # the touches last
    out = np.empty(columns.shape)
    first, second = out[..., 0, :], out[..., 1, :]
    np.divide(columns[..., 0, :], l11, out=first)
    np.multiply(first, -l21, out=second)
    second += columns[..., 1, :]
    second /= l22
    return out.transpose()


def noise_left(linear: Linearisation, root: tuple[Floats, Floats, Floats], noise: Noise, side: int) -> Floats:
    """Standard deviation of the noise that remains in the adjusted force, (n,), N.

    Args:
        linear: the linearisation.
        root: of V there.
        noise: of a touch.
        side: 0 along the force, 1 across it.
    """
    l11, l21, l22 = root
    if noise.is_plain:
        sigma = noise.force_rms
        first = linear.by_force[:, 0, side] / l11
        second = (linear.by_force[:, 1, side] - l21 * first) / l22
        return np.asarray(sigma * np.sqrt(np.clip(1 - sigma**2 * (first**2 + second**2), 0.0, 1.0)))
    covariance = force_covariance(noise, linear.force)
    along, across = covariance.side(side)
    moved = linear.by_force[:, :, 0] * along[:, None] + linear.by_force[:, :, 1] * across[:, None]
    first = moved[:, 0] / l11
    second = (moved[:, 1] - l21 * first) / l22
    before = covariance.along if side == 0 else covariance.across
    return np.asarray(np.sqrt(np.clip(before - first**2 - second**2, 0.0, before)))


def squared_distance(whitened: Whitened) -> Floats:
    """Squared Mahalanobis distance of each touch, (n,); chi-square of 2 degrees where all is well."""
    first, second = whitened.residual[:, 0], whitened.residual[:, 1]
    return np.asarray(first * first + second * second)
