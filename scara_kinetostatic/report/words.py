"""What an outcome means, in plain words; the terminal and the page say the same."""

from __future__ import annotations

from typing import NamedTuple

from scara_kinetostatic.calibration.identifiability import Combination
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.pipeline import Outcome
from scara_kinetostatic.report.quantities import SCALES, chance, count, decimals


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
UNSEEN_JOINT_NOISE = 1e-6
"""An estimate below this is none: it moves the force by less than a tenth of what sensors resolve, rad."""


def verdict(outcome: Outcome) -> Verdict:
    """The verdict in words."""
    level, headline, first = _fit(outcome)
    c, d = outcome.calibration, outcome.diagnosis
    sentences = [first]
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


def _fit(outcome: Outcome) -> tuple[str, str, str]:
    d = outcome.diagnosis
    p = f'p = {chance(d.p_value)}'
    if d.verdict == 'none':
        text = f'Nothing is left in the residuals that these touches could show beyond noise ({p}).'
        return 'good', 'The twelve-parameter model explains these touches', text
    if d.verdict == 'explained':
        names = ', '.join(item.effect.label for item in d.found)
        text = f'The twelve parameters alone do not explain the touches ({p}); with {names} added they do.'
        return 'caution', 'Something beyond the twelve parameters was found, and explains the rest', text
    if d.verdict == 'ambiguous':
        rivals = '; '.join(' or '.join(group) for group in d.rivals)
        text = f'The twelve parameters do not explain the touches ({p}); these data cannot say what does: {rivals}.'
        return 'caution', 'Something is missing in the model, and it could be one of several things', text
    text = f'The twelve parameters do not explain the touches ({p}).'
    return 'bad', 'Something is left that the model does not describe', text


def force_errors(outcome: Outcome) -> str:
    """e_f before, after, and on touches not used."""
    c, h = outcome.calibration, outcome.held_out
    return (
        f'{c.force_error_nominal:.3g} N with the nominal parameters, {c.force_error:.3g} N calibrated, '
        f'{h.force_error:.3g} N on touches left out of the fit ({h.folds} folds)'
    )


def fit_quality(outcome: Outcome) -> str:
    """Chi-square in words."""
    c = outcome.calibration
    return (
        f'{c.chi_square:.1f} over {count(c.degrees_of_freedom, "degree", "degrees")} of freedom, '
        f'{c.reduced_chi_square:.2f} each; 1 where model and noise are right'
    )


def noise(outcome: Outcome) -> str:
    """Noise levels and where they come from."""
    c = outcome.calibration
    force = f'{c.noise.force:.3g} N per force component'
    if c.noise_source == 'given':
        return f'{c.noise.joint * 1e6:.3g} µrad per joint and {force}, as the cell description gives them'
    if c.noise.joint < UNSEEN_JOINT_NOISE:
        return f'{force}, estimated from the residuals; that of the joints does not show beside it'
    return f'{c.noise.joint * 1e6:.3g} µrad per joint and {force}, estimated from the residuals'


def identifiability(outcome: Outcome) -> list[str]:
    """What the data determine and what not; what would cure it is said in the verdict."""
    c, found = outcome.calibration, outcome.calibration.identifiability
    free = sum(status != 'fixed' for status in c.status.values())
    lines = [f'{found.rank} of {free} free parameters are determined (condition number {found.condition:.3g}).']
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
