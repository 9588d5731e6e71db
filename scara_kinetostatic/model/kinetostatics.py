"""The deformable robot under a given force: the tip, H̄ (4), and the joint angles that compensate it, Ḡ; derivatives.

- H̄: Q and F are given; Q* solves q* + p c + g s(c / b) + δ = q by Newton's method.
- H̄ by law (6) to the letter is `direct_kinetostatics`. What an effect does to the object or to the force sensor is no
  part of either.
- Ḡ: S and F are given; Q* is the rigid inverse of S less what gripper and effects add: in closed form, or with effects
  by fixed-point iteration.

**Dead band.** sign(c) in (6) is set-valued at c = 0, and with a force that is known to σ_F only, the sign of a small
torque is not known. Here

    q - q* = p c + g s(c / b) + δ,    s(u) = max(-1, min(u, 1)),

with the band b_i = 3 σ_F ‖J_i‖ + 4 |g_i| f (l1 + l2): the law is (6) wherever the torque exceeds three standard
deviations, and a straight line across the dead band between. So the joint angles are a continuous function of place
and force, the middle of the dead band at c = 0, and they do not jump. The second part of b keeps 1 + (g/b) ∂c/∂q* at
3/4 or more, also where a link is pressed along itself: the equations have one solution, so H̄ and Ḡ are each other's
inverse inside the band, too. The gripper alike: -g_ee s(f / 3 σ_F) n. Under gravity c contains its torque
(`gravity`), and b three standard uncertainties of it and 4 |g_i| times its largest change per angle.

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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.extended_model import (
    ExtendedModel,
    ForceDependence,
    Shift,
    TouchMetadata,
    TouchState,
    as_model,
)
from scara_kinetostatic.model.flanks import State
from scara_kinetostatic.model.gravity import Pull, pull_of
from scara_kinetostatic.model.joint_law import NO_TORQUE, Four, deflection, inverse_of_derivative, place_in_band
from scara_kinetostatic.model.kinematics import GripperSign, LoadedJoints, component_by_parameters, inverse, stacked
from scara_kinetostatic.model.parameters import G1, G2, G_EE, NAMES, Parameters
from scara_kinetostatic.model.touch_equations import step_links

SIGN_KNOWN = 3.0
"""Standard deviations from zero at which the sign of a torque, or the direction of a force, is known."""
STEEPEST = 4.0
"""The band is so many times as wide as what the backlash itself can turn the lever arm."""


class Force(NamedTuple):
    """Forces on the object, (n,) each, or one as plain floats.

    Attributes:
        x: F along x, N.
        y: along y, N.
        size: ‖F‖, N.
        std: standard deviation of a component, N.
        place: s(f / 3 σ_F), place in the dead band of the gripper, 0 to 1.
        nx: its direction there along x; 1 where there is no force.
        ny: along y.
        held: x and y of the force that the dead bands follow where it is another one, N; it does not feel the noise.
    """

    x: Any
    y: Any
    size: Any
    std: Any
    place: Any
    nx: Any
    ny: Any
    held: tuple[float, float] | None = None

    @classmethod
    def of(cls, force: Floats, noise: Noise | None = None) -> Force:
        """Forces (n, 2), N, that are known as well as those of one touch; None for exactly."""
        x, y = np.ascontiguousarray(force.T)
        size = np.hypot(x, y)
        some = np.where(size > 0, size, 1.0)
        std = 0.0 * size if noise is None else np.hypot(noise.force_rms, noise.growth * size)
        place = np.sign(size) if noise is None else np.minimum(size / (SIGN_KNOWN * std), 1.0)
        return cls(x, y, size, std, place, np.where(size > 0, x / some, 1.0), y / some)


class Loading(NamedTuple):
    """The arm at given link angles under a force; (n,) each, or plain floats.

    Attributes:
        x1: link 1 along x, m.
        y1: along y.
        x2: link 2 along x, m.
        y2: along y.
        offset: S - H(Q*) by the gripper along x and along y, m.
        c1: torque of joint 1, Nm.
        c2: of joint 2.
        s1: place of joint 1 in its dead band, -1 to 1.
        s2: of joint 2.
        k1: dq1*-slope of the law, p1 + g1 s'/b1, rad/Nm.
        k2: of joint 2.
        pull: gravity on both joints; None without.
    """

    x1: Any
    y1: Any
    x2: Any
    y2: Any
    offset: tuple[Any, Any]
    c1: Any
    c2: Any
    s1: Any
    s2: Any
    k1: Any
    k2: Any
    pull: Pull | None = None

    @property
    def in_band(self) -> Any:
        """Whether a joint is inside its dead band."""
        return (abs(self.s1) < 1) | (abs(self.s2) < 1)

    def tip(self, p: Parameters) -> tuple[Any, Any]:
        """S along x and along y without effects, m."""
        return p.x0 + self.x1 + self.x2 + self.offset[0], p.y0 + self.y1 + self.y2 + self.offset[1]


def load_arm(
    p: Parameters, links: Four, offset: tuple[Any, Any], force: Force, gravity_std: tuple[float, float] = (0.0, 0.0)
) -> Loading:
    """The torques of the arm and its places in the dead bands; floats, or arrays of any one shape.

    Args:
        p: L̄.
        links: x and y of link 1, then of link 2, m.
        offset: S - H(Q*) by the gripper, m.
        force: on the object.
        gravity_std: as `Law.gravity_std`.
    """
    (x1, y1, x2, y2), fx, fy = links, force.x, force.y
    c2 = x2 * fy - y2 * fx
    c1 = x1 * fy - y1 * fx + c2
    known1, known2 = c1, c2
    if force.held is not None:
        x, y = force.held
        known2 = x2 * y - y2 * x
        known1 = x1 * y - y1 * x + known2
    x, y, pull, per_angle = x1 + x2, y1 + y2, None, (p.l1 + p.l2) * force.size
    if p.has_gravity:
        pull = pull_of(p, (x1 + 1j * y1) / p.l1, (x2 + 1j * y2) / p.l2)
        assert pull is not None
        pull1, pull2 = pull.torque
        c1, c2, known1, known2 = c1 + pull1, c2 + pull2, known1 + pull1, known2 + pull2
        per_angle = per_angle + (abs(p.s1) + abs(p.s2)) * abs(complex(*p.gravity))
    b1 = SIGN_KNOWN * (force.std * (x * x + y * y) ** 0.5 + gravity_std[0]) + STEEPEST * abs(p.g1) * per_angle
    b2 = SIGN_KNOWN * (force.std * p.l2 + gravity_std[1]) + STEEPEST * abs(p.g2) * per_angle
    (s1, slope1), (s2, slope2) = place_in_band(known1, b1), place_in_band(known2, b2)
    k1, k2 = p.p1 + p.g1 * slope1, p.p2 + p.g2 * slope2
    return Loading(x1, y1, x2, y2, offset, c1, c2, s1, s2, k1, k2, pull)


def newton_step(
    p: Parameters, joints: tuple[Any, Any], angles: tuple[Any, Any], turn: Any, at: Loading, force: Force
) -> tuple[Any, Any, Four]:
    """By what Q* is to be smaller for law (6) to hold, rad, and M⁻¹ by rows; floats, or arrays of any one shape.

    Args:
        p: L̄.
        joints: Q, rad.
        angles: absolute angles of the links, rad.
        turn: δ of both joints by the effects, rad.
        at: the arm there.
        force: on the object.
    """
    row1 = angles[0] - p.theta1 - joints[0] + deflection(p.p1, p.g1, at.c1, at.s1) + turn[0]
    row2 = angles[1] - angles[0] - p.theta2 - joints[1] + deflection(p.p2, p.g2, at.c2, at.s2) + turn[1]
    rows = i11, i12, i21, i22 = inverse_of_rows(at, force)
    return i11 * row1 + i12 * row2, i21 * row1 + i22 * row2, rows


def inverse_of_rows(at: Loading, force: Force) -> Four:
    """M⁻¹ by rows at constant F."""
    fx, fy = force.x, force.y
    turn2 = fx * at.x2 + fy * at.y2
    turn1 = turn2 + fx * at.x1 + fy * at.y1
    if at.pull is not None:
        turn1, turn2 = turn1 + at.pull.turn[0], turn2 + at.pull.turn[1]
    return inverse_of_derivative((1.0, 1.0), (at.k1, at.k2), (turn1, turn2))


@dataclass(frozen=True)
class Law:
    """The law of an arm.

    Attributes:
        model: the model, with the effects that are part of H̄ and Ḡ.
        gripper: the form of (7).
        noise: of one touch; None for law (6) to the letter, without a band: s = sign(c).
        gravity_std: standard uncertainties of the torques of gravity, at most, Nm: the sign of a smaller torque is not
            known, either.
    """

    model: ExtendedModel
    gripper: GripperSign
    noise: Noise | None = None
    gravity_std: tuple[float, float] = (0.0, 0.0)

    def offset(self, force: Force) -> tuple[Any, Any]:
        """S - H(Q*) by the gripper, m; floats, or arrays of any one shape."""
        slope, gap = self.gripper.slope(self.model.parameters), -self.model.parameters.g_ee * force.place
        return deflection(slope, gap, force.x, force.nx), deflection(slope, gap, force.y, force.ny)

    def loading(self, first: Floats, second: Floats, force: Force) -> Loading:
        """The arm with its links at absolute angles `first` and `second`, (n,), rad."""
        p, offset = self.model.parameters, self.offset(force)
        links = p.l1 * np.cos(first), p.l1 * np.sin(first), p.l2 * np.cos(second), p.l2 * np.sin(second)
        if self.noise is not None:
            return load_arm(p, links, offset, force, self.gravity_std)
        exactly = force._replace(std=1.0)  # any: the places in the bands are replaced
        at = load_arm(p, links, offset, exactly)
        c1, c2 = (np.where(np.abs(c) <= NO_TORQUE * (p.l1 + p.l2) * force.size, 0.0, c) for c in (at.c1, at.c2))
        return at._replace(c1=c1, c2=c2, s1=np.sign(c1), s2=np.sign(c2), k1=p.p1, k2=p.p2)

    def touch_state(self, joints: Floats, at: Loading, force: Force, metadata: TouchMetadata) -> TouchState:
        """The poses as effects take them; `joints` is Q, (n, 2), rad."""
        p = self.model.parameters
        pairs = (force.x, force.y), (at.c1, at.c2), (at.x1, at.y1), (at.x2, at.y2), at.tip(p)
        forces, torques, link1, link2, tip = (np.array(pair).T.reshape(-1, 2) for pair in pairs)
        return TouchState.of_poses(p, joints, forces, torques, (link1, link2), tip, metadata)

    def shift(self, at: TouchState, place: Floats) -> tuple[Floats, Floats]:
        """δ, rad, and d, m, by the effects of the robot, (n, 2) each; those by the force fade out with `place`."""
        joints, moved = np.zeros((2, *at.joints.shape))
        for effect, values in self.model.acting.pairs:
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
_NOTHING = 1e-15
"""Change of an angle or a place that no further step makes smaller, rad and m."""
_SOLVED = 1e-11
"""Change beyond which a pose has not been found, rad and m: nothing physical is like that."""


class Equilibrium(NamedTuple):
    """Poses that obey the law.

    Attributes:
        joints: Q, (n, 2), rad; NaN where the place is out of reach.
        tip: S, (n, 2), m; NaN where it was not found.
        loading: the arm there.
        state: the poses as effects take them; None without effects.
        shift: δ, rad, (2, n), and d, m, (n, 2), of the effects there.
    """

    joints: Floats
    tip: Floats
    loading: Loading
    state: TouchState | None
    shift: tuple[Floats, Floats]


def tip_under_load(law: Law, joints: Floats, force: Force, metadata: TouchMetadata) -> Equilibrium:
    """H̄.

    Args:
        law: of the arm.
        joints: Q, (n, 2), rad.
        force: on the object.
        metadata: of the poses.
    """
    p, effects = law.model.parameters, bool(law.model.acting.effects)
    q1, q2 = np.ascontiguousarray(joints.T)
    first, second = q1 + p.theta1, q1 + p.theta1 + q2 + p.theta2
    turn, moved, state, change = np.zeros((2, len(q1))), np.zeros((len(q1), 2)), None, np.zeros(len(q1))
    for _ in range(_PASSES):
        at = law.loading(first, second, force)
        if effects:
            state = law.touch_state(joints, at, force, metadata)
            shift, moved = law.shift(state, force.place)
            turn = shift.T
        step1, step2, _ = newton_step(p, (q1, q2), (first, second), turn, at, force)
        first, second = first - step1, second - step1 - step2
        change = np.maximum(np.abs(step1), np.abs(step2))
        if not (change > _ROUNDING).any():
            break
    at = law.loading(first, second, force)
    if law.model.effects and state is None:
        state = law.touch_state(joints, at, force, metadata)
    tip = np.where((change < _SOLVED)[:, None], np.array(at.tip(p)).T + moved, np.nan)
    return Equilibrium(joints, tip, at, state, (turn, moved))


def joints_under_load(
    law: Law, tip: Floats, force: Force, posture: Indices, metadata: TouchMetadata, begin: Equilibrium | None = None
) -> Equilibrium:
    """Ḡ.

    Args:
        law: of the arm.
        tip: S, (n, 2), m.
        force: on the object.
        posture: +1 or -1, the sign of sin(q2* + theta2), (n,).
        metadata: of the poses.
        begin: poses nearby to begin at; None for those without effects.
    """
    p, offset, once = law.model.parameters, np.array(law.offset(force)).T, not law.model.acting.effects
    turn, moved = (np.zeros((2, len(tip))), np.zeros((len(tip), 2))) if begin is None else begin.shift
    state, joints = None, np.zeros((2, len(tip)))  # far off: the shift is taken at least once
    change = joints
    for _ in range(_PASSES):
        links = inverse(p, tip - offset - moved, posture).T
        first = links[0] + p.theta1
        at = law.loading(first, first + links[1] + p.theta2, force)
        torques, places = np.array([at.c1, at.c2]), np.array([at.s1, at.s2])
        found = links + deflection(p.joint_compliances, p.joint_backlashes, torques, places) + turn
        joints, change = found, np.abs(found - joints)
        # where the place is out of reach it is not a number
        if once or not (change > _ROUNDING).any():
            break
        state = law.touch_state(joints.T, at, force, metadata)
        shift, moved = law.shift(state, force.place)
        turn = shift.T
    if law.model.effects and state is None:
        state = law.touch_state(joints.T, at, force, metadata)
    solved = once | ~(change > _SOLVED).any(axis=0)
    return Equilibrium(np.where(solved, joints, np.nan).T, tip, at, state, (turn, moved))


class Spread(NamedTuple):
    """The covariance of the values of a model, made ready.

    Attributes:
        factor: B with B Bᵀ = Σ, (12 + k, r).
        gaps: expectations E[g²] = g² + var(g) of the backlashes of the joints, rad², and of the gripper, m², (3,).
        undetermined: directions that the touches do not determine, (12 + k, u).
        undetermined_gaps: squares of the plausible ranges of the backlashes along these, (3,).
    """

    factor: Floats
    gaps: Floats
    undetermined: Floats
    undetermined_gaps: Floats

    @classmethod
    def of(cls, covariance: Floats, undetermined: Floats, parameters: Parameters) -> Spread:
        """That of a covariance, (12 + k, 12 + k), at values of L̄."""
        std = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
        scale = np.where(std > 0, std, 1.0)
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        kept = values > 0
        factor = scale[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        own, free = ((part[[G1, G2, G_EE]] ** 2).sum(axis=1) for part in (factor, undetermined))
        return cls(factor, own + np.square([parameters.g1, parameters.g2, parameters.g_ee]), undetermined, free)

    def tip(self, derivative: Floats) -> Floats:
        """J Σ Jᵀ for derivatives (..., r, 12 + k), m²; NaN where x or y depends on what is undetermined."""
        by_values = derivative @ self.factor
        found = by_values @ by_values.swapaxes(-1, -2)
        free = np.square(derivative[..., :2, :] @ self.undetermined).sum(axis=(-1, -2))
        return np.where((free > _variance(found))[..., None, None], np.nan, found)

    def of_poses(self, law: Law, jacobian: Floats, at: Loading, force: Force, state: TouchState | None) -> Floats:
        """Covariance of the tip by calibration and dead bands, (..., r, r), m²; arguments as `tip_by_values`."""
        by_model = self.tip(tip_by_values(law, jacobian, at, force, state))
        return self.with_dead_bands(by_model, jacobian, at, force)

    def with_dead_bands(self, by_model: Floats, jacobian: Floats, at: Loading, force: Force) -> Floats:
        """Covariance of the tip by the values of the model and the unknown places in the dead bands, (..., r, r), m².

        NaN where such a place counts whose backlash the touches do not determine.

        Args:
            by_model: by the values alone, J Σ Jᵀ.
            jacobian: G, (..., r, 2).
            at: the poses.
            force: on the object there.
        """
        total = by_model + band_covariance(self.gaps, jacobian, at, force)
        free = _variance(band_covariance(self.undetermined_gaps, jacobian, at, force))
        return np.where((free > _variance(total))[..., None, None], np.nan, total)


def _variance(covariance: Floats) -> Floats:
    """Of x and y together."""
    return np.asarray(covariance[..., 0, 0] + covariance[..., 1, 1])


def tip_by_joints(at: Loading, rows: Four, with_yaw: bool = False) -> Floats:
    """G = ∂S/∂Q at fixed F, (n, 2, 2), of floats (2, 2), m/rad; the angle of link 2 may be a third row.

    Args:
        at: the poses.
        rows: M⁻¹ there, by `inverse_of_rows`.
        with_yaw: whether it is.
    """
    i11, i12, i21, i22 = rows
    jx, jy = -(at.y1 + at.y2), at.x1 + at.x2
    by_joints = [
        (jx * i11 - at.y2 * i21, jx * i12 - at.y2 * i22),
        (jy * i11 + at.x2 * i21, jy * i12 + at.x2 * i22),
        (i11 + i21, i12 + i22),
    ]
    return stacked(by_joints if with_yaw else by_joints[:2], np.shape(i11)).T


def tip_by_values(law: Law, jacobian: Floats, at: Loading, force: Force, state: TouchState | None) -> Floats:
    """∂S/∂(values of the model) at fixed Q and F, (n, r, 12 + k), of floats (r, 12 + k), with the rows of G.

    Args:
        law: of the arm.
        jacobian: G, (n, r, 2) or (r, 2).
        at: the poses.
        force: on the object there.
        state: the poses as effects take them; None without effects.
    """
    p, s = law.model.parameters, law.gripper.factor
    u1x, u1y, u2x, u2y = at.x1 / p.l1, at.y1 / p.l1, at.x2 / p.l2, at.y2 / p.l2
    joints = LoadedJoints(
        slope=(at.k1, at.k2),
        moment=(u1x * force.y - u1y * force.x, u2x * force.y - u2y * force.x),
        torque=(at.c1, at.c2),
        sense=(at.s1, at.s2),
        pull=None if at.pull is None else ((at.k1, at.k2), at.pull.per_moment),
    )
    parts = (
        ((1.0, 0.0), (u1x, u2x), (s * force.x, -force.place * force.nx)),
        ((0.0, 1.0), (u1y, u2y), (s * force.y, -force.place * force.ny)),
        ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    )
    turns = jacobian.tolist() if jacobian.ndim == 2 else jacobian.transpose(1, 2, 0)
    rows = [
        component_by_parameters(axis, links, turn, gripper, joints)
        for (axis, links, gripper), turn in zip(parts, turns, strict=False)
    ]
    found = stacked(rows, jacobian.shape[:-2]).T
    return found if state is None else with_effects(found, law.model, jacobian, np.reshape(force.place, -1), state)


def with_effects(found: Floats, model: ExtendedModel, jacobian: Floats, place: Floats, state: TouchState) -> Floats:
    """The columns of L̄ and what they change in the effects, then those of the effects' values: d - G δ each.

    Args:
        found: the columns of L̄, (..., r, 12).
        model: the model.
        jacobian: G, (..., r, 2).
        place: of the gripper in its dead band, (n,), 1 beyond it.
        state: the poses as effects take them.
    """
    rows = [*np.moveaxis(found, -1, 0)]

    def column(shift: Shift, dependence: ForceDependence = ForceDependence.NONE, *, of_robot: bool = True) -> Floats:
        turned, moved = faded(shift, dependence, place)
        out = np.zeros(jacobian.shape[:-1])
        if turned is not None:
            first, second = np.moveaxis(jacobian, -1, 0)
            turned = turned.reshape(*jacobian.shape[:-2], 2)
            out -= first * turned[..., :1]
            out -= second * turned[..., 1:]
        if moved is not None and of_robot:
            out[..., :2] += moved.reshape(*jacobian.shape[:-2], 2)
        return out

    for name, shift in model.acting.shift_by_robot(state).items():
        rows[NAMES.index(name)] = rows[NAMES.index(name)] + column(shift)
    for effect, values in model.pairs:
        dependence, of_robot = effect.force_dependence, not effect.on_object
        rows += [column(shift, dependence, of_robot=of_robot) for shift in effect.derivative(state, values)]
    return np.moveaxis(np.array(rows), 0, -1)


def band_covariance(gaps: Floats, jacobian: Floats, at: Loading, force: Force) -> Floats:
    """Covariance of the tip by the unknown places in the dead bands, (..., r, r), m²: E[g²] / 3 (1 - s²) of each.

    Args:
        gaps: squares of the backlashes, as `Spread.gaps`.
        jacobian: G, (..., r, 2).
        at: the poses.
        force: on the object there.
    """
    variances = gaps / 3 * (1 - np.array([at.s1, at.s2, force.place]).T ** 2)
    found: Floats = (jacobian * variances[..., None, :2]) @ jacobian.swapaxes(-1, -2)
    found[..., 0, 0] += variances[..., 2]
    found[..., 1, 1] += variances[..., 2]
    return found


def tip_by_noise(law: Law, jacobian: Floats, at: Loading, force: Force) -> Floats:
    """Change of the tip by one standard deviation of the noise of q1, q2, F_x and F_y, (..., r, 4), m.

    ∂S/∂F at fixed Q is ∓p_ee I - g_ee s / f (I - n nᵀ) - G diag(k) Jᵀ, m/N; of a joint whose dead band follows a held
    force k is p.
    """
    assert law.noise is not None
    p, (q1, q2) = law.model.parameters, law.noise.joint_levels
    if force.held is None:
        slopes, size = (at.k1, at.k2), np.where(force.size > 0, force.size, 1.0)
    else:
        slopes, size = (p.p1, p.p2), max(force.size, SIGN_KNOWN * force.std)
    along, aside = law.gripper.factor * p.p_ee, p.g_ee * force.place / size
    cross = aside * force.nx * force.ny
    plain = [(along - aside * force.ny * force.ny, cross), (cross, along - aside * force.nx * force.nx), (0.0, 0.0)]
    shape = jacobian.shape[:-2]
    torques = [(-slopes[0] * (at.y1 + at.y2), slopes[0] * (at.x1 + at.x2)), (-slopes[1] * at.y2, slopes[1] * at.x2)]
    by_force = stacked(plain[: jacobian.shape[-2]], shape).T - jacobian @ stacked(torques, shape).T
    return np.concatenate([jacobian * (q1, q2), by_force * np.asarray(force.std)[..., None, None]], axis=-1)


def tip_yield(parameters: Parameters, joints: Floats, force: Floats) -> Floats:
    """How far arm and gripper yield to a force at the tip, (n, 2), m: C F, C that of (4) with (7), without backlash.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        force: F on the object, (n, 2), N.
    """
    p, turns = parameters, kinematics.jacobian(parameters, joints)
    angles = np.array([p.p1, p.p2]) * np.einsum('nij,ni->nj', turns, force)
    return np.asarray(p.p_ee * force + np.einsum('nij,nj->ni', turns, angles))


def press_aside(parameters: Parameters, joints: Floats, force: Floats, aside: ArrayLike) -> Floats:
    """ΔQ of a press that adds a force along the normal, and drags the tip aside, (n, 2), rad.

    J ΔQ is along C R(a) F: a tip that friction held would press at the angle a from the normal; where the angle of
    friction is smaller, it slides. If need be it is turned until the angle from F is a, too; its slope is at most
    `STEEPEST_ASIDE`. With a = 0 the tip stays where it is.

    Args:
        parameters: L̄.
        joints: Q, (n, 2), rad.
        force: F on the object, along the normal, (n, 2), N, not 0.
        aside: a, (n,), rad.
    """
    held = tip_yield(parameters, joints, kinematics.rotate(force, aside))
    square, across = (force**2).sum(axis=1), kinematics.quarter_turn(force)
    along, side = (held * force).sum(axis=1), np.sign(aside)
    slope = np.where(along > 0, (held * across).sum(axis=1) / np.where(along > 0, along, 1.0), side * STEEPEST_ASIDE)
    slope = np.where(side == 0, slope, side * np.clip(side * slope, np.tan(np.abs(aside)), STEEPEST_ASIDE))
    along = (tip_yield(parameters, joints, force) * force).sum(axis=1) / square
    moved = along[:, None] * (force + slope[:, None] * across)
    return np.asarray(np.linalg.solve(kinematics.jacobian(parameters, joints), moved[..., None])[..., 0])


DRAG = 0.5
"""Angle from the normal at which a press drags the tip aside, rad. With 0.4 friction of 0.15 and the gap of the gripper
still hold the tip in one of 24 touches in the physics engine, with 0.5 in none.
"""


STEEPEST_ASIDE = 2.0
"""Largest way aside over that along the normal. With 1.5 a tip that is held presses at less than 0.15 rad from the
normal in 6 % of the touches of soft arms, with 2 in none.
"""


def drag(angle: Floats, posture: ArrayLike) -> Floats:
    """Angle at which touches drag the tip aside, (n,), rad: `DRAG` to either side in turn.

    The tip then slides, and friction has its whole force, whatever the tip did before.

    Args:
        angle: place around the object, (n,), rad; the side changes every 15°.
        posture: elbow posture, +1 or -1, (n,); the other one has the other side.
    """
    # a quarter of a step off the places that are planned, on discs and, half a step on, on outlines
    turn = np.floor(np.asarray(angle) / (np.pi / 12) + 0.25) + (np.asarray(posture) > 0)
    return np.where(turn % 2 == 0, DRAG, -DRAG)


def inverse_kinetostatics(
    model: ExtendedModel | Parameters,
    tip: ArrayLike,
    force: ArrayLike,
    posture: ArrayLike,
    gripper: GripperSign = GripperSign.PHYSICAL,
    metadata: TouchMetadata | None = None,
) -> tuple[Floats, Floats]:
    """Ḡ: the actuator angles and torques that hold a tip at a place under a force (4).

    Args:
        model: the extended model, or L̄ of the base model alone.
        tip: S, (n, 2), m.
        force: F on the object, base frame, (n, 2), N; where a torque is zero the joint is in the middle of its dead
            band.
        posture: +1 or -1, the sign of sin(q2* + theta2), (n,) or one for all.
        gripper: the form of (7).
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`. Effects on the object
            are no part of this.

    Returns:
        Q, (n, 2), rad, NaN where the place is out of reach, and C, (n, 2), Nm.
    """
    place, load = np.broadcast_arrays(np.atleast_2d(tip), np.atleast_2d(force))
    law, known = Law(as_model(model), gripper), metadata or TouchMetadata.plain(len(place))
    with np.errstate(invalid='ignore'):
        found = joints_under_load(law, place, Force.of(load), np.asarray(posture), known)
    return found.joints, np.array([found.loading.c1, found.loading.c2]).T


def direct_kinetostatics(
    model: ExtendedModel | Parameters,
    joints: Floats,
    force: Floats,
    gripper: GripperSign = GripperSign.PHYSICAL,
    metadata: TouchMetadata | None = None,
) -> tuple[Floats, Floats]:
    """H̄: the tip's place and the torques from what sensors measure, actuator angles and the force, by law (6).

    Where a link is nearly in line with a force that compresses it, law (6) has several solutions. Use of a calibration,
    where nothing may jump, is `tip_under_load`.

    Args:
        model: the extended model, or L̄ of the base model alone.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N; where it is zero the joints are in the middle of their dead
            bands.
        gripper: the form of (7).
        metadata: what effects need to know of each pose; by default `TouchMetadata.plain`.

    Returns:
        S, (n, 2), m, and C, (n, 2), Nm.
    """
    law, load, known = Law(as_model(model), gripper), Force.of(force), metadata
    p = law.model.parameters
    pressed = (np.any(force != 0, axis=1) | p.has_gravity)[:, None]
    known = TouchMetadata.plain(len(force)) if known is None else known
    turn = moved = np.zeros(np.shape(joints))
    for _ in range(_PASSES):
        links = np.where(pressed, _links(p, joints - turn, force), joints - turn)
        first = links[:, 0] + p.theta1
        at = law.loading(first, first + links[:, 1] + p.theta2, load)
        if not law.model.effects:
            break
        before, (turn, moved) = (turn, moved), law.shift(law.touch_state(joints, at, load, known), load.place)
        if not np.any(np.abs([turn - before[0], moved - before[1]]) > _NOTHING):
            break
    return np.array(at.tip(p)).T + moved, np.array([at.c1, at.c2]).T


def _links(parameters: Parameters, joints: Floats, force: Floats) -> Floats:
    """Q* of joints under a force, (n, 2), by Newton's method.

    Where a link is nearly in line with a force that compresses it, the floating joint is unstable, and the flanks
    alternate from one start: then the others are tried.
    """
    links, wrong = np.full(joints.shape, np.nan), np.arange(len(joints))
    for start in ((1.0, 1.0), (-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)):
        found, settled = _links_from(start, parameters, joints[wrong], force[wrong])
        kept = settled | np.isnan(links[wrong, 0])
        links[wrong[kept]], wrong = found[kept], wrong[~settled]
        if not len(wrong):
            break
    return links


def _links_from(
    start: tuple[float, float], parameters: Parameters, joints: Floats, force: Floats
) -> tuple[Floats, Mask]:
    """Q* from flanks to start on, (n, 2), and whether links and flanks agree, (n,)."""
    magnitude, direction = np.hypot(force[:, 0], force[:, 1]), np.arctan2(force[:, 1], force[:, 0])
    flanks = (np.full(len(joints), each) for each in start)
    state = State(joints[:, 0], joints[:, 1], magnitude, direction, *flanks)
    for _ in range(20):  # three or four suffice
        before, (state, arm) = state, step_links(parameters, joints, state)
        if ((state.mode1 != before.mode1) | (state.mode2 != before.mode2)).any():
            state, _ = step_links(parameters, joints, state, arm=arm)
        if not np.any(_change(state, before) > _NOTHING):
            break
    further, _ = step_links(parameters, joints, state)
    settled = (_change(state, further) < _ROUNDING) & (state.mode1 == further.mode1) & (state.mode2 == further.mode2)
    return np.stack([state.link1, state.link2], axis=-1), np.asarray(settled)


def _change(one: State, other: State) -> Floats:
    """The larger change of both link angles, (n,), rad."""
    return np.asarray(np.maximum(np.abs(one.link1 - other.link1), np.abs(one.link2 - other.link2)))
