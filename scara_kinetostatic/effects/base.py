"""What a physical effect is: the interface of all effects, and the usual cases to derive from.

An effect says what it does to a touch (`model.effect_law`): δ, an angle between actuator and link beside the
law of the joint (6); d, a displacement of tip or object beside (7) and (11); e, an error of the force sensor. Most
effects are linear in their parameters: such a one defines only its `basis`, the shift per unit of each parameter.

All that is known of an effect stands in its class: nothing elsewhere asks which effect it is. A class that forgets
something is refused when it is defined. `registry` lists them, and says how a package of your own adds one.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.variables import VARIABLES, PlotAxis
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Disc
from scara_kinetostatic.model.effect_law import EffectLaw, ForceDependence, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.outline import Outline


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
class Effect(EffectLaw):
    """A physical effect that the base model lacks.

    Required of a class:

    Attributes:
        name: of the kind of effect, as in the results; letters, digits and ``_``.
        parameters: what is to be estimated.
        statement: what its presence says of the cell, a clause; ``{target}`` stands for the target.
        confounded_with: what it cannot be distinguished from, and when.
        identified_by: the touches that determine it.
        plot_variable: the variable over which its residual is plotted, a key of `variables.VARIABLES`.

    Optional, beside those of `EffectLaw`:

    Attributes:
        target: the joint (``joint1``), link or disc it is about; None if it is about the whole cell.
        special_cases: labels of effects that it contains or equals: one of these is named in its place unless its
            own restricted likelihood is larger.
        is_physical: whether it has a physical meaning; else it is a fitted curve.
        is_linear: whether the shift is linear in the parameters.
        premise: what its values suppose that the touches do not show, a clause; empty if nothing.
        declared_as: label of the source of uncertainty that the effect exceeds, where it is not the effect's own.

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
    is_linear: ClassVar[bool] = False
    premise: ClassVar[str] = ''
    declared_as: ClassVar[str] = ''

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

    def with_off_normal_std(self, std: float) -> Effect:
        """The same effect with another `off_normal_std`; itself where it has none."""
        return self

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

    is_linear: ClassVar[bool] = True

    @abstractmethod
    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """The shift per unit of each parameter."""

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return Shift(*(combined(parts, values) for parts in zip(*self.basis(at), strict=True)))

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
        return tuple(Shift(joints=at_joint(angle, self.joint)) for angle in angles)

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
    def of(cls, disc: int, name: str) -> DiscEffect:
        """The effect of one disc, by number and name."""
        return cls(target=name, disc=disc)

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls.of(number, disc.name) for number, disc in enumerate(cell.discs) if isinstance(disc, cls.kinds)]

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


def at_joint(angle: Floats, joint: int) -> Floats:
    """δ (n, 2) that is `angle` (n,) at one joint and zero at the other."""
    out = np.zeros((len(angle), 2))
    out[:, joint] = angle
    return out


def unit_vectors(n: int) -> tuple[Floats, Floats]:
    """The unit vectors along x and along y, n times each, (n, 2) each."""
    return at_joint(np.ones(n), 0), at_joint(np.ones(n), 1)


def combined(parts: Sequence[Floats | None], values: Floats) -> Floats | None:
    """The sum of parts (n, 2) times values (k,); None where there is none."""
    terms = [value * part for part, value in zip(parts, values, strict=True) if part is not None]
    return sum(terms[1:], terms[0]) if terms else None
