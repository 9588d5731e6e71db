"""The tip under load, H̄, and the joint angles that compensate it, Ḡ, of poses with a given force; with derivatives.

- H̄: Q and F are given; Q* solves q* + p c + g s(c / b) + δ = q by Newton's method.
- Ḡ: S and F are given; Q* is the rigid inverse of S less what gripper and effects add: in closed form, or with effects
  by fixed-point iteration.

**Dead band.** sign(c) in (6) is set-valued at c = 0, and with a force that is known to σ_F only, the sign of a small
torque is not known. Here

    q - q* = p c + g s(c / b) + δ,    s(u) = max(-1, min(u, 1)),

with the band b_i = 3 σ_F ‖J_i‖ + 4 |g_i| f (l1 + l2): the law is (6) wherever the torque exceeds three standard
deviations, and a straight line across the dead band between. So the joint angles are a continuous function of place
and force, the middle of the dead band at c = 0, and they do not jump. The second part of b keeps 1 + (g/b) ∂c/∂q* at
3/4 or more, also where a link is pressed along itself: the equations have one solution, so H̄ and Ḡ are each other's
inverse inside the band, too. The gripper alike: -g_ee s(f / 3 σ_F) n.

What is left out inside the band, the sign, is part of the uncertainty: the variance g²/3 (1 - s²), that of a uniform
distribution over the dead band at its middle, nothing at its edge.

**Uncertainty** (GUM, JCGM 100, 5.2): that of the calibration, and that of the place in a dead band. With the rows of
law (6) R(Q*; L̄) = 0, M = ∂R/∂Q* and J at the link angles, a change of the values at fixed Q and F moves the tip by

    ∂S/∂L̄ = ∂H/∂L̄ - G ∂R/∂L̄,    G = J M⁻¹ = ∂S/∂Q,

column by column: I for x0 and y0, G_i for theta_i, the unit vector of the link and what it adds to the torques for l_i,
-G_i c_i for p_i, -G_i s_i for g_i, ∓F for p_ee, -s n for g_ee; an effect with the shift δ and d adds d - G δ. At fixed
S and F, ∂Q/∂L̄ = -G⁻¹ ∂S/∂L̄. What an effect changes in its own shift is of second order and left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.kinematics import inverse
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

SIGN_KNOWN = 3.0
"""Standard deviations from zero at which the sign of a torque, or the direction of a force, is known."""
STEEPEST = 4.0
"""The band is so many times as wide as what the backlash itself can turn the lever arm."""
_DISC_RADIUS = 0.1
"""Radius of the disc that effects are given as the touched one, m; the tip touches it along the force."""


class Force(NamedTuple):
    """Forces on the object; all (n,).

    Attributes:
        x: F along x, N.
        y: along y, N.
        size: ‖F‖, N.
        nx: direction n along x; 1 where there is no force.
        ny: along y.
        place: s(f / 3 σ_F), place in the dead band of the gripper, 0 to 1.
        std: standard deviation of a component, N.
    """

    x: Floats
    y: Floats
    size: Floats
    nx: Floats
    ny: Floats
    place: Floats
    std: Floats

    @classmethod
    def of(cls, force: Floats, noise: Noise) -> Force:
        """Forces (n, 2), N, that are known as well as those of one touch."""
        x, y = np.ascontiguousarray(force.T)
        size = np.hypot(x, y)
        some = np.where(size > 0, size, 1.0)
        std = np.hypot(noise.force_rms, noise.growth * size)
        return cls(
            x, y, size, np.where(size > 0, x / some, 1.0), y / some, np.minimum(size / (SIGN_KNOWN * std), 1.0), std
        )


class Loading(NamedTuple):
    """The arm at given link angles under a force; all (n,).

    Attributes:
        x1: link 1 along x, m.
        y1: along y.
        x2: link 2 along x, m.
        y2: along y.
        offset_x: S - H(Q*) by the gripper, m.
        offset_y: along y.
        c1: torque of joint 1, Nm.
        c2: of joint 2.
        s1: place of joint 1 in its dead band, -1 to 1.
        s2: of joint 2.
        k1: dq1*-slope of the law, p1 + g1 s'/b1, rad/Nm.
        k2: of joint 2.
    """

    x1: Floats
    y1: Floats
    x2: Floats
    y2: Floats
    offset_x: Floats
    offset_y: Floats
    c1: Floats
    c2: Floats
    s1: Floats
    s2: Floats
    k1: Floats
    k2: Floats

    @property
    def in_band(self) -> Mask:
        """Whether a joint is inside its dead band."""
        return np.asarray((np.abs(self.s1) < 1) | (np.abs(self.s2) < 1))


@dataclass(frozen=True)
class Law:
    """The law of an arm.

    Attributes:
        model: the model, with the effects that are part of H̄ and Ḡ.
        gripper: the form of (7).
        noise: of one touch.
    """

    model: ExtendedModel
    gripper: Gripper
    noise: Noise

    def loading(self, first: Floats, second: Floats, force: Force) -> Loading:
        """The arm with its links at absolute angles `first` and `second`, (n,), rad."""
        p = self.model.parameters
        x1, y1, x2, y2 = p.l1 * np.cos(first), p.l1 * np.sin(first), p.l2 * np.cos(second), p.l2 * np.sin(second)
        along = self.gripper.slope(p) * force.size - p.g_ee * force.place
        offset_x, offset_y, moment = along * force.nx, along * force.ny, np.zeros(1)
        skew = self.gripper.skew(np.arctan2(force.ny, force.nx) - second)
        if skew is not None:  # the force then acts beside the rigid tip, and turns both joints
            normal, tangent = force.size * skew.normal, force.size * skew.tangent
            offset_x = offset_x + normal * force.nx - tangent * force.ny
            offset_y = offset_y + normal * force.ny + tangent * force.nx
            moment = -tangent * force.size
        c2 = x2 * force.y - y2 * force.x + moment
        c1 = x1 * force.y - y1 * force.x + c2
        own = STEEPEST * (p.l1 + p.l2) * force.size
        known = SIGN_KNOWN * force.std
        b1, b2 = known * np.hypot(x1 + x2, y1 + y2) + abs(p.g1) * own, known * p.l2 + abs(p.g2) * own
        u1, u2 = c1 / b1, c2 / b2
        k1, k2 = p.p1 + np.where(np.abs(u1) < 1, p.g1 / b1, 0.0), p.p2 + np.where(np.abs(u2) < 1, p.g2 / b2, 0.0)
        s1, s2 = np.clip(u1, -1.0, 1.0), np.clip(u2, -1.0, 1.0)
        return Loading(x1, y1, x2, y2, offset_x, offset_y, c1, c2, s1, s2, k1, k2)

    def touch_state(self, joints: Floats, at: Loading, force: Force, metadata: TouchMetadata) -> TouchState:
        """The poses as effects take them; `joints` is Q, (n, 2), rad."""
        p = self.model.parameters
        normal = np.array([force.nx, force.ny]).T
        tip = np.array([p.x0 + at.x1 + at.x2 + at.offset_x, p.y0 + at.y1 + at.y2 + at.offset_y]).T
        return TouchState(
            parameters=p,
            joints=joints,
            force=np.array([force.x, force.y]).T,
            magnitude=force.size,
            normal=normal,
            torques=np.array([at.c1, at.c2]).T,
            link1=np.array([at.x1, at.y1]).T / p.l1,
            link2=np.array([at.x2, at.y2]).T / p.l2,
            centers=tip + _DISC_RADIUS * normal,
            radii=np.full(len(normal), _DISC_RADIUS),
            metadata=metadata,
            off_normal=np.zeros(len(normal)),
        )

    def shift(self, at: TouchState, place: Floats) -> tuple[Floats, Floats]:
        """δ, rad, and d, m, by the effects of the robot, (n, 2) each; those by the force fade out with `place`."""
        joints, moved = np.zeros((2, *at.joints.shape))
        for effect, values in zip(self.model.effects, self.model.effect_arrays, strict=True):
            part = faded(effect.shift(at, values), effect.force_dependence, place)
            joints += 0.0 if part.joints is None else part.joints
            moved += 0.0 if part.place is None or effect.on_object else part.place
        return joints, moved


def faded(shift: Shift, dependence: ForceDependence, place: Floats) -> Shift:
    """A shift that depends on the direction of the force, made continuous where there is hardly one.

    Args:
        shift: δ and d.
        dependence: of the effect.
        place: of the gripper in its dead band, (n,), 0 without a force.
    """
    if dependence < ForceDependence.DIRECTION:
        return shift
    weight, joints = place[:, None], shift.joints
    if joints is not None and dependence == ForceDependence.DIRECTION:
        joints = weight * joints
    return Shift(joints, None if shift.place is None else weight * shift.place)


_PASSES = 60
"""Steps at most; Newton's method needs three or four, with effects some more."""
_ROUNDING = 1e-12
"""Change of an angle or a place at which it is found, rad and m."""
_SOLVED = 1e-11
"""Change beyond which a pose has not been found, rad and m: nothing physical is like that."""


class Equilibrium(NamedTuple):
    """Poses that obey the law.

    Attributes:
        joints: Q, (n, 2), rad; NaN where the place is out of reach.
        tip: S, (n, 2), m; NaN where it was not found.
        loading: the arm there.
        state: the poses as effects take them; None without effects.
    """

    joints: Floats
    tip: Floats
    loading: Loading
    state: TouchState | None


def tip_under_load(law: Law, joints: Floats, force: Force, metadata: TouchMetadata) -> Equilibrium:
    """H̄.

    Args:
        law: of the arm.
        joints: Q, (n, 2), rad.
        force: on the object.
        metadata: of the poses.
    """
    p, effects = law.model.parameters, bool(law.model.effects)
    q1, q2 = np.ascontiguousarray(joints.T)
    first, second = q1 + p.theta1, q1 + p.theta1 + q2 + p.theta2
    turn, moved, state, change = np.zeros((2, len(q1))), np.zeros((len(q1), 2)), None, np.zeros(len(q1))
    for _ in range(_PASSES):
        at = law.loading(first, second, force)
        if effects:
            state = law.touch_state(joints, at, force, metadata)
            shift, moved = law.shift(state, force.place)
            turn = shift.T
        row1 = first - p.theta1 - q1 + p.p1 * at.c1 + p.g1 * at.s1 + turn[0]
        row2 = second - first - p.theta2 - q2 + p.p2 * at.c2 + p.g2 * at.s2 + turn[1]
        i11, i12, i21, i22 = inverse_of_rows(at, force)
        step1, step2 = i11 * row1 + i12 * row2, i21 * row1 + i22 * row2
        first, second = first - step1, second - step1 - step2
        change = np.maximum(np.abs(step1), np.abs(step2))
        if not (change > _ROUNDING).any():
            break
    at = law.loading(first, second, force)
    x, y = p.x0 + at.x1 + at.x2 + at.offset_x, p.y0 + at.y1 + at.y2 + at.offset_y
    tip = np.where((change < _SOLVED)[:, None], np.array([x, y]).T + moved, np.nan)
    return Equilibrium(joints, tip, at, state)


def inverse_of_rows(at: Loading, force: Force) -> tuple[Floats, Floats, Floats, Floats]:
    """M⁻¹ by rows, M = I + diag(k) ∂C/∂Q* at constant F; (n,) each."""
    c22 = -(force.x * at.x2 + force.y * at.y2)
    c11 = c22 - (force.x * at.x1 + force.y * at.y1)
    m11, m12, m21, m22 = 1.0 + at.k1 * c11, at.k1 * c22, at.k2 * c22, 1.0 + at.k2 * c22
    scale = 1.0 / (m11 * m22 - m12 * m21)
    return m22 * scale, -m12 * scale, -m21 * scale, m11 * scale


def joints_under_load(law: Law, tip: Floats, force: Force, posture: Indices, metadata: TouchMetadata) -> Equilibrium:
    """Ḡ.

    Args:
        law: of the arm.
        tip: S, (n, 2), m.
        force: on the object.
        posture: +1 or -1, the sign of sin(q2* + theta2), (n,).
        metadata: of the poses.
    """
    p = law.model.parameters
    once = not law.model.effects and law.gripper.isotropic
    compliance, backlash = np.array([[p.p1], [p.p2]]), np.array([[p.g1], [p.g2]])
    turn, moved, state = np.zeros((2, len(tip))), np.zeros((len(tip), 2)), None
    joints, offset = np.zeros((2, len(tip))), _offset(law, np.zeros(len(tip)), force)
    change: tuple[Floats, Floats] = (joints, offset)
    for _ in range(_PASSES):
        links = inverse(p, tip - offset.T - moved, posture).T
        first = links[0] + p.theta1
        at = law.loading(first, first + links[1] + p.theta2, force)
        found = links + compliance * np.array([at.c1, at.c2]) + backlash * np.array([at.s1, at.s2]) + turn
        added = np.array([at.offset_x, at.offset_y])
        change = np.abs(found - joints), np.abs(added - offset)
        joints, offset = found, added
        # where the place is out of reach it is not a number
        if once or not ((change[0] > _ROUNDING).any() or (change[1] > _ROUNDING).any()):
            break
        if law.model.effects:
            state = law.touch_state(joints.T, at, force, metadata)
            shift, moved = law.shift(state, force.place)
            turn = shift.T
    solved = once | ~((change[0] > _SOLVED) | (change[1] > _SOLVED)).any(axis=0)
    return Equilibrium(np.where(solved, joints, np.nan).T, tip, at, state)


def _offset(law: Law, second: Floats, force: Force) -> Floats:
    """S - H(Q*) by the gripper with link 2 at angles (n,), rad; (2, n), m."""
    at = law.loading(second, second, force)
    return np.array([at.offset_x, at.offset_y])


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
