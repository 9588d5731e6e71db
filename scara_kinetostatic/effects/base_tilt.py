"""A base that is tilted against gravity (paper, section 2.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scara_kinetostatic.effects.base import LinearEffect, Parameter, at_joint
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState


@dataclass(frozen=True)
class BaseTilt(LinearEffect):
    """The part of gravity that lies in the plane of the arm loads the joints.

    With γ the acceleration in the plane (9.81 m/s² times the tilt), s1 the static moment along link 1 of the arm beyond
    joint 1 and s2 that along link 2 of the arm beyond joint 2 (kg m), M1 = s1 γ and M2 = s2 γ (Nm), u and v the
    directions of the links and a × b = a_x b_y - a_y b_x, gravity turns the joints by

        t1 = u × M1 + v × M2,   t2 = v × M2.

    The actuators hold only what it leaves, C - t, so q - q* = p (c - t) + …: δ_i = -p_i t_i. That the
    flank of the backlash might change as well is left out. M1 and M2 are
    taken as independent of each other, though both point downhill.
    """

    name = 'base_tilt'
    parameters = (
        Parameter('m1_x', 'Nm', 10.0, 'static moment along link 1 times gravity along x', typical=2.0),
        Parameter('m1_y', 'Nm', 10.0, 'static moment along link 1 times gravity along y', typical=-1.0),
        Parameter('m2_x', 'Nm', 10.0, 'static moment along link 2 times gravity along x', typical=0.8),
        Parameter('m2_y', 'Nm', 10.0, 'static moment along link 2 times gravity along y', typical=-0.4),
    )
    statement = 'the base is tilted, so that gravity loads the joints'
    short_statement = 'base tilted'
    confounded_with = (
        'a transmission error of joint 1 of one cycle per turn, which m1 alone exactly is; the base position and the '
        'offsets, if there is one elbow posture'
    )
    identified_by = 'touches all over the workspace in both elbow postures; a level shows the tilt itself'
    plot_variable = 'angle'
    order = 14
    force_dependence = ForceDependence.NONE
    scaled_by = ('p1', 'p2')

    def random_values(self, random: np.random.Generator) -> Floats:
        """Of plausible size, both moments pointing downhill."""
        angle, (first, second) = random.uniform(0, 2 * np.pi), random.uniform(0.3, 1.0, 2)
        downhill = np.array([np.cos(angle), np.sin(angle)])
        return np.array(self.scales) * np.concatenate([first * downhill, second * downhill])

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        first = [-at.parameters.p1 * torque for torque in _torques(at.link1)]
        second = [np.array([-at.parameters.p1 * torque, -at.parameters.p2 * torque]).T for torque in _torques(at.link2)]
        return (*(Shift(joints=at_joint(angle, 0)) for angle in first), *(Shift(joints=angles) for angles in second))


def _torques(link: Floats) -> tuple[Floats, Floats]:
    """Torque link × M per unit of M_x and of M_y, (n,) each."""
    return -link[:, 1], link[:, 0]
