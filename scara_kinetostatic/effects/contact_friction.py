"""Friction at the contact, with all discs or with one: in the direction of the slide, or of either sense."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from scara_kinetostatic.effects.base import Effect, EffectOfDiscs
from scara_kinetostatic.effects.variables import VARIABLES, PlotAxis, slide
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, Shift, TouchState


@dataclass(frozen=True)
class ContactFriction(EffectOfDiscs):
    """Coulomb friction: the tip drags the disc along, so the force is turned in the direction of the slide.

    The force on the object is turned by α = coefficient · slide from the disc's inward normal: the tip touches at
    S_c - r R(-α) n, so d = r (R(-α) - I) n. The coefficient is the angle of friction, which is μ up to μ³/3. A tip
    pressed along the normal does not slide: it sticks, and the force is turned by less than the angle of friction.

    Where touches do not say how the tip moved, that of one disc turns the force by the same angle in all of them,
    counter-clockwise above 0: as if it slid to one side always. That of all discs is then a turned force sensor.
    """

    name = 'contact_friction'
    parameters = (
        Parameter('coefficient', '1', 0.1, 'angle of friction: that of the force from the normal', typical=0.1, sign=1),
    )
    statement = 'friction between the tip and {target} turns the contact force, in the direction of the slide'
    confounded_with = (
        'a turned force sensor, if the tip slides the same way in all touches; that of one disc with that of all, if '
        'no other is touched, where they are the same'
    )
    identified_by = 'touches that slide in both directions on two or more discs: preload every other touch'
    plot_variable = 'slide'
    force_dependence = ForceDependence.DIRECTION

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        """The slide as the effect judges it."""
        return VARIABLES[self.plot_variable].axis(at)._replace(values=self._direction(at))

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return _off_normal(at, values[0] * self._direction(at))

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        direction = self._direction(at)
        angle = values[0] * direction
        along, across = -at.radii * np.sin(angle) * direction, -at.radii * np.cos(angle) * direction
        return (Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent),)

    def _direction(self, at: TouchState) -> Floats:
        """The slide, (n,); 0 on discs without friction; of one disc +1 where the movement is unknown."""
        known = at.metadata.press.any(axis=1) | (self.disc is None)
        return np.asarray(np.where(known, slide(at), 1.0) * self.acts_on(at))


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

    name = 'contact_friction'
    parameters = ()
    statement = 'friction between tip and disc turns the contact force, by a different angle in each touch'
    confounded_with = 'noise of the force sensor, if all forces are alike'
    identified_by = 'touches at several force levels: friction grows with the force, noise does not'
    plot_variable = 'magnitude'
    on_object = True
    force_dependence = ForceDependence.DIRECTION

    @property
    def off_normal_std(self) -> float:
        """The standard deviation of α."""
        return self.off_normal

    def with_off_normal_std(self, std: float) -> OffNormalForce:
        return replace(self, off_normal=std)

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return _off_normal(at, at.off_normal)

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return ()


def _off_normal(at: TouchState, angle: Floats) -> Shift:
    """D = r (R(-α) - I) n of forces off the normal by angles α, (n,), rad."""
    along, across = at.radii * (np.cos(angle) - 1), -at.radii * np.sin(angle)
    return Shift(place=along[:, None] * at.normal + across[:, None] * at.tangent)
