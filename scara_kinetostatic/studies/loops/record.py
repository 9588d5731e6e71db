"""A record of a load and a response; what drives it; and its path along that, as the laws need it.

A column such as `commanded_Nm` says what drives: a commanded load or a commanded response. Without one, driven by its
motion is a record of full loops: six sweeps or more between the reversals of the response, of comparable extent; the
load is predicted. Driven by its load is one whose load is at rest at first, comes on and goes off again, once or a few
times; the response is predicted. Full loops after a rest are those of a load put on again and again where the load
keeps to one side of its rest; a motion back and forth meets it on both.

A load may drive loops as well, and need not be at rest then: six sweeps or more between its reversals. It is counted
from its zero, and a prediction is judged from the end of the first third of the samples on.

Otherwise, with τ₀ the load at rest, the load is on from the first sample on with |τ − τ₀| > 10 % of its maximum; the
rest ends where it begins to rise there. It is off for good after the last sample with |τ − τ₀| ≥ 60 % of the maximum:
from there on a prediction of the response is judged.

**Path.** Driven by its load it is counted from rest, and friction follows the load averaged over `SMOOTHING`: a single
sample of a jerk, which the inertia of the arm takes up, does not make a joint slip. Driven by its motion, standstill
before and after it is left out, where errors would be small without meaning. Loops are cut into sweeps, each from one
reversal of what drives to the next. The first sweep, up to the first reversal, gives a law with memory its initial
state: of a motion it is in every fit, and it never counts for an error.

The columns of a record are the response, the load and the time among any others, by their names or those chosen. A
displacement goes with a force, an angle with a torque. A heading such as `q2_rad` or `tau2_ext_Nm` tells the number of
its joint: the columns of two joints do not go together. A column such as `commanded_Nm` says what drives.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import find_peaks

from scara_kinetostatic.errors import ParameterError, RecordingError, UnsupportedDataError
from scara_kinetostatic.files import tables
from scara_kinetostatic.files.tables import Field, Place, Sheet, load_table, split_heading
from scara_kinetostatic.model.arrays import Floats, Indices, Mask, read_only
from scara_kinetostatic.model.joint_law import place_in_band
from scara_kinetostatic.model.play_operator import play_limits, play_range

MOTION, LOAD = 'motion', 'load'
FEWEST_SWEEPS = 6
"""Three to fit and three to predict; fewer do not give a variance between sweeps."""
FEWEST_ROWS = 8
"""Mean number of samples of a sweep."""
UNLOADED_BELOW = 0.6
"""Share of its largest below which the load counts as gone."""
LEVEL = 0.01
"""Probability of a false alarm, such as one where law (6) is right; several tests of the same data share it."""
_FEWEST_AT_REST = 10
"""For the zero of load and response and for their noise, known to about a quarter of itself then."""
SMOOTHING = 0.06
"""Averaging time of the load that friction follows, s: half a period of an arm that vibrates at some 8 Hz."""


@dataclass(frozen=True)
class Record:
    """A record; arrays (n,), read-only.

    Attributes:
        source: its file, for messages.
        time: s, increasing.
        load: N or Nm.
        response: m where the load is a force, rad where it is a torque.
        load_unit: 'N' or 'Nm'.
        driven_by: `LOAD` or `MOTION` where a column of commands says so, else empty.

    Raises:
        UnsupportedDataError: the time does not rise, or the load or the response never changes; `source` is named.
    """

    source: str
    time: Floats
    load: Floats
    response: Floats
    load_unit: str = 'Nm'
    driven_by: str = ''

    def __post_init__(self) -> None:
        for name in ('time', 'load', 'response'):
            object.__setattr__(self, name, read_only(np.array(getattr(self, name), dtype=float)))
        rises = np.diff(self.time) > 0
        if not np.all(rises):
            first = int(np.argmin(rises))
            jump = f'from {self.time[first]:g} to {self.time[first + 1]:g} s'
            problem = f'{self.source}: the time does not rise from row to row: {jump}'
            raise UnsupportedDataError(problem, 'give the rows in the order of time')
        for name in ('load', 'response'):
            if not np.ptp(getattr(self, name)) > 0:
                raise UnsupportedDataError(f'{self.source}: the {name} never changes', 'check the column')

    def __len__(self) -> int:
        return len(self.time)

    @property
    def name(self) -> str:
        """Name of the file without its folder."""
        return Path(self.source).name

    def unit(self, linear: str) -> str:
        """The SI unit of a quantity, from that for a force over a displacement, such as 'm/N'."""
        return linear if self.load_unit == 'N' else linear.translate({ord('N'): 'Nm', ord('m'): 'rad'})

    def words(self, text: str) -> str:
        """The text with {load} and {response} in words."""
        load, response = ('force', 'displacement') if self.load_unit == 'N' else ('torque', 'angle')
        return text.format(load=load, response=response)

    @cached_property
    def is_at_rest_first(self) -> bool:
        """Whether the load is at rest at first, and not one of full loops that a column says it drives."""
        return is_at_rest_first(self.load) and not (self.driven_by and _has_full_loops(self))

    @cached_property
    def rest(self) -> Mask:
        """The samples before the load comes on, (n,); none in loops."""
        return np.arange(len(self)) < (_load_comes_on(self.load) if self.is_at_rest_first else 0)

    @cached_property
    def judged_from(self) -> int:
        """The first sample from which on the load stays below 60 % of its largest, or that after a third of loops."""
        if not self.is_at_rest_first:
            return len(self) // 3
        size = np.abs(self.load_change)
        return int(np.flatnonzero(size >= UNLOADED_BELOW * size.max())[-1]) + 1

    @cached_property
    def load_change(self) -> Floats:
        """Load less its mean at rest, in loops less nothing, (n,), N or Nm."""
        return np.asarray(self.load - (self.load[self.rest].mean() if self.is_at_rest_first else 0.0))

    @cached_property
    def response_change(self) -> Floats:
        """Response less its mean at rest, in loops less that of all samples, (n,), m or rad."""
        rows = self.rest if self.is_at_rest_first else slice(None)
        return np.asarray(self.response - self.response[rows].mean())

    def noise(self, values: Floats) -> float:
        """Standard deviation of a column at rest, in loops from its differences, in its unit."""
        if self.is_at_rest_first:
            return float(values[self.rest].std(ddof=1))
        return noise_of(values)


def check_alike(records: Sequence[Record]) -> None:
    """Checks that the records may be of one joint.

    Raises:
        RecordingError: their units differ; the first other one is named.
    """
    first = records[0]
    for each in records[1:]:
        if each.load_unit != first.load_unit:
            problem = f'its load is in {each.load_unit}, that of {first.source} in {first.load_unit}'
            raise RecordingError(each.source, problem, 'give records of one joint')


def what_drives(records: Sequence[Record]) -> str:
    """What drives the records, as their columns say, else as they look: `LOAD` or `MOTION`.

    Loops look driven by their motion; beside a record whose load comes on from rest their load drives them as well.

    Raises:
        ParameterError: the columns of one record say the load, those of another one the motion.
    """
    stated = {each.driven_by: each.source for each in records if each.driven_by}
    if len(stated) > 1:
        problem = f'driven by its motion, but {stated[LOAD]} by its load'
        raise ParameterError(stated[MOTION], problem, 'give records of one kind, or say which by --driven')
    return LOAD if LOAD in stated or (not stated and any(map(_looks_driven_by_load, records))) else MOTION


def _looks_driven_by_load(record: Record) -> bool:
    lowest, highest = np.percentile(record.load - record.load[0], (2, 98))  # impacts are left out
    is_one_sided = min(-lowest, highest) < 0.25 * max(-lowest, highest)
    return is_at_rest_first(record.load) and bool(is_one_sided or not _has_full_loops(record))


def _has_full_loops(record: Record) -> bool:
    """Whether there are six sweeps or more of comparable extent."""
    response = record.response
    extents = np.abs(np.diff(response[[0, *reversals(response).tolist(), len(response) - 1]]))
    # the median extent is 0.5 of the range where the amplitude grows evenly
    is_alike = np.median(extents) >= 0.4 * np.ptp(response)
    return bool(is_alike and FEWEST_SWEEPS <= len(extents) <= len(response) / FEWEST_ROWS)


def check_driven_by_load(record: Record) -> None:
    """Checks that a record can be driven by its load.

    Raises:
        UnsupportedDataError: the record is too short or has a gap in time; the load is constant, or neither loops nor
            is at rest at first and goes off again; the loops give out energy; `source` is named.
    """
    steps, took = np.diff(record.time), record.time[-1] - record.time[0]
    longest = int(np.argmax(steps))
    gap = f'there is a gap in time from {record.time[longest]:g} to {record.time[longest + 1]:g} s'
    in_loops = not record.is_at_rest_first
    turns = len(reversals(record.load)) if in_loops else 0
    neither = (
        f'the load is not at rest at first, {_FEWEST_AT_REST} samples or more, or constant within its noise, and '
        f'reverses {turns} times; loops need {FEWEST_SWEEPS - 1} reversals'
    )
    # the area of loops of response over load that run the wrong way round, beyond 2 % of load times response
    load, response = record.load - record.load.mean(), record.response - record.response.mean()
    work = float(np.sum((load[1:] + load[:-1]) / 2 * np.diff(response))) * np.sign(load @ response)
    size = np.ptp(load) * np.ptp(response)
    ahead = record.words('the {response} runs ahead of the {load}, as if the joint gave out energy')
    remedy = 'record from before the load comes on until after it has gone'
    unit = 'check the unit of the time, or record longer'
    checks = (
        (len(record) < 50, f'{len(record)} samples; 50 or more are needed', 'record longer or faster'),
        # ten times the averaging time of the load that friction follows
        (took < 0.6, f'it takes {took:.3g} s; 0.6 s or more are needed', unit),
        # what the load did meanwhile is unknown
        (steps[longest] > 5 * np.median(steps), gap, 'give the parts before and after it as files of their own'),
        (in_loops and not FEWEST_SWEEPS - 1 <= turns < len(record) // FEWEST_ROWS, neither, f'{remedy}, or more loops'),
        (len(record) - record.judged_from < 10, 'the load never falls below 60 % of its largest for good', remedy),
        (in_loops and work < -0.02 * size, ahead, 'check whether the two columns are swapped'),
    )
    for is_wrong, problem, what_to_do in checks:
        if is_wrong:
            raise UnsupportedDataError(f'{record.source}: {problem}', what_to_do)


def reversals(values: Floats) -> Indices:
    """The samples at which a displacement or a load, (n,), reverses, in the order of time."""
    least = 0.03 * float(np.ptp(values))  # prominence
    peaks = [find_peaks(sign * values, prominence=least)[0] for sign in (1, -1)]
    return np.sort(np.concatenate(peaks))


def is_at_rest_first(load: Floats) -> bool:
    """Whether the load, (n,), is at rest before it comes on; not if it is constant or noise alone."""
    lowest, highest = np.percentile(load, (0.5, 99.5))
    # range over median step is 5.4 for white noise, more for a load that comes and goes
    if len(load) <= _FEWEST_AT_REST or highest - lowest <= 7 * np.median(np.abs(np.diff(load))):
        return False
    at_rest = load[: _load_comes_on(load)]
    if len(at_rest) < _FEWEST_AT_REST:
        return False
    quarter = len(at_rest) // 4
    trend = at_rest[-quarter:].mean() - at_rest[:quarter].mean()
    # a load that rises steadily from the start has 0.07
    return bool(abs(trend) <= 0.05 * np.abs(load - at_rest.mean()).max())


def _load_comes_on(load: Floats) -> int:
    """Number of samples at rest at the beginning: before a load above 10 % of its largest and 5 standard deviations.

    The rest ends where a cumulative sum of the load less 1.25 standard deviations of its noise turns upwards for good
    (Page, Biometrika 41, 1954): the zero, a median of ten samples, is off by some 0.4 of them.
    """
    change = load - np.median(load[:_FEWEST_AT_REST])
    size = np.abs(change)
    loaded = int(np.argmax(size > max(0.1 * size.max(), min(5 * noise_of(load), 0.5 * size.max()))))
    rising = np.cumsum(np.sign(change[loaded]) * change[:loaded] - 1.25 * noise_of(load[: loaded + 1]))
    return max(loaded - int(np.argmin(rising[::-1])), 1) if loaded else 1


def noise_of(values: Floats) -> float:
    """Standard deviation of white noise on a signal that changes slowly, by the median of its differences."""
    return 1.4826 * float(np.median(np.abs(np.diff(values)))) / np.sqrt(2.0) if len(values) > 1 else 0.0


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
        loaded: what is known under a load of at least `UNLOADED_BELOW` of the largest.
        earlier: the samples of the first half of the sweeps of a motion, or of the time of a load.
        in_loops: whether it has sweeps; only then is what follows of use, of the samples as measured.
        sweeps: number of sweeps.
        edges: first sample of each sweep, and n, (sweeps + 1,); the sample at a reversal is the last of its sweep.
        sweep: number of the sweep of each sample, or of each block by its first one.
        scored: all samples but those of the first sweep.
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
            # without standstill at the beginning and at the end
            limit, way = 2e-3 * float(np.ptp(record.response)), record.response
            first = int(np.argmax(np.abs(way - way[0]) > limit))
            still = int(np.argmax(np.abs(way - way[-1])[::-1] > limit))
            moving = slice(max(first - 1, 0), len(way) - still + 1)
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
        self.loaded: Mask = self.known & (np.abs(self.smooth) >= UNLOADED_BELOW * self.size)
        self._ranges: dict[tuple[float, float], tuple[Floats, Floats]] = {}
        self.earlier: Mask = self.time < (self.time[0] + self.time[-1]) / 2
        if not self.in_loops:
            return
        self.edges = edges = np.array([0, *(reversals(driver) + 1).tolist(), len(driver)])
        self.sweeps = sweeps = len(edges) - 1
        if sweeps < FEWEST_SWEEPS or len(driver) < FEWEST_ROWS * sweeps:
            need = f'{FEWEST_SWEEPS} sweeps of {FEWEST_ROWS} samples each are needed'
            problem = f'{record.source}: {sweeps} sweeps of {len(driver)} samples in all; {need}'
            remedy = 'record more loops or faster, or, where the load drives, from rest to rest'
            raise UnsupportedDataError(problem, remedy)
        sweep = np.repeat(np.arange(sweeps), np.diff(edges))
        start, end = driver[np.maximum(edges[:-1] - 1, 0)], driver[edges[1:] - 1]
        self.sweep = sweep[:count:block]
        self.scored: Mask = self.sweep > 0
        if driven_by == MOTION:
            self.earlier = self.sweep < sweeps // 2
        self.sense = np.where(end > start, 1.0, -1.0)[sweep]
        self.distance = np.abs(driver - start[sweep])
        self.speed: Floats = np.gradient(driver, time)

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

    def sign(self, band: float | None) -> Floats:
        """Sign of the load, linear within a band of so many standard deviations of the load at rest, (n,).

        None: of the load as measured, not counted from rest.
        """
        width = (band or 0.0) * self.record.noise(self.record.load)
        change = self.record.load if band is None else self.record.load_change
        return self._means(place_in_band(change, width)[0] if width > 0 else np.sign(change))

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


_KINDS = {
    'load': (('force', 'load', 'f', 'torque', 'moment'), {'N': tables.FORCE, 'Nm': tables.TORQUE}),
    'response': (
        ('displacement', 'deflection', 'response', 'angle', 'rotation'),
        {'m': tables.LENGTH, 'rad': tables.ANGLE},
    ),
    'time': (('time', 't'), {'s': tables.TIME}),
}
"""What a column may be called where none is chosen, and its units by SI unit."""
LARGEST = {'m': 0.5, 'rad': 100.0, 's': 1e12, **dict.fromkeys(('N', 'Nm'), 1e6)}
"""The largest plausible size by SI unit."""


def _choose(table: Sheet, kind: str, chosen: str | None) -> tuple[str, str, Place]:
    """The column of a kind: its heading, its SI unit, its place.

    Raises:
        ParameterError: no column has the name chosen and such a unit.
        RecordingError: none is chosen, and not one column is called so.
    """
    words, units = _KINDS[kind]
    found, fitting = [], []
    for number, heading in enumerate(table.heading):
        word, unit = split_heading(heading)
        unit = re.sub(r'[\s·*]', '', unit)
        for si, factors in units.items():
            if unit in factors:
                fitting.append(heading)
                if heading == chosen.strip() if chosen is not None else word.lower() in words:
                    place = Place(Field(kind, (), largest=LARGEST[si]), number, factors[unit])
                    found.append((heading, si, place))
    if len(found) == 1:
        return found[0]
    remedy = f'name one with its unit, such as {words[0]}_{next(iter(units))}'
    if fitting and kind != 'time':
        listed = ', '.join(fitting[:6]) + ' …' * (len(fitting) > 6)
        remedy = f'choose one by --{kind}: {listed}'
    if chosen is not None:
        problem = f'expected one column of {table.source} with this name and a unit of a {kind}, got {len(found)}'
        raise ParameterError(f'--{kind} {chosen}', problem, remedy)
    raise RecordingError(table.source, f'expected one column of the {kind}, got {len(found)}', remedy)


def load_record(path: str | Path, response: str | None = None, load: str | None = None) -> Record:
    """Reads a record.

    Args:
        path: the file.
        response: heading of the response; None for the one with a name such as `angle_rad`.
        load: heading of the load, likewise.

    Raises:
        ParameterError: a column asked for does not exist, or is no response or load.
        RecordingError: the file cannot be read, columns do not go together, or a row is wrong.
        UnsupportedDataError: see `Record`.
    """
    table = load_table(Path(path), 'time_s,angle_rad,torque_Nm')
    asked = {'response': response, 'load': load, 'time': None}
    found = {kind: _choose(table, kind, chosen) for kind, chosen in asked.items()}
    (one, unit, _), (other, load_unit, _) = found['response'], found['load']
    if (unit, load_unit) not in (('m', 'N'), ('rad', 'Nm')):
        problem = f'the units of {one} and {other} do not go together'
        remedy = 'give an angle with a torque (rad, Nm), or a displacement with a force (m, N)'
        raise RecordingError(table.source, problem, remedy)
    joints = [re.search(r'(?:joint|axis|angle|torque|tau|q)[ _]?(\d+)', heading.lower()) for heading in (one, other)]
    if len({match[1] for match in joints if match}) > 1:
        problem = f'{one} and {other} are columns of two joints'
        raise RecordingError(table.source, problem, 'choose those of one joint, or rename one if they belong together')
    values = table.read({kind: place for kind, (_, _, place) in found.items()})
    steps = np.abs(np.diff(values['response'], prepend=values['response'][0]))
    if unit == 'rad' and steps.max() > np.pi:
        line = table.rows[int(steps.argmax())][0]
        problem = f'line {line}: {one} jumps by {steps.max():.3g} rad, more than half a turn'
        raise RecordingError(table.source, problem, 'unwrap the angle, or check the unit of the column')
    commanded = {split_heading(each)[1] for each in table.heading if each.lower().startswith('command')}
    drivers = ((LOAD, 'load', load_unit), (MOTION, 'response', unit))
    driven_by = next((driver for driver, kind, si in drivers if commanded & {*_KINDS[kind][1][si]}), '')
    return Record(table.source, **values, load_unit=load_unit, driven_by=driven_by)
