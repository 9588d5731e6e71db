"""`dial_gauge.html`: one self-contained page with the tables and figures of dial gauge experiments.

Figures of dial gauge experiments: force–displacement graphs, steps at zero force, maps over the direction, loops.
"""

from __future__ import annotations

from functools import partial
from typing import cast

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic.report import Block, Figures, Items, Report, Section, Verdict
from scara_kinetostatic.report import Figure as Picture
from scara_kinetostatic.report.figure import FAINT, INK, LINE, MICRO, PAPER, SERIES, WARN, as_svg, new_figure
from scara_kinetostatic.report.quantities import count
from scara_kinetostatic.studies.dial_gauge import text
from scara_kinetostatic.studies.dial_gauge.analysis import DialGaugeAnalysis, LoopRecord, sense_name
from scara_kinetostatic.studies.dial_gauge.loop_analysis import Sense
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER
from scara_kinetostatic.studies.dial_gauge.result import DirectionMap, Part, Run

WIDTH, HALF = 920.0, 450.0


def force_picture(run: Run, name: str) -> Markup:
    """Displacement over force of one run, with its lines drawn to zero force; the residuals below (figure 4(a)).

    Args:
        run: what to show.
        name: identifier of the picture on the page.
    """
    figure = Figure(figsize=(HALF / 72, 400 / 72), dpi=72, layout='constrained')
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3.2, 1))
    readings, fit = run.readings, run.fit
    colours = np.where(readings.force > 0, SERIES[0], SERIES[1])
    for colour in (SERIES[0], SERIES[1]):
        rows = fit.used & (colours == colour)
        above.plot(readings.force[rows], MICRO * readings.displacement[rows], 'o', ms=3, color=colour, mew=0)
        below.plot(readings.force[rows], MICRO * fit.residual[rows], 'o', ms=2.5, color=colour, mew=0)
    unused = ~fit.used
    above.plot(readings.force[unused], MICRO * readings.displacement[unused], 'o', ms=4, mfc=PAPER, mec=FAINT)
    _mean_lines(above, run)
    if run.outliers:
        rows = list(run.outliers)
        above.plot(readings.force[rows], MICRO * readings.displacement[rows], 'X', ms=8, mfc=WARN, mec=PAPER)
        below.plot(readings.force[rows], MICRO * fit.residual[rows], 'X', ms=8, mfc=WARN, mec=PAPER)
    above.set(ylabel='displacement  [µm]')
    below.axhline(0, color=FAINT, lw=0.9)
    below.set(xlabel='force  [N]', ylabel='residual  [µm]')
    figure.align_ylabels()
    return as_svg(figure, name, 'displacement over force, with straight lines and their residuals')


def _mean_lines(axes: Axes, run: Run) -> None:
    """Both lines, mean of the cycles, dashed where extrapolated, and the gap between them."""
    fit = run.fit
    ends = []
    for sign, colour in ((1, SERIES[0]), (-1, SERIES[1])):
        lines = fit.lines[fit.lines[:, 0] == sign]
        offset, slope = lines[:, 1].mean(), lines[0, 2]
        force = run.readings.force[fit.used & (np.sign(run.readings.force) == sign)]
        near, far = sign * np.abs(force).min(), sign * np.abs(force).max()
        axes.plot([near, far], MICRO * (offset + slope * np.array([near, far])), color=colour, lw=1.2)
        axes.plot([0, near], MICRO * (offset + slope * np.array([0, near])), color=colour, lw=1.2, ls=(0, (2, 2)))
        ends.append(MICRO * offset)
    axes.plot([0, 0], ends, color=INK, lw=2.2, solid_capstyle='butt')
    text = f'gap {MICRO * fit.gap.value:.4g} µm'
    axes.annotate(text, (0, np.mean(ends)), (10, 0), textcoords='offset points', va='center', color=INK)


def step_picture(part: Part, name: str) -> Markup:
    """Displacement less the elastic part, run by run: two flat lines, and the gap between them."""
    columns = min(4, len(part.runs))
    rows = -(-len(part.runs) // columns)
    size = (WIDTH, 40 + 125 * rows) if len(part.runs) > 2 else (HALF, 400)
    figure = Figure(figsize=(size[0] / 72, size[1] / 72), dpi=72, layout='constrained')
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, run in zip(panels.flat, part.runs, strict=False):
        _step(axes, run)
    for axes in panels.flat[len(part.runs) :]:
        axes.set_visible(False)
    figure.supxlabel('force  [N]', fontsize=12.5, color=INK)
    figure.supylabel('displacement less p F  [µm]', fontsize=12.5, color=INK)
    return as_svg(figure, name, 'displacement less its elastic part over force, for each direction')


def _step(axes: Axes, run: Run) -> None:
    fit, readings = run.fit, run.readings
    middle = np.zeros(len(fit.lines))
    for k in range(len(middle)):  # the gauge's zero of each cycle: the middle of its two lines
        pair = fit.lines[2 * (k // 2) : 2 * (k // 2) + 2, 1]
        middle[k] = pair.mean() if len(pair) == 2 else fit.lines[:, 1].mean()
    rest = readings.displacement - fit.compliance.value * readings.force
    for sign, colour in ((1, SERIES[0]), (-1, SERIES[1])):
        rows = fit.used & (np.sign(readings.force) == sign)
        left = rest[rows] - middle[fit.passes[rows]]
        axes.plot(readings.force[rows], MICRO * left, 'o', ms=2.2, color=colour, mew=0)
        axes.plot([0, sign * np.abs(readings.force).max()], [sign * MICRO * fit.gap.value / 2] * 2, color=INK, lw=0.9)
    axes.axhline(0, color=FAINT, lw=0.7)
    title = '' if np.isnan(run.direction) else f'{np.degrees(run.direction):g}°   '
    axes.set_title(f'{title}gap {MICRO * fit.gap.value:.1f} µm')


def map_picture(each: DirectionMap, unit: str, what: str, name: str) -> Markup:
    """A quantity over the direction, with two standard deviations and its ellipse (figures 4(b) and 4(c))."""
    figure = Figure(figsize=(HALF / 72, 400 / 72), dpi=72, layout='constrained')
    axes = cast(PolarAxes, figure.add_subplot(projection='polar'))
    turn = np.linspace(0, 2 * np.pi, 361)
    if each.ellipse is not None:
        curve = np.array([each.ellipse.at(angle) for angle in turn])
        axes.plot(turn, MICRO * curve[:, 0], color=SERIES[0], lw=1.2)
    axes.plot(turn, np.full_like(turn, MICRO * each.mean.value), color=FAINT, lw=0.9, ls=(0, (3, 3)))
    bars = 2 * MICRO * each.std
    axes.errorbar(each.direction, MICRO * each.value, bars, fmt='o', ms=5, color=INK, mfc=PAPER, mec=INK)
    axes.set_ylim(0, 1.15 * MICRO * float(np.max(each.value + 2 * each.std)))
    axes.set_thetagrids(range(0, 360, 30))
    axes.set_rlabel_position(75)
    axes.yaxis.set_major_locator(MaxNLocator(4, prune='lower'))
    axes.spines['polar'].set_color(LINE)
    axes.set_title(f'{what}  [{unit}]', pad=14)
    return as_svg(figure, name, f'{what} over the direction')


def loop_picture(record: LoopRecord, name: str) -> Markup:
    """The loops, and on each reversal that is used the two crossings of the level."""
    figure, (axes,) = new_figure(HALF, 400)
    readings = record.readings
    axes.plot(1e3 * readings.displacement, 1e-3 * readings.force, color=FAINT, lw=0.7)
    for sense, colour in _senses(record):
        for each in sense.reversals:
            start, end = (1e3 * (each.displacement + sense.sense * at) for at in each.crossings)
            axes.plot([start, end], [1e-3 * sense.level] * 2, color=colour, lw=2.0, solid_capstyle='butt', alpha=0.7)
    axes.set(xlabel='displacement  [mm]', ylabel='force  [kN]')
    return as_svg(figure, name, 'force over displacement, with the gap of each reversal')


def reversal_picture(record: LoopRecord, name: str) -> Markup:
    """Gap and compliance of each reversal over the speed in the gap, with one standard deviation."""
    figure, panels = new_figure(HALF, 400, rows=2, sharex=True)
    quantities = (('gap', 'gap  [mm]', 1e3), ('compliance', 'compliance  [nm/N]', 1e9))
    for axes, (quantity, label, factor) in zip(panels, quantities, strict=True):
        for sense, colour in _senses(record):
            x = 1e3 * np.array([each.speed for each in sense.reversals])
            y, std = factor * np.array([getattr(each, quantity) for each in sense.reversals]).T
            shape = '^' if sense.sense > 0 else 'v'
            axes.errorbar(x, y, std, fmt=shape, ms=5, color=colour, mew=0, elinewidth=1.0, label=sense_name(sense))
        axes.set(ylabel=label)
    panels[0].legend(frameon=False, ncols=2, loc='lower left', bbox_to_anchor=(0, 1), borderaxespad=0.1)
    panels[1].set(xlabel='speed in the gap  [mm/s]')
    figure.align_ylabels()
    return as_svg(figure, name, 'gap and compliance of each reversal over the speed')


def _senses(record: LoopRecord) -> list[tuple[Sense, str]]:
    return [(sense, SERIES[0] if sense.sense > 0 else SERIES[1]) for sense in record.analysis.senses]


def dial_gauge_report(analysis: DialGaugeAnalysis) -> Report:
    """The result of dial gauge experiments for the terminal and as a page."""
    points = analysis.points
    blocks: list[Block] = []
    if points is not None:
        blocks += [_part_section(part) for part in points.parts]
        note = 'gap: displacement jump at zero force; half gap: g of equations (6) and (7); ±: one standard deviation'
        blocks.append(Section('Summary', (text.summary_table(points), note)))
    blocks += [_loop_section(record, f'loop{k}') for k, record in enumerate(analysis.loops)]
    sources = [*(points.sources if points else ()), *(record.source for record in analysis.loops)]
    what = [text.TITLES[part.name] for part in points.parts] if points else []
    what += [f'loops of {record.source}' for record in analysis.loops]
    return Report(
        title='Compliance and backlash by dial gauge',
        answer=Verdict(f'Compliance and backlash: {", ".join(what)}'),
        blocks=tuple(blocks),
        source=', '.join(sources),
        remarks=tuple(analysis.warnings),
        footer='all numbers in full in dial_gauge.json',
    )


def part_figures(part: Part) -> tuple[Figures, ...]:
    """Maps over the direction, typical runs, and the steps at zero force of one part."""
    found = []
    if part.compliance_map is not None and part.gap_map is not None:
        caption = 'With two standard deviations; dashed: mean; curve: {}.'
        compliance = partial(map_picture, part.compliance_map, 'µm/N', 'compliance', f'{part.name}_compliance')
        gap = partial(map_picture, part.gap_map, 'µm', 'backlash (gap)', f'{part.name}_gap')
        ellipse = 'width of an elliptical dead zone'
        found.append(Figures((Picture(compliance, caption.format('uᵀPu')), Picture(gap, caption.format(ellipse)))))
    forces = tuple(
        Picture(partial(force_picture, run, f'{part.name}_force{k}'), _caption(run)) for k, run in _typical(part)
    )
    steps = Picture(
        partial(step_picture, part, f'{part.name}_steps'),
        'Displacement less the elastic part, cycle by cycle: the backlash. Blue: positive force, orange: negative.',
    )
    return (*found, *((Figures((*forces, steps)),) if len(forces) == 1 else (Figures(forces), Figures((steps,)))))


def _part_section(part: Part) -> Section:
    return Section(text.TITLES[part.name], (text.run_table(part), *text.map_sentences(part), *part_figures(part)))


def _typical(part: Part) -> list[tuple[int, Run]]:
    """The runs with the largest and the smallest gap."""
    order = sorted(range(len(part.runs)), key=lambda k: -part.runs[k].fit.gap.value)
    return [(k, part.runs[k]) for k in dict.fromkeys((order[0], order[-1]))]


def _caption(run: Run) -> str:
    where = f'{run.name}: ' if run.part == GRIPPER else ''
    unused = '; hollow: no load, not used' if not run.fit.used.all() else ''
    caption = f'{where}readings, straight lines, residuals{unused}.'
    return caption[0].upper() + caption[1:]


def _loop_section(record: LoopRecord, name: str) -> Section:
    pictures = (
        Picture(
            partial(loop_picture, record, f'{name}_record'),
            'The record; bars: the gap of each reversal, at the force inside the backlash. Blue: displacement rising '
            'after the reversal, orange: falling.',
        ),
        Picture(
            partial(reversal_picture, record, f'{name}_reversals'),
            'Gap and compliance of each reversal, with one standard deviation from the residuals of the lines.',
        ),
    )
    senses = [
        Section(
            f'Displacement {sense_name(sense)} after the reversal',
            (text.reversal_table(sense), text.level_sentence(sense), *text.sense_sentences(sense)),
        )
        for sense in record.analysis.senses
    ]
    rejected = tuple(f'{each.time:.2f} s: {each.reason}' for each in record.analysis.rejected)
    unused = [Items(rejected, f'{count(len(rejected), "reversal")} not used:')] if rejected else []
    return Section(f'Loops: {record.source}', (Figures(pictures), *senses, *unused))
