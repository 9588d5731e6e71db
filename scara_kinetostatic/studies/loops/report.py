"""The hysteresis of records as a report, for the terminal and as a page, and as data; the same whatever drives."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from scara_kinetostatic import __version__
from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.report import (
    NOT_DETERMINED,
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
from scara_kinetostatic.report.figure import FAINT, INK, LINE, SERIES, Margins, as_svg, new_figure
from scara_kinetostatic.report.quantities import Scale, chance, count, p_equals, scale_of, shown
from scara_kinetostatic.studies.loops.dependence import VARIABLES, Dependence
from scara_kinetostatic.studies.loops.laws import PARAMETERS
from scara_kinetostatic.studies.loops.path import RecordPath, block_means, repeatability
from scara_kinetostatic.studies.loops.record import LEVEL, MOTION, Record
from scara_kinetostatic.studies.loops.selection import (
    AMBIGUOUS,
    NONE,
    UNDECIDED,
    UNEXPLAINED,
    Candidate,
    Judged,
    Selection,
    Study,
)


def hysteresis_document(selections: Sequence[Selection], predicted: Sequence[Judged] = ()) -> Document:
    """`hysteresis.json`: SI units; null where a quantity does not exist.

    Of records driven by their motion each has a selection, those that are driven by their load have one together.
    """
    study = selections[0].study
    unit = study.records[0].unit('m')
    head = {
        'schema': 'scara_kinetostatic/hysteresis/1',
        'version': __version__,
        'driven': study.driven_by,
        'units': {'load': study.records[0].load_unit, 'response': unit},
    }
    if study.driven_by == MOTION:
        records = [_motion_facts(each.study.paths[0]) | _content(each) for each in selections]
        return {**head, 'records': records}
    (selection,) = selections
    has_state = selection.final.law.has_state
    others = [
        {
            'file': each.path.record.source,
            'before': each.before_rms,
            'after': each.after_rms,
            'unit': unit,
            'from_s': each.path.time[each.rows.argmax()],
            'state': each.after.state if has_state else None,
        }
        for each in predicted
    ]
    facts = [_load_facts(selection, k) for k in range(len(study.records))]
    return {**head, **_content(selection), 'records': facts, 'predicted': others}


def _content(selection: Selection) -> Document:
    """Verdict, errors and parameters."""
    selected, record = selection.selected, selection.study.records[0]
    laws = [selection.before, *([selected] if selected else [])]
    effects = [each.law.effect for each in (selected, *selection.rivals)] if selected else []
    driven, unit = ('force', 'N') if selection.study.driven_by == MOTION else ('response', 'm')
    return {
        'verdict': selection.verdict,
        'p_value': selection.p_value,
        'detectable_share': selection.detectable,
        'p_value_after': selection.p_after,
        'law': {'before': selection.before.law.name, 'after': selected.law.name if selected else None},
        'effects': effects[:1],
        'rivals': [effects] if selection.rivals else [],
        'residual_dependence': {
            'before': {each.variable: each for each in selection.dependence_before},
            'after': {each.variable: each for each in selection.dependence_after},
        },
        'p_value_without_memory': selection.p_without_memory,
        'direction': selection.study.direction,
        f'{driven}_error': {
            'before': _errors(selection.before),
            'after': _errors(selected) if selected else None,
            'unit': record.unit(unit),
        },
        'candidates': [_compared(each, selection) for each in (selection.before, *selection.candidates)],
        'parameters': {each.law.name: each.parameters for each in laws},
    }


def _errors(each: Candidate) -> Document:
    return {'fitted': each.fitted_rms, 'held_out': each.held_out_rms}


def _compared(each: Candidate, selection: Selection) -> Document:
    is_before = each is selection.before
    return {
        'name': each.law.name,
        'effect': each.law.effect,
        'p_value': None if is_before else each.p_gain,
        'bic_difference': None if is_before else each.bic,
        'accepted': each.accepted,
        **_errors(each),
        'parameters': each.parameters,
    }


def _motion_facts(path: RecordPath) -> Document:
    return {
        'source': path.record.source,
        'sweeps': path.sweeps,
        'samples': len(path.time),
        'force_range': float(np.ptp(path.driven)),
        'travel': path.size,
        'repeatability': repeatability(path),
    }


def _load_facts(selection: Selection, number: int) -> Document:
    study, record = selection.study, selection.study.records[number]
    path, block, judged = study.paths[number], study.blocks[number], selection.judged[number]
    moved, rests = block.driven - record.response[0] + record.response_change[0], record.is_at_rest_first
    selected = selection.selected
    return {
        'source': record.source,
        'samples': len(record),
        'loaded': record.time[record.rest][-1] if rests else None,
        'judged_from': record.time[record.judged_from],
        'largest_load': path.smooth[int(np.abs(path.smooth).argmax())],
        'deflection': moved[int(np.abs(moved).argmax())],
        'remaining': record.remaining if rests else None,
        'noise': {'load': record.noise(record.load), 'response': record.noise(record.response)},
        'response_error': {'before': judged.before_rms, 'after': judged.after_rms if selected else None},
        'state': selected.along[number].state if selected and selected.law.has_state else None,
    }


class _Words(NamedTuple):
    """How the error of what was held out is said, where standard deviations are from, what the errors are."""

    held_out: str
    uncertainty: str
    errors: str


def _words(study: Study) -> _Words:
    if study.driven_by == MOTION:
        return _Words(
            'On sweeps not used in the fit, the error',
            'delete-one-cycle jackknife',
            'Errors: rms of the {load}, without the first sweep. Held out: each half of the sweeps predicted from the '
            'other.',
        )
    if study.is_single:
        return _Words(
            'The later half predicted from the earlier half, the error',
            'delete-one-sweep jackknife' if study.in_loops else 'one record gives none',
            'Errors: rms of the {response} of the later half. Held out: predicted by a fit to the earlier half.',
        )
    judged = 'after the first third' if study.in_loops else 'after unloading'
    errors = f'Errors: rms of the {{response}} {judged}.'
    if study.in_loops and not all(path.in_loops for path in study.paths):
        errors += ' Of a record that begins at rest: after the unloading; tests are those of the loops.'
    return _Words(
        f'Each record predicted from the others, the error {judged}',
        'delete-one-record jackknife',
        f'{errors} Held out: predicted with the parameters of the other records; zero and state of friction from its '
        'own samples before.',
    )


_DEPENDENCE = Note(
    'Share of the square of the residual that the variable explains, and the p-value of no dependence on it. The '
    'verdict states that of no dependence on any of them. The load before: at rest after the load the residual is not '
    'that at rest before it.'
)


def hysteresis_report(selections: Sequence[Selection], predicted: Sequence[Judged] = ()) -> Report:
    """The report of records driven by their motion, one selection each, or of all that are driven by their load."""
    first = selections[0].study.records[0]
    verdicts = [verdict(each) for each in selections]
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
    if predicted:
        blocks += (_predicted_section(selections[0], predicted),)
    source, driven = ('response', 'load') if selections[0].study.driven_by == MOTION else ('load', 'response')
    predicted_from = f'the {{{driven}}} is predicted from the {{{source}}}.'
    records = [record for each in selections for record in each.study.records]
    size = f'{count(len(records), "record")}, {count(sum(map(len, records)), "sample")}'
    return Report(
        title=first.words('Hysteresis of {load} and {response}: is law (6) sufficient?'),
        answer=answer,
        blocks=(first.words(f'Driven by their {selections[0].study.driven_by}: {predicted_from}'), *blocks),
        source=f'{size}: {", ".join(record.source for record in records)}',
        footer='all numbers in full in hysteresis.json',
    )


def verdict(selection: Selection) -> Verdict:
    """The verdict with its evidence."""
    study, record, selected = selection.study, selection.study.records[0], selection.selected
    together = f', {len(study.records)} records together' if len(study.records) > 1 else ''
    chances = f'{p_equals(selection.p_value)}{together}'
    error = _error_scale(selection)
    before = _number(error.per_si * selection.before.held_out_rms)
    errors = f'{_words(study).held_out} of law (6) is {before} {error.unit} (rms).'
    limit = f'Each test would have found {100 * min(selection.detectable, 1.0):.0f} % of its square.'
    errors += f' That is {100 * selection.share_of_range:.2g} % of the range.'
    if selection.verdict == UNDECIDED:
        smaller = [each.law.title for each in selection.candidates if selection.is_clearly_smaller(each)]
        better = f'Held out, these err clearly less, though not significantly: {", ".join(smaller)}.' if smaller else ''
        found = f'No dependence of the residual of law (6) was found ({chances}). {limit}'
        sentences = (found, *[better][: len(smaller)], *_reservations(selection), errors)
        return Verdict('These records do not show whether law (6) is sufficient', 'caution', sentences)
    if selection.verdict == NONE:
        headline = 'Law (6), slope and gap, is sufficient'
        if selection.needs_memory:
            headline = 'Law (6) is sufficient only with a gap that keeps its place when unloaded'
        found = f'No dependence of its residual was found ({chances}). {limit}'
        level: Level = 'caution' if selection.needs_memory else 'good'
        return Verdict(headline, level, (found, *_reservations(selection), errors))
    evidence = f'The residual of law (6) {_strongest(selection.dependence_before, record)} ({chances}).'
    if selection.verdict == UNEXPLAINED or selected is None:
        return Verdict(
            'Law (6) is not sufficient, and no candidate predicts significantly better', 'bad', (evidence, errors)
        )
    meanings = [record.words(each.law.meaning) for each in (selected, *selection.rivals)]
    headline = f'Law (6) is not sufficient: {meanings[0]}'
    if selection.verdict == AMBIGUOUS:
        headline = f'Law (6) is not sufficient; these records do not distinguish between {"; and ".join(meanings)}'
    after = _number(error.per_si * selected.held_out_rms)
    factor = selection.before.held_out_rms / selected.held_out_rms
    errors = f'{_words(study).held_out} falls from {before} to {after} {error.unit} (rms), by a factor of {factor:.1f}.'
    is_complete = selection.p_after >= LEVEL / 2
    rest = f'No further dependence of the residual was found ({p_equals(selection.p_after)}).'
    if not is_complete:
        depends = _strongest(selection.dependence_after, record)
        rest = f'The selected law is not complete either: its residual {depends} ({p_equals(selection.p_after)}).'
    level = 'good' if is_complete and selection.verdict != AMBIGUOUS else 'caution'
    return Verdict(headline, level, (evidence, errors, *_repeats(selection), rest))


def _reservations(selection: Selection) -> list[str]:
    """What goes with the result that no dependence was found."""
    study, sentences = selection.study, []
    if study.driven_by == MOTION:
        return []
    record = study.records[0]
    if selection.needs_memory:
        sentences.append(f'With one that returns to its zero it is not ({p_equals(selection.p_without_memory)}).')
    untested = [record.words(VARIABLES[d.variable]) for d in selection.dependence_before if not d.is_tested]
    if untested:
        sentences.append(f'No load lasts or stays away long enough to test the dependence on {" and ".join(untested)}.')
    total = sum(float(np.var(path.driven) * len(path.time)) for path in study.blocks)
    if selection.before.whole.square > 0.9 * total:
        sentences.append(record.words('The {response} hardly follows the {load}: do the columns belong to one joint?'))
    elif study.is_single and not study.in_loops:
        sentences.append('One record hardly tells slip from a gap; several records of the joint do.')
    return sentences


def _repeats(selection: Selection) -> list[str]:
    """How well the measured load repeats, which no law undercuts."""
    study = selection.study
    limit = repeatability(study.paths[0]) if study.driven_by == MOTION else np.nan
    if not np.isfinite(limit):
        return []
    ratio = rms(selection.final.along[0].residual[study.judged[0]]) / limit
    repeats = study.records[0].words('Where the motion repeats, the {load} repeats to')
    return [f'{repeats} {_number(limit)} {study.records[0].load_unit}; the residual is {ratio:.1f} times as large.']


def _strongest(found: Sequence[Dependence], record: Record) -> str:
    best = min(filter(lambda each: each.is_tested, found), key=lambda each: each.p_value)
    return record.words(f'depends on {VARIABLES[best.variable]}')


def _blocks(selection: Selection, name: str) -> tuple[Block, ...]:
    record, words = selection.study.records[0], _words(selection.study)
    return (
        Section('Records', (_record_table(selection), *_figures(selection, name))),
        Section('Laws compared', (_candidate_table(selection), record.words(words.errors), _COMPARED)),
        Section('What the residual depends on', (_dependence_table(selection), _DEPENDENCE)),
        Section('Parameters', (_parameter_table(selection), _parameter_note(selection))),
    )


_COMPARED = Note(
    'p: p-value of no better prediction than by law (6). ΔBIC: difference to law (6), which counts the parameters. '
    'Better: it predicts better in the rms, in BIC and in the test (0.5 %, shared among the laws). '
    'Selected: of these the one with the smallest BIC; of several forms of one effect the simplest within 2.'
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


def _record_table(selection: Selection) -> Table:
    """Each record: its load and response, the errors when it is predicted."""
    study, selected = selection.study, selection.selected
    error = _error_scale(selection)
    unit = study.records[0].unit('m')
    moved = _scale(max(float(np.ptp(record.response)) for record in study.records), unit)
    columns = [
        ('file', '', [record.name for record in study.records]),
        ('range of load', study.records[0].load_unit, [_number(float(np.ptp(each.load))) for each in study.records]),
        ('of response', moved.unit, [_number(moved.per_si * float(np.ptp(each.response))) for each in study.records]),
    ]
    if not study.in_loops:
        stays = [f'{round(moved.per_si * record.remaining, 3) + 0.0:.3f}' for record in study.records]
        memory = next(each for each in selection.dependence_before if each.variable == 'memory')
        p_values = [chance(p) if np.isfinite(p) else NOT_DETERMINED for p in memory.p_value_by_record]
        columns += [('stays', moved.unit, stays), ('p of no memory', '', p_values)]
    errors = [('before', [each.before_rms for each in selection.judged])]
    errors += [('after', [each.after_rms for each in selection.judged])] if selected else []
    columns += [(title, error.unit, [_number(error.per_si * each) for each in several]) for title, several in errors]
    if selected and selected.law.has_state:
        columns.append(('state at the start', '', [f'{each.state:+.2f}' for each in selected.along]))
    headings, units, cells = zip(*columns, strict=True)
    return Table(headings, units, tuple(zip(*cells, strict=True)))


def _candidate_table(selection: Selection) -> Table:
    """Law (6) and every candidate compared with it."""
    error = _error_scale(selection)
    notes = {
        each.law.name: 'less, not significantly' for each in selection.candidates if selection.is_clearly_smaller(each)
    }
    notes |= {each.law.name: 'better' for each in selection.candidates if each.accepted}
    notes |= {each.law.name: 'rival' for each in selection.rivals}
    notes |= {selection.selected.law.name: 'selected'} if selection.selected else {}
    rows = []
    for each in (selection.before, *selection.candidates):
        errors = [_number(error.per_si * size) for size in (each.fitted_rms, each.held_out_rms)]
        compared = [chance(each.p_gain), f'{each.bic:.0f}', notes.get(each.law.name, 'no better')]
        last = ['', '', 'before'] if each is selection.before else compared
        rows.append((each.law.title, str(each.law.size), *errors, *last))
    headings = ('law', 'parameters', 'fitted', 'held out', 'p', 'ΔBIC', '')
    return Table(headings, ('', '', error.unit, error.unit, '', '', ''), tuple(rows))


def _dependence_table(selection: Selection) -> Table:
    """What the residual of law (6) and that of the selected law depend on."""
    record, rows = selection.study.records[0], []
    after = {each.variable: each for each in selection.dependence_after}
    for each in selection.dependence_before:
        shown_ones = [each, after[each.variable]] if selection.selected else [each]
        cells = [record.words(VARIABLES[each.variable])]
        for one in shown_ones:
            share = f'{100 * min(one.share, 1.0):.0f} %' if one.share > 0 else 'nothing'
            cells += [share, chance(one.p_value)] if one.is_tested else [NOT_DETERMINED, NOT_DETERMINED]
        rows.append(tuple(cells))
    headings = ('residual over', 'before', 'p', 'after', 'p')[: len(rows[0])]
    return Table(headings, ('',) * len(headings), tuple(rows))


def _parameter_table(selection: Selection) -> Table:
    """Parameters of law (6) and of the selected law, or of the gap that it takes."""
    record = selection.study.records[0]
    laws = {'before': selection.before}
    if selection.needs_memory:
        laws['gap that keeps its place'] = selection.candidates[0]  # it comes first
    elif selection.selected:
        laws['after'] = selection.selected
    rows = []
    for name, (title, _) in PARAMETERS.items():
        found = [each.parameters.get(name) for each in laws.values()]
        if any(found):
            rows.append((record.words(title), *(shown(*each).text if each else '' for each in found)))
    return Table(('parameter', *laws), ('',) * (1 + len(laws)), tuple(rows))


def _parameter_note(selection: Selection) -> str:
    record, along = selection.study.records[0], 'along' if selection.study.direction > 0 else 'against'
    note = f'Standard deviations: {_words(selection.study).uncertainty}.'
    if selection.study.driven_by == MOTION:
        return note
    return record.words(f'The {{response}} changes {along} a positive {{load}}; parameters are magnitudes. {note}')


def _predicted_section(selection: Selection, predicted: Sequence[Judged]) -> Section:
    scale = _error_scale(selection)
    has_state = selection.final.law.has_state
    rows = tuple(
        (
            each.path.record.name,
            _number(scale.per_si * each.before_rms),
            _number(scale.per_si * each.after_rms),
            f'{each.after.state:+.2f}' if has_state else NOT_DETERMINED,
        )
        for each in predicted
    )
    table = Table(('predicted', 'before', 'after', 'state at the start'), ('', scale.unit, scale.unit, ''), rows)
    begins = 'the unloading' if selection.study.records[0].is_at_rest_first else 'the end of the first third'
    note = f'What comes before {begins} gives zero and state of friction; the error counts from there on.'
    pictures = [_pictures(selection, each, f'other{k}') for k, each in enumerate(predicted)]
    return Section('Further records, predicted', (note, table, *pictures))


def _figures(selection: Selection, name: str) -> list[Block]:
    """Pictures of each record, that with the largest error of law (6) first; all but the first four are folded."""
    order = sorted(enumerate(selection.judged), key=lambda numbered: -numbered[1].before_rms)
    sections = [_pictures(selection, each, f'{name}_{k}') for k, each in order]
    more = Section(f'{len(sections) - 4} more', tuple(sections[4:]), folded=True)
    return [Note(_PICTURES), *sections[:4], *([more] if sections[4:] else [])]


_PICTURES = (
    'Before, after: error (rms) by law (6) and by the selected law. Left: measured, and predicted where it was held '
    'out. Right: measured less predicted; what is shaded is judged.'
)


def _pictures(selection: Selection, judged: Judged, name: str) -> Section:
    residuals = [(judged.before.residual, SERIES[1], 'law (6)')]
    residuals += [(judged.after.residual, SERIES[0], 'selected law')] if selection.selected else []
    pictures = (
        Figure(partial(_loop_picture, judged.path, residuals, name)),
        Figure(partial(_residual_picture, judged, residuals, _error_scale(selection), name)),
    )
    return Section(judged.path.record.name, (Figures(pictures),))


_Residuals = list[tuple[Floats, str, str]]


def _averaged(*several: Floats) -> list[Floats]:
    """At most 1000 points of each."""
    return [block_means(values, -(-len(values) // 1000)) for values in several]


def _loop_picture(path: RecordPath, residuals: _Residuals, name: str) -> Markup:
    """What is driven over what drives: measured and predicted."""
    record, is_motion = path.record, path.driven_by == MOTION
    words, units = ['{response}', '{load}'], [record.unit('m'), record.load_unit]
    if not is_motion:
        words, units = words[::-1], units[::-1]
    driven = path.driven if is_motion else record.response_change
    scales = [_scale(float(np.ptp(each)), unit) for each, unit in zip((path.driver, driven), units, strict=True)]
    figure, (axes,) = new_figure(450.0, 300.0, margins=_MARGINS)
    curves = [(driven, INK, 'measured'), *((driven - left, colour, label) for left, colour, label in residuals)]
    for values, colour, label in curves:
        x, y = _averaged(scales[0].per_si * path.driver, scales[1].per_si * values)
        axes.plot(x, y, color=colour, lw=0.8 if colour == INK else 1.4, label=label)
    labels = [f'{record.words(word)}  [{scale.unit}]' for word, scale in zip(words, scales, strict=True)]
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.legend(**_LEGEND)
    return as_svg(figure, f'{name}_loop', record.words(f'{words[1]} over {words[0]}, measured and predicted'))


def _residual_picture(judged: Judged, residuals: _Residuals, scale: Scale, name: str) -> Markup:
    """Residuals over time, what is judged shaded."""
    figure, (axes,) = new_figure(450.0, 300.0, margins=_MARGINS)
    every = judged.path.time
    axes.axvspan(every[judged.rows.argmax()], every[-1], color=LINE, lw=0, alpha=0.5)
    axes.axhline(0, color=FAINT, lw=0.9)
    for residual, colour, label in residuals:
        time, left = _averaged(every, scale.per_si * residual)
        axes.plot(time, left, color=colour, lw=1.0, label=label)
    axes.set(xlabel='time  [s]', ylabel=f'residual  [{scale.unit}]', xlim=(every[0], every[-1]))
    axes.legend(**_LEGEND)
    return as_svg(figure, f'{name}_residual', 'residual over time by each law; what is judged is shaded')


_MARGINS = Margins(left=64, right=8, bottom=74, top=12)
_LEGEND = {'frameon': False, 'loc': 'upper center', 'bbox_to_anchor': (0.5, -0.19), 'ncols': 3, 'handlelength': 1.4}
