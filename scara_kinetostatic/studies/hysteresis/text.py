"""Measured loops in words, for a terminal and for the page."""

from __future__ import annotations

import math

from scara_kinetostatic.render.quantities import chance, count
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisStudy, Record
from scara_kinetostatic.studies.hysteresis.dependence import VARIABLES, Dependence
from scara_kinetostatic.studies.hysteresis.model_selection import AMBIGUOUS, LEVEL, NONE, UNEXPLAINED
from scara_kinetostatic.studies.hysteresis.tables import (
    candidate_table,
    dependence_table,
    force,
    parameter_table,
    plain,
    refinement_table,
    share,
    summary_table,
    transfer_table,
)

MEANING = {
    'softening': 'softening: the spring gives way at large loads',
    'viscous': 'a damper in parallel: the force grows with the speed',
    'friction': 'Coulomb friction in parallel: the force jumps with the sense of motion',
    'slip_no_gap': 'friction in series, without a gap: the force levels off and the joint slips',
    'slip': 'friction in series: the force levels off and the joint slips',
}


def verdict(record: Record) -> tuple[str, list[str]]:
    """One line, and the sentences below it."""
    choice = record.choice
    if choice.verdict == NONE:
        enough = f'the residual depends on nothing that was asked (p = {chance(choice.p_value)})'
        return 'Law (6) is enough', [f'Slope and gap are all that these loops show: {enough}.']
    first = f'Law (6) is not enough (p {_chance(choice.p_value)}): its residual {_depends(choice.structure)}.'
    if choice.verdict == UNEXPLAINED:
        return 'Law (6) is not enough, and none of the candidates helps', [first]
    assert choice.winner is not None
    headline = f'Law (6) lacks {MEANING[choice.winner.law.name]}'
    if choice.verdict == AMBIGUOUS:
        others = '; or '.join(MEANING[name] for name in choice.rivals)
        headline = (
            f'Law (6) lacks one of these, the data cannot tell which: {MEANING[choice.winner.law.name]}; or {others}'
        )
    return headline, [first, _before_after(record), *_left(record)]


def _depends(found: tuple[Dependence, ...]) -> str:
    best = found[0]
    alone = next(each for each in found if each.variable == 'displacement')
    sentence = f'depends on {VARIABLES[best.variable]}, which explains {share(best.share)} of its square'
    return f'{sentence}; the displacement alone {share(alone.share)}'


def _before_after(record: Record) -> str:
    winner, before = record.choice.winner, record.choice.before
    assert winner is not None
    factor = before.held_out_rms / winner.held_out_rms
    return (
        f'On sweeps not used in the fit the force error falls from {force(before.held_out_rms)} to '
        f'{force(winner.held_out_rms)} N, by a factor of {factor:.1f}.'
    )


def _left(record: Record) -> list[str]:
    """What remains open."""
    choice, sentences = record.choice, []
    if choice.winner is not None and choice.after.law.name != choice.winner.law.name:
        added = ', '.join(choice.after.law.title.split(', ')[1:])
        sentences.append(
            f'Refined by {added}: {force(choice.after.held_out_rms)} N. These describe the curves of this record; '
            'that they are its physics is not shown.'
        )
    if math.isfinite(record.repeatability):
        sentences.append(
            f'Where the motion repeats, the force repeats to {force(record.repeatability)} N: '
            f'{choice.after.whole.rms(record.motion.scored) / record.repeatability:.1f} times less than what is left.'
        )
    independent = f'its {len(record.motion)} samples are worth {record.independent:.0f} independent ones'
    sentences.append(f'What is left is no noise: {independent}.' if structured(record) else f'Left: {independent}.')
    if choice.p_left < LEVEL:
        sentences.append(f'It still {_depends(choice.left)} (p {_chance(choice.p_left)}).')
    return sentences


def structured(record: Record) -> bool:
    """Whether the residual after hangs together over many samples."""
    return record.independent < len(record.motion) / 3


def _chance(p_value: float) -> str:
    text = chance(p_value)
    return text if text.startswith('below') else f'= {text}'


def transfer_sentences(study: HysteresisStudy) -> list[str]:
    """How well that went."""
    ratios = [a / b for each in study.transfers for a, b in zip(each.slips, each.own_slips, strict=True) if b > 0]
    shown = [each.shown / each.own for each in study.transfers]
    worse = [study.records[each.record].source for each in study.transfers if each.after >= each.before]
    found = []
    if ratios:
        found.append(f'The slip force by the line is {min(ratios):.2g} to {max(ratios):.2g} times that of the own fit.')
    found += [f'Predicted no better than by law (6): {", ".join(worse)}.'] if worse else []
    more = f'{min(shown):.2g} to {max(shown):.2g} times that of the own fit'
    return [*found, f'With the slip force shown, the error of the slope and gap carried over is {more}.']


TRANSFER = (
    'Each record predicted from the others: slope, gap and zero carried over; slip force by a straight line over the '
    'tension, or shown by the first three sweeps, which are not scored.'
)
ERRORS = (
    'rms of measured less predicted force. Held out: sweeps not used in the fit, both ways: the later half predicted '
    'from the earlier, the earlier from the later. As displacement: times the compliance of the law named. Refined: '
    'what was added is chosen by the held-out error, which is a little too good for that; refined as another file: not.'
)


def text(study: HysteresisStudy) -> str:
    """Everything, for a terminal."""
    parts = []
    for record in study.records:
        headline, sentences = verdict(record)
        parts += [f'{record.source}: {headline}', '\n'.join(sentences), plain(candidate_table(record))]
        parts += [plain(refinement_table(record))] if record.choice.refinements else []
        parts += [plain(dependence_table(record)), plain(parameter_table(record))]
    parts += ['Before and after', plain(summary_table(study)), ERRORS]
    if study.transfers:
        parts += [TRANSFER, plain(transfer_table(study)), '\n'.join(transfer_sentences(study))]
    parts += [f'note: {note}' for record in study.records for note in record.notes]
    return '\n\n'.join(parts)


def sweeps(record: Record) -> str:
    """What the record holds."""
    motion = record.motion
    size = f'{1e3 * motion.travel:.1f} mm, {1e-3 * motion.force_range:.1f} kN from end to end'
    return f'{count(motion.sweeps, "sweep")}, {count(len(motion), "sample")}, {size}'
