"""A record driven by its load: its parts, and what it refuses."""

from __future__ import annotations

import re

import numpy as np
import pytest
from studies.load_records import ANGLE_NOISE, TORQUE_NOISE, columns, load_record, torque

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord, is_at_rest_first


def test_parts_and_noise() -> None:
    record = load_record()
    assert 195 <= record.rest.sum() <= 203
    assert not record.rest[205:].any()
    assert 620 <= record.unloaded <= 635
    assert record.load_noise == pytest.approx(TORQUE_NOISE, rel=0.2)
    assert record.response_noise == pytest.approx(ANGLE_NOISE, rel=0.2)
    assert record.name == 'one.csv'
    with pytest.raises(ValueError, match='read-only'):
        record.load[0] = 1.0


def test_a_zero_of_the_load_changes_nothing() -> None:
    time, load, angle = columns(torque())
    record, shifted = LoadRecord('a', time, load, angle), LoadRecord('a', time, load + 7.5, angle)
    assert record.unloaded == shifted.unloaded
    assert np.array_equal(record.rest, shifted.rest)


def test_several_loadings_are_unloaded_after_the_last() -> None:
    first = torque()
    record = load_record(np.concatenate([first, 0.5 * first, first]))
    assert record.unloaded > 2 * len(first) + 600
    assert record.rest.sum() < 205


def test_an_impact_does_not_end_the_hold() -> None:
    load = torque()
    load[640] = 1.3 * load[300]
    assert load_record(load).unloaded == 641


def without(rows: slice) -> LoadRecord:
    kept = np.delete(np.arange(len(torque())), rows)
    return LoadRecord('one.csv', *(values[kept] for values in columns(torque())))


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: without(slice(20, None)), 'one.csv: 20 samples; 50 or more are needed'),
        (lambda: without(slice(500, None)), 'one.csv: the load never falls below 60 % of its largest for good'),
        (lambda: without(slice(0, 195)), 'one.csv: the load is not at rest at first'),
        (lambda: without(slice(0, 300)), 'one.csv: the load never falls below 60 % of its largest for good'),
        (lambda: without(slice(300, 320)), 'one.csv: there is a gap in time from 3.7375 to 4 s'),
        (lambda: load_record(np.zeros(400)), 'one.csv: the load is constant within its noise'),
        (lambda: load_record(np.linspace(0, 1, 400)), 'one.csv: the load is not at rest at first'),
    ],
)
def test_what_is_refused(make: object, message: str) -> None:
    with pytest.raises(UnsupportedDataError, match=re.escape(message)):
        make()  # type: ignore[operator]


def test_time_and_response_are_checked() -> None:
    time, load, angle = columns(torque())
    back = time.copy()
    back[400:] -= 0.5
    with pytest.raises(UnsupportedDataError, match=r'the time does not rise from row to row: from 4\.9875 to 4\.5 s'):
        LoadRecord('one.csv', back, load, angle)
    with pytest.raises(UnsupportedDataError, match='the response never changes'):
        LoadRecord('one.csv', time, load, np.full(len(time), 0.7))
    with pytest.raises(UnsupportedDataError, match='the load is constant'):
        LoadRecord('one.csv', time, np.full(len(time), 0.1), angle)
    with pytest.raises(UnsupportedDataError, match=r'it takes 0\.0117 s; 0\.6 s or more are needed; check the unit'):
        LoadRecord('one.csv', 1e-3 * time, load, angle)
    with pytest.raises(ParameterError, match='finite'):
        LoadRecord('one.csv', time, load, np.where(time > 1, np.nan, angle))
    with pytest.raises(ParameterError, match='got rad and N'):
        LoadRecord('one.csv', time, load, angle, load_unit='N')


def test_noise_is_no_rest() -> None:
    random = np.random.default_rng(3)
    assert not any(is_at_rest_first(random.standard_normal(size)) for size in (60, 300, 2000) for _ in range(50))


@pytest.mark.parametrize('noise', [1e-3, 0.02, 0.1])
@pytest.mark.parametrize('rise', [2, 20, 100, 1500])
def test_the_rest_ends_where_the_load_begins_to_rise(rise: int, noise: float) -> None:
    ramp = np.linspace(0.0, 2.0, rise)
    load = np.concatenate([np.zeros(150), ramp, np.full(200, 2.0), ramp[::-1], np.zeros(100)])
    random = np.random.default_rng(rise)
    measured = load + 0.7 + noise * random.standard_normal(len(load))
    record = LoadRecord('one.csv', np.arange(len(load)) / 80, measured, 1e-4 * measured)
    end = int(record.rest.sum())
    assert end >= 140
    assert load[:end].max() < 4 * noise + 1e-2
