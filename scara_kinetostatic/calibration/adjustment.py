"""One linearised adjustment of all touches: the Gauss–Helmert model.

Q and F are both measured, both with noise, and every touch ties them by two
conditions h(Q, F, L̄) = 0, in metres (`model.equations`). Nothing has to be solved inside, and
the conditions are nearly linear in L̄, so they lead from 20 mm and 3° off as well
as from nearby. Weighting and the treatment of the noise follow the Gauss–Helmert
model of adjustment theory: linearised at the *adjusted* observations (Q̂, F̂),

    h(Q̂, F̂, L̄) + B [Q - Q̂; F - F̂] + h_L̄ ΔL̄ + B v = 0,   B = [h_Q h_F],   v ~ (0, Σ),

the misclosure w = h + B [Q - Q̂; F - F̂] has the covariance V = σ_q² h_Q h_Qᵀ + σ_f² h_F h_Fᵀ,
different for every touch. To first order h = -h_F (F - A(Q, L̄)), so this is the weighted fit of the force
(9) (10) with residual covariance Σ_F + A_Q Σ_Q A_Qᵀ. Beyond first order it is better: derivatives
taken at adjusted, not at noisy, observations do not correlate with the noise,
which would draw the compliances to one side as touches get many.

**Two stages.** The direction of a small force is poorly measured: σ_f/f = 0.03 rad at 10 N. Taken as
measured, it puts the tip r (σ_f/f)²/2 ≈ 0.1 mm off along the normal, far more than
the joints' noise does. So the coarse stage, whose parameters may be far off, takes the
observations as measured and adds this to V; the fine stage adjusts them.

Sources: Mikhail and Ackermann, Observations and Least Squares (1976); Neitzel,
J. Geodesy 84 (2010) 751, on where to linearise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.calibration.misreading import along_and_across, misread, unreading
from scara_kinetostatic.model.cell import Noise, SensorFrame
from scara_kinetostatic.model.extended import all_derivatives, extended_equations, lean_derivative, settled
from scara_kinetostatic.model.extension import Extension, Setting
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import NAMES, THETA1, THETA2, Parameters
from scara_kinetostatic.model.state import State, free_state

Floats = NDArray[np.float64]

GROSS = 50.0
"""A touch whose squared distance is beyond this keeps its observations as measured."""


class Observations(NamedTuple):
    """What n touches measured and where: the data of the adjustment.

    Attributes:
        joints: Q, (n, 2), rad.
        force: F on the object in the sensor's frame, (n, 2), N.
        centers: centre of each touch's disc, (n, 2), m.
        radii: its radius, (n,), m.
        frame: the sensor's frame.
        gripper: the form of (7).
        extension: effects beyond the twelve parameters; None without.
    """

    joints: Floats
    force: Floats
    centers: Floats
    radii: Floats
    frame: SensorFrame
    gripper: Gripper
    extension: Extension | None = None

    def select(self, which: NDArray[np.bool_]) -> Observations:
        """The touches that a mask picks."""
        extension = None if self.extension is None else self.extension.select(which)
        return self._replace(
            joints=self.joints[which],
            force=self.force[which],
            centers=self.centers[which],
            radii=self.radii[which],
            extension=extension,
        )

    def setting(self, joints: Floats, lean: Floats | None = None) -> Setting:
        """The touches at joint angles (n, 2), rad, and leans (n,), rad, as the equations take them."""
        return Setting(joints, self.centers, self.radii, self.gripper, self.extension, lean)

    @property
    def spread(self) -> float:
        """Standard deviation of the lean of the force, rad."""
        return 0.0 if self.extension is None else self.extension.spread

    def true_force(self, parameters: Parameters, reported: Floats) -> Floats:
        """The forces behind what the sensor reports, (n, 2), N, in its frame."""
        return reported if self.extension is None else self.extension.unread(parameters, reported)


class Adjusted(NamedTuple):
    """Where the equations are linearised.

    Attributes:
        joints: Q̂, (n, 2), rad.
        force: F̂ in the sensor's frame, (n, 2), N.
        state: link angles and modes that go with them.
        lean: α̂ of each touch's force, (n,), rad; None where no effect lets it differ.
    """

    joints: Floats
    force: Floats
    state: State
    lean: Floats | None = None


class Linearisation(NamedTuple):
    """The adjustment's equations at a point; before whitening.

    Attributes:
        misclosure: w, (n, 2), m, along and across the force.
        derivative: h_L̄, (n, 2, 12 + k), the k parameters of effects behind the twelve.
        by_joints: h_Q, (n, 2, 2), m/rad.
        by_force: h_F in radial and tangential components of F̂, (n, 2, 2), m/N.
        by_lean: h_α times the standard deviation of the lean, (n, 2), m; None without.
    """

    misclosure: Floats
    derivative: Floats
    by_joints: Floats
    by_force: Floats
    by_lean: Floats | None = None


class Whitened(NamedTuple):
    """The same in units of standard deviations.

    Attributes:
        residual: (n, 2).
        derivative: (n, 2, 12).
        root: lower Cholesky factor of V, as (l11, l21, l22), (n,) each.
    """

    residual: Floats
    derivative: Floats
    root: tuple[Floats, Floats, Floats]


def first_guess(observations: Observations, parameters: Parameters) -> Adjusted:
    """Start: the observations as measured."""
    o = observations
    return as_measured(o, parameters, free_state(parameters, o.joints, o.centers))


def place_force(
    observations: Observations, parameters: Parameters, joints: Floats, force: Floats, state: State
) -> State:
    """The state with magnitude and base-frame direction of a force as the sensor reports it."""
    force = observations.true_force(parameters, force)
    direction = np.arctan2(force[:, 1], force[:, 0])
    if observations.frame is SensorFrame.TOOL:
        direction = direction + joints[:, 0] + joints[:, 1] + parameters.theta1 + parameters.theta2
    return state._replace(magnitude=np.hypot(force[:, 0], force[:, 1]), direction=direction)


def linearise(observations: Observations, parameters: Parameters, adjusted: Adjusted) -> Linearisation:
    """The equations and their derivatives at the adjusted observations."""
    o = observations
    state = place_force(o, parameters, adjusted.joints, adjusted.force, adjusted.state)
    setting = o.setting(adjusted.joints, adjusted.lean)
    e = extended_equations(parameters, setting, state)
    derivative = all_derivatives(parameters, setting, state, e)
    by_joints = derivative[:, :, [THETA1, THETA2]]
    turned = np.stack([e.normal_d, e.tangent_d], axis=-1)
    if o.frame is SensorFrame.TOOL:  # the sensor turns with link 2, so the force does
        by_joints = by_joints + turned[:, :, None]
        derivative[:, :, THETA1] += turned
        derivative[:, :, THETA2] += turned
    by_force = np.empty_like(by_joints)
    by_force[:, 0, 0], by_force[:, 1, 0] = e.normal_f, e.tangent_f
    by_force[:, :, 1] = turned / state.magnitude[:, None]
    if o.extension is not None and o.extension.reads:
        derivative[:, :, len(NAMES) :] += misread(o.extension, parameters, adjusted.force, by_force)
        by_force = by_force @ unreading(o.extension, parameters, adjusted.force)
    off_joints = o.joints - adjusted.joints
    off_force = along_and_across(o.force - adjusted.force, adjusted.force)
    misclosure = np.stack([e.normal, e.tangent], axis=-1)
    misclosure += np.einsum('nij,nj->ni', by_joints, off_joints) + np.einsum('nij,nj->ni', by_force, off_force)
    if not o.spread:
        return Linearisation(misclosure, derivative, by_joints, by_force)
    by_lean = lean_derivative(parameters, setting, state, e)
    if adjusted.lean is not None:
        misclosure -= by_lean * adjusted.lean[:, None]
    return Linearisation(misclosure, derivative, by_joints, by_force, o.spread * by_lean)


def covariance_of(linear: Linearisation, noise: Noise) -> Floats:
    """V of each touch's misclosure, (n, 3): the entries 11, 21, 22, m²."""
    covariance = noise.joint**2 * outer(linear.by_joints) + noise.force**2 * outer(linear.by_force)
    return covariance if linear.by_lean is None else covariance + outer(linear.by_lean[:, :, None])


def direction_variance(observations: Observations, noise: Noise) -> Floats:
    """What the measured direction of the force adds to V11 in the coarse stage, (n,), m²."""
    spread = noise.force**2 / (observations.force**2).sum(axis=-1)
    return (observations.radii * spread) ** 2


def outer(matrices: Floats) -> Floats:
    """B Bᵀ of (n, 2, k) matrices, (n, 3): the entries 11, 21, 22."""
    first, second = matrices[:, 0], matrices[:, 1]
    return np.stack([(first * first).sum(-1), (first * second).sum(-1), (second * second).sum(-1)], axis=-1)


def whiten(linear: Linearisation, noise: Noise, extra: Floats | float = 0.0) -> Whitened:
    """Divide by the Cholesky root of V, touch by touch; `extra` is added to V11."""
    v11, v21, v22 = np.moveaxis(covariance_of(linear, noise), -1, 0)
    v11 = v11 + extra
    l11 = np.sqrt(v11)
    l21 = v21 / l11
    l22 = np.sqrt(np.maximum(v22 - l21 * l21, 1e-12 * v22))
    root = (l11, l21, l22)
    return Whitened(whiten_by(linear.misclosure, root), whiten_by(linear.derivative, root), root)


def whiten_by(array: Floats, root: tuple[Floats, Floats, Floats]) -> Floats:
    """L⁻¹ applied to arrays (n, 2) or (n, 2, k), touch by touch."""
    l11, l21, l22 = (part.reshape((-1,) + (1,) * (array.ndim - 2)) for part in root)
    out = np.empty_like(array)
    out[:, 0] = array[:, 0] / l11
    out[:, 1] = (array[:, 1] - l21 * out[:, 0]) / l22
    return out


def squared_distance(whitened: Whitened) -> Floats:
    """Squared Mahalanobis distance of each touch, (n,); chi-square of 2 degrees where all is well."""
    return (whitened.residual**2).sum(axis=-1)


def adjust(
    observations: Observations,
    parameters: Parameters,
    adjusted: Adjusted,
    linear: Linearisation,
    whitened: Whitened,
    step: Floats,
    noise: Noise,
    frozen: bool = False,
) -> Adjusted:
    """Adjusted observations after a step ΔL̄: [Q̂; F̂] = [Q; F] - Σ Bᵀ V⁻¹ (w + h_L̄ ΔL̄).

    Touches that are grossly off keep what they measured, but for the direction of the
    force, which is taken to be radial.

    Args:
        observations: the data.
        parameters: L̄ after the step.
        adjusted: the point of linearisation.
        linear: the equations there.
        whitened: the same, whitened.
        step: ΔL̄, (12,).
        noise: σ_q and σ_f.
        frozen: whether every joint stays on its flank.
    """
    l11, l21, l22 = whitened.root
    left = whitened.residual + whitened.derivative @ step
    close = ((left**2).sum(axis=-1) < GROSS)[:, None]
    second = left[:, 1] / l22
    multiplier = np.stack([(left[:, 0] - l21 * second) / l11, second], axis=-1)
    o = observations
    off_joints = noise.joint**2 * np.einsum('nij,ni->nj', linear.by_joints, multiplier)
    off = noise.force**2 * np.einsum('nij,ni->nj', linear.by_force, multiplier)
    x, y = np.moveaxis(adjusted.force / np.hypot(adjusted.force[:, 0], adjusted.force[:, 1])[:, None], -1, 0)
    off_force = np.stack([off[:, 0] * x - off[:, 1] * y, off[:, 0] * y + off[:, 1] * x], axis=-1)
    joints = o.joints - np.where(close, off_joints, 0.0)
    force = np.where(close, o.force - off_force, _turned_radial(o, parameters, adjusted.state))
    state = place_force(o, parameters, joints, force, adjusted.state)
    lean = None
    if linear.by_lean is not None:
        lean = -o.spread * np.where(close[:, 0], (linear.by_lean * multiplier).sum(axis=-1), 0.0)
    return Adjusted(joints, force, settle_twice(o, parameters, joints, state, frozen, lean), lean)


def settle_twice(
    observations: Observations,
    parameters: Parameters,
    joints: Floats,
    state: State,
    frozen: bool = False,
    lean: Floats | None = None,
) -> State:
    """Link angles and modes that go with joints and force; the second step is for changed modes."""
    setting = observations.setting(joints, lean)
    return settled(parameters, setting, settled(parameters, setting, state, frozen), frozen)


def _turned_radial(observations: Observations, parameters: Parameters, state: State) -> Floats:
    """The measured forces turned so that they point from the tip to the disc's centre, as the sensor reports them."""
    o = observations
    tip = forward(parameters, np.stack([state.link1, state.link2], axis=-1))
    to_disc = o.setting(o.joints).shifted(parameters, state).centers - tip
    direction = np.arctan2(to_disc[:, 1], to_disc[:, 0])
    if o.frame is SensorFrame.TOOL:
        direction = direction - (o.joints[:, 0] + o.joints[:, 1] + parameters.theta1 + parameters.theta2)
    magnitude = np.hypot(*o.true_force(parameters, o.force).T)
    turned = np.stack([magnitude * np.cos(direction), magnitude * np.sin(direction)], axis=-1)
    return turned if o.extension is None else o.extension.read(parameters, turned)


def as_measured(observations: Observations, parameters: Parameters, state: State) -> Adjusted:
    """The observations as measured, with the link angles that go with a new L̄: the coarse stage."""
    o = observations
    state = place_force(o, parameters, o.joints, o.force, state)
    return Adjusted(o.joints, o.force, settle_twice(o, parameters, o.joints, state))
