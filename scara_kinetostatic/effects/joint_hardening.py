"""A joint whose compliance depends on the torque."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scara_kinetostatic.effects.base import JointEffect, Parameter
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import TouchState

OTHERS = (0.5, 2, 5)
"""Powers of a spring that is soft about zero, of one whose stiffness changes evenly, and of one that stiffens late."""


@dataclass(frozen=True)
class JointHardening(JointEffect):
    """Beside p c the joint deflects by δ = -rate c³: it hardens for a positive rate, softens for a negative one.

    With rate > 0 the law turns round at c = √(p / 3 rate); it holds for torques below that. Up to there its trace stays
    small: the reduced chi-square rises by 0.03 to 0.06, by 0.4 at most. So simulations take a negative rate.

    Attributes:
        power: of the torque, odd as a function; 3 is the first term that a smooth spring has beside p c.
    """

    power: float = 3

    name = 'joint_hardening'
    statement = 'the compliance of {target} depends on the torque'
    short_statement = 'compliance of {target} depends on the torque'
    confounded_with = 'compliance and backlash of the joint, if its torques are alike in size'
    identified_by = 'touches with torques on the joint from small to large, in three or more steps'
    plot_variable = 'torque'
    order = 7

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """The rate; its plausible size is that of a milliradian at 10 Nm."""
        meaning = f'by which the deflection falls short of p c, over c^{self.power:g}'
        return (
            Parameter(
                'rate',
                f'rad/(Nm)^{self.power:g}',
                1e-3 / 10**self.power,
                meaning,
                typical=1e-6 / 10**self.power,
                sign=-1,
            ),
        )

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        torque = at.torques[:, self.joint]
        return (-np.sign(torque) * np.abs(torque) ** self.power,)

    def alternative_laws(self) -> tuple[JointHardening, ...]:
        return tuple(replace(self, power=power) for power in OTHERS)
