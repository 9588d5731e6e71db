"""Analysis of tables of gauge readings, loads point by point or continuous loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.loop_analysis import LoopAnalysis, Sense, analyse_loops
from scara_kinetostatic.studies.dial_gauge.point_analysis import analyse_points
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings, join
from scara_kinetostatic.studies.dial_gauge.result import PointAnalysis
from scara_kinetostatic.studies.dial_gauge.run_fit import ZERO_BAND
from scara_kinetostatic.studies.dial_gauge.statistics import FALSE_ALARM_LEVEL

AUTO, POINTS, LOOPS = 'auto', 'points', 'loops'


class LoopRecord(NamedTuple):
    """One continuous record: its file, its readings and their analysis."""

    source: str
    readings: DialGaugeReadings
    analysis: LoopAnalysis


class DialGaugeAnalysis(NamedTuple):
    """Result of all tables.

    Attributes:
        points: the experiments with loads point by point; None without any.
        loops: the continuous records.
        warnings: one sentence each.
    """

    points: PointAnalysis | None
    loops: tuple[LoopRecord, ...]
    warnings: tuple[str, ...]


def analyse_tables(
    tables: Sequence[DialGaugeReadings], kind: str = AUTO, zero_band: float = ZERO_BAND
) -> DialGaugeAnalysis:
    """Analyses tables.

    Args:
        tables: each from one file.
        kind: 'points', 'loops', or 'auto': loops where a table has times, and neither cycles nor directions.
        zero_band: share of the largest load of a run up to which a load counts as none.

    Raises:
        ParameterError: the rows of a joint have no lever.
        UnsupportedDataError: a table cannot be analysed; it is named.
    """
    loops = [table for table in tables if kind == LOOPS or (kind == AUTO and _continuous(table))]
    points = [table for table in tables if not any(table is loop for loop in loops)]
    analysis = analyse_points(join(points), zero_band) if points else None
    records = tuple(_record(table) for table in loops)
    warnings = [*(analysis.warnings if analysis else ())]
    for record in records:
        warnings += [*record.readings.notes, *_loop_warnings(record)]
    return DialGaugeAnalysis(analysis, records, tuple(warnings))


def _continuous(table: DialGaugeReadings) -> bool:
    return bool(np.all(np.isfinite(table.time)) and np.all(table.cycle < 0) and np.all(np.isnan(table.direction)))


def _record(table: DialGaugeReadings) -> LoopRecord:
    source = table.sources[0]
    if not np.all(np.isfinite(table.time)):
        raise UnsupportedDataError(f'{source}: loops need the time of every row', 'add a column time_s')
    try:
        return LoopRecord(source, table, analyse_loops(table.time, table.displacement, table.force))
    except UnsupportedDataError as error:
        raise UnsupportedDataError(f'{source}: {error.problem}', error.remedy) from error


def _loop_warnings(record: LoopRecord) -> list[str]:
    """Warnings about inconsistent reversals and trends."""
    found = []
    level = FALSE_ALARM_LEVEL / sum(2 + len(sense.trends) for sense in record.analysis.senses)
    for sense in record.analysis.senses:
        where = f'{record.source}: {sense_name(sense)}'
        for name, test, factor, unit in (('gap', sense.gap, 1e6, 'µm'), ('compliance', sense.compliance, 1e6, 'µm/N')):
            if test is not None and test.p_value < level:
                between = f'{factor * test.between:.3g} {unit}'
                found.append(f'{where}: the reversals are inconsistent in {name}; standard deviation between {between}')
        for trend in sense.trends:
            if trend.p_value < level:
                found.append(
                    f'{where}: {_trend_text(trend.quantity, trend.variable, trend.slope.value, trend.slope.std)}'
                )
    return found


def _trend_text(quantity: str, variable: str, slope: float, std: float) -> str:
    unit = 'µm' if quantity == 'gap' else 'µm/N'
    if variable == 'speed':
        amount = f'{1e3 * slope:.3g} ± {1e3 * std:.2g} {unit} per mm/s'
        return f'the {quantity} changes with the speed (or the amplitude) by {amount}'
    return f'the {quantity} drifts by {1e6 * slope:.3g} ± {1e6 * std:.2g} {unit} per s'


def sense_name(sense: Sense) -> str:
    """Name of the reversals of one sense."""
    return 'rising' if sense.sense > 0 else 'falling'
