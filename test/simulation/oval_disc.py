"""An effect outside the list, as a user would write one: a disc that is not round."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import DiscEffect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.extended_model import Parameter, TouchState


@dataclass(frozen=True)
class OvalDisc(DiscEffect):
    """Support function r + a cos 2(ψ - ψ0): the normal ψ stays where it is, the place of contact moves.

    The point of a convex outline with support h(ψ) under the normal N is h N + h' T. The outward normal is -n, so
    d = -((h - r) N + h' T).
    """

    name: ClassVar[str] = 'oval_disc'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('cosine', 'm', 1e-4, 'half the difference of the radii along x and y'),
        Parameter('sine', 'm', 1e-4, 'the same along the diagonals'),
    )
    statement: ClassVar[str] = '{target} is not round'
    confounded_with: ClassVar[str] = 'nothing'
    identified_by: ClassVar[str] = 'touches all around the disc'
    plot_variable: ClassVar[str] = 'place'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        outward, around = -at.normal, np.stack([at.normal[:, 1], -at.normal[:, 0]], axis=-1)
        angle = 2 * np.arctan2(outward[:, 1], outward[:, 0])
        return tuple(
            -(support[:, None] * outward + slope[:, None] * around)
            for support, slope in ((np.cos(angle), -2 * np.sin(angle)), (np.sin(angle), 2 * np.cos(angle)))
        )
