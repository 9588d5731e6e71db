"""Effects without a name: curves fitted to what no physical effect explains, and errors too small to be detected.

**Empirical curves** are smooth functions of whatever the residual depends on. What no physical effect of the list
explains is still described, by what it depends on, and corrected by a function fitted to it. Such a term says where
the model deviates and by how much, not why.

**Undetected effects.** Every effect of the catalogue that was not found may be there all the same: it is a random
effect of mean zero and of a size of its own, its standard deviation (`diagnosis.mixed_model`). Of those of the robot
`Undetected` holds the columns, so that the uncertainty of a prediction contains them wherever the arm is.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate, groupby, repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.base import (
    LENGTH,
    VARIABLES,
    Effect,
    LinearEffect,
    PlotAxis,
    SensorEffect,
    Variable,
    at_joint,
    one_of,
)
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ForceDependence, Parameter, Shift, TouchState

CURVE_VARIABLES: dict[str, tuple[Variable, int]] = {
    'q1': (VARIABLES['angle'], 0),
    'q2': (VARIABLES['angle'], 1),
    'torque1': (VARIABLES['torque'], 0),
    'torque2': (VARIABLES['torque'], 1),
    'force': (VARIABLES['magnitude'], 0),
    **{name: (VARIABLES[name], 0) for name in ('direction', 'direction_from_link2', 'time')},
}
"""What a curve may depend on, by name: the variable, and the joint."""
CHANNELS = {
    'joint1': 'joint 1 deviates by an angle',
    'joint2': 'joint 2 deviates by an angle',
    'along': 'the tip deviates along the force',
    'across': 'the tip deviates across the force',
}
"""Where a curve may act, in words."""
_OF_JOINTS = 'joint1', 'joint2'
_RANGE = 1.05
"""Half ranges of the touches from their middle, beyond which a curve over anything but a direction is constant."""


@dataclass(frozen=True)
class Unnamed(LinearEffect):
    """A smooth deviation depending on one variable.

    Attributes:
        channel: where it acts, a key of `CHANNELS`.
        variable: what it depends on, a key of `CURVE_VARIABLES`.
        middle: of the variable in the touches.
        half: half its range there.
        disc: number of the disc if it acts there alone; -1 for all.
        powers: highest power if it is a polynomial; 0 for what `variable` asks for: waves over an angle, else four.
    """

    channel: str = 'along'
    variable: str = 'direction'
    middle: float = 0.0
    half: float = 1.0
    disc: int = -1
    powers: int = 0

    name = 'unnamed'
    statement = 'the model deviates, cause unknown'
    confounded_with = 'anything that depends on the same variable'
    identified_by = 'touches in which this variable changes while all others stay'
    plot_variable = 'angle'
    is_physical = False

    @property
    def label(self) -> str:
        """Channel and variable; the target too."""
        return f'unnamed[{self.channel} over {self.variable}{f" of {self.target}" if self.disc >= 0 else ""}]'

    @property
    def description(self) -> str:
        """What deviates depending on what."""
        where = f' on {self.target}' if self.disc >= 0 else ''
        variable, joint = CURVE_VARIABLES[self.variable]
        return f'{CHANNELS[self.channel]}{where}, depending on the {variable.title(joint)}'

    @property
    def title(self) -> str:
        return f'a fitted curve ({self.description})'

    @property
    def on_object(self) -> bool:  # type: ignore[override]
        """Only what one disc does belongs to the object."""
        return self.disc >= 0

    @property
    def force_dependence(self) -> ForceDependence:  # type: ignore[override]
        """That of its variable; along and across the force it turns with it at least."""
        of_variable = CURVE_VARIABLES[self.variable][0].force_dependence
        return of_variable if self.channel in _OF_JOINTS else max(of_variable, ForceDependence.DIRECTION)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """One coefficient per function."""
        if self._waves:
            names = ['slope'] * self._has_slope + [f'{wave}{k}' for k in self._waves for wave in ('cos', 'sin')]
        else:
            names = [f'power{k}' for k in range(1, (self.powers or 4) + 1)]
        unit = 'rad' if self.channel in _OF_JOINTS else 'm'
        return tuple(Parameter(name, unit, LENGTH, 'coefficient') for name in names)

    @property
    def _waves(self) -> tuple[int, ...]:
        """Orders of the waves of which it is a sum, around a disc without the first, a displaced centre; none where it
        is one of powers.
        """
        if CURVE_VARIABLES[self.variable][0].unit != 'rad' or self.powers:
            return ()
        return (2, 3, 4) if self.disc >= 0 else (1, 2, 3)

    @property
    def _has_slope(self) -> bool:
        """Whether it is a sum of waves over an angle that is not periodic."""
        return self.variable in ('q1', 'q2')

    def functions(self, at: TouchState) -> list[Floats]:
        """The functions of the variable, (n,) each."""
        variable, joint = CURVE_VARIABLES[self.variable]
        value = variable.values(at, joint)
        # constant beyond the touches, in half ranges from the middle
        z = np.clip((value - self.middle) / self.half, -_RANGE, _RANGE)
        if not self._waves:
            return list(accumulate(repeat(z, self.powers or 4), np.multiply))
        angles = np.multiply.outer(self._waves, value)
        waves = [wave for pair in zip(np.cos(angles), np.sin(angles), strict=True) for wave in pair]
        return [z, *waves] if self._has_slope else waves

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return np.asarray((at.metadata.disc == self.disc) | (self.disc < 0))

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        variable, joint = CURVE_VARIABLES[self.variable]
        return variable.axis(at, joint)

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        shifts = self._of(at, np.array(self.functions(at)))
        return tuple(map(partial(one_of, shifts), range(len(self.parameters))))

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return self._of(at, values @ np.array(self.functions(at)))

    def _of(self, at: TouchState, curve: Floats) -> Shift:
        """The shift by a function of the variable, (n,), or by several at once, (k, n)."""
        if self.disc >= 0:
            curve = curve * (at.metadata.disc == self.disc)
        if self.channel in _OF_JOINTS:
            return Shift(joints=at_joint(curve, _OF_JOINTS.index(self.channel)))
        return Shift(place=curve[..., None] * (at.normal if self.channel == 'along' else at.tangent))


def empirical_effects(at: TouchState, discs: Sequence[str], one_level: bool = False) -> Iterator[Effect]:
    """All curves that could describe the residuals of these touches.

    Args:
        at: the touches.
        discs: names of the cell's discs.
        one_level: whether all forces are the same but for their noise; then nothing can depend on their size.
    """
    for channel in CHANNELS:
        for name, (variable, joint) in CURVE_VARIABLES.items():
            middle, half = 0.0, 1.0
            if one_level and name == 'force':
                continue
            if not name.startswith('direction'):
                value = variable.values(at, joint)
                middle, half = float(value.max() + value.min()) / 2, float(np.ptp(value)) / 2 or 1.0
            yield Unnamed(None, channel, name, middle, half)
            if (channel, name) in (('joint1', 'q2'), ('joint2', 'q1')):
                # few parameters; over the joint's own angle that is a cable's pull
                yield Unnamed(None, channel, name, middle, half, powers=3)
    for disc in np.unique(at.metadata.disc):
        for channel in ('along', 'across'):
            yield Unnamed(discs[disc], channel, 'direction', disc=int(disc))


class Column(NamedTuple):
    """A column of an effect: its derivative by one of its parameters.

    Attributes:
        effect: the effect.
        values: of its parameters where it is taken.
        parameter: number of the parameter.
    """

    effect: Effect
    values: tuple[float, ...]
    parameter: int

    @property
    def moves_robot(self) -> bool:
        """Whether the arm is elsewhere by it, now: no error of objects or sensor, and nothing that is over."""
        effect = self.effect
        return not (effect.on_object or effect.is_stepwise or isinstance(effect, SensorEffect))

    @property
    def text(self) -> str:
        """As text, such as ``transmission_error[joint1]|0.0,0.0,3.0|0``."""
        return f'{self.effect.label}|{",".join(map(repr, self.values))}|{self.parameter}'


def columns_of(effect: Effect, at: TouchState) -> list[Column]:
    """The columns as which an effect may be there in some touches: those of its amplitudes, without what L̄ contains."""
    acts = effect.amplitudes(np.array([not p.is_alias for p in effect.parameters], dtype=float))
    amplitudes = np.flatnonzero(acts).tolist()
    forms = [tuple(map(float, values)) for values in effect.forms(at)]
    return [Column(effect, values, k) for values in forms for k in amplitudes]


@dataclass(frozen=True)
class Undetected(LinearEffect):
    """All columns of undetected effects of the robot that depend alike on the force, as parameters.

    Attributes:
        cell: in whose catalogue the effects are.
        depends: what of the force they depend on.
        columns: as texts (`Column.text`).
    """

    cell: Cell | None = None
    depends: int = 0
    columns: tuple[str, ...] = ()

    name = 'undetected'
    statement = 'errors too small to be detected'
    confounded_with = 'each other'
    identified_by = 'more touches'
    plot_variable = 'angle'
    is_physical = False
    is_undetected = True

    @classmethod
    def of(cls, cell: Cell, columns: Sequence[Column]) -> tuple[Undetected, ...]:
        """The effects that hold some columns, in their order; they have to be sorted by their dependence."""
        groups = groupby(columns, lambda column: column.effect.force_dependence)
        return tuple(
            cls(level.name.lower(), cell, int(level), tuple(column.text for column in some)) for level, some in groups
        )

    @property
    def force_dependence(self) -> ForceDependence:  # type: ignore[override]
        """As of all its columns."""
        return ForceDependence(self.depends)

    @cached_property
    def _parsed(self) -> tuple[Column, ...]:
        effects = {} if self.cell is None else {effect.label: effect for effect in catalogue(self.cell)}
        parts = (text.split('|') for text in self.columns)
        return tuple(Column(effects[label], tuple(map(float, v.split(','))), int(k)) for label, v, k in parts)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """One per column, named by it."""
        described = zip(self.columns, (c.effect.parameters[c.parameter] for c in self._parsed), strict=True)
        return tuple(p._replace(name=text, meaning='undetected', start=0.0) for text, p in described)

    def shift(self, at: TouchState, values: Floats) -> Shift:
        """None where their values are zero."""
        return super().shift(at, values) if values.any() else Shift()

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        return derivatives(self._parsed, at)

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        return derivatives(self._parsed, at)


def derivatives(columns: Sequence[Column], at: TouchState) -> tuple[Shift, ...]:
    """The shift per unit of each column, each effect evaluated once at the same values."""
    known, found = dict[tuple[Effect, tuple[float, ...]], tuple[Shift, ...]](), list[Shift]()
    for column in columns:
        if column[:2] not in known:
            known[column[:2]] = column.effect.derivative(at, np.array(column.values))
        found.append(known[column[:2]][column.parameter])
    return tuple(found)
