"""What an outcome means, in plain words; the terminal and the page say the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.calibration.identifiability import Combination
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.render.quantities import SCALES, count, decimals, p_equals
from scara_kinetostatic.report.diagnosis_document import known_effects
from scara_kinetostatic.report.parameter_rows import base_rank


class Verdict(NamedTuple):
    """The answer to "may I use these numbers?".

    Attributes:
        level: ``good``, ``caution`` or ``bad``.
        headline: a few words.
        sentences: what stands behind it.
    """

    level: str
    headline: str
    sentences: tuple[str, ...]


HIDDEN = (
    'An error common to all radii, the radius of the tip for instance: it is, exactly, backlash of the gripper, g_ee.',
    'All discs displaced together: that is x0 and y0. Turned together about the base, it is close to theta1.',
    'A wrong gain of the force sensor: it scales all three compliances by one factor.',
    'A gripper stiffer along link 2 than across it, or a link 2 that bends: to first order, another p_ee and p2.',
    'Friction in a transmission that comes to every touch from the same side: it looks like backlash.',
)
"""What no set of such touches can show, whatever their number."""
MOST_RIVALS = 4
"""Of so many rivals the names are told; of the others how many there are."""
UNSEEN_JOINT_NOISE = 1e-6
"""An estimate below this is none: it moves the force by less than a tenth of what sensors resolve, rad."""


def verdict(outcome: Outcome) -> Verdict:
    """The verdict in words."""
    level, headline, sentences = _fit(outcome)
    c, d = outcome.final, outcome.diagnosis
    if c is not outcome.calibration and outcome.calibration.termination is not Termination.CONVERGED:
        sentences.append('The fit of the twelve alone does not settle; what is said of it is where it ended.')
    if d.advice:
        sentences.append(sentence(d.advice))
    groups = c.identifiability.confounded
    if groups and level == 'good':
        level, headline = 'caution', 'The fit is sound, but these data do not determine every parameter'
    if groups:
        sentences.append(sentence(c.identifiability.advice))
    if c.termination is not Termination.CONVERGED:
        level, headline = 'bad', 'The fit did not converge'
        sentences.append(sentence(c.termination.advice))
    return Verdict(level, headline, tuple(sentences))


def _fit(outcome: Outcome) -> tuple[str, str, list[str]]:
    d = outcome.diagnosis
    p = p_equals(d.p_value)
    if d.verdict == 'none':
        text = f'Nothing is left in the residuals that these touches could show beyond noise ({p}).'
        return 'good', 'The twelve-parameter model explains these touches', [text]
    first = f'The twelve parameters alone do not explain the touches ({p})'
    if d.verdict == 'explained':
        text = f'{first}; with {effect_names(d)} added they do.'
        return 'caution', 'Something beyond the twelve parameters was found, and explains the rest', [text]
    if d.verdict == 'ambiguous':
        which = '; '.join(group_names(d, group) for group in d.rivals)
        headline = 'Something is missing in the model, and it could be one of several things'
        return 'caution', headline, [f'{first}; these data cannot say what does: {which}.', *_union(d)]
    headline = 'Something is left that the model does not describe'
    if d.extended is None:
        return 'bad', headline, [f'{first}.']
    return 'bad', headline, [f'{first}. Added to the model: {effect_names(d)}.', *_union(d)]


def _union(d: Diagnosis) -> list[str]:
    """What rivals do in the extended model."""
    if not d.rivals or d.extended is None:
        return []
    held = {item.effect.label for item in d.found}
    if all(label in held for group in d.rivals for label in group):
        return [
            'The extended model holds the rivals together, so that the twelve parameters are right whichever it is; '
            'the values of the rivals themselves are not.'
        ]
    return [
        'The extended model holds one rival, or some of them; the standard deviations of the twelve parameters are '
        'widened so that they cover the others, those of the rivals themselves are not.'
    ]


def effect_names(d: Diagnosis) -> str:
    """The effects in the extended model, in one phrase."""
    return ', '.join(effect_name(item.effect) for item in d.found)


def effect_name(effect: Effect) -> str:
    """The label, or what deviates over what where there is no name."""
    return f'a fitted curve ({effect.description})' if isinstance(effect, Unnamed) else effect.label


def group_names(d: Diagnosis, group: Sequence[str]) -> str:
    """Rivals in one phrase, the first ones by name."""
    known = known_effects(d)
    names = [effect_name(known[label]) if label in known else label for label in group[:MOST_RIVALS]]
    if len(group) > MOST_RIVALS:
        names.append(f'one of {len(group) - MOST_RIVALS} more')
    return ' or '.join(names)


def force_errors(outcome: Outcome) -> str:
    """e_f before, after, and on touches not used."""
    compared = outcome.comparison
    alone, extended, folds = compared.alone, compared.extended, outcome.extended_held_out.folds
    if outcome.final is outcome.calibration:
        return (
            f'{compared.nominal:.3g} N with the nominal parameters, {alone.force_error:.3g} N calibrated, '
            f'{alone.held_out:.3g} N on touches left out of the fit ({folds} folds)'
        )
    return (
        f'{compared.nominal:.3g} N with the nominal parameters, {alone.force_error:.3g} N with the twelve alone, '
        f'{extended.force_error:.3g} N extended; on touches left out of the fit ({folds} folds) '
        f'{alone.held_out:.3g} N and {extended.held_out:.3g} N'
    )


def tip_errors(outcome: Outcome) -> str:
    """The error of the tip in mm, before and after, on touches not used, and what noise alone gives."""
    compared = outcome.comparison
    (a, a_out, _), (e, e_out, noise_alone) = (1e3 * np.array(side.tip) for side in compared[1:3])
    noise_text = f'noise alone gives {noise_alone:.3g} mm'
    if outcome.final is outcome.calibration:
        return f'{a:.3g} mm from the circle it touches, {a_out:.3g} mm on touches left out; {noise_text}'
    return (
        f'{a:.3g} mm from the circle it touches with the twelve alone, {e:.3g} mm extended; on touches left out '
        f'{a_out:.3g} mm and {e_out:.3g} mm; {noise_text}'
    )


def bent(outcome: Outcome) -> str:
    """How far what was missing had bent the twelve; empty where nothing was found."""
    if outcome.final is outcome.calibration:
        return ''
    rows = sorted((row for row in outcome.comparison.biases if row.sure), key=lambda row: -abs(row.in_std))
    worst = ', '.join(f'{row.name} by {abs(row.in_std):.2g} σ' for row in rows[:3])
    moved = outcome.comparison.moved * 1e3
    return f'without it {worst or "nothing"} off; the tip H(L̄, Q) by {moved:.3g} mm (rms over the touches)'


def fit_quality(outcome: Outcome) -> str:
    """Chi-square in words."""
    c = outcome.final
    return (
        f'{c.chi_square:.1f} over {count(c.degrees_of_freedom, "degree", "degrees")} of freedom, '
        f'{c.reduced_chi_square:.2f} each; 1 where model and noise are right'
    )


def noise(outcome: Outcome) -> str:
    """Noise levels and where they come from."""
    c = outcome.final
    force = f'{c.noise.force:.3g} N per force component'
    if c.noise_source == 'given':
        return f'{c.noise.joint * 1e6:.3g} µrad per joint and {force}, as the cell description gives them'
    if c.noise.joint < UNSEEN_JOINT_NOISE:
        return f'{force}, estimated from the residuals; that of the joints does not show beside it'
    return f'{c.noise.joint * 1e6:.3g} µrad per joint and {force}, estimated from the residuals'


def identifiability(outcome: Outcome) -> list[str]:
    """What the data determine and what not; what would cure it is said in the verdict."""
    c, found = outcome.final, outcome.final.identifiability
    free = sum(status != 'fixed' for status in c.status.values())
    lines = [f'{base_rank(c)} of {free} free parameters are determined (condition number {found.condition:.3g}).']
    for group in found.confounded:
        what = 'stays near the nominal one' if len(group) == 1 else 'is one choice of many'
        lines.append(f'Not determined: {" and ".join(group)}; what is shown {what}.')
    return lines + [_combination(item) for item in found.combinations]


def _combination(item: Combination) -> str:
    unit, per_si = SCALES[item.text.split()[0]]
    value, std = item.value * per_si, item.std * per_si
    digits = decimals(std) or 0
    return f'Determined all the same: {item.text} = {value:.{digits}f} ± {std:.{digits}f} {unit} (factors in SI units).'


def sentence(text: str) -> str:
    """With a capital (unless it starts with a name) and a full stop."""
    text = text.strip()
    first = text.split(' ', 1)[0]
    if first.isalpha() and first.islower():
        text = text[0].upper() + text[1:]
    return text if text.endswith('.') else f'{text}.'
