"""Hysteresis analysis of several records: law (6), the law selected, the errors of both on sweeps not in the fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.fit import Fit, fit, with_std
from scara_kinetostatic.studies.hysteresis.laws import SLIP
from scara_kinetostatic.studies.hysteresis.leave_one_out import LeaveOneOut, predict_left_out
from scara_kinetostatic.studies.hysteresis.model_selection import (
    ModelSelection,
    effective_count,
    select_model,
)
from scara_kinetostatic.studies.hysteresis.motion import Motion, motion_from_readings, repeatability
from scara_kinetostatic.studies.hysteresis.units import LINEAR, Units

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
