"""Measured loops in words and tables, for a terminal and for the page."""

from __future__ import annotations

import math

from scara_kinetostatic.experiments.gauge_solution import Estimate
from scara_kinetostatic.experiments.loops_choice import AMBIGUOUS, LEVEL, NONE, UNEXPLAINED, Comparison, Score
from scara_kinetostatic.experiments.loops_dependence import VARIABLES, Dependence
from scara_kinetostatic.experiments.loops_laws import Law
from scara_kinetostatic.experiments.loops_study import LoopsStudy, Record
from scara_kinetostatic.report.gauge_text import Table, with_std
from scara_kinetostatic.report.quantities import chance, count

MEANING = {
    'softening': 'softening: the spring gives way at large loads',
    'viscous': 'a damper in parallel: the force grows with the speed',
    'friction': 'Coulomb friction in parallel: the force jumps with the sense of motion',
    'slip_no_gap': 'friction in series, without a gap: the force levels off and the joint slips',
    'slip': 'friction in series: the force levels off and the joint slips',
}
PARAMETERS = {
    'zero': ('zero of the displacement', 1e3, 'mm'),
    'start': ('state at the start', 1e3, 'mm'),
    'compliance': ('compliance p', 1e9, 'nm/N'),
    'half_gap': ('half gap g', 1e3, 'mm'),
    'force_zero': ('zero of the force', 1.0, 'N'),
    'slip_positive': ('slips at, positive', 1.0, 'N'),
    'slip_negative': ('slips at, negative', 1.0, 'N'),
    'damping': ('damping', 1e-3, 'Ns/mm'),
    'friction': ('friction', 1.0, 'N'),
    'compliance_ratio': ('negative / positive compliance', 1.0, ''),
    'rounding': ('rounding of the gap', 1e3, 'mm'),
    'place_positive': ('slip force by place, positive', 1e-3, 'N/mm'),
    'place_negative': ('slip force by place, negative', 1e-3, 'N/mm'),
    'slow_positive': ('more at rest, positive', 1.0, 'N'),
    'slow_negative': ('more at rest, negative', 1.0, 'N'),
    'breakaway_positive': ('more after reversal, positive', 1.0, 'N'),
    'breakaway_negative': ('more after reversal, negative', 1.0, 'N'),
    'breakaway_length': ('dies away over', 1e3, 'mm'),
}
"""What each parameter is called, and the unit it is shown in."""


def title(law: Law) -> str:
    """A law in a few words; refinements after a plus."""
    first, *more = law.title.split(', ') if '+' in law.name else [law.title]
    return ' + '.join([first, *more])


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
    sentence = f'depends on {VARIABLES[best.variable]}, which explains {_share(best.share)} of its square'
    return f'{sentence}; the displacement alone {_share(alone.share)}'


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


def _share(share: float) -> str:
    return f'{100 * share:.0f} %' if share > 0 else 'nothing'


def force(newton: float) -> str:
    """Three digits, no exponent."""
    return f'{newton:.0f}' if newton >= 99.5 else f'{newton:.3g}'


def summary_table(study: LoopsStudy) -> Table:
    """Before and after, record by record: errors on sweeps not used in the fit."""
    rows = []
    for record in study.records:
        choice = record.choice
        shown = [('before: law (6)', choice.before)]
        shown += [('after: ' + title(choice.winner.law), choice.winner)] if choice.winner else []
        shown += [('refined', choice.after)] if choice.winner and choice.after.law != choice.winner.law else []
        for words, score in shown:
            first = record.source if score is choice.before else ''
            rows.append((first, words, *_errors(score, record)))
    heading = ('file', 'law', 'fitted', 'held out', 'later half', 'earlier half', 'of range', 'as displacement')
    return Table(heading, ('', '', 'N', 'N', 'N', 'N', '%', 'mm'), tuple(rows))


def _errors(score: Score, record: Record) -> tuple[str, ...]:
    share = 100 * score.held_out_rms / record.motion.force_range
    moved = 1e3 * record.compliance * score.held_out_rms
    errors = (score.train_rms, score.held_out_rms, score.later_rms, score.earlier_rms)
    return (*(force(each) for each in errors), f'{share:.2g}' if share < 10 else f'{share:.0f}', f'{moved:.2g}')


def candidate_table(record: Record) -> Table:
    """Every candidate against law (6)."""
    choice = record.choice
    found = [
        (*_law_cells(choice.before, record), '', '', 'before'),
        (*_law_cells(choice.told, record), '', '', 'no candidate'),
        *(_candidate_row(each, record) for each in choice.candidates),
    ]
    heading = ('law', 'parameters', 'fitted', 'held out', 'later half', 'earlier half', 'p', 'ΔBIC', '')
    return Table(heading, ('', '', 'N', 'N', 'N', 'N', '', '', ''), tuple(found))


def _law_cells(score: Score, record: Record) -> tuple[str, ...]:
    return (title(score.law), str(len(score.law.parameters)), *_errors(score, record)[:4])


def _candidate_row(each: Comparison, record: Record) -> tuple[str, ...]:
    choice, name = record.choice, each.score.law.name
    note = 'better' if each.accepted else 'no better'
    if choice.winner is not None and name == choice.winner.law.name:
        note = 'named'
    elif name in choice.rivals:
        note = 'rival'
    return (*_law_cells(each.score, record), chance(each.p_gain), f'{each.bic:.0f}', note)


def refinement_table(record: Record) -> Table:
    """Every step of the refinement: what was tried, against the law before it."""
    rows = []
    for number, step in enumerate(record.choice.refinements, 1):
        for place, each in enumerate(step):
            note = ('taken' if place == 0 else 'better as well') if each.accepted else 'not accepted'
            cells = (each.score.law.title.split(', ')[-1], *_law_cells(each.score, record)[1:])
            rows.append((str(number) if place == 0 else '', *cells, chance(each.p_gain), f'{each.bic:.0f}', note))
    heading = ('step', 'added', 'parameters', 'fitted', 'held out', 'later half', 'earlier half', 'p', 'ΔBIC', '')
    return Table(heading, ('', '', '', 'N', 'N', 'N', 'N', '', '', ''), tuple(rows))


def dependence_table(record: Record) -> Table:
    """What the residual depends on, before and after."""
    choice = record.choice
    after = {each.variable: each for each in choice.left}
    rows = tuple(
        (VARIABLES[each.variable], _share(each.share), chance(each.p_value), _share(after[each.variable].share),
         chance(after[each.variable].p_value))
        for each in choice.structure
    )  # fmt: skip
    return Table(('residual over', 'before', 'p', 'after', 'p'), ('', '', '', '', ''), rows)


def parameter_table(record: Record) -> Table:
    """Parameters of law (6), of the law named and of the refined one."""
    laws = list(record.parameters)
    names = [name for name in PARAMETERS if any(name in record.parameters[law] for law in laws)]
    headings = ('before', 'after', 'refined')[: len(laws)]
    rows = tuple(
        (PARAMETERS[name][0], *(_value(record, law, name) for law in laws), PARAMETERS[name][2]) for name in names
    )
    return Table(('parameter', *headings, ''), ('',) * (len(laws) + 2), rows)


def _value(record: Record, law: str, name: str) -> str:
    estimate: Estimate | None = record.parameters[law].get(name)
    return '' if estimate is None else with_std(estimate, PARAMETERS[name][1])


def transfer_table(study: LoopsStudy) -> Table:
    """Each record from the others."""
    rows = tuple(
        (study.records[each.record].source, f'{each.tension:g}', force(each.before), force(each.after),
         force(each.shown), force(each.own), _pair(each.slips), _pair(each.own_slips))
        for each in study.transfers
    )  # fmt: skip
    heading = (
        'predicted',
        'tension',
        'law (6)',
        'slip by tension',
        'slip shown',
        'own fit',
        'slips at, predicted',
        'own',
    )
    return Table(heading, ('', '', 'N', 'N', 'N', 'N', 'N', 'N'), rows)


def _pair(slips: tuple[float, float]) -> str:
    return f'{slips[0]:.0f} / {slips[1]:.0f}'


TRANSFER = (
    'Each record predicted from the others: slope, gap and zero carried over; slip force by a straight line over the '
    'tension, or shown by the first three sweeps, which are not scored.'
)
ERRORS = (
    'rms of measured less predicted force. Held out: sweeps not used in the fit, both ways: the later half predicted '
    'from the earlier, the earlier from the later. As displacement: times the compliance of the law named.'
)


def text(study: LoopsStudy) -> str:
    """Everything, for a terminal."""
    parts = []
    for record in study.records:
        headline, sentences = verdict(record)
        parts += [f'{record.source}: {headline}', '\n'.join(sentences), plain(candidate_table(record))]
        parts += [plain(refinement_table(record))] if record.choice.refinements else []
        parts += [plain(dependence_table(record)), plain(parameter_table(record))]
    parts += ['Before and after', plain(summary_table(study)), ERRORS]
    parts += [TRANSFER, plain(transfer_table(study))] if study.transfers else []
    parts += [f'note: {note}' for record in study.records for note in record.notes]
    return '\n\n'.join(parts)


def plain(table: Table) -> str:
    """Aligned columns."""
    lines = [table.heading, *([table.units] if any(table.units) else []), *table.rows]
    widths = [max(len(line[k]) for line in lines) for k in range(len(table.heading))]
    right = [is_number(table, k) for k in range(len(widths))]
    return '\n'.join(
        '  '.join(
            cell.rjust(width) if aside else cell.ljust(width)
            for cell, width, aside in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in lines
    )


def is_number(table: Table, column: int) -> bool:
    """Whether a column holds numbers, which are set to the right."""
    cells = [row[column] for row in table.rows if row[column]]
    return (
        bool(cells)
        and column > 0
        and all(c.lstrip('-(')[:1].isdigit() or c in ('nothing', 'below 1e-12') for c in cells)
    )


def sweeps(record: Record) -> str:
    """What the record holds."""
    motion = record.motion
    size = f'{1e3 * motion.travel:.1f} mm, {1e-3 * motion.force_range:.1f} kN from end to end'
    return f'{count(motion.sweeps, "sweep")}, {count(len(motion), "sample")}, {size}'
