"""Hysteresis of a joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scara_kinetostatic.effects.base import JointEffect, Parameter
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, TouchState


@dataclass(frozen=True)
class JointHysteresis(JointEffect):
    """Coulomb friction in the transmission: the link lags the actuator by δ = width · direction of approach.

    The friction torque τ acts on the spring beside the load, so that width = p τ.
    """

    name = 'joint_hysteresis'
    parameters = (Parameter('width', 'rad', 1e-3, 'lag of the link, half the width of the loop', typical=1e-4, sign=1),)
    statement = '{target} has hysteresis beyond its backlash'
    short_statement = 'hysteresis in {target}'
    confounded_with = 'the backlash of the joint, if it always moves on in the direction of its torque'
    identified_by = 'touches reached from both sides: preload every other touch'
    plot_variable = 'approach'
    order = 8
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (np.sign(at.metadata.approach[:, self.joint]),)
