"""Errors of the arm that are too small to be detected, with their typical sizes.

Every effect of the catalogue that was not found may be there all the same: it is a random effect of mean zero and of a
size of its own, its standard deviation (`diagnosis.mixed_model`). Of those of the robot `Undetected` holds the columns,
so that the uncertainty of a prediction contains them wherever the arm is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.effects.base import Effect, LinearEffect, SensorEffect
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import ArmClass, Cell
from scara_kinetostatic.model.effect_law import ForceDependence, Parameter, Shift, TouchState

TYPICAL: Mapping[str, tuple[float | tuple[float, ...], str]] = {
    'contact_friction': (4e-3, 'lubricated steel, pressed along the normal'),
    'sensor_rotation': (2e-3, 'a flange with pins'),
    'sensor_bias': (0.05, 'drift of a strain-gauge sensor between tare and hold'),
    'sensor_nonlinearity': (1e-4, '0.4 % of 40 N'),
    'sensor_cross_talk': (2e-3, 'calibrated six-axis sensors: 0.2 to 1 %'),
    'encoder_gain': (2e-5, 'belt or cable across the joint'),
    # the gear alone: 1.5e-4 rad or more, peak to peak (Harmonic Drive, catalogue CSF/CSG, positioning accuracy)
    'transmission_error': (2e-5, '4 arcsec: what its compensation, or an encoder at the output, leaves of a gear'),
    'joint_coupling': (2e-5, 'belt of joint 2 through the shoulder'),
    'cable_pull': ((5e-6, 2.5e-6, 8e-7), 'a soft hose: a smooth curve of 5 µrad at 1 rad, by its Taylor series'),
    'tip_shape': (2e-6, 'a ground pin'),
    'joint_hardening': (2e-9, '2 µrad at 10 Nm'),
    'joint_hysteresis': (1e-5, '2 arcsec'),
    'joint_slip': (5e-7, 'a tenth of a stiff joint'),
    'load_friction': (5e-7, 'the same'),
    'anisotropic_gripper': (2e-7, '8 µm at 40 N'),
    'anisotropic_backlash': (3e-6, 'a fit of the gripper'),
    'link_bending': (4e-7, 'a tube of aluminium'),
    'base_compliance': (1e-7, '4 µm at 40 N: a steel frame'),
    'base_tilt': (2e-2, '5 kg, 0.2 m, levelled to 2 mrad'),
    'contact_compliance': (3e-7, 'Hertz: steel on steel'),
    'object_position': (1e-5, 'a coordinate measuring machine in the workshop'),
    'plate_position': (1e-5, 'the same'),
    'object_radius': (5e-6, 'a ground pin'),
    'object_rotation': (1e-4, '10 µm over 0.1 m'),
    'object_offset': (5e-6, 'as the radius'),
    'edge_bow': (3e-6, 'a ground edge'),
    'thermal_drift': (1e-8, '6 µrad, or 6 µm per metre, in ten minutes: 0.5 K of steel, 1.15e-5 per K'),
    'shift': (3e-6, 'fastened'),
    'shift[joint1]': (5e-6, 'an encoder that keeps its zero'),
    'shift[joint2]': (5e-6, 'the same'),
    'shift[sensor]': (3e-2, 'as its drift'),
}
"""Typical size of each effect of an industrial arm by label or name, in the unit of its parameters, and what it is.
Conventions, orders of magnitude: where more is known it is declared."""
CLASSES = {ArmClass.INDUSTRIAL: 1.0, ArmClass.DESKTOP: 5.0, ArmClass.PRINTED: 25.0}
"""Classes of arms, and by what factor their typical sizes are larger; a convention."""


def typical_size(effect: Effect, parameter: int, arm: ArmClass = ArmClass.INDUSTRIAL) -> float:
    """Of one parameter of an effect on a class of arms, in its unit; a fiftieth of the largest plausible one where the
    table has none.
    """
    known = TYPICAL.get(effect.label) or TYPICAL.get(effect.name)
    size = known[0] if known else effect.parameters[parameter].scale / 50.0
    return CLASSES[arm] * (size[parameter] if isinstance(size, tuple) else size)


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

    @classmethod
    def parse(cls, text: str, effects: Mapping[str, Effect]) -> Column:
        """The column of a text, of one of the effects by label.

        Raises:
            ValueError, KeyError: it is damaged, or of no such effect.
        """
        label, values, parameter = text.split('|')
        return cls(effects[label], tuple(map(float, values.split(','))), int(parameter))


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
        return tuple(Column.parse(text, effects) for text in self.columns)

    @property
    def parameters(self) -> tuple[Parameter, ...]:  # type: ignore[override]
        """One per column, named by it."""
        described = zip(self.columns, (c.effect.parameters[c.parameter] for c in self._parsed), strict=True)
        return tuple(p._replace(name=text, meaning='undetected', start=0.0) for text, p in described)

    def shift(self, at: TouchState, values: Floats) -> Shift:
        """None where their values are zero."""
        return super().shift(at, values) if values.any() else Shift()

    def basis(self, at: TouchState) -> tuple[Shift, ...]:
        return derivatives(self._parsed, at)


def derivatives(columns: Sequence[Column], at: TouchState) -> tuple[Shift, ...]:
    """The shift per unit of each column, each effect evaluated once at the same values."""
    known = {c[:2]: c.effect.derivative(at, np.array(c.values)) for c in columns}
    return tuple(known[c[:2]][c.parameter] for c in columns)
