"""The law of the joints (6), compliance and backlash, and the torques (8) that it takes.

sign(c) in (6) is set-valued at c = 0: inside its backlash the joint floats and
q - q* is anywhere in [-g, g]. Where a torque vanishes, `slack` in [-1, 1] says
where in the dead band the joint is, 0 being its middle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats, as_complex
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch_equations import Pull, pull_of


def joint_deflection(parameters: Parameters, torques: ArrayLike, slack: ArrayLike = 0.0) -> Floats:
    """Law of the joints (6): q - q* = p c + g sign(c).

    Args:
        parameters: L̄.
        torques: C, (n, 2), Nm.
        slack: place in the dead band where a torque is zero, in [-1, 1].

    Returns:
        q - q*, (n, 2), rad.
    """
    torques = np.asarray(torques, dtype=float)
    sign = np.where(torques == 0, slack, np.sign(torques))
    return parameters.joint_compliances[:, 0] * torques + parameters.joint_backlashes[:, 0] * sign


def joint_torques(parameters: Parameters, links: ArrayLike, force: ArrayLike) -> Floats:
    """Torques C = JᵀF (2) (8), with J at the link angles Q*, and what holds the arm against gravity.

    Without gravity they are exact zeros below 1e-13 of force times arm length.

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
    torques = np.where(np.abs(torques) <= 1e-13 * scale[..., None], 0.0, torques)
    pull = pull_of_links(parameters, links)
    return torques if pull is None else torques + pull.torque.T


def pull_of_links(parameters: Parameters, links: ArrayLike) -> Pull | None:
    """Gravity on links at Q*, (n, 2), rad; None where there is none."""
    first, second = kinematics.link_vectors(parameters, links)
    return pull_of(parameters, as_complex(first) / parameters.l1, as_complex(second) / parameters.l2)
