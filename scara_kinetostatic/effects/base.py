"""What a physical effect is: the interface of all effects, and the usual cases to derive from.

An effect says what it does to a touch (`model.extended_model`): δ, an angle between actuator and link beside the
law of the joint (6); d, a displacement of tip or object beside (7) and (11); e, an error of the force sensor. Most
effects are linear in their parameters: such a one defines only its `basis`, the shift per unit of each parameter.

All that is known of an effect stands in its class; elsewhere it is asked which effect one is only where that is about
this one alone, as a tilted base. A class that forgets something is refused when it is defined. `registry` lists them,
and says how a package of your own adds one.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import ArmClass, Cell, Disc
from scara_kinetostatic.model.extended_model import EffectLaw, ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import MILLI

LENGTH = ANGLE = MILLI
"""Largest plausible error of a length, m, and of an angle, rad."""
FINER = 13
"""Trials of a finer grid about one of a coarse grid."""
CLASSES = {ArmClass.INDUSTRIAL: 1.0, ArmClass.DESKTOP: 5.0, ArmClass.PRINTED: 25.0}
"""Classes of arms, and by what factor their typical sizes are larger; a convention."""
STICKING = 0.1
"""A tip that comes within this angle of the normal sticks, as a usual coefficient of friction has it, rad."""


class PlotAxis(NamedTuple):
    """The x axis of a plot of residuals.

    Attributes:
        title: what it is, in words.
        unit: of the values; empty where they have none.
        values: one per touch, (n,).
    """

    title: str
    unit: str
    values: Floats


class Variable(NamedTuple):
    """A property of touches.

    Attributes:
        label: in words; ``{joint}`` stands for the joint's number.
        unit: of the values; empty where they have none.
        values: from touches and a joint, 0 or 1, to values (n,); only a variable of a joint depends on it.
        force_dependence: what of the force it depends on, as far as a fitted curve needs it.
    """

    label: str
    unit: str
    values: Callable[[TouchState, int], Floats]
    force_dependence: ForceDependence = ForceDependence.ALL

    def title(self, joint: int = 0) -> str:
        """In words, of a joint where it is one of a joint."""
        return self.label.format(joint=joint + 1)

    def axis(self, at: TouchState, joint: int = 0) -> PlotAxis:
        """The variable at n touches, of a joint where it is one of a joint."""
        return PlotAxis(self.title(joint), self.unit, self.values(at, joint))


def slide(at: TouchState, _: int = 0) -> Floats:
    """How far the last movement in contact drags the tip aside, (n,): +1 or -1, or between where the tip sticks.

    It is the part along t of the movement J ΔQ, divided by the whole movement and by `STICKING`, limited to ±1. Both
    the movement and t = R90 n are those of the rigid tip at the measured angles.
    """
    p = at.parameters
    links = at.joints + np.array([p.theta1, p.theta2])
    first, second = links[:, 0], links.sum(axis=1)
    x2, y2 = p.l2 * np.cos(second), p.l2 * np.sin(second)
    x1, y1 = p.l1 * np.cos(first) + x2, p.l1 * np.sin(first) + y2
    turn1, turn2 = at.metadata.press.T
    inward_x, inward_y = at.centers[:, 0] - p.x0 - x1, at.centers[:, 1] - p.y0 - y1
    if at.tangents is not None:
        t, outer = at.tangents, np.sign(at.radii)
        inward_x = np.where(t.any(axis=1), -t[:, 1], outer * inward_x)
        inward_y = np.where(t.any(axis=1), t[:, 0], outer * inward_y)
    move_x, move_y = -y1 * turn1 - y2 * turn2, x1 * turn1 + x2 * turn2
    size = np.hypot(inward_x, inward_y) * np.hypot(move_x, move_y)
    aside = (inward_x * move_y - inward_y * move_x) / np.where(size > 0, size, 1.0)
    return np.asarray(np.clip(aside / STICKING, -1.0, 1.0))


def angle_from_link2(at: TouchState, _: int = 0) -> Floats:
    """χ, from link 2 to the force, (n,), rad."""
    across = at.normal[:, 1] * at.link2[:, 0] - at.normal[:, 0] * at.link2[:, 1]
    return np.arctan2(across, (at.normal * at.link2).sum(axis=1))


_NONE, _DIRECTION = ForceDependence.NONE, ForceDependence.DIRECTION
VARIABLES = {
    'angle': Variable('angle of joint {joint}', 'rad', lambda at, joint: at.joints[:, joint], _NONE),
    'torque': Variable('torque of joint {joint}', 'Nm', lambda at, joint: at.torques[:, joint]),
    'link1_torque': Variable(
        'bending moment in the middle of link 1', 'Nm', lambda at, _: 0.5 * at.torques.sum(axis=1)
    ),
    'other_angle': Variable(
        'angle of the joint beside joint {joint}', 'rad', lambda at, joint: at.joints[:, 1 - joint], _NONE
    ),
    'magnitude': Variable('force', 'N', lambda at, _: at.magnitude),
    'direction': Variable(
        'direction of the force', 'rad', lambda at, _: np.arctan2(at.normal[:, 1], at.normal[:, 0]), _DIRECTION
    ),
    'direction_from_link2': Variable('direction of the force from link 2', 'rad', angle_from_link2, _DIRECTION),
    'place': Variable('place on the disc', 'rad', lambda at, _: np.arctan2(-at.normal[:, 1], -at.normal[:, 0])),
    'disc': Variable('number of the object', '', lambda at, _: 1 + at.metadata.disc.astype(float)),
    'along_edge': Variable('place along the edge', 'm', lambda at, _: at.along_edge, _NONE),
    'time': Variable('time', 's', lambda at, _: at.metadata.time, _NONE),
    'touch': Variable(
        'number of the touch',
        '',
        lambda at, _: np.zeros_like(at.magnitude) if (order := at.metadata.order) is None else order.astype(float),
    ),
    'approach': Variable(
        'direction of approach of joint {joint}', '', lambda at, joint: np.sign(at.metadata.approach[:, joint])
    ),
    'slide': Variable('direction of the slide along the disc', '', slide),
}
"""What `Effect.plot_variable` may be, by name: what a residual can be plotted over."""


class Trial(NamedTuple):
    """One way in which an effect may be present, linear in what is to be found first.

    Attributes:
        columns: shift per unit of each coefficient.
        sensor_errors: error of the sensor per unit of each coefficient, (n, 2) each, sensor's frame; empty if none.
        values: from the coefficients found to values of the effect's parameters.
        place: where among the trials of the effect it stands, such as a frequency.
    """

    columns: tuple[Shift, ...]
    sensor_errors: tuple[Floats, ...] = ()
    values: Callable[[Floats], Floats] = np.asarray
    place: float = 0.0


@dataclass(frozen=True)
class Grid(Sequence[Trial]):
    """The trials of an effect at places of its `Effect.grid_parameter`, which differ by a factor in each touch.

    Attributes:
        places: (t,).
        factors: of the columns at each place, (t, m, n); m may be 1 where they are the same.
        unit: the trial by which they multiply.
        values: from the coefficients found at a place, and the place, to values of the effect's parameters.
    """

    places: Floats
    factors: Floats
    unit: Trial
    values: Callable[[Floats, float], Floats] = np.append

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, k: Any) -> Any:
        place, (columns, errors, *_) = float(self.places[k]), self.unit
        factors = np.broadcast_to(self.factors[k], (len(columns), self.factors.shape[-1]))[..., None]
        shifts = (
            Shift(*(None if part is None else factor * part for part in shift))
            for factor, shift in zip(factors, columns, strict=True)
        )
        errors = tuple(factor * error for factor, error in zip(factors, errors, strict=False))
        return Trial(tuple(shifts), errors, lambda coefficients: self.values(coefficients, place), place)


@dataclass(frozen=True)
class Effect(EffectLaw):
    """A physical effect that the base model lacks.

    Required of a class:

    Attributes:
        name: of the kind of effect, as in the results; letters, digits and ``_``.
        parameters: what is to be estimated.
        statement: what its presence says of the cell, a clause; ``{target}`` stands for the target.
        confounded_with: what it cannot be distinguished from, and when.
        identified_by: the touches that determine it.
        plot_variable: the variable over which its residual is plotted, a key of `VARIABLES`.

    Optional, beside those of `EffectLaw`:

    Attributes:
        target: the joint (``joint1``), link or disc it is about; None if it is about the whole cell.
        special_cases: labels of effects that it contains or equals: where one of these is a candidate, it is less
            likely beforehand (`diagnosis.weighing`).
        is_physical: whether it has a physical meaning; else it is a fitted curve.
        premise: what its values suppose that the touches do not show, a clause; empty if nothing.
        declared_as: label of the source of uncertainty that the effect exceeds, where it is not the effect's own.
        typical_size: standard deviation of each parameter, or of all, on a sound industrial arm, where nothing of it is
            known: a convention, an order of magnitude. None: a fiftieth of the largest plausible size.

    Raises:
        TypeError: when a class is defined that lacks one of these; names the class and the attribute.

    Example:
        >>> import scara_kinetostatic as sk
        >>> from dataclasses import dataclass
        >>> from scara_kinetostatic.effects import JointEffect, Parameter
        >>> @dataclass(frozen=True)
        ... class Creep(JointEffect):
        ...     name = 'creep'
        ...     parameters = (Parameter('size', 'rad', 1e-3, 'angle after a long time'),)
        ...     statement = '{target} creeps under load'
        ...     confounded_with = 'the compliance of the joint'
        ...     identified_by = 'touches early and late in a recording'
        ...     plot_variable = 'time'
        ...     def angles(self, at):
        ...         return (np.sign(at.torques[:, self.joint]) * (1 - np.exp(-at.metadata.time / 100)),)
        >>> isinstance(Creep.of(1), sk.Effect), Creep.of(1).label
        (True, 'creep[joint2]')
    """

    target: str | None = None

    name: ClassVar[str]
    statement: ClassVar[str]
    confounded_with: ClassVar[str]
    identified_by: ClassVar[str]
    plot_variable: ClassVar[str]
    special_cases: ClassVar[tuple[str, ...]] = ()
    is_physical: ClassVar[bool] = True
    premise: ClassVar[str] = ''
    declared_as: ClassVar[str] = ''
    typical_size: ClassVar[float | tuple[float, ...] | None] = None

    def __init_subclass__(cls, **options: Any) -> None:
        """Refuse a kind of effect of which something is missing; a class with abstract methods may have no texts."""
        super().__init_subclass__(**options)
        missing = [name for name in dir(cls) if getattr(getattr(cls, name, None), '__isabstractmethod__', False)]
        if missing and 'name' not in vars(cls):
            return
        where = f'effect {cls.__module__}.{cls.__qualname__}'
        if missing:
            raise TypeError(f'{where}: the method {missing[0]!r} is missing')
        for word in ('name', 'statement', 'confounded_with', 'identified_by', 'plot_variable', 'parameters'):
            if not hasattr(cls, word):
                raise TypeError(f'{where}: {word!r} is missing')
        if cls.plot_variable not in VARIABLES:
            known = ', '.join(VARIABLES)
            raise TypeError(f"{where}: 'plot_variable': expected one of {known}, got {cls.plot_variable!r}")

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        """The effects of this kind that a cell may have: one for the whole cell, each joint or each disc."""
        return [cls()]

    @property
    def label(self) -> str:
        """Name and target, such as ``encoder_gain[joint1]``."""
        return f'{self.name}[{self.target}]' if self.target else self.name

    @property
    def description(self) -> str:
        """What deviates depending on what, of an effect without a physical meaning; else empty."""
        return ''

    @property
    def title(self) -> str:
        """What it says of the cell, a clause: ``disc_2 is not where the cell description says``."""
        return self.statement.format(target=re.sub(r'^(joint|link)(?=[12]$)', r'\1 ', self.target or ''))

    @property
    def grid_parameter_index(self) -> int:
        """Place of `grid_parameter` among `parameters`."""
        return [parameter.name for parameter in self.parameters].index(self.grid_parameter)

    @property
    def start(self) -> tuple[float, ...]:
        """Where the estimation begins."""
        return tuple(parameter.start for parameter in self.parameters)

    @property
    def typical(self) -> tuple[float, ...]:
        """Values that matter, for examples and tests."""
        return tuple(p.scale / 10 if p.typical is None else p.typical for p in self.parameters)

    def size(self, parameter: int = 0, arm: ArmClass = ArmClass.INDUSTRIAL) -> float:
        """Typical size of one parameter on a class of arms, in its unit: what is there undetected."""
        known = self.typical_size
        if known is None:
            known = self.parameters[parameter].scale / 50.0
        return CLASSES[arm] * (known[parameter] if isinstance(known, tuple) else known)

    def is_plausible(self, values: Floats) -> bool:
        """Whether fitted values (k,) still describe this effect."""
        return True

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """The ways in which it may be present in these touches; `force` is in the sensor's frame, (n, 2), N."""
        values = np.array(self.start)
        errors = self.sensor_error_derivative(force, values, at.metadata)
        return (Trial(self.derivative(at, values), errors),)

    def forms(self, at: TouchState) -> Sequence[Floats]:
        """Values of its parameters, (k,) each, with whose derivatives it may be there in these touches undetected."""
        return (np.array(self.start),)

    def usual_trials(self, at: TouchState) -> Sequence[Trial]:
        """The few trials that are likelier beforehand than all others of the grid."""
        return ()

    def finer(self, at: TouchState, trial: Trial, width: float) -> Sequence[Trial]:
        """Further trials, up to `width` steps on both sides of one of `trials`, where these are a grid."""
        return ()

    def correction(self, values: Mapping[str, float]) -> str:
        """What is to be corrected in the cell description where it is found with values by name, in the imperative;
        empty if that says nothing of it.
        """
        return ''

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        """The touches whose residual is to be plotted, (n,): of an effect of one disc, those on it."""
        return np.ones(len(at.magnitude), dtype=bool)

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        """What its residual is plotted over, at n touches, for values (k,) of the parameters."""
        return VARIABLES[self.plot_variable].axis(at)


class LinearEffect(Effect):
    """An effect that is linear in its parameters."""

    @abstractmethod
    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """The shift per unit of each parameter."""

    def shift(self, at: TouchState, values: Floats) -> Shift:
        total = list[Floats | None]()
        for parts in zip(*self.basis(at), strict=True):
            terms = [value * part for part, value in zip(parts, values, strict=True) if part is not None]
            total.append(sum(terms[1:], terms[0]) if terms else None)
        return Shift(*total)

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return self.basis(at)


class SensorEffect(Effect):
    """An error of the force sensor: it moves nothing."""

    force_dependence: ClassVar[ForceDependence] = ForceDependence.NONE

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return Shift()

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return tuple(Shift() for _ in self.parameters)

    @abstractmethod
    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats:
        """The error e for true forces (n, 2) in the sensor's frame, N."""

    def sensor_error_derivative(
        self, force: Floats, values: Floats, metadata: TouchMetadata | None = None
    ) -> tuple[Floats, ...]:
        """The derivatives of `sensor_error`, one per parameter; this is for an error that is linear in them."""
        return tuple(self.sensor_error(force, unit, metadata) for unit in np.eye(len(values)))


@dataclass(frozen=True)
class EffectOfJoint(Effect):
    """An effect of one joint. The catalogue has one for each joint.

    Attributes:
        joint: 0 or 1.
    """

    joint: int = 0

    @classmethod
    def of(cls, joint: int) -> EffectOfJoint:
        """The effect of joint 0 or 1."""
        return cls(target=f'joint{joint + 1}', joint=joint)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls.of(joint) for joint in (0, 1)]

    def turned(self, *angles: Floats) -> tuple[Shift, ...]:
        """Shifts by angles of the joint, (n,) each, rad."""
        return tuple(Shift(joints=turn) for turn in at_joint(np.array(angles), self.joint))

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        return VARIABLES[self.plot_variable].axis(at, self.joint)


class JointEffect(EffectOfJoint, LinearEffect):
    """A linear effect of one joint: δ of that joint alone."""

    @abstractmethod
    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """δ of the joint per unit of each parameter, (n,) each, rad."""

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        return self.turned(*self.angles(at))


@dataclass(frozen=True)
class EffectOfDiscs(Effect):
    """An effect of all discs, or of one. The catalogue has one of all, and one of each where there are two or more.

    Attributes:
        disc: number in the cell of the one disc; None for all.
    """

    disc: int | None = None
    on_object: ClassVar[bool] = True

    @classmethod
    def of(cls, disc: int, name: str) -> EffectOfDiscs:
        """That of one disc, by number and name."""
        return cls(target=name, disc=disc)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        discs = enumerate(cell.discs) if len(cell.discs) > 1 else ()
        return [cls(), *(cls.of(number, disc.name) for number, disc in discs)]

    @property
    def title(self) -> str:
        return super().title if self.target else self.statement.format(target='the discs')

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return super().acts_on(at) if self.disc is None else np.asarray(at.metadata.disc == self.disc)


@dataclass(frozen=True)
class DiscEffect(LinearEffect):
    """A linear effect of one disc. The catalogue has one for each disc.

    Attributes:
        disc: its number in the cell.
        kinds: of objects that may have it.
    """

    disc: int = 0
    on_object: ClassVar[bool] = True
    kinds: ClassVar[tuple[type, ...]] = (Disc, Outline)

    @classmethod
    def of(cls, disc: int, name: str, *facts: Any) -> DiscEffect:
        """The effect of one disc, by number and name, with what else the class knows of it."""
        return cls(name, disc, *facts)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        discs = enumerate(cell.discs)
        return [cls.of(k, disc.name, *cls.facts(cell, disc)) for k, disc in discs if isinstance(disc, cls.kinds)]

    @classmethod
    def facts(cls, cell: Cell, disc: Disc | Outline) -> tuple[Any, ...]:
        """What a class knows of its disc beside number and name, in the order of its fields."""
        return ()

    @abstractmethod
    def places(self, at: TouchState) -> tuple[Floats, ...]:
        """Each d per unit of its parameter, as if every touch were on this disc, (n, 2) each, m."""

    def touched(self, at: TouchState) -> NDArray[np.bool_]:
        """Which touches are on it, (n,)."""
        return np.asarray(at.metadata.disc == self.disc)

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        touched = self.touched(at)[:, None]
        return tuple(Shift(place=place * touched) for place in self.places(at))

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return np.asarray(self.touched(at) | (self.plot_variable == 'disc'))


def at_joint(angle: Floats, joint: int) -> Floats:
    """δ (..., n, 2) that is `angle` (..., n) at one joint and zero at the other."""
    out = np.zeros((*angle.shape, 2))
    out[..., joint] = angle
    return out


def one_of(shifts: Shift, k: int) -> Shift:
    """One of several shifts at once, δ and d (t, n, 2) each."""
    joints, place = shifts
    return Shift(None if joints is None else joints[k], None if place is None else place[k])


def moved(at: TouchState, *places: Floats) -> tuple[Shift, ...]:
    """Shifts by displacements of the tip or of an object, (n, 2) each, m, as they count along edges."""
    counted = list(map(at.across_edges, places))
    return tuple(Shift(place=place) for place in counted)


def unit_vectors(n: int) -> tuple[Floats, Floats]:
    """The unit vectors along x and along y, n times each, (n, 2) each."""
    return at_joint(np.ones(n), 0), at_joint(np.ones(n), 1)
