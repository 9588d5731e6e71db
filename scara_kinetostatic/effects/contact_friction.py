"""Friction between tip and disc."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, Floats, Parameter
from scara_kinetostatic.model.law import Shift, TouchState
from scara_kinetostatic.model.parameters import Parameters

STICKING = 0.1
"""A tip that comes within this angle of the normal sticks, as a usual coefficient of friction has it, rad."""


def slide(at: TouchState, reference: Parameters | None = None) -> Floats:
    """How far the last movement in contact drags the tip aside, (n,): +1 or -1, or between where the tip sticks.

    It is the part along t of the movement J ΔQ, as a part of the whole; -1 and 1 are reached at `STICKING`. Both the
    movement and t = R90 n are those of the rigid tip at the measured angles.

    Args:
        at: the touches.
        reference: L̄ by which the tip is placed; None for that of the touches.
    """
    p = reference or at.parameters
    links = at.joints + np.array([p.theta1, p.theta2])
    first, second = links[:, 0], links.sum(axis=1)
    x2, y2 = p.l2 * np.cos(second), p.l2 * np.sin(second)
    x1, y1 = p.l1 * np.cos(first) + x2, p.l1 * np.sin(first) + y2
    turn1, turn2 = at.metadata.press.T
    move_x, move_y = -y1 * turn1 - y2 * turn2, x1 * turn1 + x2 * turn2
    inward_x, inward_y = at.centers[:, 0] - p.x0 - x1, at.centers[:, 1] - p.y0 - y1
    size = np.hypot(inward_x, inward_y) * np.hypot(move_x, move_y)
    aside = (inward_x * move_y - inward_y * move_x) / np.where(size > 0, size, 1.0)
    return np.asarray(np.clip(aside / STICKING, -1.0, 1.0))


@dataclass(frozen=True)
class ContactFriction(Effect):
    """Coulomb friction: the tip drags the disc along, so the force leans in the sense of the slide.

    The force on the object is turned by α = coefficient · slide from the disc's inward normal: the tip touches at
    S_c - r R(-α) n, so d = r (R(-α) - I) n. The coefficient is the angle of friction, which is μ up to μ³/3. A tip
    pressed along the normal does not slide: it sticks, and the force leans as it came, less than by friction.

    Attributes:
        reference: L̄ by which the slide is judged, such as the nominal one: held, so that no touch
            changes its sense while L̄ is estimated; None for L̄ itself.
    """

    reference: Parameters | None = None

    name: ClassVar[str] = 'contact_friction'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('coefficient', '1', 0.1, 'angle of friction: that of the force from the normal'),
    )
    confounded_with: ClassVar[str] = 'a turned force sensor, if the tip slides the same way in all touches'
    identified_by: ClassVar[str] = (
        'touches that slide in both senses: press beyond the force and let it down, every other time'
    )
    plot_variable: ClassVar[str] = 'slide'
    statement: ClassVar[str] = 'friction between tip and disc turns the contact force, in the sense of the slide'
    on_object: ClassVar[bool] = True

    def shift(self, at: TouchState, values: Floats) -> Shift:
        off_normal = values[0] * slide(at, self.reference)
        along, across = at.radii * (np.cos(off_normal) - 1), -at.radii * np.sin(off_normal)
        return Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent)

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        sense = slide(at, self.reference)
        off_normal = values[0] * sense
        along, across = -at.radii * np.sin(off_normal) * sense, -at.radii * np.cos(off_normal) * sense
        return (Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent),)
