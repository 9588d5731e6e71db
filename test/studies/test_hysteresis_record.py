"""A record from a table: columns by name and by unit, what drives it, its parts, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from studies.load_records import TORQUE_NOISE, columns, record, torque

from benchmark.hysteresis import sine
from scara_kinetostatic.errors import InputError, UnsupportedDataError
from scara_kinetostatic.studies.loops import record as records
from scara_kinetostatic.studies.loops.record import LOAD, MOTION, Record, RecordPath, what_drives

PANDA = Path(__file__).parents[2] / 'bags' / 'panda'


def read(folder: Path, text: str, *options: str) -> Record:
    (folder / 'one.csv').write_text(text, encoding='utf-8')
    return records.load_record(folder / 'one.csv', *options)


@pytest.mark.parametrize(
    ('heading', 'response', 'load', 'units'),
    [
        ('time [s],angle [deg],torque [N m]', np.pi / 180, 1.0, ('rad', 'Nm')),
        ('t (s),rotation_µrad,moment (mNm)', 1e-6, 1e-3, ('rad', 'Nm')),
        ('time_s,displacement_mm,force_kN', 1e-3, 1e3, ('m', 'N')),
    ],
)
def test_units(tmp_path: Path, heading: str, response: float, load: float, units: tuple[str, str]) -> None:
    found = read(tmp_path, f'{heading}\n0,0.25,-1.5\n1,0.5,2\n')
    np.testing.assert_allclose(found.response, [0.25 * response, 0.5 * response], rtol=1e-12)
    np.testing.assert_allclose(found.load, [-1.5 * load, 2 * load], rtol=1e-12)
    assert (found.unit('m'), found.load_unit) == units
    assert found.unit('m/N') == '/'.join(units)
    assert found.time.tolist() == [0.0, 1.0]


MANY = 'time_s,q2_rad,q4_rad,tau2_Nm,tau4_Nm,Fx_N,x_mm,status'


@pytest.mark.parametrize(
    ('heading', 'options', 'message'),
    [
        (MANY, ['q2_rad'], 'expected one column of the load, got 0; choose one by --load: tau2_Nm, tau4_Nm, Fx_N'),
        (MANY, ['q2', 'tau2_Nm'], '--response q2: expected one column of '),
        (MANY, ['status', 'Fx_N'], 'a unit of a response, got 0; choose one by --response: q2_rad, q4_rad, x_mm'),
        (MANY, ['q2_rad', 'Fx_N'], 'the units of q2_rad and Fx_N do not go together; give an angle with a torque'),
        (MANY, ['q2_rad', 'tau4_Nm'], 'q2_rad and tau4_Nm are columns of two joints; choose those of one joint'),
        ('angle_rad,torque_Nm', [], 'expected one column of the time, got 0; name one with its unit, such as time_s'),
        ('time_s,angle_rad,status', [], 'the load, got 0; name one with its unit, such as force_N'),
    ],
)
def test_columns_that_cannot_be(tmp_path: Path, heading: str, options: list[str], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        read(tmp_path, f'{heading}\n{",".join("1" * (heading.count(",") + 1))}\n', *options)


def test_an_angle_that_wraps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'one\.csv: line 4: angle_deg jumps by 6\.25 rad'):
        read(tmp_path, 'time_s,angle_deg,torque_Nm\n0,178,0\n1,179,1\n2,-179,1\n')


def test_measured_records_are_driven_by_their_load() -> None:
    for path in sorted(PANDA.glob('*.csv')):
        found = records.load_record(path, 'q4_rad', 'tau4_from_force_Nm')
        assert what_drives([found]) == LOAD, path
        assert 2.0 < found.time[found.rest][-1] < 5.0, path
        assert 8.0 < found.time[found.judged_from] < 20.0, path


def loops(rest: int, zero: float = 0.0) -> Record:
    """A motion to and fro of a spring, after a rest."""
    time, moved = sine()
    moved = np.concatenate([np.zeros(rest), moved])
    force = zero + 1e6 * moved + 20 * np.random.default_rng(0).standard_normal(len(moved))
    return Record('loops.csv', time[1] * np.arange(len(moved)), force, moved, 'N')


def test_what_drives_is_seen() -> None:
    one = record(torque())
    assert what_drives([one]) == what_drives([record(np.tile(torque(), 5))]) == LOAD
    assert what_drives([loops(0)]) == what_drives([loops(100)]) == what_drives([loops(100, 5e4)]) == MOTION
    assert what_drives([one, loops(0)]) == what_drives([loops(0), one]) == LOAD
    assert what_drives([one, replace(loops(0), driven_by=MOTION)]) == MOTION
    with pytest.raises(InputError, match=r'loops\.csv: driven by its motion, but 0\.csv by its load'):
        what_drives([replace(one, driven_by=LOAD), replace(loops(0), driven_by=MOTION)])


def test_parts_and_noise() -> None:
    found = record(torque())
    assert 195 <= found.rest.sum() <= 203
    assert not found.rest[205:].any()
    assert 620 <= found.judged_from <= 635
    assert found.noise(found.load) == pytest.approx(TORQUE_NOISE, rel=0.2)
    with pytest.raises(ValueError, match='read-only'):
        found.load[0] = 1.0
    time, load, angle = columns(torque())
    shifted = Record('a', time, load + 7.5, angle)
    assert found.judged_from == shifted.judged_from
    assert np.array_equal(found.rest, shifted.rest)
    several = record(np.concatenate([torque(), 0.5 * torque(), torque()]))
    assert several.judged_from > 2 * len(torque()) + 600
    assert several.rest.sum() < 205
    load = torque()
    load[640] = 1.3 * load[300]  # an impact
    assert record(load).judged_from == 641


def without(rows: slice) -> Record:
    kept = np.delete(np.arange(len(torque())), rows)
    return Record('0.csv', *(values[kept] for values in columns(torque())))


TIME, TORQUE, ANGLE = columns(torque())


@pytest.mark.parametrize(
    ('make', 'message'),
    [
        (lambda: without(slice(20, None)), '0.csv: 20 samples; 50 or more are needed'),
        (lambda: without(slice(500, None)), '0.csv: the load never falls below 60 % of its largest for good'),
        (lambda: without(slice(0, 195)), '0.csv: the load is not at rest at first'),
        (lambda: without(slice(300, 320)), '0.csv: there is a gap in time from 3.7375 to 4 s'),
        (lambda: record(np.zeros(400)), '0.csv: the load is not at rest at first, 10 samples or more, or constant'),
        (lambda: record(np.linspace(0, 1, 400)), '0.csv: the load is not at rest at first'),
        (lambda: Record('a', -TIME, TORQUE, ANGLE), 'a: the time does not rise from row to row: from -0 to -0.0125 s'),
        (lambda: Record('a', TIME, TORQUE, 0 * TIME), 'a: the response never changes'),
        (lambda: Record('a', TIME, 0 * TIME, ANGLE), 'a: the load never changes'),
        (lambda: Record('a', 1e-3 * TIME, TORQUE, ANGLE), 'it takes 0.0117 s; 0.6 s or more are needed; check the u'),
    ],
)
def test_what_is_refused(make: object, message: str) -> None:
    with pytest.raises(UnsupportedDataError, match=re.escape(message)):
        RecordPath(make())  # type: ignore[operator]


def test_noise_is_no_rest() -> None:
    random = np.random.default_rng(3)
    assert not any(
        records.is_at_rest_first(random.standard_normal(size)) for size in (60, 300, 2000) for _ in range(20)
    )


@pytest.mark.parametrize('noise', [1e-3, 0.1])
@pytest.mark.parametrize('rise', [2, 20, 100, 1500])
def test_the_rest_ends_where_the_load_begins_to_rise(rise: int, noise: float) -> None:
    ramp = np.linspace(0.0, 2.0, rise)
    load = np.concatenate([np.zeros(150), ramp, np.full(200, 2.0), ramp[::-1], np.zeros(100)])
    measured = load + 0.7 + noise * np.random.default_rng(rise).standard_normal(len(load))
    end = int(Record('one.csv', np.arange(len(load)) / 80, measured, 1e-4 * measured).rest.sum())
    assert end >= 140
    assert load[:end].max() < 4 * noise + 1e-2


def test_a_motion_is_cut_at_its_reversals_and_its_still_ends_are_left_out() -> None:
    time, moved = sine()
    still = np.concatenate([moved, np.full(100, moved[-1])])
    path = RecordPath(Record('a', np.arange(740) * time[1], np.arange(740.0), still, 'N'), MOTION)
    assert path.sweeps == 11
    assert len(path.time) < 645
    assert set(np.unique(path.sense)) == {-1.0, 1.0}
    assert np.all(np.diff(path.driver) * path.sense[1:] >= 0)
    assert np.abs(np.diff(path.distance)[path.edges[1:-1] - 1]).min() > 1e-3  # far from the reversal, then near it
    assert path.distance[path.edges[1:-1]].max() < 1e-3
    with pytest.raises(UnsupportedDataError, match=r'a: 1 sweeps of 99 samples in all; 6 sweeps of 8 samples each'):
        RecordPath(Record('a', np.arange(99.0), np.arange(99.0), np.arange(99.0), 'N'), MOTION)
