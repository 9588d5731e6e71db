"""A record driven by its motion, cut into sweeps, each from one reversal of the motion to the next.

Standstill before and after the motion is left out, where errors would be small without meaning. For cross-validation a
law is fitted to half of the sweeps and predicts the other half, in turn. A law with memory needs the initial state: the
first sweep, up to the first reversal, is in every fit and never counts for an error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.dial_gauge.loop_analysis import reversals
from scara_kinetostatic.studies.hysteresis.record import FEWEST_ROWS, FEWEST_SWEEPS, Record


@dataclass(frozen=True)
class Motion:
    """The moving part of a record; arrays (n,).

    Attributes:
        record: the record.
        time: s, increasing.
        displacement: m or rad.
        force: N or Nm.
        edges: first sample of each sweep, and n, (sweeps + 1,); the sample at a reversal is the last of its sweep.
        sweep: number of the sweep of each sample.
        sense: of the motion, +1 or -1.
        distance: since the reversal, m or rad.
        speed: of the displacement, signed, m/s or rad/s.
    """

    record: Record
    time: Floats
    displacement: Floats
    force: Floats
    edges: NDArray[np.int64]
    sweep: NDArray[np.int64]
    sense: Floats
    distance: Floats
    speed: Floats

    def __len__(self) -> int:
        return len(self.time)

    @property
    def sweeps(self) -> int:
        """Number of sweeps."""
        return len(self.edges) - 1

    @property
    def travel(self) -> float:
        """Range of the displacement, m or rad."""
        return float(np.ptp(self.displacement))

    @property
    def force_range(self) -> float:
        """Range of the force, N or Nm."""
        return float(np.ptp(self.force))

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


def cut_at_reversals(record: Record) -> Motion:
    """Cuts a record at its reversals.

    Raises:
        UnsupportedDataError: there are too few; the file is named.
    """
    moving = _moving(record.response)
    time, displacement, force = record.time[moving], record.response[moving], record.load[moving]
    edges = np.array([0, *(reversals(displacement) + 1).tolist(), len(time)], dtype=np.int64)
    sweeps = len(edges) - 1
    if sweeps < FEWEST_SWEEPS or len(time) < FEWEST_ROWS * sweeps:
        need = f'{FEWEST_SWEEPS} sweeps of {FEWEST_ROWS} samples each are needed'
        problem = f'{record.source}: {sweeps} sweeps of {len(time)} samples in all; {need}'
        raise UnsupportedDataError(problem, 'record more loops or faster, or, where the load drives, from rest to rest')
    sweep = np.repeat(np.arange(sweeps), np.diff(edges))
    start, last = displacement[np.maximum(edges[:-1] - 1, 0)], displacement[edges[1:] - 1]
    return Motion(
        record=record,
        time=time,
        displacement=displacement,
        force=force,
        edges=edges,
        sweep=sweep,
        sense=np.where(last > start, 1.0, -1.0)[sweep],
        distance=np.abs(displacement - start[sweep]),
        speed=np.gradient(displacement, time),
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
    turns = np.append(motion.displacement[np.maximum(motion.edges[:-1] - 1, 0)], motion.displacement[-1])
    for k in range(motion.sweeps - 2):
        if np.abs(turns[k + 2 : k + 4] - turns[k : k + 2]).max() > 0.01 * motion.travel:
            continue
        one, other = (slice(motion.edges[j], motion.edges[j + 1]) for j in (k, k + 2))
        there = np.maximum.accumulate(motion.distance[other])
        difference = np.interp(motion.distance[one], there, motion.force[other]) - motion.force[one]
        square, count = square + float(difference @ difference) / 2, count + len(difference)
    return float(np.sqrt(square / count)) if count else float('nan')
