"""What changed between two calibrations of one robot, in its uncertainty.

The touches of one calibration are held against the other one, as `verify` holds new ones (`change`): with the joint
covariance C₀ of its values and of the errors of the cell they are evidence for a change of the values,

    d = Λ⁻¹ b,    cov d = Λ⁻¹,    dᵀ Λ d ~ χ²,

b and Λ of the values that may have changed. Errors of the cell description are the same in both, as are undetected
effects of the robot, which are values of its model: C₀ says how they moved the estimates and predicts what they do to
the touches, so they cancel. The discs stand where they stood. An object that the cells describe otherwise is another
one (`change.described_otherwise`). What undetected effects of objects and sensor do to the values is

    S = (G_A - G_B)(G_A - G_B)ᵀ,

with G the change of the estimates by one standard deviation of each, and is added to C₀. Where the noise was estimated,
the F distribution takes the place of χ².

The calibration that names more effects is the one that the touches of the other are held against: each of its effects
is a value that may have changed. Effects that are not comparable (`is_comparable`) are taken as each calibration found
them for its own touches. Directions that either calibration does not determine are left out.

Which part moved says the likelihood ratio of each hypothesis (`change`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import erfc

from scara_kinetostatic.calibration.observations import UNDETECTED
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.gaussian.p_values import p_values
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.extended_model import EffectLaw, ExtendedModel
from scara_kinetostatic.model.parameters import UNITS
from scara_kinetostatic.monitoring.change import (
    CalibratedState,
    Causes,
    described_otherwise,
    hypotheses_of,
    measure,
    ranked,
)
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm

LEVEL = 0.01
"""p-value below which two calibrations differ. Source: the accepted rate of false alarms of the diagnosis."""


def is_comparable(effect: EffectLaw, one: Cell, other: Cell) -> bool:
    """Whether an effect means the same in the recordings of two cells.

    Not what happened at a moment of one recording, nor friction of a random angle, which has no value, nor what is of
    an object that the cells describe otherwise.
    """
    is_of_another = getattr(effect, 'target', '') in described_otherwise(one, other)
    return not (effect.is_stepwise or effect.off_normal_std or is_of_another)


def alone(record: CalibrationRecord, other: CalibrationRecord) -> list[EffectLaw]:
    """The effects of a calibration that another one lacks."""
    theirs = {(effect.label, effect.off_normal_std > 0) for effect in other.arm.effects}
    return [e for e in record.arm.effects if (e.label, e.off_normal_std > 0) not in theirs]


def _known_there(known: CalibrationRecord, later: CalibrationRecord) -> CalibrationRecord:
    """What a calibration knows of the robot in the touches of another one: with its effects that mean the same there,
    and with those of the other that mean nothing here, as these were found.
    """
    cell = later.arm.cell
    record = known.in_cell(cell)
    arm, size = record.arm, len(record.arm.model.names)

    def model_of(pairs: Sequence[tuple[EffectLaw, tuple[float, ...]]]) -> ExtendedModel:
        effects = tuple(effect for effect, _ in pairs)
        return ExtendedModel(arm.model.parameters, effects, tuple(values for _, values in pairs))

    mine, theirs = (list(zip(m.effects, m.effect_values, strict=True)) for m in (arm.model, later.arm.model))
    kept = [pair for pair in mine if is_comparable(pair[0], arm.cell, cell)]
    model = model_of([*kept, *(pair for pair in theirs if not is_comparable(pair[0], arm.cell, cell))])
    at = [arm.model.names.index(name) for name in model_of(kept).names]
    at += [-1] * (len(model.names) - len(at))  # exactly known: the row and column of zeros at the end
    every = [*at, *range(size, len(record.names))]
    covariance, values = np.pad(record.covariance, (0, 1))[np.ix_(every, every)], len(at)
    return replace(
        record,
        arm=replace(
            arm,
            model=model,
            covariance=covariance[:values, :values],
            undetermined=np.pad(arm.undetermined, ((0, 1), (0, 0)))[at],
        ),
        names=(*model.names, *record.names[size:]),
        values=np.concatenate([model.as_array(), record.values[size:]]),
        covariance=covariance,
    )


class ParameterChange(NamedTuple):
    """Change of one value from one calibration to the next.

    Attributes:
        name: of a parameter, or of an effect that both have.
        unit: SI.
        before: first value.
        after: second value.
        std: standard uncertainty of the difference; NaN where a calibration does not determine it, 0 where both hold
            it fixed.
    """

    name: str
    unit: str
    before: float
    after: float
    std: float

    @property
    def change(self) -> float:
        """`after` less `before`."""
        return self.after - self.before

    @property
    def z(self) -> float:
        """The change in standard uncertainties; NaN where there is none."""
        return self.change / self.std if self.std > 0 else np.nan

    @property
    def p_value(self) -> float:
        """Two-sided p-value of the change alone; NaN where there is none."""
        return float(erfc(abs(self.z) / np.sqrt(2))) if np.isfinite(self.z) else np.nan


class Change(NamedTuple):
    """What changed from one calibration to the next.

    Attributes:
        before: the first calibration.
        after: the second.
        parameters: every value that both have.
        chi_square: of the difference of all determined combinations.
        degrees_of_freedom: their number.
        p_value: of no change at all.
        causes: hypotheses of what changed.
        tip: root mean square displacement of the predicted tip at the touches of the second calibration, m.
        largest_tip: the largest there, m.
        only_before: labels of effects that the first has alone.
        only_after: labels of effects that the second has alone.
        not_compared: those of both that cannot be compared.
        notes: what limits the comparison, one sentence each.
    """

    before: CalibrationRecord
    after: CalibrationRecord
    parameters: tuple[ParameterChange, ...]
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    causes: Causes
    tip: float
    largest_tip: float
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    not_compared: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def has_changed(self) -> bool:
        """Whether the calibrations differ."""
        return self.p_value < LEVEL


def compare_records(records: Sequence[CalibrationRecord]) -> list[Change]:
    """The changes between consecutive calibrations.

    Raises:
        InputError: fewer than two, or calibrations of different robots.
    """
    if len(records) < 2:
        raise InputError('calibrations', f'expected two or more to compare, got {len(records)}')
    for record in records[1:]:
        check_same_arm(records[0].arm.cell, record.arm.cell, records[0].source, record.source)
    return [compare(before, after) for before, after in pairwise(records)]


def compare(before: CalibrationRecord, after: CalibrationRecord) -> Change:
    """What changed from one calibration of a robot to the next; it has the same undetected effects in both."""
    both, cells = (before, after), (before.arm.cell, after.arm.cell)
    only_before, only_after = (tuple(effect.label for effect in alone(*pair)) for pair in (both, both[::-1]))
    effects = (*before.arm.model.effects, *after.arm.model.effects)
    not_compared = tuple(dict.fromkeys(e.label for e in effects if not is_comparable(e, *cells)))
    known, held = both if len(only_before) >= len(only_after) else both[::-1]
    known = _known_there(known, held)
    state = CalibratedState.of(known, held.arm.cell, _by_undetected(*both, known))
    at_noise = replace(known, document=held.document, arm=replace(known.arm, noise=held.arm.noise))
    evidence = state.known.change(measure(held.touches, at_noise, state).information())
    if held is before:  # the change from it is asked for
        evidence = evidence._replace(score=-evidence.score)
    evidence = evidence.beside(_undetermined(both, state))
    names = [name for name in known.arm.model.names if not name.startswith(UNDETECTED)]
    names = [name for name in names if name in UNITS or name.rpartition('.')[0] not in not_compared]
    tested = [state.place(name) for name in names if not _is_fixed(name, both)]
    test = evidence.ratio(tested)
    noise = sum(r.noise_freedoms for r in both if np.isfinite(r.noise_freedoms)) or np.inf
    p_value = float(p_values(test.statistic, test.freedoms, noise))
    causes = Causes()
    if p_value < LEVEL:
        others = {*range(state.values)} - {*tested}
        hypotheses = [h for h in hypotheses_of(state) if not {*h.places} & others]
        ranking = ranked(hypotheses, evidence, state)
        total = evidence.ratio(sorted({*tested, *ranking[0].places}))
        causes = Causes.of(ranking, (total.statistic, total.freedoms, noise))
    found = dict(zip(tested, (state.scale[tested] * [test.change, test.std]).T.tolist(), strict=True))
    parameters = []
    for name in names:
        place = state.place(name)
        value, (change, std) = float(known.values[place]), found.get(place, (_difference(name, both), 0.0))
        first, last = (value, value + change) if held is after else (value - change, value)
        parameters.append(ParameterChange(name, state.units[place], first, last, std))
    off = after.tip_moved(before.arm, after.arm)
    return Change(
        before=before,
        after=after,
        parameters=tuple(parameters),
        chi_square=test.statistic,
        degrees_of_freedom=test.freedoms,
        p_value=p_value,
        causes=causes,
        tip=rms(off),
        largest_tip=float(off.max(initial=0.0)),
        only_before=only_before,
        only_after=only_after,
        not_compared=not_compared,
        notes=tuple(_notes(before, after, parameters)),
    )


def _difference(name: str, both: Sequence[CalibrationRecord]) -> float:
    """Of a value of which neither calibration says more; 0 where one lacks it."""
    one, other = (record.values[record.place(name)] if name in record.names else np.nan for record in both)
    return float(np.nan_to_num(other - one))


def _is_fixed(name: str, both: Sequence[CalibrationRecord]) -> bool:
    """Whether both calibrations hold a value."""
    return all(name in record.fixed or name in record.arm.model.held for record in both)


def _undetermined(both: Sequence[CalibrationRecord], state: CalibratedState) -> Floats:
    """Directions of the state that one of two calibrations does not determine, in units of its scale, (p, u)."""
    columns = []
    for record in both:
        names, part = record.arm.model.names, record.arm.undetermined
        column = np.zeros((len(state.names), part.shape[1]))
        own = [name for name in state.names[: state.values] if name in names]
        column[[state.place(name) for name in own]] = part[[names.index(name) for name in own]]
        columns.append(column / state.scale[:, None])
    return np.concatenate(columns, axis=1)


def _by_undetected(before: CalibrationRecord, after: CalibrationRecord, known: CalibrationRecord) -> Floats:
    """Changes of the difference of all values by one standard deviation of each undetected effect of objects and
    sensor, SI, (v, u): they are the same in both calibrations, but other touches show other parts of them.
    """
    names, parts = known.arm.model.names, list[dict[str, tuple[float, Floats]]]()
    for one in (before.undetected, after.undetected):
        rows = zip(one.columns, one.of_robot, one.size.tolist(), one.at(names).T, strict=True)
        parts.append({column: (size, moved) for column, of_robot, size, moved in rows if not of_robot})
    found, nothing = [], (0.0, np.zeros(len(names)))
    for column in parts[0] | parts[1]:
        (size, moved), (other_size, other) = (part.get(column, nothing) for part in parts)
        one = (size * other_size) ** 0.5
        found.append(other * (one / other_size) - moved * (one / size) if one else moved + other)
    of_errors = len(known.names) - len(names)
    return np.pad(np.reshape(found, (-1, len(names))).T, ((0, of_errors), (0, 0)))


def _notes(before: CalibrationRecord, after: CalibrationRecord, parameters: Sequence[ParameterChange]) -> list[str]:
    """What limits a comparison."""
    notes, single = [], [p.name for p in parameters if np.isnan(p.std)]
    if single:
        notes += [f'{", ".join(single)}: not determined each by itself; compared only in combination, if at all']
    if before.checksums & after.checksums:
        same = 'both calibrations contain the same recording'
        notes += [f'{same}: they are not independent, and the p-value is not valid']
    if before.fixed != after.fixed or any(p.std == 0 and p.change for p in parameters):
        notes += ['the calibrations hold other parameters fixed: a wrong fixed value looks like a change']
    return notes + [f'{record.source} is unfit for use' for record in (before, after) if record.arm.grade == 'unfit']
