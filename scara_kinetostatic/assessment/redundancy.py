"""Whether the touches check the result: convergence, leverage, degrees of freedom, prediction of held-out touches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from scara_kinetostatic.assessment import thresholds
from scara_kinetostatic.assessment.evidence import Evidence
from scara_kinetostatic.assessment.grade import Grade, Remark
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.model.arrays import Indices

_MOST_NAMED = 4
"""So many touches are named."""
MORE_TOUCHES = 'record more touches, all round every disc, in both elbow postures and at three force levels'


def convergence(evidence: Evidence) -> Iterator[Remark]:
    """A fit that did not converge."""
    termination = evidence.final.termination
    if termination is not Termination.CONVERGED:
        yield Remark(Grade.UNFIT, 'the fit did not converge', termination.advice.rpartition('; ')[2])


def held_out(evidence: Evidence) -> Iterator[Remark]:
    """Touches that do not predict each other."""
    errors = evidence.comparison.extended
    ratio = errors.held_out / max(errors.force_error, evidence.final.noise.force_rms)
    if ratio <= thresholds.HELD_OUT_CAUTION:
        return
    yield Remark(
        Grade.CAUTION if ratio <= thresholds.HELD_OUT_UNFIT else Grade.UNFIT,
        f'touches that the fit has not seen are predicted with a force error of {errors.held_out:.2g} N, those it has '
        f'seen with {errors.force_error:.2g} N',
        MORE_TOUCHES,
    )


def leverage(evidence: Evidence) -> Iterator[Remark]:
    """Touches that nothing checks."""
    found = evidence.leverages
    high = np.flatnonzero(found > thresholds.LEVERAGE_CAUTION)
    if not len(high):
        return
    high = high[np.argsort(-found[high], kind='stable')]
    used = np.flatnonzero(evidence.final.used)[high]
    worst = float(found[high[0]])
    yield Remark(
        Grade.CAUTION if worst <= thresholds.LEVERAGE_UNFIT else Grade.UNFIT,
        f'{len(high)} of {len(found)} touches are not checked by the others: of an error of touch '
        f'{evidence.final.touches.index[used[0]]} the parameters absorb {_percent(worst)} (leverage {worst:.2f})',
        MORE_TOUCHES if len(high) > _MOST_NAMED else f'touch again beside {_places(evidence.final, used)}',
    )


def _percent(part: float) -> str:
    return 'everything' if part > 0.995 else f'{100 * part:.0f} %'


def _places(c: Calibration, which: Indices) -> str:
    """Where these touches are."""
    t = c.touches
    places = dict.fromkeys(
        f'{c.cell.discs[t.disc[k]].name}, elbow {"left" if t.posture[k] > 0 else "right"}, touch {t.index[k]}'
        for k in which.tolist()
    )
    return '; '.join(places)


def freedoms(evidence: Evidence) -> Iterator[Remark]:
    """Few degrees of freedom: the noise is not checked."""
    number = evidence.final.degrees_of_freedom
    if number >= thresholds.LEAST_FREEDOMS:
        return
    estimated = evidence.final.noise_source == 'estimated'
    consequence = 'the estimated noise is a guess' if estimated else 'they do not check the stated noise'
    left = f'{number} degree{"" if number == 1 else "s"} of freedom {"is" if number == 1 else "are"} left'
    yield Remark(
        Grade.CAUTION, f'{int(evidence.final.used.sum())} touches are few: {left}, {consequence}', MORE_TOUCHES
    )
