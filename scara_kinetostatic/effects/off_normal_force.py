"""Friction between tip and disc that takes either direction and any size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, Parameter
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState


@dataclass(frozen=True)
class OffNormalForce(Effect):
    """Friction of a creeping tip: in every touch the force is off the normal by an angle of its own.

    A tip that creeps while the joints deflect comes to rest with a tangential force of either direction and any size
    up to μN. The sensor measures it with the rest, so "the tip lies on the circle" holds and only "the force is
    radial" breaks. So each touch has an off-normal angle α of its own, Gaussian about zero with the standard deviation
    `off_normal`; it is adjusted with the observations, d = r (R(-α) - I) n. It cannot be predicted: where a force is
    predicted, its off-normal angle is that of the measured one.

    The diagnosis tests it beside the effects of the catalogue, as a variance: `diagnosis.noise_structure`.

    Attributes:
        off_normal: standard deviation of α, rad; the coefficient of friction is larger than it.
    """

    off_normal: float = 0.05

    name: ClassVar[str] = 'contact_friction'
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    statement: ClassVar[str] = (
        'friction between tip and disc turns the contact force, by a different angle in each touch'
    )
    short_statement: ClassVar[str] = 'friction at the contact, of either sense'
    confounded_with: ClassVar[str] = 'noise of the force sensor, if all forces are alike'
    identified_by: ClassVar[str] = 'touches at several force levels: friction grows with the force, noise does not'
    plot_variable: ClassVar[str] = 'magnitude'
    on_object: ClassVar[bool] = True
    force_dependence: ClassVar[ForceDependence] = ForceDependence.DIRECTION

    @property
    def off_normal_std(self) -> float:
        """The standard deviation of α."""
        return self.off_normal

    def with_off_normal_std(self, std: float) -> OffNormalForce:
        return replace(self, off_normal=std)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return []

    def shift(self, at: TouchState, values: Floats) -> Shift:
        along, across = at.radii * (np.cos(at.off_normal) - 1), -at.radii * np.sin(at.off_normal)
        return Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent)

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return ()
