"""Gain of an encoder."""

from __future__ import annotations

from dataclasses import dataclass

from scara_kinetostatic.effects.base import JointEffect, Parameter
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, TouchState


@dataclass(frozen=True)
class EncoderGain(JointEffect):
    """The encoder reports q where the actuator is at (1 + gain) q: δ = -gain q.

    A torque on the joint that grows with its angle, as a cable or a spring makes it, looks the same.
    """

    name = 'encoder_gain'
    parameters = (Parameter('gain', '1', 1e-2, 'true angle over reported, less 1', typical=1e-3),)
    statement = 'the encoder of {target} has a gain error'
    short_statement = 'gain error of the encoder of {target}'
    confounded_with = 'the offset of the joint, if its angle hardly varies; a torque that grows with it'
    identified_by = 'touches over the whole range of the joint, in both elbow postures'
    plot_variable = 'angle'
    order = 5
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.joints[:, self.joint],)
