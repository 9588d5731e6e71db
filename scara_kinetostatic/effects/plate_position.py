"""A plate of several discs that is not where it is said to be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.effects.base import Effect, LinearEffect, Parameter, unit_vectors
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Shift, TouchState
from scara_kinetostatic.model.quantity import displacement


@dataclass(frozen=True)
class PlatePosition(LinearEffect):
    """All discs of the plate are displaced by (x, y): d = -(x, y) in their touches.

    A cell has it for each of its plates that carries several discs, but not all: a plate of one disc is that disc, and
    one of all discs is the base the other way.

    Attributes:
        discs: their numbers in the cell.
    """

    discs: tuple[int, ...] = ()

    name: ClassVar[str] = 'plate_position'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('x', 'm', 1e-3, 'true place of the plate less the stated one, x', typical=1e-4),
        Parameter('y', 'm', 1e-3, 'true place of the plate less the stated one, y', typical=-2e-4),
    )
    statement: ClassVar[str] = 'the plate {target} is not where the cell description says'
    short_statement: ClassVar[str] = 'plate {target} displaced'
    confounded_with: ClassVar[str] = 'the only disc, or the only plate, that is not on it, displaced the other way'
    identified_by: ClassVar[str] = 'touches all round its discs and two or more others that are not mounted together'
    plot_variable: ClassVar[str] = 'place'
    on_object: ClassVar[bool] = True
    order: ClassVar[int] = 26
    force_dependence: ClassVar[ForceDependence] = ForceDependence.NONE

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        for plate in cell.plates:
            discs = tuple(number for number, disc in enumerate(cell.discs) if disc.plate == plate.name)
            if 1 < len(discs) < len(cell.discs):
                yield cls(target=plate.name, discs=discs)

    def correction(self, values: Mapping[str, float]) -> str:
        return f'measure the place of plate {self.target} again: it stands {displacement(values["x"], values["y"])}'

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        touched = self.acts_on(at)[:, None]
        return tuple(Shift(place=touched * -unit) for unit in unit_vectors(len(touched)))

    def acts_on(self, at: TouchState) -> NDArray[np.bool_]:
        return np.asarray(np.isin(at.metadata.disc, self.discs))
