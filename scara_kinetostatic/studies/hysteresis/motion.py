"""A measured record of force over displacement, cut into sweeps, each from one reversal of the motion to the next.

Standstill before and after the motion is left out, where errors would be small without meaning. For cross-validation a
law is fitted to half of the sweeps and predicts the other half, in turn. A law with memory needs the initial state: the
first sweep, up to the first reversal, is in every fit and never counts for an error.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.dial_gauge.loop_analysis import PROMINENCE
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings

Rows = NDArray[np.bool_]

FEWEST_SWEEPS = 6
"""Three to fit and three to predict; fewer do not give a variance between sweeps."""
FEWEST_ROWS = 8
"""Mean number of samples of a sweep."""
_STILL = 2e-3
"""Distance from the first or last place, as a share of the range, within which the record is at standstill."""
_SAME_TURN = 0.01
"""Distance of reversals, as a share of the travel, up to which they are at the same place."""


@dataclass(frozen=True)
class Motion:
    """The record; arrays (n,), read-only.

    Attributes:
        time: s, increasing.
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
        """Number of sweeps."""
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
        """All samples but those of the first sweep, which gives every law the initial state."""
        return self.sweep > 0

    @property
    def cycle(self) -> NDArray[np.int64]:
        """Number of the cycle, a pair of sweeps, of each sample."""
        return self.sweep // 2

    def mean_square(self, residual: Floats, rows: Rows) -> Floats:
        """Mean square of each sweep that has rows, N²; NaN for the others, (sweeps,)."""
        count = np.bincount(self.sweep, weights=rows, minlength=self.sweeps)
        total = np.bincount(self.sweep, weights=np.where(rows, residual**2, 0.0), minlength=self.sweeps)
        return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def motion_from_readings(readings: DialGaugeReadings) -> Motion:
    """The motion in a table of readings.

    Raises:
        UnsupportedDataError: no times, times that do not increase, or too few reversals.
    """
    if not np.all(np.isfinite(readings.time)):
        raise UnsupportedDataError('loops need the time of every row', 'add a column time_s')
    return cut_at_reversals(readings.time, readings.displacement, readings.force)


def cut_at_reversals(time: Floats, displacement: Floats, force: Floats) -> Motion:
    """Cuts a record at its reversals.

    Args:
        time: s, (n,).
        displacement: m, (n,).
        force: N, (n,).

    Raises:
        UnsupportedDataError: see `motion_of`.
    """
    if len(time) < 2:
        raise UnsupportedDataError('one sample', 'record full loops')
    if not np.all(np.diff(time) > 0):
        raise UnsupportedDataError('the time does not rise from row to row', 'give the rows in the order of time')
    if not np.ptp(force) > 0 or not np.ptp(displacement) > 0:
        raise UnsupportedDataError('the force or the displacement never changes', 'record full loops')
    time, displacement, force = (values[_moving(displacement)] for values in (time, displacement, force))
    edges = np.array([0, *(reversals(displacement) + 1).tolist(), len(time)], dtype=np.int64)
    if len(edges) - 1 < FEWEST_SWEEPS or len(time) < FEWEST_ROWS * (len(edges) - 1):
        found = f'{len(edges) - 1} sweeps of {len(time)} samples in all'
        need = f'{FEWEST_SWEEPS} sweeps of {FEWEST_ROWS} samples each are needed'
        raise UnsupportedDataError(
            f'{found}; {need}', 'record more loops or faster, or, where the load drives, from rest to rest'
        )
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


def reversals(displacement: Floats) -> NDArray[np.int64]:
    """The samples at which the motion reverses, in the order of time."""
    least = PROMINENCE * float(np.ptp(displacement))
    turns = [find_peaks(sign * displacement, prominence=least)[0] for sign in (1, -1)]
    return np.asarray(np.sort(np.concatenate(turns)), dtype=np.int64)


def _moving(displacement: Floats) -> slice:
    """The rows between standstill at the beginning and standstill at the end."""
    limit = _STILL * float(np.ptp(displacement))
    first = int(np.argmax(np.abs(displacement - displacement[0]) > limit))
    last = len(displacement) - int(np.argmax(np.abs(displacement - displacement[-1])[::-1] > limit))
    return slice(max(first - 1, 0), last + 1)


def repeatability(motion: Motion) -> float:
    """Repeatability of the force where the motion repeats: a lower limit for the error of any law, N.

    Standard deviation of the force over the distance, from sweeps of one sense, one cycle apart, that begin and end at
    the same places. NaN if no motion repeats.
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
