"""Bending of a link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import LinearEffect, Parameter
from scara_kinetostatic.model.law import Shift, Situation


@dataclass(frozen=True)
class LinkBending(LinearEffect):
    """A link is an elastic beam of bending stiffness EI, clamped at its joint; compliance k = l / EI.

    Its end is loaded across by P and by a moment M, which give it the deflection y and the slope φ:

        y / l = k (P l / 3 + M / 2),   φ = k (P l / 2 + M).

    *Link 1* ends in joint 2: M = c2, and P l1 = c1 - c2 since c1 is the moment at joint 1. Its chord turns by y / l1,
    and link 2 against the chord by φ - y / l1:

        δ1 = k (c1 / 3 + c2 / 6),   δ2 = k (c1 / 6 + c2 / 3).

    The parts c1 / 3 and c2 / 3 are another p1 and p2; only the coupling of the joints, c / 6, is new.

    *Link 2* ends in the tip: M = 0, P l2 = c2, and δ2 = k c2 / 3. That is another p2, exactly: it can never be seen.

    Attributes:
        link: 0 or 1.
    """

    link: int = 0

    name: ClassVar[str] = 'link_bending'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('compliance', 'rad/Nm', 1e-3, 'length over bending stiffness, l / EI'),
    )
    hides_behind: ClassVar[str] = (
        'p1 and p2, if the torques of the joints are nearly in proportion; bending of link 2 hides in p2 always'
    )
    reveal: ClassVar[str] = 'touches in which the torques of the two joints differ much, also in sign'
    betrays: ClassVar[str] = 'link1_torque'

    @classmethod
    def of(cls, link: int) -> LinkBending:
        """That of link 0 or 1."""
        return cls(target=f'link{link + 1}', link=link)

    def basis(self, at: Situation) -> tuple[Shift, ...]:
        c1, c2 = at.torques.T
        if self.link == 0:
            return (Shift(joints=np.stack([c1 / 3 + c2 / 6, c1 / 6 + c2 / 3], axis=-1)),)
        return (Shift(joints=np.stack([np.zeros_like(c2), c2 / 3], axis=-1)),)
