"""Random effects: every error of the catalogue that was not found is in the fit all the same, with a prior.

Each is a sum of columns, its derivatives by its amplitudes (`effects.undetected`), taken where the touches are and
held: they are small. The value u of a column has the prior N(0, 1) in units of its size, and shifts each touch by

    δ u, rad, of the joints;  d u, m, of the place;  e u, N, of the sensor,

as the effect itself does. So it is an error like the declared ones (`declared_errors`), at the end of their vector.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.calibration.declared_errors import Source
from scara_kinetostatic.effects.undetected import Column, Undetected, derivatives
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import EffectLaw, TouchState

UNDETECTED = 'undetected'
"""What undetected effects of a name contribute has the label ``undetected[name]``."""

RIVALS = 'rivals'
"""Label of what the choice between rival effects contributes."""

LARGE_EFFECT = f'{UNDETECTED}[large_effect]'
"""Label of what a single large effect contributes that the touches neither show nor exclude."""


class RandomEffects(NamedTuple):
    """The columns of all random effects at n touches.

    Attributes:
        columns: what they are, k of them, those of the robot first.
        size: prior standard deviation of each, (k,), in its unit.
        joints: δ by one standard deviation, (n, 2, k), rad.
        place: d by one, (n, 2, k), m.
        sensor: e by one, (n, 2, k), N, in the sensor's frame.
        stated: declared standard deviations by label or name of the effect.
    """

    columns: tuple[Column, ...]
    size: Floats
    joints: Floats
    place: Floats
    sensor: Floats
    stated: dict[str, float]

    @classmethod
    def at(
        cls, columns: Sequence[Column], size: Floats, at: TouchState, force: Floats, stated: dict[str, float]
    ) -> RandomEffects:
        """Columns of some sizes at touches with true forces in the sensor's frame (n, 2), N."""
        n, k = len(force), len(columns)
        joints, place, sensor = np.zeros((3, n, 2, k))
        for number, shift in enumerate(derivatives(columns, at)):
            for out, part in ((joints, shift.joints), (place, shift.place)):
                if part is not None:
                    out[:, :, number] = part
        errors = {c[:2]: c.effect.sensor_error_derivative(force, np.array(c.values), at.metadata) for c in columns}
        for number, column in enumerate(columns):
            if errors[column[:2]]:
                sensor[:, :, number] = errors[column[:2]][column.parameter]
        return cls(tuple(columns), size, joints * size, place * size, sensor * size, stated)

    def resized(self, factor: Floats) -> RandomEffects:
        """The same with sizes larger by factors (k,)."""
        size, joints, place, sensor = (factor * part for part in (self.size, self.joints, self.place, self.sensor))
        return self._replace(size=size, joints=joints, place=place, sensor=sensor)

    def summed(self, values: Floats) -> RandomEffects:
        """One column: all with their values (k,)."""
        joints, place, sensor = ((part @ values)[:, :, None] for part in (self.joints, self.place, self.sensor))
        return self._replace(columns=self.columns[:1], size=np.ones(1), joints=joints, place=place, sensor=sensor)

    def select(self, which: Any) -> RandomEffects:
        """At the touches that a mask, a slice or an array of positions picks."""
        return self._replace(joints=self.joints[which], place=self.place[which], sensor=self.sensor[which])

    def stated_size(self, column: Column) -> float:
        """The declared standard deviation of its effect; NaN where none is declared."""
        return self.stated.get(column.effect.label, self.stated.get(column.effect.name, np.nan))

    @property
    def of_robot(self) -> int:
        """How many columns move the robot."""
        return sum(column.moves_robot for column in self.columns)

    @property
    def sources(self) -> tuple[Source, ...]:
        """One for each column; those of effects of one name have one label."""
        return tuple(
            Source(f'{UNDETECTED}[{c.effect.name}]', self.stated_size(c), c.effect.parameters[c.parameter].unit)
            for c in self.columns
        )

    def effects(self, cell: Cell) -> tuple[EffectLaw, ...]:
        """Those of the robot as effects of the model (`Undetected`)."""
        return Undetected.of(cell, self.columns[: self.of_robot])
