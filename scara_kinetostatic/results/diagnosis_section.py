"""The section of the page on model errors: effects, errors before and after, biases, candidates, limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.diagnosis.comparison import Bias, Comparison, ModelErrors
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.report.quantities import (
    PAGE_SCALES,
    PAGE_UNITS,
    chance,
    decimals,
    p_equals,
    shown,
    unsigned_zero,
)
from scara_kinetostatic.report.table import Table
from scara_kinetostatic.results import messages
from scara_kinetostatic.results.effect_figures import NOTABLE, bias_picture, residual_picture

_MOST_PICTURES = 3
"""So many effects are drawn."""
_MOST_CANDIDATES = 8
"""So many candidates are listed openly, the others folded."""
_MOST_CURVES = 3
"""Of the fitted curves that were rejected, so many are listed."""
_MOST_DEPENDENCES = 8
"""So many dependences of the residual are listed."""
_MOST_LIMITS = 8
"""So many detection limits are listed."""
_LEAST_LIMIT = 1.0
"""A detection limit is listed where an undetected effect could bias a parameter by so many standard deviations."""
_OFF_NORMAL = (
    'The force of each touch is off the normal by an angle of its own, which no model predicts: the extended model '
    'includes this scatter in the weights, it does not remove it. Where it predicts a force, the angle is taken from '
    'the measured one, so that its force error is the part along the force.'
)
"""Note to an effect that scatters."""


class _EffectEntry(NamedTuple):
    """One effect of the extended model.

    Attributes:
        name: its title.
        label: as in the files; empty of a fitted curve.
        tag: what is said beside the name of one that is not proved; empty for one that is found.
        values: name, value and meaning of each parameter.
        note: in words; empty if none.
        picture: its residual before and after; None if it is not drawn.
    """

    name: str
    label: str
    tag: str
    values: list[tuple[str, str, str]]
    note: str
    picture: Any


class _CandidateRow(NamedTuple):
    """One row of the table of candidates, ready to print; `bar` is the gain in per cent of the largest."""

    name: str
    role: str
    gain: str
    held_out: str
    p_value: str
    share: str
    bar: float


def diagnosis_context(outcome: Outcome) -> dict[str, Any]:
    """The variables of the template `diagnosis_section.html.j2`; to be called within `report.figure.style`."""
    d, compared = outcome.diagnosis, outcome.comparison
    extended = outcome.final is not outcome.calibration
    table = _candidates(d)
    open_rows = [row for row in table if row.role != 'rejected']
    return {
        'd': d,
        'p_value': p_equals(d.p_value),
        'remaining_p_value': p_equals(d.remaining_p_value),
        'is_extended': extended,
        'effects': _entries(outcome) if extended else [],
        'candidates': open_rows[:_MOST_CANDIDATES],
        'more_candidates': open_rows[_MOST_CANDIDATES:],
        'rejected': [row for row in table if row.role == 'rejected'],
        'more_curves': _more_curves(d),
        'errors': _errors(compared, extended),
        'tip_noise': _mm(compared.extended.tip.noise),
        'moved': _mm(compared.tip_bias),
        'moved_most': _mm(compared.largest_tip_bias),
        'biases': [_bias(row) for row in compared.biases] if extended else [],
        'bias_picture': bias_picture(compared.biases) if extended else None,
        'rivals': [[messages.group_names(d, [label]) for label in group] for group in d.rivals],
        'unidentifiable': _unidentifiable(d),
        'limits': _detection_limits(outcome),
        'tested': len(catalogue(outcome.calibration.cell)),
        'dependences': _dependences(d.dependences),
        'remaining': _dependences(d.remaining),
    }


def _entries(outcome: Outcome) -> list[_EffectEntry]:
    entries = []
    for number, item in enumerate(outcome.diagnosis.found):
        titles = ('without it', 'with it') if item.in_every_model else ('without the rivals', 'with all rivals')
        drawn = number < _MOST_PICTURES
        picture = residual_picture(outcome.effect_residuals[number], f'effect{number}', titles) if drawn else None
        note = _OFF_NORMAL if item.effect.off_normal_std else ''
        label = item.effect.label if item.effect.is_physical else ''
        tag = 'possible, not proved' if item.is_possible else ''
        tag = tag if item.in_every_model else 'one of several possible causes'
        entries.append(_EffectEntry(item.effect.title, label, tag, _values(item), note, picture))
    return entries


def _values(item: Found) -> list[tuple[str, str, str]]:
    """Name, value and meaning of each parameter; none of a fitted curve, whose coefficients have no meaning."""
    if not item.effect.is_physical:
        return []
    return [
        (v.name, shown(v.value, v.std, v.unit, PAGE_UNITS).text.replace('-', '−', 1), v.meaning) for v in item.values
    ]


def _candidates(d: Diagnosis) -> list[_CandidateRow]:
    """All identifiable candidates, those found first, then by their gain; of rejected curves only the first ones."""
    largest = max([1.0, *(item.gain for item in d.ranking if math.isfinite(item.gain))])
    chosen, curves = [], 0
    for item in sorted((item for item in d.ranking if item.role != 'unidentifiable'), key=lambda item: -item.gain):
        curve = _is_rejected_curve(d, item)
        curves += curve
        if not curve or curves <= _MOST_CURVES:
            chosen.append(item)
    chosen.sort(key=lambda item: d.role_of(item) not in ('found', 'possible'))
    return [_candidate(item, d.role_of(item), largest) for item in chosen]


def _candidate(item: Ranked, role: str, largest: float) -> _CandidateRow:
    return _CandidateRow(
        name=item.effect.title,
        role=role,
        gain=_signed(item.gain),
        held_out=_signed(item.held_out),
        p_value=chance(item.p_value) if math.isfinite(item.p_value) else '',
        share=f'{100 * item.share:.0f} %',
        bar=round(100 * min(max(item.gain, 0.0) / largest, 1.0), 1),
    )


def _is_rejected_curve(d: Diagnosis, item: Ranked) -> bool:
    return d.role_of(item) == 'rejected' and not item.effect.is_physical


def _more_curves(d: Diagnosis) -> int:
    """How many rejected curves are not listed."""
    return max(0, sum(_is_rejected_curve(d, item) for item in d.ranking) - _MOST_CURVES)


def _signed(value: float) -> str:
    if not math.isfinite(value):
        return ''
    return '0.0' if round(value, 1) == 0 else f'{value:+.1f}'.replace('-', '−')


def _mm(metres: float) -> str:
    return f'{1e3 * metres:.3g}'


def _errors(compared: Comparison, extended: bool) -> Table:
    """Force and tip, fitted and held out, and chi-square, of the nominal, the base and the extended model."""
    heading = ('', 'force error', 'held out', 'tip error', 'held out', 'reduced chi-square')
    rows = [('nominal parameters', f'{compared.nominal:.3g}', '', '', '', '')]
    rows.append(('base model', *_side(compared.base)))
    rows += [('extended model', *_side(compared.extended))] if extended else []
    return Table(heading, ('', 'N', 'N', 'mm', 'mm', ''), tuple(rows))


def _side(side: ModelErrors) -> tuple[str, str, str, str, str]:
    return (
        f'{side.force_error:.3g}',
        f'{side.held_out:.3g}',
        _mm(side.tip.fitted),
        _mm(side.tip.held_out),
        f'{side.reduced_chi_square:.2f}',
    )


def _bias(row: Bias) -> dict[str, str]:
    unit, per_si = PAGE_SCALES[row.name]
    digits = decimals(row.std * per_si)
    places = 3 if digits is None else digits
    known = digits is not None

    def text(value: float) -> str:
        return unsigned_zero(f'{value * per_si:.{places}f}').replace('-', '−')

    return {
        'name': row.name,
        'base': text(row.base),
        'base_std': text(row.base_std) if row.base_std > 0 else '',
        'value': text(row.value),
        'std': text(row.std) if known else '',
        'bias': text(row.shift) if known else '',
        'in_std': _signed(row.in_std),
        'unit': unit,
        'notable': 'lost' if row.is_significant and abs(row.in_std) > NOTABLE else '',
    }


def _dependences(found: Sequence[Dependence]) -> Table | None:
    """What a residual depends on, the most significant first; None if on nothing."""
    rows = [(each.name, chance(each.p_value), f'{100 * each.share:.0f} %') for each in found[:_MOST_DEPENDENCES]]
    if len(found) > _MOST_DEPENDENCES:
        rows.append((f'and {len(found) - _MOST_DEPENDENCES} more, in calibration.json', '', ''))
    return Table(('the residual depends on', 'p-value', 'share'), ('',) * 3, tuple(rows)) if rows else None


def _unidentifiable(d: Diagnosis) -> Table | None:
    """The physical effects that these touches cannot show at all; None if there are none."""
    effects = [item.effect for item in d.ranking if item.role == 'unidentifiable' and item.effect.is_physical]
    rows = tuple((effect.title, effect.confounded_with, effect.identified_by) for effect in effects)
    return Table(('effect', 'confounded with', 'identified by'), ('',) * 3, rows) if rows else None


def _detection_limits(outcome: Outcome) -> Table | None:
    """By how much a rejected effect, just too small to be detected, could bias a parameter; the largest first."""
    d, c = outcome.diagnosis, outcome.final
    items = [
        item
        for item in d.ranking
        if d.role_of(item) == 'rejected' and item.undetected_bias > _LEAST_LIMIT and item.effect.is_physical
    ]
    items.sort(key=lambda item: -item.undetected_bias)
    rows = []
    for item in items[:_MOST_LIMITS]:
        unit, per_si = PAGE_SCALES[item.biased_parameter]
        bias = item.undetected_bias * c.std_of(item.biased_parameter) * per_si
        size = f'{float(f"{bias:.2g}"):g}' if math.isfinite(bias) else ''
        rows.append((item.effect.title, item.biased_parameter, f'{item.undetected_bias:.1f}', size, unit))
    heading = ('undetected effect', 'parameter', 'bias up to [σ]', 'bias up to', '')
    return Table(heading, ('',) * 5, tuple(rows)) if rows else None
