"""Uncertainty of H̄ and Ḡ (GUM, JCGM 100, 5.2): that of the calibration, and that of the place in a dead band.

With the rows of law (6) R(Q*; L̄) = 0, M = ∂R/∂Q* and J at the link angles, a change of the values at fixed Q and F
moves the tip by

    ∂S/∂L̄ = ∂H/∂L̄ - G ∂R/∂L̄,    G = J M⁻¹ = ∂S/∂Q,

column by column: I for x0 and y0, G_i for theta_i, the unit vector of the link and what it adds to the torques for l_i,
-G_i c_i for p_i, -G_i s_i for g_i, ∓F for p_ee, -s n for g_ee; an effect with the shift δ and d adds d - G δ. At fixed
S and F, ∂Q/∂L̄ = -G⁻¹ ∂S/∂L̄. What an effect changes in its own shift is of second order and left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.compensation.equilibrium import Equilibrium, inverse_of_rows
from scara_kinetostatic.compensation.loading import Force, Law, faded
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import Shift
from scara_kinetostatic.model.parameters import (
    G1,
    G2,
    G_EE,
    L1,
    L2,
    NAMES,
    P1,
    P2,
    P_EE,
    THETA1,
    THETA2,
    X0,
    Y0,
    Parameters,
)

DEPENDS = 1.0
"""A change of the tip by the plausible range of an undetermined direction that counts, in standard uncertainties."""


class Jacobian(NamedTuple):
    """G = ∂S/∂Q at fixed F, by rows, (n,) each, m/rad."""

    xx: Floats
    xy: Floats
    yx: Floats
    yy: Floats

    @classmethod
    def at(cls, found: Equilibrium, force: Force) -> Jacobian:
        """That of poses."""
        a = found.loading
        i11, i12, i21, i22 = inverse_of_rows(a, force)
        j1x, j1y = -(a.y1 + a.y2), a.x1 + a.x2
        return cls(j1x * i11 - a.y2 * i21, j1x * i12 - a.y2 * i22, j1y * i11 + a.x2 * i21, j1y * i12 + a.x2 * i22)

    def inverse(self) -> Jacobian:
        """G⁻¹; not finite where the arm is stretched or folded."""
        with np.errstate(divide='ignore', invalid='ignore'):
            scale = 1.0 / (self.xx * self.yy - self.xy * self.yx)
            return Jacobian(self.yy * scale, -self.xy * scale, -self.yx * scale, self.xx * scale)

    def times(self, vectors: Floats) -> tuple[Floats, Floats]:
        """G times vectors (n, 2): the components."""
        return (
            self.xx * vectors[:, 0] + self.xy * vectors[:, 1],
            self.yx * vectors[:, 0] + self.yy * vectors[:, 1],
        )


class Symmetric(NamedTuple):
    """A symmetric 2×2 matrix for each of n poses; its entries xx, yy and xy, (n,) each."""

    xx: Floats
    yy: Floats
    xy: Floats

    def plus(self, other: Symmetric) -> Symmetric:
        """The sum."""
        return Symmetric(*(one + two for one, two in zip(self, other, strict=True)))

    def mapped(self, by: Jacobian) -> Symmetric:
        """B Σ Bᵀ."""
        a, b = by.xx * self.xx + by.xy * self.xy, by.xx * self.xy + by.xy * self.yy
        c, d = by.yx * self.xx + by.yy * self.xy, by.yx * self.xy + by.yy * self.yy
        return Symmetric(a * by.xx + b * by.xy, c * by.yx + d * by.yy, a * by.yx + b * by.yy)

    def variance_along(self, x: Floats, y: Floats) -> Floats:
        """nᵀ Σ n for unit vectors."""
        return np.asarray(self.xx * x * x + self.yy * y * y + 2 * self.xy * x * y)

    @property
    def largest(self) -> Floats:
        """Variance in the worst direction, (n,)."""
        return np.asarray((self.xx + self.yy) / 2 + np.hypot((self.xx - self.yy) / 2, self.xy))

    @property
    def matrices(self) -> Floats:
        """(n, 2, 2)."""
        return np.array([[self.xx, self.xy], [self.xy, self.yy]]).transpose(2, 0, 1)


class Squares(NamedTuple):
    """Squares of the half gaps of the joints, rad², and of the gripper, m²."""

    joint1: float
    joint2: float
    gripper: float


class Spread(NamedTuple):
    """The covariance of the values of a model, made ready.

    Attributes:
        factor: B with B Bᵀ = Σ, (12 + k, r).
        undetermined: directions that the touches do not determine, (12 + k, u).
    """

    factor: Floats
    undetermined: Floats

    def gaps(self, parameters: Parameters) -> Squares:
        """Expectations E[g²] = g² + var(g) of the backlashes."""
        g = parameters
        v1, v2, own = (float(self.factor[k] @ self.factor[k]) for k in (G1, G2, G_EE))
        return Squares(g.g1**2 + v1, g.g2**2 + v2, g.g_ee**2 + own)

    @property
    def undetermined_gaps(self) -> Squares:
        """Squares of the plausible ranges of the backlashes along what is undetermined."""
        return Squares(*(float(self.undetermined[k] @ self.undetermined[k]) for k in (G1, G2, G_EE)))

    @classmethod
    def of(cls, covariance: Floats, undetermined: Floats) -> Spread:
        """That of a covariance, (12 + k, 12 + k)."""
        std = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
        scale = np.where(std > 0, std, 1.0)
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        kept = values > 0
        return cls(scale[:, None] * vectors[:, kept] * np.sqrt(values[kept]), undetermined)

    def tip(self, derivative: Floats) -> Symmetric:
        """J Σ Jᵀ for derivatives (12 + k, 2, n), m²; NaN where the tip depends on what is undetermined."""
        k, _, n = derivative.shape
        x, y = (self.factor.T @ derivative.reshape(k, 2 * n)).reshape(-1, 2, n).transpose(1, 0, 2)
        xx, yy, xy = (np.einsum('rn,rn->n', one, two) for one, two in ((x, x), (y, y), (x, y)))
        if self.undetermined.shape[1]:
            free = (self.undetermined.T @ derivative.reshape(k, 2 * n)).reshape(-1, n)
            unknown = np.einsum('rn,rn->n', free, free) > DEPENDS**2 * (xx + yy)
            xx, yy, xy = (np.where(unknown, np.nan, part) for part in (xx, yy, xy))
        return Symmetric(xx, yy, xy)


def tip_derivative(law: Law, found: Equilibrium, force: Force, jacobian: Jacobian) -> Floats:
    """∂S/∂(values of the model) at fixed Q and F, (12 + k, 2, n)."""
    p, a, g = law.model.parameters, found.loading, jacobian
    out = np.zeros((len(law.model.names), 2, len(force.x)))
    out[X0, 0] = out[Y0, 1] = 1.0
    out[THETA1], out[THETA2] = (g.xx, g.yx), (g.xy, g.yy)
    u1x, u1y, u2x, u2y = a.x1 / p.l1, a.y1 / p.l1, a.x2 / p.l2, a.y2 / p.l2
    by_l1 = a.k1 * (u1x * force.y - u1y * force.x)
    out[L1] = u1x - g.xx * by_l1, u1y - g.yx * by_l1
    moment = u2x * force.y - u2y * force.x
    w1, w2 = a.k1 * moment, a.k2 * moment
    out[L2] = u2x - g.xx * w1 - g.xy * w2, u2y - g.yx * w1 - g.yy * w2
    out[P1], out[P2] = (-g.xx * a.c1, -g.yx * a.c1), (-g.xy * a.c2, -g.yy * a.c2)
    out[G1], out[G2] = (-g.xx * a.s1, -g.yx * a.s1), (-g.xy * a.s2, -g.yy * a.s2)
    out[P_EE] = law.gripper.factor * force.x, law.gripper.factor * force.y
    out[G_EE] = -force.place * force.nx, -force.place * force.ny
    if found.state is not None:
        _add_effects(out, law, found, force, jacobian)
    return out


def _add_effects(out: Floats, law: Law, found: Equilibrium, force: Force, jacobian: Jacobian) -> None:
    """The rows of the effects' values, and what those of L̄ change in the effects."""
    assert found.state is not None
    row = len(NAMES)
    for effect, values in zip(law.model.effects, law.model.effect_arrays, strict=True):
        for part in effect.derivative(found.state, values):
            shift = faded(part, effect.force_dependence, force.place)
            _add(out[row], shift._replace(place=None) if effect.on_object else shift, jacobian)
            row += 1
    for name, shift in law.model.shift_by_robot(found.state).items():
        _add(out[NAMES.index(name)], shift, jacobian)


def _add(row: Floats, shift: Shift, jacobian: Jacobian) -> None:
    """Add d - G δ to a row (2, n)."""
    if shift.place is not None:
        row += shift.place.T
    if shift.joints is not None:
        row -= jacobian.times(shift.joints)


def band_covariance(gaps: Squares, found: Equilibrium, force: Force, jacobian: Jacobian) -> Symmetric:
    """Covariance of the tip by the unknown places in the dead bands, m²: E[g²] / 3 (1 - s²) of each.

    Args:
        gaps: of the backlashes.
        found: the poses.
        force: on the object there.
        jacobian: G there.
    """
    a, g = found.loading, jacobian
    v1, v2 = gaps.joint1 / 3 * (1 - a.s1**2), gaps.joint2 / 3 * (1 - a.s2**2)
    own = gaps.gripper / 3 * (1 - force.place**2)
    return Symmetric(
        g.xx**2 * v1 + g.xy**2 * v2 + own,
        g.yx**2 * v1 + g.yy**2 * v2 + own,
        g.xx * g.yx * v1 + g.xy * g.yy * v2,
    )


def with_dead_bands(by_model: Symmetric, spread: Spread, law: Law, found: Equilibrium, force: Force) -> Symmetric:
    """Covariance of the tip by the values of the model and the unknown places in the dead bands, m².

    NaN where such a place counts whose backlash the touches do not determine.

    Args:
        by_model: by the values alone, J Σ Jᵀ.
        spread: of the values.
        law: of the arm.
        found: the poses.
        force: on the object there.
    """
    jacobian = Jacobian.at(found, force)
    total = by_model.plus(band_covariance(spread.gaps(law.model.parameters), found, force, jacobian))
    if not spread.undetermined.shape[1]:
        return total
    free = band_covariance(spread.undetermined_gaps, found, force, jacobian)
    unknown = free.xx + free.yy > DEPENDS**2 * (total.xx + total.yy)
    return Symmetric(*(np.where(unknown, np.nan, part) for part in total))


def by_force(law: Law, found: Equilibrium, force: Force, jacobian: Jacobian) -> Jacobian:
    """∂S/∂F at fixed Q = ∓p_ee I - g_ee s / f (I - n nᵀ) - G diag(k) Jᵀ, m/N."""
    p, a, g = law.model.parameters, found.loading, jacobian
    along = law.gripper.factor * p.p_ee
    aside = p.g_ee * force.place / np.where(force.size > 0, force.size, 1.0)
    j1x, j1y = -(a.y1 + a.y2), a.x1 + a.x2
    xx = along - aside * force.ny**2 - (g.xx * a.k1 * j1x - g.xy * a.k2 * a.y2)
    xy = aside * force.nx * force.ny - (g.xx * a.k1 * j1y + g.xy * a.k2 * a.x2)
    yx = aside * force.nx * force.ny - (g.yx * a.k1 * j1x - g.yy * a.k2 * a.y2)
    yy = along - aside * force.nx**2 - (g.yx * a.k1 * j1y + g.yy * a.k2 * a.x2)
    return Jacobian(xx, xy, yx, yy)


def by_noise(law: Law, found: Equilibrium, force: Force, jacobian: Jacobian) -> Floats:
    """Change of the tip by one standard deviation of the noise of q1, q2, F_x and F_y, (n, 2, 4), m."""
    f, (q1, q2) = by_force(law, found, force, jacobian), law.noise.joint_levels
    x = (jacobian.xx * q1, jacobian.xy * q2, f.xx * force.std, f.xy * force.std)
    y = (jacobian.yx * q1, jacobian.yy * q2, f.yx * force.std, f.yy * force.std)
    return np.stack([np.stack(x, axis=-1), np.stack(y, axis=-1)], axis=1)


def measurement_covariance(law: Law, found: Equilibrium, force: Force, jacobian: Jacobian) -> Symmetric:
    """Covariance of the tip by the noise of one measurement of Q and F, m²."""
    g, (q1, q2) = jacobian, (std**2 for std in law.noise.joint_levels)
    by_joints = Symmetric(g.xx**2 * q1 + g.xy**2 * q2, g.yx**2 * q1 + g.yy**2 * q2, g.xx * g.yx * q1 + g.xy * g.yy * q2)
    variance = force.std**2
    isotropic = Symmetric(variance, variance, np.zeros_like(variance))
    return by_joints.plus(isotropic.mapped(by_force(law, found, force, jacobian)))
