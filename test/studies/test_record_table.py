"""Tables of records: columns by name and by unit, units, what drives them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studies.load_records import table, torque

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.studies.dial_gauge.readings import load_readings
from scara_kinetostatic.studies.hysteresis.laws import sine
from scara_kinetostatic.studies.hysteresis.record_table import (
    LOAD,
    MOTION,
    RecordTable,
    choose_columns,
    load_record_table,
    what_drives,
)

PANDA = Path(__file__).parents[2] / 'bags' / 'panda'
POSES = sorted(PANDA.glob('*.csv'))


def read(folder: Path, text: str, **options: str) -> RecordTable:
    (folder / 'one.csv').write_text(text, encoding='utf-8')
    return load_record_table(folder / 'one.csv', **options)


@pytest.mark.parametrize(
    ('heading', 'response', 'load', 'units'),
    [
        ('time_s,angle_rad,torque_Nm', 1.0, 1.0, ('rad', 'Nm')),
        ('time [s],angle [deg],torque [N m]', np.pi / 180, 1.0, ('rad', 'Nm')),
        ('t (s),rotation (mrad),moment (mNm)', 1e-3, 1e-3, ('rad', 'Nm')),
        ('time_s,q_µrad,tau_Nm', 1e-6, 1.0, ('rad', 'Nm')),
        ('time_s,displacement_mm,force_kN', 1e-3, 1e3, ('m', 'N')),
        ('stamp_s,x_um,reading_N', 1e-6, 1.0, ('m', 'N')),
        ('time_s,deflection_rad,load_Nm', 1.0, 1.0, ('rad', 'Nm')),
    ],
)
def test_units(tmp_path: Path, heading: str, response: float, load: float, units: tuple[str, str]) -> None:
    separator = ',' if ',' in heading else ';'
    found = read(tmp_path, f'{heading}\n0{separator}0.25{separator}-1.5\n1,0.5,2\n')
    np.testing.assert_allclose(found.response, [0.25 * response, 0.5 * response], rtol=1e-15)
    np.testing.assert_allclose(found.load, [-1.5 * load, 2 * load], rtol=1e-15)
    assert (found.response_unit, found.load_unit) == units
    assert found.time is not None
    assert found.time.tolist() == [0.0, 1.0]


def test_decimal_commas_and_comments(tmp_path: Path) -> None:
    found = read(tmp_path, '# a joint\ntime_ms;angle_deg;torque_Nm\n0;1,5;-2,5\n#1;2;3\n12,5;90;0\n')
    assert found.response.tolist() == pytest.approx([np.radians(1.5), np.radians(90)])
    assert found.load.tolist() == [-2.5, 0.0]
    assert found.time is not None
    assert found.time.tolist() == pytest.approx([0.0, 0.0125])


@pytest.mark.parametrize('joint', [2, 4, 6])
@pytest.mark.parametrize('path', POSES, ids=lambda path: path.stem)
def test_measured_records_are_driven_by_their_load(path: Path, joint: int) -> None:
    found = load_record_table(path, f'q{joint}_rad', f'tau{joint}_from_force_Nm')
    assert found.joint == joint
    assert what_drives([found]) == LOAD
    record = found.load_record
    assert 2.0 < record.time[record.rest][-1] < 5.0
    assert 8.0 < record.time[record.unloaded] < 20.0


def test_a_gauge_table_is_read_as_before(tmp_path: Path) -> None:
    text = 'time_s,force_kN,displacement_mm,angle_deg,remark\n0,1,2,90,3\n1,2,3,90,4\n'
    found = read(tmp_path, text).readings
    expected = load_readings(tmp_path / 'one.csv')
    for name in ('time', 'force', 'displacement'):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
    assert found.sources == expected.sources
    assert found.notes == expected.notes


MANY = ['time_s', 'q2_rad', 'q4_rad', 'tau2_Nm', 'tau4_Nm', 'tau4_ext_Nm', 'Fx_N', 'x_mm', 'status']


@pytest.mark.parametrize(
    ('response', 'load', 'message'),
    [
        (None, None, '3 columns may be the response: q2_rad, q4_rad, x_mm; choose one by --response'),
        ('q2_rad', None, '3 columns may be the load: tau2_Nm, tau4_Nm, tau4_ext_Nm; choose one by --load'),
        (None, 'tau2_Nm', '2 columns may be the response: q2_rad, q4_rad; choose one by --response'),
        ('q2', 'tau2_Nm', '--response q2: one.csv has no such column; did you mean q2_rad'),
        ('q2_rad', 'zzz', '--load zzz: one.csv has no such column; its columns of this kind are tau2_Nm, tau4_Nm'),
        ('tau2_Nm', 'q2_rad', '--response tau2_Nm: one.csv: the column is a torque (Nm); expected m, mm, um, rad'),
        ('q2_rad', 'time_s', '--load time_s: one.csv: the column is a time (s); expected N, kN, mN, Nm'),
        ('status', 'Fx_N', '--response status: one.csv: the column has no known unit'),
        ('q2_rad', 'Fx_N', 'these units do not go together: q2_rad is an angle and Fx_N a force'),
        ('q2_rad', 'tau4_Nm', 'q2_rad and tau4_Nm are columns of two joints, 2 and 4; choose --load tau2_Nm'),
        ('q2_rad', 'tau4_ext_Nm', 'are columns of two joints, 2 and 4; choose those of one joint'),
    ],
)
def test_columns_that_cannot_be(response: str | None, load: str | None, message: str) -> None:
    with pytest.raises(InputError) as caught:
        choose_columns(MANY, 'one.csv', response, load)
    assert message in str(caught.value)
    assert ';' in str(caught.value)


def test_the_other_column_is_found_where_it_is_the_only_one() -> None:
    assert choose_columns(MANY, 'one.csv', 'x_mm').load.heading == 'Fx_N'
    assert choose_columns(MANY, 'one.csv', None, 'Fx_N').response.heading == 'x_mm'
    assert choose_columns(['time_s', 'ch1_mm', 'ch2_N'], 'one.csv').load.heading == 'ch2_N'
    with pytest.raises(InputError, match='q2_rad is an angle and F_N a force'):
        choose_columns(['q2_rad', 'F_N'], 'one.csv', 'q2_rad')
    with pytest.raises(InputError, match='no column of the load that goes with q2_rad'):
        choose_columns(['q2_rad', 'F'], 'one.csv', 'q2_rad')
    with pytest.raises(InputError, match='arm_joint2_rad and pos_tau4_Nm are columns of two joints, 2 and 4'):
        choose_columns(['time_s', 'arm_joint2_rad', 'pos_tau4_Nm'], 'one.csv')
    with pytest.raises(InputError, match='2 columns of this name'):
        choose_columns(['q_rad', 'q_rad', 'tau_Nm'], 'one.csv', 'q_rad')


def loops(rest: int) -> RecordTable:
    """A motion to and fro of a spring, after a rest."""
    time, moved = sine(640)
    moved = np.concatenate([np.zeros(rest), moved])
    random = np.random.default_rng(0)
    force = 1e6 * moved + 20 * random.standard_normal(len(moved))
    step = time[1] - time[0]
    return RecordTable('loops.csv', step * np.arange(len(moved)), force, moved, 'N', 'm')


def test_what_drives_is_seen(tmp_path: Path) -> None:
    one = read(tmp_path, table())
    many = read(tmp_path, table(np.tile(torque(), 5)))
    assert what_drives([one]) == LOAD
    assert what_drives([many]) == LOAD
    assert what_drives([loops(0)]) == MOTION
    assert what_drives([loops(100)]) == MOTION
    assert what_drives([loops(100)], LOAD) == LOAD
    with pytest.raises(InputError, match=r'driven by its motion, but .*one\.csv by its load'):
        what_drives([one, loops(0)])


def test_an_angle_that_wraps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'one\.csv: line 4: angle_deg jumps by 6\.25 rad'):
        read(tmp_path, 'time_s,angle_deg,torque_Nm\n0,178,0\n1,179,1\n2,-179,1\n')
