"""The tables on measured loops, for a terminal and for the page."""

from __future__ import annotations

from scara_kinetostatic.render.quantities import chance
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.dial_gauge.text import Table, with_std
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisStudy, Record
from scara_kinetostatic.studies.hysteresis.dependence import VARIABLES
from scara_kinetostatic.studies.hysteresis.laws import Law
from scara_kinetostatic.studies.hysteresis.model_selection import Comparison, Score

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


def force(newton: float) -> str:
    """Three digits, no exponent."""
    return f'{newton:.0f}' if newton >= 99.5 else f'{newton:.3g}'


def share(part: float) -> str:
    """A part in per cent."""
    return f'{100 * part:.0f} %' if part > 0 else 'nothing'


def summary_table(study: HysteresisStudy) -> Table:
    """Before and after, record by record: errors on sweeps not used in the fit."""
    rows = []
    for number, record in enumerate(study.records):
        choice = record.choice
        shown = [('before: law (6)', choice.before)]
        shown += [('after: ' + title(choice.winner.law), choice.winner)] if choice.winner else []
        shown += [('refined', choice.after)] if choice.winner and choice.after.law != choice.winner.law else []
        for words, score in shown:
            first = record.source if score is choice.before else ''
            rows.append((first, words, *_errors(score, record)))
        rows += [
            ('', f'refined as {study.records[each.other].source}', *_errors(each.score, record))
            for each in study.borrowed
            if each.record == number
        ]
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
        (VARIABLES[each.variable], share(each.share), chance(each.p_value), share(after[each.variable].share),
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


def transfer_table(study: HysteresisStudy) -> Table:
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
