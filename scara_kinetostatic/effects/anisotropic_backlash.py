"""Backlash of the gripper that depends on the direction of the force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from scara_kinetostatic.effects.base import LinearEffect, Parameter
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState


@dataclass(frozen=True)
class AnisotropicBacklash(LinearEffect):
    """The gripper has more backlash in one direction than in another: d = -(a cos 2χ + b sin 2χ) n.

    χ is the angle of the force from link 2. That the tip slides aside in a gap that is not round only turns the
    force by some milliradians; it is left out.
    """

    name: ClassVar[str] = 'anisotropic_backlash'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('a', 'm', 1e-3, 'backlash along link 2 beyond the mean; as much less across it', typical=4e-5),
        Parameter('b', 'm', 1e-3, 'backlash at 45° to link 2 beyond the mean', typical=-3e-5),
    )
    statement: ClassVar[str] = 'the backlash of the gripper depends on the direction of the force'
    short_statement: ClassVar[str] = 'backlash of the gripper depends on the direction'
    confounded_with: ClassVar[str] = (
        'an anisotropic compliance of the gripper, and g_ee and g2, if there is one force level or few directions'
    )
    identified_by: ClassVar[str] = 'forces from all directions relative to link 2, at several levels, small ones too'
    plot_variable: ClassVar[str] = 'direction_from_link2'
    order: ClassVar[int] = 11
    force_dependence: ClassVar[ForceDependence] = ForceDependence.DIRECTION

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        along = (at.normal * at.link2).sum(axis=1)
        across = at.normal[:, 1] * at.link2[:, 0] - at.normal[:, 0] * at.link2[:, 1]
        waves = along**2 - across**2, 2 * along * across
        return tuple(Shift(place=-wave[:, None] * at.normal) for wave in waves)
