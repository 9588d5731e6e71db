"""One linearised adjustment of all touches: the Gauss–Helmert model.

Q and F are both measured, both with noise, and every touch ties them by two
conditions h(Q, F, L̄) = 0, in metres (`model.contact_force`). Nothing has to be solved inside, and
the conditions are nearly linear in L̄, so they lead from 20 mm and 3° off as well
as from nearby. Weighting and the treatment of the noise follow the Gauss–Helmert
model of adjustment theory: linearised at the *adjusted* observations (Q̂, F̂),

    h(Q̂, F̂, L̄) + B [Q - Q̂; F - F̂] + h_L̄ ΔL̄ + B v = 0,   B = [h_Q h_F],   v ~ (0, Σ),

the misclosure w = h + B [Q - Q̂; F - F̂] has the covariance V = h_Q Σ_Q h_Qᵀ + h_F Σ_F h_Fᵀ,
different for every touch; mostly Σ_Q = σ_q² I and Σ_F = σ_f² I.
To first order h = -h_F (F - A(Q, L̄)), so this is the weighted fit of the force
(9) (10) with residual covariance Σ_F + A_Q Σ_Q A_Qᵀ. Beyond first order it is better: derivatives
taken at adjusted, not at noisy, observations do not correlate with the noise,
which would bias the compliances.

**Two stages.** The direction of a small force is poorly measured: σ_f/f = 0.03 rad at 10 N. Taken as
measured, it puts the tip r (σ_f/f)²/2 ≈ 0.1 mm off along the normal, far more than
the joints' noise does. So the coarse stage, whose parameters may be far off, takes the
observations as measured and adds this to V; the fine stage adjusts them.

Sources: Mikhail and Ackermann, Observations and Least Squares (1976); Neitzel,
J. Geodesy 84 (2010) 751, on where to linearise.

`whiten` gives the same in units of standard deviations, by the root of V.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.observations import Observations
from scara_kinetostatic.model.arrays import Floats, Mask, along_and_across, as_complex, pairs, unit_vectors
from scara_kinetostatic.model.cell import Noise, SensorFrame, force_covariance
from scara_kinetostatic.model.contact_force import free_state, solve_links
from scara_kinetostatic.model.extended_model import ExtendedModel, Shift, reported_force, sensor_derivatives, true_force
from scara_kinetostatic.model.flanks import Arm, State, keep_flanks, next_modes
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import THETA1, THETA2
from scara_kinetostatic.model.touch_derivatives import all_derivatives, off_normal_derivative
from scara_kinetostatic.model.touch_equations import Equations, across, extended_equations, shift_column


class Adjusted(NamedTuple):
    """Where the equations are linearised.

    Attributes:
        joints: Q̂, (n, 2), rad.
        force: F̂ in the sensor's frame, (n, 2), N.
        state: link angles and modes that go with them.
        off_normal: α̂, the off-normal angle of each touch's force, (n,), rad; None where no effect has one.
    """

    joints: Floats
    force: Floats
    state: State
    off_normal: Floats | None = None


def first_guess(observations: Observations, model: ExtendedModel) -> Adjusted:
    """Start: the observations as measured."""
    o = observations
    return as_measured(o, model, free_state(model.parameters, o.joints, o.centers, o.edges))[0]


def place_force(observations: Observations, model: ExtendedModel, joints: Floats, force: Floats, state: State) -> State:
    """The state with magnitude and base-frame direction of a force as the sensor reports it."""
    force = true_force(model, force, observations.metadata)
    x, y = observations.frame.to_base(force, joints, model.parameters).T
    return state._replace(magnitude=np.hypot(x, y), direction=np.arctan2(y, x))


def _in_sensor_frame(observations: Observations, model: ExtendedModel, joints: Floats, state: State) -> Floats:
    """The true force of a state in the sensor's frame, (n, 2), N."""
    force = pairs(state.magnitude * unit_vectors(state.direction))
    return observations.frame.from_base(force, joints, model.parameters)


def linearise(
    observations: Observations, model: ExtendedModel, adjusted: Adjusted, arm: Arm | None = None
) -> Linearisation:
    """The equations and their derivatives at the adjusted observations; `arm` saves work where that of their state
    is known.
    """
    o, state = observations, adjusted.state
    if arm is None:
        state = place_force(o, model, adjusted.joints, adjusted.force, state)
    contact_problem = o.contact_problem(adjusted.joints, adjusted.off_normal)
    e = extended_equations(model, contact_problem, state, arm)
    derivative = all_derivatives(model, contact_problem, state, e)
    h_f, h_d = e.h_by
    if o.frame is SensorFrame.TOOL:  # the sensor turns with link 2, so the force does
        turned = pairs(h_d)
        derivative[:, :, THETA1] += turned
        derivative[:, :, THETA2] += turned
    by = by_touch(4, 2, len(o.joints))
    by_force = by[:, :, 2:]
    by[:, :, :2] = derivative[:, :, THETA1 : THETA2 + 1 : THETA2 - THETA1]
    by_force[:, 0, 0], by_force[:, 1, 0] = h_f.real, h_f.imag
    by_force[:, 0, 1], by_force[:, 1, 1] = h_d.real / state.magnitude, h_d.imag / state.magnitude
    if model.effects and model.has_sensor_error:
        true = _in_sensor_frame(o, model, adjusted.joints, state)
        by_force[:], columns = sensor_derivatives(model, adjusted.force, true, by_force, o.metadata)
        derivative[:, :, model.base_count :] += columns
    # measured less adjusted: both joints, rad, and the force along and across the adjusted one, N
    off_force = along_and_across(o.force - adjusted.force, adjusted.force)
    off = np.concatenate([o.joints - adjusted.joints, off_force], axis=1)
    misclosure = pairs(e.h) + np.einsum('kin,nk->ni', by.T, off)
    parts = [] if o.declared is None else [_by_errors(o, model, adjusted.force, state, by_force)]
    if o.random is not None:
        parts.append(np.concatenate(unit_changes(e, by_force, adjusted.force), axis=2) @ o.random.changes)
    by_errors, by_angle = np.concatenate(parts, axis=-1) if parts else None, None
    if model.effects and model.off_normal_std:
        by_off_normal = off_normal_derivative(model, e)
        if adjusted.off_normal is not None:
            misclosure -= by_off_normal * adjusted.off_normal[:, None]
        by_angle = model.off_normal_std * by_off_normal
    return Linearisation(misclosure, derivative, by, adjusted.force, by_angle, by_errors)


class UnitChanges(NamedTuple):
    """Change of the misclosures of each touch per unit of the two components of what an effect changes.

    Attributes:
        joints: by δ, (n, 2, 2), 1/rad.
        place: by d, (n, 2, 2), 1/m.
        sensor: by e, (n, 2, 2), 1/N.
    """

    joints: Floats
    place: Floats
    sensor: Floats


def unit_changes(equations: Equations, by_force: Floats, force: Floats) -> UnitChanges:
    """What the components of δ, d and e change at touches with reported forces (n, 2), N."""
    units = [np.broadcast_to(unit, force.shape) for unit in np.eye(2)]
    joints = [shift_column(Shift(joints=unit), equations) for unit in units]
    place = [shift_column(Shift(place=unit), equations) for unit in units]
    error = [-np.einsum('nij,nj->ni', by_force, along_and_across(unit, force)) for unit in units]
    return UnitChanges(*(np.stack(part, axis=-1) for part in (joints, place, error)))


def _by_errors(
    observations: Observations, model: ExtendedModel, force: Floats, state: State, by_force: Floats
) -> Floats:
    """h_e: derivatives of the equations by the declared errors, (n, 2, m), m."""
    o = observations
    assert o.declared is not None
    errors = o.errors[: o.declared.count]
    centers, radii = o.declared.by_disc(errors)
    (by_x, by_y), by_radius = centers.transpose(1, 2, 0).take(o.surface, axis=2), radii.T.take(o.surface, axis=1)
    x, y = np.cos(state.direction), np.sin(state.direction)
    out = np.empty((o.declared.count, 2, len(o.joints)))  # the touches last
    np.subtract(by_radius, by_x * x + by_y * y, out=out[:, 0])
    np.subtract(by_x * y, by_y * x, out=out[:, 1])
    if o.tangents is not None:
        _on_edges(o, model, state, out, by_radius)
    along, across = o.declared.by_force(errors)
    for changes, by in ((along, by_force[:, :, 0]), (across, by_force[:, :, 1])):
        for k in np.flatnonzero(changes):
            out[k] += changes[k] * np.hypot(force[:, 0], force[:, 1]) * by.T
    return out.transpose()


def _on_edges(observations: Observations, model: ExtendedModel, state: State, out: Floats, by_radius: Floats) -> None:
    """Corrects h_e, (m, 2, n), in place at straight edges: what moves along them counts nothing, their rotation ω does.

    With N the normal and X the tip, the edge's rotation about the centre S_c of its disc moves h by
    ω (r T + N T·(X - S_c)).
    """
    o = observations
    assert o.declared is not None and o.tangents is not None
    tangent = as_complex(o.tangents)
    seen = np.exp(-1j * state.direction)
    along = tangent * seen
    moved = across(along, out[:, 0] - by_radius + 1j * out[:, 1]) + by_radius
    tip = as_complex(forward(model.parameters, np.array([state.link1, state.link2]).T) - o.centers)
    by_turn = along * (o.radii - 1j * (tip * tangent.conj()).real)
    moved += o.declared.rotation[o.surface].T * by_turn
    out[:, 0], out[:, 1] = moved.real, moved.imag


def adjust(
    observations: Observations,
    model: ExtendedModel,
    adjusted: Adjusted,
    linear: Linearisation,
    whitened: Whitened,
    step: Floats,
    frozen: bool = False,
) -> tuple[Adjusted, Arm]:
    """Adjusted observations after a step ΔL̄: [Q̂; F̂] = [Q; F] - Σ Bᵀ V⁻¹ (w + h_L̄ ΔL̄).

    Touches that are grossly off keep what they measured, but for the direction of the
    force, which is taken to be radial.

    Args:
        observations: the data.
        model: after the step.
        adjusted: the point of linearisation.
        linear: the equations there.
        whitened: the same, whitened.
        step: ΔL̄ and the change of the declared errors, (12 + k + m,).
        frozen: whether every joint stays on its flank.

    Returns:
        The adjusted observations, and the arm at their state.
    """
    o, (multiplier, close) = observations, _multiplier(whitened, step)
    by_q1, by_q2, along, across = np.einsum('kin,ni->kn', whitened.gain.T, multiplier)
    unit = as_complex(adjusted.force)
    unit = unit / np.abs(unit)
    joints, force = o.joints - np.array([by_q1, by_q2]).T, o.force - pairs(unit * (along + 1j * across))
    if not close.all():
        joints = np.where(close[:, None], joints, o.joints)
        force = np.where(close[:, None], force, _turned_radial(o, model, adjusted.state))
    state = place_force(o, model, joints, force, adjusted.state)
    off_normal = np.zeros(len(close)) if model.off_normal_std else None
    if off_normal is not None and linear.by_off_normal is not None:
        off_normal = -model.off_normal_std * np.where(close, (linear.by_off_normal * multiplier).sum(axis=-1), 0.0)
    state, arm = solve_links(model, o.contact_problem(joints, off_normal), state, frozen, again=True)
    return Adjusted(joints, force, state, off_normal), arm


def _multiplier(whitened: Whitened, step: Floats) -> tuple[Floats, Mask]:
    """V⁻¹ (w + h_L̄ ΔL̄), (n, 2), and which touches are not grossly off, (n,)."""
    l11, l21, l22 = whitened.root
    jacobian = whitened.jacobian
    n, _, k = jacobian.shape
    left = whitened.residual.T + (step @ jacobian.transpose(2, 1, 0).reshape(k, 2 * n)).reshape(2, n)
    close = left[0] * left[0] + left[1] * left[1] < 200.0  # 14 standard deviations: no noise is beyond
    multiplier = by_touch(2, n)
    multiplier[:, 1] = left[1] / l22
    multiplier[:, 0] = (left[0] - l21 * multiplier[:, 1]) / l11
    return multiplier, close


def _turned_radial(observations: Observations, model: ExtendedModel, state: State) -> Floats:
    """The measured forces turned so that they point from the tip to the disc's centre, as the sensor reports them."""
    o = observations
    tip = forward(model.parameters, np.array([state.link1, state.link2]).T)
    to_disc = o.contact_problem(o.joints).shifted(model, state).inward(tip)
    direction = np.arctan2(to_disc[:, 1], to_disc[:, 0])
    magnitude = np.hypot(*true_force(model, o.force, o.metadata).T)
    turned = _in_sensor_frame(o, model, o.joints, state._replace(magnitude=magnitude, direction=direction))
    return reported_force(model, turned, o.metadata)


def nearest_flanks(
    observations: Observations, model: ExtendedModel, state: State, *, wide: bool = False
) -> tuple[State, Floats]:
    """Each joint whose torque has no known sign (`keep_flanks`) on the flank that fits best; `wide`: of more torques.

    Returns:
        The state, and how far along the normal the next best flanks would have the tip, (n,), m; inf where there are
        none.
    """
    o, p, trials, offs = observations, model.parameters, list[State](), list[Floats]()
    problem = o.contact_problem(o.joints)
    for one, two in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        trial = state._replace(mode1=one * state.mode1, mode2=two * state.mode2)
        for _ in range(3):
            trial, arm = solve_links(model, problem, trial, frozen=True)
        shifted, tip = problem.shifted(model, trial, arm), forward(p, np.array(trial[:2]).T)
        flanks = keep_flanks(p, next_modes(p, shifted.joints, trial, arm), trial, arm, wide=wide)
        inward = shifted.inward(tip)
        along = ((shifted.centers - tip) * inward).sum(axis=1) / np.hypot(*inward.T)
        off = along - o.radii - o.gripper.stretch(p, trial.magnitude)
        off[(flanks.mode1 != trial.mode1) | (flanks.mode2 != trial.mode2)] = np.inf
        trials.append(trial)
        offs.append(off)
    off, each = np.array(offs), np.arange(len(o.joints))
    best = np.argmin(np.abs(off), axis=0)
    with np.errstate(invalid='ignore'):  # no flank agrees with its torque far from any touch
        apart = np.nan_to_num(np.abs(off - off[best, each]), nan=np.inf, posinf=np.inf)
    apart[apart == 0] = np.inf  # itself, and the other flank of a joint without backlash
    return State(*(np.array(part)[best, each] for part in zip(*trials, strict=True))), apart.min(axis=0)


@np.errstate(all='ignore')
def as_radial(observations: Observations, model: ExtendedModel, state: State) -> Adjusted:
    """The observations as measured but for the direction of the force, which points from the tip to the disc's centre.

    From here the adjustment proper can start: measured directions are not good enough to linearise at.

    Args:
        observations: the data.
        model: the model.
        state: where the tips are.
    """
    o = observations
    if model.parameters.has_gravity:
        state, _ = nearest_flanks(o, model, state)
    force, off_normal = _turned_radial(o, model, state), np.zeros(len(o.joints)) if model.off_normal_std else None
    state = place_force(o, model, o.joints, force, state)
    state, _ = solve_links(model, o.contact_problem(o.joints, off_normal), state, again=True)
    return Adjusted(o.joints, force, state, off_normal)


def as_measured(observations: Observations, model: ExtendedModel, state: State) -> tuple[Adjusted, Arm]:
    """The observations as measured, with the link angles that go with a new L̄: the coarse stage. As `adjust`."""
    o = observations
    state = place_force(o, model, o.joints, o.force, state)
    state, arm = solve_links(model, o.contact_problem(o.joints), state, again=True)
    return Adjusted(o.joints, o.force, state), arm


class Linearisation(NamedTuple):
    """The adjustment's equations at a point; before whitening.

    Attributes:
        misclosure: w, (n, 2), m, along and across the force.
        derivative: h_L̄, (n, 2, 12 + k), in the order of `ExtendedModel.names`.
        by: B = [h_Q h_F], (n, 2, 4), m/rad and m/N, in radial and tangential components of F̂.
        force: F̂ in the sensor's frame, (n, 2), N.
        by_off_normal: h_α times the standard deviation of the off-normal angle, (n, 2), m; None without.
        by_errors: h_e by the declared errors of the cell, (n, 2, m), m; None without.
    """

    misclosure: Floats
    derivative: Floats
    by: Floats
    force: Floats
    by_off_normal: Floats | None = None
    by_errors: Floats | None = None

    @property
    def by_joints(self) -> Floats:
        """h_Q, (n, 2, 2), m/rad."""
        return self.by[:, :, :2]

    @property
    def by_force(self) -> Floats:
        """h_F, (n, 2, 2), m/N."""
        return self.by[:, :, 2:]


class Whitened(NamedTuple):
    """The same in units of standard deviations.

    Attributes:
        residual: (n, 2).
        derivative: (n, 2, 12 + k).
        root: lower Cholesky factor of V, as (l11, l21, l22), (n,) each.
        gain: B Σ, not whitened, (n, 2, 4).
        by_errors: (n, 2, m); None without declared errors.
    """

    residual: Floats
    derivative: Floats
    root: tuple[Floats, Floats, Floats]
    gain: Floats
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


def whiten(linear: Linearisation, noise: Noise, extra: Floats | float = 0.0) -> Whitened:
    """Divide by the Cholesky root of V, touch by touch; `extra` is added to V11."""
    along, crossed, across = force_covariance(noise, linear.force)
    by, (q1, q2) = linear.by.T, noise.joint_levels  # (4, 2, n)
    gain = np.empty_like(by)
    gain[0], gain[1] = q1 * q1 * by[0], q2 * q2 * by[1]
    gain[2], gain[3] = by[2] * along + by[3] * crossed, by[2] * crossed + by[3] * across
    (v11, _), (v21, v22) = np.einsum('kin,kjn->ijn', gain, by)
    if linear.by_off_normal is not None:
        first, second = linear.by_off_normal[:, 0], linear.by_off_normal[:, 1]
        v11, v21, v22 = v11 + first * first, v21 + first * second, v22 + second * second
    l11 = np.sqrt(v11 + extra)
    l21 = v21 / l11
    l22 = np.sqrt(np.maximum(v22 - l21 * l21, 1e-12 * v22))
    root = (l11, l21, l22)
    by_errors = None if linear.by_errors is None else whiten_by(linear.by_errors, root)
    return Whitened(whiten_by(linear.misclosure, root), whiten_by(linear.derivative, root), root, gain.T, by_errors)


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


def whitened_square(matrices: Floats, root: tuple[Floats, Floats, Floats]) -> Floats:
    """L⁻¹ B Bᵀ L⁻ᵀ of (n, 2, k) matrices B, (n, 2, 2)."""
    rows = whiten_by(matrices, root)
    return rows @ rows.swapaxes(1, 2)


def noise_left(linear: Linearisation, root: tuple[Floats, Floats, Floats], noise: Noise, side: int) -> Floats:
    """Standard deviation of the noise that remains in the adjusted force, (n,), N.

    Args:
        linear: the linearisation.
        root: of V there.
        noise: of a touch.
        side: 0 along the force, 1 across it.
    """
    l11, l21, l22 = root
    covariance = force_covariance(noise, linear.force)
    along, across = covariance[side : side + 2]
    by_along, by_across = linear.by_force.T
    moved = by_along * along + by_across * across
    first = moved[0] / l11
    second = (moved[1] - l21 * first) / l22
    before = covariance.along if side == 0 else covariance.across
    return np.asarray(np.sqrt(np.clip(before - first**2 - second**2, 0.0, before)))


def squared_distance(whitened: Whitened) -> Floats:
    """Squared Mahalanobis distance of each touch, (n,); chi-square of 2 degrees where all is well."""
    first, second = whitened.residual[:, 0], whitened.residual[:, 1]
    return np.asarray(first * first + second * second)
