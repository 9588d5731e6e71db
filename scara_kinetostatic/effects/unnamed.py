"""Empirical curves: smooth functions of whatever the residual depends on, without a physical name.

What no physical effect of the list explains is still described, by what it depends on, and corrected by a
function fitted to it. Such a term says where the model deviates and by how much, not why.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, repeat

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.base import Effect, LinearEffect, at_joint
from scara_kinetostatic.effects.variables import VARIABLES, PlotAxis, Variable
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, Shift, TouchState

CURVE_VARIABLES: dict[str, tuple[str, int | None]] = {
    'q1': ('angle', 0),
    'q2': ('angle', 1),
    'torque1': ('torque', 0),
    'torque2': ('torque', 1),
    'force': ('magnitude', None),
    'direction': ('direction', None),
    'direction_from_link2': ('direction_from_link2', None),
    'time': ('time', None),
}
"""What a curve may depend on, by name: the key of `VARIABLES`, and the joint."""
CHANNELS = {
    'joint1': 'joint 1 deviates by an angle',
    'joint2': 'joint 2 deviates by an angle',
    'along': 'the tip deviates along the force',
    'across': 'the tip deviates across the force',
}
"""Where a curve may act, in words."""


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
    def _variable(self) -> tuple[Variable, int | None]:
        """What it depends on, and of which joint."""
        name, joint = CURVE_VARIABLES[self.variable]
        return VARIABLES[name], joint

    def axis(self, at: TouchState) -> PlotAxis:
        """The variable that it depends on, at n touches."""
        variable, joint = self._variable
        return variable.axis(at, joint)

    @property
    def label(self) -> str:
        """Channel and variable; the target too."""
        return f'unnamed[{self.channel} over {self.variable}{f" of {self.target}" if self.disc >= 0 else ""}]'

    @property
    def description(self) -> str:
        """What deviates depending on what."""
        where = f' on {self.target}' if self.disc >= 0 else ''
        variable, joint = self._variable
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
        of_variable = self._variable[0].force_dependence
        return of_variable if self.channel in ('joint1', 'joint2') else max(of_variable, ForceDependence.DIRECTION)

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """One coefficient per function."""
        unit = 'rad' if self.channel in ('joint1', 'joint2') else 'm'
        if self.waves:
            names = [f'{wave}{k}' for k in self._orders() for wave in ('cos', 'sin')]
            names = ['slope', *names] if self.has_slope else names
        else:
            names = [f'power{k}' for k in range(1, (self.powers or 4) + 1)]
        return tuple(Parameter(name, unit, 1e-3, 'coefficient') for name in names)

    @property
    def waves(self) -> bool:
        """Whether it is a sum of waves; else it is one of powers."""
        return self._variable[0].unit == 'rad' and not self.powers

    @property
    def has_slope(self) -> bool:
        """Whether it is one over an angle that is not periodic."""
        return self.variable in ('q1', 'q2')

    def _orders(self) -> Sequence[int]:
        # around a disc, the first would be a displaced centre
        return (2, 3, 4) if self.disc >= 0 else (1, 2, 3)

    def functions(self, at: TouchState) -> list[Floats]:
        """The functions of the variable, (n,) each."""
        value = self.axis(at).values
        # constant beyond the touches, in half ranges from the middle
        z = np.clip((value - self.middle) / self.half, -1.05, 1.05)
        if self.waves:
            angles = np.multiply.outer(self._orders(), value)
            waves = [wave for pair in zip(np.cos(angles), np.sin(angles), strict=True) for wave in pair]
            return [z, *waves] if self.has_slope else waves
        return list(accumulate(repeat(z, self.powers or 4), np.multiply))

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return np.asarray((at.metadata.disc == self.disc) | (self.disc < 0))

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        return self.axis(at)

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        return tuple(self._of(at, part) for part in self.functions(at))

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return self._of(at, values @ np.array(self.functions(at)))

    def _of(self, at: TouchState, curve: Floats) -> Shift:
        """The shift by a function of the variable, (n,)."""
        if self.disc >= 0:
            curve = curve * (at.metadata.disc == self.disc)
        if self.channel in ('joint1', 'joint2'):
            return Shift(joints=at_joint(curve, int(self.channel == 'joint2')))
        return Shift(place=curve[:, None] * (at.normal if self.channel == 'along' else at.tangent))


def empirical_effects(at: TouchState, discs: Sequence[str], one_level: bool = False) -> Iterator[Effect]:
    """All curves that could describe the residuals of these touches.

    Args:
        at: the touches.
        discs: names of the cell's discs.
        one_level: whether all forces are the same but for their noise; then nothing can depend on their size.
    """
    names = [name for name in CURVE_VARIABLES if not (one_level and name == 'force')]
    for channel in ('joint1', 'joint2', 'along', 'across'):
        for name in names:
            middle, half = 0.0, 1.0
            if not name.startswith('direction'):
                value = Unnamed(variable=name).axis(at).values
                middle, half = float(value.max() + value.min()) / 2, float(np.ptp(value)) / 2 or 1.0
            yield Unnamed(None, channel, name, middle, half)
            if (channel, name) in (('joint1', 'q2'), ('joint2', 'q1')):
                # few parameters; over the joint's own angle that is a cable's pull
                yield Unnamed(None, channel, name, middle, half, powers=3)
    for disc in np.unique(at.metadata.disc):
        for channel in ('along', 'across'):
            yield Unnamed(discs[disc], channel, 'direction', disc=int(disc))
