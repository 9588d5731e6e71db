"""The law of an elastic part with backlash, a joint (6) or the gripper (7), and the torques (2) (8) of the joints.

    q - q* = p c + g s(c),    s(c) = sign(c).

sign(c) is set-valued at c = 0: inside its backlash the part floats and q - q* is anywhere in [-g, g]. There s is the
place in the dead band, from -1 to 1, 0 being its middle. It is given (the flank on which a joint rests), or a
continuous function of the load: a straight line across a band |c| < b, where the sign is not known (`place_in_band`),
or `rounded_sign`. Solved for the load, the law is a spring with a dead zone, p c = dz(q - q*; g) (`beyond_gap`).

**Newton's method.** With rows on_i (q_i* - q_i) + w_i c_i + g_i s_i of both joints, whose torques lose t_i as joint i
turns,

    M = ∂rows/∂Q* = [[on1 - w1 t1, -w1 t2], [-w2 t2, on2 - w2 t2]],

w being p on a flank, p + g ∂s/∂c inside a band. A joint that floats has on = 0, and the torque alone for a row.
"""

from __future__ import annotations

from math import copysign
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.gravity import pull_of_links
from scara_kinetostatic.model.parameters import Parameters

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
