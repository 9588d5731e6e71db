"""A disc of another radius than stated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from scara_kinetostatic.effects.base import DiscEffect, Parameter
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, TouchState
from scara_kinetostatic.model.quantity import quantity


@dataclass(frozen=True)
class ObjectRadius(DiscEffect):
    """The disc is larger by `radius` than stated: d = radius · n."""

    name: ClassVar[str] = 'object_radius'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('radius', 'm', 1e-3, 'true radius less the stated one', typical=1e-4),
    )
    statement: ClassVar[str] = '{target} has another radius than the cell description says'
    short_statement: ClassVar[str] = '{target} of another radius'
    confounded_with: ClassVar[str] = 'g_ee, if there is one disc: all radii larger is a smaller backlash of the gripper'
    identified_by: ClassVar[str] = 'touches of two or more discs, all round each'
    plot_variable: ClassVar[str] = 'disc'
    order: ClassVar[int] = 17
    force_dependence: ClassVar[ForceDependence] = ForceDependence.DIRECTION

    def correction(self, values: Mapping[str, float]) -> str:
        error = values['radius']
        size = f'{quantity(abs(error), "m")} {"larger" if error > 0 else "smaller"}'
        return f'measure the radius of {self.target} again: it is {size}'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        return (at.normal,)
