"""Hysteresis of a joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Floats, JointEffect, Parameter
from scara_kinetostatic.model.law import TouchState


@dataclass(frozen=True)
class JointHysteresis(JointEffect):
    """Coulomb friction in the transmission: the link stays behind the actuator by δ = width · sense of approach.

    The friction torque τ winds the spring up beside the load, so that width = p τ.
    """

    name: ClassVar[str] = 'joint_hysteresis'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('width', 'rad', 1e-3, 'by which the link stays behind, half the width of the loop'),
    )
    confounded_with: ClassVar[str] = 'the backlash of the joint, if it always moves on in the sense of its torque'
    identified_by: ClassVar[str] = (
        'touches reached from both sides: press beyond the force and let it down, every other time'
    )
    plot_variable: ClassVar[str] = 'approach'
    statement: ClassVar[str] = '{target} has hysteresis beyond its backlash'

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (np.sign(at.metadata.approach[:, self.joint]),)
