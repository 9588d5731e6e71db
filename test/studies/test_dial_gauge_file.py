"""Tables of gauge readings: units, separators, and every bad row named."""

from __future__ import annotations

import math

import numpy as np
import pytest
from studies.gauge_table import dump_readings

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.tables import parse_table
from scara_kinetostatic.studies.loops.dial_gauge import GaugeTable, Readings, load_readings
from scara_kinetostatic.studies.paper.study import simulate_experiments


def parse(text: str, **defaults: str | float) -> GaugeTable:
    return load_readings(parse_table(text, 'table.csv', 'force_N,displacement_mm'), **defaults)


def only(text: str, **defaults: str | float) -> Readings:
    (found,) = parse(text, **defaults).runs
    return found


def test_what_is_written_is_read_back():
    given = simulate_experiments(directions=(0.0, 0.5), seed=1)
    back = parse(dump_readings(given))
    first = 2
    for run, found in zip(given, back.runs, strict=True):
        np.testing.assert_allclose(found.displacement, run.displacement, rtol=0, atol=1e-11)
        for name in ('force', 'direction', 'lever', 'cycle'):
            np.testing.assert_allclose(getattr(found, name), getattr(run, name), rtol=1e-8, atol=1e-12)
        assert (found.part, found.gauge_at, found.source) == (run.part, run.gauge_at, 'table.csv')
        assert found.line.tolist() == list(range(first, first + len(run)))
        first += len(run)
    assert not back.notes
    with pytest.raises(ValueError, match='read-only'):
        back.runs[0].force[0] = 1.0


def test_optional_columns_and_what_holds_without_them():
    heading = 'force_N,displacement_m,direction_deg,cycle,Joint,lever_mm,gauge_at,time_s'
    text = f'{heading}\n1,2e-6,90,3.0,Joint 2,330,TIP,0.5\n1,2e-6\n'
    one, other = parse(text, part='joint1', lever=0.66, direction=math.pi, gauge_at='link').runs
    assert (one.part, other.part) == ('joint2', 'joint1')
    assert (one.lever, other.lever) == pytest.approx((0.33, 0.66))
    assert (one.direction, other.direction) == pytest.approx((math.pi / 2, math.pi))
    assert (one.gauge_at, other.gauge_at) == ('tip', 'link')
    assert (one.cycle.tolist(), np.isnan(other.cycle).tolist()) == ([3.0], [True])
    text = 'force_N,displacement_m,part,lever_m\n1,0,gripper,\n1,0,joint1,0.66\n'
    assert [run.gauge_at for run in parse(text).runs] == ['tip', 'link']


def test_a_run_is_of_one_part_one_direction_and_one_lever():
    heading = 'force_N,displacement_m,part,direction_deg,lever_m,levr_m\n'
    rows = ['1,0,gripper,0,', '2,0,joint1,0,0.66', '3,0,gripper,0,0.5', '4,0,gripper,90,', '5,0,joint1,0,0.33']
    found = parse(heading + '\n'.join(rows))
    assert [run.force.tolist() for run in found.runs] == [[1.0, 3.0], [2.0], [4.0], [5.0]]
    assert found.notes == ("table.csv: columns that are unknown and not used: 'levr_m'",)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('force_N,displacement_m\n1,25.1\n', 'displacement_m: 25.1 is too large to be plausible; check the unit'),
        ('force_N,displacement_m,part\n1,0,elbow\n', "line 2: part: expected gripper or joint1 or joint2, got 'elbow'"),
        ('force_N,displacement_m,lever_m\n1,0,0\n', 'line 2: lever_m: expected a number above 0'),
        ('force_N,displacement_m,direction_deg\n1,0,9000\n', 'line 2: direction_deg: 9000 is too large'),
    ],
)
def test_what_is_wrong_is_said_in_one_line(text, message):
    """What every table may have wrong: `test_touch_table`."""
    with pytest.raises(RecordingError, match=message) as caught:
        parse(text)
    assert str(caught.value).startswith('table.csv: ')
    assert '\n' not in str(caught.value)


def test_tables_are_told_apart_by_their_columns():
    rows = [(k, force, 10 * force + (10 if force > 0 else -10)) for k, force in enumerate([1, 2, 3, 2, 1, -1, -2, -3])]
    points = 'time_s,cycle,force_N,displacement_um\n' + ''.join(f'{k},1,{f},{moved}\n' for k, f, moved in rows)
    loops = 'time_s,force_N,displacement_um\n' + ''.join(f'{k},{f},{moved}\n' for k, f, moved in rows)
    assert len(parse(points).runs) == len(parse(loops, direction=0.0).runs) == 1
    with pytest.raises(RecordingError, match=r'table\.csv: a continuous record: .*; give it to the verb hysteresis'):
        parse(loops)
