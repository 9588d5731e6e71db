"""Leave-one-out prediction: a record predicted from those at other tensions of the band.

Slope, gap and zero of the force sensor are the means of the other records'; the slip force of each sense is a straight
line over the tension through the other records (least squares for more than two), at least 0. Of the record itself only
its first reading is used, which gives the initial state. In a second prediction the slip force is identified from the
first sweeps of the record, which do not count for the error: it shows how much of the error is due to the slip force.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, rms
from scara_kinetostatic.studies.hysteresis.fit import Fit, predict, refit
from scara_kinetostatic.studies.hysteresis.laws import Values
from scara_kinetostatic.studies.hysteresis.motion import Motion

IDENTIFICATION_SWEEPS = 3
"""Sweeps from which the slip force is identified in the second prediction: the first one and a whole cycle."""
_SLIPS = ('slip_positive', 'slip_negative')


class LeaveOneOut(NamedTuple):
    """One record predicted from the others; all errors are over the samples after the identification sweeps.

    Attributes:
        record: its index.
        tension: of its band, in the unit given.
        backlash: rms error of law (6) with the others' parameters, N.
        by_tension: rms error of slip, slip force from the line over the tension, N.
        identified: rms error of slip, slip force identified from the first sweeps, N.
        own: rms residual of slip fitted to the record itself, N.
        slips: slip force from the line over the tension, positive and negative sense, N.
        own_slips: slip force of the record's own fit, N.
        residual: of the prediction by tension, (n,), N.
    """

    record: int
    tension: float
    backlash: float
    by_tension: float
    identified: float
    own: float
    slips: tuple[float, float]
    own_slips: tuple[float, float]
    residual: Floats


def predict_left_out(
    record: int, motions: Sequence[Motion], tensions: Sequence[float], before: Sequence[Fit], slip: Sequence[Fit]
) -> LeaveOneOut:
    """Predicts a record from all others.

    Args:
        record: its index.
        motions: of all records.
        tensions: of all records; two or more different ones among the others.
        before: law (6) fitted to each record.
        slip: slip in series fitted to each.
    """
    others = [k for k in range(len(motions)) if k != record]
    motion, own = motions[record], slip[record]
    rows = motion.sweep >= IDENTIFICATION_SWEEPS
    slips = tuple(
        max(0.0, _line([tensions[k] for k in others], [slip[k].values[name] for k in others], tensions[record]))
        for name in _SLIPS
    )
    carried = {**_mean([slip[k].values for k in others]), **dict(zip(_SLIPS, slips, strict=True)), 'start': 0.0}
    law6 = predict(before[record]._replace(values=_mean([before[k].values for k in others])), motion)
    by_tension = predict(own._replace(values=carried), motion)
    identified = refit(by_tension, motion, ~rows, only=(*_SLIPS, 'start'))
    return LeaveOneOut(
        record=record,
        tension=tensions[record],
        backlash=law6.rms(rows),
        by_tension=by_tension.rms(rows),
        identified=identified.rms(rows),
        own=rms(own.residual[rows]),
        slips=(slips[0], slips[1]),
        own_slips=(own.values[_SLIPS[0]], own.values[_SLIPS[1]]),
        residual=by_tension.residual,
    )


def _mean(several: Sequence[Values]) -> dict[str, float]:
    return {name: float(np.mean([values[name] for values in several])) for name in several[0]}


def _line(tension: Sequence[float], force: Sequence[float], at: float) -> float:
    return float(np.polynomial.Polynomial.fit(tension, force, 1)(at))
