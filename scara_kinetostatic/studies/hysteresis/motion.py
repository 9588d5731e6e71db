"""A measured record of force over displacement, cut into sweeps, each from one reversal of the motion to the next.

What stands still before and after the motion is left out: it would only dilute the errors. Half of the sweeps
is what a law is fitted to, the other half what it has to predict; then the other way round. A law with a
memory needs to know the state in which the record begins: the first sweep, up to the first reversal, is
shown to every fit and never scored.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.dial_gauge.reversals import PROMINENCE

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_]

FEWEST_SWEEPS = 6
"""Three to fit to and three to predict: no scatter among sweeps can be told from fewer."""
_FEWEST_ROWS = 8
"""Samples of a sweep, on the mean."""
_STILL = 2e-3
"""Within this part of the whole range of its ends, the record stands still."""
_SAME_TURN = 0.01


@dataclass(frozen=True)
class Motion:
    """The record; arrays (n,), read-only.

    Attributes:
        time: s, rising.
        displacement: m.
        force: N.
        edges: first sample of each sweep, and n, (sweeps + 1,); the sample at a reversal is the last of its sweep.
        sweep: number of the sweep of each sample.
        sense: of the motion, +1 or -1.
        distance: since the reversal, m.
        speed: of the displacement, signed, m/s.
    """

    time: Floats
    displacement: Floats
    force: Floats
    edges: NDArray[np.int64]
    sweep: NDArray[np.int64]
    sense: Floats
    distance: Floats
    speed: Floats

    def __post_init__(self) -> None:
        for field in fields(self):
            getattr(self, field.name).flags.writeable = False

    def __len__(self) -> int:
        return len(self.time)

    @property
    def sweeps(self) -> int:
        """How many."""
        return len(self.edges) - 1

    @property
    def begins(self) -> NDArray[np.int64]:
        """Sample at which each sweep begins: the reversal before it, (sweeps,)."""
        return np.maximum(self.edges[:-1] - 1, 0)

    @property
    def travel(self) -> float:
        """Range of the displacement, m."""
        return float(np.ptp(self.displacement))

    @property
    def force_range(self) -> float:
        """Range of the force, N."""
        return float(np.ptp(self.force))

    @property
    def earlier(self) -> Rows:
        """The samples of the first half of the sweeps."""
        return self.sweep < self.sweeps // 2

    @property
    def scored(self) -> Rows:
        """All but the first sweep, which shows every law the state in which the record begins."""
        return self.sweep > 0

    @property
    def cycle(self) -> NDArray[np.int64]:
        """Number of the pair of sweeps, there and back, of each sample."""
        return self.sweep // 2

    def mean_square(self, residual: Floats, rows: Rows) -> Floats:
        """Mean square of each sweep that has rows, N²; NaN for the others, (sweeps,)."""
        count = np.bincount(self.sweep, weights=rows, minlength=self.sweeps)
        total = np.bincount(self.sweep, weights=np.where(rows, residual**2, 0.0), minlength=self.sweeps)
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def motion_of(readings: DialGaugeReadings) -> Motion:
    """The motion in a table of readings.

    Raises:
        UnsupportedDataError: no times, times that do not rise, or too few reversals.
    """
    if not np.all(np.isfinite(readings.time)):
        raise UnsupportedDataError('loops need the time of every row', 'add a column time_s')
    return cut(readings.time, readings.displacement, readings.force)


def cut(time: Floats, displacement: Floats, force: Floats) -> Motion:
    """Cuts a record at its reversals.

    Args:
        time: s, (n,).
        displacement: m, (n,).
        force: N, (n,).

    Raises:
        UnsupportedDataError: see `motion_of`.
    """
    if len(time) < 2 or not np.all(np.diff(time) > 0):
        raise UnsupportedDataError('the time does not rise from row to row', 'give the record in its order')
    if not np.ptp(force) > 0 or not np.ptp(displacement) > 0:
        raise UnsupportedDataError('the force or the displacement never changes', 'record full loops')
    time, displacement, force = (values[_moving(displacement)] for values in (time, displacement, force))
    least = PROMINENCE * float(np.ptp(displacement))
    turns = np.sort(np.concatenate([find_peaks(sign * displacement, prominence=least)[0] for sign in (1, -1)]))
    edges = np.array([0, *(turns + 1).tolist(), len(time)], dtype=np.int64)
    if len(edges) - 1 < FEWEST_SWEEPS or len(time) < _FEWEST_ROWS * (len(edges) - 1):
        found = f'{len(edges) - 1} sweeps of {len(time)} samples in all'
        need = f'{FEWEST_SWEEPS} sweeps of {_FEWEST_ROWS} samples each are needed'
        raise UnsupportedDataError(f'{found}; {need}', 'record more loops, sampled more densely')
    sweep = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    start, last = displacement[np.maximum(edges[:-1] - 1, 0)], displacement[edges[1:] - 1]
    return Motion(
        time=time.copy(),
        displacement=displacement.copy(),
        force=force.copy(),
        edges=edges,
        sweep=sweep,
        sense=np.where(last > start, 1.0, -1.0)[sweep],
        distance=np.abs(displacement - start[sweep]),
        speed=np.gradient(displacement, time),
    )


def _moving(displacement: Floats) -> slice:
    """From where it leaves its first place to where it comes to its last."""
    limit = _STILL * float(np.ptp(displacement))
    first = int(np.argmax(np.abs(displacement - displacement[0]) > limit))
    last = len(displacement) - int(np.argmax(np.abs(displacement - displacement[-1])[::-1] > limit))
    return slice(max(first - 1, 0), last + 1)


def repeatability(motion: Motion) -> float:
    """How well a sweep repeats where the motion does: no law of the displacement alone can do better.

    Sweeps of one sense that begin and end at the same places, one cycle apart; force over the distance,
    standard deviation of one, N. NaN if no motion repeats.
    """
    limit, square, count = _SAME_TURN * motion.travel, 0.0, 0
    start, last = motion.displacement[motion.begins], motion.displacement[motion.edges[1:] - 1]
    for k in range(motion.sweeps - 2):
        if max(abs(start[k + 2] - start[k]), abs(last[k + 2] - last[k])) > limit:
            continue
        one, other = (slice(motion.edges[j], motion.edges[j + 1]) for j in (k, k + 2))
        there = np.maximum.accumulate(motion.distance[other])
        difference = np.interp(motion.distance[one], there, motion.force[other]) - motion.force[one]
        square, count = square + float(difference @ difference) / 2, count + len(difference)
    return float(np.sqrt(square / count)) if count else float('nan')
