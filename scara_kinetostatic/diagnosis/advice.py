"""What a diagnosis means and what to do next, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from scara_kinetostatic.calibration.solution import Calibration
from scara_kinetostatic.diagnosis.deciding import Deciding
from scara_kinetostatic.diagnosis.result import Found
from scara_kinetostatic.diagnosis.structure import Trace
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import Unnamed

LARGEST_JOINT_NOISE = 2e-4
"""Estimated repeatability of a joint beyond which it is an error of the model, rad."""
GROWING = 1e-3
"""P-value below which it is said that the noise grows with the force."""
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


def with_growing_noise(text: str, p_value: float) -> str:
    """What to add where the scatter of the force is not the same at all forces."""
    if p_value >= GROWING:
        return text
    said = (
        f'the scatter of the force grows with the force (p = {p_value:.1g}), and all tests take it for the same: '
        'structure over the size of the force may be no more than that'
    )
    return f'{text}. {said}' if text else said


def too_quiet(c: Calibration) -> str:
    """Where the residuals are smaller than the stated noise."""
    if c.noise_source == 'given' and stats.chi2.cdf(c.chi_square, c.degrees_of_freedom) < 1e-3:
        return (
            f'the residuals are {c.reduced_chi_square**0.5:.2g} times the stated noise: it is stated too large, '
            'and so are the standard deviations; leave the noise out of the cell file to have it estimated'
        )
    return ''


def _few(labels: Sequence[str]) -> str:
    """The first few of many, in words."""
    more = f' and {len(labels) - FEW} others' if len(labels) > FEW else ''
    return ' and '.join(labels) if not more else ', '.join(labels[:FEW]) + more


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
        apart = f'{_few(group)} cannot be told apart by these touches'
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
    return '. '.join(sentences)
