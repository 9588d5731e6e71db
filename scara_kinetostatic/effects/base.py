"""What a physical effect is: the one interface behind which each of them stands.

An effect says what it does to a touch (`model.law`): δ, an angle between actuator and link beside the
law of the joint (6); d, a displacement of tip or object beside (7) and (11); e, an error of the force sensor. Most
effects are linear in their parameters: such a one only names its `basis`, the shift per unit of each parameter.

To add an effect of your own, write a class like those beside this file and `register` it.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.law import Shift, TouchState

Floats = NDArray[np.float64]


class Parameter(NamedTuple):
    """A parameter of an effect.

    Attributes:
        name: as in the results.
        unit: SI.
        scale: plausible size; in units of it the fit is scaled.
        meaning: in a few words.
        start: where the estimation begins.
    """

    name: str
    unit: str
    scale: float
    meaning: str
    start: float = 0.0


class Trial(NamedTuple):
    """One way in which an effect may be present, linear in what is to be found first.

    Attributes:
        columns: shift per unit of each coefficient.
        readings: error of the sensor per unit of each coefficient, (n, 2) each, sensor's frame; empty if none.
        values: from the coefficients found to values of the effect's parameters.
        place: where among the trials of the effect it stands, such as a frequency.
    """

    columns: tuple[Shift, ...]
    sensor_errors: tuple[Floats, ...] = ()
    values: Callable[[Floats], Floats] = np.asarray
    place: float = 0.0


@dataclass(frozen=True)
class Effect(ABC):
    """A physical effect that the twelve parameters lack.

    Attributes:
        target: the joint (``joint1``), link or disc it is about; None if it is about the whole cell.
        name: of the kind of effect, as in the results.
        parameters: what is to be estimated.
        hides_behind: what it cannot be told from, and when.
        reveal: the touches that bring it to light.
        betrays: the variable over which its residual is best looked at, a key of `variables.VARIABLES`.
        on_object: whether `place` belongs to the object rather than to the robot.
        searched: name of the parameter over which `trials` is a grid, such as a frequency; empty if there is none.
        runs_off: whether it runs to large values beside a rival that is nearly the same, instead of sharing with it.
        scaled_by: names of those of the twelve parameters that the shift is proportional to.
        statement: what it says of the cell, a clause in which ``{target}`` stands for the target, such as
            ``{target} is not where the cell description says``; empty for one made of the label.
        is_physical: whether it has a physical meaning; else it is a fitted curve, whose coefficients have none.
    """

    target: str | None = None

    name: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    confounded_with: ClassVar[str]
    identified_by: ClassVar[str]
    plot_variable: ClassVar[str]
    on_object: ClassVar[bool] = False
    grid_parameter: ClassVar[str] = ''
    diverges_with_alias: ClassVar[bool] = False
    scaled_by: ClassVar[tuple[str, ...]] = ()
    statement: ClassVar[str] = ''
    is_physical: ClassVar[bool] = True

    @property
    def off_normal_std(self) -> float:
        """Standard deviation of the lean of the force, if the effect lets it differ from touch to touch, rad."""
        return 0.0

    @property
    def label(self) -> str:
        """Name and target, such as ``encoder_gain[joint1]``."""
        return f'{self.name}[{self.target}]' if self.target else self.name

    @property
    def description(self) -> str:
        """What deviates and over what, of an effect without a physical meaning; else empty."""
        return ''

    @property
    def title(self) -> str:
        """How a report names it: its label, or what it describes."""
        return f'a fitted curve ({self.description})' if self.description else self.label

    @property
    def finding(self) -> str:
        """What is said where it is found, a clause: ``disc_2 is not where the cell description says``."""
        target = re.sub(r'^(joint|link)(?=[12]$)', r'\1 ', self.target or '')
        return self.statement.format(target=target) if self.statement else f'there is {self.title}'

    @property
    def subject(self) -> str:
        """What it is about, the middle part of the names of its ROS parameters: the target, or ``all``."""
        return self.target or 'all'

    @property
    def labels(self) -> tuple[str, ...]:
        """Each parameter's name behind the effect's."""
        return tuple(f'{self.label}.{parameter.name}' for parameter in self.parameters)

    @property
    def grid_parameter_index(self) -> int:
        """Place of the parameter `searched` among `parameters`."""
        return [parameter.name for parameter in self.parameters].index(self.grid_parameter)

    @property
    def scales(self) -> tuple[float, ...]:
        """Plausible size of each parameter."""
        return tuple(parameter.scale for parameter in self.parameters)

    @property
    def start(self) -> tuple[float, ...]:
        """Where the estimation begins."""
        return tuple(parameter.start for parameter in self.parameters)

    @abstractmethod
    def shift(self, at: TouchState, values: Floats) -> Shift:
        """δ and d at n touches for values (k,) of the parameters."""

    @abstractmethod
    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        """The derivatives of `shift`, one per parameter."""

    def sensor_error(self, force: Floats, values: Floats) -> Floats | None:
        """The error e for true forces (n, 2) in the sensor's frame, N; None unless the effect is one of the sensor."""
        return None

    def sensor_error_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        """The derivatives of `reading`, one per parameter."""
        return ()

    def amplitudes(self, values: Floats) -> Floats:
        """The values (k,), zero where they say how the effect is rather than how strong: what its derivatives,
        times these, add up to is the effect to first order.
        """
        return values

    def is_plausible(self, values: Floats) -> bool:
        """Whether fitted values (k,) still describe this effect, and not something that it was bent to."""
        return True

    def alternative_laws(self) -> tuple[Effect, ...]:
        """The same effect by other laws, just as plausible, that few touches do not tell from this one."""
        return ()

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """The ways in which it may be present in these touches; `force` is in the sensor's frame, (n, 2), N."""
        values = np.array(self.start)
        return (Trial(self.derivative(at, values), self.sensor_error_derivative(force, values)),)

    def finer(self, at: TouchState, trial: Trial, width: float) -> Sequence[Trial]:
        """Further trials, up to `width` steps on both sides of one of `trials`, where these are a grid."""
        return ()


@dataclass(frozen=True)
class LinearEffect(Effect):
    """An effect that is linear in its parameters."""

    @abstractmethod
    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        """The shift per unit of each parameter."""

    def shift(self, at: TouchState, values: Floats) -> Shift:
        parts = self.basis(at)
        return Shift(
            _combine([part.joints for part in parts], values), _combine([part.place for part in parts], values)
        )

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return self.basis(at)


@dataclass(frozen=True)
class SensorEffect(Effect):
    """An error of the force sensor: it moves nothing."""

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return Shift()

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return tuple(Shift() for _ in self.parameters)


@dataclass(frozen=True)
class JointEffect(LinearEffect):
    """A linear effect of one joint: δ of that joint alone.

    Attributes:
        joint: 0 or 1.
    """

    joint: int = 0

    @classmethod
    def of(cls, joint: int) -> JointEffect:
        """The effect of joint 0 or 1."""
        return cls(target=f'joint{joint + 1}', joint=joint)

    @abstractmethod
    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        """δ of the joint per unit of each parameter, (n,) each, rad."""

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        return tuple(Shift(joints=at_joint(angle, self.joint)) for angle in self.angles(at))


@dataclass(frozen=True)
class DiscEffect(LinearEffect):
    """A linear effect of one disc.

    Attributes:
        disc: its number in the cell.
    """

    disc: int = 0
    on_object: ClassVar[bool] = True

    @classmethod
    def of(cls, disc: int, name: str) -> DiscEffect:
        """The effect of one disc, by number and name."""
        return cls(target=name, disc=disc)

    @abstractmethod
    def places(self, at: TouchState) -> tuple[Floats, ...]:
        """Each d per unit of its parameter, as if every touch were on this disc, (n, 2) each, m."""

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        touched = (at.metadata.disc == self.disc)[:, None]
        return tuple(Shift(place=place * touched) for place in self.places(at))


def at_joint(angle: Floats, joint: int) -> Floats:
    """δ (n, 2) that is `angle` (n,) at one joint and zero at the other."""
    out = np.zeros((len(angle), 2))
    out[:, joint] = angle
    return out


def _combine(parts: list[Floats | None], values: Floats) -> Floats | None:
    terms = [value * part for part, value in zip(parts, values, strict=True) if part is not None]
    return None if not terms else np.asarray(np.sum(terms, axis=0))
