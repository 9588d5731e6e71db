"""The load of a record as the laws need it: counted from rest, smoothed, and passed through operators with memory.

Play operator of half width r (Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989): with the load τ,

    p_k = min(max(p_{k-1}, τ_k - r), τ_k + r).

Each step is a clip, and a clip after a clip is a clip again; so the limits of all steps up to k follow by a parallel
prefix of log2(n) vector operations, whatever the initial state p_0 is.

The friction of a joint follows the load averaged over `SMOOTHING`: a single sample of a jerk, which the inertia of the
arm takes up, does not make it slip.
"""

from __future__ import annotations

from collections.abc import Hashable

import numpy as np
from scipy.ndimage import uniform_filter1d

from scara_kinetostatic.model.arrays import Floats, Mask
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord

SMOOTHING = 0.06
"""Averaging time of the load that friction follows, s: half a period of an arm that vibrates at some 8 Hz."""
LONG_BLOCK = 0.5
"""Length of the blocks whose means do not contain vibrations, s."""
_KEPT = 2_000_000
"""Values kept in arrays of one record, so that they are not computed twice; 16 to 32 MB."""


class LoadPath:
    """Load and response of one record, as measured or as means of blocks.

    Attributes:
        record: the record.
        block: number of samples in a block; 1: as measured.
        time: s, (n,).
        load: counted from its mean at rest, (n,), N or Nm.
        smooth: the same averaged over `SMOOTHING`.
        response: measured, (n,), m or rad.
        size: largest |smooth|.
        rest: before the load comes on, (n,).
        known: before the load is gone for good, (n,).
    """

    def __init__(self, record: LoadRecord, block: int = 1) -> None:
        self.record, self.block = record, block
        self.time, self.load, self.response = map(self._means, (record.time, record.load_change, record.response))
        count = len(self.time) * block
        smooth: Floats = uniform_filter1d(record.load_change, _samples(record), mode='nearest')
        self._every_smooth = smooth
        self.smooth: Floats = smooth[block // 2 : count : block]
        self.size = float(np.abs(smooth).max())
        last = np.arange(block - 1, count, block)
        self.rest: Mask = record.rest[last]
        self.known: Mask = last < record.unloaded
        self._kept: dict[Hashable, tuple[Floats, ...]] = {}

    @classmethod
    def in_blocks(cls, record: LoadRecord) -> LoadPath:
        """Means of blocks of `SMOOTHING`, enough for a fit."""
        return cls(record, _samples(record))

    def play_operator(self, half_width: float, state: float) -> Floats:
        """Output of the play operator, (n,), N or Nm.

        Args:
            half_width: r, N or Nm.
            state: initial output, from -1 to 1 times r.
        """
        key = ('play', half_width)
        if key not in self._kept:
            self._keep(key, *_play_limits(self.smooth, half_width))
        low, high = self._kept[key]
        return np.clip(state * half_width, low, high)

    def jumping_play_operator(self, half_width: float, kinetic: float, state: float) -> Floats:
        """Output of a play operator that jumps: where it slips it moves on until |τ - p| is only kinetic · r."""
        key = ('jump', half_width, kinetic, state)
        if key not in self._kept:
            self._keep(key, _jumping(self.smooth, half_width, kinetic * half_width, state * half_width))
        return self._kept[key][0]

    def lag(self, time_constant: float) -> Floats:
        """The load behind a first-order lag, (n,): T dy/dt = τ - y, at rest at first."""
        key = ('lag', time_constant)
        if key not in self._kept:
            self._keep(key, _lagging(self.load, self.time, time_constant))
        return self._kept[key][0]

    def sign(self, band: float) -> Floats:
        """Sign of the load, linear within a band of so many standard deviations of the load at rest, (n,)."""
        width = band * self.record.load_noise
        change = self.record.load_change
        return self._means(np.clip(change / width, -1.0, 1.0) if width > 0 else np.sign(change))

    def sign_as_given(self) -> Floats:
        """Sign of the load as measured, not counted from rest, (n,)."""
        return self._means(np.sign(self.record.load))

    def last_sign(self, band: float, state: float) -> Floats:
        """Sign of the load where it exceeds a band, else the last such sign; `state` before the first one, (n,)."""
        width = band * self.record.load_noise
        sign = np.where(np.abs(self._every_smooth) > width, np.sign(self._every_smooth), 0.0)
        last = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), -1))
        return self._means(np.where(last >= 0, sign[last], state))

    def _means(self, values: Floats) -> Floats:
        """Means of the blocks."""
        count = len(values) // self.block * self.block
        return np.asarray(values[:count].reshape(-1, self.block).mean(axis=1))

    def long_block(self, samples: int) -> int:
        """Number of samples in a block of `LONG_BLOCK`, or in a quarter of so many samples if that is shorter."""
        return max(min(round(LONG_BLOCK / float(np.median(np.diff(self.time)))), samples // 4), 1)

    def long_means(self, values: Floats) -> Floats:
        """Means of successive long blocks."""
        block = self.long_block(len(values))
        count = len(values) // block
        return np.asarray(values[: count * block].reshape(count, block).mean(axis=1))

    def _keep(self, key: Hashable, *arrays: Floats) -> None:
        if (len(self._kept) + 1) * len(self.time) > _KEPT:
            self._kept.clear()
        self._kept[key] = arrays


def _samples(record: LoadRecord) -> int:
    """Samples in `SMOOTHING`."""
    return max(round(SMOOTHING / float(np.median(np.diff(record.time)))), 1)


def _play_limits(load: Floats, half_width: float) -> tuple[Floats, Floats]:
    """Limits (n,) between which the output lies after each sample, whatever the initial state."""
    low, high = load - half_width, load + half_width
    step = 1
    while step < len(load):
        lower, upper = low[step:], high[step:]
        low = np.concatenate([low[:step], np.clip(low[:-step], lower, upper)])
        high = np.concatenate([high[:step], np.clip(high[:-step], lower, upper)])
        step *= 2
    return low, high


def _jumping(load: Floats, static: float, kinetic: float, start: float) -> Floats:
    output, here = [], start
    for each in load.tolist():
        if each - here > static:
            here = each - kinetic
        elif here - each > static:
            here = each + kinetic
        output.append(here)
    return np.array(output)


def _lagging(load: Floats, time: Floats, time_constant: float) -> Floats:
    share = -np.expm1(-np.diff(time, prepend=time[0]) / time_constant)
    output, here = [], 0.0
    for each, part in zip(load.tolist(), share.tolist(), strict=True):
        here += part * (each - here)
        output.append(here)
    return np.array(output)
