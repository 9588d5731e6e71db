"""Something that shifts at a moment: the base, a disc, the tool, the zero of a joint or of the force sensor.

The moment lies between two touches, in the order of time over all recordings. It is searched over all pairs of
neighbours, and as nothing changes between two of them, a fit holds it (`Effect.is_stepwise`).

What the calibration estimates anyway, base, joints and tool, is estimated as it is after the moment, which is how the
robot is now. What the cell description states, discs and the sensor's zero, is taken to be right before it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.base import Effect, Parameter, Trial, at_joint, combined, unit_vectors
from scara_kinetostatic.effects.variables import VARIABLES, PlotAxis
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchMetadata, TouchState

_LEAST = 3
"""Touches on either side of a moment at least; with fewer they are outliers."""
_MOST = 160
"""Moments of the grid at most; between them the search refines."""
_FINER = 13
"""Moments about one of the grid."""
RANDOM_MOMENTS = (10, 60)
"""Touches between which `random_values` puts the moment."""
_MOMENT = Parameter('moment', '1', 1.0, 'between the touches of these numbers, in the order of time', typical=23.5)


@dataclass(frozen=True)
class _Step(Effect):
    """An effect that begins or ends at a moment, in steps from touch to touch.

    Attributes:
        acts_before: whether it acts on the touches before the moment, with the opposite sign, instead of those after.
        remains: what holds after the moment, a clause.
    """

    acts_before: ClassVar[bool] = True
    remains: ClassVar[str] = ''
    confounded_with: ClassVar[str] = (
        'a drift, if the touches before and after the moment are few; another shift, if only one disc is touched or '
        'the touches go from disc to disc'
    )
    identified_by: ClassVar[str] = 'the same touches again, on all discs, before and after the moment'
    plot_variable: ClassVar[str] = 'touch'
    grid_parameter: ClassVar[str] = 'moment'
    is_stepwise: ClassVar[bool] = True
    force_dependence: ClassVar[ForceDependence] = ForceDependence.NONE
    diverges_with_alias: ClassVar[bool] = True

    @abstractmethod
    def units(self, at: TouchState) -> tuple[Shift, ...]:
        """The shift per unit of each parameter but the moment, of all touches; empty for none."""

    def unit_errors(self, force: Floats) -> tuple[Floats, ...]:
        """The same as errors of the sensor, for forces (n, 2)."""
        return ()

    def shift(self, at: TouchState, values: Floats) -> Shift:
        units = self.units(at)
        if not units:
            return Shift()
        weight = self._weight(at.metadata, len(at.magnitude), values[-1])[:, None]
        whole = combined([unit.joints for unit in units], values[:-1]), combined([u.place for u in units], values[:-1])
        return Shift(*(None if part is None else weight * part for part in whole))

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        units = self.units(at)
        if not units:
            return tuple(Shift() for _ in values)
        weight = self._weight(at.metadata, len(at.magnitude), values[-1])[:, None]
        parts = [Shift(*(None if one is None else weight * one for one in unit)) for unit in units]
        still = Shift(*(None if one is None else np.zeros(at.joints.shape) for one in units[0]))
        return (*parts, still)

    def sensor_error(self, force: Floats, values: Floats) -> Floats | None:
        return self.sensor_error_of_touches(force, values, None)

    def sensor_error_derivative(self, force: Floats, values: Floats) -> tuple[Floats, ...]:
        return self.sensor_error_of_touches_derivative(force, values, None)

    def sensor_error_of_touches(self, force: Floats, values: Floats, metadata: TouchMetadata | None) -> Floats | None:
        parts = self.sensor_error_of_touches_derivative(force, values, metadata)
        return combined(parts, values) if parts else None

    def sensor_error_of_touches_derivative(
        self, force: Floats, values: Floats, metadata: TouchMetadata | None
    ) -> tuple[Floats, ...]:
        units = self.unit_errors(force)
        if not units:
            return ()
        weight = self._weight(metadata, len(force), values[-1])[:, None]
        return (*(weight * unit for unit in units), np.zeros(force.shape))

    def amplitudes(self, values: Floats) -> Floats:
        """All but the moment."""
        return np.array([*values[:-1], 0.0])

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """One per moment of a grid, with `_LEAST` touches or more before and after it."""
        return self._at(at, force, self._moments(at)[:: self._stride(at)])

    def finer(self, at: TouchState, trial: Trial, width: float) -> Sequence[Trial]:
        """The moments between a trial and its neighbours of the grid; none where the grid holds all."""
        moments, step = self._moments(at), self._stride(at)
        if step == 1:
            return ()
        k, reach = int(np.argmin(np.abs(moments - trial.place))), max(int(np.ceil(width * step)), 1)
        near = moments[max(k - reach, 0) : k + reach + 1]
        return self._at(at, at.force, near[:: 1 + (len(near) - 1) // _FINER])

    def place_text(self, low: float, high: float, where: str = '') -> str:
        between = f'between the touches {low:.0f} and {high:.0f}' + (f', {where}' if where else '')
        return f'{self.finding} {between}' + (f'; {self.remains}' if self.remains else '')

    def random_values(self, random: np.random.Generator) -> Floats:
        """The plausible size in a random direction, at a random moment."""
        unit = random.standard_normal(len(self.parameters) - 1)
        size = np.array(self.scales[:-1]) * unit / np.linalg.norm(unit)
        return np.array([*size, random.integers(*RANDOM_MOMENTS) + 0.5])

    def _weight(self, metadata: TouchMetadata | None, n: int, moment: float) -> Floats:
        """-1 before the moment and 0 after it, or 0 and 1, (n,); touches of unknown order are after it."""
        order = None if metadata is None else metadata.order
        before = np.zeros(n) if order is None else (order < moment).astype(float)
        return -before if self.acts_before else 1 - before

    def _moments(self, at: TouchState) -> Floats:
        """All moments between two neighbours of the touches that it acts on."""
        order = at.metadata.order
        if order is None:
            return np.empty(0)
        acts = np.sort(order[self.acts_on(at)]).astype(float)
        between = (acts[1:] + acts[:-1]) / 2
        return np.asarray(between[_LEAST - 1 : len(between) - _LEAST + 1])

    def _stride(self, at: TouchState) -> int:
        """Every how many moments the grid has one."""
        return 1 + len(self._moments(at)) // _MOST

    def _at(self, at: TouchState, force: Floats, moments: Floats) -> Sequence[Trial]:
        """A trial for each moment; where there is none, one that cannot be told from the base model."""
        moments = moments if len(moments) else np.array([0.0 if self.acts_before else np.inf])
        units, errors = self.units(at), self.unit_errors(force)
        found = []
        for moment in moments.tolist():
            weight = self._weight(at.metadata, len(at.magnitude), moment)[:, None]
            columns = tuple(Shift(*(None if one is None else weight * one for one in unit)) for unit in units)
            found.append(
                Trial(
                    columns or tuple(Shift() for _ in errors),
                    tuple(weight * error for error in errors),
                    partial(_with_moment, moment=moment),
                    moment,
                )
            )
        return found


def _with_moment(coefficients: Floats, moment: float) -> Floats:
    """The values of the parameters."""
    return np.array([*coefficients, moment])


@dataclass(frozen=True)
class BaseShift(_Step):
    """The base moves by (x, y) at a moment: d = -(x, y) before it.

    x0 and y0 are the place after it. A base that turns as well shifts the zero of joint 1.
    """

    name: ClassVar[str] = 'shift'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('x', 'm', 1e-3, 'movement along x', typical=1e-4),
        Parameter('y', 'm', 1e-3, 'movement along y', typical=-5e-5),
        _MOMENT,
    )
    statement: ClassVar[str] = 'the base shifted'
    remains: ClassVar[str] = 'x0 and y0 are those after it'
    order: ClassVar[int] = 21

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls(target='base')]

    def units(self, at: TouchState) -> tuple[Shift, ...]:
        return tuple(Shift(place=unit) for unit in unit_vectors(len(at.normal)))


@dataclass(frozen=True)
class ToolShift(_Step):
    """The tip moves at the end of link 2 at a moment, by (x, y): d = -(x v + y R90 v) before it.

    v is the direction of link 2. l2 and theta2 are those after it. A movement across link 2 alone is, to first order,
    a shift of the zero of joint 2.
    """

    name: ClassVar[str] = 'shift'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('x', 'm', 1e-3, 'movement along link 2', typical=8e-5),
        Parameter('y', 'm', 1e-3, 'movement across link 2', typical=5e-5),
        _MOMENT,
    )
    statement: ClassVar[str] = 'the tool shifted'
    remains: ClassVar[str] = 'l2 and theta2 are those after it'
    order: ClassVar[int] = 22

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls(target='tool')]

    def units(self, at: TouchState) -> tuple[Shift, ...]:
        x, y = at.link2.T
        return Shift(place=at.link2), Shift(place=np.array([-y, x]).T)


@dataclass(frozen=True)
class DiscShift(_Step):
    """A disc moves by (x, y) at a moment: d = -(x, y) in its touches after it.

    Before it the disc stands where the cell description says.

    Attributes:
        disc: its number in the cell.
    """

    disc: int = 0

    name: ClassVar[str] = 'shift'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('x', 'm', 1e-3, 'movement along x', typical=1e-4),
        Parameter('y', 'm', 1e-3, 'movement along y', typical=-2e-4),
        _MOMENT,
    )
    statement: ClassVar[str] = '{target} shifted'
    acts_before: ClassVar[bool] = False
    on_object: ClassVar[bool] = True
    order: ClassVar[int] = 23

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls(target=disc.name, disc=number) for number, disc in enumerate(cell.discs)]

    def units(self, at: TouchState) -> tuple[Shift, ...]:
        touched = 1.0 * (at.metadata.disc == self.disc)[:, None]
        return tuple(Shift(place=-touched * unit) for unit in unit_vectors(len(touched)))

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return np.asarray(at.metadata.disc == self.disc)


@dataclass(frozen=True)
class ZeroShift(_Step):
    """The zero of a joint shifts at a moment: δ = angle before it.

    The true angle grows by `angle` against the reported one. The offset theta of the joint is that after it.

    Attributes:
        joint: 0 or 1.
    """

    joint: int = 0

    name: ClassVar[str] = 'shift'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('angle', 'rad', 1e-3, 'growth of the true angle', typical=1e-4),
        _MOMENT,
    )
    statement: ClassVar[str] = 'the zero of {target} shifted'
    order: ClassVar[int] = 24

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls(target=f'joint{joint + 1}', joint=joint) for joint in (0, 1)]

    @property
    def remains(self) -> str:  # type: ignore[override]
        """Of the offset of the joint."""
        return f'theta{self.joint + 1} is that after it'

    def units(self, at: TouchState) -> tuple[Shift, ...]:
        return (Shift(joints=at_joint(np.full(len(at.joints), -1.0), self.joint)),)

    def plot_axis(self, at: TouchState, values: Floats) -> PlotAxis:
        return VARIABLES[self.plot_variable].axis(at, self.joint)


@dataclass(frozen=True)
class SensorShift(_Step):
    """The zero of the force sensor shifts by (x, y), in its frame, at a moment: e = (x, y) after it.

    Before it the sensor reads zero without force. A tare before each touch takes it away.
    """

    name: ClassVar[str] = 'shift'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('x', 'N', 3.0, 'reported too much along x of the sensor', typical=1.0),
        Parameter('y', 'N', 3.0, 'reported too much along y of the sensor', typical=-0.7),
        _MOMENT,
    )
    statement: ClassVar[str] = 'the zero of the force sensor shifted'
    acts_before: ClassVar[bool] = False
    order: ClassVar[int] = 25

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return [cls(target='sensor')]

    def units(self, at: TouchState) -> tuple[Shift, ...]:
        return ()

    def unit_errors(self, force: Floats) -> tuple[Floats, ...]:
        return unit_vectors(len(force))
