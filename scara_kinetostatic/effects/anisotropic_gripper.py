"""A gripper whose compliance couples along and across link 2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scara_kinetostatic.effects.base import LinearEffect, Parameter
from scara_kinetostatic.model.effect_law import Shift, TouchState
from scara_kinetostatic.model.kinematics import quarter_turn


@dataclass(frozen=True)
class AnisotropicGripper(LinearEffect):
    """The compliance of the gripper couples along and across link 2: d = -coupling (F·v w + F·w v), w = R90 v.

    v is the direction of link 2, the coupling is p12 = p21 of P in its frame. That P differs along and across,
    p11 - p22, cannot be identified: it is another p_ee and p2. So is all of P where the arm has
    one link angle only. The lever arms' change, of second order, is left out.
    """

    name: ClassVar[str] = 'anisotropic_gripper'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter(
            'coupling', 'm/N', 1e-5, 'p12 in the frame of link 2: yield across it per force along it', typical=1e-6
        ),
    )
    statement: ClassVar[str] = 'the gripper also yields across the force'
    short_statement: ClassVar[str] = 'gripper yields across the force'
    confounded_with: ClassVar[str] = (
        'p_ee, p1 and p2, if the forces come from few directions relative to link 2; '
        'the difference p11 - p22 is always part of p_ee and p2'
    )
    identified_by: ClassVar[str] = 'forces from all directions relative to link 2, in both elbow postures'
    plot_variable: ClassVar[str] = 'direction_from_link2'
    order: ClassVar[int] = 10

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        along = at.link2
        across = quarter_turn(along)
        f_along, f_across = ((at.force * axis).sum(axis=1)[:, None] for axis in (along, across))
        return (Shift(place=-(f_along * across + f_across * along)),)
