"""Compliance of the contact between tip and disc."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.base import Effect, LinearEffect, Parameter
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import Shift, TouchState

HERTZ = 2 / 3
"""Exponent of force in Hertz's law of a ball on a surface."""
OTHERS = (1 / 3, 0.5, 0.85)
"""A soft skin on a hard core sinks in early, a cone by f^(1/2); rough surfaces come near a straight line."""


@dataclass(frozen=True)
class ContactCompliance(LinearEffect):
    """Hertz's contact: the tip sinks into the disc by yield · f^(2/3), so d = -yield f^(2/3) n.

    Where the tip would have to pull, f < 0, the law continues as an odd function.

    Attributes:
        disc: number in the cell of the one disc that is soft; None for all.
        exponent: of the force; 2/3 is Hertz's.
    """

    disc: int | None = None
    exponent: float = HERTZ

    name = 'contact_compliance'
    parameters = (
        Parameter('yield', 'm/N^(2/3)', 1e-3, 'depth of the tip in the disc under 1 N', typical=1e-5, sign=1),
    )
    statement = '{target} yields under the force'
    short_statement = '{target} yields'
    confounded_with = (
        'p_ee and g_ee together, if all discs are soft and the force levels few: f^(2/3) is nearly a straight line; '
        'the radius of a soft disc, if it is touched with one force only'
    )
    identified_by = 'touches of every disc at many force levels, very small ones above all'
    plot_variable = 'magnitude'
    order = 15
    on_object = True

    @classmethod
    def of(cls, disc: int, name: str) -> ContactCompliance:
        """That of one disc, by number and name."""
        return cls(target=name, disc=disc)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        """One of all discs, and one of each where there are two or more."""
        discs = enumerate(cell.discs) if len(cell.discs) > 1 else ()
        return [cls(), *(cls.of(number, disc.name) for number, disc in discs)]

    @property
    def title(self) -> str:
        return super().title if self.target else 'surface of the discs yields'

    @property
    def finding(self) -> str:
        """One disc that yields, or all."""
        return super().finding if self.target else 'the surface of the discs yields under the force'

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return super().acts_on(at) if self.disc is None else np.asarray(at.metadata.disc == self.disc)

    def alternative_laws(self) -> tuple[ContactCompliance, ...]:
        return tuple(replace(self, exponent=exponent) for exponent in OTHERS)

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        depth = np.sign(at.magnitude) * np.abs(at.magnitude) ** self.exponent
        if self.disc is not None:
            depth = depth * (at.metadata.disc == self.disc)
        return (Shift(place=-depth[:, None] * at.normal),)
