"""The table of touches: what it may look like, and one clear line for everything that is wrong with one."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.tables import EXAMPLE, _touches, is_touch_table, load_touch_table, parse_table
from scara_kinetostatic.model.cell import SensorFrame

HEADING = 'q1_rad,q2_rad,fx_N,fy_N'
ROW = '0.5,1.5,-10,0.25'


def parse(*lines: str):
    return _touches(parse_table('\n'.join(lines) + '\n', 'touches.csv', EXAMPLE))


def test_the_four_columns():
    table = parse(HEADING, ROW)
    assert (table.objects, table.time.tolist(), table.approach.tolist()) == (('',), [0.0], [[0.0, 0.0]])
    assert (table.lines, table.notes) == ((2,), ())


def test_all_columns_in_any_order_with_comments_empty_lines_and_empty_cells():
    table = parse(
        '# from the robot in hall 3',
        '',
        'object,time_s,approach2,approach1,fy_N,fx_N,q2_rad,q1_rad,operator',
        'disc_1,12.5,-1e-3,2e-3,4,3,2,1,me',
        ',13.5,,,8,7,6,5,me',
        ',,,,,,,',
        '# the last one was interrupted',
    )
    np.testing.assert_array_equal(table.joints, [[1, 2], [5, 6]])
    np.testing.assert_array_equal(table.force, [[3, 4], [7, 8]])
    np.testing.assert_array_equal(table.time, [0, 1])
    np.testing.assert_array_equal(table.approach, [[2e-3, -1e-3], [0, 0]])
    assert table.objects == ('disc_1', '')
    assert table.lines == (4, 5)
    assert table.notes == ("columns that are unknown and not used: 'operator'",)


def test_a_word_more_makes_another_column_and_another_unit_is_refused():
    table = parse(HEADING + ',fx_calibrated_N', ROW + ',1')
    np.testing.assert_array_equal(table.force, [[-10, 0.25]])
    assert table.notes == ("columns that are unknown and not used: 'fx_calibrated_N'",)
    with pytest.raises(
        RecordingError, match="'time_ns' has none of the units of time; convert or rename it to time_s or time_ms"
    ):
        parse(HEADING + ',time_ns', ROW + ',1')


def test_rows_without_angles_and_force_are_noted_and_not_used():
    table = parse(HEADING + ',object', ROW + ',disc_1', ',,,,disc_2', ROW + ',disc_3', ' , ,,,disc_4')
    assert table.lines == (2, 4)
    assert table.objects == ('disc_1', 'disc_3')
    assert table.notes == ('line 3 and 1 more: no joint angles and no force; not used',)


def test_rows_that_are_not_finite_are_counted_and_not_used():
    bad = [ROW.replace('1.5', word) for word in ('nan', 'NaN', '-inf', 'Infinity', ' nan ', '-nan(ind)')]
    table = parse(HEADING, ROW, *bad[:1], *[ROW] * 11, *bad[1:], *bad[:4], ROW)
    assert len(table.lines) == 13
    lines = '3, 15, 16, 17, 18, 19, 20, 21 and 2 more'
    assert table.notes == (f'not finite: 10 of 23 rows, line {lines}; not used',)
    assert parse(HEADING, ROW, bad[0]).notes == ('not finite: 1 of 2 rows, line 3; not used',)
    with pytest.raises(RecordingError, match='not finite: 2 of 3 rows, line 3, 4; not used; see what'):
        parse(HEADING, ROW, *bad[:2])


def test_forces_in_the_tool_frame_have_headings_of_their_own():
    table = parse('q1_rad,q2_rad,fx_tool_kN,fy_tool_N', '0.5,1.5,-0.01,0.25')
    np.testing.assert_array_equal(table.force, [[-10, 0.25]])
    assert table.frame is SensorFrame.TOOL
    table = parse(HEADING + ',fx_tool_N,fy_tool_N', ROW + ',7,8')
    np.testing.assert_array_equal(table.force, [[-10, 0.25]])
    assert table.frame is SensorFrame.BASE
    with pytest.raises(RecordingError, match="there is no column 'fy_tool_N'"):
        parse('q1_rad,q2_rad,fx_tool_N,fy_N', ROW)


@pytest.mark.parametrize(
    'text',
    [
        'q1_rad;q2_rad;fx_N;fy_N\n0,5;1,5;-10;0,25\n',
        'q1_rad\tq2_rad\tfx_N\tfy_N\r\n0,5\t1.5\t-1,0e1\t,25\r\n',
        'Q1_RAD, Q2_rad ,"fx_N",FY_n\n 0.5 ,"1.5",\N{MINUS SIGN}10,+.25\n',
        'q1 [rad],q2 (rad),fx [N],fy N\n0.5,1.5,-10.,25e-2\n',
        'q1_mrad,q2_urad,fx_kN,fy_mN\n500,1500000,-0.01,250\n',
        'q1 [°],q2_deg,fx (kN),fy_N\n28.64788975654116,85.94366926962348,-1e-2,0.25\n',
    ],
)
def test_ways_of_writing_the_same(text, tmp_path):
    for encoding in ('utf-8', 'utf-8-sig', 'utf-16', 'latin-1'):
        if encoding == 'latin-1':
            text = text.replace('\N{MINUS SIGN}', '-')
        path = tmp_path / 'touches.csv'
        path.write_text(text, encoding=encoding)
        table = load_touch_table(path)
        np.testing.assert_allclose([*table.joints[0], *table.force[0]], [0.5, 1.5, -10, 0.25], rtol=1e-12)


def test_times_and_last_movements_are_converted_too():
    table = parse(HEADING + ',time_ms,approach1_mrad,approach2_deg', ROW + ',0,2,-180', ROW + ',1500,-2,180')
    np.testing.assert_allclose(table.time, [0, 1.5])
    np.testing.assert_allclose(table.approach, [[2e-3, -np.pi], [-2e-3, np.pi]])


@pytest.mark.parametrize(
    ('lines', 'message'),
    [
        ([], 'the file is empty; begin with a line such as q1_rad,q2_rad,fx_N,fy_N'),
        ([HEADING], 'there are no rows below the heading'),
        ([ROW, ROW], "there is no column 'q1_rad', got 0.5, 1.5, -10, 0.25; name them q1_rad,q2_rad,fx_N,fy_N"),
        (['q1_rad,q2_rad,fx_N', '1,2,3'], "there is no column 'fy_N', got q1_rad, q2_rad, fx_N; name them q1_rad,"),
        (['q1_mm,q2_deg,fx_N,fy_N', ROW], "the column 'q1_mm' has none of the units of q1; convert or rename it to"),
        (['q1,q2,fx_N,fy_N', ROW], "the column 'q1' has none of the units of q1; convert or rename it to q1_rad or"),
        ([HEADING + ',approach1_mm', ROW + ',1'], "the column 'approach1_mm' has none of the units of approach1"),
        ([HEADING + ',q1_deg', ROW + ',1'], "two columns of q1_rad, 'q1_rad' and 'q1_deg'; leave one out"),
        ([HEADING + ',object,Object', ROW + ',a,b'], "two columns of object, 'object' and 'Object'"),
        ([HEADING + ',approach1', ROW + ',1'], 'there is one of approach1 and approach2; give both, or none'),
        ([HEADING, ROW, '1,2,x,4'], "line 3: fx_N: expected a number, got 'x'"),
        ([HEADING + ',object', ',,,,a'], 'no row has a number in q1_rad,q2_rad,fx_N,fy_N'),
        ([HEADING, '1,2,3'], 'line 2: fy_N: expected a number, got nothing'),
        ([HEADING, 'nan,2,3,4'], 'not finite: 1 of 1 rows, line 2; not used; see what writes'),
        ([HEADING, '1,1e400,3,4'], 'line 2: q2_rad: 1e400 is too large to be plausible'),
        ([HEADING, '1,2,3,4,5'], 'line 2: expected 4 columns, got 5 (a decimal comma needs semicolons'),
        ([HEADING, '25,117,3,4'], 'line 2: q2_rad: 117 is too large to be plausible; name it q2_deg'),
        (['q1 (deg),q2_rad,fx_N,fy_N', '2e3,1,3,4'], 'line 2: q1 (deg): 2e3 is too large to be plausible; check'),
        ([HEADING, 'a,2,3,4', ROW, 'b,1,1,1', '1,1,1,c'], "line 2: q1_rad: expected a number, got 'a'; wrong row"),
        ([HEADING + ',time_s', ROW + ',1', ROW + ','], 'time_s: some cells are empty; give the time of every touch'),
        ([HEADING + ',object', ROW + ',"disc'], 'line 2: not CSV'),
    ],
)  # fmt: skip
def test_what_is_wrong_is_one_line(lines, message):
    with pytest.raises(RecordingError) as error:
        parse(*lines)
    text = str(error.value)
    assert text.startswith(f'touches.csv: {message}')
    assert '\n' not in text


@pytest.mark.parametrize(
    ('data', 'message'),
    [
        (b'PK\x03\x04', 'expected CSV, got a spreadsheet; save it as CSV'),
        (b'q1_rad\x00\x01', 'expected CSV text, got binary data'),
        ('q1_rad'.encode('utf-16') + b'\x00', 'expected CSV text, got binary data'),
        ('q1_rad'.encode('utf-32'), 'expected CSV text, got binary data'),
    ],
)
def test_files_that_are_no_csv(tmp_path, data, message):
    path = tmp_path / 'touches.csv'
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=message):
        load_touch_table(path)


def test_a_table_is_known_by_its_suffix(tmp_path):
    assert is_touch_table('a/b.csv')
    assert is_touch_table('B.CSV')
    assert not is_touch_table('b.mcap')
    (tmp_path / 'recording.csv').mkdir()
    assert not is_touch_table(tmp_path / 'recording.csv')
