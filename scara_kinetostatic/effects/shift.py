"""What changes while the touches are recorded: links and zeros of joints that drift with time; something that shifts at
a moment, the base, a disc, the tool, the zero of a joint or of the force sensor.

The moment of a **shift** lies between two touches, in the order of time over all recordings. It is searched over all
pairs of neighbours, and as nothing changes between two of them, a fit holds it (`Effect.is_stepwise`).

What the calibration estimates anyway, base, joints and tool, is estimated as it is after the moment, which is how the
robot is now. What the cell description states, discs and the sensor's zero, is taken to be right before it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.base import (
    ANGLE,
    FINER,
    LENGTH,
    Effect,
    Grid,
    JointEffect,
    LinearEffect,
    Trial,
    moved,
    unit_vectors,
)
from scara_kinetostatic.effects.objects import ObjectPosition
from scara_kinetostatic.effects.robot import SensorBias
from scara_kinetostatic.model.arrays import Floats, over_arrays
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import ForceDependence, Parameter, Shift, TouchMetadata, TouchState
from scara_kinetostatic.model.kinematics import quarter_turn
from scara_kinetostatic.model.parameters import MICRO


class LinkGrowth(LinearEffect):
    """Both links grow with time t since the start of the recording: d = rate t (l1 u + l2 v).

    u and v are the directions of the links; l1 and l2 are the lengths at the start.
    """

    name = 'thermal_drift'
    parameters = (Parameter('rate', '1/s', 1e-5, 'growth of the links, per length', typical=MICRO),)
    typical_size = 1e-8  # 6 µrad, or 6 µm per metre, in ten minutes: 0.5 K of steel, 1.15e-5 per K
    statement = 'the links grow with time'
    confounded_with = 'places, postures or forces that change in the same order as time goes on'
    identified_by = 'the same touches again later, after a warm-up and after a rest'
    plot_variable = 'time'
    force_dependence = ForceDependence.NONE

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        reach = at.parameters.l1 * at.link1 + at.parameters.l2 * at.link2
        return moved(at, at.metadata.time[:, None] * reach)


class ZeroDrift(JointEffect):
    """The zero of a joint drifts with time t since the start of the recording: δ = -rate t.

    The true angle is q + rate t: it is as if the offset theta of the joint grew.
    """

    name = 'thermal_drift'
    parameters = (LinkGrowth.parameters[0]._replace(unit='rad/s', meaning='growth of the true angle'),)
    typical_size = LinkGrowth.typical_size
    statement = 'the zero of {target} drifts with time'
    confounded_with = LinkGrowth.confounded_with
    identified_by = LinkGrowth.identified_by
    plot_variable = 'time'
    force_dependence = ForceDependence.NONE

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (-at.metadata.time,)


class _Shifting:
    """What may shift, and what all shifts have in common; the catalogue has it as a part of `Stepped` alone.

    Attributes:
        is_estimated: whether the calibration estimates it anyway, as it is after the moment.
    """

    name = 'shift'
    is_estimated: ClassVar[bool] = False
    confounded_with = (
        'a drift, if the touches before and after the moment are few; another shift, if only one disc is touched or '
        'the touches go from disc to disc'
    )
    identified_by = 'the same touches again, on all discs, before and after the moment'
    plot_variable = 'touch'

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        return ()


class BaseMove(_Shifting, LinearEffect):
    """The base moves by (x, y): d = (x, y)."""

    statement = 'the base shifted during the recording'
    typical_size = 3 * MICRO  # fastened
    parameters = (
        Parameter('x', 'm', LENGTH, 'movement along x'),
        Parameter('y', 'm', LENGTH, 'movement along y', typical=-5e-5),
    )
    is_estimated = True

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        return moved(at, *unit_vectors(len(at.normal)))


class ToolMove(_Shifting, LinearEffect):
    """The tip moves at the end of link 2 by (x, y): d = x v + y R90 v, v the direction of link 2."""

    statement = 'the tool shifted during the recording'
    typical_size = BaseMove.typical_size
    parameters = (
        Parameter('x', 'm', LENGTH, 'movement along link 2', typical=8e-5),
        Parameter('y', 'm', LENGTH, 'movement across link 2', typical=5e-5),
    )
    is_estimated = True

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        return moved(at, at.link2, quarter_turn(at.link2))


class ZeroMove(_Shifting, JointEffect):
    """The true angle of a joint grows against the reported one: δ = -angle."""

    statement = 'the zero of {target} shifted during the recording'
    parameters = (Parameter('angle', 'rad', ANGLE, 'growth of the true angle'),)
    typical_size = 5e-6  # an encoder that keeps its zero
    is_estimated = True

    def angles(self, at: TouchState) -> tuple[Floats, ...]:
        return (np.full(len(at.joints), -1.0),)


class DiscMove(_Shifting, ObjectPosition):
    """A disc moves by (x, y)."""

    statement = '{target} shifted during the recording'
    typical_size = BaseMove.typical_size


class SensorMove(_Shifting, SensorBias):
    """The zero of the force sensor changes by (x, y)."""

    statement = 'the zero of the force sensor shifted during the recording'
    typical_size = 3e-2  # as its drift


_LONGEST_GRID = 160
"""Moments that are tried at first."""


@dataclass(frozen=True)
class Stepped(_Shifting, Effect):
    """Another effect, linear in its parameters, that begins or ends at a moment, in steps from touch to touch.

    - The **base** moves by (x, y): d = -(x, y) before the moment; x0 and y0 are the place after it. A base that turns
      as well shifts the zero of joint 1.
    - The **tool** moves by (x, y) along and across link 2; l2 and theta2 are those after it. A movement across link 2
      alone is, to first order, a shift of the zero of joint 2.
    - A **disc** moves by (x, y): d = -(x, y) in its touches after the moment. Before it the disc stands where the cell
      description says.
    - The **zero of a joint**: δ = angle before the moment; its offset theta is that after it.
    - The **zero of the force sensor**: e = (x, y) after the moment. A tare before each touch takes it away.

    Attributes:
        effect: what begins or ends; its parameters are these, before the moment.
    """

    effect: BaseMove | ToolMove | ZeroMove | DiscMove | SensorMove = field(default_factory=BaseMove)

    grid_parameter = 'moment'
    is_stepwise = True
    force_dependence = ForceDependence.NONE

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        yield cls('base', BaseMove())
        yield cls('tool', ToolMove())
        yield from (cls(disc.name, DiscMove(disc.name, number)) for number, disc in enumerate(cell.discs))
        yield from (cls(f'joint{joint + 1}', ZeroMove(joint=joint)) for joint in (0, 1))
        yield cls('sensor', SensorMove())

    @property
    def statement(self) -> str:  # type: ignore[override]
        """What has shifted."""
        return self.effect.statement

    @property
    def typical_size(self) -> float | tuple[float, ...] | None:  # type: ignore[override]
        """As of the effect."""
        return self.effect.typical_size

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """Those of the effect, and the moment."""
        between = 'between the touches of these numbers, in the order of time'
        return (*self.effect.parameters, Parameter('moment', '1', 1.0, between, typical=23.5))

    @property
    def on_object(self) -> bool:  # type: ignore[override]
        """As of the effect."""
        return self.effect.on_object

    def shift(self, at: TouchState, values: Floats) -> Shift:
        return _times(self._weight(at.metadata, len(at.magnitude), values[-1]), self.effect.shift(at, values[:-1]))

    def derivative(self, at: TouchState, values: Floats) -> tuple[Shift, ...]:
        weight = self._weight(at.metadata, len(at.magnitude), values[-1])
        parts = [_times(weight, part) for part in self.effect.derivative(at, values[:-1])]
        return (*parts, _times(0.0, parts[0]))

    def sensor_error(self, force: Floats, values: Floats, metadata: TouchMetadata | None = None) -> Floats | None:
        error = self.effect.sensor_error(force, values[:-1], metadata)
        return None if error is None else self._weight(metadata, len(force), values[-1]) * error

    def sensor_error_derivative(
        self, force: Floats, values: Floats, metadata: TouchMetadata | None = None
    ) -> tuple[Floats, ...]:
        weight = self._weight(metadata, len(force), values[-1])
        parts = [weight * part for part in self.effect.sensor_error_derivative(force, values[:-1], metadata)]
        return (*parts, np.zeros(force.shape)) if parts else ()

    def amplitudes(self, values: Floats) -> Floats:
        """All but the moment."""
        return np.array([*values[:-1], 0.0])

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return self.effect.acts_on(at)

    def trials(self, at: TouchState, force: Floats) -> Sequence[Trial]:
        """One per moment of a grid, with three touches or more before and after it."""
        moments, step = self._moments(at)
        return self._at(at, force, moments[::step])

    def forms(self, at: TouchState) -> Sequence[Floats]:
        """After each third of its touches."""
        moments, _ = self._moments(at)
        thirds = moments[[len(moments) // 3, 2 * len(moments) // 3]] if len(moments) else ()
        return [np.append(np.zeros(len(self.effect.parameters)), moment) for moment in thirds]

    def finer(self, at: TouchState, trial: Trial, width: float) -> Sequence[Trial]:
        """The moments between a trial and its neighbours of the grid, `FINER` or a few more; none where the grid has
        all.
        """
        moments, step = self._moments(at)
        if step == 1:
            return ()
        k, reach = int(np.argmin(np.abs(moments - trial.place))), max(int(np.ceil(width * step)), 1)
        near = moments[max(k - reach, 0) : k + reach + 1]
        return self._at(at, at.force, near[:: 1 + (len(near) - 1) // FINER])

    def _weight(self, metadata: TouchMetadata | None, n: int, moment: Floats | float) -> Floats:
        """-1 before a moment and 0 after it, or 0 and 1, (n, 1), of moments (t, 1) each, (t, n, 1); touches of unknown
        order are after it.
        """
        order = None if metadata is None else metadata.order
        before = ((np.full(n, np.inf) if order is None else order) < moment).astype(float)
        return np.asarray(-before if self.effect.is_estimated else 1 - before)[..., None]

    def _moments(self, at: TouchState) -> tuple[Floats, int]:
        """All moments between two neighbours of the touches that it acts on; fewer than three touches are outliers. And
        every how many the grid has one: it has about `_LONGEST_GRID` at most, between them the search refines.
        """
        order = at.metadata.order
        if order is None:
            return np.empty(0), 1
        acts = np.sort(order[self.acts_on(at)]).astype(float)
        between = (acts[1:] + acts[:-1]) / 2
        moments = between[2 : len(between) - 2]
        return moments, 1 + len(moments) // _LONGEST_GRID

    def _at(self, at: TouchState, force: Floats, moments: Floats) -> Sequence[Trial]:
        """A trial for each moment; where there is none, one that cannot be told from the base model."""
        moments = moments if len(moments) else np.array([0.0 if self.effect.is_estimated else np.inf])
        still = np.zeros(len(self.effect.parameters))
        errors = self.effect.sensor_error_derivative(force, still, at.metadata)
        factors = self._weight(at.metadata, len(force), moments[:, None]).swapaxes(1, 2)
        return Grid(moments, factors, Trial(self.effect.derivative(at, still), errors))


def _times(weight: Floats | float, shift: Shift) -> Shift:
    return over_arrays(lambda part: weight * part, shift)
