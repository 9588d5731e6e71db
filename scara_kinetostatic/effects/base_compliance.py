"""Compliance of the base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from scara_kinetostatic.effects.base import LinearEffect, Parameter
from scara_kinetostatic.model.effect_law import Shift, TouchState


@dataclass(frozen=True)
class BaseCompliance(LinearEffect):
    """The robot stands on springs: pushed by -F, its base moves by d = -[[excess, coupling], [coupling, -excess]] F.

    That is the part of a compliance matrix, in the base frame, that the base model lacks: what is the same in
    all directions is another p_ee, what turns the base about joint 1 another p1.
    """

    name = 'base_compliance'
    parameters = (
        Parameter(
            'excess', 'm/N', 1e-5, 'yield along x beyond the mean of x and y; as much less along y', typical=1e-6
        ),
        Parameter('coupling', 'm/N', 1e-5, 'yield along y per force along x', typical=-2e-6),
    )
    statement = 'the base yields under the force'
    short_statement = 'base yields'
    confounded_with = (
        'the compliances of gripper and joints, if the arm hardly turns; '
        'its mean over all directions is always part of p_ee'
    )
    identified_by = 'forces in all directions of the base frame, with the arm turned many ways'
    plot_variable = 'direction'
    order = 13

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        x, y = at.force.T
        return Shift(place=np.array([-x, y]).T), Shift(place=np.array([-y, -x]).T)
