"""The rigid robot: direct kinematics H, inverse G, Jacobian J (1) (2) (5).

The angles here are those of the links, Q*; the offsets theta1, theta2 are added
inside. J is ∂S/∂Q by definition (2): its first column holds both links. (The J
printed under (5) lacks the l2 term in the first column, a misprint.)
"""

from __future__ import annotations

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
