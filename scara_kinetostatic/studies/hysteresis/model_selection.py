"""Which law of the force: every candidate is fitted to half of the sweeps, and judged on the half it has not seen.

Both halves take their turn, so that each sample but those of the first sweep is predicted once by a law that
was not fitted to it. Two laws are compared sweep by sweep: a one-sided t-test of the logarithms of the ratios of
their mean squares, which takes the sweeps for independent and the logarithms for normal. BIC counts, instead of the
samples, n / (1 + 2 Σρ), ρ being the autocorrelations of the residual of the law that predicts best.

A candidate is accepted if the residual of law (6) has structure, and if the candidate predicts better than
law (6), in the rms, in BIC and in the test, the level shared among the candidates. The one that predicts best is named;
with it, as rivals, those accepted that do not predict worse by the same test. Slip with a gap is left out where it
predicts no better than slip without one. Refinements of slip are added one by one by the same rule. They are chosen
by their held-out errors: the last of these is a little too good. Refinements that another record has asked for
(`refine_as`) are free of that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import stats

from scara_kinetostatic.studies.hysteresis.dependence import Dependence, anything_left, dependences
from scara_kinetostatic.studies.hysteresis.fit import Fit, fit, fit_refined
from scara_kinetostatic.studies.hysteresis.laws import (
    BACKLASH,
    CANDIDATES,
    REFINEMENTS,
    RESET,
    SLIP,
    SLIP_NO_GAP,
    Law,
    Refinement,
)
from scara_kinetostatic.studies.hysteresis.motion import Floats, Motion

LEVEL = 0.01
BIC_GAIN = 2.0
"""By so much BIC must fall, in its usual reading the least that counts as evidence."""
NONE, EXPLAINED, AMBIGUOUS, UNEXPLAINED = 'none', 'explained', 'ambiguous', 'unexplained'


class Score(NamedTuple):
    """A law on a record.

    Attributes:
        law: which.
        whole: fitted to all of it.
        halves: fitted to the earlier sweeps, and to the later ones.
        held_out: residual of each sample by the fit that has not seen it, (n,), N.
        train_rms: of the halves' fits on what they were fitted to, N.
        later_rms: the later sweeps, predicted from the earlier ones, N.
        earlier_rms: the earlier from the later.
        held_out_rms: both, N.
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
    """A law against the one it is to replace: p-value that it predicts no better, difference in BIC, verdict."""

    score: Score
    p_gain: float
    bic: float
    accepted: bool


class Choice(NamedTuple):
    """What was decided on a record.

    Attributes:
        before: law (6).
        told: law (6), told the measured force at every reversal.
        structure: what its residual depends on.
        candidates: each against law (6).
        winner: the candidate named; None if none is accepted.
        rivals: names of those accepted that the data cannot tell from the winner.
        refinements: each step: the refinements tried, against the law before the step; the one taken first, if any.
        after: the winner with the refinements taken; law (6) if there is no winner.
        left: what its residual depends on.
        verdict: none, explained (one is named), ambiguous (several), unexplained (structure, but none accepted).
    """

    before: Score
    told: Score
    structure: tuple[Dependence, ...]
    candidates: tuple[Comparison, ...]
    winner: Score | None
    rivals: tuple[str, ...]
    refinements: tuple[tuple[Comparison, ...], ...]
    after: Score
    left: tuple[Dependence, ...]
    verdict: str

    @property
    def p_value(self) -> float:
        """That law (6) is enough."""
        return anything_left(self.structure)

    @property
    def p_left(self) -> float:
        """That nothing is left of structure after all."""
        return anything_left(self.left)


def choose(motion: Motion, candidates: tuple[Law, ...] = CANDIDATES) -> Choice:
    """Decides what a record needs beyond law (6)."""
    before = score(BACKLASH, motion)
    structure = dependences(motion, before.whole.residual)
    scores = [score(law, motion) for law in candidates]
    compared = compare(before, scores, motion)
    if anything_left(structure) >= LEVEL:
        compared = tuple(each._replace(accepted=False) for each in compared)
    accepted = _without_idle([each.score for each in compared if each.accepted], motion)
    winner = min(accepted, key=lambda each: each.held_out_rms, default=None)
    rivals = tuple(each.law.name for each in accepted if winner and _as_good(each, winner, len(accepted), motion))
    after, steps = _refine(winner, motion) if winner else (before, ())
    verdict = AMBIGUOUS if rivals else EXPLAINED
    if winner is None:
        verdict = NONE if anything_left(structure) >= LEVEL else UNEXPLAINED
    left = dependences(motion, after.whole.residual)
    return Choice(before, score(RESET, motion), structure, compared, winner, rivals, steps, after, left, verdict)


def _without_idle(accepted: list[Score], motion: Motion) -> list[Score]:
    """Slip with a gap is left out where the gap gains nothing over slip without one."""
    by_name = {each.law.name: each for each in accepted}
    larger, smaller = by_name.get(SLIP.name), by_name.get(SLIP_NO_GAP.name)
    if larger is None or smaller is None or p_better(larger, smaller, motion) < LEVEL:
        return accepted
    return [each for each in accepted if each is not larger]


def score(law: Law, motion: Motion, base: Score | None = None, refinement: Refinement | None = None) -> Score:
    """Fits a law, or a refinement of one that is fitted, to the whole and to both halves."""
    halves = (motion.earlier | ~motion.scored, ~motion.earlier | ~motion.scored)
    everything = np.ones(len(motion), dtype=bool)
    if base is None or refinement is None:
        whole, first, last = (fit(law, motion, rows) for rows in (everything, *halves))
    else:
        starts = (base.whole, *base.halves)
        whole, first, last = (
            fit_refined(start, refinement, motion, rows)
            for start, rows in zip(starts, (everything, *halves), strict=True)
        )
    held_out = np.where(motion.earlier, last.residual, first.residual)
    earlier, later = motion.earlier & motion.scored, ~motion.earlier
    train = np.where(motion.earlier, first.residual, last.residual)
    return Score(
        law=whole.law,
        whole=whole,
        halves=(first, last),
        held_out=held_out,
        train_rms=rms(train[motion.scored]),
        later_rms=first.rms(later),
        earlier_rms=last.rms(earlier),
        held_out_rms=rms(held_out[motion.scored]),
    )


def rms(values: Floats) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def compare(before: Score, scores: list[Score], motion: Motion) -> tuple[Comparison, ...]:
    """Every law against the one it is to replace, in the order given."""
    best = min([before, *scores], key=lambda each: each.held_out_rms)
    count = effective_count(best.whole.residual[motion.scored])
    found = []
    for each in scores:
        p_gain = p_better(each, before, motion)
        bic = _bic(each, motion, count) - _bic(before, motion, count)
        accepted = each.held_out_rms < before.held_out_rms and bic < -BIC_GAIN and p_gain < LEVEL / len(scores)
        found.append(Comparison(each, p_gain, bic, accepted))
    return tuple(found)


def p_better(one: Score, other: Score, motion: Motion) -> float:
    """p-value that one law predicts no better than another, sweep by sweep."""
    squares = [motion.mean_square(each.held_out, motion.scored)[1:] for each in (other, one)]
    tiny = 1e-12 * motion.force_range**2
    gain = np.log((squares[0] + tiny) / (squares[1] + tiny))
    if not np.ptp(gain) > 0:
        return 1.0
    return float(stats.ttest_1samp(gain, 0.0, alternative='greater').pvalue)


def effective_count(residual: Floats) -> float:
    """How many independent samples a residual is worth: n / (1 + 2 Σρ), the sum ending where ρ falls below 0."""
    centred = residual - residual.mean()
    count = len(centred)
    spectrum = np.fft.rfft(centred, 2 * count)
    correlation = np.fft.irfft(spectrum * spectrum.conj())[:count]
    if not correlation[0] > 0:
        return float(count)
    rho = correlation / correlation[0]
    end = int(np.argmax(rho < 0)) or count
    return max(count / (1 + 2 * float(rho[1:end].sum())), 2.0)


def _bic(each: Score, motion: Motion, count: float) -> float:
    mean_square = max(rms(each.whole.residual[motion.scored]) ** 2, 1e-300)
    return float(count * np.log(mean_square) + len(each.law.parameters) * np.log(count))


def _as_good(each: Score, winner: Score, count: int, motion: Motion) -> bool:
    return each is not winner and p_better(winner, each, motion) >= LEVEL / count


def refine_as(winner: Score, other: Score, motion: Motion) -> Score:
    """A record's winner with the refinements that another record asked for, chosen without a look at this one."""
    found = winner
    for name in other.law.name.split('+')[1:]:
        found = score(found.law, motion, found, next(each for each in REFINEMENTS if each.name == name))
    return found


def _refine(winner: Score, motion: Motion) -> tuple[Score, tuple[tuple[Comparison, ...], ...]]:
    """Adds refinements to slip one by one, as long as one is accepted."""
    open_ones, steps, now = list(REFINEMENTS), [], winner
    while open_ones and winner.law.name in (SLIP.name, SLIP_NO_GAP.name):
        compared = compare(now, [score(now.law, motion, now, each) for each in open_ones], motion)
        order = sorted(range(len(compared)), key=lambda k: (not compared[k].accepted, compared[k].score.held_out_rms))
        steps.append(tuple(compared[k] for k in order))
        if not compared[order[0]].accepted:
            break
        now = compared[order[0]].score
        del open_ones[order[0]]
    return now, tuple(steps)
