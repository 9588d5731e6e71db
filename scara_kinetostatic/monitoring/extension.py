"""A calibration extended by effects that another one has found, by its own touches and to first order.

With r and J the whitened residuals and the derivatives of `linear` at the calibrated values, K those by the values θ
of the further effects, and Ĉ the covariance of all that was free in the fit,

    θ = (Kᵀ W K)⁻¹ Kᵀ r,    W = I - J Ĉ Jᵀ,    cov θ = (Kᵀ W K)⁻¹,

and the values that the calibration has change by -M θ, M = Ĉ Jᵀ K, with the further covariance M cov θ Mᵀ. r contains
what the declared errors have been estimated at; at the optimum it is orthogonal to all of J but their prior.

K is taken at the values that the other calibration has found: the direction of a periodic effect, say, has no
derivative where its amplitude is zero. What the touches do not show of θ is undetermined.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from scara_kinetostatic.files.effect_entry import effect_entry, read_effect
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.effect_law import EffectLaw
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.monitoring.fit import Fit
from scara_kinetostatic.monitoring.linear import State, measure
from scara_kinetostatic.monitoring.record import CalibrationRecord

_OF_THE_CELL = ('disc', 'discs', 'plate')
"""Fields of an effect that say where in a cell its object is."""
_SHOWN = 1e-9
"""Information on a combination of values, in the largest of all, below which the touches do not show it."""


def with_common_effects(
    before: CalibrationRecord, after: CalibrationRecord
) -> tuple[CalibrationRecord, CalibrationRecord]:
    """Two calibrations, each extended by the effects that the other has found and that can be compared."""
    return _extended(before, after), _extended(after, before)


def is_comparable(effect: EffectLaw, one: Cell, other: Cell) -> bool:
    """Whether an effect means the same in the recordings of two cells.

    Not what happened at a moment of one recording, nor friction of a random angle, which has no value, nor an error of
    an object that the cells describe otherwise: a description may have been corrected.
    """
    if effect.is_stepwise or effect.off_normal_std:
        return False
    stated = [_stated(cell).get(getattr(effect, 'target', None)) for cell in (one, other)]
    return stated[0] == stated[1]


def _stated(cell: Cell) -> dict[str | None, tuple[float, ...]]:
    """Place and, of a disc, radius of each object and plate by name."""
    stated: dict[str | None, tuple[float, ...]] = {plate.name: (plate.x, plate.y) for plate in cell.plates}
    return stated | {disc.name: (disc.x, disc.y, disc.radius) for disc in cell.discs}


def alone(record: CalibrationRecord, other: CalibrationRecord) -> list[EffectLaw]:
    """The effects of a calibration that another one lacks."""
    theirs = {(effect.label, effect.off_normal_std > 0) for effect in other.arm.model.effects}
    return [e for e in record.arm.model.effects if (e.label, e.off_normal_std > 0) not in theirs]


def _extended(record: CalibrationRecord, other: CalibrationRecord) -> CalibrationRecord:
    cell, model = record.arm.cell, other.arm.model
    own = {effect.label for effect in record.arm.model.effects}
    values = dict(zip((effect.label for effect in model.effects), model.effect_values, strict=True))
    missing = [e for e in alone(other, record) if e.label not in own and is_comparable(e, cell, other.arm.cell)]
    if not missing:
        return record
    effects = [_in_cell(effect, cell, other.source) for effect in missing]
    return extended(record, effects, [values[effect.label] for effect in effects])


def _in_cell(effect: EffectLaw, cell: Cell, where: str) -> EffectLaw:
    """The same effect in a cell that may number its objects otherwise.

    Raises:
        CalibrationFileError: there is none.
    """
    entry = effect_entry(effect)
    own = {name: value for name, value in entry['fields'].items() if name not in _OF_THE_CELL}
    return read_effect(entry | {'fields': own}, cell, where)


def extended(
    record: CalibrationRecord, effects: Sequence[EffectLaw], at: Sequence[tuple[float, ...]]
) -> CalibrationRecord:
    """A calibration with further effects, whose values its touches determine.

    Args:
        record: the calibration.
        effects: that it lacks.
        at: values of each at which it is linearised.
    """
    wide = _padded(record, effects, at)
    new = np.arange(len(record.arm.model.names), len(wide.arm.model.names))
    residual = measure(record.touches, record, State.of(record).of_stored_forces()).residual.ravel()
    state, jacobian, knowledge = Fit.of(wide, new)
    columns = jacobian[:, new]
    by_new = -knowledge @ (jacobian.T @ columns)  # -M
    information = columns.T @ (columns + jacobian @ by_new)
    by_new[new] += np.eye(len(new))
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    shown = values > _SHOWN * float((columns**2).sum(axis=0).max(initial=1e-12))
    root = by_new @ (vectors[:, shown] / np.sqrt(values[shown]))
    found = root @ ((vectors[:, shown] / np.sqrt(values[shown])).T @ (columns.T @ residual))
    return _changed(wide, state, found, root, by_new @ vectors[:, ~shown])


def _padded(
    record: CalibrationRecord, effects: Sequence[EffectLaw], at: Sequence[tuple[float, ...]]
) -> CalibrationRecord:
    """The calibration with the effects at these values in its model; zero, exactly, among its values."""
    arm, m = record.arm, record.arm.model
    model = ExtendedModel(m.parameters, (*m.effects, *effects), (*m.effect_values, *map(tuple, at)))
    size, total = len(m.names), len(model.names)
    places = np.r_[:size, total : len(record.names) + total - size]
    values = np.zeros(len(record.names) + total - size)
    covariance = np.zeros((len(values), len(values)))
    values[places], covariance[np.ix_(places, places)] = record.values, record.covariance
    undetermined = np.concatenate([arm.undetermined, np.zeros((total - size, arm.undetermined.shape[1]))])
    arm = replace(arm, model=model, covariance=covariance[:total, :total], undetermined=undetermined)
    return replace(record, arm=arm, names=(*model.names, *record.names[size:]), values=values, covariance=covariance)


def _changed(
    record: CalibrationRecord, state: State, change: Floats, root: Floats, hidden: Floats
) -> CalibrationRecord:
    """A calibration whose values change, with a further covariance root rootᵀ and further undetermined directions.

    All in units of the scale of the state, (p, …).
    """
    total = len(record.arm.model.names)
    places = [*range(total), *(state.error_place(name) for name in record.names[total:])]
    scale = state.scale[places]
    values = record.values + scale * change[places]
    further = scale[:, None] * root[places]
    covariance = record.covariance + further @ further.T
    undetermined = np.concatenate([record.arm.undetermined, scale[:total, None] * hidden[:total]], axis=1)
    model = record.arm.model.with_array(values[:total])
    arm = replace(record.arm, model=model, covariance=covariance[:total, :total], undetermined=undetermined)
    return replace(record, arm=arm, values=values, covariance=covariance)
