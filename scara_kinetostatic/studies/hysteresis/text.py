"""The hysteresis analysis as sentences, for a terminal and for the page."""

from __future__ import annotations

import math

from scara_kinetostatic.report.quantities import count, p_equals
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisAnalysis, Record
from scara_kinetostatic.studies.hysteresis.dependence import Dependence
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, NONE, UNEXPLAINED
from scara_kinetostatic.studies.hysteresis.tables import (
    candidate_table,
    dependence_table,
    force,
    parameter_table,
    prediction_table,
    share,
    summary_table,
    variable,
)
from scara_kinetostatic.studies.hysteresis.units import Units

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
