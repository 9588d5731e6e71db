"""Gravity: the torques by which it loads the joints of an arm that does not lie level.

Gravity g in the plane of the arm pulls each link down with the torque s (e × g), s its static moment and e its unit
vector. Both torques on the links have to be held by the actuators: the robot's force F on the object comes back as -F,
with the torques -JᵀF = -f a; so the actuators exert C = f a - τ,

    τ1 = s1 (e1 × g) + s2 (e2 × g),   τ2 = s2 (e2 × g),

and in (6) C replaces f a, in the dead band too: `Pull` holds t = -τ. As the links turn, t changes as the lever arms do:
dt1 = -k1 dq1 - k2 dq2, dt2 = -k2 (dq1 + dq2), with k = -(s1 e1·g + s2 e2·g, s2 e2·g). The moments of link 2 and of a
load count at the elbow for s1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import ArrayLike

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import as_complex
from scara_kinetostatic.model.parameters import Parameters


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
