"""Friction between tip and disc that takes either sense and any size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from scara_kinetostatic.effects.base import Effect, Floats, Parameter
from scara_kinetostatic.model.law import Shift, TouchState


@dataclass(frozen=True)
class OffNormalForce(Effect):
    """Friction as it is: in every touch the force leans from the normal by an angle of its own.

    A tip that creeps while the joints give way comes to rest with a tangential force of either sense and any size
    up to μN. The sensor measures it with the rest, so "the tip lies on the circle" holds and only "the force is
    radial" breaks. So each touch has a lean α of its own, Gaussian about zero with the standard deviation `lean`; it is
    adjusted with the observations, d = r (R(-α) - I) n. Nothing predicts it: where a force is predicted, its lean is
    read off the measured one.

    Attributes:
        lean: standard deviation of α, rad; the coefficient of friction is larger than it.
    """

    off_normal: float = 0.05

    name: ClassVar[str] = 'contact_friction'
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    confounded_with: ClassVar[str] = 'noise of the force sensor, if all forces are alike'
    identified_by: ClassVar[str] = 'touches at several force levels: friction grows with the force, noise does not'
    plot_variable: ClassVar[str] = 'magnitude'
    statement: ClassVar[str] = 'friction between tip and disc turns the contact force, by another angle in each touch'
    on_object: ClassVar[bool] = True

    @property
    def off_normal_std(self) -> float:
        """The standard deviation of the lean."""
        return self.off_normal

    def shift(self, at: TouchState, values: Floats) -> Shift:
        along, across = at.radii * (np.cos(at.off_normal) - 1), -at.radii * np.sin(at.off_normal)
        return Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent)

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return ()
