"""Friction between tip and disc."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, Floats, Parameter
from scara_kinetostatic.model.extension import Shift, Situation


def slide(at: Situation) -> Floats:
    """Sense in which the last movement before the hold drags the tip along the disc: of t·J ΔQ, (n,), +1, -1 or 0."""
    p = at.parameters
    x, y = p.l2 * at.link2[:, 0], p.l2 * at.link2[:, 1]
    x_all, y_all = x + p.l1 * at.link1[:, 0], y + p.l1 * at.link1[:, 1]
    dq1, dq2 = at.tags.approach.T
    move = np.stack([-y_all * dq1 - y * dq2, x_all * dq1 + x * dq2], axis=-1)
    return np.asarray(np.sign((move * at.tangent).sum(axis=1)))


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
