"""A joint whose compliance depends on the torque."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scara_kinetostatic.effects.base import Floats, JointEffect, Parameter
from scara_kinetostatic.model.extension import Situation


@dataclass(frozen=True)
class JointHardening(JointEffect):
    """Beside p c the joint gives way by δ = -rate c³: it hardens for a positive rate, softens for a negative one.

    With rate > 0 the law turns round at c = √(p / 3 rate); it holds for torques below that.
    """

    name: ClassVar[str] = 'joint_hardening'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('rate', 'rad/(Nm)^3', 1e-6, 'by which the deflection falls short of p c, over c³'),
    )
    hides_behind: ClassVar[str] = 'compliance and backlash of the joint, if its torques are alike in size'
    reveal: ClassVar[str] = 'touches with torques on the joint from small to large, in three or more steps'
    betrays: ClassVar[str] = 'torque'

    def angles(self, at: Situation) -> tuple[Floats, ...]:
        return (-(at.torques[:, self.joint] ** 3),)
