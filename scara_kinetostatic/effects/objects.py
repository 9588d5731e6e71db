"""Objects that are not as the cell description says: displaced, of another radius, soft; a plate displaced. Friction at
the contact, with all discs or with one: in the direction of the slide, or of either sense.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.base import (
    LENGTH,
    STICKING,
    VARIABLES,
    DiscEffect,
    Effect,
    EffectOfDiscs,
    LinearEffect,
    PlotAxis,
    moved,
    slide,
    unit_vectors,
)
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.extended_model import ForceDependence, Parameter, Shift, TouchState
from scara_kinetostatic.model.kinematics import quarter_turn
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import MICRO, MILLI
from scara_kinetostatic.model.quantities import displacement, off


def _place_of(what: str) -> tuple[Parameter, ...]:
    meaning = f'true place of the {what} less the stated one'
    return Parameter('x', 'm', LENGTH, f'{meaning}, x'), Parameter('y', 'm', LENGTH, f'{meaning}, y', typical=-2e-4)


@dataclass(frozen=True)
class ObjectPosition(DiscEffect):
    """The centre of the disc is displaced by (x, y): d = -(x, y).

    What the touches show are the distances between the discs, as x0, y0 and theta1 are free. With three discs a move
    that changes only the distance of two of them may be that of either.

    Attributes:
        plate: name of the plate that carries this disc alone, which may be what is displaced; empty if there is none.
    """

    plate: str = ''

    name = 'object_position'
    parameters = _place_of('centre')
    typical_size = 1e-5  # a coordinate measuring machine in the workshop
    statement = '{target} is not where the cell description says'
    confounded_with = (
        'x0, y0 and theta1, if there is one disc; another disc, if the move changes the distance to that one only'
    )
    identified_by = 'touches all round three or more discs, in both elbow postures'
    plot_variable = 'place'
    force_dependence = ForceDependence.NONE

    @classmethod
    def facts(cls, cell: Cell, disc: Disc | Outline) -> tuple[Any, ...]:
        return (disc.plate if [other.plate for other in cell.discs].count(disc.plate) == 1 else '',)

    @property
    def title(self) -> str:
        return super().title.replace(' is not', f' or its plate {self.plate} is not' if self.plate else ' is not')

    def correction(self, values: Mapping[str, float]) -> str:
        return f'measure {self.target} again: it stands {displacement(values["x"], values["y"])}'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        return tuple(at.across_edges(-unit) for unit in unit_vectors(len(at.normal)))


@dataclass(frozen=True)
class ObjectRotation(DiscEffect):
    """The outline is turned by `angle` about its reference point: its edges move, and their normals turn.

    With N the normal, T the tangent and X the tip, an edge adds d = angle (r T + N T·(X - S_o)), a corner that of its
    centre.

    Attributes:
        reference: S_o, base frame, m.
    """

    reference: tuple[float, float] = (0.0, 0.0)

    name = 'object_rotation'
    parameters = (Parameter('angle', 'rad', 2e-2, 'true rotation less the stated one', typical=MILLI),)
    typical_size = 1e-4  # 10 µm over 0.1 m
    kinds = (Outline,)
    statement = '{target} is turned against what the cell description says'
    confounded_with = 'theta1, if there is no other object; a place of the object, if one edge alone is touched'
    identified_by = 'touches along two of its edges, and of another object'
    plot_variable = 'disc'
    force_dependence = ForceDependence.DIRECTION

    @classmethod
    def facts(cls, cell: Cell, disc: Disc | Outline) -> tuple[Any, ...]:
        return ((disc.x, disc.y),)

    def correction(self, values: Mapping[str, float]) -> str:
        turned = off(values['angle'], 'rad', 'counter-clockwise', 'clockwise')
        return f'measure the rotation of {self.target} again: it is {turned}'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        d = at.across_edges(-quarter_turn(at.centers - self.reference))
        if at.tangents is not None:
            t = at.tangents
            d = d + at.radii[:, None] * t - at.along_edge[:, None] * quarter_turn(t)
        return (d,)


class ObjectRadius(DiscEffect):
    """The disc is larger by `radius` than stated: d = radius · n."""

    name = 'object_radius'
    parameters = (Parameter('radius', 'm', LENGTH, 'true radius less the stated one'),)
    typical_size = 5e-6  # a ground pin
    statement = '{target} has another radius than the cell description says'
    confounded_with = 'g_ee, if there is one disc: all radii larger is a smaller backlash of the gripper'
    kinds: ClassVar[tuple[type, ...]] = (Disc,)
    identified_by = 'touches of two or more discs, all round each'
    plot_variable = 'disc'
    force_dependence = ForceDependence.DIRECTION

    def correction(self, values: Mapping[str, float]) -> str:
        size = off(values['radius'], 'm', 'larger', 'smaller')
        return f'measure the radius of {self.target} again: it is {size}'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        return (at.normal,)


class ObjectOffset(ObjectRadius):
    """All sides of the outline stand further out by `offset`: d = offset · n."""

    name = 'object_offset'
    parameters = (Parameter('offset', 'm', LENGTH, 'of all sides along their normals; worn: below 0'),)
    statement = 'the sides of {target} are not where the cell description says, all by the same'
    confounded_with = 'g_ee, if there is no other object; the radius of the tip'
    kinds = (Outline,)
    identified_by = 'touches of opposite sides, and of another object'

    def correction(self, values: Mapping[str, float]) -> str:
        where = off(values['offset'], 'm', 'further out', 'further in')
        return f'measure {self.target} again: its sides stand {where}'


@dataclass(frozen=True)
class EdgeBow(DiscEffect):
    """A straight edge bulges by `bow` in its middle: d = -bow (1 - (s/h)²) N.

    N is its normal, s the place along it from its middle, h half its length between the corners. The slope turns the
    normal as a rotation does: with T the tangent and r the radius, d has 2 bow r s/h² T as well. The square of the
    slope is neglected: 12 nm at the ends of 0.12 m for 20 µm. The target ``block.2`` is the edge from the second to the
    third corner of block.

    Attributes:
        surface: number of the edge among the surfaces of the cell.
        half: h, m.
    """

    surface: int = 0
    half: float = 1.0

    name = 'edge_bow'
    parameters = (Parameter('bow', 'm', LENGTH, 'of the middle, outwards, against the ends', typical=5e-5),)
    typical_size = 3 * MICRO  # a ground edge
    statement = '{target} is not straight'
    confounded_with = 'a place or an offset of the object, if the edge is touched at one distance from its middle'
    identified_by = 'touches in the middle and near both ends of the edge, and of other edges or objects'
    plot_variable = 'along_edge'
    force_dependence = ForceDependence.DIRECTION

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        for number, disc in enumerate(cell.discs):
            if isinstance(disc, Outline):
                edges = np.flatnonzero((cell.surfaces.object == number) & cell.surfaces.is_edge).tolist()
                for count, edge in enumerate(edges, 1):
                    yield cls(f'{disc.name}.{count}', number, edge, float(cell.surfaces.halves[edge]))

    @property
    def edge(self) -> str:
        """Which edge, in words."""
        name, _, count = (self.target or '').rpartition('.')
        return f'edge {count} of {name}'

    @property
    def title(self) -> str:
        return self.statement.format(target=self.edge)

    def correction(self, values: Mapping[str, float]) -> str:
        where = off(values['bow'], 'm', 'further out', 'further in')
        return f'grind {self.edge}: its middle stands {where} than its ends'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        if at.tangents is None:
            return (np.zeros_like(at.normal),)
        t, s = at.tangents, at.along_edge[:, None]
        slope = 2 * s / self.half**2 * at.radii[:, None]
        return (slope * t + (1 - (s / self.half) ** 2) * quarter_turn(t),)

    def touched(self, at: TouchState) -> NDArray[np.bool_]:
        surface = at.metadata.surface
        return np.zeros(len(at.radii), dtype=bool) if surface is None else np.asarray(surface == self.surface)


@dataclass(frozen=True)
class PlatePosition(LinearEffect):
    """All discs of the plate are displaced by (x, y): d = -(x, y) in their touches.

    A cell has it for each of its plates that carries several discs: a plate of one disc is that disc. One of all discs
    is the base the other way: it can be simulated, and no touches show it.

    Attributes:
        discs: their numbers in the cell.
    """

    discs: tuple[int, ...] = ()

    name = 'plate_position'
    parameters = _place_of('plate')
    typical_size = ObjectPosition.typical_size
    statement = 'the plate {target} is not where the cell description says'
    confounded_with = 'the only disc, or the only plate, that is not on it, displaced the other way'
    identified_by = 'touches all round its discs and two or more others that are not mounted together'
    plot_variable = 'place'
    on_object = True
    force_dependence = ForceDependence.NONE

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        for plate in cell.plates:
            discs = tuple(number for number, disc in enumerate(cell.discs) if disc.plate == plate.name)
            if len(discs) > 1:
                yield cls(target=plate.name, discs=discs)

    def correction(self, values: Mapping[str, float]) -> str:
        return f'measure the place of plate {self.target} again: it stands {displacement(values["x"], values["y"])}'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        touched = self.acts_on(at)[:, None]
        return moved(at, *(touched * -unit for unit in unit_vectors(len(touched))))

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return np.asarray(np.isin(at.metadata.disc, self.discs))


class ContactCompliance(EffectOfDiscs, LinearEffect):
    """Hertz's contact: the tip sinks into the disc by yield · f^(2/3), so d = -yield f^(2/3) n.

    Where the tip would have to pull, f < 0, the law continues as an odd function.
    """

    name = 'contact_compliance'
    parameters = (
        Parameter('yield', 'm/N^(2/3)', MILLI, 'depth of the tip in the disc under 1 N', typical=1e-5, sign=1),
    )
    typical_size = 3e-7  # Hertz: steel on steel
    statement = 'the surface of {target} yields under the force'
    confounded_with = (
        'p_ee and g_ee together, if all discs are soft and the force levels few: f^(2/3) is nearly a straight line; '
        'the radius of a soft disc, if it is touched with one force only'
    )
    identified_by = 'touches of every disc at many force levels, very small ones above all'
    plot_variable = 'magnitude'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        depth = np.sign(at.magnitude) * np.abs(at.magnitude) ** (2 / 3)
        return (Shift(place=-(depth * self.acts_on(at))[:, None] * at.normal),)


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
        Parameter(
            'coefficient', '1', STICKING, 'angle of friction: that of the force from the normal', 0.0, STICKING, 1
        ),
    )
    typical_size = 4 * MILLI  # lubricated steel, pressed along the normal
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

    The diagnosis tests it beside the effects of the catalogue, as a variance: `diagnosis.lack_of_fit`.

    Attributes:
        off_normal: standard deviation of α, rad, with which a fit begins to estimate it; the coefficient of friction is
            larger than it.
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
    typical_size = ContactFriction.typical_size

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return ()

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
    x, y = at.normal.T
    return Shift(place=np.array([along * x - across * y, along * y + across * x]).T)
