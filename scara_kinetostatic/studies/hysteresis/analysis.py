"""Hysteresis analysis of several records: law (6), the law selected, the errors of both on sweeps not in the fit.

Leave-one-out prediction: a record predicted from those at other tensions of the band.

Slope, gap and zero of the force sensor are the means of the other records'; the slip force of each sense is a straight
line over the tension through the other records (least squares for more than two), at least 0. Of the record itself only
its first reading is used, which gives the initial state. In a second prediction the slip force is identified from the
first sweeps of the record, which do not count for the error: it shows how much of the error is due to the slip force.

Words and units of a record driven by its motion: a force over a displacement, or a torque over an angle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.report.quantities import Scale
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.fit import Fit, fit, predict, refit, with_std
from scara_kinetostatic.studies.hysteresis.laws import SLIP, Values
from scara_kinetostatic.studies.hysteresis.model_selection import ModelSelection, effective_count, select_model
from scara_kinetostatic.studies.hysteresis.motion import Motion, motion_from_readings, repeatability


class Units(NamedTuple):
    """What is shown of a record; `LINEAR` is what tables, figures and documents are written for.

    Attributes:
        load: 'force' or 'torque'.
        response: 'displacement' or 'angle'.
        others: units, and factors to them, that take the place of those of `LINEAR`.
        si: SI units that do so.
    """

    load: str
    response: str
    others: Mapping[str, Scale]
    si: Mapping[str, str]

    def unit(self, linear: str) -> str:
        """The displayed unit in place of one of `LINEAR`."""
        return self.others[linear].unit if linear in self.others else linear

    def factor(self, linear: str, per_si: float) -> float:
        """Displayed units per SI unit, in place of that of `LINEAR`."""
        return per_si * self.others[linear].per_si if linear in self.others else per_si

    def si_unit(self, linear: str) -> str:
        """The SI unit in place of one of `LINEAR`."""
        return self.si.get(linear, linear)


LINEAR = Units('force', 'displacement', {}, {})
ROTARY = Units(
    'torque',
    'angle',
    {
        'N': Scale('Nm', 1.0),
        'kN': Scale('Nm', 1e3),
        'mm': Scale('mrad', 1.0),
        'nm/N': Scale('µrad/Nm', 1e-3),
        'Ns/mm': Scale('Nm·s/mrad', 1.0),
        'N/mm': Scale('Nm/mrad', 1.0),
    },
    {'N': 'Nm', 'm': 'rad', 'm/N': 'rad/Nm', 'Ns/m': 'Nm·s/rad', 'N s/m': 'Nm·s/rad', 'N/m': 'Nm/rad'},
)
BY_LOAD = {'N': LINEAR, 'Nm': ROTARY}
"""By the SI unit of the load."""


IDENTIFICATION_SWEEPS = 3
"""Sweeps from which the slip force is identified in the second prediction: the first one and a whole cycle."""
_SLIPS = ('slip_positive', 'slip_negative')


class LeaveOneOut(NamedTuple):
    """One record predicted from the others; all errors are over the samples after the identification sweeps.

    Attributes:
        record: its index.
        tension: of its band, in the unit given.
        backlash: rms error of law (6) with the others' parameters, N.
        by_tension: rms error of slip, slip force from the line over the tension, N.
        identified: rms error of slip, slip force identified from the first sweeps, N.
        own: rms residual of slip fitted to the record itself, N.
        slips: slip force from the line over the tension, positive and negative sense, N.
        own_slips: slip force of the record's own fit, N.
        residual: of the prediction by tension, (n,), N.
    """

    record: int
    tension: float
    backlash: float
    by_tension: float
    identified: float
    own: float
    slips: tuple[float, float]
    own_slips: tuple[float, float]
    residual: Floats


def predict_left_out(
    record: int, motions: Sequence[Motion], tensions: Sequence[float], before: Sequence[Fit], slip: Sequence[Fit]
) -> LeaveOneOut:
    """Predicts a record from all others.

    Args:
        record: its index.
        motions: of all records.
        tensions: of all records; two or more different ones among the others.
        before: law (6) fitted to each record.
        slip: slip in series fitted to each.
    """
    others = [k for k in range(len(motions)) if k != record]
    motion, own = motions[record], slip[record]
    rows = motion.sweep >= IDENTIFICATION_SWEEPS
    slips = tuple(
        max(0.0, _line([tensions[k] for k in others], [slip[k].values[name] for k in others], tensions[record]))
        for name in _SLIPS
    )
    carried = {**_mean([slip[k].values for k in others]), **dict(zip(_SLIPS, slips, strict=True)), 'start': 0.0}
    law6 = predict(before[record]._replace(values=_mean([before[k].values for k in others])), motion)
    by_tension = predict(own._replace(values=carried), motion)
    identified = refit(by_tension, motion, ~rows, only=(*_SLIPS, 'start'))
    return LeaveOneOut(
        record=record,
        tension=tensions[record],
        backlash=law6.rms(rows),
        by_tension=by_tension.rms(rows),
        identified=identified.rms(rows),
        own=rms(own.residual[rows]),
        slips=(slips[0], slips[1]),
        own_slips=(own.values[_SLIPS[0]], own.values[_SLIPS[1]]),
        residual=by_tension.residual,
    )


def _mean(several: Sequence[Values]) -> dict[str, float]:
    return {name: float(np.mean([values[name] for values in several])) for name in several[0]}


def _line(tension: Sequence[float], force: Sequence[float], at: float) -> float:
    return float(np.polynomial.Polynomial.fit(tension, force, 1)(at))


_FEWEST_RECORDS = 3
"""Records for a leave-one-out prediction: one to predict, and two for a line over the tension."""


class Record(NamedTuple):
    """One record.

    Attributes:
        source: name of its file.
        motion: cut at its reversals.
        selection: the model selection.
        parameters: of law (6) and of the selected law, with their standard deviations, by law name.
        repeatability: of the force where the motion repeats, N; NaN if it never does.
        independent: effective number of independent samples of the final law's residual.
        notes: remarks on the file.
        units: force over displacement, or torque over angle; N and m stand for Nm and rad then.
    """

    source: str
    motion: Motion
    selection: ModelSelection
    parameters: dict[str, dict[str, Estimate]]
    repeatability: float
    independent: float
    notes: tuple[str, ...]
    units: Units = LINEAR

    @property
    def name(self) -> str:
        """Name of the file without its folder."""
        return Path(self.source).name

    @property
    def compliance(self) -> float:
        """Of the selected law, m/N; converts errors of the force on an elastic branch to errors of the displacement."""
        return self.selection.final.whole.values['compliance']


class HysteresisAnalysis(NamedTuple):
    """Result of all records.

    Attributes:
        records: in the order given.
        leave_one_out: each record predicted from the others; empty without tensions.
    """

    records: tuple[Record, ...]
    leave_one_out: tuple[LeaveOneOut, ...]

    @property
    def units(self) -> Units:
        """Those of all records."""
        return self.records[0].units


def analyse_hysteresis(
    tables: Sequence[DialGaugeReadings], tensions: Sequence[float] = (), units: Units = LINEAR
) -> HysteresisAnalysis:
    """Analyses records of loops.

    Args:
        tables: each from one file, with times.
        tensions: of the band, one per table, in any unit; without them no record is predicted from the others.
        units: of the tables; for `ROTARY` their forces are torques in Nm, their displacements angles in rad.

    Raises:
        ParameterError: the tensions do not match the tables.
        UnsupportedDataError: a table has no times, or too few reversals; it is named.
    """
    check_tensions(len(tables), tensions)
    records = tuple(_record(table, units) for table in tables)
    predictions: tuple[LeaveOneOut, ...] = ()
    if tensions:
        motions = [record.motion for record in records]
        before = [record.selection.before.whole for record in records]
        slip = [_slip(record) for record in records]
        predictions = tuple(predict_left_out(k, motions, tensions, before, slip) for k in range(len(records)))
    return HysteresisAnalysis(records, predictions)


def check_tensions(records: int, tensions: Sequence[float]) -> None:
    """Checks that records can be predicted from one another.

    Args:
        records: number of records.
        tensions: of the band, one per record; none if nothing is to be predicted.

    Raises:
        ParameterError: they cannot.
    """
    if not tensions:
        return
    if len(tensions) != records:
        raise ParameterError('tension', f'expected one per file, {records}, got {len(tensions)}')
    others = [{value for j, value in enumerate(tensions) if j != k} for k in range(len(tensions))]
    if len(tensions) < _FEWEST_RECORDS or min(len(values) for values in others) < 2:
        problem = 'a line over the tension needs two different tensions among the other files'
        raise ParameterError('tension', problem, 'give three files or more, or leave the tensions out')


def _record(table: DialGaugeReadings, units: Units) -> Record:
    source = table.sources[0]
    try:
        motion = motion_from_readings(table)
    except UnsupportedDataError as error:
        raise UnsupportedDataError(f'{source}: {error.problem}', error.remedy) from error
    selection = select_model(motion)
    scores = [score for score in (selection.before, selection.selected) if score is not None]
    parameters = {score.law.name: with_std(score.whole, motion) for score in scores}
    independent = effective_count(selection.final.whole.residual[motion.scored])
    return Record(source, motion, selection, parameters, repeatability(motion), independent, table.notes, units)


def _slip(record: Record) -> Fit:
    for each in record.selection.candidates:
        if each.score.law.name == SLIP.name:
            return each.score.whole
    return fit(SLIP, record.motion, np.ones(len(record.motion), dtype=bool))
