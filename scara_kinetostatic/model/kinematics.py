"""The rigid robot: direct kinematics H, inverse G, Jacobian J (1) (2) (5); the laws of gripper (7) and joints (6).

The angles here are those of the links, Q*; the offsets theta1, theta2 are added
inside. J is ∂S/∂Q by definition (2): its first column holds both links. (The J
printed under (5) lacks the l2 term in the first column, a misprint.)

**The gripper** yields along the force, in all directions alike:

    S - S* = -p_ee F - g_ee F/‖F‖        (physical; the paper prints + for the first -)

A compliance matrix beside p_ee I is the effect `anisotropic_gripper`, or another p_ee and p2.

**The law** of an elastic part with backlash, a joint (6) or the gripper (7), and the torques (2) (8) of the joints.

    q - q* = p c + g s(c),    s(c) = sign(c).

sign(c) is set-valued at c = 0: inside its backlash the part floats and q - q* is anywhere in [-g, g]. There s is the
place in the dead band, from -1 to 1, 0 being its middle. It is given (the flank on which a joint rests), or a
continuous function of the load: a straight line across a band |c| < b, where the sign is not known (`place_in_band`),
or `rounded_sign`. Solved for the load, the law is a spring with a dead zone, p c = dz(q - q*; g) (`beyond_gap`).

**Newton's method.** With rows on_i (q_i* - q_i) + w_i c_i + g_i s_i of both joints, whose torques lose t_i as joint i
turns,

    M = ∂rows/∂Q* = [[on1 - w1 t1, -w1 t2], [-w2 t2, on2 - w2 t2]],

w being p on a flank, p + g ∂s/∂c inside a band. A joint that floats has on = 0, and the torque alone for a row.

**Gravity** g in the plane of the arm pulls each link down with the torque s (e × g), s its static moment and e its unit
vector. Both torques on the links have to be held by the actuators: the robot's force F on the object comes back as -F,
with the torques -JᵀF = -f a; so the actuators exert C = f a - τ,

    τ1 = s1 (e1 × g) + s2 (e2 × g),   τ2 = s2 (e2 × g),

and in (6) C replaces f a, in the dead band too: `Pull` holds t = -τ. As the links turn, t changes as the lever arms do:
dt1 = -k1 dq1 - k2 dq2, dt2 = -k2 (dq1 + dq2), with k = -(s1 e1·g + s2 e2·g, s2 e2·g). The moments of link 2 and of a
load count at the elbow for s1.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from math import copysign
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, Indices, as_complex
from scara_kinetostatic.model.parameters import Parameters


def link_vectors(parameters: Parameters, joints: ArrayLike) -> tuple[Floats, Floats]:
    """The two links as vectors in the base frame.

    Args:
        parameters: L̄.
        joints: link angles Q*, (n, 2), rad.

    Returns:
        Link 1 and link 2, (n, 2) each, m.
    """
    q = np.asarray(joints, dtype=float)
    first = q[..., 0] + parameters.theta1
    second = first + q[..., 1] + parameters.theta2
    u = np.stack([np.cos(first), np.sin(first)], axis=-1)
    v = np.stack([np.cos(second), np.sin(second)], axis=-1)
    return parameters.l1 * u, parameters.l2 * v


def forward(parameters: Parameters, joints: ArrayLike) -> Floats:
    """H: the tip of the rigid arm (5).

    Args:
        parameters: L̄.
        joints: link angles Q*, (n, 2), rad.

    Returns:
        S*, (n, 2), m.
    """
    link1, link2 = link_vectors(parameters, joints)
    return link1 + link2 + (parameters.x0, parameters.y0)


def jacobian(parameters: Parameters, joints: ArrayLike) -> Floats:
    """J = ∂S/∂Q (2).

    Args:
        parameters: L̄.
        joints: link angles Q*, (n, 2), rad.

    Returns:
        (n, 2, 2), m/rad; the last axis counts the joints.
    """
    link1, link2 = link_vectors(parameters, joints)
    return np.stack([quarter_turn(link1 + link2), quarter_turn(link2)], axis=-1)


class LoadedJoints(NamedTuple):
    """What L̄ changes the link angles by under a given force; pairs of joint 1 and joint 2, floats or arrays alike.

    Attributes:
        slope: change of the deflection per torque, rad/Nm; 0 where the change of the torques is left out.
        moment: of the force about a joint per length of its link, N.
        torque: C, Nm.
        sense: place in the dead band, sign(c) beyond it.
        rests: 1 where the joint rests on a flank or in a dead band that is crossed continuously, 0 where it floats.
        pull: change of the row per torque of gravity, and the torque u × g per static moment of each link, m/s²;
            None without gravity.
    """

    slope: tuple[Any, Any] = (0.0, 0.0)
    moment: tuple[Any, Any] = (0.0, 0.0)
    torque: tuple[Any, Any] = (0.0, 0.0)
    sense: tuple[Any, Any] = (0.0, 0.0)
    rests: tuple[Any, Any] = (1.0, 1.0)
    pull: tuple[tuple[Any, Any], tuple[Any, Any]] | None = None


def component_by_parameters(
    axis: tuple[Any, Any], links: tuple[Any, Any], turns: tuple[Any, Any], gripper: tuple[Any, Any], at: LoadedJoints
) -> tuple[Any, ...]:
    """∂S/∂L̄ (5) (6) (7) (8) of one component of the tip at fixed Q and F; floats, or arrays of any one shape.

    With G_i = ∂S/∂q_i, the change of the row of joint i of law (6) moves the tip by -G_i times it: by G_i for theta_i,
    -G_i c_i for p_i, -G_i sign(c_i) for g_i, and by what the length of a link adds to the torques for l_i.

    Args:
        axis: parts of x and y in the component: (1, 0) for x.
        links: the component of the unit vectors of both links.
        turns: the component of G_1 and G_2, m/rad.
        gripper: the component of the tip's change by p_ee, N, and by g_ee.
        at: the joints.

    Returns:
        Those of L̄, in the order of `NAMES`; with `pull` those by s1 and s2 behind.
    """
    (u, v), (g1, g2) = links, turns
    (k1, k2), (m1, m2), (c1, c2), (s1, s2), (rests1, rests2), pull = at
    by1, by2 = g1 * k1, g2 * k2
    l1, l2 = u - by1 * m1, v - (by1 + by2) * m2
    found = (*axis, g1 * rests1, l1, g2 * rests2, l2, gripper[0], -g1 * c1, -g2 * c2, gripper[1], -g1 * s1, -g2 * s2)
    if pull is None:
        return found
    (w1, w2), (per_s1, per_s2) = pull
    return (*found, -g1 * w1 * per_s1, -(g1 * w1 + g2 * w2) * per_s2)


def stacked(rows: Sequence[Sequence[Any]], shape: tuple[int, ...]) -> Floats:
    """R rows of k floats or arrays of a shape as one array (k, r, *shape)."""
    if not shape:
        return np.array(rows, dtype=float).T
    out = np.empty((len(rows[0]), len(rows), *shape))
    for number, row in enumerate(rows):
        for k, part in enumerate(row):
            out[k, number] = part
    return out


def tip_by_parameters(
    parameters: Parameters, links: ArrayLike, force: Floats, factor: float, at: LoadedJoints | None = None
) -> Floats:
    """∂S/∂L̄ at fixed Q and F with G = J: what the deflection changes in the lever arms is left out.

    Args:
        parameters: L̄.
        links: link angles Q*, (..., 2), rad.
        force: F on the object, (..., 2), N.
        factor: sign of the elastic part of the gripper's law, `GripperSign.factor`.
        at: torque and sense of the joints; None without a force.

    Returns:
        (..., 2, 12), in the order of `NAMES`.
    """
    link1, link2 = link_vectors(parameters, links)
    turn1, turn2 = quarter_turn(link1 + link2), quarter_turn(link2)
    size = np.hypot(force[..., 0], force[..., 1])[..., None]
    unit = force / np.where(size > 0, size, 1.0)
    rows = [
        component_by_parameters(
            (1.0 - k, k),
            (link1[..., k] / parameters.l1, link2[..., k] / parameters.l2),
            (turn1[..., k], turn2[..., k]),
            (factor * force[..., k], -unit[..., k]),
            at or LoadedJoints(),
        )
        for k in (0, 1)
    ]
    return np.moveaxis(stacked(rows, link1.shape[:-1]), (0, 1), (-1, -2))


def forward_by_parameters(parameters: Parameters, joints: ArrayLike) -> Floats:
    """∂H/∂L̄ at link angles (n, 2), rad: (n, 2, 12). By the joints it is J."""
    return tip_by_parameters(parameters, joints, np.zeros(np.shape(joints)), 0.0)


def inverse(parameters: Parameters, tip: ArrayLike, posture: ArrayLike) -> Floats:
    """G: the link angles that put the rigid arm's tip at a place (1).

    Args:
        parameters: L̄.
        tip: S*, (n, 2), m.
        posture: +1 or -1, the sign of sin(q2 + theta2), (n,) or one for all.

    Returns:
        Q*, (n, 2), rad, wrapped to (-pi, pi]; NaN where the place is out of reach.
    """
    x, y = np.moveaxis(np.asarray(tip, dtype=float) - (parameters.x0, parameters.y0), -1, 0)
    l1, l2 = parameters.l1, parameters.l2
    with np.errstate(over='ignore'):
        cos_elbow = (x * x + y * y - l1 * l1 - l2 * l2) / (2 * l1 * l2)
    # (1 - c)(1 + c) by factors: 1 - c² would lose digits near the stretched and the folded arm
    with np.errstate(invalid='ignore'):
        sin_elbow = np.asarray(posture) * np.sqrt((1 - cos_elbow) * (1 + cos_elbow))
    elbow = np.arctan2(sin_elbow, cos_elbow)
    shoulder = np.arctan2(y, x) - np.arctan2(l2 * sin_elbow, l1 + l2 * cos_elbow)
    return wrap(np.stack([shoulder - parameters.theta1, elbow - parameters.theta2], axis=-1))


def posture(parameters: Parameters, joints: ArrayLike) -> Indices:
    """The elbow posture: +1 where sin(q2 + theta2) > 0, else -1, (n,)."""
    elbow = np.asarray(joints, dtype=float)[..., 1] + parameters.theta2
    return np.where(np.sin(elbow) > 0, 1, -1)


def wrap(angles: ArrayLike) -> Floats:
    """Angles brought to (-pi, pi], rad."""
    angles = np.asarray(angles, dtype=float)
    return angles - 2 * np.pi * np.ceil((angles - np.pi) / (2 * np.pi))


def quarter_turn(vectors: ArrayLike) -> Floats:
    """R90: vectors (n, 2) turned by +90 degrees (11)."""
    vectors = np.asarray(vectors, dtype=float)
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def rotate(vectors: ArrayLike, angle: ArrayLike) -> Floats:
    """Vectors (n, 2) turned by angles (n,), rad."""
    vectors, angle = np.asarray(vectors, dtype=float), np.asarray(angle, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([c * x - s * y, s * x + c * y], axis=-1)


class GripperSign(str, Enum):
    """Which form of (7) holds: as physics has it, or as the paper printed it."""

    PHYSICAL = 'physical'
    PAPER = 'paper'

    @property
    def factor(self) -> float:
        """The sign s of the elastic part: -1, or +1 as printed."""
        return 1.0 if self is GripperSign.PAPER else -1.0

    def slope(self, parameters: Parameters) -> float:
        """Stretch along n per newton, dγ/df, m/N."""
        return self.factor * parameters.p_ee

    def stretch(self, parameters: Parameters, magnitude: Floats) -> Floats:
        """γ = s p_ee f - g_ee, S - S* along n, (n,), m.

        For f < 0, the continuation to a tip that pulls at the disc, it stays the same straight line.
        """
        return self.slope(parameters) * magnitude - parameters.g_ee


Pair = tuple[Any, Any] | Floats
Four = tuple[Any, Any, Any, Any]
NO_TORQUE = 1e-13
"""Part of force times arm length below which a torque is rounding error: an exact zero."""


def deflection(compliance: Any, backlash: Any, load: Any, place: Any) -> Any:
    """Law (6): q - q* = p c + g s, rad; of the gripper the same in m. Floats, or arrays of any one shape."""
    return compliance * load + backlash * place


def place_in_band(load: Any, band: Any) -> tuple[Any, Any]:
    """Place max(-1, min(c / b, 1)) of a load c in a band b > 0, and ∂s/∂c; floats, or arrays of any one shape."""
    part = load / band
    if part.__class__ is float:  # at 1 kHz the arithmetic of arrays takes twice as long
        return (part, 1.0 / band) if -1.0 < part < 1.0 else (copysign(1.0, part), 0.0)
    inside = abs(part) < 1
    return inside * part + (part >= 1) - (part <= -1), inside / band


def rounded_sign(load: Floats, width: float) -> Floats:
    """A sign with a continuous derivative, c / √(c² + w²)."""
    return load / np.hypot(load, width)


def beyond_gap(deflected: Floats, backlash: float) -> Floats:
    """The law solved for the load: p c = dz(u; g) = sign(u) max(|u| - g, 0) at a deflection u."""
    return np.asarray(np.sign(deflected) * np.maximum(np.abs(deflected) - backlash, 0.0))


def inverse_of_derivative(on: Pair, weight: Pair, turn: Pair) -> Four:
    """M⁻¹ by rows; floats, or arrays of any one shape.

    Args:
        on: 1, or 0 where a joint floats.
        weight: w, change of each row per torque.
        turn: t, what the torques lose per angle.
    """
    (w1, w2), (t1, t2) = weight, turn
    m11, m12, m21, m22 = on[0] - w1 * t1, w1 * t2, w2 * t2, on[1] - w2 * t2
    scale = 1.0 / (m11 * m22 - m12 * m21)
    return m22 * scale, m12 * scale, m21 * scale, m11 * scale


def joint_deflection(parameters: Parameters, torques: ArrayLike, slack: ArrayLike = 0.0) -> Floats:
    """Law of the joints (6): q - q* = p c + g sign(c).

    Args:
        parameters: L̄.
        torques: C, (n, 2), Nm.
        slack: place in the dead band where a torque is zero, in [-1, 1].

    Returns:
        q - q*, (n, 2), rad.
    """
    torques, p = np.asarray(torques, dtype=float), parameters
    sign = np.where(torques == 0, slack, np.sign(torques))
    return np.asarray(deflection(p.joint_compliances[:, 0], p.joint_backlashes[:, 0], torques, sign))


def joint_torques(parameters: Parameters, links: ArrayLike, force: ArrayLike) -> Floats:
    """Torques C = JᵀF (2) (8), with J at the link angles Q*, and what holds the arm against gravity.

    Without gravity they are exact zeros below `NO_TORQUE`.

    Args:
        parameters: L̄.
        links: Q*, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.

    Returns:
        C, (n, 2), Nm.
    """
    force = np.asarray(force, dtype=float)
    torques = np.einsum('...ij,...i->...j', kinematics.jacobian(parameters, links), force)
    scale = (parameters.l1 + parameters.l2) * np.hypot(force[..., 0], force[..., 1])
    torques = np.where(np.abs(torques) <= NO_TORQUE * scale[..., None], 0.0, torques)
    pull = pull_of_links(parameters, links)
    return torques if pull is None else torques + np.stack(pull.torque, axis=-1)


class Pull(NamedTuple):
    """Gravity on the joints; pairs of joint 1 and joint 2, floats, or arrays (n,).

    Attributes:
        torque: t, what it adds to the torques of the actuators, Nm.
        turn: k, what t loses per angle of its joint, Nm/rad.
        per_moment: -(e × g) of each link, m/s².
    """

    torque: tuple[Any, Any]
    turn: tuple[Any, Any]
    per_moment: tuple[Any, Any]


def pull_of(parameters: Parameters, link1: Any, link2: Any) -> Pull | None:
    """Gravity on links along unit vectors, complex numbers or arrays (n,) of such; None where there is none."""
    if not parameters.has_gravity:
        return None
    gravity1, gravity2 = parameters.gravity_of_links
    seen1, seen2 = -gravity1 * link1.conjugate(), -gravity2 * link2.conjugate()
    both, second = parameters.s1 * seen1 + parameters.s2 * seen2, parameters.s2 * seen2
    return Pull((both.imag, second.imag), (both.real, second.real), (seen1.imag, seen2.imag))


def pull_of_links(parameters: Parameters, links: ArrayLike) -> Pull | None:
    """Gravity on links at Q*, (n, 2), rad; None where there is none."""
    first, second = kinematics.link_vectors(parameters, links)
    return pull_of(parameters, as_complex(first) / parameters.l1, as_complex(second) / parameters.l2)
