"""A disc that is not where it is said to be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from scara_kinetostatic.effects.base import DiscEffect, Effect, Parameter, unit_vectors
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import ForceDependence, TouchState
from scara_kinetostatic.model.quantity import displacement


@dataclass(frozen=True)
class ObjectPosition(DiscEffect):
    """The centre of the disc is displaced by (x, y): d = -(x, y).

    What the touches show are the distances between the discs, as x0, y0 and theta1 are free. With three discs a move
    that changes only the distance of two of them may be that of either.

    Attributes:
        plate: name of the plate that carries this disc alone, which may be what is displaced; empty if there is none.
    """

    plate: str = ''

    name: ClassVar[str] = 'object_position'
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter('x', 'm', 1e-3, 'true place of the centre less the stated one, x', typical=1e-4),
        Parameter('y', 'm', 1e-3, 'true place of the centre less the stated one, y', typical=-2e-4),
    )
    statement: ClassVar[str] = '{target} is not where the cell description says'
    short_statement: ClassVar[str] = '{target} displaced'
    confounded_with: ClassVar[str] = (
        'x0, y0 and theta1, if there is one disc; another disc, if the move changes the distance to that one only'
    )
    identified_by: ClassVar[str] = 'touches all round three or more discs, in both elbow postures'
    plot_variable: ClassVar[str] = 'place'
    order: ClassVar[int] = 16
    force_dependence: ClassVar[ForceDependence] = ForceDependence.NONE

    @classmethod
    def instances(cls, cell: Cell) -> Iterable[Effect]:
        plates = [disc.plate for disc in cell.discs]
        return [
            cls(disc.name, number, disc.plate if plates.count(disc.plate) == 1 else '')
            for number, disc in enumerate(cell.discs)
        ]

    def _about(self, text: str) -> str:
        return super()._about(text.replace('{target}', f'{{target}} or its plate {self.plate}') if self.plate else text)

    def correction(self, values: Mapping[str, float]) -> str:
        return f'measure {self.target} again: it stands {displacement(values["x"], values["y"])}'

    def places(self, at: TouchState) -> tuple[Floats, ...]:
        return tuple(-unit for unit in unit_vectors(len(at.normal)))
