"""A tip that is not round: lobes over the direction of contact, seen from link 2, which carries the tip.

With χ the angle from link 2 to n, the outward normal of the tip where it touches, let the tip have the support function

    h(χ) = ρ + s(χ),   s = a cos kχ + b sin kχ,

ρ its mean radius, which a disc's radius r contains. The point of a convex outline under the normal n is h n + h' t from
its centre, t = R90 n. Put in place of ρ n it gives

    H(Q*) + (r + γ) n - S_c + d = 0,   d = s n + s' t.

The outline is convex while (k² - 1) √(a² + b²) < ρ.

Of order k = 1 this is d = a v + b w, v along and w across link 2: the tip elsewhere on link 2, another l2 and theta2,
exactly. Of order k = 2, an oval, the part s n is that of `AnisotropicBacklash` with the other sign. The part s' t
turns the force by s'/r only, 0.4 mrad for 20 µm on a disc of 0.1 m, below the noise of a hundred touches; so an oval
tip is named as that backlash, unless very small discs show the difference. Both predict the same.

Where the tip presses, H̄ is the centre of the round tip that would touch there; without a force that is the centre of
this one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, LinearEffect
from scara_kinetostatic.effects.variables import VARIABLES
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, Shift, TouchState

SHAPES = {'oval': 2, 'three-lobed': 3, 'four-lobed': 4, 'five-lobed': 5}
"""Targets with their order k, the lobes of a turn. Turned and ground pins have two to five."""


@dataclass(frozen=True)
class TipShape(LinearEffect):
    """The radius of the tip has waves: d = s n + s' t, s = a cos kχ + b sin kχ, k = 2 (oval) to 5 lobes.

    χ is the angle of the force from link 2. k = 1 is another l2 and theta2. An oval tip is named `anisotropic_backlash`
    unless the discs are very small: their radial parts are the same with opposite signs, and predict the same.

    Attributes:
        lobes: k.
    """

    lobes: int = 2

    name = 'tip_shape'
    parameters = (
        Parameter('a', 'm', 1e-3, 'radius along link 2 beyond the mean', typical=4e-5),
        Parameter('b', 'm', 1e-3, 'the same at a quarter of a wave from link 2', typical=-3e-5),
    )
    statement = 'the tip is {target}, not round'
    confounded_with = (
        'l2 and theta2, of which one lobe is a part, **always**; anisotropic_backlash, if it is oval; each other, if '
        'the forces have few directions relative to link 2'
    )
    identified_by = (
        'forces from all directions relative to link 2, in both elbow postures; the same again with the tip turned in '
        'its holder shows that it is the tip'
    )
    plot_variable = 'direction_from_link2'
    force_dependence: ClassVar[ForceDependence] = ForceDependence.DIRECTION

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls(target=shape, lobes=lobes) for shape, lobes in SHAPES.items()]

    @property
    def special_cases(self) -> tuple[str, ...]:  # type: ignore[override]
        """Of an oval tip the backlash with the same radial part."""
        return ('anisotropic_backlash',) if self.lobes == 2 else ()

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        angle = self.lobes * VARIABLES['direction_from_link2'].axis(at).values[:, None]
        cosine, sine, n, t = np.cos(angle), np.sin(angle), at.normal, self.lobes * at.tangent
        return tuple(Shift(place=at.across_edges(part)) for part in (cosine * n - sine * t, sine * n + cosine * t))
