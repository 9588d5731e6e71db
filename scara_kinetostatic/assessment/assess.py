"""The assessment: every criterion in turn, each of which may leave a remark."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scara_kinetostatic.assessment import thresholds
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Assessment, Grade, Remark
from scara_kinetostatic.assessment.leverage import leverages
from scara_kinetostatic.assessment.mistakes import find_mistake
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.model.parameters import NAMES


def assess(evidence: Evidence) -> Assessment:
    """Whether a result may be used, why, and what to do.

    Args:
        evidence: the calibration with all that speaks for or against its use.
    """
    remarks = [remark for criterion in CRITERIA for remark in criterion(evidence)]
    remarks = remarks or [Remark(Grade.FIT, _nothing_against(evidence))]
    return Assessment.of(remarks, _judged_without(evidence))


def _nothing_against(evidence: Evidence) -> str:
    """The reason of a result that is fit."""
    compared = evidence.comparison.extended
    return (
        f'{int(evidence.final.used.sum())} touches determine all parameters and check them: force error '
        f'{compared.force_error:.2g} N, on held-out touches {compared.held_out:.2g} N'
    )


def _judged_without(evidence: Evidence) -> Iterator[str]:
    yield 'the cell declares no uncertainties and no tolerance: discs and sensor count as exact'


def _mistake(evidence: Evidence) -> Iterator[Remark]:
    """A mistake in the cell description or the touches that explains what is odd."""
    mistake = find_mistake(evidence.final.touches, evidence.final.cell, evidence.final)
    if mistake is not None:
        yield Remark(Grade.UNFIT, mistake.text, mistake.action)


def _convergence(evidence: Evidence) -> Iterator[Remark]:
    """A fit that did not converge."""
    termination = evidence.final.termination
    if termination is not Termination.CONVERGED:
        yield Remark(Grade.UNFIT, 'the fit did not converge', termination.advice)


def _held_out(evidence: Evidence) -> Iterator[Remark]:
    """Touches that do not predict each other."""
    errors = evidence.comparison.extended
    ratio = errors.held_out / max(errors.force_error, evidence.final.noise.force_rms)
    if not ratio < thresholds.HELD_OUT_CAUTION:
        grade = Grade.UNFIT if not ratio < thresholds.HELD_OUT_UNFIT else Grade.CAUTION
        yield Remark(
            grade,
            f'on held-out touches the force error is {errors.held_out:.2g} N, {ratio:.2g} times that in the fit',
            'record more touches, all round every disc, in both elbow postures',
        )


def _leverage(evidence: Evidence) -> Iterator[Remark]:
    """Touches that nothing checks."""
    found = leverages(evidence.final)
    numbers = evidence.final.touches.index[evidence.final.used]
    high = np.flatnonzero(found > thresholds.LEVERAGE_CAUTION)
    if len(high):
        worst = int(high[np.argmax(found[high])])
        grade = Grade.UNFIT if found[worst] > thresholds.LEVERAGE_UNFIT else Grade.CAUTION
        yield Remark(
            grade,
            f'{len(high)} of {len(found)} touches are not checked by the others: an error of touch {numbers[worst]} '
            f'would go into the parameters to {100 * found[worst]:.0f} %',
            'record more touches, beside those that are not checked: '
            + ', '.join(str(number) for number in numbers[high][:6]),
        )


def _values(evidence: Evidence) -> Iterator[Remark]:
    """Compliances and backlashes that are negative."""
    final = evidence.final
    for name in NAMES[6:]:
        value, std = getattr(final.parameters, name), final.std_of(name)
        if std > 0 and value < -thresholds.NEGATIVE * std:
            yield Remark(Grade.UNFIT, f'{name} is negative, by {-value / std:.0f} standard uncertainties')


def _undetermined(evidence: Evidence) -> Iterator[Remark]:
    """Parameters without a value."""
    found = evidence.final.identifiability
    if found.confounded:
        names = '; '.join(' and '.join(group) for group in found.confounded)
        yield Remark(Grade.CAUTION, f'the touches do not determine {names}', found.advice)


def _verdict(evidence: Evidence) -> Iterator[Remark]:
    """A model that is not complete."""
    if evidence.diagnosis.verdict in ('ambiguous', 'unexplained'):
        yield Remark(Grade.CAUTION, f'the model is not complete (verdict {evidence.diagnosis.verdict})')


CRITERIA = (_mistake, _convergence, _held_out, _leverage, _values, _undetermined, _verdict)
"""In the order in which equally grave reasons are given."""
