"""Tables of the hysteresis analysis, for a terminal and for the page."""

from __future__ import annotations

from scara_kinetostatic.report.quantities import chance
from scara_kinetostatic.report.table import Table
from scara_kinetostatic.studies.dial_gauge.statistics import Estimate
from scara_kinetostatic.studies.dial_gauge.text import with_std
from scara_kinetostatic.studies.hysteresis.analysis import HysteresisAnalysis, Record
from scara_kinetostatic.studies.hysteresis.dependence import VARIABLES
from scara_kinetostatic.studies.hysteresis.model_selection import Comparison, CrossValidation
from scara_kinetostatic.studies.hysteresis.units import Units

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
