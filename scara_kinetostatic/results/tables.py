"""Tables of a calibration: parameters, uncertainty budget, effects, candidates, biases, limits, touches."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.uncertainty_budget import Item
from scara_kinetostatic.diagnosis.comparison import Comparison
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.diagnosis.result import Diagnosis, Found
from scara_kinetostatic.model.parameters import DESCRIPTIONS
from scara_kinetostatic.report import Table
from scara_kinetostatic.report.quantities import SCALES, chance, decimals, micrometres, shown, unsigned_zero

NOTABLE = 2.0
"""A bias of so many standard deviations is drawn in the warning colour."""
_STATUS = {'estimated': '', 'fixed': 'fixed', 'confounded': 'not determined by these data'}
_LISTED = 8
"""So many dependences are listed."""


def parameter_table(c: Calibration) -> Table:
    """The parameters of the base model with what they are, or why they have no value.

    A value has the digits that its uncertainty allows; one that the data do not determine is in brackets.
    """
    nominal, values = c.cell.nominal.as_dict(), c.parameters.as_dict()
    rows = []
    for name in c.parameters.names:
        (unit, per_si), status = SCALES[name], c.status[name]
        found = shown(values[name], c.std_of(name), unit, {unit: SCALES[name]})
        text = f'({found.value})' if status == 'confounded' else unsigned_zero(f'{values[name] * per_si:.6g}')
        text = f'{found.value} ± {found.std}' if found.std else text
        start = unsigned_zero(f'{nominal[name] * per_si:.6g}')
        rows.append((name, start, text, unit, _STATUS[status] or DESCRIPTIONS[name]))
    levels = {'estimated': '', 'fixed': 'faint', 'confounded': 'caution'}
    heading = ('', 'nominal', 'estimate ± 1 σ', '', '')
    return Table(heading, ('',) * 5, tuple(rows), levels=tuple(levels[c.status[name]] for name in c.parameters.names))


def base_rank(c: Calibration) -> int:
    """How many parameters of the base model, or of their combinations, the data determine.

    Each confounded group is one unidentifiable direction; groups of effects' parameters alone do not count.
    """
    free = sum(status != 'fixed' for status in c.status.values())
    return free - sum(bool(set(group) & set(c.parameters.names)) for group in c.identifiability.confounded)


def effect_tables(found: Sequence[Found]) -> list[Table]:
    """Each effect of the extended model with its values; those of a fitted curve have no meaning by themselves."""
    tables = []
    for item in found:
        doubt = ' (possible, not proved)' if item.is_possible else ''
        doubt = doubt if item.in_every_model else ' (one of several possible causes)'
        title = item.effect.title + doubt
        rows: tuple[tuple[str, ...], ...] = ()
        if item.effect.is_physical:
            title += f'  {item.effect.label}'
            rows = tuple((f'    {v.name}', shown(v.value, v.std, v.unit).text, v.meaning) for v in item.values)
        tables.append(Table(('',) * 3, ('',) * 3, rows, title=f'  {title}'))
    return tables


def tip_budget(outcome: Outcome, most: int | None = None) -> Table | None:
    """Contributions to the tip where its uncertainty is largest, the largest first; None where it is not determined.

    Args:
        outcome: the result.
        most: so many are listed, the others together; None for all.
    """
    items = sorted(outcome.budget, key=lambda item: -item.tip)
    total = math.hypot(*(item.tip for item in items))
    if not total > 0 or not math.isfinite(total) or not math.isfinite(outcome.tip_uncertainty.worst):
        return None
    listed = [(item.title, item.evaluation, _declared(item), item.tip) for item in items[:most]]
    if others := items[len(listed) :]:
        listed.append((f'{len(others)} others', '', '', math.hypot(*(item.tip for item in others))))
    listed.append(('combined standard uncertainty', '', '', total))
    rows = [(*words, micrometres(size), f'{100 * (size / total) ** 2:.0f} %') for *words, size in listed]
    heading = ('tip: source', 'type', 'declared', 'contribution', 'share of the variance')
    return Table(heading, ('', '', '', 'µm', ''), tuple(rows))


def _declared(item: Item) -> str:
    return '' if item.declared is None else shown(item.declared, math.nan, item.unit).text


def error_table(compared: Comparison) -> Table:
    """Force and tip, fitted and held out, and chi-square, of the nominal, the base and the extended model."""
    tip = micrometres(compared.nominal_tip)
    rows: list[tuple[str, ...]] = [('nominal parameters', f'{compared.nominal:.3g}', '', tip, '', '')]
    sides = [('base model', compared.base), ('extended model', compared.extended)]
    for name, side in sides[: 1 if compared.base == compared.extended else 2]:
        tips = map(micrometres, (side.tip.fitted, side.tip.held_out))
        force = (f'{each:.3g}' for each in (side.force_error, side.held_out))
        rows.append((name, *force, *tips, f'{side.reduced_chi_square:.2f}'))
    rows.append(('expected from noise', '', '', micrometres(compared.extended.tip.noise), '', '1'))
    heading = ('', 'force error', 'held out', 'tip error', 'held out', 'reduced chi-square')
    return Table(heading, ('', 'N', 'N', 'µm', 'µm', ''), tuple(rows))


def bias_table(compared: Comparison) -> Table:
    """Each parameter by the base and by the extended model, and their difference."""
    rows, levels = [], []
    for bias in compared.biases:
        unit, per_si = SCALES[bias.name]
        digits = decimals(bias.std * per_si)
        places = 3 if digits is None else digits
        base, extended, shift = (
            unsigned_zero(f'{value * per_si:.{places}f}') for value in (bias.base, bias.value, bias.shift)
        )
        if bias.base_std > 0 and math.isfinite(bias.base_std):
            base += f' ± {bias.base_std * per_si:.{places}f}'
        if digits is not None:
            extended += f' ± {bias.std * per_si:.{places}f}'
        shift = '' if digits is None else shift
        rows.append((bias.name, base, extended, unit, shift, _signed(bias.in_std)))
        levels.append('bad' if bias.is_significant and abs(bias.in_std) > NOTABLE else '')
    heading = ('parameter', 'base model ± 1 σ', 'extended ± 1 σ', 'unit', 'bias', 'bias [σ]')
    return Table(heading, ('',) * 6, tuple(rows), levels=tuple(levels))


def _signed(value: float) -> str:
    if not math.isfinite(value):
        return ''
    return '0.0' if round(value, 1) == 0 else f'{value:+.1f}'


def candidate_table(d: Diagnosis) -> Table | None:
    """The identifiable candidates, of fitted curves only those that are not rejected; those found first, then by their
    gain; None if there are none.
    """
    rows = []
    for item in sorted(d.ranking, key=lambda item: (d.role_of(item) not in ('found', 'possible'), -item.gain)):
        role, p_value = d.role_of(item), chance(item.p_value) if math.isfinite(item.p_value) else ''
        if item.role != 'unidentifiable' and (item.effect.is_physical or role != 'rejected'):
            rows.append((item.effect.title, _signed(item.gain), p_value, f'{100 * item.share:.0f} %', role))
    levels = {'found': 'good', 'possible': 'good', 'rival': 'caution'}
    heading, shown = ('effect', 'gain', 'p-value', 'share', ''), tuple(levels.get(row[-1], '') for row in rows)
    return Table(heading, ('',) * 5, tuple(rows), levels=shown) if rows else None


def dependence_table(found: Sequence[Dependence]) -> Table | None:
    """What a residual depends on, the most significant first; None if on nothing."""
    rows = [(each.name, chance(each.p_value), f'{100 * each.share:.0f} %') for each in found[:_LISTED]]
    if len(found) > _LISTED:
        rows.append((f'and {len(found) - _LISTED} more, in calibration.json', '', ''))
    return Table(('the residual depends on', 'p-value', 'share'), ('',) * 3, tuple(rows)) if rows else None


def unidentifiable_table(d: Diagnosis) -> Table | None:
    """The physical effects that these touches cannot show at all; None if there are none."""
    effects = [item.effect for item in d.ranking if item.role == 'unidentifiable' and item.effect.is_physical]
    rows = tuple((effect.title, effect.confounded_with, effect.identified_by) for effect in effects)
    return Table(('effect', 'confounded with', 'identified by'), ('',) * 3, rows) if rows else None
