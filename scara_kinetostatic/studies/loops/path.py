"""A record along what drives it, its motion or its load, as the laws need it: with sweeps, and operators with memory.

Driven by its load it is counted from rest, and friction follows the load averaged over `SMOOTHING`: a single sample of
a jerk, which the inertia of the arm takes up, does not make a joint slip. Driven by its motion, standstill before and
after it is left out, where errors would be small without meaning.

Loops are cut into sweeps, each from one reversal of what drives to the next. The first sweep, up to the first reversal,
gives a law with memory its initial state: of a motion it is in every fit, and it never counts for an error.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats, Indices, Mask
from scara_kinetostatic.model.play_operator import play_limits, play_range
from scara_kinetostatic.studies.loops.record import (
    FEWEST_ROWS,
    FEWEST_SWEEPS,
    LOAD,
    MOTION,
    Record,
    check_driven_by_load,
    reversals,
)

SMOOTHING = 0.06
"""Averaging time of the load that friction follows, s: half a period of an arm that vibrates at some 8 Hz."""


class RecordPath:
    """What drives and what is driven in one record, as measured or as means of blocks; arrays (n,).

    Attributes:
        record: the record.
        driven_by: `LOAD` or `MOTION`.
        block: number of samples in a block, `SMOOTHING` where the load drives, enough for a fit; 1: as measured.
        direction: +1 or -1: sign of what is driven under a positive driver.
        time: s.
        driver: the load counted from its mean at rest (N, Nm), or the displacement (m, rad).
        driven: the other one, as measured.
        smooth: the driver averaged over `SMOOTHING` where it is a load.
        size: largest |smooth|, of a motion its range.
        rest: before the load comes on.
        known: what a prediction may use of it, `Record.judged_from`; all of a motion.
        in_loops: whether it has sweeps; only then is what follows of use, of the samples as measured.
        edges: first sample of each sweep, and n, (sweeps + 1,); the sample at a reversal is the last of its sweep.
        sweep: number of the sweep of each sample, or of each block by its first one.
        sense: of the driver, +1 or -1.
        distance: of the driver since the reversal.
        speed: of the driver, signed, per second.

    Raises:
        UnsupportedDataError: there are too few sweeps; see `check_driven_by_load`.
    """

    def __init__(self, record: Record, driven_by: str = LOAD, in_blocks: bool = False, direction: float = 1.0) -> None:
        self.record, self.driven_by, self.direction = record, driven_by, direction
        self.in_loops = driven_by == MOTION or not record.is_at_rest_first
        if driven_by == LOAD:
            check_driven_by_load(record)
            driver, driven, time = record.load_change, record.response, record.time
            samples = max(round(SMOOTHING / float(np.median(np.diff(time)))), 1)
            smooth: Floats = uniform_filter1d(driver, samples, mode='nearest')
        else:
            moving = _moving(record.response)
            driver, driven, time = record.response[moving], record.load[moving], record.time[moving]
            smooth, samples = driver, 1
        self.block = block = samples if in_blocks else 1
        count = len(driver) // block * block
        self._middle = slice(block // 2, count, block)
        self.time, self.driver, self.driven = map(self._means, (time, driver, driven))
        self._every_smooth, self.smooth = smooth, smooth[self._middle]
        self.size = float(np.abs(smooth).max() if driven_by == LOAD else np.ptp(driver))
        last = np.arange(block - 1, count, block)
        self.rest: Mask = record.rest[last] if driven_by == LOAD else np.zeros(len(last), dtype=bool)
        self.known: Mask = last < (record.judged_from if driven_by == LOAD else len(driver))
        self._ranges: dict[tuple[float, float], tuple[Floats, Floats]] = {}
        if self.in_loops:
            self._cut(driver, time, count)

    def _cut(self, driver: Floats, time: Floats, count: int) -> None:
        """Cuts the samples at the reversals of what drives."""
        self.edges = edges = np.array([0, *(reversals(driver) + 1).tolist(), len(driver)])
        sweeps = len(edges) - 1
        if sweeps < FEWEST_SWEEPS or len(driver) < FEWEST_ROWS * sweeps:
            need = f'{FEWEST_SWEEPS} sweeps of {FEWEST_ROWS} samples each are needed'
            problem = f'{self.record.source}: {sweeps} sweeps of {len(driver)} samples in all; {need}'
            remedy = 'record more loops or faster, or, where the load drives, from rest to rest'
            raise UnsupportedDataError(problem, remedy)
        sweep = np.repeat(np.arange(sweeps), np.diff(edges))
        start, end = driver[np.maximum(edges[:-1] - 1, 0)], driver[edges[1:] - 1]
        self.sweep = sweep[: count : self.block]
        self.sense = np.where(end > start, 1.0, -1.0)[sweep]
        self.distance = np.abs(driver - start[sweep])
        self.speed: Floats = np.gradient(driver, time)

    @property
    def sweeps(self) -> int:
        """Number of sweeps."""
        return len(self.edges) - 1

    @property
    def cycle(self) -> Indices:
        """Number of the cycle, a pair of sweeps, of each sample."""
        return self.sweep // 2

    @property
    def scored(self) -> Mask:
        """All samples but those of the first sweep."""
        return np.asarray(self.sweep > 0)

    @property
    def earlier(self) -> Mask:
        """The samples of the first half of the sweeps of a motion, or of the time of a load."""
        if self.driven_by == MOTION:
            return np.asarray(self.sweep < self.sweeps // 2)
        return np.asarray(self.time < (self.time[0] + self.time[-1]) / 2)

    @property
    def halves(self) -> tuple[Mask, ...]:
        """What a fit uses that predicts the other samples: either half of loops, else the earlier one."""
        if self.driven_by == MOTION:
            return self.earlier | ~self.scored, ~self.earlier | ~self.scored
        return (self.earlier, ~self.earlier) if self.in_loops else (self.earlier,)

    def play_operator(self, half_width: float, state: float, ratio: float = 0.0) -> Floats:
        """Output of the play operator (`model.play_operator`), (n,), in the unit of the driver.

        Args:
            half_width: r, in the unit of the driver.
            state: initial output, from -1 to 1: the least to the largest that no load, in loops the first, allows.
            ratio: μ.
        """
        shape = (half_width, ratio)
        if shape not in self._ranges:  # a fit asks for many states of one or two shapes
            if len(self._ranges) > 8:
                self._ranges.clear()
            if self.rest.any():
                self._ranges[shape] = play_range(self.smooth, half_width, ratio)
            else:  # loops turn round between the middles of blocks
                limits = play_range(self._every_smooth, half_width, ratio)
                self._ranges[shape] = limits[0][self._middle], limits[1][self._middle]
        low, high = self._ranges[shape]
        first = np.zeros(()) if self.rest.any() else self._every_smooth[0]
        least, most = play_limits(first, half_width, ratio)
        return np.clip(least + (most - least) * (state + 1) / 2, low, high)

    def sign(self, band: float) -> Floats:
        """Sign of the load, linear within a band of so many standard deviations of the load at rest, (n,)."""
        width = band * self.record.noise(self.record.load)
        change = self.record.load_change
        return self._means(np.clip(change / width, -1.0, 1.0) if width > 0 else np.sign(change))

    def sign_as_given(self) -> Floats:
        """Sign of the load as measured, not counted from rest, (n,)."""
        return self._means(np.sign(self.record.load))

    def last_sign(self, band: float, state: float) -> Floats:
        """Sign of the load where it exceeds a band, else the last such sign; `state` before the first one, (n,)."""
        width = band * self.record.noise(self.record.load)
        sign = np.where(np.abs(self._every_smooth) > width, np.sign(self._every_smooth), 0.0)
        last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), -1))
        return self._means(np.where(last >= 0, sign[last], state))

    def _means(self, values: Floats) -> Floats:
        """Means of the blocks; in loops, whose load moves on, the values in their middle."""
        return values[self._middle] if self.in_loops else block_means(values, self.block)

    def long_block(self, samples: int) -> int:
        """Number of samples in half a second, whose mean has no vibrations, or in a quarter of so many samples."""
        return max(min(round(0.5 / float(np.median(np.diff(self.time)))), samples // 4), 1)


def block_means(values: Floats, block: int) -> Floats:
    """Means of successive blocks of samples, without an incomplete last one."""
    count = len(values) // block * block
    return np.asarray(values[:count].reshape(-1, block).mean(axis=1))


def _moving(displacement: Floats) -> slice:
    """The rows between standstill at the beginning and standstill at the end."""
    limit = 2e-3 * float(np.ptp(displacement))
    first = int(np.argmax(np.abs(displacement - displacement[0]) > limit))
    last = len(displacement) - int(np.argmax(np.abs(displacement - displacement[-1])[::-1] > limit))
    return slice(max(first - 1, 0), last + 1)


def repeatability(path: RecordPath) -> float:
    """Repeatability of what is driven where the motion repeats: a lower limit for the error of any law, in its unit.

    Standard deviation over the distance, from sweeps of one sense, one cycle apart, that begin and end at the same
    places, but for 1 % of the travel. NaN if no motion repeats.
    """
    square, count = 0.0, 0
    turns = np.append(path.driver[np.maximum(path.edges[:-1] - 1, 0)], path.driver[-1])
    for k in range(path.sweeps - 2):
        if np.abs(turns[k + 2 : k + 4] - turns[k : k + 2]).max() > 0.01 * path.size:
            continue
        one, other = (slice(path.edges[j], path.edges[j + 1]) for j in (k, k + 2))
        there = np.maximum.accumulate(path.distance[other])
        difference = np.interp(path.distance[one], there, path.driven[other]) - path.driven[one]
        square, count = square + float(difference @ difference) / 2, count + len(difference)
    return float(np.sqrt(square / count)) if count else float('nan')
