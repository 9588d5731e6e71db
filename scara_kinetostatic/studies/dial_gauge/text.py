"""The result of gauge experiments in words and tables, for a terminal and for the page."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.render.quantities import chance, count, decimals
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeStudy, LoopRecord, sense_name
from scara_kinetostatic.studies.dial_gauge.directions import DirectionMap
from scara_kinetostatic.studies.dial_gauge.loop_analysis import Sense
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER
from scara_kinetostatic.studies.dial_gauge.result import DialGaugeAnalysis, Part, Run
from scara_kinetostatic.studies.dial_gauge.statistics import Agreement, Estimate

TITLES = {'gripper': 'Gripper', 'joint1': 'Joint 1', 'joint2': 'Joint 2'}
SYMBOLS = {'gripper': ('p_ee', 'g_ee'), 'joint1': ('p1', 'g1'), 'joint2': ('p2', 'g2')}
_CLEAR = 0.01


class Table(NamedTuple):
    """Headings, units below them, and rows; all text."""

    heading: tuple[str, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def with_std(estimate: Estimate, factor: float = 1e6) -> str:
    """Value ± one standard deviation, with the digits the latter allows."""
    digits = decimals(estimate.std * factor)
    if digits is None:
        return f'{estimate.value * factor:.6g}'
    return f'{estimate.value * factor:.{digits}f} ± {estimate.std * factor:.{digits}f}'


def short(value: float) -> str:
    """Two digits, without an exponent where it can be."""
    return f'{float(f"{value:.2g}"):g}'


def _test(test: Agreement) -> str:
    p_value = chance(test.p_value)
    p_value = f'p {p_value}' if p_value.startswith('below') else f'p = {p_value}'
    return f'χ² = {test.chi_square:.1f} with {test.degrees_of_freedom} degrees of freedom, {p_value}'


def summary_table(analysis: DialGaugeAnalysis) -> Table:
    """One row per part: compliance, gap, half gap."""
    rows = []
    for part in analysis.parts:
        unit = ('µm/N', 'µm') if part.name == GRIPPER else ('µrad/Nm', 'µrad')
        values = (with_std(part.compliance), unit[0], with_std(part.gap), with_std(part.half_gap), unit[1])
        rows.append((TITLES[part.name], str(len(part.runs)), *values))
    return Table(('part', 'runs', 'compliance', '', 'gap', 'half gap g', ''), ('',) * 7, tuple(rows))


def run_table(part: Part) -> Table:
    """One row per run."""
    unit = ('µm/N', 'µm') if part.name == GRIPPER else ('µrad/Nm', 'µrad')
    heading = ('direction', 'compliance', 'gap', 'half gap g', 'reading σ', 'rows', 'checks')
    rows = tuple(_run_row(run) for run in part.runs)
    return Table(heading, ('deg', unit[0], unit[1], unit[1], 'µm', '', ''), rows)


def _run_row(run: Run) -> tuple[str, ...]:
    direction = '–' if np.isnan(run.direction) else f'{np.degrees(run.direction):.5g}'
    return (
        direction,
        with_std(run.compliance),
        with_std(run.gap),
        with_std(run.half_gap),
        f'{1e6 * run.fit.sigma:.2f}',
        f'{int(run.fit.used.sum())}',
        ', '.join(alarm.name.replace('_', ' ') for alarm in run.alarms) or 'ok',
    )


def map_sentences(part: Part) -> list[str]:
    """Whether compliance and gap are the same in all directions."""
    found = []
    for what, unit, each in (('compliance', 'µm/N', part.compliance_map), ('gap', 'µm', part.gap_map)):
        if each is not None:
            found.append(_map_sentence(what, unit, each))
    return found


def _map_sentence(what: str, unit: str, each: DirectionMap) -> str:
    test = each.isotropy
    numbers = _test(test)
    if test.p_value >= _CLEAR:
        return f'The {what} is the same in all directions within its uncertainty ({numbers}).'
    text = f'The {what} depends on the direction ({numbers}): '
    text += f'{1e6 * each.value.min():.4g} … {1e6 * each.value.max():.4g} {unit}'
    if each.ellipse is not None:
        ellipse = each.ellipse
        axis = with_std(ellipse.axis, 180 / np.pi)
        fits = '' if np.isnan(ellipse.p_value) else f', p = {chance(ellipse.p_value)}'
        ends = f'{with_std(ellipse.minor)} to {with_std(ellipse.major)} {unit}'
        text += f'; ellipse from {ends}, largest at {axis} deg{fits}'
    return text + '.'


def reversal_table(sense: Sense) -> Table:
    """One row per reversal."""
    rows = tuple(
        (
            f'{each.time:.2f}',
            f'{1e3 * each.displacement:.2f}',
            f'{1e3 * each.speed:.1f}',
            with_std(each.gap),
            with_std(each.compliance, 1e9),
            with_std(each.unloading, 1e9),
            f'{each.samples[0]} + {each.samples[1]}',
        )
        for each in sense.reversals
    )
    heading = ('time', 'at', 'speed', 'gap', 'compliance', 'before the gap', 'samples')
    return Table(heading, ('s', 'mm', 'mm/s', 'µm', 'nm/N', 'nm/N', ''), rows)


def sense_sentences(sense: Sense) -> list[str]:
    """Means, whether the reversals agree, and what limits them."""
    found = []
    for place, (what, unit, factor, test) in enumerate(
        (('gap', 'µm', 1e6, sense.gap), ('compliance', 'nm/N', 1e9, sense.compliance))
    ):
        if test is None:
            continue
        found.append(_agreement_sentence(what, unit, factor, test))
        extra = []
        if np.isfinite(sense.repeatability[place]):
            extra.append(f'repeats at the same place to {short(factor * sense.repeatability[place])} {unit}')
        if np.isfinite(sense.definition[place]):
            moves = f'{short(factor * sense.definition[place])} {unit}'
            extra.append(f'moves by ± {moves} with the choice of the straight part')
        if extra:
            found.append(f'The {what} {", and ".join(extra)}.')
    return found


def _agreement_sentence(what: str, unit: str, factor: float, test: Agreement) -> str:
    mean = f'{what.capitalize()} {with_std(Estimate(test.mean, test.std), factor)} {unit}'
    numbers = _test(test)
    if test.p_value >= _CLEAR:
        return f'{mean}: the reversals agree within their uncertainty ({numbers}).'
    return f'{mean}: the reversals do not agree ({numbers}); between them {short(factor * test.between)} {unit} more.'


def level_sentence(sense: Sense) -> str:
    """Forces inside the gap and at the plateau."""
    return f'Force inside the gap {sense.level:.0f} N, at the plateau {sense.plateau:.0f} N.'


def text(study: DialGaugeStudy) -> str:
    """Everything, for a terminal."""
    lines: list[str] = []
    if study.points is not None:
        for part in study.points.parts:
            lines += [TITLES[part.name], *_laid_out(run_table(part)), *map_sentences(part), '']
        lines += ['Summary', *_laid_out(summary_table(study.points))]
        lines += ['gap: jump of the displacement at zero force; half gap: g of equations (6) and (7); ± one σ', '']
    for record in study.loops:
        lines += _loop_lines(record)
    return '\n'.join([*lines, *(f'note: {warning}' for warning in study.warnings)]).rstrip()


def _loop_lines(record: LoopRecord) -> list[str]:
    lines = []
    for sense in record.analysis.senses:
        lines += [f'{record.source}: {sense_name(sense)}', *_laid_out(reversal_table(sense))]
        lines += [level_sentence(sense), *sense_sentences(sense), '']
    rejected = record.analysis.rejected
    lines += [f'{count(len(rejected), "reversal")} not used:'] * bool(rejected)
    return lines + [f'  {each.time:.2f} s: {each.reason}' for each in rejected] + [''] * bool(rejected)


def _laid_out(table: Table) -> list[str]:
    every = [table.heading, *([table.units] if any(table.units) else []), *table.rows]
    widths = [max(len(row[k]) for row in every) for k in range(len(table.heading))]
    last = len(widths) - 1
    return [
        '  '.join(
            cell.ljust(width) if k in (0, last) else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in every
    ]
