"""The hysteresis analysis as sentences, for a terminal and for the page."""

from __future__ import annotations

import math

from scara_kinetostatic.report.quantities import chance, count, p_equals
from scara_kinetostatic.report.table import Table
from scara_kinetostatic.studies.dial_gauge.report import with_std
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisAnalysis, Record, Units
from scara_kinetostatic.studies.hysteresis.model_selection import (
    AMBIGUOUS,
    LEVEL,
    NONE,
    UNEXPLAINED,
    VARIABLES,
    Comparison,
    CrossValidation,
    Dependence,
)

_PARAMETERS = {
    'zero': ('zero of the {response}', 1e3, 'mm'),
    'start': ('state at the start', 1e3, 'mm'),
    'compliance': ('compliance p', 1e9, 'nm/N'),
    'half_gap': ('half gap g', 1e3, 'mm'),
    'force_zero': ('zero of the {load}', 1.0, 'N'),
    'slip_positive': ('slip {load}, positive', 1.0, 'N'),
    'slip_negative': ('slip {load}, negative', 1.0, 'N'),
    'damping': ('damping', 1e-3, 'Ns/mm'),
    'friction': ('friction', 1.0, 'N'),
}
"""Name of each parameter, displayed units per SI unit, and the displayed unit, of a force over a displacement."""


def _units(units: Units, *linear: str) -> tuple[str, ...]:
    return tuple(units.unit(each) for each in linear)


def variable(name: str, units: Units) -> str:
    """A variable of the motion in words."""
    return VARIABLES[name].replace('displacement', units.response)


def force(newton: float) -> str:
    """A force or torque with three digits, without exponent."""
    return f'{newton:.0f}' if newton >= 99.5 else f'{newton:.3g}'


def share(part: float) -> str:
    """A share in per cent."""
    return f'{100 * part:.0f} %' if part > 0 else 'nothing'


def summary_table(analysis: HysteresisAnalysis) -> Table:
    """Before and after, record by record: errors on sweeps not used in the fit."""
    rows = []
    for record in analysis.records:
        selection = record.selection
        shown = [('before: law (6)', selection.before)]
        shown += [('after: ' + selection.selected.law.title, selection.selected)] if selection.selected else []
        for label, score in shown:
            first = record.name if score is selection.before else ''
            rows.append((first, label, *_errors(score, record)))
    heading = (
        'file',
        'law',
        'fitted',
        'held out',
        'later half',
        'earlier half',
        'of range',
        f'as {analysis.units.response}',
    )
    return Table(heading, _units(analysis.units, '', '', 'N', 'N', 'N', 'N', '%', 'mm'), tuple(rows))


def _errors(score: CrossValidation, record: Record) -> tuple[str, ...]:
    share = 100 * score.held_out_rms / record.motion.force_range
    moved = 1e3 * record.compliance * score.held_out_rms
    errors = (score.train_rms, score.held_out_rms, score.later_rms, score.earlier_rms)
    return (*(force(each) for each in errors), f'{share:.2g}' if share < 10 else f'{share:.0f}', f'{moved:.2g}')


def candidate_table(record: Record) -> Table:
    """Every candidate compared with law (6)."""
    selection = record.selection
    found = [
        (*_law_cells(selection.before, record), '', '', 'before'),
        (*_law_cells(selection.with_reset, record), '', '', 'not a candidate'),
        *(_candidate_row(each, record) for each in selection.candidates),
    ]
    heading = ('law', 'parameters', 'fitted', 'held out', 'later half', 'earlier half', 'p', 'ΔBIC', '')
    return Table(heading, _units(record.units, '', '', 'N', 'N', 'N', 'N', '', '', ''), tuple(found))


def _law_cells(score: CrossValidation, record: Record) -> tuple[str, ...]:
    return (score.law.title, str(len(score.law.parameters)), *_errors(score, record)[:4])


def _candidate_row(each: Comparison, record: Record) -> tuple[str, ...]:
    selection, name = record.selection, each.score.law.name
    note = 'better' if each.accepted else 'no better'
    if selection.selected is not None and name == selection.selected.law.name:
        note = 'selected'
    elif name in selection.rivals:
        note = 'rival'
    return (*_law_cells(each.score, record), chance(each.p_gain), f'{each.bic:.0f}', note)


def dependence_table(record: Record) -> Table:
    """Dependence of the residual, law (6) and selected law."""
    selection = record.selection
    after = {each.variable: each for each in selection.dependence_after}
    rows = tuple(
        (variable(each.variable, record.units),
         share(each.share), chance(each.p_value), share(after[each.variable].share),
         chance(after[each.variable].p_value))
        for each in selection.dependence_before
    )  # fmt: skip
    return Table(('residual over', 'before', 'p', 'after', 'p'), ('', '', '', '', ''), rows)


def parameter_table(record: Record) -> Table:
    """Parameters of law (6) and of the selected law."""
    laws = list(record.parameters)
    names = [name for name in _PARAMETERS if any(name in record.parameters[law] for law in laws)]
    headings = ('before', 'after')[: len(laws)]
    rows = tuple(
        (
            _PARAMETERS[name][0].format(load=record.units.load, response=record.units.response),
            *(_value(record, law, name) for law in laws),
            record.units.unit(_PARAMETERS[name][2]),
        )
        for name in names
    )
    return Table(('parameter', *headings, ''), ('',) * (len(laws) + 2), rows)


def _value(record: Record, law: str, name: str) -> str:
    estimate: Estimate | None = record.parameters[law].get(name)
    _, per_si, unit = _PARAMETERS[name]
    return '' if estimate is None else with_std(estimate, record.units.factor(unit, per_si))


def prediction_table(analysis: HysteresisAnalysis) -> Table:
    """Each record predicted from the others."""
    rows = tuple(
        (analysis.records[each.record].name, f'{each.tension:g}', force(each.backlash), force(each.by_tension),
         force(each.identified), force(each.own), _pair(each.slips), _pair(each.own_slips))
        for each in analysis.leave_one_out
    )  # fmt: skip
    heading = (
        'predicted',
        'tension',
        'law (6)',
        'slip by tension',
        'slip identified',
        'own fit',
        f'slip {analysis.units.load}, predicted',
        'own fit',
    )
    return Table(heading, _units(analysis.units, '', '', 'N', 'N', 'N', 'N', 'N', 'N'), rows)


def _pair(slips: tuple[float, float]) -> str:
    return f'{force(slips[0])} / {force(slips[1])}'


_MEANING = {
    'softening': 'a softening spring: the stiffness decreases with the load',
    'viscous': 'viscous damping in parallel: a {load} proportional to the speed',
    'friction': 'Coulomb friction in parallel: the {load} jumps with the sense of motion',
    'slip_no_gap': 'Coulomb friction in series, without a gap: the joint slips at a limit of the {load}',
    'slip': 'Coulomb friction in series: the joint slips at a limit of the {load}',
}
_CORRELATED = 3
"""A residual with fewer effective samples than the number of samples over this is correlated."""
DRIVEN = 'Driven by their motion: the {load} is predicted from the {response}.'
PREDICTION = (
    'Each record predicted from the others: mean slope, gap and zero of the others; slip {load} from a straight line '
    'over the tension, or identified from the first three sweeps of the record, which do not count for the error.'
)
ERRORS = (
    'rms of measured less predicted {load}. Held out: sweeps not used in the fit; later half: predicted from the '
    'earlier half, earlier half: from the later. As {response}: multiplied by the compliance of the selected law.'
)


def in_words(sentence: str, units: Units) -> str:
    """A sentence with the words of a force over a displacement, or of a torque over an angle."""
    return sentence.format(load=units.load, response=units.response)


def verdict(record: Record) -> tuple[str, list[str]]:
    """Headline of a record, and the sentences below it."""
    selection = record.selection
    if selection.verdict == NONE:
        found = f'No dependence of its residual was found ({p_equals(selection.p_value)}).'
        return 'Law (6), slope and gap, is sufficient', [found]
    depends = _depends(selection.dependence_before, record.units)
    first = f'The residual of law (6) {depends} ({p_equals(selection.p_value)}).'
    if selection.verdict == UNEXPLAINED:
        return 'Law (6) is not sufficient, and no candidate predicts better', [first]
    assert selection.selected is not None
    laws = [in_words(_MEANING[name], record.units) for name in (selection.selected.law.name, *selection.rivals)]
    headline = f'Law (6) is not sufficient: {laws[0]}'
    if selection.verdict == AMBIGUOUS:
        headline = f'Law (6) is not sufficient; these records do not distinguish between {"; and ".join(laws)}'
    return headline, [first, _before_after(record), *_limits(record)]


def _depends(found: tuple[Dependence, ...], units: Units) -> str:
    best = found[0]
    alone = next(each for each in found if each.variable == 'displacement')
    sentence = f'depends on {variable(best.variable, units)}, which explains {share(best.share)} of its square'
    return f'{sentence}; the {units.response} alone explains {share(alone.share)}'


def _before_after(record: Record) -> str:
    selected, before = record.selection.selected, record.selection.before
    assert selected is not None
    factor = before.held_out_rms / selected.held_out_rms
    return (
        f'On sweeps not used in the fit the {record.units.load} error falls from {force(before.held_out_rms)} to '
        f'{force(selected.held_out_rms)} {record.units.unit("N")}, by a factor of {factor:.1f}.'
    )


def _limits(record: Record) -> list[str]:
    """Repeatability and what the residual still contains."""
    selection, sentences = record.selection, []
    if math.isfinite(record.repeatability):
        ratio = selection.final.whole.rms(record.motion.scored) / record.repeatability
        sentences.append(
            f'Repeatability of the {record.units.load} where the motion repeats: {force(record.repeatability)} '
            f'{record.units.unit("N")}; the residual is {ratio:.1f} times as large.'
        )
    effective = f'effective number of samples {record.independent:.0f} of {len(record.motion)}'
    correlation = 'correlated and not only noise' if is_correlated(record) else 'hardly correlated'
    sentences.append(f'The residual is {correlation}: {effective}.')
    if selection.p_after < LEVEL:
        sentences.append(
            f'It still {_depends(selection.dependence_after, record.units)} ({p_equals(selection.p_after)}).'
        )
    return sentences


def is_correlated(record: Record) -> bool:
    """Whether the residual of the final law is correlated over many samples."""
    return record.independent < len(record.motion) / _CORRELATED


def prediction_sentences(analysis: HysteresisAnalysis) -> list[str]:
    """Errors of the leave-one-out predictions."""
    found = analysis.leave_one_out
    ratios = [a / b for each in found for a, b in zip(each.slips, each.own_slips, strict=True) if b > 0]
    identified = [each.identified / each.own for each in found]
    worse = [analysis.records[each.record].name for each in found if each.by_tension >= each.backlash]
    sentences = []
    if ratios:
        limits = f'{min(ratios):.2g} to {max(ratios):.2g}'
        sentences.append(
            f"The slip {analysis.units.load} from the straight line is {limits} times that of the record's own fit."
        )
    sentences += [f'Predicted no better than by law (6): {", ".join(worse)}.'] if worse else []
    limits = f'{min(identified):.2g} to {max(identified):.2g}'
    return [
        *sentences,
        f'With the slip {analysis.units.load} identified, the error is {limits} times that of the own fit.',
    ]


def text(analysis: HysteresisAnalysis) -> str:
    """The whole result for a terminal."""
    parts = [in_words(DRIVEN, analysis.units)]
    for record in analysis.records:
        headline, sentences = verdict(record)
        parts += [f'{record.source}: {headline}', '\n'.join(sentences), candidate_table(record).text()]
        parts += [dependence_table(record).text(), parameter_table(record).text()]
    parts += ['Before and after', summary_table(analysis).text(), in_words(ERRORS, analysis.units)]
    if analysis.leave_one_out:
        parts += [
            in_words(PREDICTION, analysis.units),
            prediction_table(analysis).text(),
            '\n'.join(prediction_sentences(analysis)),
        ]
    parts += [f'note: {note}' for record in analysis.records for note in record.notes]
    return '\n\n'.join(parts)


def sweeps(record: Record) -> str:
    """Size of a record in words."""
    motion = record.motion
    load, response = (record.units.factor(*each) for each in (('kN', 1e-3), ('mm', 1e3)))
    moved = f'{response * motion.travel:.1f} {record.units.unit("mm")}'
    size = f'range {moved} and {load * motion.force_range:.1f} {record.units.unit("kN")}'
    return f'{count(motion.sweeps, "sweep")}, {count(len(motion), "sample")}, {size}'
