"""What a diagnosis means and what to do next, in words."""

from __future__ import annotations

from collections.abc import Sequence

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.discrimination import DiscriminatingTouch
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.diagnosis.refit import effect_values
from scara_kinetostatic.diagnosis.result import Found, Ranked
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.effects.unnamed import Unnamed
from scara_kinetostatic.model.parameters import NAMES

LARGE_BEND = 5.0
"""Standard deviations by which an effect that is not found may bend one of the twelve before it is said."""
FEW = 4
VAGUE = 5.0
"""Factor by which a standard deviation grows with other forms from which on it is said."""


def unexplained(c: Calibration, found: Sequence[Dependence]) -> str:
    """Where the twelve parameters are not enough and nothing was found to add."""
    if not found and c.noise_source == 'estimated':
        return (
            'the forces lean from the normal of the disc, or scatter, in another way than noise does, without a '
            'pattern: a few bad touches, or contact friction too small to be told; record more touches'
        )
    if not found:
        return (
            f'the residuals are {c.reduced_chi_square**0.5:.2g} times as large as the stated noise, without a pattern: '
            'the noise is stated too small, or touches repeat worse than assumed; '
            'leave the noise out of the cell file to have it estimated'
        )
    names = '; '.join(dependence.name for dependence in found[:3])
    return (
        f'the residual depends on {names}: the robot does something that the twelve parameters do not describe, '
        'and they are bent by it; do not trust them to their standard deviations'
    )


def hint(p_value: float, found: Sequence[Dependence]) -> str:
    """Where the residual shows a trace that no effect explains well enough to be believed."""
    over = f' over {found[0].name}' if found else ''
    return (
        f'a hint of structure{over} (p = {p_value:.1g}), and nothing that explains it well enough to be believed; '
        'more touches would show whether it is there'
    )


def not_excluded(ranking: Sequence[Ranked]) -> str:
    """What "nothing is missing" does not exclude: effects just too small to be found that would bend the twelve."""
    named = [item for item in ranking if item.undetected_bias > LARGE_BEND and not isinstance(item.effect, Unnamed)]
    if not named:
        return ''
    worst = max(named, key=lambda item: item.undetected_bias)
    others = f'; {len(named) - 1} other effects some parameter by more than {LARGE_BEND:g}' if len(named) > 1 else ''
    return (
        f'not excluded: {worst.effect.label}, just too small to be found in these touches, could bend '
        f'{worst.biased_parameter} by {worst.undetected_bias:.0f} standard deviations{others}'
    )


def held(c: Calibration) -> str:
    """What to say where some of the twelve were held at given values."""
    if not c.fixed:
        return ''
    names = ', '.join(c.fixed)
    return f'held at given values: {names}; a wrong value shows as an effect that is not there, so fit it as well'


def joined(*texts: str) -> str:
    """Sentences, as one text; it begins small, as it does where there is one only."""
    first, *others = [text for text in texts if text] or ['']
    return '. '.join([first, *(text[0].upper() + text[1:] for text in others)])


def _few(labels: Sequence[str]) -> str:
    """The first few of many, in words."""
    left = len(labels) - FEW
    parts = [*labels[:FEW], *([f'{left} other{"s" if left > 1 else ""}'] if left > 0 else [])]
    return f'{", ".join(parts[:-1])} and {parts[-1]}' if len(parts) > 1 else parts[0]


def alternative_frequencies(extended: Calibration, peaks: Sequence[Calibration]) -> str:
    """Which other frequencies fit as well as those of an extended model.

    Args:
        extended: the model.
        peaks: fits of the same effects with other frequencies.
    """
    sentences = []
    for place, effect in enumerate(extended.model.effects):
        if not isinstance(effect, Effect) or not effect.grid_parameter:
            continue
        k = effect.grid_parameter_index
        found, *others = (f'{effect_values(fit)[place][0][k]:.3g}' for fit in (extended, *peaks))
        others = sorted(set(others) - {found}, key=float)
        if others:
            sentences.append(
                f'{effect.label} fits as well with {" or ".join(others)} {effect.grid_parameter} instead of {found}; '
                f'the standard deviations hold for all of them; to decide, record {effect.identified_by}'
            )
    return joined(*sentences)


def vague(extended: Calibration, widened: Calibration) -> str:
    """Which of the twelve other forms and frequencies, that fit as well, leave open."""
    names = [name for name, a, b in zip(NAMES, extended.std, widened.std, strict=True) if b > VAGUE * a]
    if not names:
        return ''
    return (
        f'{_few(names)} {"is" if len(names) == 1 else "are"} left open: what was found may go by another law that fits '
        'these touches as well, and the standard deviations hold for those, too'
    )


def after_search(
    verdict: str,
    found: Sequence[Found],
    rivals: Sequence[Sequence[str]],
    remaining: Sequence[Dependence],
    known: Sequence[Effect],
    discriminating: Sequence[DiscriminatingTouch] | None = None,
) -> str:
    """What remains open once the model has been extended."""
    by_label = {effect.label: effect for effect in known}
    sentences = []
    for group in rivals:
        apart = f'these touches cannot tell {_few(group)} apart'
        reveals = dict.fromkeys(by_label[label].identified_by for label in group[:FEW] if label in by_label)
        sentences.append(f'{apart}; to decide, record {"; or ".join(reveals)}' if discriminating != () else apart)
    if discriminating:
        sentences.append(
            f'where they differ most: {"; ".join(map(str, discriminating))}; repeat such touches until they decide'
        )
    elif discriminating is not None:
        sentences.append('no touch of these discs would do it; measure one of the rivals by other means, and hold it')
    for item in found:
        if isinstance(item.effect, Unnamed) and not item.in_every_model:
            sentences.append(
                f'{item.effect.label} stands for something that no effect of the list is: {item.effect.description}'
            )
        elif isinstance(item.effect, Unnamed):
            sentences.append(
                f'no effect of the list explains what is left: {item.effect.description}; it is corrected by a fitted '
                f'curve. To learn what it is, record {item.effect.identified_by}'
            )
    if verdict == 'unexplained' and remaining:
        names = '; '.join(dependence.name for dependence in remaining[:3])
        sentences.append(f'something is left even so: the residual depends on {names}')
    elif verdict == 'unexplained' and not any(isinstance(item.effect, Unnamed) for item in found):
        sentences.append('the residuals stay larger than the stated noise, without a pattern')
    return joined(*sentences)
