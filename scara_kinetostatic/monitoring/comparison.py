r"""What changed between two calibrations of one robot, in its uncertainty.

Both estimates are moved by the same errors of the cell description: the discs stand where they stood. With G the change
of an estimate by an error of one standard uncertainty, its column of the joint covariance, the difference has the
covariance

    S = N_A + N_B + Σ_common (G_A - G_B)(G_A - G_B)ᵀ + Σ_others G Gᵀ,

N what noise and the choice among credible models contribute. Two calibrations by the same plan have nearly the same G,
and declared errors cancel. Sources are common where both cells describe the same thing alike: an object of the same
name, place, radius and uncertainty, the same sensor, the same trusted nominal value.

Directions that either calibration does not determine are left out: only combinations of values that both determine are
compared. The global test is Δᵀ S⁺ Δ ~ χ²; where the noise was estimated, the F distribution takes its place. Which part
moved says the likelihood ratio of each hypothesis (`hypotheses`). An object that moved shows by what its move does to
the second estimate, C Jᵀ J_e.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, erfc, fdtrc

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.calibration.identifiability import SCALES
from scara_kinetostatic.compensation.predictions import Predictor
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.monitoring.hypotheses import Explanation, explanations, hypotheses_of, rivals
from scara_kinetostatic.monitoring.linear import Evidence, Information, State, measure, same_sources, source_of
from scara_kinetostatic.monitoring.record import CalibrationRecord

LEVEL = 0.01
"""p-value below which two calibrations differ. Source: the accepted rate of false alarms of the diagnosis."""
_RANK = 1e-10
"""Variance of a combination, in the largest of all, below which both calibrations hold it fixed."""


class ParameterChange(NamedTuple):
    """Change of one value from one calibration to the next.

    Attributes:
        name: of a parameter, or of an effect that both have.
        unit: SI.
        before: first value.
        after: second value.
        std: standard uncertainty of the difference; NaN where a calibration does not determine it, 0 where both hold
            it fixed.
        std_independent: the same if nothing were common to both calibrations.
    """

    name: str
    unit: str
    before: float
    after: float
    std: float
    std_independent: float

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
        ranking: hypotheses of what changed, the best first.
        rivals: names of those that explain the difference about as well as the first.
        remaining_p_value: of nothing else having changed than the first hypothesis says.
        tip: root mean square displacement of the predicted tip at the touches of the second calibration, m.
        largest_tip: the largest there, m.
        only_before: labels of effects that the first has alone.
        only_after: labels of effects that the second has alone.
        notes: what limits the comparison, one sentence each.
    """

    before: CalibrationRecord
    after: CalibrationRecord
    parameters: tuple[ParameterChange, ...]
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    ranking: tuple[Explanation, ...]
    rivals: tuple[str, ...]
    remaining_p_value: float
    tip: float
    largest_tip: float
    only_before: tuple[str, ...]
    only_after: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def has_changed(self) -> bool:
        """Whether the calibrations differ."""
        return self.p_value < LEVEL


def compare_records(records: Sequence[CalibrationRecord]) -> list[Change]:
    """The changes between consecutive calibrations.

    Raises:
        InputError: fewer than two, or calibrations of different robots or cells.
    """
    if len(records) < 2:
        raise InputError('calibrations', f'expected two or more to compare, got {len(records)}')
    for record in records[1:]:
        check_same_robot(records[0], record)
    return [compare(before, after) for before, after in pairwise(records)]


def check_same_robot(one: CalibrationRecord, other: CalibrationRecord) -> None:
    """Check that two calibrations are of one robot in one cell.

    Raises:
        InputError: they are not.
    """
    a, b = one.arm.cell, other.arm.cell
    remedy = 'give calibrations of one robot and cell'
    for name in ('robot', 'serial_number', 'cell'):
        first, second = getattr(a.identification, name), getattr(b.identification, name)
        if first and second and first != second:
            problem = f'is of {name.replace("_", " ")} {second!r}, and {one.source} of {first!r}'
            raise InputError(other.source, problem, remedy)
    off = np.abs(a.nominal.as_array() - b.nominal.as_array()) > SCALES
    if off.any():
        name = NAMES[int(np.argmax(off))]
        values = f'{getattr(b.nominal, name):g} and {getattr(a.nominal, name):g} {UNITS[name]}'
        raise InputError(other.source, f'is of another robot than {one.source}: nominal {name} is {values}', remedy)
    if a.gripper != b.gripper:
        raise InputError(other.source, f'has another gripper law (model) than {one.source}', remedy)
    if not {(d.name, d.x, d.y, d.radius) for d in a.discs} & {(d.name, d.x, d.y, d.radius) for d in b.discs}:
        raise InputError(other.source, f'is of another cell than {one.source}: no object is in both', remedy)


def compare(before: CalibrationRecord, after: CalibrationRecord) -> Change:
    """What changed from one calibration to the next; `check_same_robot` has found nothing."""
    names = tuple(name for name in before.arm.model.names if name in after.arm.model.names)
    difference = _Difference.of(before, after, names)
    kept = difference.combinations
    combined = kept @ difference.change
    values, vectors = np.linalg.eigh(kept @ difference.covariance @ kept.T)
    large = values > _RANK * max(float(values.max(initial=0.0)), 1e-30)
    root = (vectors[:, large] / np.sqrt(values[large])).T @ kept
    whitened = root @ difference.change
    chi_square, freedoms = float(whitened @ whitened), int(large.sum())
    evidence, state = _evidence(root, difference.change, names, after)
    hypotheses = [h for h in hypotheses_of(state, len(after.arm.model.names)) if _is_comparable(h.places, names, after)]
    ranking = explanations(evidence, state, hypotheses)
    best = ranking[0]
    noise = _noise_freedoms(before, after)
    held = np.abs(vectors[:, ~large].T @ combined).max(initial=0.0) > 1e-9
    left = chi_square - best.statistic
    tip = _tip_change(before, after)
    return Change(
        before=before,
        after=after,
        parameters=difference.parameters,
        chi_square=chi_square,
        degrees_of_freedom=freedoms,
        p_value=p_of(chi_square, freedoms, noise),
        ranking=tuple(ranking),
        rivals=tuple(rivals(ranking, evidence)),
        remaining_p_value=p_of(max(left, 0.0), max(freedoms - len(best.change), 0), noise),
        tip=rms(tip),
        largest_tip=float(tip.max(initial=0.0)),
        only_before=_only(before, after),
        only_after=_only(after, before),
        notes=tuple(_notes(before, after, bool(held))),
    )


class _Difference(NamedTuple):
    """The difference of common values, in units of their plausible ranges.

    Attributes:
        change: after less before, (p,).
        covariance: S, (p, p).
        combinations: of values that both determine, (r, p).
        parameters: the values one by one.
    """

    change: Floats
    covariance: Floats
    combinations: Floats
    parameters: tuple[ParameterChange, ...]

    @classmethod
    def of(cls, before: CalibrationRecord, after: CalibrationRecord, names: Sequence[str]) -> _Difference:
        """Of the values `names` that both have."""
        places = [[record.names.index(name) for name in names] for record in (before, after)]
        values = [record.values[where] for record, where in zip((before, after), places, strict=True)]
        s, independent = _covariances(before, after, places)
        scale = State.of(after).scale[places[1]]
        undetermined = np.concatenate(
            [r.arm.undetermined[[r.arm.model.names.index(n) for n in names]] for r in (before, after)], axis=1
        )
        combinations = _null_space((undetermined / scale[:, None]).T, len(names))
        stds = [np.sqrt(np.clip(np.diag(matrix), 0.0, None)) for matrix in (s, independent)]
        hidden = np.linalg.norm(undetermined, axis=1) > stds[1]
        stds = [np.where(hidden, np.nan, std) for std in stds]
        units = _units(after)
        rows = zip(names, *(part.tolist() for part in (*values, *stds)), strict=True)
        parameters = tuple(ParameterChange(row[0], units[row[0]], *row[1:]) for row in rows)
        return cls((values[1] - values[0]) / scale, s / np.outer(scale, scale), combinations, parameters)


def _units(record: CalibrationRecord) -> dict[str, str]:
    units = dict(UNITS)
    for effect in record.arm.model.effects:
        units |= {f'{effect.label}.{p.name}': p.unit for p in effect.parameters}
    return units


def _null_space(rows: Floats, size: int) -> Floats:
    """Orthonormal combinations (r, size) that are zero along all rows."""
    if not len(rows):
        return np.eye(size)
    _, singular, right = np.linalg.svd(rows, full_matrices=True)
    rank = int((singular > 1e-9 * singular.max(initial=0.0)).sum()) if len(singular) else 0
    return np.asarray(right[rank:])


def _covariances(before: CalibrationRecord, after: CalibrationRecord, places: list[list[int]]) -> tuple[Floats, Floats]:
    """S of the difference, and what it would be if nothing were common; SI, (p, p) each."""
    by_error = [_by_error(record, where) for record, where in zip((before, after), places, strict=True)]
    common = _common(before.arm.cell, after.arm.cell) & by_error[0].keys() & by_error[1].keys()
    covariances = [r.covariance[np.ix_(where, where)] for r, where in zip((before, after), places, strict=True)]
    independent = covariances[0] + covariances[1]
    s = independent.copy()
    for name in common:  # (a - b)(a - b)ᵀ in the place of a aᵀ + b bᵀ
        a, b = by_error[0][name], by_error[1][name]
        s -= np.outer(a, b) + np.outer(b, a)
    return s, independent


def _by_error(record: CalibrationRecord, where: list[int]) -> dict[str, Floats]:
    """What an error of one standard uncertainty does to the values, by its name, (p,) each, SI."""
    declared = DeclaredErrors.of(record.arm.cell)
    spread = np.sqrt(record.enlargement)
    found: dict[str, Floats] = {}
    for name, std in zip(declared.names, declared.units.tolist(), strict=True) if declared else ():
        if name in record.names:
            found[name] = -record.covariance[where, record.names.index(name)] / (std * spread)
    for name, std in record.arm.cell.uncertainty.nominal.items():
        if name not in record.fixed:
            found[f'nominal[{name}]'] = record.covariance[where, NAMES.index(name)] / (std * spread)
    return found


def _common(a: Cell, b: Cell) -> set[str]:
    """Names of the declared errors that are the same in both cells."""
    labels, found = same_sources(a, b), set()
    declared = DeclaredErrors.of(a)
    other = DeclaredErrors.of(b)
    if declared is not None and other is not None:
        stds = dict(zip(other.names, other.units.tolist(), strict=True))
        pairs = zip(declared.names, declared.units.tolist(), strict=True)
        found = {name for name, std in pairs if source_of(name) in labels and stds.get(name) == std}
    for name, std in a.uncertainty.nominal.items():
        if b.uncertainty.nominal.get(name) == std and getattr(a.nominal, name) == getattr(b.nominal, name):
            found.add(f'nominal[{name}]')
    return found


def _evidence(root: Floats, change: Floats, names: Sequence[str], after: CalibrationRecord) -> tuple[Evidence, State]:
    """Evidence for changes of values and of the cell, in the state of the second calibration."""
    cell = replace(after.arm.cell, sensor=after.arm.cell.sensor._replace(frame=SensorFrame.BASE))
    state = State.of(after, cell)
    forces = [k for k, name in enumerate(state.names) if name in ('force_gain', 'force_rotation')]
    values = len(after.arm.model.names)
    errors = state.errors.copy()
    errors[np.array(forces, dtype=np.intp) - values] = 0.0  # the stored forces are corrected
    information = Information.of(measure(after.touches, after, state._replace(errors=errors)))
    moved = state.covariance @ information.matrix  # of the estimates by true errors of the cell
    where = [state.place(name) for name in names]
    response = np.zeros((len(names), len(state.names)))
    response[np.arange(len(names)), where] = 1.0
    response[:, values:] = moved[where][:, values:]
    rows = root @ response
    return Evidence(rows.T @ (root @ change), rows.T @ rows), state


def _is_comparable(places: Sequence[int], names: Sequence[str], after: CalibrationRecord) -> bool:
    """Whether a hypothesis is about values that both calibrations have, or about the cell."""
    own = after.arm.model.names
    return all(place >= len(own) or own[place] in names for place in places)


def _noise_freedoms(before: CalibrationRecord, after: CalibrationRecord) -> float:
    """Degrees of freedom of the noise levels: infinite where both were given."""
    finite = [r.noise_freedoms for r in (before, after) if np.isfinite(r.noise_freedoms)]
    return sum(finite) if finite else np.inf


def p_of(chi_square: float, freedoms: int, noise_freedoms: float) -> float:
    """p-value of a chi-square whose noise was estimated with some degrees of freedom, infinite where it is known."""
    if not freedoms:
        return 1.0
    if np.isinf(noise_freedoms):
        return float(chdtrc(freedoms, chi_square))
    return float(fdtrc(freedoms, noise_freedoms, chi_square / freedoms))


def _tip_change(before: CalibrationRecord, after: CalibrationRecord) -> Floats:
    """Displacement of the predicted tip at the touches of the second calibration, (n,), m."""
    touches = after.touches
    tips = [Predictor(record.arm).locate(touches.joints, touches.force).position for record in (before, after)]
    return np.asarray(np.linalg.norm(tips[1] - tips[0], axis=1))


def _only(one: CalibrationRecord, other: CalibrationRecord) -> tuple[str, ...]:
    theirs = {effect.label for effect in other.arm.model.effects}
    return tuple(effect.label for effect in one.arm.model.effects if effect.label not in theirs)


def _notes(before: CalibrationRecord, after: CalibrationRecord, held: bool) -> list[str]:
    notes = []
    if before.checksums & after.checksums:
        notes.append(
            'both calibrations contain the same recording: they are not independent, and the p-value is not valid'
        )
    if before.fixed != after.fixed or held:
        notes.append('the calibrations hold other parameters fixed: a wrong fixed value looks like a change')
    if _only(before, after) or _only(after, before):
        notes.append('the calibrations found other model errors: one that only one of them has can move the parameters')
    if before.created and after.created and before.created > after.created:
        notes.append(f'{after.source} is older than {before.source}: they are compared in the order given')
    grades = [r.source for r in (before, after) if r.arm.grade == 'unfit']
    return notes + [f'{source} is unfit for use' for source in grades]
