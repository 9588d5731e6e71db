"""The result of dial gauge experiments: sentences, tables and figures, and `dial_gauge.json`."""

from __future__ import annotations

from functools import partial
from typing import cast

import numpy as np
from markupsafe import Markup
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic import __version__
from scara_kinetostatic.report import (
    NOT_DETERMINED,
    Block,
    Document,
    Figure,
    Figures,
    Items,
    Report,
    Section,
    Table,
    Verdict,
)
from scara_kinetostatic.report.figure import FAINT, INK, LINE, MICRO, PAPER, SERIES, WARN, as_svg, new_figure
from scara_kinetostatic.report.quantities import Scale, count, p_equals, shown
from scara_kinetostatic.studies.loops.dial_gauge import DialGaugeAnalysis, DirectionMap, Part, Run
from scara_kinetostatic.studies.loops.estimates import FALSE_ALARM_LEVEL, CombinedEstimate, Estimate
from scara_kinetostatic.studies.loops.reversals import LoopAnalysis

TITLES = {'gripper': 'Gripper', 'joint1': 'Joint 1', 'joint2': 'Joint 2'}
HALF = 450.0
"""Width of a figure beside another, pixels."""


def dial_gauge_document(analysis: DialGaugeAnalysis) -> Document:
    """`dial_gauge.json`: SI units; null where a quantity does not exist.

    `gap` is the jump of the displacement at zero force, `half_gap` the g of equations (6) and (7).
    """
    return {
        'schema': 'scara_kinetostatic/dial_gauge/1',
        'version': __version__,
        'parts': {part.name: _part(part) for part in analysis.parts.values()},
        'loops': [
            {'source': each.record.source, 'senses': {own.name: own for own in each.senses}, 'rejected': each.rejected}
            for each in analysis.loops
        ],
        'warnings': analysis.warnings,
    }


def _part(part: Part) -> Document:
    found = {**_quantities(part), 'runs': [_run(run) for run in part.runs]}
    maps = {
        what: {
            'mean': each.mean,
            'smallest': each.value.min(),
            'largest': each.value.max(),
            'isotropy': each.isotropy,
            'ellipse': each.ellipse,
        }
        for what, each in part.maps.items()
    }
    return found | ({'over_direction': maps} if maps else {})


def _quantities(each: Part | Run) -> Document:
    return {'compliance': each.compliance, 'gap': each.gap, 'half_gap': each.gap.over(2)}


def _run(run: Run) -> Document:
    readings, fit = run.readings, run.fit
    return {
        **{name: getattr(readings, name) for name in ('source', 'gauge_at', 'direction', 'lever')},
        **_quantities(run),
        'at_gauge': {'slope': fit.compliance, 'gap': fit.gap},
        'slope_negative': fit.slopes[0],
        'slope_positive': fit.slopes[1],
        'cycle_gaps': fit.cycle_gaps,
        'reading_std': fit.sigma,
        'resolution': fit.resolution,
        'degrees_of_freedom': fit.degrees_of_freedom,
        'rows': {'found': len(fit.used), 'used': int(fit.used.sum())},
        'checks': [{**check._asdict(), 'failed': check in run.failed_checks} for check in fit.checks],
        'outlier_lines': readings.line[list(run.outliers)],
        'note': run.note,
    }


def dial_gauge_report(analysis: DialGaugeAnalysis) -> Report:
    """The result of dial gauge experiments for the terminal and as a page."""
    blocks: list[Block] = [
        Section(TITLES[part.name], (_run_table(part), *_map_sentences(part), *part_figures(part)))
        for part in analysis.parts.values()
    ]
    if analysis.parts:
        note = (
            'Gap: jump of the displacement at zero force. Half gap: g of equations (6) and (7). ±: standard deviation.'
        )
        blocks.append(Section('Summary', (summary_table(analysis), note)))
    blocks += [_loop_section(loops, f'loop{k}') for k, loops in enumerate(analysis.loops)]
    what = [TITLES[name] for name in analysis.parts] + [f'loops of {each.record.source}' for each in analysis.loops]
    return Report(
        title='Compliance and backlash by dial gauge',
        answer=Verdict(f'Compliance and backlash: {", ".join(what)}'),
        blocks=tuple(blocks),
        source=', '.join(analysis.sources),
        remarks=analysis.warnings,
        footer='all numbers in full in dial_gauge.json',
    )


def with_std(estimate: Estimate, factor: float = 1e6) -> str:
    """Value ± one standard deviation, with the digits that the latter allows; `factor`: displayed units per SI unit."""
    return shown(estimate.value, estimate.std, '', {'': Scale('', factor)}).text


def _cells(each: Part | Run) -> tuple[str, str, str]:
    return with_std(each.compliance), with_std(each.gap), with_std(each.gap.over(2))


def summary_table(analysis: DialGaugeAnalysis) -> Table:
    """One row per part: compliance, gap, half gap."""
    rows = []
    for part in analysis.parts.values():
        compliance, *gaps = _cells(part)
        units = f'µ{part.compliance.unit}', f'µ{part.gap.unit}'
        rows.append((TITLES[part.name], str(len(part.runs)), compliance, units[0], *gaps, units[1]))
    return Table(('part', 'runs', 'compliance', '', 'gap', 'half gap g', ''), ('',) * 7, tuple(rows))


def _run_table(part: Part) -> Table:
    rows = tuple(
        (
            NOT_DETERMINED if np.isnan(run.readings.direction) else f'{np.degrees(run.readings.direction):.5g}',
            *_cells(run),
            f'{1e6 * run.fit.sigma:.2f}',
            f'{int(run.fit.used.sum())}',
            ', '.join(check.name.replace('_', ' ') for check in run.failed_checks) or 'ok',
        )
        for run in part.runs
    )
    heading = ('direction', 'compliance', 'gap', 'half gap g', 'reading σ', 'rows', 'checks')
    gap_unit = f'µ{part.gap.unit}'
    return Table(heading, ('°', f'µ{part.compliance.unit}', gap_unit, gap_unit, 'µm', '', ''), rows)


def _test(test: CombinedEstimate) -> str:
    degrees = f'{test.degrees_of_freedom} degrees of freedom'
    return f'χ² = {test.chi_square:.1f} with {degrees}, {p_equals(test.p_value)}'


def _map_sentences(part: Part) -> list[str]:
    """Whether compliance and gap are isotropic."""
    found = []
    for what, each in part.maps.items():
        unit, ellipse = f'µ{each.mean.unit}', each.ellipse
        if each.isotropy.p_value >= FALSE_ALARM_LEVEL:
            found.append(f'The {what} is equal in all directions within its uncertainty ({_test(each.isotropy)}).')
            continue
        text = f'The {what} depends on the direction ({_test(each.isotropy)}): '
        text += f'{1e6 * each.value.min():.4g} … {1e6 * each.value.max():.4g} {unit}'
        if ellipse is not None:
            fits = '' if np.isnan(ellipse.p_value) else f', {p_equals(ellipse.p_value)}'
            limits = f'{with_std(ellipse.minor)} to {with_std(ellipse.major)} {unit}'
            text += f'; ellipse from {limits}, largest at {with_std(ellipse.axis, 180 / np.pi)}°{fits}'
        found.append(f'{text}.')
    return found


def part_figures(part: Part) -> tuple[Figures, ...]:
    """Maps over the direction, and the runs with the largest and the smallest gap."""
    maps = [Figure(partial(map_picture, each, what, f'{part.name}_{what}')) for what, each in part.maps.items()]
    dead_zone = 'With two standard deviations; dashed: mean; curve: uᵀPu, and the width of an elliptical dead zone.'
    gaps = [run.gap.value for run in part.runs]
    runs = {k: part.runs[k] for k in (int(np.argmax(gaps)), int(np.argmin(gaps)))}
    forces = [
        Figure(partial(force_picture, run, f'{part.name}_force{k}'), title=run.readings.name.capitalize())
        for k, run in runs.items()
    ]
    found = Figures(tuple(forces), 'Readings, straight lines, residuals; hollow: no load, not used.')
    return (Figures(tuple(maps), dead_zone), found) if maps else (found,)


def map_picture(each: DirectionMap, what: str, name: str) -> Markup:
    """A quantity over the direction, with two standard deviations and its ellipse (figures 4(b) and 4(c))."""
    figure, found = new_figure(HALF, 400, subplot_kw={'projection': 'polar'})
    axes = cast(PolarAxes, found[0])
    turn = np.linspace(0, 2 * np.pi, 361)
    if each.ellipse is not None:
        major, minor, axis = (estimate.value for estimate in each.ellipse[:3])
        turned = turn - axis
        q = major**each.power * np.cos(turned) ** 2 + minor**each.power * np.sin(turned) ** 2
        axes.plot(turn, MICRO * q ** (1 / each.power), color=SERIES[0], lw=1.2)
    axes.plot(turn, np.full_like(turn, MICRO * each.mean.value), color=FAINT, lw=0.9, ls=(0, (3, 3)))
    bars = 2 * MICRO * each.std
    axes.errorbar(each.direction, MICRO * each.value, bars, fmt='o', ms=5, color=INK, mfc=PAPER, mec=INK)
    axes.set_ylim(0, 1.15 * MICRO * float(np.max(each.value + 2 * each.std)))
    axes.set_thetagrids(range(0, 360, 30))
    axes.set_rlabel_position(75)
    axes.yaxis.set_major_locator(MaxNLocator(4, prune='lower'))
    axes.spines['polar'].set_color(LINE)
    axes.set_title(f'{what}  [µ{each.mean.unit}]', pad=14)
    return as_svg(figure, name, f'{what} over the direction')


def force_picture(run: Run, name: str) -> Markup:
    """Displacement over force of one run, with its lines drawn to zero force; the residuals below (figure 4(a)).

    Args:
        run: what to show.
        name: identifier of the picture on the page.
    """
    figure, (above, below) = new_figure(HALF, 400, rows=2, sharex=True, height_ratios=(3.2, 1))
    force, displacement, fit = run.readings.force, MICRO * run.readings.displacement, run.fit
    above.plot(force[~fit.used], displacement[~fit.used], 'o', ms=4, mfc=PAPER, mec=FAINT)
    offsets = []
    for sign, colour in ((1, SERIES[0]), (-1, SERIES[1])):
        rows = fit.used & (np.sign(force) == sign)
        above.plot(force[rows], displacement[rows], 'o', ms=3, color=colour, mew=0)
        below.plot(force[rows], MICRO * fit.residual[rows], 'o', ms=2.5, color=colour, mew=0)
        lines = fit.lines[fit.lines[:, 0] == sign]
        offset, slope, far = MICRO * lines[:, 1].mean(), MICRO * lines[0, 2], sign * np.abs(force[rows]).max()
        above.plot([0, far], [offset, offset + slope * far], color=colour, lw=1.2)
        offsets.append(offset)
    above.plot([0, 0], offsets, color=INK, lw=2.2, solid_capstyle='butt')
    text = f'gap {MICRO * fit.gap.value:.4g} µm at the gauge'
    above.annotate(text, (0, np.mean(offsets)), (10, 0), textcoords='offset points', va='center', color=INK)
    for axes, values in ((above, displacement), (below, MICRO * fit.residual)):
        axes.plot(force[list(run.outliers)], values[list(run.outliers)], 'X', ms=8, mfc=WARN, mec=PAPER)
    above.set(ylabel='displacement  [µm]')
    below.axhline(0, color=FAINT, lw=0.9)
    below.set(xlabel='force  [N]', ylabel='residual  [µm]')
    figure.align_ylabels()
    return as_svg(figure, name, 'displacement over force, with straight lines and their residuals')


def _loop_section(loops: LoopAnalysis, name: str) -> Section:
    picture = Figure(
        partial(loop_picture, loops, f'{name}_record'),
        'The record; bars: the gap of each reversal, at the force inside the backlash. Blue: displacement rising after '
        'the reversal, orange: falling.',
    )
    note = 'definitional: by the choice of the straight part, common to all reversals; those are in dial_gauge.json'
    rejected = tuple(f'{each.time:.2f} s: {each.reason}' for each in loops.rejected)
    unused = [Items(rejected, f'{count(len(rejected), "reversal")} not used:')] if rejected else []
    return Section(f'Loops: {loops.record.source}', (picture, _loop_table(loops), note, *unused))


def _loop_table(loops: LoopAnalysis) -> Table:
    """Mean, definitional uncertainty and consistency of gap and compliance after the reversals of each sense."""
    rows = []
    for sense in loops.senses:
        for what, unit, factor, test in ('gap', 'µm', 1e6, sense.gap), ('compliance', 'nm/N', 1e9, sense.compliance):
            definitional = float(f'{factor * test.definitional_uncertainty:.2g}')
            rows.append((sense.name, what, with_std(test.estimate, factor), f'{definitional:g}', unit, _test(test)))
        for where, force in ('inside the gap', sense.gap_force), ('at the plateau', sense.slip_force):
            rows.append((sense.name, f'force {where}', f'{force:.0f}', '', 'N', ''))
    heading = ('displacement', '', 'mean', 'definitional ±', '', 'consistency of the reversals')
    return Table(heading, ('',) * len(heading), tuple(rows))


def loop_picture(loops: LoopAnalysis, name: str) -> Markup:
    """The loops, and on each reversal that is used the two crossings of the level."""
    figure, (axes,) = new_figure(HALF, 400)
    record = loops.record
    axes.plot(1e3 * record.response, 1e-3 * record.load, color=FAINT, lw=0.7)
    for sense in loops.senses:
        colour = SERIES[0] if sense.sense > 0 else SERIES[1]
        for each in sense.reversals:
            start, end = (1e3 * (each.displacement + sense.sense * at) for at in each.crossings)
            axes.plot([start, end], [1e-3 * sense.gap_force] * 2, color=colour, lw=2.0, alpha=0.7)
    axes.set(xlabel='displacement  [mm]', ylabel='force  [kN]')
    return as_svg(figure, name, 'force over displacement, with the gap of each reversal')
