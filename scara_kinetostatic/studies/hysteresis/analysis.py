"""Measured loops of several records: law (6), what it lacks, the error before and after on sweeps not in the fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.fit import Fit, fit, with_std
from scara_kinetostatic.studies.hysteresis.laws import SLIP
from scara_kinetostatic.studies.hysteresis.leave_one_out import Transfer, transfer
from scara_kinetostatic.studies.hysteresis.model_selection import Choice, Score, choose, effective_count, refine_as
from scara_kinetostatic.studies.hysteresis.motion import Motion, motion_of, repeatability

FEWEST_RECORDS = 3
"""One to predict, and two for a line over the tension."""


class Record(NamedTuple):
    """One record.

    Attributes:
        source: name of its file.
        motion: cut at its reversals.
        choice: what was decided.
        parameters: of law (6), of the winner and of the winner refined, with their standard deviations, by law name.
        repeatability: of the force where the motion repeats, N; NaN if it never does.
        independent: samples that the residual after is worth.
        notes: what the reader of its file found worth saying.
    """

    source: str
    motion: Motion
    choice: Choice
    parameters: dict[str, dict[str, Estimate]]
    repeatability: float
    independent: float
    notes: tuple[str, ...]

    @property
    def compliance(self) -> float:
        """Of the named law, m/N: turns an error of the force on an elastic branch into one of the displacement."""
        return (self.choice.winner or self.choice.before).whole.values['compliance']


class Borrowed(NamedTuple):
    """A record's winner with the refinements that another record has asked for: numbers of both, and how it does."""

    record: int
    other: int
    score: Score


class HysteresisStudy(NamedTuple):
    """What all records say.

    Attributes:
        records: in the order given.
        borrowed: each record refined as every other one with the same winner.
        transfers: each record predicted from the others; empty without tensions.
    """

    records: tuple[Record, ...]
    borrowed: tuple[Borrowed, ...]
    transfers: tuple[Transfer, ...]


def hysteresis_study(tables: Sequence[DialGaugeReadings], tensions: Sequence[float] = ()) -> HysteresisStudy:
    """Closes the loop on measured loops.

    Args:
        tables: each from one file, with times.
        tensions: of the band, one per table, in any unit; without them no record is predicted from the others.

    Raises:
        ParameterError: the tensions do not match the tables.
        UnsupportedDataError: a table has no times, or too few reversals; it is named.
    """
    check_tensions(len(tables), tensions)
    records = tuple(_record(table) for table in tables)
    transfers: tuple[Transfer, ...] = ()
    if tensions:
        motions = [record.motion for record in records]
        before = [record.choice.before.whole for record in records]
        slip = [_slip(record) for record in records]
        transfers = tuple(transfer(k, motions, tensions, before, slip) for k in range(len(records)))
    return HysteresisStudy(records, _borrowed(records), transfers)


def check_tensions(records: int, tensions: Sequence[float]) -> None:
    """Whether records can be predicted from one another.

    Raises:
        ParameterError: they cannot.
    """
    if not tensions:
        return
    if len(tensions) != records:
        raise ParameterError('tension', f'expected one per file, {records}, got {len(tensions)}')
    others = [{value for j, value in enumerate(tensions) if j != k} for k in range(len(tensions))]
    if len(tensions) < FEWEST_RECORDS or min(len(values) for values in others) < 2:
        problem = 'a line over the tension needs two different ones among the other files'
        raise ParameterError('tension', problem, 'give three files or more, or leave the tensions out')


def _record(table: DialGaugeReadings) -> Record:
    source = table.sources[0]
    try:
        motion = motion_of(table)
    except UnsupportedDataError as error:
        raise UnsupportedDataError(f'{source}: {error.problem}', error.remedy) from error
    choice = choose(motion)
    scores = [score for score in (choice.before, choice.winner, choice.after) if score is not None]
    parameters = {score.law.name: with_std(score.whole, motion) for score in scores}
    independent = effective_count(choice.after.whole.residual[motion.scored])
    return Record(source, motion, choice, parameters, repeatability(motion), independent, table.notes)


def _borrowed(records: Sequence[Record]) -> tuple[Borrowed, ...]:
    found = []
    for k, record in enumerate(records):
        own = record.choice.winner
        for j, other in enumerate(records):
            theirs = other.choice.winner
            if j == k or own is None or theirs is None or own.law.name != theirs.law.name:
                continue
            if '+' in other.choice.after.law.name:
                found.append(Borrowed(k, j, refine_as(own, other.choice.after, record.motion)))
    return tuple(found)


def _slip(record: Record) -> Fit:
    for each in record.choice.candidates:
        if each.score.law.name == SLIP.name:
            return each.score.whole
    return fit(SLIP, record.motion, np.ones(len(record.motion), dtype=bool))
