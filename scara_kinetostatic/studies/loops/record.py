"""A record of a load and a response, read from a CSV file, and what drives it.

Columns: the response, the load and the time among any others, chosen by name or by their units (`files.columns`). A
displacement goes with a force, an angle with a torque. A heading such as `q2_rad` or `tau2_ext_Nm` tells the number
of its joint: the columns of two joints do not go together.

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
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import find_peaks

from scara_kinetostatic.errors import ParameterError, RecordingError, UnsupportedDataError
from scara_kinetostatic.files import columns
from scara_kinetostatic.files.columns import Column, Place, load_table, split_heading
from scara_kinetostatic.model.arrays import Floats, Indices, Mask

MOTION, LOAD = 'motion', 'load'
PROMINENCE = 0.03
"""Smallest prominence of a reversal, as a share of the range of what reverses."""
FEWEST_SWEEPS = 6
"""Three to fit and three to predict; fewer do not give a variance between sweeps."""
FEWEST_ROWS = 8
"""Mean number of samples of a sweep."""
UNLOADED_BELOW = 0.6
"""Share of its largest below which the load counts as gone."""
LEVEL = 0.01
"""Probability of an alarm, by a dependence of the residual of law (6) or by a candidate, where law (6) is right."""
_FEWEST_AT_REST = 10
"""For the zero of load and response and for their noise, known to about a quarter of itself then."""
_QUANTITIES = {
    'm': (columns.LENGTH, 0.5),
    'rad': (columns.ANGLE, 100.0),
    'N': (columns.FORCE, 1e6),
    'Nm': (columns.TORQUE, 1e6),
    's': (columns.TIME, 1e12),
}
"""By SI unit: factor to it by unit, and the largest plausible size."""


class _Kind(NamedTuple):
    """What a column may be: its SI units, words that are preferred to others of the same unit, an example."""

    units: tuple[str, ...]
    words: tuple[str, ...]
    example: str


_KINDS = {
    'load': _Kind(('N', 'Nm'), ('force', 'load', 'f', 'torque', 'moment'), 'force_N or torque_Nm'),
    'response': _Kind(
        ('m', 'rad'), ('displacement', 'deflection', 'response', 'angle', 'rotation'), 'displacement_m or angle_rad'
    ),
    'time': _Kind(('s',), ('time', 't'), 'time_s'),
}


class RecordColumn(NamedTuple):
    """A column: its heading, its number from 0, its SI unit, the factor to it."""

    heading: str
    number: int
    unit: str
    factor: float

    @property
    def joint(self) -> int | None:
        """Number of the joint in the heading, if it has one."""
        match = re.search(r'(?:joint|axis|angle|torque|tau|q)[ _]?(\d+)', self.heading.lower())
        return int(match[1]) if match else None

    def goes_with(self, other: RecordColumn) -> bool:
        """Whether they are a displacement and a force, or an angle and a torque."""
        return {self.unit, other.unit} in ({'m', 'N'}, {'rad', 'Nm'})


def choose_columns(
    headings: Sequence[str], where: str, response: str | None = None, load: str | None = None
) -> dict[str, RecordColumn]:
    """The columns of a record by kind: load, response and time.

    Args:
        headings: of the table.
        where: the file, for messages.
        response: heading of the response; None for the only one, or the one with a name such as `angle_rad`.
        load: heading of the load, likewise; its quantity must go with that of the response.

    Raises:
        ParameterError: the table has no such column of a response or a load.
        RecordingError: a column is not given and cannot be told, or the two do not go together.
    """
    known = []
    for number, heading in enumerate(headings):
        unit = re.sub(r'[\s·*]', '', split_heading(heading)[1])
        known += [
            RecordColumn(heading, number, si, factors[unit])
            for si, (factors, _) in _QUANTITIES.items()
            if unit in factors
        ]
    names = {'load': load, 'response': response, 'time': None}
    chosen: dict[str, RecordColumn] = {}
    for kind in sorted(names, key=lambda kind: names[kind] is None):  # those named come first
        of_kind = [column for column in known if column.unit in _KINDS[kind].units]
        name = names[kind]
        if name is None:
            chosen[kind] = _only(of_kind, kind, None if kind == 'time' else next(iter(chosen.values()), None), where)
            continue
        found = [column for column in of_kind if column.heading == name.strip()]
        if len(found) != 1:
            problem = f'expected one column of {where} with this name and a unit of a {kind}, got {len(found)}'
            example = f'name one {_KINDS[kind].example}'
            raise ParameterError(f'--{kind} {name}', problem, f'choose {_listed(of_kind)}' if of_kind else example)
        chosen[kind] = found[0]
    _check_pair(chosen['response'], chosen['load'], where)
    return chosen


def _driven_by(headings: Sequence[str], chosen: Mapping[str, RecordColumn]) -> str:
    """What a column of commands says that drives: `LOAD`, `MOTION`, or nothing."""
    units = {split_heading(each)[1] for each in headings if each.lower().startswith('command')}
    for driver, kind in ((LOAD, 'load'), (MOTION, 'response')):
        if units & set(_QUANTITIES[chosen[kind].unit][0]):
            return driver
    return ''


def _only(of_kind: list[RecordColumn], kind: str, other: RecordColumn | None, where: str) -> RecordColumn:
    """The only column of a kind that goes with the other one, or the one of them whose name says so."""
    fitting = [column for column in of_kind if other is None or column.goes_with(other)]
    words = _KINDS[kind].words
    chosen = fitting if len(fitting) == 1 else [c for c in fitting if split_heading(c.heading)[0].lower() in words]
    if len(chosen) == 1:
        return chosen[0]
    if fitting:
        remedy = 'leave all but one out' if kind == 'time' else f'choose one by --{kind}'
        raise RecordingError(where, f'{len(fitting)} columns may be the {kind}: {_listed(fitting)}', remedy)
    goes_with = f' that goes with {other.heading}' if other else ''
    problem = f'there is no column of the {kind}{goes_with}'
    raise RecordingError(where, problem, f'name one with its unit, such as {_KINDS[kind].example}')


def _check_pair(response: RecordColumn, load: RecordColumn, where: str) -> None:
    pair = f'{response.heading} and {load.heading}'
    if not response.goes_with(load):
        remedy = 'give an angle with a torque (rad, Nm), or a displacement with a force (m, N)'
        raise RecordingError(where, f'the units of {pair} do not go together', remedy)
    if None not in (response.joint, load.joint) and response.joint != load.joint:
        problem = f'{pair} are columns of two joints, {response.joint} and {load.joint}'
        raise RecordingError(where, problem, 'choose those of one joint, or rename one if they do belong together')


def _listed(several: Sequence[RecordColumn]) -> str:
    return ', '.join(column.heading for column in several[:6]) + (' …' if len(several) > 6 else '')


@dataclass(frozen=True)
class Record:
    """A record; arrays (n,), read-only.

    Attributes:
        source: its file, for messages.
        time: s, increasing.
        load: N or Nm.
        response: m where the load is a force, rad where it is a torque.
        load_unit: 'N' or 'Nm'.
        joint: its number in the headings, if there is one.
        driven_by: `LOAD` or `MOTION` where a column of commands says so, else empty.

    Raises:
        UnsupportedDataError: the time does not rise, or the load or the response never changes; `source` is named.
    """

    source: str
    time: Floats
    load: Floats
    response: Floats
    load_unit: str = 'Nm'
    joint: int | None = None
    driven_by: str = ''

    def __post_init__(self) -> None:
        for name in ('time', 'load', 'response'):
            array = np.array(getattr(self, name), dtype=float)
            array.flags.writeable = False
            object.__setattr__(self, name, array)
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
        if self.load_unit == 'N':
            return linear
        return re.sub('[Nm]', lambda letter: {'N': 'Nm', 'm': 'rad'}[letter[0]], linear)

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

    @property
    def remaining(self) -> float:
        """Response that stays after the load has gone: mean of the last half of what follows, m or rad."""
        return float(self.response_change[(self.judged_from + len(self)) // 2 :].mean())

    def noise(self, values: Floats) -> float:
        """Standard deviation of a column at rest, in loops from its differences, in its unit."""
        if self.is_at_rest_first:
            return float(values[self.rest].std(ddof=1))
        return 1.4826 * float(np.median(np.abs(np.diff(values)))) / np.sqrt(2.0)


def load_record(path: str | Path, response: str | None = None, load: str | None = None) -> Record:
    """Reads a record.

    Args:
        path: the file.
        response: heading of the response; None for the one that its name or its unit tells.
        load: heading of the load, likewise.

    Raises:
        ParameterError: a column asked for does not exist, or is no response or load.
        RecordingError: the file cannot be read, columns do not go together, or a row is wrong.
        UnsupportedDataError: see `Record`.
    """
    table = load_table(Path(path), 'time_s,angle_rad,torque_Nm')
    chosen = choose_columns(table.heading, table.source, response, load)
    places = {
        kind: Place(Column(kind, (), largest=_QUANTITIES[column.unit][1]), column.number, column.factor)
        for kind, column in chosen.items()
    }
    values = table.read(places).numbers
    steps = np.abs(np.diff(values['response'], prepend=values['response'][0]))
    if chosen['response'].unit == 'rad' and steps.max() > np.pi:
        line = table.rows[int(steps.argmax())][0]
        problem = f'line {line}: {chosen["response"].heading} jumps by {steps.max():.3g} rad, more than half a turn'
        raise RecordingError(table.source, problem, 'unwrap the angle, or check the unit of the column')
    joint = chosen['response'].joint if chosen['response'].joint is not None else chosen['load'].joint
    driven_by = _driven_by(table.heading, chosen)
    return Record(table.source, **values, load_unit=chosen['load'].unit, joint=joint, driven_by=driven_by)


def check_alike(records: Sequence[Record]) -> None:
    """Checks that the records may be of one joint.

    Raises:
        RecordingError: their units or the numbers of their joints differ; the first other one is named.
    """
    first = records[0]
    for each in records[1:]:
        if each.load_unit != first.load_unit:
            problem = f'its load is in {each.load_unit}, that of {first.source} in {first.load_unit}'
            raise RecordingError(each.source, problem, 'give records of one joint')
        if None not in (each.joint, first.joint) and each.joint != first.joint:
            problem = f'a record of joint {each.joint}, but {first.source} is one of joint {first.joint}'
            raise RecordingError(each.source, problem, 'give records of one joint, or rename the columns')


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
    kinds = stated or {_drives(each) for each in records}
    return LOAD if LOAD in kinds else MOTION


def _drives(record: Record) -> str:
    if not is_at_rest_first(record.load):
        return MOTION
    if not _has_full_loops(record):
        return LOAD
    lowest, highest = np.percentile(record.load - record.load[0], (2, 98))  # impacts are left out
    return LOAD if min(-lowest, highest) < 0.25 * max(-lowest, highest) else MOTION


def _has_full_loops(record: Record) -> bool:
    """Whether there are six sweeps or more of comparable extent."""
    response = record.response
    edges = np.array([0, *reversals(response).tolist(), len(response) - 1])
    sweeps = len(edges) - 1
    if sweeps < FEWEST_SWEEPS or len(response) < FEWEST_ROWS * sweeps:
        return False
    # the median extent is 0.5 of the range where the amplitude grows evenly
    return bool(np.median(np.abs(np.diff(response[edges]))) >= 0.4 * np.ptp(response))


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
    remedy = 'record from before the load comes on until after it has gone'
    checks = (
        (len(record) < 50, f'{len(record)} samples; 50 or more are needed', 'record longer or faster'),
        # ten times the averaging time of the load that friction follows
        (
            took < 0.6,
            f'it takes {took:.3g} s; 0.6 s or more are needed',
            'check the unit of the time, or record longer',
        ),
        # what the load did meanwhile is unknown
        (steps[longest] > 5 * np.median(steps), gap, 'give the parts before and after it as files of their own'),
        (in_loops and not FEWEST_SWEEPS - 1 <= turns < len(record) // FEWEST_ROWS, neither, f'{remedy}, or more loops'),
        (len(record) - record.judged_from < 10, 'the load never falls below 60 % of its largest for good', remedy),
        (
            in_loops and _gives_out_energy(record),
            record.words('the {response} runs ahead of the {load}, as if the joint gave out energy'),
            'check whether the two columns are swapped',
        ),
    )
    for is_wrong, problem, what_to_do in checks:
        if is_wrong:
            raise UnsupportedDataError(f'{record.source}: {problem}', what_to_do)


def _gives_out_energy(record: Record) -> bool:
    """Whether the loops of response over load run the wrong way round, their area beyond 2 % of load times response."""
    load, response = record.load - record.load.mean(), record.response - record.response.mean()
    work = float(np.sum((load[1:] + load[:-1]) / 2 * np.diff(response))) * np.sign(load @ response)
    return work < -0.02 * float(np.ptp(load) * np.ptp(response))


def reversals(values: Floats) -> Indices:
    """The samples at which a displacement or a load, (n,), reverses, in the order of time."""
    least = PROMINENCE * float(np.ptp(values))
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
    """Number of samples at rest at the beginning: before a load above 10 % of its largest and 5 standard deviations."""
    change = np.abs(load - np.median(load[:_FEWEST_AT_REST]))
    noise = 1.4826 * float(np.median(np.abs(np.diff(load)))) / np.sqrt(2.0)  # normal distribution
    loaded = int(np.argmax(change > max(0.1 * change.max(), min(5 * noise, 0.5 * change.max()))))
    return _end_of_rest(load[:loaded]) if loaded > _FEWEST_AT_REST else max(loaded, 1)


def _end_of_rest(load: Floats) -> int:
    """Where a load that is on at the end of these samples, (n,), begins to rise: the change point.

    The samples before it are a constant, those from it on a straight line, with normal scatter. Of all change points
    whose log-likelihood is not significantly below the largest, the last one counts.
    """
    load = load - load.mean()
    place = np.arange(len(load))
    ends = np.arange(2, len(load) + 1)
    first, square, moment = (np.concatenate([[0.0], np.cumsum(values)]) for values in (load, load**2, place * load))
    constant = square[ends] - first[ends] ** 2 / ends
    count = np.maximum(len(load) - ends, 1)
    middle = (len(load) + ends - 1) / 2
    rest, slope = first[-1] - first[ends], moment[-1] - moment[ends] - middle * (first[-1] - first[ends])
    line = square[-1] - square[ends] - rest**2 / count - slope**2 / np.maximum(count * (count**2 - 1) / 12, 1e-300)
    line = np.where(count > 1, np.maximum(line, 0.0), 0.0)
    total = np.maximum(constant + line, 1e-12 * square[-1])
    likelihood = -len(load) / 2 * np.log(total) if square[-1] > 0 else np.zeros(len(ends))
    # χ² of 10 with one degree of freedom, p = 0.002
    return int(ends[np.flatnonzero(likelihood >= likelihood.max() - 5.0)[-1]])
