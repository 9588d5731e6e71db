"""Tables of a calibration: parameters, uncertainty budget, effects, candidates, biases, limits, touches."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.uncertainty_budget import NOISE, Item
from scara_kinetostatic.diagnosis.comparison import Comparison
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES
from scara_kinetostatic.report import NOT_DETERMINED, Table
from scara_kinetostatic.report.quantities import (
    PAGE_SCALES,
    PAGE_UNITS,
    SCALES,
    Scale,
    chance,
    decimals,
    shown,
    unsigned_zero,
)

NOTABLE = 2.0
"""A bias of so many standard deviations is drawn in the warning colour."""
_STATUS = {'estimated': '', 'fixed': 'fixed', 'confounded': 'not determined by these data'}
_LISTED = 8
"""So many dependences and detection limits are listed."""


class Row(NamedTuple):
    """One parameter, ready to print.

    Attributes:
        name: as everywhere.
        nominal: where the calibration started.
        value: the estimate, with the digits its uncertainty allows; in brackets where the data do not determine it.
        std: one standard deviation, two digits; empty where there is none.
        unit: of all three.
        status: ``estimated``, ``fixed`` or ``confounded``.
    """

    name: str
    nominal: str
    value: str
    std: str
    unit: str
    status: str


def parameter_rows(c: Calibration, scales: Mapping[str, Scale] = SCALES) -> list[Row]:
    """The twelve parameters in their order, in units by name."""
    nominal, values = c.cell.nominal.as_dict(), c.parameters.as_dict()
    rows = []
    for name in NAMES:
        unit, per_si = scales[name]
        value, std, status = values[name] * per_si, c.std_of(name) * per_si, c.status[name]
        digits = decimals(std)
        text = f'{value:.6g}' if digits is None else f'{value:.{digits}f}'
        if digits is None and status == 'confounded':
            text = f'({value:.0f})' if 100 <= abs(value) < 1e6 else f'({value:.3g})'
        std_text = '' if digits is None else f'{std:.{digits}f}'
        start = unsigned_zero(f'{nominal[name] * per_si:.6g}')
        rows.append(Row(name, start, unsigned_zero(text), std_text, unit, status))
    return rows


def parameter_table(c: Calibration, scales: Mapping[str, Scale]) -> Table:
    """The twelve parameters with what they are, or why they have no value."""
    rows = parameter_rows(c, scales)
    cells = tuple(
        (
            row.name,
            row.nominal,
            f'{row.value} ± {row.std}' if row.std else row.value,
            row.unit,
            _STATUS[row.status] or DESCRIPTIONS[row.name],
        )
        for row in rows
    )
    levels = {'estimated': '', 'fixed': 'faint', 'confounded': 'caution'}
    heading = ('', 'nominal', 'estimate ± 1 σ', '', '')
    return Table(heading, ('',) * 5, cells, levels=tuple(levels[row.status] for row in rows))


def base_rank(c: Calibration) -> int:
    """How many of the twelve parameters, or of their combinations, the data determine.

    Each confounded group is one unidentifiable direction; groups of effects' parameters alone do not count.
    """
    free = sum(status != 'fixed' for status in c.status.values())
    return free - sum(bool(set(group) & set(NAMES)) for group in c.identifiability.confounded)


def effect_tables(found: Sequence[Found], units: Mapping[str, Scale] | None = None) -> list[Table]:
    """Each effect of the extended model with its values; those of a fitted curve have no meaning by themselves."""
    tables = []
    for item in found:
        doubt = ' (possible, not proved)' if item.is_possible else ''
        doubt = doubt if item.in_every_model else ' (one of several possible causes)'
        title = item.effect.title + doubt
        rows: tuple[tuple[str, ...], ...] = ()
        if item.effect.is_physical:
            title += f'  {item.effect.label}'
            rows = tuple((f'    {v.name}', shown(v.value, v.std, v.unit, units).text, v.meaning) for v in item.values)
        tables.append(Table(('',) * 3, ('',) * 3, rows, title=f'  {title}'))
    return tables


def tip_budget(outcome: Outcome, most: int | None = None) -> Table | None:
    """Contributions to the tip where its uncertainty is largest, the largest first; None where it is not determined.

    Args:
        outcome: the result.
        most: so many are listed, the others together; None for all, with the way in which each was found.
    """
    items = sorted(outcome.budget, key=lambda item: -item.tip)
    total = math.hypot(*(item.tip for item in items))
    if not total > 0 or not math.isfinite(total) or not math.isfinite(outcome.tip_uncertainty.worst):
        return None

    def part(size: float, scale: Scale) -> tuple[str, str]:
        return f'{scale.per_si * size:.3g}', _percent((size / total) ** 2)

    if most is None:
        scale = Scale('mm', 1e3)
        full = [(item.title, item.evaluation, _declared(item, PAGE_UNITS), *part(item.tip, scale)) for item in items]
        full.append(('combined standard uncertainty', '', '', *part(total, scale)))
        heading = ('source', 'type', 'declared', 'contribution', 'share of the variance')
        return Table(heading, ('', '', '', 'mm', ''), tuple(full))
    scale = Scale('mm', 1e3) if items[0].tip >= 999.5e-6 else Scale('µm', 1e6)
    units = {**PAGE_UNITS, 'rad': Scale('mrad', 1e3)}
    rows = [(item.title, _declared(item, units), *part(item.tip, scale)) for item in items[:most]]
    if others := items[most:]:
        rows.append((f'{len(others)} others', '', *part(math.hypot(*(item.tip for item in others)), scale)))
    return Table(('tip: source', 'declared', 'contribution', 'share'), ('', '', scale.unit, ''), tuple(rows))


def _declared(item: Item, units: Mapping[str, Scale]) -> str:
    return '' if item.declared is None else shown(item.declared, math.nan, item.unit, units).text


def parameter_budget(outcome: Outcome) -> Table | None:
    """Noise and the largest declared source of each parameter; None where nothing is declared."""
    items = outcome.budget
    declared = [item for item in items if item.label != NOISE]
    if not declared or np.isnan(outcome.final.std).all():
        return None
    rows = []
    for place, name in enumerate(NAMES):
        parts = {item.label: float(item.parameters[place]) for item in items}
        total = math.hypot(*parts.values())
        if not total > 0:
            rows.append((name, NOT_DETERMINED, '', '', '', ''))
            continue
        largest = max(declared, key=lambda item: parts[item.label])
        unit, per_si = PAGE_SCALES[name]
        sizes = f'{total * per_si:.2g}', f'{parts.get(NOISE, 0.0) * per_si:.2g}'
        rows.append((name, *sizes, unit, largest.title, _percent((parts[largest.label] / total) ** 2)))
    heading = ('parameter', 'std. uncertainty', 'by noise', '', 'largest declared source', 'its share of the variance')
    return Table(heading, ('',) * 6, tuple(rows))


def _percent(share: float) -> str:
    return f'{100 * share:.0f} %' if share >= 0.005 or share == 0 else 'below 1 %'


def error_table(compared: Comparison) -> Table:
    """Force and tip, fitted and held out, and chi-square, of the nominal, the base and the extended model."""
    rows: list[tuple[str, ...]] = [('nominal parameters', f'{compared.nominal:.3g}', '', '', '', '')]
    for name, side in (('base model', compared.base), ('extended model', compared.extended)):
        tip = (f'{1e3 * each:.3g}' for each in (side.tip.fitted, side.tip.held_out))
        force = (f'{each:.3g}' for each in (side.force_error, side.held_out))
        rows.append((name, *force, *tip, f'{side.reduced_chi_square:.2f}'))
    heading = ('', 'force error', 'held out', 'tip error', 'held out', 'reduced chi-square')
    return Table(heading, ('', 'N', 'N', 'mm', 'mm', ''), tuple(rows))


def bias_table(compared: Comparison) -> Table:
    """Each parameter by the base and by the extended model, and their difference."""
    rows, levels = [], []
    for bias in compared.biases:
        unit, per_si = PAGE_SCALES[bias.name]
        digits = decimals(bias.std * per_si)
        places = 3 if digits is None else digits

        def text(value: float, std: float, per_si: float = per_si, places: int = places) -> str:
            number = unsigned_zero(f'{value * per_si:.{places}f}').replace('-', '−')
            return f'{number} ± {std * per_si:.{places}f}' if std > 0 and math.isfinite(std) else number

        shift = '' if digits is None else text(bias.shift, 0.0)
        base, extended = text(bias.base, bias.base_std), text(bias.value, math.nan if digits is None else bias.std)
        rows.append((bias.name, base, extended, unit, shift, _signed(bias.in_std)))
        levels.append('bad' if bias.is_significant and abs(bias.in_std) > NOTABLE else '')
    heading = ('parameter', 'base model ± 1 σ', 'extended ± 1 σ', 'unit', 'bias', 'bias [σ]')
    return Table(heading, ('',) * 6, tuple(rows), levels=tuple(levels))


def _signed(value: float) -> str:
    if not math.isfinite(value):
        return ''
    return '0.0' if round(value, 1) == 0 else f'{value:+.1f}'.replace('-', '−')


def candidate_table(d: Diagnosis, items: Iterable[Ranked]) -> Table | None:
    """Candidate effects, those found first, then by their gain; None if there are none."""
    ordered = sorted(items, key=lambda item: (d.role_of(item) not in ('found', 'possible'), -item.gain))
    roles = [d.role_of(item) for item in ordered]
    rows = tuple(
        (
            item.effect.title,
            _signed(item.gain),
            chance(item.p_value) if math.isfinite(item.p_value) else '',
            f'{100 * item.share:.0f} %',
            role,
        )
        for item, role in zip(ordered, roles, strict=True)
    )
    levels = {'found': 'good', 'possible': 'good', 'rival': 'caution'}
    heading = ('effect', 'gain', 'p-value', 'share', '')
    return Table(heading, ('',) * 5, rows, levels=tuple(levels.get(role, '') for role in roles)) if rows else None


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


def limit_table(outcome: Outcome) -> Table | None:
    """By how much a rejected effect, just too small to be detected, could bias a parameter by more than its σ."""
    d, c = outcome.diagnosis, outcome.final
    items = [
        item
        for item in d.ranking
        if d.role_of(item) == 'rejected' and item.undetected_bias > 1.0 and item.effect.is_physical
    ]
    rows = []
    for item in sorted(items, key=lambda item: -item.undetected_bias)[:_LISTED]:
        unit, per_si = PAGE_SCALES[item.biased_parameter]
        bias = item.undetected_bias * c.std_of(item.biased_parameter) * per_si
        size = f'{float(f"{bias:.2g}"):g}' if math.isfinite(bias) else ''
        rows.append((item.effect.title, item.biased_parameter, f'{item.undetected_bias:.1f}', size, unit))
    heading = ('undetected effect', 'parameter', 'bias up to [σ]', 'bias up to', '')
    return Table(heading, ('',) * 5, tuple(rows)) if rows else None


def touch_table(c: Calibration) -> Table:
    """All touches that were fitted."""
    t = c.touches
    force, residual = np.hypot(*c.force.T), np.hypot(*c.residual.T)
    angle = np.degrees(np.arctan2(c.force[:, 1], c.force[:, 0]))
    rows = tuple(
        (
            str(t.index[k]),
            f'{t.time[k]:.1f}',
            c.cell.discs[t.disc[k]].name,
            'left' if t.posture[k] > 0 else 'right',
            f'{force[k]:.2f}',
            unsigned_zero(f'{angle[k]:.1f}').replace('-', '−'),
            f'{residual[k]:.2f}',
            f'{c.standardized[k]:.1f}',
            '' if c.used[k] else 'not used',
        )
        for k in range(len(t))
    )
    heading = ('touch', 'time', 'disc', 'posture', 'force', 'direction', 'residual', 'residual', '')
    levels = tuple('' if used else 'bad' for used in c.used)
    return Table(heading, ('', 's', '', '', 'N', '°', 'N', 'σ', ''), rows, levels=levels)
