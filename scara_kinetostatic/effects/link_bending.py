"""Bending of a link."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from scara_kinetostatic.effects.base import Effect, LinearEffect, Parameter, at_joint
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import Shift, TouchState

HINGES = (0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.75, 0.8)
"""Places of a hinge, as parts of the length of link 1, for the alternative laws."""


@dataclass(frozen=True)
class LinkBending(LinearEffect):
    """A link is an elastic beam of bending stiffness EI, clamped at its joint; compliance k = l / EI.

    Its end is loaded across by P and by a moment M, which give it the deflection y and the slope φ:

        y / l = k (P l / 3 + M / 2),   φ = k (P l / 2 + M).

    *Link 1* ends in joint 2: M = c2, and P l1 = c1 - c2 since c1 is the moment at joint 1. Its chord turns by y / l1,
    and link 2 against the chord by φ - y / l1:

        δ1 = k (c1 / 3 + c2 / 6),   δ2 = k (c1 / 6 + c2 / 3).

    The parts c1 / 3 and c2 / 3 are another p1 and p2; only the coupling of the joints, c / 6, is independent of them.

    Where the link is no even beam, only the parts for c1 in δ1 and c2 in δ2 differ. A hinge at the part s of its
    length, an elastic flange or a soft section, gives

        δ1 = k' ((1 - s)² c1 + s (1 - s) c2),   δ2 = k' (s (1 - s) c1 + s² c2).

    *Link 2* ends in the tip: M = 0, P l2 = c2, and δ2 = k c2 / 3. That is another p2, exactly: it cannot be identified.

    Attributes:
        link: 0 or 1.
        hinge: part of the length of link 1 at which it bends; None for an even beam.
    """

    link: int = 0
    hinge: float | None = None

    name = 'link_bending'
    parameters = (
        Parameter('compliance', 'rad/Nm', 1e-3, 'length over bending stiffness, l / EI', typical=1e-5, sign=1),
    )
    statement = '{target} bends'
    short_statement = '{target} bends'
    confounded_with = (
        'p1 and p2, if the torques of the joints are nearly in proportion; bending of link 2 is always part of p2'
    )
    identified_by = 'touches in which the torques of the two joints differ much, also in sign'
    plot_variable = 'link1_torque'
    order = 12

    @classmethod
    def of(cls, link: int) -> LinkBending:
        """That of link 0 or 1."""
        return cls(target=f'link{link + 1}', link=link)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls.of(link) for link in (0, 1)]

    def alternative_laws(self) -> tuple[LinkBending, ...]:
        return () if self.link else tuple(replace(self, hinge=hinge) for hinge in HINGES)

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        c1, c2 = at.torques.T
        if self.link == 0:
            first, second = (1 / 3, 1 / 3) if self.hinge is None else self._beside_coupling(self.hinge)
            return (Shift(joints=np.array([first * c1 + c2 / 6, c1 / 6 + second * c2]).T),)
        return (Shift(joints=at_joint(c2 / 3, 1)),)

    @staticmethod
    def _beside_coupling(hinge: float) -> tuple[float, float]:
        """The parts for c1 in δ1 and c2 in δ2 of a hinge whose coupling is that of the even beam, 1/6."""
        return (1 - hinge) / hinge / 6, hinge / (1 - hinge) / 6
