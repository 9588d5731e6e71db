"""Reports, for the terminal and as a page, and data: hysteresis, whatever drives, and dial gauge experiments."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import cast

import numpy as np
from markupsafe import Markup
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MaxNLocator

from scara_kinetostatic import __version__
from scara_kinetostatic.model.parameters import IN_MICRO
from scara_kinetostatic.model.quantities import (
    NOT_DETERMINED,
    Scale,
    chance,
    count,
    p_equals,
    percentage,
    scale_of,
    shown,
)
from scara_kinetostatic.report.figure import (
    FAINT,
    INK,
    LINE,
    PAPER,
    SERIES,
    THICK,
    THIN,
    WARN,
    Margins,
    as_svg,
    new_figure,
)
from scara_kinetostatic.report.page import (
    Block,
    Document,
    Figure,
    Figures,
    Level,
    Note,
    Report,
    Section,
    Table,
    Verdict,
)
from scara_kinetostatic.studies.loops import dial_gauge
from scara_kinetostatic.studies.loops.laws import PARAMETERS
from scara_kinetostatic.studies.loops.record import LEVEL, MOTION, Record, block_means
from scara_kinetostatic.studies.loops.selection import NONE, UNDECIDED, VARIABLES, Judged, ResidualDependence, Selection


def hysteresis_document(selections: Sequence[Selection], predicted: Sequence[Judged] = ()) -> Document:
    """`hysteresis.json`: SI units; null where a quantity does not exist.

    Of records driven by their motion each has a selection, those that are driven by their load have one together.
    """
    study, record = selections[0].study, selections[0].study.records[0]
    head = {
        'schema': 'scara_kinetostatic/hysteresis/1',
        'version': __version__,
        'driven': study.driven_by,
        'units': {'load': record.load_unit, 'response': record.unit('m')},
    }
    if study.driven_by == MOTION:
        return {**head, 'records': [_facts(each)[0] | _content(each) for each in selections]}
    others = []
    for each in predicted:
        errors = {'before': each.before_rms, 'after': each.after_rms, 'unit': record.unit('m')}
        begins = {'from_s': each.path.time[each.rows.argmax()], 'state': each.state}
        others.append({'file': each.path.record.source, **errors, **begins})
    return {**head, **_content(selections[0]), 'records': _facts(selections[0]), 'predicted': others}


def _content(selection: Selection) -> Document:
    """Verdict, errors and parameters."""
    study, before, selected = selection.study, selection.before, selection.selected
    effects = [each.law.effect for each in (selected, *selection.rivals) if each]
    driven, unit = ('force', 'N') if study.driven_by == MOTION else ('response', 'm')
    laws = (before, *selection.candidates)
    errors = {each.law.name: {'fitted': each.fitted_rms, 'held_out': each.held_out_rms} for each in laws}
    candidates = []
    for each in laws:
        law = {'name': each.law.name, 'effect': each.law.effect, 'p_value': each.p_gain, 'bic_difference': each.bic}
        found = {'accepted': each.accepted, **errors[each.law.name], 'parameters': selection.stated(each)}
        candidates.append(law | found)
    both = {'before': errors[before.law.name], 'after': errors[selected.law.name] if selected else None}
    return {
        'verdict': selection.verdict,
        'p_value': selection.p_value,
        'detectable_share': selection.detectable,
        'p_value_after': selection.p_after,
        'law': {'before': before.law.name, 'after': selected.law.name if selected else None},
        'effects': effects[:1],
        'rivals': [effects] if selection.rivals else [],
        'residual_dependence': {
            when: {each.variable: each for each in found}
            for when, found in (('before', selection.dependence_before), ('after', selection.dependence_after))
        },
        'p_value_without_memory': selection.p_without_memory,
        'direction': study.direction,
        'misfit': selection.misfit or None,
        f'{driven}_error': {**both, 'unit': study.records[0].unit(unit)},
        'candidates': candidates,
        'parameters': {each.law.name: selection.stated(each) for each in (before, selected) if each},
    }


def _facts(selection: Selection) -> list[Document]:
    """Of each record: its samples and errors, from which time on they count, its state of friction at the start."""
    found = []
    for each in selection.judged:
        errors = {'before': each.before_rms, 'after': each.after_rms if selection.selected else None}
        begins = {'judged_from': each.path.time[each.rows.argmax()], 'state': each.state}
        found.append({'source': each.path.record.source, 'samples': len(each.path.time), 'error': errors, **begins})
    return found


def _held_out(selection: Selection) -> str:
    """How what was held out is predicted."""
    study = selection.study
    if study.driven_by == MOTION:
        return 'On sweeps not used in the fit'
    if study.is_single:
        return 'The later half predicted from the earlier half'
    return 'Each record predicted from the others, after its unloading or, in loops, its first third'


def hysteresis_report(
    selections: Sequence[Selection], predicted: Sequence[Judged] = (), other: Sequence[Selection] = ()
) -> Report:
    """The report of records driven by their motion, one selection each, or of all that are driven by their load.

    Args:
        selections: as driven by what is stated, or errs less.
        predicted: further records.
        other: as driven by the other one, where nothing states what drives.
    """
    study, verdicts = selections[0].study, [verdict(each) for each in selections]
    answer, blocks = verdicts[0], _blocks(selections[0], 'record0')
    if len(selections) > 1:
        levels = [each.level for each in verdicts]
        enough = sum(each.verdict == NONE for each in selections)
        worst: Level = next(level for level in ('bad', 'caution', 'good') if level in levels)
        answer = Verdict(f'Law (6) is sufficient for {enough} of {len(selections)} records', worst)
        blocks = tuple(
            Section(each.study.records[0].name, (found, *_blocks(each, f'record{k}')))
            for k, (each, found) in enumerate(zip(selections, verdicts, strict=True))
        )
    if selections[0].misfit:
        level = 'caution' if answer.level == 'good' else answer.level
        answer = answer._replace(level=level, sentences=(selections[0].misfit, *answer.sentences))
    if predicted:
        begins = 'the unloading' if study.records[0].is_at_rest_first else 'the end of the first third'
        note = f'What comes before {begins} gives zero and state of friction; the error counts from there on.'
        found = _record_table(selections[0], predicted), _figures(selections[0], predicted, 'other')
        blocks += (Section('Further records, predicted', (note, *found)),)
    driven, driver = ('load', 'response') if study.driven_by == MOTION else ('response', 'load')
    what = f'Driven by their {study.driven_by}: the {{{driven}}} is predicted from the {{{driver}}}.'
    if other:
        one, two = (percentage(max(each.final_share for each in some), '.2g') for some in (selections, other))
        what += f' Nothing states what drives; held out, the law errs by {one} of the range, {two} as driven by their '
        what += f'{other[0].study.driven_by} (--driven decides).'
    records = [record for each in selections for record in each.study.records]
    size = f'{count(len(records), "record")}, {count(sum(map(len, records)), "sample")}'
    return Report(
        title=records[0].words('Hysteresis of {load} and {response}: is law (6) sufficient?'),
        answer=answer,
        blocks=(records[0].words(what), *blocks),
        source=f'{size}: {", ".join(record.source for record in records)}',
        footer='all numbers in full in hysteresis.json',
    )


def verdict(selection: Selection) -> Verdict:
    """The verdict with its evidence."""
    study, record, selected = selection.study, selection.study.records[0], selection.selected
    together = f', {len(study.records)} records together' if len(study.records) > 1 else ''
    chances, error = f'{p_equals(selection.p_value)}{together}', _error_scale(selection)
    before = _number(error.per_si * selection.before.held_out_rms)
    limit, held_out = percentage(min(selection.detectable, 1.0)), _held_out(selection)
    share = f'That is {percentage(selection.share_of_range, ".2g")} of the range.'
    errors = f'{held_out}, the error of law (6) is {before} {error.unit} (rms). {share}'
    level: Level
    if selection.verdict in (NONE, UNDECIDED):
        headline, level, residual = 'Law (6), slope and gap, is sufficient', 'good', 'its residual'
        if selection.needs_memory:
            headline, level = 'Law (6) is sufficient only with a gap that keeps its place when unloaded', 'caution'
        if selection.verdict == UNDECIDED:
            headline, level = 'These records do not show whether law (6) is sufficient', 'caution'
            residual = 'the residual of law (6)'
        found = f'No dependence of {residual} was found ({chances}).'
        found += f' Each test would have found {limit} of its square.'
        return Verdict(headline, level, (found, *_reservations(selection), errors))
    evidence = f'The residual of law (6) {_strongest(selection.dependence_before, record)} ({chances}).'
    if selected is None:
        headline = 'Law (6) is not sufficient, and no candidate predicts significantly better'
        return Verdict(headline, 'bad', (evidence, errors))
    headline = f'Law (6) is not sufficient: {selected.law.title}'
    if selection.rivals:
        titles = ' and '.join(each.law.title for each in (selected, *selection.rivals))
        headline = f'Law (6) is not sufficient; these records do not distinguish between {titles}'
    after = _number(error.per_si * selected.held_out_rms)
    factor = selection.before.held_out_rms / selected.held_out_rms
    errors = f'{held_out}, the error falls from {before} to {after} {error.unit} (rms), by a factor of {factor:.1f}.'
    rest = 'No further dependence of the residual was found'
    if not selection.is_complete:
        rest = f'The selected law is not complete either: its residual {_strongest(selection.dependence_after, record)}'
    rest += f' ({p_equals(selection.p_after)}).'
    level = 'good' if selection.is_complete and not selection.rivals else 'caution'
    return Verdict(headline, level, (evidence, errors, rest))


def _reservations(selection: Selection) -> list[str]:
    """What goes with the result that no dependence was found."""
    study, record, sentences = selection.study, selection.study.records[0], list[str]()
    if study.driven_by == MOTION:
        return []
    if selection.needs_memory:
        sentences.append(f'With one that returns to its zero it is not ({p_equals(selection.p_without_memory)}).')
    untested = [record.words(VARIABLES[d.variable]) for d in selection.dependence_before if not d.is_tested]
    if untested:
        sentences.append(f'No load lasts or stays away long enough to test the dependence on {" and ".join(untested)}.')
    total = sum(float(np.var(path.driven) * len(path.time)) for path in study.blocks)
    if selection.before.whole.square > 0.9 * total:
        sentences.append(record.words('The {response} hardly follows the {load}: do the columns belong to one joint?'))
    return sentences


def _strongest(found: Sequence[ResidualDependence], record: Record) -> str:
    best = min(filter(lambda each: each.is_tested, found), key=lambda each: each.p_value)
    return record.words(f'depends on {VARIABLES[best.variable]}')


def _blocks(selection: Selection, name: str) -> tuple[Block, ...]:
    study, record = selection.study, selection.study.records[0]
    note = 'Standard deviations: jackknife over cycles, sweeps or records; none of one record from rest to rest.'
    if not selection.is_complete:
        note = 'No law is complete: this is no compliance and no gap of the joint, and has no standard deviation.'
    if study.driven_by != MOTION:
        along = 'along' if study.direction > 0 else 'against'
        note = f'The {{response}} changes {along} a positive {{load}}; parameters are magnitudes. {note}'
    compared = Note(
        'Errors: rms. Held out: predicted by fits that have not seen what is judged. p: p-value of no better '
        'prediction than by law (6). ΔBIC: difference to law (6). Better: in the rms, in BIC and in the test (0.5 %, '
        'shared among the laws). Selected: of these the one with the smallest BIC; of several forms the simplest '
        'within 2.'
    )
    judged = selection.judged
    return (
        Section('Records', (_record_table(selection, judged), _figures(selection, judged, name))),
        Section('Laws compared', (_candidate_table(selection), compared)),
        Section('Parameters', (_parameter_table(selection), record.words(note))),
    )


def _number(value: float) -> str:
    """Three digits, without exponent."""
    return f'{value:.0f}' if abs(value) >= 99.5 else f'{value:.3g}'


def _scale(size: float, unit: str) -> Scale:
    """The unit with the prefix in which a size is at least 0.1."""
    return scale_of(10 * size, unit)


def _error_scale(selection: Selection) -> Scale:
    """The unit of all errors, from that of law (6)."""
    unit = selection.study.records[0].unit('N' if selection.study.driven_by == MOTION else 'm')
    return _scale(selection.before.held_out_rms, unit)


def _record_table(selection: Selection, judged: Sequence[Judged]) -> Table:
    """Each record: its load and response, the errors when it is predicted."""
    selected, error = selection.selected, _error_scale(selection)
    records = [each.path.record for each in judged]
    moved = _scale(max(float(np.ptp(record.response)) for record in records), records[0].unit('m'))
    columns = [
        ('file', '', [record.name for record in records]),
        ('range of load', records[0].load_unit, [_number(float(np.ptp(each.load))) for each in records]),
        ('of response', moved.unit, [_number(moved.per_si * float(np.ptp(each.response))) for each in records]),
    ]
    columns.append(('before', error.unit, [_number(error.per_si * each.before_rms) for each in judged]))
    if selected:
        columns.append(('after', error.unit, [_number(error.per_si * each.after_rms) for each in judged]))
    headings, units, cells = zip(*columns, strict=True)
    return Table(headings, units, tuple(zip(*cells, strict=True)))


def _candidate_table(selection: Selection) -> Table:
    """Law (6) and every candidate compared with it."""
    error = _error_scale(selection)
    rivals, rows = [each.law.name for each in selection.rivals], []
    for each in (selection.before, *selection.candidates):
        errors = [_number(error.per_si * size) for size in (each.fitted_rms, each.held_out_rms)]
        note = 'less, not significantly' if selection.is_clearly_smaller(each) else 'no better'
        note = 'about as good' if each.law.name in rivals else 'better' if each.accepted else note
        note = 'selected' if selection.selected and each.law.name == selection.selected.law.name else note
        compared = (chance(each.p_gain), f'{each.bic:.0f}', note)
        last = ('', '', 'before') if each is selection.before else compared
        rows.append((each.law.title, str(each.law.size), *errors, *last))
    headings = ('law', 'parameters', 'fitted', 'held out', 'p', 'ΔBIC', '')
    return Table(headings, ('', '', error.unit, error.unit, '', '', ''), tuple(rows))


def _parameter_table(selection: Selection) -> Table:
    """Parameters of law (6) and of the selected law, or of the gap that it takes."""
    record = selection.study.records[0]
    columns = {'before': selection.stated(selection.before)}
    if selection.selected:
        columns['after'] = selection.stated(selection.selected)
    if selection.needs_memory:
        columns['gap that keeps its place'] = selection.candidates[0].parameters  # it comes first
    rows = []
    for name, (title, _) in PARAMETERS.items():
        found = [each.get(name) for each in columns.values()]
        if any(found):
            rows.append((record.words(title), *(shown(*each).text if each else '' for each in found)))
    headings = [name if selection.is_complete else f'{name}: fit only' for name in columns]
    return Table(('parameter', *headings), ('',) * (1 + len(columns)), tuple(rows))


def _figures(selection: Selection, judged: Sequence[Judged], name: str) -> Figures:
    """Pictures of each record, that with the largest error of law (6) first."""
    order = sorted(enumerate(judged), key=lambda numbered: -numbered[1].before_rms)
    pictures = [
        Figure(partial(_picture, selection, each, f'{name}_{k}'), title=each.path.record.name) for k, each in order
    ]
    note = (
        'Before, after: error (rms) by law (6) and by the selected law. Measured, and predicted where it was held out.'
    )
    return Figures(tuple(pictures), note)


def _picture(selection: Selection, judged: Judged, name: str) -> Markup:
    """What is driven over what drives, measured and predicted, at most 1000 points of each curve."""
    path, record = judged.path, judged.path.record
    residuals = [(judged.before.residual, SERIES[1], 'law (6)')]
    residuals += [(judged.after.residual, SERIES[0], 'selected law')] if selection.selected else []
    driver, driven, measured = ('{load}', record.load_unit), ('{response}', record.unit('m')), record.response_change
    if path.driven_by == MOTION:
        driver, driven, measured = driven, driver, path.driven
    across, up = _scale(float(np.ptp(path.driver)), driver[1]), _scale(float(np.ptp(measured)), driven[1])
    figure, (axes,) = new_figure(HALF, 300.0, margins=Margins(left=64, right=8, bottom=74, top=12))
    xlabel, ylabel = (f'{record.words(one[0])}  [{scale.unit}]' for one, scale in ((driver, across), (driven, up)))
    axes.set(xlabel=xlabel, ylabel=ylabel)
    block = -(-len(measured) // 1000)
    x = block_means(across.per_si * path.driver, block)
    axes.plot(x, block_means(up.per_si * measured, block), color=INK, lw=THIN, label='measured')
    for left, colour, label in residuals:
        axes.plot(x, block_means(up.per_si * (measured - left), block), color=colour, label=label)
    axes.legend(frameon=False, loc='upper center', bbox_to_anchor=(0.5, -0.19), ncols=3, handlelength=1.4)
    return as_svg(figure, name, record.words(f'{driven[0]} over {driver[0]}, measured and predicted'))


HALF, _HEIGHT = 450.0, 400.0
"""Width of a figure beside another, and height of one of a part, pixels."""
TITLES = {'gripper': 'Gripper', 'joint1': 'Joint 1', 'joint2': 'Joint 2'}


def dial_gauge_document(analysis: dial_gauge.DialGaugeAnalysis) -> Document:
    """`dial_gauge.json`: SI units; null where a quantity does not exist.

    `gap` is the jump of the displacement at zero force, `half_gap` the g of equations (6) and (7).
    """
    return {
        'schema': 'scara_kinetostatic/dial_gauge/1',
        'version': __version__,
        'parts': {part.name: _part(part) for part in analysis.parts.values()},
        'warnings': analysis.warnings,
    }


def _part(part: dial_gauge.Part) -> Document:
    runs = {'runs': [_run(run) for run in part.runs]}
    return _quantities(part) | runs | ({'over_direction': part.combined} if part.over_direction else {})


def _quantities(each: dial_gauge.Part | dial_gauge.Run) -> Document:
    return {'compliance': each.compliance, 'gap': each.gap, 'half_gap': each.gap.over(2)}


def _run(run: dial_gauge.Run) -> Document:
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


def dial_gauge_report(analysis: dial_gauge.DialGaugeAnalysis) -> Report:
    """The result of dial gauge experiments for the terminal and as a page."""
    blocks: list[Block] = [
        Section(TITLES[part.name], (_run_table(part), *_map_sentences(part), *part_figures(part)))
        for part in analysis.parts.values()
    ]
    note = 'Gap: jump of the displacement at zero force. Half gap: g of equations (6) and (7). ±: standard deviation.'
    blocks.append(Section('Summary', (summary_table(analysis), note)))
    sources = dict.fromkeys(run.readings.source for part in analysis.parts.values() for run in part.runs)
    return Report(
        title='Compliance and backlash by dial gauge',
        answer=Verdict(f'Compliance and backlash: {", ".join(TITLES[name] for name in analysis.parts)}'),
        blocks=tuple(blocks),
        source=', '.join(sources),
        remarks=analysis.warnings,
        footer='all numbers in full in dial_gauge.json',
    )


def _cells(each: dial_gauge.Part | dial_gauge.Run) -> list[str]:
    """Compliance, gap and half gap, each with its standard deviation and unit."""
    return [shown(*estimate).text for estimate in (each.compliance, each.gap, each.gap.over(2))]


def summary_table(analysis: dial_gauge.DialGaugeAnalysis) -> Table:
    """One row per part: compliance, gap, half gap."""
    rows = [(TITLES[part.name], str(len(part.runs)), *_cells(part)) for part in analysis.parts.values()]
    return Table(('part', 'runs', 'compliance', 'gap', 'half gap g'), ('',) * 5, tuple(rows))


def _run_table(part: dial_gauge.Part) -> Table:
    rows = []
    for run in part.runs:
        turn, failed = np.degrees(run.readings.direction), [check.name for check in run.failed_checks]
        direction = NOT_DETERMINED if np.isnan(turn) else f'{turn:.5g}'
        fit = f'{IN_MICRO * run.fit.sigma:.2f}', f'{int(run.fit.used.sum())}'
        rows.append((direction, *_cells(run), *fit, ', '.join(failed).replace('_', ' ') or 'ok'))
    heading = ('direction', 'compliance', 'gap', 'half gap g', 'reading σ', 'rows', 'checks')
    return Table(heading, ('°', '', '', '', 'µm', '', ''), tuple(rows))


def _map_sentences(part: dial_gauge.Part) -> list[str]:
    """Whether compliance and gap are isotropic."""
    found = []
    for what, isotropy in part.combined.items() if part.over_direction else ():
        values, unit = [IN_MICRO * getattr(run, what).value for run in part.runs], f'µ{isotropy.estimate.unit}'
        word = 'depends on the direction' if isotropy.p_value < LEVEL else 'is equal in all directions'
        found.append(f'The {what} {word} ({p_equals(isotropy.p_value)}): {min(values):.4g} … {max(values):.4g} {unit}.')
    return found


def part_figures(part: dial_gauge.Part) -> tuple[Figures, ...]:
    """Maps over the direction, and the runs with the largest and the smallest gap."""
    maps = [
        Figure(partial(map_picture, part, what, f'{part.name}_{what}')) for what in part.combined if part.over_direction
    ]
    gaps, forces = [run.gap.value for run in part.runs], []
    for k in dict.fromkeys((int(np.argmax(gaps)), int(np.argmin(gaps)))):
        run, name = part.runs[k], f'{part.name}_force{k}'
        forces.append(Figure(partial(force_picture, run, name), title=run.readings.name.capitalize()))
    found = Figures(tuple(forces), 'Readings, straight lines, residuals; hollow: no load, not used.')
    return (Figures(tuple(maps), 'With two standard deviations; dashed: mean.'), found) if maps else (found,)


def map_picture(part: dial_gauge.Part, what: str, name: str) -> Markup:
    """Compliance or gap over the direction, with two standard deviations (figures 4(b) and 4(c))."""
    figure, found = new_figure(HALF, _HEIGHT, subplot_kw={'projection': 'polar'})
    axes = cast(PolarAxes, found[0])
    turn = np.linspace(0, 2 * np.pi, 361)
    middle = getattr(part, what)
    axes.plot(turn, np.full_like(turn, IN_MICRO * middle.value), color=FAINT, lw=THIN, ls=(0, (3, 3)))
    values, bars = (IN_MICRO * np.array([getattr(run, what)[k] for run in part.runs]) for k in (0, 1))
    direction = [run.readings.direction for run in part.runs]
    axes.errorbar(direction, values, 2 * bars, fmt='o', ms=4, color=INK, mfc=PAPER, mec=INK)
    axes.set_ylim(0, 1.15 * float(np.max(values + 2 * bars)))
    axes.set_thetagrids(range(0, 360, 30))
    axes.set_rlabel_position(75)
    axes.yaxis.set_major_locator(MaxNLocator(4, prune='lower'))
    axes.spines['polar'].set_color(LINE)
    axes.set_title(f'{what}  [µ{middle.unit}]')
    return as_svg(figure, name, f'{what} over the direction')


def force_picture(run: dial_gauge.Run, name: str) -> Markup:
    """Displacement over force of one run, with its lines drawn to zero force; the residuals below (figure 4(a)).

    Args:
        run: what to show.
        name: identifier of the picture on the page.
    """
    figure, (above, below) = new_figure(HALF, _HEIGHT, rows=2, sharex=True, height_ratios=(3.2, 1))
    force, displacement, fit = run.readings.force, IN_MICRO * run.readings.displacement, run.fit
    above.plot(force[~fit.used], displacement[~fit.used], 'o', ms=4, mfc=PAPER, mec=FAINT)
    offsets = []
    for sign, colour in ((1, SERIES[0]), (-1, SERIES[1])):
        rows = fit.used & (np.sign(force) == sign)
        above.plot(force[rows], displacement[rows], 'o', ms=3, color=colour, mew=0)
        below.plot(force[rows], IN_MICRO * fit.residual[rows], 'o', ms=3, color=colour, mew=0)
        lines = fit.lines[fit.lines[:, 0] == sign]
        offset, slope, far = IN_MICRO * lines[:, 1].mean(), IN_MICRO * lines[0, 2], sign * np.abs(force[rows]).max()
        above.plot([0, far], [offset, offset + slope * far], color=colour)
        offsets.append(offset)
    above.plot([0, 0], offsets, color=INK, lw=THICK, solid_capstyle='butt')
    text = f'gap {IN_MICRO * fit.gap.value:.4g} µm at the gauge'
    above.annotate(text, (0, np.mean(offsets)), (10, 0), textcoords='offset points', va='center', color=INK)
    for axes, values in ((above, displacement), (below, IN_MICRO * fit.residual)):
        axes.plot(force[list(run.outliers)], values[list(run.outliers)], 'X', ms=8, mfc=WARN, mec=PAPER)
    above.set(ylabel='displacement  [µm]')
    below.axhline(0, color=FAINT, lw=THIN)
    below.set(xlabel='force  [N]', ylabel='residual  [µm]')
    figure.align_ylabels()
    return as_svg(figure, name, 'displacement over force, with straight lines and their residuals')
