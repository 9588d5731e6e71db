"""A record in loops, cut into sweeps, each from one reversal of what drives, motion or load, to the next.

Standstill before and after a motion is left out, where errors would be small without meaning. For cross-validation a
law is fitted to half of the sweeps and predicts the other half, in turn. A law with memory needs the initial state: the
first sweep, up to the first reversal, is in every fit and never counts for an error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.loops.record import FEWEST_ROWS, FEWEST_SWEEPS, MOTION, Record
from scara_kinetostatic.studies.loops.reversals import reversals


@dataclass(frozen=True)
class Motion:
    """The moving part of a record driven by its motion, or all of one driven by its load; arrays (n,).

    Attributes:
        record: the record.
        time: s, increasing.
        driver: what drives, the displacement (m, rad) or the load (N, Nm).
        driven: the other one.
        edges: first sample of each sweep, and n, (sweeps + 1,); the sample at a reversal is the last of its sweep.
        sweep: number of the sweep of each sample.
        sense: of the driver, +1 or -1.
        distance: of the driver since the reversal.
        speed: of the driver, signed, per second.
        driven_by: `MOTION` or `LOAD`.
    """

    record: Record
    time: Floats
    driver: Floats
    driven: Floats
    edges: NDArray[np.int64]
    sweep: NDArray[np.int64]
    sense: Floats
    distance: Floats
    speed: Floats
    driven_by: str = MOTION

    def __len__(self) -> int:
        return len(self.time)

    @property
    def sweeps(self) -> int:
        """Number of sweeps."""
        return len(self.edges) - 1

    @property
    def travel(self) -> float:
        """Range of the driver."""
        return float(np.ptp(self.driver))

    @property
    def driven_range(self) -> float:
        """Range of what is driven."""
        return float(np.ptp(self.driven))

    @property
    def earlier(self) -> Mask:
        """The samples of the first half of the sweeps."""
        return self.sweep < self.sweeps // 2

    @property
    def scored(self) -> Mask:
        """All samples but those of the first sweep, which gives every law the initial state."""
        return self.sweep > 0

    @property
    def cycle(self) -> NDArray[np.int64]:
        """Number of the cycle, a pair of sweeps, of each sample."""
        return self.sweep // 2


def cut_at_reversals(record: Record, driven_by: str = MOTION) -> Motion:
    """Cuts a record at the reversals of what drives.

    Raises:
        UnsupportedDataError: there are too few; the file is named.
    """
    moving = _moving(record.response) if driven_by == MOTION else slice(None)
    time, *pair = (each[moving] for each in (record.time, record.response, record.load))
    driver, driven = pair if driven_by == MOTION else pair[::-1]
    edges = np.array([0, *(reversals(driver) + 1).tolist(), len(time)], dtype=np.int64)
    sweeps = len(edges) - 1
    if sweeps < FEWEST_SWEEPS or len(time) < FEWEST_ROWS * sweeps:
        need = f'{FEWEST_SWEEPS} sweeps of {FEWEST_ROWS} samples each are needed'
        problem = f'{record.source}: {sweeps} sweeps of {len(time)} samples in all; {need}'
        raise UnsupportedDataError(problem, 'record more loops or faster, or, where the load drives, from rest to rest')
    sweep = np.repeat(np.arange(sweeps), np.diff(edges))
    start, last = driver[np.maximum(edges[:-1] - 1, 0)], driver[edges[1:] - 1]
    return Motion(
        record=record,
        time=time,
        driver=driver,
        driven=driven,
        edges=edges,
        sweep=sweep,
        sense=np.where(last > start, 1.0, -1.0)[sweep],
        distance=np.abs(driver - start[sweep]),
        speed=np.gradient(driver, time),
        driven_by=driven_by,
    )


def _moving(displacement: Floats) -> slice:
    """The rows between standstill at the beginning and standstill at the end."""
    limit = 2e-3 * float(np.ptp(displacement))
    first = int(np.argmax(np.abs(displacement - displacement[0]) > limit))
    last = len(displacement) - int(np.argmax(np.abs(displacement - displacement[-1])[::-1] > limit))
    return slice(max(first - 1, 0), last + 1)


def repeatability(motion: Motion) -> float:
    """Repeatability of the force where the motion repeats: a lower limit for the error of any law, N or Nm.

    Standard deviation of the force over the distance, from sweeps of one sense, one cycle apart, that begin and end at
    the same places, but for 1 % of the travel. NaN if no motion repeats.
    """
    square, count = 0.0, 0
    turns = np.append(motion.driver[np.maximum(motion.edges[:-1] - 1, 0)], motion.driver[-1])
    for k in range(motion.sweeps - 2):
        if np.abs(turns[k + 2 : k + 4] - turns[k : k + 2]).max() > 0.01 * motion.travel:
            continue
        one, other = (slice(motion.edges[j], motion.edges[j + 1]) for j in (k, k + 2))
        there = np.maximum.accumulate(motion.distance[other])
        difference = np.interp(motion.distance[one], there, motion.driven[other]) - motion.driven[one]
        square, count = square + float(difference @ difference) / 2, count + len(difference)
    return float(np.sqrt(square / count)) if count else float('nan')
