"""What the page says of what the model lacks: effects, scores, errors, bent parameters, what is open."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from scara_kinetostatic.diagnosis.comparison import Bias, Comparison, Side
from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Ranked
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.render.quantities import SCALES, chance, decimals, p_equals, shown
from scara_kinetostatic.report import messages as words
from scara_kinetostatic.report.diagnosis_document import role
from scara_kinetostatic.report.effect_pictures import bias_picture, residual_picture

MOST_PICTURES = 3
MOST_CURVES = 3
"""Of the fitted curves that were refuted, so many are listed."""
WORTH_A_WARNING = 1.0
"""An effect that could have bent a parameter by so many standard deviations unseen is named."""
MOST_HIDDEN = 8
LEANING = (
    'Every force leans by an angle of its own, which nothing predicts: the extended model expects the scatter, it does '
    'not remove it. Where it predicts a force, the lean is read off the measured one, so that its force error is what '
    'is left along the force.'
)
"""Said of an effect that scatters."""


class EffectEntry(NamedTuple):
    """One effect of the extended model: name, proved or not, values and a note in words, picture or None."""

    name: str
    in_every_model: bool
    values: list[tuple[str, str, str]]
    note: str
    picture: Any


class CandidateRow(NamedTuple):
    """One row of the table of candidates, ready to print."""

    name: str
    role: str
    gain: str
    held_out: str
    p_value: str
    share: str
    bar: float


def diagnosis_context(outcome: Outcome) -> dict[str, Any]:
    """What the template `diagnosis.html.j2` needs; to be called within `drawing.style`."""
    d, compared = outcome.diagnosis, outcome.comparison
    extended = outcome.final is not outcome.calibration
    rows, table = compared.biases, _candidates(d)
    return {
        'd': d,
        'p_value': p_equals(d.p_value),
        'remaining_p_value': p_equals(d.remaining_p_value),
        'is_extended': extended,
        'effects': _entries(outcome) if extended else [],
        'candidates': [row for row in table if row.role != 'refuted'],
        'refuted': [row for row in table if row.role == 'refuted'],
        'more_curves': _more_curves(d),
        'errors': _errors(compared, extended),
        'tip_noise': _mm(compared.extended.tip.noise),
        'moved': _mm(compared.moved),
        'moved_most': _mm(compared.moved_most),
        'bends': [_bias(row) for row in rows] if extended else [],
        'bend_picture': bias_picture(rows) if extended else None,
        'rivals': [[_name(d, label) for label in group] for group in d.rivals],
        'unseen': [
            (item.effect.label, item.effect.confounded_with, item.effect.identified_by)
            for item in d.ranking
            if item.role == 'unseen' and not isinstance(item.effect, Unnamed)
        ],
        'hidden_bends': _undetected_biases(d),
        'tested': len(catalogue(outcome.calibration.cell)),
        'traces': [(t.name, chance(t.p_value), f'{100 * t.share:.0f} %') for t in d.dependences],
        'remaining': [(t.name, chance(t.p_value), f'{100 * t.share:.0f} %') for t in d.remaining],
    }


def _name(d: Diagnosis, label: str) -> str:
    return words.group_names(d, [label])


def _entries(outcome: Outcome) -> list[EffectEntry]:
    entries = []
    for number, item in enumerate(outcome.diagnosis.found):
        titles = ('without it', 'with it') if item.in_every_model else ('without the rivals', 'with all rivals')
        drawn = number < MOST_PICTURES
        picture = residual_picture(outcome.effect_residuals[number], f'effect{number}', titles) if drawn else None
        note = LEANING if item.effect.off_normal_std else ''
        entries.append(EffectEntry(words.effect_name(item.effect), item.in_every_model, _values(item), note, picture))
    return entries


def _values(item: Found) -> list[tuple[str, str, str]]:
    """Name, value and meaning of each parameter; the coefficients of a fitted curve say nothing by themselves."""
    if isinstance(item.effect, Unnamed):
        return []
    return [(v.name, shown(v.value, v.std, v.unit).text.replace('-', '−', 1), v.meaning) for v in item.values]


def _candidates(d: Diagnosis) -> list[CandidateRow]:
    """All that can show, the best first; of refuted curves without a name only the first ones."""
    roles = {item.effect.label: role(d, item) for item in d.ranking}
    largest = max([1.0, *(item.gain for item in d.ranking if math.isfinite(item.gain))])
    chosen, curves = [], 0
    for item in sorted((item for item in d.ranking if item.role != 'unseen'), key=lambda item: -item.gain):
        refuted = roles[item.effect.label] == 'refuted'
        curves += refuted and isinstance(item.effect, Unnamed)
        if refuted and isinstance(item.effect, Unnamed) and curves > MOST_CURVES:
            continue
        chosen.append(item)
    chosen.sort(key=lambda item: roles[item.effect.label] != 'found')
    return [_candidate(item, roles[item.effect.label], largest) for item in chosen]


def _candidate(item: Ranked, role: str, largest: float) -> CandidateRow:
    return CandidateRow(
        name=words.effect_name(item.effect),
        role=role,
        gain=_signed(item.gain),
        held_out=_signed(item.held_out),
        p_value=chance(item.p_value) if math.isfinite(item.p_value) else '',
        share=f'{100 * item.share:.0f} %',
        bar=round(100 * min(max(item.gain, 0.0) / largest, 1.0), 1),
    )


def _more_curves(d: Diagnosis) -> int:
    """How many refuted curves are not listed."""
    curves = sum(role(d, item) == 'refuted' and isinstance(item.effect, Unnamed) for item in d.ranking)
    return max(0, curves - MOST_CURVES)


def _signed(value: float) -> str:
    return f'{value:+.1f}'.replace('-', '−') if math.isfinite(value) else ''


def _mm(metres: float) -> str:
    return f'{1e3 * metres:.3g}'


def _errors(compared: Comparison, extended: bool) -> list[tuple[str, list[str]]]:
    """The rows of the table of errors: force and tip, fitted and held out, and chi-square."""
    rows = [('nominal parameters', [f'{compared.nominal:.3g}', '', '', '', ''])]
    rows.append(('the twelve parameters alone', _side(compared.alone)))
    if extended:
        rows.append(('the extended model', _side(compared.extended)))
    return rows


def _side(side: Side) -> list[str]:
    return [
        f'{side.force_error:.3g}',
        f'{side.held_out:.3g}',
        _mm(side.tip.fitted),
        _mm(side.tip.held_out),
        f'{side.reduced_chi_square:.2f}',
    ]


def _bias(row: Bias) -> dict[str, str]:
    unit, per_si = SCALES[row.name]
    digits = decimals(row.std * per_si)
    places = 3 if digits is None else digits
    known = digits is not None

    def text(value: float) -> str:
        return f'{value * per_si:.{places}f}'.replace('-', '−')

    return {
        'name': row.name,
        'alone': text(row.alone),
        'alone_std': text(row.alone_std) if row.alone_std > 0 else '',
        'value': text(row.value),
        'std': text(row.std) if known else '',
        'shift': text(row.shift) if known else '',
        'in_std': _signed(row.in_std),
        'unit': unit,
        'notable': 'lost' if row.sure and abs(row.in_std) > 2 else '',
    }


def _undetected_biases(d: Diagnosis) -> list[tuple[str, str, str]]:
    """Effects that could have bent a parameter without being found: name, by how many σ, which."""
    rows = [
        item
        for item in d.ranking
        if role(d, item) == 'refuted'
        and item.undetected_bias > WORTH_A_WARNING
        and not isinstance(item.effect, Unnamed)
    ]
    rows.sort(key=lambda item: -item.undetected_bias)
    return [(item.effect.label, f'{item.undetected_bias:.1f}', item.biased_parameter) for item in rows[:MOST_HIDDEN]]
