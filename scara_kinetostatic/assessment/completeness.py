"""Whether what the model lacks, or the noise, matters for the use of the result."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from scara_kinetostatic.assessment import thresholds
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark, quantity
from scara_kinetostatic.assessment.rejections import between
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis.advice import contradicted, implausible_noise, large_noise
from scara_kinetostatic.diagnosis.lack_of_fit import Dependence
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.model.quantity import displacement

_MOST_NAMED = 4
"""So many rivals are named."""


def ambiguous(evidence: Evidence) -> Iterator[Remark]:
    """Rivals: the values hold whichever is there, the effects do not."""
    d = evidence.diagnosis
    if d.verdict != 'ambiguous':
        return
    groups = '; '.join(_one_of(d, group) for group in d.rivals)
    yield Remark(
        Grade.CAUTION,
        f'a model error was corrected, but its cause is open: {groups}; the twelve parameters and their uncertainties '
        'hold whichever it is, the effects do not',
        to_discriminate(d),
    )


def _one_of(d: Diagnosis, group: Sequence[str]) -> str:
    titles = [d.effects_by_label()[label].title if label in d.effects_by_label() else label for label in group]
    left = len(titles) - _MOST_NAMED
    return ' or '.join([*titles[:_MOST_NAMED], *([f'one of {left} more'] if left > 0 else [])])


def to_discriminate(d: Diagnosis) -> str:
    """What tells rivals apart: touches or, where no touch would, another measurement; empty if nothing is known."""
    effects = d.effects_by_label()
    labels = [label for group in d.rivals for label in group[:_MOST_NAMED] if label in effects]
    if labels and d.discriminating == ():
        effect = effects[labels[0]]
        fixed = ' '.join(f"--fix '{effect.label}.{parameter.name}=VALUE'" for parameter in effect.parameters)
        return f'measure one of the possible causes by other means and hold it, such as by {fixed}'
    touches = dict.fromkeys(effects[label].identified_by for label in labels)
    return f'to tell the causes apart, record {"; or ".join(touches)}' if touches else ''


def shifted(evidence: Evidence) -> Iterator[Remark]:
    """Something that shifted at a moment: corrected, but a cell in which things move."""
    for item in evidence.diagnosis.found:
        effect, values = item.effect, {value.name: value.value for value in item.values}
        if not (effect.is_stepwise and item.in_every_model):
            continue
        moment = _moment(evidence.final, values.get('moment', np.nan), effect)
        moment += '' if evidence.sequence_known else ', in the order given, as that in time is not known'
        if effect.on_object:
            what = f'{effect.target} has moved {moment}, {displacement(values["x"], values["y"])}: corrected'
            yield Remark(Grade.CAUTION, what, f'fasten {effect.target}, measure its place again, and record again')
        else:
            what = f'{effect.finding} {moment}: corrected; the result is that of after it'
            yield Remark(Grade.CAUTION, what, f'find out why {effect.finding}, and record again without that')


def _moment(c: Calibration, moment: float, effect: Effect) -> str:
    """The two touches between which a moment lies; of a disc, two of its own."""
    touches, own = c.touches, np.ones(len(c.touches), dtype=bool)
    if effect.on_object:
        own = touches.disc == [disc.name for disc in c.cell.discs].index(effect.target or '')
    before, after = own & (touches.order < moment), own & (touches.order > moment)
    if not (before.any() and after.any()):
        return 'at a moment'
    last = int(np.flatnonzero(before)[np.argmax(touches.order[before])])
    first = int(np.flatnonzero(after)[np.argmin(touches.order[after])])
    return between(touches, last, first)


def unexplained(evidence: Evidence) -> Iterator[Remark]:
    """A model error that no effect explains: what it does to the tip decides."""
    d, c = evidence.diagnosis, evidence.final
    for test in d.contradicted:
        action = f'correct the nominal value of {test.name}, or leave it out of uncertainty.nominal'
        yield Remark(Grade.CAUTION, f'{contradicted(test)}: the result is without it', action)
    if d.verdict != 'unexplained' or (d.contradicted and not d.remaining and not d.found):
        return
    implausible = implausible_noise(c)
    if implausible:
        problem, _, action = implausible.partition('; ')
        yield Remark(Grade.UNFIT, problem, action)
        return
    curves = [item.effect for item in d.found if not item.effect.is_physical]
    if curves and not d.remaining:
        yield _about_curve(curves[0], evidence.base.fixed)
    elif d.remaining:
        yield _about_dependence(d.remaining[0], evidence)
    else:
        yield _about_noise(c)


def _about_curve(curve: Effect, fixed: Iterable[str]) -> Remark:
    """A fitted curve; a wrong value of a fixed parameter needs one."""
    held = ', '.join(fixed)
    return Remark(
        Grade.CAUTION,
        f'a model error of unknown cause is corrected by a fitted curve ({curve.description}): it holds where the '
        'touches are, and may not elsewhere',
        f'estimate {held} as well: a wrong value looks like this'
        if held
        else f'to identify the cause, record {curve.identified_by}',
    )


def _about_dependence(dependence: Dependence, evidence: Evidence) -> Remark:
    """Unfit where the error is larger than the noise."""
    c, tip = evidence.final, evidence.comparison.extended.tip
    if c.noise_source == 'given':
        small = c.reduced_chi_square <= thresholds.MODEL_ERROR_UNFIT
    else:
        small = dependence.share <= thresholds.MODEL_ERROR_SHARE
    return Remark(
        Grade.CAUTION if small else Grade.UNFIT,
        f'a model error is not explained; the residual is correlated with: {dependence.name}; the touches are '
        f'{quantity(tip.fitted, "m")} off (rms), {quantity(tip.noise, "m")} by noise; the stated uncertainties do not '
        'cover its bias',
        'look in the report at what the residuals depend on, mend it, and record again',
    )


def _about_noise(c: Calibration) -> Remark:
    """Residuals that are larger than the noise, or distributed otherwise, without a pattern."""
    factor = c.reduced_chi_square**0.5
    if c.noise_source == 'estimated':
        reason = 'the residuals are not distributed like noise, without a pattern: some touches are bad'
        return Remark(Grade.CAUTION, reason, 'record more touches')
    return Remark(
        Grade.CAUTION if factor <= thresholds.NOISE_FACTOR else Grade.UNFIT,
        f'the residuals are {factor:.2g} times the stated noise, without a pattern; the uncertainties are enlarged by '
        'that',
        'leave the noise out of the cell description to have it estimated',
    )


def noise(evidence: Evidence) -> Iterator[Remark]:
    """Noise that no robot has, or that the touches contradict."""
    c = evidence.final
    if large_noise(c) and evidence.diagnosis.verdict != 'unexplained':
        yield Remark(
            Grade.CAUTION,
            f'the joints seem to repeat no better than {1e6 * c.noise.joint_rms:.0f} µrad: a model error may be '
            'counted as noise',
            'give the noise in the cell description if it is known',
        )
    factor = c.reduced_chi_square**0.5
    if c.noise_source == 'given' and factor < thresholds.NOISE_OVERSTATED:
        yield Remark(
            Grade.CAUTION,
            f'the residuals are {factor:.2g} times the stated noise: the uncertainties are stated too large by that',
            'leave the noise out of the cell description to have it estimated',
        )
