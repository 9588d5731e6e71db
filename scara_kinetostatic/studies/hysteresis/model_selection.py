"""Selection of a law of the force by two-fold cross-validation: fitted to half of the sweeps, tested on the other half.

Both halves are held out in turn, so that each sample but those of the first sweep is predicted once by a law that was
not fitted to it. Two laws are compared sweep by sweep: a one-sided t-test of the logarithms of the ratios of their mean
squares, which assumes independent sweeps and normal logarithms. BIC uses the effective number of samples n / (1 + 2
Σρ), ρ being the autocorrelations of the residual of the law that predicts best.

A candidate is accepted if the residual of law (6) depends on any variable, and if the candidate predicts better than
law (6) in the rms, in BIC and in the test, the level shared among the candidates (Bonferroni). The accepted candidate
with the smallest held-out error is selected; its rivals are the accepted ones that do not predict worse by the same
test. Slip with a gap is dropped where it predicts no better than slip without one.

Dependence of a residual on variables of the motion: curves fitted to half of the cycles, tested on the other half.

The residual of the odd cycles is averaged in bins of a variable; this curve predicts the residual of the even cycles,
and the other way round. The share of the squared residual that it explains measures the dependence. The p-value is that
of a one-sided t-test of the correlation between residual and curve over the sweeps (the smaller of both halves,
doubled). It assumes that for a sufficient law the residuals of different sweeps are independent with a symmetric
distribution; within a sweep they may be correlated. Displacement alone cannot explain hysteresis: where a variable
explains more together with the sense of the motion, no elastic law is sufficient.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.studies.hysteresis.fit import Fit, fit
from scara_kinetostatic.studies.hysteresis.laws import BACKLASH, CANDIDATES, RESET, SLIP, SLIP_NO_GAP, Law
from scara_kinetostatic.studies.hysteresis.motion import Motion, Rows

_BINS = 16
VARIABLES = {
    'displacement': 'displacement',
    'displacement_sense': 'displacement, by sense of motion',
    'speed': 'speed',
    'distance_sense': 'distance since the reversal, by sense of motion',
    'time': 'time',
}


class Dependence(NamedTuple):
    """Dependence on one variable.

    Attributes:
        variable: a key of `VARIABLES`.
        share: explained share of the squared residual on the half held out; below 0 if the curve increases it.
        p_value: of no dependence.
    """

    variable: str
    share: float
    p_value: float


def dependences(motion: Motion, residual: Floats) -> tuple[Dependence, ...]:
    """Dependence on all variables, in decreasing order of the explained share.

    Args:
        motion: the record.
        residual: (n,), N; the first sweep does not count.
    """
    found = [_dependence(motion, residual, variable) for variable in VARIABLES]
    return tuple(sorted(found, key=lambda each: -each.share))


def p_independent(found: tuple[Dependence, ...]) -> float:
    """p-value of no dependence on any variable (Bonferroni)."""
    return min(1.0, len(found) * min(each.p_value for each in found))


def _dependence(motion: Motion, residual: Floats, variable: str) -> Dependence:
    place = _bin(motion, variable)
    odd = motion.cycle % 2 == 1
    unexplained, p_values = residual.copy(), []
    for fitted in (odd & motion.scored, ~odd & motion.scored):
        held_out = motion.scored & ~fitted
        curve = _curve(place, residual, fitted)[place]
        unexplained[held_out] -= curve[held_out]
        sums = [_by_sweep(motion, values, held_out) for values in (residual * curve, residual**2, curve**2)]
        size = np.sqrt(sums[1] * sums[2])
        p_values.append(_p_positive_mean(sums[0][size > 0] / size[size > 0]))
    rows = motion.scored
    share = 1 - float((unexplained[rows] ** 2).sum() / (residual[rows] ** 2).sum()) if np.any(residual[rows]) else 0.0
    return Dependence(variable, share, min(1.0, 2 * min(p_values)))


def _by_sweep(motion: Motion, values: Floats, rows: Rows) -> Floats:
    """Sum over the rows of each sweep, (sweeps,)."""
    return np.asarray(np.bincount(motion.sweep[rows], weights=values[rows], minlength=motion.sweeps), dtype=float)


def _bin(motion: Motion, variable: str) -> NDArray[np.int64]:
    by_sense = variable.endswith('_sense')
    values: Floats = getattr(motion, variable.removesuffix('_sense'))
    steps = _BINS * (values - values.min()) / (np.ptp(values) or 1.0)
    place = np.minimum(steps.astype(np.int64), _BINS - 1)
    return place + _BINS * (motion.sense > 0) if by_sense else place


def _curve(place: NDArray[np.int64], residual: Floats, rows: Rows) -> Floats:
    """Mean of each bin, (2 bins,), N; 0 for an empty one."""
    count = np.bincount(place[rows], minlength=2 * _BINS)
    total = np.bincount(place[rows], weights=residual[rows], minlength=2 * _BINS)
    return np.asarray(total / np.maximum(count, 1))


def _p_positive_mean(values: Floats) -> float:
    """p-value of a mean of zero or less."""
    if len(values) < 2 or not np.ptp(values) > 0:
        return 1.0
    return float(stats.ttest_1samp(values, 0.0, alternative='greater').pvalue)


LEVEL = 0.01
"""Significance level of the tests."""
BIC_GAIN = 2.0
"""Smallest decrease of BIC that counts as evidence (Kass and Raftery, J. Am. Stat. Assoc. 90 (1995) 773)."""
NONE, EXPLAINED, AMBIGUOUS, UNEXPLAINED = 'none', 'explained', 'ambiguous', 'unexplained'


class CrossValidation(NamedTuple):
    """Cross-validation of a law on a record.

    Attributes:
        law: the law.
        whole: fitted to all sweeps.
        halves: fitted to the earlier sweeps, and to the later ones.
        held_out: residual of each sample by the fit from which it was held out, (n,), N.
        train_rms: rms residual of the fits to the halves on the samples fitted, N.
        later_rms: rms error of the later sweeps, predicted from the earlier ones, N.
        earlier_rms: rms error of the earlier sweeps, predicted from the later ones, N.
        held_out_rms: rms of `held_out`, N.
    """

    law: Law
    whole: Fit
    halves: tuple[Fit, Fit]
    held_out: Floats
    train_rms: float
    later_rms: float
    earlier_rms: float
    held_out_rms: float


class Comparison(NamedTuple):
    """A law compared with the one that it would replace.

    Attributes:
        score: cross-validation of the law.
        p_gain: p-value of no better prediction.
        bic: difference in BIC.
        accepted: whether it is better by all criteria.
    """

    score: CrossValidation
    p_gain: float
    bic: float
    accepted: bool


class ModelSelection(NamedTuple):
    """Model selection on a record.

    Attributes:
        before: law (6).
        with_reset: law (6) whose state is set by the measured force at every reversal.
        dependence_before: dependence of the residual of law (6).
        candidates: each compared with law (6).
        selected: the candidate selected; None if none is accepted.
        rivals: names of the accepted candidates that predict as well as the selected one.
        dependence_after: dependence of the residual of the selected law, or of law (6).
        verdict: none (law (6) is sufficient), explained (one law selected), ambiguous (with rivals), unexplained
            (the residual of law (6) depends on a variable, but no candidate is accepted).
    """

    before: CrossValidation
    with_reset: CrossValidation
    dependence_before: tuple[Dependence, ...]
    candidates: tuple[Comparison, ...]
    selected: CrossValidation | None
    rivals: tuple[str, ...]
    dependence_after: tuple[Dependence, ...]
    verdict: str

    @property
    def final(self) -> CrossValidation:
        """The selected law, or law (6) if none is selected."""
        return self.selected or self.before

    @property
    def p_value(self) -> float:
        """p-value of law (6) as a sufficient law."""
        return p_independent(self.dependence_before)

    @property
    def p_after(self) -> float:
        """p-value of the selected law as a sufficient law."""
        return p_independent(self.dependence_after)


def select_model(motion: Motion, candidates: tuple[Law, ...] = CANDIDATES) -> ModelSelection:
    """Selects the law that a record needs beyond law (6).

    Args:
        motion: the record.
        candidates: laws to compare with law (6).
    """
    before = _cross_validate(BACKLASH, motion)
    dependence_before = dependences(motion, before.whole.residual)
    sufficient = p_independent(dependence_before) >= LEVEL
    scores = [_cross_validate(law, motion) for law in candidates]
    compared = _compare(before, scores, motion)
    if sufficient:
        compared = tuple(each._replace(accepted=False) for each in compared)
    accepted = _without_needless_gap([each.score for each in compared if each.accepted], motion)
    selected = min(accepted, key=lambda each: each.held_out_rms, default=None)
    rivals = tuple(each.law.name for each in accepted if selected and _as_good(each, selected, len(accepted), motion))
    verdict = AMBIGUOUS if rivals else EXPLAINED
    if selected is None:
        verdict = NONE if sufficient else UNEXPLAINED
    return ModelSelection(
        before=before,
        with_reset=_cross_validate(RESET, motion),
        dependence_before=dependence_before,
        candidates=compared,
        selected=selected,
        rivals=rivals,
        dependence_after=dependences(motion, (selected or before).whole.residual),
        verdict=verdict,
    )


def _without_needless_gap(accepted: list[CrossValidation], motion: Motion) -> list[CrossValidation]:
    """The accepted laws without slip with a gap, where it predicts no better than slip without one."""
    by_name = {each.law.name: each for each in accepted}
    larger, smaller = by_name.get(SLIP.name), by_name.get(SLIP_NO_GAP.name)
    if larger is None or smaller is None or p_better(larger, smaller, motion) < LEVEL:
        return accepted
    return [each for each in accepted if each is not larger]


def _cross_validate(law: Law, motion: Motion) -> CrossValidation:
    """Fits a law to all sweeps and to both halves, and predicts each half from the other."""
    everything = np.ones(len(motion), dtype=bool)
    halves = (everything, motion.earlier | ~motion.scored, ~motion.earlier | ~motion.scored)
    whole, first, last = (fit(law, motion, rows) for rows in halves)
    held_out = np.where(motion.earlier, last.residual, first.residual)
    earlier, later = motion.earlier & motion.scored, ~motion.earlier
    train = np.where(motion.earlier, first.residual, last.residual)
    return CrossValidation(
        law=law,
        whole=whole,
        halves=(first, last),
        held_out=held_out,
        train_rms=rms(train[motion.scored]),
        later_rms=first.rms(later),
        earlier_rms=last.rms(earlier),
        held_out_rms=rms(held_out[motion.scored]),
    )


def _compare(before: CrossValidation, scores: list[CrossValidation], motion: Motion) -> tuple[Comparison, ...]:
    """Every law compared with the one that it would replace, in the order given."""
    best = min([before, *scores], key=lambda each: each.held_out_rms)
    count = effective_count(best.whole.residual[motion.scored])
    found = []
    for each in scores:
        p_gain = p_better(each, before, motion)
        bic = _bic(each, motion, count) - _bic(before, motion, count)
        accepted = each.held_out_rms < before.held_out_rms and bic < -BIC_GAIN and p_gain < LEVEL / len(scores)
        found.append(Comparison(each, p_gain, bic, accepted))
    return tuple(found)


def p_better(one: CrossValidation, other: CrossValidation, motion: Motion) -> float:
    """p-value of one law predicting no better than another, from the mean squares of the sweeps."""
    squares = [motion.mean_square(each.held_out, motion.scored)[1:] for each in (other, one)]
    tiny = 1e-12 * motion.force_range**2
    gain = np.log((squares[0] + tiny) / (squares[1] + tiny))
    if not np.ptp(gain) > 0:
        return 1.0
    return float(stats.ttest_1samp(gain, 0.0, alternative='greater').pvalue)


def effective_count(residual: Floats, mean: float | None = None) -> float:
    """Effective number of independent samples of a residual: n / (1 + 2 Σρ), summed up to the first ρ below 0.

    Args:
        residual: (n,).
        mean: the expected one, where it is known; else that of the samples.
    """
    centred = residual - (residual.mean() if mean is None else mean)
    count = len(centred)
    spectrum = np.fft.rfft(centred, 2 * count)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:count]
    if not correlation[0] > 0:
        return float(count)
    rho = correlation / correlation[0]
    end = int(np.argmax(rho < 0)) or count
    return max(count / (1 + 2 * float(rho[1:end].sum())), 2.0)


def _bic(each: CrossValidation, motion: Motion, count: float) -> float:
    mean_square = max(rms(each.whole.residual[motion.scored]) ** 2, 1e-300)
    return float(count * np.log(mean_square) + len(each.law.parameters) * np.log(count))


def _as_good(each: CrossValidation, selected: CrossValidation, count: int, motion: Motion) -> bool:
    return each is not selected and p_better(selected, each, motion) >= LEVEL / count
