"""A loop predicted from the loops of other tensions: slope and gap carried over, slip force by a law over the tension.

Slope, gap and zero of the force sensor are the means of the other records'; the slip force of each sense is a straight
line over the tension, through the other records (least squares if there are more than two), at least 0. Of the
record itself nothing is used but its first reading, which tells the state it begins in. How much of the error is the
slip force's shows a second prediction, in which it is read from the first sweeps of the record; these are never scored.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.studies.hysteresis.fit import Fit, predict, refit
from scara_kinetostatic.studies.hysteresis.laws import Values
from scara_kinetostatic.studies.hysteresis.model_selection import rms
from scara_kinetostatic.studies.hysteresis.motion import Floats, Motion

SHOWN = 3
"""Sweeps from which the slip force is read in the second prediction: the first one and a whole cycle."""
SLIPS = ('slip_positive', 'slip_negative')


class Transfer(NamedTuple):
    """One record predicted from the others; all errors over the same samples, those after the sweeps shown.

    Attributes:
        record: its number.
        tension: of its band, in the unit given.
        before: rms error of law (6), carried over, N.
        after: rms error of slip, slip force by the law over the tension, N.
        shown: rms error of slip, slip force read from the first sweeps, N.
        own: rms error of slip fitted to the record itself: what could be had, N.
        slips: slip force by the law over the tension, positive and negative sense, N.
        own_slips: those of the record's own fit, N.
        residual: of the prediction by tension, (n,), N.
    """

    record: int
    tension: float
    before: float
    after: float
    shown: float
    own: float
    slips: tuple[float, float]
    own_slips: tuple[float, float]
    residual: Floats


def transfer(
    record: int, motions: Sequence[Motion], tensions: Sequence[float], before: Sequence[Fit], slip: Sequence[Fit]
) -> Transfer:
    """Predicts a record from all others.

    Args:
        record: which.
        motions: of all records.
        tensions: likewise; two or more different ones among the others.
        before: law (6) fitted to each record.
        slip: slip in series fitted to each.
    """
    others = [k for k in range(len(motions)) if k != record]
    motion, own = motions[record], slip[record]
    rows = motion.sweep >= SHOWN
    slips = tuple(
        max(0.0, _line([tensions[k] for k in others], [slip[k].values[name] for k in others], tensions[record]))
        for name in SLIPS
    )
    carried = {**_mean([slip[k].values for k in others]), **dict(zip(SLIPS, slips, strict=True)), 'start': 0.0}
    law6 = predict(before[record]._replace(values=_mean([before[k].values for k in others])), motion)
    after = predict(own._replace(values=carried), motion)
    shown = refit(after, motion, ~rows, only=(*SLIPS, 'start'))
    return Transfer(
        record=record,
        tension=tensions[record],
        before=law6.rms(rows),
        after=after.rms(rows),
        shown=shown.rms(rows),
        own=rms(own.residual[rows]),
        slips=(slips[0], slips[1]),
        own_slips=(own.values[SLIPS[0]], own.values[SLIPS[1]]),
        residual=after.residual,
    )


def _mean(several: Sequence[Values]) -> dict[str, float]:
    return {name: float(np.mean([values[name] for values in several])) for name in several[0]}


def _line(tension: Sequence[float], force: Sequence[float], at: float) -> float:
    return float(np.polynomial.Polynomial.fit(tension, force, 1)(at))
