"""Friction between tip and disc."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, Parameter
from scara_kinetostatic.effects.variables import VARIABLES, PlotAxis, slide
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState
from scara_kinetostatic.model.parameters import Parameters


@dataclass(frozen=True)
class ContactFriction(Effect):
    """Coulomb friction: the tip drags the disc along, so the force is turned in the direction of the slide.

    The force on the object is turned by α = coefficient · slide from the disc's inward normal: the tip touches at
    S_c - r R(-α) n, so d = r (R(-α) - I) n. The coefficient is the angle of friction, which is μ up to μ³/3. A tip
    pressed along the normal does not slide: it sticks, and the force is turned by less than the angle of friction.

    Attributes:
        reference: L̄ by which the slide is judged, such as the nominal one: held, so that no touch
            changes its direction while L̄ is estimated; None for L̄ itself.
    """

    reference: Parameters | None = None

    name: ClassVar[str] = 'contact_friction'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('coefficient', '1', 0.1, 'angle of friction: that of the force from the normal', typical=0.1, sign=1),
    )
    statement: ClassVar[str] = 'friction between tip and disc turns the contact force, in the direction of the slide'
    short_statement: ClassVar[str] = 'friction at the contact'
    confounded_with: ClassVar[str] = 'a turned force sensor, if the tip slides the same way in all touches'
    identified_by: ClassVar[str] = 'touches that slide in both directions: preload every other touch'
    plot_variable: ClassVar[str] = 'slide'
    order: ClassVar[int] = 1
    force_dependence: ClassVar[ForceDependence] = ForceDependence.DIRECTION
    on_object: ClassVar[bool] = True

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        """One, its slide judged by the nominal parameters."""
        return [cls(reference=cell.nominal)]

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        """The slide as the effect judges it."""
        return VARIABLES[self.plot_variable].axis(at)._replace(values=slide(at, self.reference))

    def shift(self, at: TouchState, values: Floats) -> Shift:
        off_normal = values[0] * slide(at, self.reference)
        along, across = at.radii * (np.cos(off_normal) - 1), -at.radii * np.sin(off_normal)
        return Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent)

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        direction = slide(at, self.reference)
        off_normal = values[0] * direction
        along, across = -at.radii * np.sin(off_normal) * direction, -at.radii * np.cos(off_normal) * direction
        return (Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent),)
