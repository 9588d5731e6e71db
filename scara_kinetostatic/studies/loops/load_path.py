"""A record driven by its load as the laws need it: counted from rest, smoothed, passed through operators with memory.

The friction of a joint follows the load averaged over `SMOOTHING`: a single sample of a jerk, which the inertia of the
arm takes up, does not make it slip.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.model.play_operator import play_limits, play_range
from scara_kinetostatic.studies.loops.record import Record, check_driven_by_load

SMOOTHING = 0.06
"""Averaging time of the load that friction follows, s: half a period of an arm that vibrates at some 8 Hz."""


class LoadPath:
    """Load and response of one record, as measured or as means of blocks.

    Attributes:
        record: the record.
        block: number of samples in a block; 1: as measured.
        direction: +1 or -1: sign of the response to a positive load.
        time: s, (n,).
        load: counted from its mean at rest, (n,), N or Nm.
        smooth: the same averaged over `SMOOTHING`.
        response: measured, (n,), m or rad.
        size: largest |smooth|.
        rest: before the load comes on, (n,).
        known: what a prediction may use of it, `Record.judged_from`, (n,).

    Raises:
        UnsupportedDataError: see `check_driven_by_load`.
    """

    def __init__(self, record: Record, block: int = 1, direction: float = 1.0) -> None:
        check_driven_by_load(record)
        self.record, self.block, self.direction = record, block, direction
        count = len(record) // block * block
        self._middle = slice(block // 2, count, block)
        self.time, self.load, self.response = map(self._means, (record.time, record.load_change, record.response))
        self._every_smooth: Floats = uniform_filter1d(record.load_change, _samples(record), mode='nearest')
        self.smooth: Floats = self._every_smooth[self._middle]
        self.size = float(np.abs(self._every_smooth).max())
        last = np.arange(block - 1, count, block)
        self.rest: Mask = record.rest[last]
        self.known: Mask = last < record.judged_from
        self._ranges: dict[tuple[float, float], tuple[Floats, Floats]] = {}

    @classmethod
    def in_blocks(cls, record: Record) -> LoadPath:
        """Means of blocks of `SMOOTHING`, enough for a fit."""
        return cls(record, _samples(record))

    @property
    def earlier(self) -> Mask:
        """The samples of the first half of the time."""
        return np.asarray(self.time < (self.time[0] + self.time[-1]) / 2)

    def play_operator(self, half_width: float, state: float, ratio: float = 0.0) -> Floats:
        """Output of the play operator (`model.play_operator`), (n,), N or Nm.

        Args:
            half_width: r, N or Nm.
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
        return block_means(values, self.block) if self.record.is_at_rest_first else values[self._middle]

    def long_block(self, samples: int) -> int:
        """Number of samples in half a second, whose mean has no vibrations, or in a quarter of so many samples."""
        return max(min(round(0.5 / float(np.median(np.diff(self.time)))), samples // 4), 1)


def block_means(values: Floats, block: int) -> Floats:
    """Means of successive blocks of samples, without an incomplete last one."""
    count = len(values) // block * block
    return np.asarray(values[:count].reshape(-1, block).mean(axis=1))


def _samples(record: Record) -> int:
    """Samples in `SMOOTHING`."""
    return max(round(SMOOTHING / float(np.median(np.diff(record.time)))), 1)
