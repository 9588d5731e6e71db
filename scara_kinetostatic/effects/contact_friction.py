"""Friction between tip and disc."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, Floats, Parameter
from scara_kinetostatic.model.extension import Shift, Situation


def slide(at: Situation) -> Floats:
    """Sense in which the last movement before the hold drags the tip along the disc: of t·J ΔQ, (n,), +1, -1 or 0.

    t runs around the disc at the rigid tip H(L, Q). Taken at the measured angles the sense is given with the touch:
    seen along the force, which leans by it, a tip pressed along the normal would have neither.
    """
    p = at.parameters
    links = at.joints + (p.theta1, p.theta2)
    first, second = links[:, 0], links.sum(axis=1)
    x2, y2 = p.l2 * np.cos(second), p.l2 * np.sin(second)
    x1, y1 = p.l1 * np.cos(first) + x2, p.l1 * np.sin(first) + y2
    turn1, turn2 = at.tags.approach.T
    move_x, move_y = -y1 * turn1 - y2 * turn2, x1 * turn1 + x2 * turn2
    inward_x, inward_y = at.centers[:, 0] - p.x0 - x1, at.centers[:, 1] - p.y0 - y1
    return np.asarray(np.sign(inward_x * move_y - inward_y * move_x))


@dataclass(frozen=True)
class ContactFriction(Effect):
    """Coulomb friction: the tip drags the disc along, so the force leans in the sense of the slide.

    The force on the object is turned by α = coefficient · sense from the disc's inward normal: the tip touches at
    S_c - r R(-α) n, so d = r (R(-α) - I) n. The coefficient is the angle of friction, which is μ up to μ³/3.
    """

    name: ClassVar[str] = 'contact_friction'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('coefficient', '1', 0.1, 'angle of friction: that of the force from the normal'),
    )
    hides_behind: ClassVar[str] = 'a turned force sensor, if the tip slides the same way in all touches'
    reveal: ClassVar[str] = (
        'touches that slide in both senses: press beyond the force and let it down, every other time'
    )
    betrays: ClassVar[str] = 'slide'
    on_object: ClassVar[bool] = True

    def shift(self, at: Situation, values: Floats) -> Shift:
        lean = values[0] * slide(at)
        along, across = at.radii * (np.cos(lean) - 1), -at.radii * np.sin(lean)
        return Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent)

    def derivative(self, at: Situation, values: Floats) -> tuple[Shift, ...]:
        sense = slide(at)
        lean = values[0] * sense
        along, across = -at.radii * np.sin(lean) * sense, -at.radii * np.cos(lean) * sense
        return (Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent),)
