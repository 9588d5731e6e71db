"""A user's URDF with corrected origins: the tip is that of the arm, all else stays."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from files.robots import CASES, SCARA, Case, Tree, text_of
from files.test_robot_cell import cell_of, described

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.files.export import exported_into
from scara_kinetostatic.files.urdf import RobotDescription
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import Lift, Plane
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward


def calibrated(text: str, name: str = 'scara', l2: float = -1.5e-3, **more: object) -> CalibratedArm:
    """An arm that differs from the URDF by some millimetres and milliradians."""
    arm = nominal_arm(cell_of(described(text, name, **more)[0]))
    n = arm.cell.nominal
    values = {'x0': 1e-3, 'y0': -2e-3, 'theta1': n.theta1 + 3e-3, 'l1': n.l1 + 1e-3, 'theta2': n.theta2 - 2e-3}
    return replace(arm, model=ExtendedModel(n.replace(**values, l2=n.l2 + l2, g1=1e-4)))


def into(arm: CalibratedArm, content: bytes, path: Path) -> tuple[bytes, list[str]]:
    path.write_bytes(content)
    return exported_into(arm, path, 'calibration.json')


def largest_miss(urdf: str | bytes, arm: CalibratedArm, case: Case) -> float:
    """Of the tip of a URDF from H(L, Q), at 20 poses, m."""
    readings, tree = np.random.default_rng(3).uniform(-3, 3, (20, 2)), Tree(urdf)
    held, p = arm.cell.positions, arm.model.parameters
    tips = [tree.frame(case.tip, held | dict(zip(case.joints, pair, strict=True)))[1] for pair in readings.tolist()]
    off = arm.cell.plane.in_plane(np.array(tips))[:, :2] - forward(p, arm.cell.angles(readings))
    return float(np.abs(off).max())


@pytest.mark.parametrize('name', CASES)
def test_the_tip_is_that_of_the_calibrated_arm(name: str, tmp_path: Path) -> None:
    text = text_of(CASES[name])
    arm = calibrated(text, name)
    made, notes = into(arm, text.encode(), tmp_path / 'robot.urdf')
    assert largest_miss(text, arm, CASES[name]) > 1e-3 and largest_miss(made, arm, CASES[name]) < 1e-9
    found = cell_of(described(made.decode(), name)[0])
    assert (found.nominal.l1, found.nominal.l2) == pytest.approx((arm.model.parameters.l1, arm.model.parameters.l2))
    again, _ = into(arm, made, tmp_path / 'again.urdf')
    assert again == made
    assert any('cannot hold compliance and backlash (p_ee 1e-05 m/N' in note for note in notes)


def decorated(text: str) -> str:
    """All that users write: what only `check_urdf` reads, quotes and lines as they like, another origin afterwards."""
    text = text.replace('<robot', '<!-- a -- licence -->\n<robot xmlns="u" xmlns:a="b"')
    text = text.replace(
        '<origin rpy="0 0 0.1" xyz="0.0 0.0 0.05"/>', "<origin a:b='x'\n\t xyz = '0.0 0.0 0.05'\n\t rpy='0 0 0.10' />"
    )
    text = text.replace('<axis xyz="0 0 -1"/>', '<origin xyz="1 2 3"/><axis xyz="0 0 -1"/>')
    return text.replace('</robot>', '<gazebo><c:x d:y="1"/>&lt;\u00e4</gazebo>\n</robot>')


ENCODINGS = ['utf-8', 'utf-8-sig', 'utf-16', 'latin-1', 'iso-8859-1']


@pytest.mark.parametrize('encoding', ENCODINGS)
@pytest.mark.parametrize(('l2', 'number'), [(0.0, 2), (-1e-3, 3)])
def test_every_other_byte_stays(l2: float, number: int, encoding: str, tmp_path: Path) -> None:
    """Two origins change, and that of the joint behind for another l2."""
    text, arm = decorated(SCARA).replace('\n', '\r\n'), calibrated(SCARA, l2=l2)
    if encoding == 'iso-8859-1':
        text = text.replace('"1.0"?', f'"1.0" encoding="{encoding}"?')
    made, notes = into(arm, text.encode(encoding), tmp_path / 'robot.urdf')
    after = made.decode(encoding)
    assert after.encode(encoding) == made and notes[-1].startswith('changed are the origins of shoulder, elbow')
    kept, changed = (re.split('(<origin[^>]*>)', each) for each in (text, after))
    different = [k for k, (old, new) in enumerate(zip(kept, changed, strict=True)) if old != new]
    assert len(different) == number and all(k % 2 for k in different)
    assert re.fullmatch(r"<origin a:b='x'\r\n\t xyz = '\S+ \S+ 0.05'\r\n\t rpy='0 0 0.103' />", changed[different[0]])
    plain, _ = into(arm, SCARA.encode(), tmp_path / 'plain.urdf')
    one, other = (RobotDescription(each, 'robot.urdf').joints for each in (made, plain))
    assert all((one[name].xyz, one[name].rpy) == (other[name].xyz, other[name].rpy) for name in one)


@pytest.mark.parametrize('missing', ['xyz="0.0 0.0 0.05"', 'rpy="0 0 0.1" xyz="0.0 0.0 0.05"'])
def test_an_attribute_that_is_not_there_is_added(missing: str, tmp_path: Path) -> None:
    bare = SCARA.replace(missing, '')
    arm = calibrated(bare)
    made, _ = into(arm, bare.encode(), tmp_path / 'robot.urdf')
    assert largest_miss(made, arm, CASES['scara']) < 1e-9


def test_an_origin_that_is_not_there_is_added(tmp_path: Path) -> None:
    bare = SCARA.replace('    <origin rpy="0 0 0.1" xyz="0.0 0.0 0.05"/>\n', '')
    arm = calibrated(bare)
    made, _ = into(arm, bare.encode(), tmp_path / 'robot.urdf')
    assert largest_miss(made, arm, CASES['scara']) < 1e-9
    assert re.search('"revolute">\n    <origin xyz="[^"]*" rpy="[^"]*"/>\n    <parent', made.decode())


@pytest.mark.parametrize(
    ('change', 'plane', 'words'),
    [
        (('xyz="0.3 0.02', 'xyz="0.4 0.02'), {}, 'differs by 0.099 m or rad from what was calibrated'),
        (('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>'), {}, 'or a joint turns the other way; give the URDF'),
        (('"shoulder"', '"one"'), {}, "no joint 'shoulder'; its joints are one elbow quill flange"),
        (('', ''), {'plane': Plane()}, 'its cell has no robot.plane with a tip; describe the cell by'),
        (('', ''), {'coupling': 0.2}, 'a URDF has no coupling of joints'),
        (
            ('<axis', '<axis <'),
            {},
            'is no valid URDF: line 13: expected a tag, got <axis < xyz="0 0 1"/>; correct it there',
        ),
    ],
)
def test_refused_in_one_line(change: tuple[str, str], plane: dict[str, object], words: str, tmp_path: Path) -> None:
    arm = calibrated(SCARA)
    arm = replace(arm, cell=replace(arm.cell, **plane))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=words.replace('(', r'\(')) as caught:
        into(arm, SCARA.replace(*change).encode('latin-1'), tmp_path / 'robot.urdf')
    assert '\n' not in str(caught.value)


def test_parameters_of_an_arm_that_is_not_changed_change_nothing(tmp_path: Path) -> None:
    arm = nominal_arm(cell_of(described(SCARA)[0]))
    content, notes = into(arm, SCARA.encode(), tmp_path / 'robot.urdf')
    assert content == SCARA.encode() and 'origins of no joint' in notes[-1]


@pytest.mark.parametrize('down', [None, 0.1])
def test_with_a_lift(down: float | None, tmp_path: Path) -> None:
    """The touches were made with it down, at the end of its travel or where the user has put that."""
    arm = calibrated(SCARA, at={'flange': 0.4})
    assert arm.cell.lift == Lift('quill', 0.0, 0.2)
    if down is not None:
        arm = replace(arm, cell=replace(arm.cell, lift=arm.cell.lift._replace(down=down)))
    made, _ = into(arm, SCARA.encode(), tmp_path / 'robot.urdf')
    assert largest_miss(made, arm, CASES['scara']) < 1e-9
