"""Gain of an encoder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scara_kinetostatic.effects.base import JointEffect, Parameter
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, TouchState


@dataclass(frozen=True)
class EncoderGain(JointEffect):
    """The encoder reports q where the actuator is at (1 + gain) q: δ = -gain q.

    A torque on the joint that grows with its angle, as a cable or a spring makes it, looks the same.
    """

    name: ClassVar[str] = 'encoder_gain'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('gain', '1', 1e-2, 'true angle over reported, less 1', typical=1e-3),
    )
    statement: ClassVar[str] = 'the encoder of {target} has a gain error'
    short_statement: ClassVar[str] = 'gain error of the encoder of {target}'
    confounded_with: ClassVar[str] = 'the offset of the joint, if its angle hardly varies; a torque that grows with it'
    identified_by: ClassVar[str] = 'touches over the whole range of the joint, in both elbow postures'
    plot_variable: ClassVar[str] = 'angle'
    order: ClassVar[int] = 5
    force_dependence: ClassVar[ForceDependence] = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.joints[:, self.joint],)
