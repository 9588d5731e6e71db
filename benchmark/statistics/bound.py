"""The Cramér–Rao bound of the base model's parameters, derived independently of the package's equations and fit.

A touch ties the true observations Q̂ and F̂ by two conditions in the base frame, h(Q̂, F̂, L̄) = 0:

    c = J(L, Q*)ᵀ F,  Q* = Q - p c - g sign(c),  S = H(L, Q*) - p_ee F - g_ee F/‖F‖,  h = S + r F/‖F‖ - S_c.

Both observations are noisy, Σ = diag(σ_q², σ_q², σ_f², σ_f²), and the true ones are unknown as well. The information
about L̄ that is left when they are estimated along with it is, with B = [h_Q h_F] at the truth,

    I = Σ_touches h_L̄ᵀ (B Σ Bᵀ)⁻¹ h_L̄,

and its inverse is the bound. Noise levels that are unknown too do not change it: information about a mean and about a
variance of normal errors do not mix. Derivatives are complex steps, exact to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet

PASSES = 12
"""Of the fixed point for Q*; each gains two digits or more, and there are 16."""
STEP = 1e-30
ADJUSTMENTS = 8


class Linear(NamedTuple):
    """The conditions of n touches at one place, and their derivatives.

    Attributes:
        misclosure: h, (n, 2), m.
        by_parameters: h_L̄, (n, 2, 12).
        by_observations: B, (n, 2, 4), for q1, q2, the two components of the force.
    """

    misclosure: Floats
    by_parameters: Floats
    by_observations: Floats


class Bound(NamedTuple):
    """What no unbiased estimate of L̄ can beat.

    Attributes:
        covariance: the inverse of the information, (12, 12).
        gain: what the ideal linear estimate makes of the errors of the observations, (12, n, 4).
    """

    covariance: Floats
    gain: Floats

    @property
    def std(self) -> Floats:
        """Standard deviations, (12,)."""
        return np.sqrt(np.diag(self.covariance))

    def ideal(self, joint_errors: Floats, force_errors: Floats) -> Floats:
        """Error of the estimate that attains the bound, from errors of the observations (n, 2) each, (12,)."""
        return np.einsum('knj,nj->k', self.gain, np.concatenate([joint_errors, force_errors], axis=1))


def conditions(values: Any, joints: Any, force: Any, centers: Floats, radii: Floats) -> Any:
    """The two conditions h of n touches, (n, 2), m; real or complex.

    Args:
        values: the parameters L̄, in their order.
        joints: Q, (n, 2), rad.
        force: F on the object in the base frame, (n, 2), N.
        centers: of the touched disc, (n, 2), m.
        radii: its radius, (n,), m.
    """
    x0, y0, theta1, l1, theta2, l2, p_ee, p1, p2, g_ee, g1, g2 = values
    fx, fy = force[:, 0], force[:, 1]
    size = np.sqrt(fx * fx + fy * fy)
    link1, link2 = joints[:, 0] + 0 * size, joints[:, 1] + 0 * size
    for _ in range(PASSES):
        a, b = link1 + theta1, link1 + theta1 + link2 + theta2
        c2 = l2 * (np.cos(b) * fy - np.sin(b) * fx)
        c1 = l1 * (np.cos(a) * fy - np.sin(a) * fx) + c2
        link1 = joints[:, 0] - p1 * c1 - g1 * np.sign(c1.real)
        link2 = joints[:, 1] - p2 * c2 - g2 * np.sign(c2.real)
    a, b = link1 + theta1, link1 + theta1 + link2 + theta2
    along = (radii - g_ee) / size - p_ee
    x = x0 + l1 * np.cos(a) + l2 * np.cos(b) + along * fx
    y = y0 + l1 * np.sin(a) + l2 * np.sin(b) + along * fy
    return np.stack([x, y], axis=1) - centers


def linear(cell: Cell, truth: Parameters, touches: TouchSet) -> Linear:
    """The conditions and their derivatives at touches of a sensor in the base frame, disc by disc as they name it."""
    values, centers, radii = truth.as_array(), cell.centers[touches.disc], cell.radii[touches.disc]
    observed = np.concatenate([touches.joints, touches.force], axis=1)

    def by_parameters(step: Any) -> Any:
        return conditions(values + step, touches.joints, touches.force, centers, radii)

    def by_observations(step: Any) -> Any:
        moved = observed + step
        return conditions(values, moved[:, :2], moved[:, 2:], centers, radii)

    return Linear(
        conditions(values, touches.joints, touches.force, centers, radii),
        _complex_steps(by_parameters, len(values)),
        _complex_steps(by_observations, 4),
    )


def _complex_steps(function: Callable[[Any], Any], count: int) -> Floats:
    return np.stack([function(1j * STEP * unit).imag / STEP for unit in np.eye(count)], axis=-1)


def variance(at: Linear, noise: Noise) -> Floats:
    """V = B Σ Bᵀ of every touch, (n, 2, 2), m²."""
    scaled = at.by_observations * [*noise.joint_levels, *noise.force_levels]
    return scaled @ scaled.transpose(0, 2, 1)


def bound(cell: Cell, truth: Parameters, exact: TouchSet, noise: Noise) -> Bound:
    """The bound for touches whose true observations are `exact`."""
    at = linear(cell, truth, exact)
    weighted = np.linalg.solve(variance(at, noise), at.by_parameters)
    information = np.einsum('nik,nil->kl', weighted, at.by_parameters)
    unit = np.sqrt(np.diag(information))  # metres, radians and newtons differ by ten digits
    covariance = np.linalg.inv(information / np.outer(unit, unit)) / np.outer(unit, unit)
    return Bound(covariance, -np.einsum('kl,nil,nij->knj', covariance, weighted, at.by_observations))


def size(cell: Cell, truth: Parameters, touches: TouchSet, clean: TouchSet, noise: Noise) -> Floats:
    """How far bad touches without noise are from what the model allows, in standard deviations, (n,).

    That is the least noise that would turn a touch that obeys the model into the bad one. It is sought from the touch
    as it would be if it were good; where another disc is taken for the touched one the size counts as infinite.
    """
    observed = np.concatenate([touches.joints, touches.force], axis=1)
    nearest = np.concatenate([clean.joints, clean.force], axis=1)
    scale = np.array([*noise.joint_levels, *noise.force_levels])
    for _ in range(ADJUSTMENTS):
        at = linear(cell, truth, clean.replace(joints=nearest[:, :2], force=nearest[:, 2:]))
        left = at.misclosure + np.einsum('nij,nj->ni', at.by_observations, observed - nearest)
        multiplier = np.linalg.solve(variance(at, noise), left[:, :, None])[:, :, 0]
        nearest = observed - scale**2 * np.einsum('nij,ni->nj', at.by_observations, multiplier)
    good = np.concatenate([clean.joints, clean.force], axis=1)  # obeys the model: a bound, should the search fail
    distance = np.min([np.linalg.norm((observed - place) / scale, axis=1) for place in (nearest, good)], axis=0)
    return np.where(touches.disc == clean.disc, distance, np.inf)
