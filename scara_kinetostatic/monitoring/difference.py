"""The difference of two calibrations with its covariance, errors that both suffer from counted once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import erfc

from scara_kinetostatic.calibration.declared_errors import DeclaredErrors
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.monitoring.fit import Fit
from scara_kinetostatic.monitoring.linear import State, same_sources, source_of
from scara_kinetostatic.monitoring.record import CalibrationRecord


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


class Difference(NamedTuple):
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
    def of(cls, before: CalibrationRecord, after: CalibrationRecord, names: Sequence[str]) -> Difference:
        """Of the values `names` that both have."""
        places = [[record.place(name) for name in names] for record in (before, after)]
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
    fit, found = Fit.of(record), dict[str, Floats]()
    declared = DeclaredErrors.of(record.arm.cell)
    for name, std in zip(declared.names, declared.units.tolist(), strict=True) if declared else ():
        found[name] = -fit.by_standard_error(fit.state.error_place(name), std, record.enlargement)[where]
    for name, std in record.arm.cell.uncertainty.nominal.items():
        found[f'nominal[{name}]'] = fit.by_standard_error(NAMES.index(name), std, record.enlargement)[where]
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
