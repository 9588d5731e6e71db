"""The outcome in sentences; the terminal and the page say the same."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import special

from scara_kinetostatic.assessment.grade import LIMITS, Grade
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.assessment.tolerance import advice
from scara_kinetostatic.calibration.identifiability import Combination
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.calibration.tip_uncertainty import COVERAGE_FACTOR
from scara_kinetostatic.diagnosis.linear_problem import SIGNIFICANCE
from scara_kinetostatic.diagnosis.result import Diagnosis, Found
from scara_kinetostatic.model.parameters import NAMES, UNITS
from scara_kinetostatic.model.quantity import quantity
from scara_kinetostatic.report import Level, Verdict, sentence
from scara_kinetostatic.report.quantities import SCALES, Scale, count, decimals, p_equals
from scara_kinetostatic.results.tables import base_rank

ANSWERS = {Grade.FIT: 'Fit for use', Grade.CAUTION: 'To be used with caution', Grade.UNFIT: 'Not fit for use'}
"""The grades in words: the first thing in text and page."""
NEVER_IDENTIFIABLE = (
    'An error common to all radii, such as that of the radius of the tip: exactly equivalent to backlash of the '
    'gripper, g_ee.',
    'A displacement of all discs together: equivalent to x0 and y0. A rotation of all discs about the base: nearly '
    'equivalent to theta1.',
    'A gain error of the force sensor: equivalent to one factor on all compliances.',
    'A gripper that is stiffer along link 2 than across it, or bending of link 2: to first order equivalent to other '
    'values of p_ee and p2.',
    'Friction in a transmission that is always approached from the same side: equivalent to backlash.',
)
"""Errors that touches of this kind cannot show, whatever their number, and the parameters they change."""
_DISAGREES = 1e-3
"""P-value of chi-square below which it contradicts a model that the diagnosis finds complete."""
MOST_RIVALS = 4
"""Of a group of rivals so many are named; of the others only the number is given."""
_LEAST_JOINT_NOISE = 1e-6
"""An estimated joint noise below this is not determined: it changes the force by less than a tenth of what sensors
resolve, rad.
"""


def verdict(outcome: Outcome) -> Verdict:
    """The verdict in words."""
    c, d = outcome.final, outcome.diagnosis
    level, headline, sentences = _model(d)
    caveat = ' Do not rely on the standard deviations.' if d.verdict == 'unexplained' else ''
    sentences.append(f'Verdict: {d.verdict}.{caveat}')
    if c is not outcome.calibration and outcome.calibration.termination is not Termination.CONVERGED:
        sentences.append('The fit of the base model did not converge; its values are those of the last iteration.')
    if d.advice:
        sentences.append(sentence(d.advice))
    groups = c.identifiability.confounded
    if groups and level == 'good':
        unchecked = ' nothing checks it:' if c.degrees_of_freedom < LIMITS.least_freedoms else ''
        level = 'caution'
        headline = f'The base model fits, but{unchecked} these data do not determine every parameter'
    if groups:
        sentences.append(sentence(c.identifiability.advice))
    if c.termination is not Termination.CONVERGED:
        level, headline = 'bad', 'The fit did not converge'
        sentences.append(sentence(f'{c.termination.meaning}; {c.termination.remedy}'))
    return Verdict(headline, level, tuple(sentences))


def model_verdict(outcome: Outcome) -> Verdict:
    """The verdict on the model alone: whether it is complete, and what was found; the assessment says the rest."""
    d = outcome.diagnosis
    level, headline, sentences = _model(d)
    advice = [sentence(d.advice)] if d.advice else []
    return Verdict(headline, level, (*sentences, f'Verdict: {d.verdict}.', *advice))


def _model(d: Diagnosis) -> tuple[Level, str, list[str]]:
    """Level, headline and sentences on whether the model is complete."""
    p = p_equals(d.p_value)
    if d.verdict == 'none':
        return 'good', 'The base model explains these touches', [f'No model error detected ({p} for the base model).']
    lack = f'The base model does not explain the touches ({p})'
    if d.p_value >= SIGNIFICANCE:  # noise that was estimated covers the error
        lack = f'The base model explains the touches with more noise than any robot has (with that noise {p})'
    if d.verdict == 'explained':
        headline = f'Model error found and corrected: {"; ".join(item.effect.title for item in d.found)}'
        return 'caution', headline, [f'{lack}; extended by what was found it does: {_names(d.found)}.']
    if d.verdict == 'ambiguous':
        which = '; '.join(group_names(d, group) for group in d.rivals)
        headline = 'Model error found, but these data cannot distinguish its possible causes'
        return 'caution', headline, [f'{lack}. Possible causes: {which}.', *_rivals_in_model(d)]
    if d.extended is None:
        return 'bad', 'Model error found, cause unknown', [f'{lack}.']
    curve = any(item.in_every_model and not item.effect.is_physical for item in d.found)
    rest = 'cause unknown; described by a fitted curve' if curve else 'only partly explained'
    return ('bad', f'Model error found, {rest}', [f'{lack}. {_added(d.found)}', *_rivals_in_model(d)])


def _rivals_in_model(d: Diagnosis) -> list[str]:
    """How rivals enter the extended model."""
    if not d.rivals or d.extended is None:
        return []
    held = {item.effect.label for item in d.found}
    if all(label in held for group in d.rivals for label in group):
        return [
            'The extended model contains all of them, so that the twelve parameters are valid whichever is present; '
            'the values of these effects themselves are not.'
        ]
    return [
        'The extended model contains one or some of them; the standard deviations of the twelve parameters cover the '
        'others as well, those of the effects do not.'
    ]


def _added(found: Sequence[Found]) -> str:
    """What an incomplete model contains: suspicions and fitted curves."""
    possible = [item for item in found if item.is_possible]
    curves = [item for item in found if not item.is_possible]
    suspected = f'Possible, but not proved, and in the model: {_names(possible)}.' if possible else ''
    described = f'Added to the model: {_names(curves)}.' if curves else ''
    return ' '.join(text for text in (suspected, described) if text)


def _names(found: Sequence[Found]) -> str:
    return ', '.join(item.effect.title for item in found)


def group_names(d: Diagnosis, group: Sequence[str]) -> str:
    """Rivals in one phrase, the first ones by name."""
    effects = d.effects_by_label()
    names = [effects[label].title if label in effects else label for label in group[:MOST_RIVALS]]
    if len(group) > MOST_RIVALS:
        names.append(f'one of {len(group) - MOST_RIVALS} more')
    return ' or '.join(names)


def force_errors(outcome: Outcome) -> str:
    """The force error e_f before and after, in the fit and on held-out touches."""
    compared = outcome.comparison
    base, extended, folds = compared.base, compared.extended, outcome.extended_held_out.folds
    if outcome.final is outcome.calibration:
        return (
            f'{compared.nominal:.3g} N with the nominal parameters, {base.force_error:.3g} N calibrated; '
            f'{base.held_out:.3g} N on held-out touches ({folds} folds)'
        )
    return (
        f'{compared.nominal:.3g} N with the nominal parameters, {base.force_error:.3g} N with the base model, '
        f'{extended.force_error:.3g} N with the extended model; on held-out touches ({folds} folds) '
        f'{base.held_out:.3g} N and {extended.held_out:.3g} N'
    )


def tip_errors(outcome: Outcome) -> str:
    """The error of the tip in mm before and after, in the fit and on held-out touches, and that by noise."""
    compared = outcome.comparison
    (a, a_out, _), (e, e_out, noise_alone) = (1e3 * np.array(side.tip) for side in (compared.base, compared.extended))
    expected = f'{noise_alone:.3g} mm is expected from noise'
    if outcome.final is outcome.calibration:
        return f'{a:.3g} mm from the circle of contact (rms), {a_out:.3g} mm on held-out touches; {expected}'
    return (
        f'{a:.3g} mm from the circle of contact (rms) with the base model, {e:.3g} mm with the extended model; on '
        f'held-out touches {a_out:.3g} mm and {e_out:.3g} mm; {expected}'
    )


def bias(outcome: Outcome) -> str:
    """By how much the base model's parameters and tip are biased; empty where no model error was found."""
    if outcome.final is outcome.calibration:
        return ''
    rows = sorted((row for row in outcome.comparison.biases if row.is_significant), key=lambda row: -abs(row.in_std))
    # 3: so many biased parameters are named
    worst = ', '.join(f'{row.name} by {abs(row.in_std):.2g} σ' for row in rows[:3])
    tip = f'the tip by {outcome.comparison.tip_bias * 1e3:.3g} mm (rms over the touches)'
    return f'ignoring it would bias {f"{worst} and " if worst else ""}{tip}'


def fit_quality(outcome: Outcome) -> str:
    """Chi-square in words."""
    c = outcome.final
    freedom = count(c.degrees_of_freedom, 'degree', 'degrees')
    text = f'{c.chi_square:.1f} for {freedom} of freedom; reduced {c.reduced_chi_square:.2f}, expected 1'
    if c.noise_source != 'given' or outcome.diagnosis.remaining_p_value < SIGNIFICANCE:
        return text
    larger, smaller = (float(f(c.degrees_of_freedom, c.chi_square)) for f in (special.chdtrc, special.chdtr))
    if smaller < _DISAGREES:
        return f'{text}: the noise is stated too large; the p-value of the model is that with the noise estimated'
    if larger < _DISAGREES:
        return f'{text} ({p_equals(larger)} by itself; the p-value of the model is corrected for all tests made)'
    return text


def noise(outcome: Outcome) -> str:
    """Noise levels and their source."""
    c = outcome.final
    joint = f'{_by_axis([1e6 * level for level in c.noise.joint_levels])} µrad per joint'
    force = f'{_by_axis(c.noise.force_levels)} N per force component'
    grown = f', in addition {100 * c.noise.growth:.2g} % of the force' if c.noise.growth else ''
    if c.noise_source == 'given':
        return f'{joint} and {force}{grown}, given by the cell description'
    stated = c.cell.noise
    if stated is not None:
        parts = ['the part that grows with the force'] if stated.force_relative is None and grown else []
        pairs = (c.noise.joint, stated.joint), (c.noise.force, stated.force)
        by_axis = any(isinstance(found, tuple) and not isinstance(given, tuple) for found, given in pairs)
        parts += ['the ratio of the axes'] if by_axis else []
        return f'{joint} and {force}{grown}; {" and ".join(parts)} estimated from the residuals, the rest given'
    if c.noise.joint_rms < _LEAST_JOINT_NOISE:
        return f'{force}{grown}, estimated from the residuals; the joint noise is too small to be estimated'
    return f'{joint} and {force}{grown}, estimated from the residuals'


def _by_axis(levels: Sequence[float]) -> str:
    first, second = levels
    return f'{first:.3g}' if first == second else f'{first:.3g} and {second:.3g}'


def identifiability(outcome: Outcome, scales: Mapping[str, Scale] = SCALES) -> list[str]:
    """Which parameters the data determine; the verdict says which touches would determine the others."""
    c, found = outcome.final, outcome.final.identifiability
    free = sum(status != 'fixed' for status in c.status.values())
    known, rank = sum(status == 'estimated' for status in c.status.values()), base_rank(c)
    how_many = f'{known} of {free} free parameters are determined'
    if rank != known:
        how_many += f', {rank} of {free} independent combinations of them'
    lines = [f'{how_many} (condition number {found.condition:.3g}).']
    for group in found.confounded:
        values = 'the value shown is near the nominal one' if len(group) == 1 else 'other values fit as well'
        lines.append(f'Not determined: {_listed(group)}; {values}.')
    return lines + [_combination(item, scales) for item in found.combinations]


def _listed(names: Sequence[str]) -> str:
    """Names in a sentence; all twelve parameters are not listed."""
    if set(NAMES) <= set(names):
        names = ['all twelve parameters', *(name for name in names if name not in NAMES)]
    return ' and '.join(filter(None, [', '.join(names[:-1]), names[-1]]))


def _combination(item: Combination, scales: Mapping[str, Scale]) -> str:
    unit, per_si = scales[item.first]
    sign, of = '-' if item.factor < 0 else '+', _unit_of_ratio(UNITS[item.first], UNITS[item.second])
    value, std = item.value * per_si, item.std * per_si
    digits = decimals(std) or 0
    combination = f'{item.first} {sign} {abs(item.factor):.4g} {of}{item.second}'
    return f'Only the combination {combination} = {value:.{digits}f} ± {std:.{digits}f} {unit} is determined.'


def _unit_of_ratio(unit: str, other: str) -> str:
    """The unit of one parameter per that of another, with the sign of a product; empty where they are the same."""
    if unit == other:
        return ''
    length_or_angle, per, load = other.partition('/')
    if per and length_or_angle == unit:
        return f'{load} · '
    parts = (f'({text})' if '/' in text else text for text in (unit, other))
    return f'{"/".join(parts)} · '


def tip_sentences(outcome: Outcome) -> list[str]:
    """How uncertain the tip is, what dominates, and what would help most."""
    tip = outcome.tip_uncertainty
    if tip.at is None or not math.isfinite(tip.worst):
        return ['The uncertainty of the tip is not determined by these touches.']
    largest = max(outcome.budget, key=lambda item: item.tip)
    share = largest.tip**2 / sum(item.tip**2 for item in outcome.budget)
    at = f'x {tip.at.tip[0]:.2f} m, y {tip.at.tip[1]:.2f} m'
    sizes = f'at most {quantity(tip.worst, "m")}, at {at}, median {quantity(tip.median, "m")}.'
    help_most = advice(outcome)
    part = f'{100 * share:.0f} %' if share >= 0.005 else 'below 1 %'
    found = [
        f'Expanded uncertainty of the tip (k = {COVERAGE_FACTOR:g}) over the workspace: {sizes}',
        f'Largest contribution there: {largest.title}, {part} of the variance.',
    ]
    return [*found, f'What would help most: {help_most}.'] if help_most else found
