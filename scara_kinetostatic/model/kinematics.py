"""The rigid robot: direct kinematics H, inverse G, Jacobian J (1) (2) (5); and the law of its gripper (7).

The angles here are those of the links, Q*; the offsets theta1, theta2 are added
inside. J is ∂S/∂Q by definition (2): its first column holds both links. (The J
printed under (5) lacks the l2 term in the first column, a misprint.)

**The gripper** yields along the force, in all directions alike:

    S - S* = -p_ee F - g_ee F/‖F‖        (physical; the paper prints + for the first -)

A compliance matrix beside p_ee I is the effect `anisotropic_gripper`, or another p_ee and p2.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model.arrays import Floats, Indices
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


def pose(parameters: Parameters, joints: Floats) -> Floats:
    """Place of the rigid tip, m, and direction of link 2, rad, in (-pi, pi], at joint angles (n, 2): (n, 3)."""
    direction = wrap(joints.sum(axis=1) + parameters.theta1 + parameters.theta2)
    return np.concatenate([forward(parameters, joints), direction[:, None]], axis=1)


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
