"""Keys of the cell description that say how the robot may move, and how it touches."""

from __future__ import annotations

import pytest

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.files.calibration_file import cell_entry, stored_cell
from scara_kinetostatic.files.cell_file import dump_cell, parse_cell
from scara_kinetostatic.model.cell import PAPER_CELL, Lift, TouchMotion

KEYS = {
    'limits': '  limits: {joint1: [-2.6, 2.5], joint2: [-2.4, 2.3]}',
    'lift': '  lift: {joint: joint3, up: 0.02, down: 0.0}',
    'hold': '  hold: {joint4: 0.5}',
    'obstacles': 'obstacles: [{outline: [[0.3, 0.1], [0.5, 0.1], [0.5, 0.3]]}]',
    'touch': 'touch: {force: [20, 50], max_force: 80, contact_speed: 0.005}',
}


def text(**changes: str) -> str:
    """The paper's cell with these keys, some of them changed."""
    keys = KEYS | changes
    begin, end = dump_cell(PAPER_CELL).split('objects:')
    robot = '\n'.join(keys[name] for name in ('limits', 'lift', 'hold'))
    return f'{begin}{robot}\nobjects:{end}{keys["obstacles"]}\n{keys["touch"]}\n'


def test_they_are_read_written_and_stored():
    cell = parse_cell(text())
    assert cell.limits == ((-2.6, 2.5), (-2.4, 2.3))
    assert cell.lift == Lift('joint3', 0.02, 0.0)
    assert cell.hold == {'joint4': 0.5}
    assert cell.obstacles == (((0.3, 0.1), (0.5, 0.1), (0.5, 0.3)),)
    assert cell.touch == TouchMotion((20.0, 50.0), 80.0, contact_speed=0.005)
    assert parse_cell(dump_cell(cell)) == cell
    assert stored_cell(cell_entry(cell), 'file') == cell
    assert (PAPER_CELL.limits, PAPER_CELL.lift, PAPER_CELL.obstacles) == (None, None, ())


@pytest.mark.parametrize(
    ('key', 'old', 'new', 'message'),
    [
        ('limits', '-2.6', '-150', 'robot.limits.joint1.lower limit: expected -12.6 to 12.6 rad, got -150'),
        ('limits', '-2.4, 2.3', '2.3, -2.4', 'robot.limits.joint2: expected the lower limit first'),
        ('limits', 'joint2', 'elbow', "robot.limits: unknown key 'elbow'"),
        ('lift', '0.02', '0.0', 'robot.lift.up: up and down are both 0: it does not lift'),
        ('lift', 'joint3', 'joint1', "robot.lift.joint: 'joint1' is one of joint_names"),
        ('hold', 'joint4', 'joint3', 'robot.hold.joint3: it is a joint of the plane or the lift'),
        ('hold', '{joint4: 0.5}', '[joint4]', 'robot.hold: expected a mapping'),
        ('hold', 'joint4', '"a\\nb"', 'robot.hold: expected names of joints'),
        ('obstacles', '[0.3, 0.1], ', '', 'obstacles[0].outline: expected 3 to 50 corners'),
        ('obstacles', '[0.3, 0.1]', '[0.3]', 'obstacles[0].outline.corner 0: expected [x, y], got [0.3]'),
        ('touch', '80', '50', 'touch.max_force: expected more than the largest force of 50 N'),
        ('touch', '[20, 50]', '[50, 20]', 'touch.force: expected the smallest force first'),
        ('touch', '0.005', '0.5', 'touch.contact_speed: expected above 0, at most 0.05 m/s, got 0.5'),
    ],
)
def test_what_is_wrong_is_refused_in_one_line(key, old, new, message):
    assert old in KEYS[key]
    with pytest.raises(CellError) as refused:
        parse_cell(text(**{key: KEYS[key].replace(old, new)}), 'cell.yaml')
    assert str(refused.value).startswith(f'cell.yaml: {message}')
    assert '\n' not in str(refused.value)
