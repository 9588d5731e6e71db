"""A user's URDF with corrected origins: the tip is that of the arm, all else stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from files.robots import CASES, SCARA, Case, Tree, text_of
from files.test_robot_cell import cell_of, described

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.calibration_file import nominal_arm
from scara_kinetostatic.files.export import exported_into
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import Plane
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward


def calibrated(text: str, name: str = 'scara', l2: float = -1.5e-3) -> CalibratedArm:
    """An arm that differs from the URDF by some millimetres and milliradians."""
    arm = nominal_arm(cell_of(described(text, name)[0]))
    n = arm.cell.nominal
    more = {'x0': 1e-3, 'y0': -2e-3, 'theta1': n.theta1 + 3e-3, 'l1': n.l1 + 1e-3, 'theta2': n.theta2 - 2e-3}
    return replace(arm, model=ExtendedModel(n.replace(**more, l2=n.l2 + l2, g1=1e-4)))


def into(arm: CalibratedArm, content: bytes, path: Path) -> tuple[str, list[str]]:
    path.write_bytes(content)
    return exported_into(arm, path, 'calibration.json')


def largest_miss(urdf: str, arm: CalibratedArm, case: Case) -> float:
    """Of the tip of a URDF from H(L, Q), at 20 poses, m."""
    readings, tree = np.random.default_rng(3).uniform(-3, 3, (20, 2)), Tree(urdf)
    held, p = dict(arm.cell.hold), arm.model.parameters
    tips = [tree.frame(case.tip, held | dict(zip(case.joints, pair, strict=True)))[1] for pair in readings.tolist()]
    off = arm.cell.plane.in_plane(np.array(tips))[:, :2] - forward(p, arm.cell.angles(readings))
    return float(np.abs(off).max())


@pytest.mark.parametrize('name', CASES)
def test_the_tip_is_that_of_the_calibrated_arm(name: str, tmp_path: Path) -> None:
    text = text_of(CASES[name])
    arm = calibrated(text, name)
    made, notes = into(arm, text.encode(), tmp_path / 'robot.urdf')
    assert largest_miss(text, arm, CASES[name]) > 1e-3 and largest_miss(made, arm, CASES[name]) < 1e-9
    found = cell_of(described(made, name)[0])
    assert (found.nominal.l1, found.nominal.l2) == pytest.approx((arm.model.parameters.l1, arm.model.parameters.l2))
    again, _ = into(arm, made.encode(), tmp_path / 'again.urdf')
    assert largest_miss(again, arm, CASES[name]) < 1e-9
    assert any('cannot hold compliance and backlash (p_ee 1e-05 m/N' in note for note in notes)


@pytest.mark.parametrize(('l2', 'number'), [(0.0, 2), (-1e-3, 3)])
def test_all_else_stays(l2: float, number: int, tmp_path: Path) -> None:
    """Two origins, and that of the joint behind for another l2; the comment stands before the root."""
    text = SCARA.replace('<robot', '<!-- a licence -->\n<robot xmlns:a="b"')
    text = text.replace('</robot>', '<a:x>&lt;</a:x>\n</robot>')
    made, _ = into(calibrated(SCARA, l2=l2), text.encode(), tmp_path / 'robot.urdf')
    before, after = ([line for line in each.splitlines() if '<!--' not in line] for each in (text, made))
    kept = [line for line in before if line in after]
    assert [line.split()[0] for line in before if line not in after] == ['<?xml'] + ['<origin'] * number
    assert [line for line in after if line in before] == kept
    comment = made[made.index('<!--\n') : made.index('<robot')]
    assert 'cannot hold compliance' in comment and made.index('<!-- a licence -->') < made.index(comment)
    assert '<!-- a comment of the user -->' in made and '<a:x>&lt;</a:x>' in made and 'xmlns:a="b"' in made


def test_an_origin_that_is_not_there_is_added(tmp_path: Path) -> None:
    bare = SCARA.replace('    <origin rpy="0 0 0.1" xyz="0.0 0.0 0.05"/>\n', '')
    arm = calibrated(bare)
    made, _ = into(arm, bare.encode(), tmp_path / 'robot.urdf')
    assert largest_miss(made, arm, CASES['scara']) < 1e-9


@pytest.mark.parametrize(
    ('change', 'plane', 'words'),
    [
        (('xyz="0.3 0.02', 'xyz="0.4 0.02'), {}, 'differs by 0.099 m or rad from what was calibrated'),
        (('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>'), {}, 'or a joint turns the other way; give the URDF'),
        (('"shoulder"', '"one"'), {}, "no joint 'shoulder'; its joints are one elbow quill flange"),
        (('', ''), {'plane': Plane()}, 'its cell has no robot.plane with a tip; describe the cell by'),
        (('', ''), {'coupling': 0.2}, 'a URDF has no coupling of joints'),
        (('a comment of the user', 'd\xe9j\xe0 vu'), {}, 'is no valid URDF: not well-formed'),
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
    text, _ = into(arm, SCARA.encode(), tmp_path / 'robot.urdf')
    assert text[text.index('<robot') :] == SCARA[SCARA.index('<robot') :]
