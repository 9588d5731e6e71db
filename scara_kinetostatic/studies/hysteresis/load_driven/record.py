"""A measured record that is driven by its load: at rest first, then loaded, then unloaded, once or several times.

With τ₀ the load at rest, the load is on from the first sample on with |τ − τ₀| > 10 % of its maximum; the rest ends
where it begins to rise there. It is off for good after the last sample with
|τ − τ₀| ≥ 60 % of the maximum: from there on a prediction of the response is judged.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats

UNITS = {'N': 'm', 'Nm': 'rad'}
"""Unit of the response by that of the load."""
UNLOADED_BELOW = 0.6
"""Share of its largest below which the load counts as gone."""

_LOADED_ABOVE = 0.1
"""Share of its largest above which the load counts as on; the rest is searched before it."""
FEWEST_SAMPLES = 50
_FEWEST_AT_REST = 10
"""For the zero of load and response and for their noise, known to about a quarter of itself then."""
_FEWEST_UNLOADED = 10
_SHORTEST = 0.6
"""Shortest record, s: ten times the averaging time of the load that friction follows."""
_LONGEST_STEP = 5.0
"""Steps in time longer than so many medians are gaps: what the load did meanwhile is unknown."""
_NOISE = 7.0
_RANGE = (0.5, 99.5)
"""Range between these percentiles over median step: 5.4 for white noise, more for a load that comes and goes."""
_LARGEST_TREND = 0.05
"""Change of the load over the rest, as a share of its largest; a load that rises steadily from the start has 0.07."""
_ABOVE_NOISE = 5.0
"""In standard deviations of the load at rest: above it the load is on."""
_LIKELY = 5.0
"""Largest decrease of a log-likelihood that is not significant: χ² of 10 with one degree of freedom, p = 0.002."""
_MAD = 1.4826
"""Standard deviation over median absolute deviation, normal distribution."""
CONSTANT_LOAD = 'the load is constant within its noise'
CHECK_LOAD = 'check the column, or record with a load'
_REMEDY = 'record from before the load comes on until after it has gone'


@dataclass(frozen=True)
class LoadRecord:
    """One record; arrays (n,), read-only.

    Attributes:
        source: its file, for messages.
        time: s, increasing, without gaps.
        load: N or Nm.
        response: m or rad.
        load_unit: 'N' or 'Nm'.
        response_unit: 'm' with N, 'rad' with Nm.
        notes: remarks on the file.

    Raises:
        ParameterError: lengths differ, a value is not finite, or the units do not go together.
        UnsupportedDataError: the record is too short, its time does not increase or has a gap, load or response is
            constant, the load is not at rest at first, or does not go off again; `source` is named.
    """

    source: str
    time: Floats
    load: Floats
    response: Floats
    load_unit: str = 'Nm'
    response_unit: str = 'rad'
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if UNITS.get(self.load_unit) != self.response_unit:
            got = f'{self.response_unit} and {self.load_unit}'
            raise ParameterError(self.source, f'expected a response in m and a load in N, or rad and Nm, got {got}')
        for field in fields(self):
            if field.name in ('time', 'load', 'response'):
                array = np.array(getattr(self, field.name), dtype=float)
                if array.shape != np.shape(self.time) or array.ndim != 1 or not np.all(np.isfinite(array)):
                    raise ParameterError(f'{self.source}: {field.name}', 'expected finite numbers, one for each time')
                array.flags.writeable = False
                object.__setattr__(self, field.name, array)
        self._check()

    def __len__(self) -> int:
        return len(self.time)

    @property
    def name(self) -> str:
        """Name of the file without its folder."""
        return Path(self.source).name

    @cached_property
    def rest(self) -> NDArray[np.bool_]:
        """The samples before the load comes on, (n,)."""
        return np.arange(len(self)) < self._loaded

    @cached_property
    def unloaded(self) -> int:
        """The first sample from which on the load stays below 60 % of its largest."""
        return _off_for_good(self.load_change)

    @cached_property
    def load_change(self) -> Floats:
        """Load less its mean at rest, (n,), N or Nm."""
        return np.asarray(self.load - self.load[: self._loaded].mean())

    @cached_property
    def load_noise(self) -> float:
        """Standard deviation of the load at rest, N or Nm."""
        return float(self.load[self.rest].std(ddof=1))

    @cached_property
    def response_noise(self) -> float:
        """Standard deviation of the response at rest, m or rad; 0 where the sensor repeats to the last digit."""
        return float(self.response[self.rest].std(ddof=1))

    @cached_property
    def _loaded(self) -> int:
        return _load_comes_on(self.load)

    def _check(self) -> None:
        if len(self) < FEWEST_SAMPLES:
            self._refuse(f'{len(self)} samples; {FEWEST_SAMPLES} or more are needed', 'record longer or faster')
        self._check_time()
        if not np.ptp(self.response) > 0:
            self._refuse('the response never changes', 'check the column, or record with a finer sensor')
        if is_constant(self.load):
            self._refuse(CONSTANT_LOAD, CHECK_LOAD)
        if not is_at_rest_first(self.load):
            need = f'{_FEWEST_AT_REST} samples or more at rest are needed'
            self._refuse(f'the load is not at rest at first; {need}', _REMEDY)
        if len(self) - self.unloaded < _FEWEST_UNLOADED:
            self._refuse(f'the load never falls below {100 * UNLOADED_BELOW:g} % of its largest for good', _REMEDY)

    def _check_time(self) -> None:
        steps = np.diff(self.time)
        if not np.all(steps > 0):
            first = int(np.argmin(steps > 0))
            jump = f'from {self.time[first]:g} to {self.time[first + 1]:g} s'
            self._refuse(f'the time does not rise from row to row: {jump}', 'give the rows in the order of time')
        if self.time[-1] - self.time[0] < _SHORTEST:
            took = f'it takes {self.time[-1] - self.time[0]:.3g} s; {_SHORTEST:g} s or more are needed'
            self._refuse(took, 'check the unit of the time, or record longer')
        longest = int(np.argmax(steps))
        if steps[longest] > _LONGEST_STEP * np.median(steps):
            gap = f'from {self.time[longest]:g} to {self.time[longest + 1]:g} s'
            self._refuse(f'there is a gap in time {gap}', 'give the parts before and after it as files of their own')

    def _refuse(self, problem: str, remedy: str) -> None:
        raise UnsupportedDataError(f'{self.source}: {problem}', remedy)


def is_at_rest_first(load: Floats) -> bool:
    """Whether the load, (n,), is at rest before it comes on; not if it is constant or noise alone."""
    if len(load) <= _FEWEST_AT_REST or is_constant(load):
        return False
    at_rest = load[: _load_comes_on(load)]
    quarter = len(at_rest) // 4
    if len(at_rest) < _FEWEST_AT_REST:
        return False
    trend = at_rest[-quarter:].mean() - at_rest[:quarter].mean()
    return bool(abs(trend) <= _LARGEST_TREND * np.abs(load - at_rest.mean()).max())


def is_constant(load: Floats) -> bool:
    """Whether the load, (n,), is constant, or changes no more in all than from sample to sample."""
    lowest, highest = np.percentile(load, _RANGE)
    return not np.ptp(load) > 0 or bool(highest - lowest <= _NOISE * np.median(np.abs(np.diff(load))))


def _load_comes_on(load: Floats) -> int:
    """Number of samples at rest at the beginning."""
    change = np.abs(load - np.median(load[:_FEWEST_AT_REST]))
    noise = _MAD * float(np.median(np.abs(np.diff(load)))) / np.sqrt(2.0)
    loaded = int(np.argmax(change > max(_LOADED_ABOVE * change.max(), min(_ABOVE_NOISE * noise, 0.5 * change.max()))))
    return _end_of_rest(load[:loaded]) if loaded > _FEWEST_AT_REST else max(loaded, 1)


def _end_of_rest(load: Floats) -> int:
    """Where a load that is on at the end of these samples, (n,), begins to rise: the change point.

    The samples before it are a constant, those from it on a straight line, with normal scatter. Of all change points
    whose log-likelihood is not significantly below the largest, the last one counts.
    """
    load = load - load.mean()
    place = np.arange(len(load))
    ends = np.arange(2, len(load) + 1)
    sums = [np.concatenate([[0.0], np.cumsum(each)]) for each in (load, load**2, place * load)]
    first, square, moment = sums
    constant = square[ends] - first[ends] ** 2 / ends
    count = np.maximum(len(load) - ends, 1)
    middle = (len(load) + ends - 1) / 2
    rest, slope = first[-1] - first[ends], moment[-1] - moment[ends] - middle * (first[-1] - first[ends])
    line = square[-1] - square[ends] - rest**2 / count - slope**2 / np.maximum(count * (count**2 - 1) / 12, 1e-300)
    line = np.where(count > 1, np.maximum(line, 0.0), 0.0)
    total = np.maximum(constant + line, 1e-12 * square[-1])
    likelihood = -len(load) / 2 * np.log(total) if square[-1] > 0 else np.zeros(len(ends))
    return int(ends[np.flatnonzero(likelihood >= likelihood.max() - _LIKELY)[-1]])


def _off_for_good(change: Floats) -> int:
    size = np.abs(change)
    return int(np.flatnonzero(size >= UNLOADED_BELOW * size.max())[-1]) + 1
