"""What a diagnosis means and what to do next, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.diagnosis.deciding import Deciding
from scara_kinetostatic.diagnosis.result import Found, Ranked
from scara_kinetostatic.diagnosis.structure import Trace
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import Unnamed

LARGEST_JOINT_NOISE = 2e-4
"""Estimated repeatability of a joint beyond which it is an error of the model, rad."""
GROWING = 1e-3
"""P-value below which it is said that the noise grows with the force."""
LARGE_BEND = 5.0
"""Standard deviations by which an effect that is not found may bend one of the twelve before it is said."""
FEW = 4
LARGEST_ERROR_SHARE = 0.2
"""The same for the force error as a part of the force."""


def incredible(c: Calibration) -> str:
    """Why estimated noise cannot be noise; empty if it can. A gross error of the model passes for noise otherwise."""
    if c.noise_source == 'given':
        return ''
    share = c.force_error / float(np.hypot(c.force[:, 0], c.force[:, 1]).mean())
    if c.noise.joint <= LARGEST_JOINT_NOISE and share <= LARGEST_ERROR_SHARE:
        return ''
    return (
        f'the touches miss the model by {c.force_error:.2g} N, {100 * share:.0f} % of the force, as if the joints '
        f'repeated to {c.noise.joint:.1e} rad only: no noise is like that; check the places and radii of '
        'the discs, the fixed parameters, and whether a joint lost its zero'
    )


def unexplained(c: Calibration, found: Sequence[Trace]) -> str:
    """Where the twelve parameters are not enough and nothing was found to add."""
    if not found:
        return (
            f'the residuals are {c.reduced_chi_square**0.5:.2g} times as large as the stated noise, without a pattern: '
            'the noise is stated too small, or touches repeat worse than assumed; '
            'leave the noise out of the cell file to have it estimated'
        )
    names = '; '.join(trace.name for trace in found[:3])
    return (
        f'the residual depends on {names}: the robot does something that the twelve parameters do not describe, '
        'and they are bent by it; do not trust them to their standard deviations'
    )


def hint(p_value: float, found: Sequence[Trace]) -> str:
    """Where the residual shows a trace that no effect explains well enough to be believed."""
    over = f' over {found[0].name}' if found else ''
    return (
        f'a hint of structure{over} (p = {p_value:.1g}), and nothing that explains it well enough to be believed; '
        'more touches would show whether it is there'
    )


def not_excluded(ranking: Sequence[Ranked]) -> str:
    """What "nothing is missing" does not exclude: effects just too small to be found that would bend the twelve."""
    named = [item for item in ranking if item.hidden_bend > LARGE_BEND and not isinstance(item.effect, Unnamed)]
    if not named:
        return ''
    worst = max(named, key=lambda item: item.hidden_bend)
    others = f'; {len(named) - 1} other effects some parameter by more than {LARGE_BEND:g}' if len(named) > 1 else ''
    return (
        f'not excluded: {worst.effect.label}, just too small to be found in these touches, could bend {worst.bent} by '
        f'{worst.hidden_bend:.0f} standard deviations{others}'
    )


def held(c: Calibration) -> str:
    """What to say where some of the twelve were held at given values."""
    if not c.fixed:
        return ''
    names = ', '.join(c.fixed)
    return f'held at given values: {names}; a wrong value shows as an effect that is not there, so fit it as well'


def growing_noise(p_value: float) -> str:
    """What to say where the scatter of the force is not the same at all forces."""
    if p_value >= GROWING:
        return ''
    return (
        f'the scatter of the force grows with the force (p = {p_value:.1g}), and all tests take it for the same: '
        'structure over the size of the force may be no more than that'
    )


def too_quiet(c: Calibration) -> str:
    """Where the residuals are smaller than the stated noise."""
    if c.noise_source == 'given' and special.chdtr(c.degrees_of_freedom, c.chi_square) < 1e-3:
        return (
            f'the residuals are {c.reduced_chi_square**0.5:.2g} times the stated noise: it is stated too large, and so '
            'are the standard deviations of the twelve alone; what was looked for beyond them was looked for with the '
            'noise that the touches show. Leave the noise out of the cell file to have it estimated'
        )
    return ''


def joined(*texts: str) -> str:
    """Sentences, as one text; it begins small, as it does where there is one only."""
    first, *others = [text for text in texts if text] or ['']
    return '. '.join([first, *(text[0].upper() + text[1:] for text in others)])


def _few(labels: Sequence[str]) -> str:
    """The first few of many, in words."""
    left = len(labels) - FEW
    parts = [*labels[:FEW], *([f'{left} other{"s" if left > 1 else ""}'] if left > 0 else [])]
    return f'{", ".join(parts[:-1])} and {parts[-1]}' if len(parts) > 1 else parts[0]


def after_search(
    verdict: str,
    found: Sequence[Found],
    rivals: Sequence[Sequence[str]],
    remaining: Sequence[Trace],
    known: Sequence[Effect],
    deciding: Sequence[Deciding] | None = None,
) -> str:
    """What remains open once the model has been extended."""
    by_label = {effect.label: effect for effect in known}
    sentences = []
    for group in rivals:
        apart = f'these touches cannot tell {_few(group)} apart'
        reveals = dict.fromkeys(by_label[label].reveal for label in group[:FEW] if label in by_label)
        sentences.append(f'{apart}; to decide, record {"; or ".join(reveals)}' if deciding != () else apart)
    if deciding:
        sentences.append(
            f'where they differ most: {"; ".join(map(str, deciding))}; repeat such touches until they decide'
        )
    elif deciding is not None:
        sentences.append('no touch of these discs would do it; measure one of the rivals by other means, and hold it')
    for item in found:
        if isinstance(item.effect, Unnamed):
            sentences.append(
                f'no effect of the list explains what is left: {item.effect.description}; it is corrected by a fitted '
                f'curve. To learn what it is, record {item.effect.reveal}'
            )
    if verdict == 'unexplained' and remaining:
        names = '; '.join(trace.name for trace in remaining[:3])
        sentences.append(f'something is left even so: the residual depends on {names}')
    elif verdict == 'unexplained' and not any(isinstance(item.effect, Unnamed) for item in found):
        sentences.append('the residuals stay larger than the stated noise, without a pattern')
    return joined(*sentences)
