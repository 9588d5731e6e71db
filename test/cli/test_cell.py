"""The verb `cell`, and `export --into`: from a URDF to a calibrated URDF."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from cli.command import refused
from cli.conftest import SLOW
from files.robots import SCARA
from files.test_robot_cell import cell_of

OBJECTS = """objects:
  - {name: disc_1, center: [0.35, 0.20], radius: 0.05}
  - {name: disc_2, center: [0.20, -0.30], radius: 0.04}
  - {name: disc_3, center: [-0.20, 0.35], radius: 0.06}
"""
DESCRIBE = ('--joints', 'shoulder', 'elbow', '--tip', 'tool', '--at', 'quill=0.05', 'flange=0.4')


def tips(path: Path) -> np.ndarray:
    with path.open() as stream:
        return np.array([[float(row['x_m']), float(row['y_m'])] for row in csv.DictReader(stream)])


def test_from_a_urdf_to_a_calibrated_urdf(run, without_page):
    """Read again, the tip of the corrected URDF is that of `locate --rigid`, in the robot's frame."""
    Path('robot.urdf').write_bytes(SCARA.replace('\n', '\r\n').encode())
    found = run('cell', '--urdf', 'robot.urdf', *DESCRIBE, '--out', 'cell.yaml')
    assert (found.status, found.out, found.err) == (0, 'cell.yaml\n', 'note: gravity is across the plane: none in it\n')
    text = Path('cell.yaml').read_text().replace('objects: []\n', OBJECTS)
    Path('cell.yaml').write_text(text + 'uncertainty: {effects: none}\n')
    assert run('simulate', '--cell', 'cell.yaml', '--out', 'recording', *SLOW).status == 0
    assert run('calibrate', 'recording', '--cell', 'cell.yaml', '--out', 'result').status == 0
    into = ('export', 'result/calibration.json', '--format', 'urdf', '--into', 'robot.urdf', '--out', 'better.urdf')
    written = run(*into)
    assert written.out == 'better.urdf\n' and 'cannot hold compliance and backlash' in written.err
    before, after = (Path(name).read_bytes().splitlines() for name in ('robot.urdf', 'better.urdf'))
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert len(changed) == 3 and all(b'<origin ' in old and b'<origin ' in new for old, new in changed)
    assert b'\r\n'.join(after) + b'\r\n' == Path('better.urdf').read_bytes()
    assert run('cell', '--urdf', 'better.urdf', *DESCRIBE, '--out', 'again.yaml').status == 0
    again = run('cell', '--urdf', 'better.urdf', *DESCRIBE, '--out', 'cell.yaml')
    refused(again, 2, 'cell.yaml: exists, and may have objects filled in; give another --out')
    rows = [f'{q1},{q2},0,0' for q1, q2 in np.random.default_rng(0).uniform(-2, 2, (50, 2)).tolist()]
    Path('states.csv').write_text('\n'.join(['q1_rad,q2_rad,fx_N,fy_N', *rows]))
    places = []
    for source, cell, out in (
        ('result/calibration.json', 'cell.yaml', 'one.csv'), ('again.yaml', 'again.yaml', 'two.csv'),
    ):  # fmt: skip
        assert run('locate', source, 'states.csv', '--rigid', '--out', out).status == 0
        plane = cell_of(Path(cell).read_text()).plane
        places.append(plane.in_robot(tips(Path(out))))
    np.testing.assert_allclose(places[0], places[1], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('--urdf', 'none.urdf', *DESCRIBE), 'none.urdf: there is no such file'),
        (('--urdf', 'robot.urdf', *DESCRIBE, 'quill=0.06'), '--at: names a joint twice; give one position of each'),
        (DESCRIBE, 'one of the arguments --urdf --topic is required'),
    ],
)
def test_a_wrong_command_is_one_line(run, arguments, words):
    Path('robot.urdf').write_text(SCARA)
    refused(run('cell', *arguments, '--out', 'cell.yaml'), 2, words)
    assert not Path('cell.yaml').exists()


def test_the_urdf_is_not_replaced(run):
    Path('robot.urdf').write_text(SCARA)
    for arguments, words in (
        (('cell', '--urdf', 'robot.urdf', *DESCRIBE, '--out', 'robot.urdf'), 'is an input and would be replaced'),
        (('export', 'c.json', '--format', 'dh', '--into', 'robot.urdf'), '--into: is for --format urdf with --out'),
    ):
        refused(run(*arguments), 2, words)
