"""A cell description from a URDF has the kinematics and the weight of the robot; what makes no arm is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from files.robots import CASES, SCARA, Tree, text_of

from scara_kinetostatic.errors import CellError, InputError
from scara_kinetostatic.files.cell_file import load_cell, read_cell
from scara_kinetostatic.files.robot_cell import robot_cell
from scara_kinetostatic.files.urdf import RobotDescription, read_robot
from scara_kinetostatic.files.yaml_file import parse_yaml
from scara_kinetostatic.model.cell import Cell, Lift, SensorFrame
from scara_kinetostatic.model.joint_law import joint_torques
from scara_kinetostatic.model.kinematics import forward


def cell_of(text: str) -> Cell:
    return read_cell(parse_yaml(text, 'cell.yaml', CellError), 'cell.yaml', may_be_empty=True)


def described(text: str, name: str = 'scara', **more: object) -> tuple[str, list[str]]:
    case = CASES[name]
    given = {'joints': case.joints, 'tip': case.tip, 'at': case.at} | more
    return robot_cell(RobotDescription(text.encode(), 'robot.urdf'), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize('name', CASES)
def test_tip_and_weight_are_those_of_the_robot(name: str) -> None:
    """20 poses each; axes that are not exactly parallel, as the truncated numbers of one make them, cost torque."""
    case, text = CASES[name], text_of(CASES[name])
    cell, tree = cell_of(described(text, name)[0]), Tree(text)
    assert cell.hold.keys() >= case.at.keys() and cell.plane.tip == case.tip
    readings = np.random.default_rng(7).uniform(-3, 3, (20, 2))
    positions = [dict(cell.hold) | dict(zip(case.joints, pair, strict=True)) for pair in readings.tolist()]
    tips = np.array([tree.frame(case.tip, each)[1] for each in positions])
    angles = cell.angles(readings)
    np.testing.assert_allclose(cell.plane.in_plane(tips)[:, :2], forward(cell.nominal, angles), rtol=0, atol=1e-9)
    torques = [[tree.holding_torque(joint, each) for joint in case.joints] for each in positions]
    found = cell.in_sense(joint_torques(cell.nominal, angles, np.zeros((20, 2))))
    np.testing.assert_allclose(found, torques, rtol=0, atol=1e-5 if name == 'xarm' else 1e-9)


def test_the_description_of_an_upright_arm(tmp_path: Path) -> None:
    text, notes = described(text_of(CASES['ur5']), 'ur5', at={}, sensor='tool0')
    cell = cell_of(text)
    assert notes == [] and 'not stated, so taken as 0: shoulder_pan_joint wrist_1_joint' in text
    assert cell.direction == (-1, -1) and cell.nominal.gravity == (0.0, -9.81)
    assert (cell.plane.frame, cell.plane.x, cell.plane.y) == ('world', (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert cell.nominal.l1 == 0.425 and cell.plane.origin[2] == 0.089159
    assert cell.uncertainty.nominal['s1'] == pytest.approx(0.3 * cell.nominal.s1, rel=1e-2)
    path = tmp_path / 'cell.yaml'
    path.write_text(text)
    with pytest.raises(CellError, match='give at least one'):
        load_cell(path)


@pytest.mark.parametrize('name', ['scara', 'ur5'])
def test_the_sensor_sees_the_force_as_it_is_mounted(name: str) -> None:
    case = CASES[name]
    text = text_of(case)
    cell, tree = cell_of(described(text, name)[0]), Tree(text)
    assert cell.sensor.frame is SensorFrame.TOOL and bool(cell.sensor.rotation) == (name == 'scara')
    readings, force = np.array([0.4, -0.9]), np.array([3.0, 5.0])
    turn, _ = tree.frame(case.tip, dict(cell.hold) | dict(zip(case.joints, readings, strict=True)))
    seen = cell.force_axes @ turn.T @ cell.plane.axes[:, :2] @ force
    angle = cell.angles(readings).sum() + cell.nominal.theta1 + cell.nominal.theta2
    at_link2 = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) @ force
    np.testing.assert_allclose(seen, at_link2, atol=1e-12)


def test_a_scara_has_no_gravity_in_its_plane_and_limits_of_its_readings() -> None:
    text, notes = described(SCARA)
    cell = cell_of(text)
    assert notes == ['gravity is across the plane: none in it'] and not cell.nominal.has_gravity
    assert cell.direction == (1, -1) and cell.limits == ((-2.5, 2.2), (-3.14, 3.14))
    assert 'elbow turns without end' in text
    assert cell_of(text.replace('[-3.14, 3.14]', '[-1.0, 2.0]')).limits == ((-2.5, 2.2), (-2.0, 1.0))


ELBOW = '<axis xyz="0 0 -1"/>\n  </joint>\n  <link name="fore'
BENEATH = '"frame"/>\n    <child link="upper_link"'
QUILL = '<axis xyz="0 0 -1"/>\n    <limit lower="0"'


@pytest.mark.parametrize(
    ('change', 'given', 'words'),
    [
        (('', ''), {'joints': ('shoulder', 'elbo')}, "no joint 'elbo'; did you mean 'elbow'?"),
        (('', ''), {'joints': ('elbow', 'shoulder')}, 'shoulder comes before elbow; write --joints shoulder elbow'),
        (('', ''), {'joints': ('elbow', 'elbow')}, 'elbow is named twice; name two joints, the shoulder first'),
        (('', ''), {'joints': ('shoulder', 'quill')}, "joint 'quill' is prismatic, not revolute"),
        (('', ''), {'tip': 'tol'}, "no link 'tol'; did you mean 'tool'?"),
        (('', ''), {'tip': 'fore_link'}, 'the tip is on the axis of joint 2: a link of length zero'),
        (('', ''), {'tip': 'upper_link'}, "elbow does not move link 'upper_link'; it is moved by shoulder"),
        (('', ''), {'at': {'quill': 0.5}}, 'quill at 0.5 is beyond its limits, 0 to 0.2; state another'),
        (('', ''), {'at': {'elbow': 0.5}}, '--at elbow: it is not a joint to be held'),
        (('"quill" type="prismatic"', '"quill" type="continuous"'), {'at': {'quill': -90}},
         '--at quill=-90 is beyond a turn; in degrees? Give rad: -1.5708'),
        (('', ''), {'sensor': 'frame'}, "link 'frame' is not moved by elbow; name the link of the sensor"),
        (('xyz="0.3 0.02 0.03"', 'xyz="0 0 0.03"'), {}, 'the axes of both joints are one: a link of length zero'),
        ((ELBOW, ELBOW.replace('0 0 -1', '0 1 -1')), {}, 'are 45 degrees from parallel; choose two parallel'),
        ((QUILL, '<mimic joint="elbow"/>' + QUILL), {}, "joint 'quill' on the way to 'tool' mimics elbow"),
        ((BENEATH, BENEATH.replace('frame', 'tool')), {}, "above 'fore_link' go round in a loop"),
        (('link="tool"', 'link="upper_link"'), {}, 'two of its joints have one child: a loop'),
        (('xyz="0.3 0.02', 'xyz="0.3 nan'), {}, "joint 'elbow' has no axis, or a number that is not finite"),
        (('xyz="0.3 0.02 0.03', 'xyz="0.3'), {}, 'is no valid URDF: line 20: expected 3 numbers, got xyz="0.3"'),
        (('parent link="quill_link"', 'parent link="quil"'), {}, 'one link without a parent, got base quil'),
        (('type="prismatic"', 'type="floating"'), {'at': {}}, "joint 'quill' on the way to 'tool' is floating"),
        (('joint name="flange"', 'joint name="quill"'), {}, 'two of its joints or links have one name; give'),
    ],
)  # fmt: skip
def test_what_makes_no_arm_is_one_line(change: tuple[str, str], given: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words.replace('(', r'\(').replace('?', r'\?')) as caught:
        described(SCARA.replace(*change), **given)
    assert '\n' not in str(caught.value) and str(caught.value).startswith('robot.urdf: ')


def test_a_prismatic_joint_between_the_two_is_refused() -> None:
    moved = SCARA.replace('name="quill" type="prismatic"', 'name="wrist" type="revolute"')
    moved = moved.replace('name="elbow" type="continuous"', 'name="slide" type="prismatic"')
    with pytest.raises(InputError, match="'slide' between the two is prismatic: link 1 has no length of its own"):
        described(moved, joints=('shoulder', 'flange'), at={})


def test_axes_that_are_one_degree_off_are_said() -> None:
    text, notes = described(SCARA.replace(ELBOW, ELBOW.replace('0 0 -1', '0 0.017455 -1')))
    cost = 'the tip leaves the plane by up to 4.4 mm, and is in it up to 39 µm from where the model has it'
    assert notes[0] == f'the axes are 1 degrees off parallel: {cost}'
    assert notes[0] in text.replace('Their axes', 'the axes')


def test_without_inertias_the_moments_are_to_be_stated() -> None:
    lying = SCARA.replace('rpy="0 0 0.3"', 'rpy="1.5707963267948966 0 0"')
    cell = cell_of(described(lying)[0])
    assert cell.nominal.gravity == (0.0, -9.81) and cell.nominal.s1 > 0
    text, notes = described(lying.replace('inertial>', 'visual>'))
    assert notes == ['robot.urdf has no inertias: state robot.moments, {s1, s2} in kg m']
    assert cell_of(text).nominal.s1 == 0


FINGER = """<joint name="finger" type="prismatic"><parent link="tool"/><child link="finger_link"/><axis xyz="1 0 0"/>
<limit lower="0" upper="0" effort="1" velocity="1"/></joint>
<link name="finger_link"><inertial><mass value="1"/></inertial></link>
<joint name="other" type="prismatic"><parent link="tool"/><child link="other_link"/><mimic joint="finger"/></joint>
<link name="other_link"><inertial><mass value="1"/></inertial></link></robot>"""


def test_joints_off_the_way_carry_weight_where_at_puts_them() -> None:
    """Those that mimic one follow it; limits that are none, as lower 0 and upper 0, bound nothing."""
    lying = SCARA.replace('rpy="0 0 0.3"', 'rpy="1.5707963267948966 0 0"').replace('</robot>', FINGER)
    (first, _), (text, notes) = described(lying), described(lying, at=CASES['scara'].at | {'finger': 0.02})
    assert notes == [] and cell_of(text).hold['finger'] == 0.02
    assert cell_of(text).nominal.s2 != cell_of(first).nominal.s2


@pytest.mark.parametrize(
    ('change', 'words'),
    [('xyz="0.3 0.02 0.03"', 'line 20 has xyz="${L1} 0 0"'), ('<link name="frame"/>', 'line 8 has <xacro:property>')],
)
def test_a_xacro_in_a_urdf_is_to_be_expanded(change: str, words: str) -> None:
    text = SCARA.replace(change, 'xyz="${L1} 0 0"' if 'xyz' in change else '<xacro:property name="a" value="1"/>')
    with pytest.raises(InputError) as caught:
        described(text)
    assert str(caught.value).endswith(f'{words}; expand it: xacro robot.urdf > expanded.urdf')
    assert (
        described(SCARA.replace('<robot', '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"'))[0]
        == described(SCARA)[0]
    )


def test_a_xacro_is_refused() -> None:
    with pytest.raises(InputError, match=r'a xacro is a program; expand it: xacro arm\.urdf\.xacro > robot\.urdf'):
        read_robot(Path('arm.urdf.xacro'))


@pytest.mark.parametrize('turn', ['3.141592653589793 0 0', '3.14159 0 0', '0 3.1415 0', '3.14 0 0.3'])
def test_a_scara_that_hangs_is_level_whatever_its_urdf_rounds(turn: str) -> None:
    text, notes = described(SCARA.replace('rpy="0 0 0.3"', f'rpy="{turn}"'))
    cell = cell_of(text)
    assert not cell.nominal.has_gravity and 'gravity is across the plane' in notes[-1] and 'none in it' in notes[-1]
    assert abs(cell.plane.x[2]) < 2e-3 and ('degrees' in notes[-1]) == (turn != '3.141592653589793 0 0')


def test_a_link_without_a_mass_has_no_moment_to_trust() -> None:
    text = SCARA.replace('rpy="0 0 0.3"', 'rpy="1.5707963267948966 0 0"')
    bare = text.replace('<inertial><mass value="2"/><origin xyz="0.1 0 0"/></inertial>', '')
    assert set(cell_of(described(text)[0]).uncertainty.nominal) == {'s1', 's2'}
    assert set(cell_of(described(bare)[0]).uncertainty.nominal) == {'s1'}
    with pytest.raises(InputError, match=r"the mass of link 'fore_link' is -2 kg"):
        described(text.replace('mass value="2"', 'mass value="-2"'))


def test_lengths_that_no_cell_has_are_refused_at_once() -> None:
    with pytest.raises(CellError, match='l1'):
        described(SCARA.replace('xyz="0.3 0.02 0.03"', 'xyz="300 20 30"'))


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('type="revolute"', 'type="revolute" drake:acceleration="1"'),
        ('<inertial><mass value="4"/>', '<inertial a="1"b="2"><mass value="4"/><mass value="9"/>'),
        ('</inertial>', '</inertial><inertial><mass value="99"/></inertial>'),
        ('<axis xyz="0 0 -1"/>', '<axis xyz="0 0 -1"/><origin xyz="9 9 9"/><axis xyz="1 0 0"/>'),
        ('<robot', '<robot xmlns="http://drake.mit.edu"'),
        ('</robot>', '<gazebo><a:b c:d="<&"/><![CDATA[</robot>]]></gazebo><!-- a -- b --></robot>'),
        ('<?xml', 'Warning: of another program\n<?xml'),
        ('<?xml', '\ufeff<!-- first --><?xml'),
        ('<robot', '<!DOCTYPE robot><robot'),
        ('a comment of the user', 'd\xe9j\xe0 vu'),
        ('name="shoulder"', 'name="shoulder" name="other"'),
        ('<visual/>', ''),
        ('</robot>', '<link name="eye"><visual><geometry><mesh filename="package://a/b.stl"/></geometry></visual></link>'
         '<joint name="eyes" type="fixed"><parent link="tool"/><child link="eye"/><axis xyz=""/></joint></robot>'),
        ('</robot>', '<link name="f"/><joint name="f" type="planar"><parent link="base"/><child link="f"/></joint>'
         '</robot>'),
    ],
)  # fmt: skip
@pytest.mark.parametrize('encoding', ['utf-8', 'utf-16', 'latin-1'])
def test_what_check_urdf_reads_is_read(old: str, new: str, encoding: str) -> None:
    """The first of what is there twice; none of it changes the arm."""
    content = SCARA.replace(old, new).encode(encoding, 'replace')
    case = CASES['scara']
    assert robot_cell(RobotDescription(content, 'robot.urdf'), case.joints, case.tip, case.at) == described(SCARA)


def test_names_of_any_letters_are_kept() -> None:
    text, _ = described(SCARA.replace('"elbow"', '"\u00c9paule &amp; 2: #"'), joints=('shoulder', '\u00c9paule & 2: #'))
    assert cell_of(text).joint_names == ('shoulder', '\u00c9paule & 2: #')


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 'is no URDF: expected <robot>, there is no tag in it'),
        ('joint 1', 'is no URDF: expected <robot>, there is no tag in it'),
        ('<?xml version="1.0"?>\n<sdf><robot/></sdf>', 'is no URDF: expected <robot>, its root is <sdf>'),
        ('<robot name="a"/>', 'there is no <link> in its <robot>'),
        (SCARA[:-60], 'line 35: expected a tag, got <limit lower='),
        (SCARA.replace('</robot>', ''), 'line 2: <robot> has no end'),
        (SCARA.replace('<!-- a comment of the user -->', '<!-- a'), 'line 2: expected a tag, got <!-- a'),
        (SCARA.replace('"frame"/>\n', '"frame">\n', 1), 'line 7: </joint> where </child> of line 5 is expected'),
        (SCARA.replace('</robot>', '</robot></robot>'), 'line 38: </robot> where no end is expected'),
        ('<robot>' + '<a>' * 10**6, 'line 1: more than 100 tags within each other'),
        (SCARA.replace('<child link="upper_link"/>', ''), 'line 9: a joint without <child> with link'),
        (SCARA.replace('name="shoulder" ', ''), 'line 9: a joint without name'),
        (SCARA.replace('"-2.5"', '"-2,5"'), 'line 14: expected a number, got lower="-2,5" in <limit>'),
        (SCARA.replace('</robot>', '<link name="other"/></robot>'), 'one link without a parent, got base other'),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_said_with_its_line(text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        described(text)
    assert words in str(caught.value) and 'check_urdf' not in str(caught.value)


@pytest.mark.parametrize('dust', ['1e-15', '-3e-6', '4e-14', '0.00002', '-1e-05'])
@pytest.mark.parametrize('where', ['rpy="0 0 0.1"', 'rpy="0 0 0"', 'xyz="0.25 0 -0.1"', '<axis xyz="0 0 -1"/>'])
def test_every_reader_of_yaml_reads_the_numbers(dust: str, where: str) -> None:
    """PyYAML takes 1e-15 as a string; dust is 0."""
    for lying in ('0 0 0.3', '1.5707963267948966 0 0'):
        text, _ = described(SCARA.replace('0 0 0.3"', f'{lying}"').replace(where, where.replace('0 0', f'0 {dust}', 1)))
        tree = yaml.safe_load(text)
        assert tree == parse_yaml(text, 'cell.yaml', CellError)
        numbers = [*tree['robot']['nominal'].values(), *tree['robot'].get('moments', {}).values()]
        numbers += [*tree['robot']['plane']['origin'], *tree['robot']['plane']['x'], *tree.get('gravity', [0.0])]
        assert all(isinstance(number, float) and not 0 < abs(number) < 1e-12 for number in numbers)
    text, _ = described(SCARA, at=CASES['scara'].at | {'flange': float(dust)})
    turn = yaml.safe_load(text)['sensor']['rotation']
    assert turn == pytest.approx(float(dust), abs=1e-12) and not 0 < abs(turn) < 1e-12


@pytest.mark.parametrize(
    ('limits', 'stated', 'taken'),
    [
        ('lower="-180" upper="90"', '-180 to 90 in the URDF (in degrees?)', (-np.pi, np.pi / 2)),
        ('lower="0" upper="0"', '0 to 0 in the URDF', (-3.14, 3.14)),
        ('', '0 to 0 in the URDF', (-3.14, 3.14)),
        ('lower="2" upper="-2"', '2 to -2 in the URDF', (-3.14, 3.14)),
        ('lower="-1.8e308" upper="1.8e308"', '-inf to inf in the URDF', (-3.14, 3.14)),
        ('lower="nan" upper="1"', 'nan to 1 in the URDF', (-3.14, 3.14)),
        (None, 'are missing', (-3.14, 3.14)),
        ('lower="-6.2832" upper="6.2832"', '', (-6.2832, 6.2832)),
    ],
)
def test_limits_that_are_none_are_assumed_and_said(limits: str | None, stated: str, taken: tuple[float, float]) -> None:
    tag = '<limit lower="-2.5" upper="2.2" effort="1" velocity="1"/>'
    text, notes = described(SCARA.replace(tag, '' if limits is None else f'<limit {limits}/>'))
    assert cell_of(text).limits[0] == pytest.approx(taken)
    assert len(notes) == 1 + bool(stated) and (f'# {notes[-1]}\n' in text) == bool(stated)
    if stated:
        assert notes[-1].startswith(f'limits of shoulder {stated}: {taken[0]:.4g} to {taken[1]:.4g} rad is assumed')


COLUMN = '<axis xyz="0 0 -1"/>\n    <limit lower="0" upper="0.2" effort="1" velocity="1"/>'


@pytest.mark.parametrize(
    ('change', 'at', 'lift'),
    [
        (('', ''), {}, Lift('quill', 0.0, 0.2)),
        ((COLUMN, COLUMN.replace('-1', '1').replace('"0" upper="0.2"', '"-0.2" upper="0"')), {},
         Lift('quill', 0.0, -0.2)),
        ((COLUMN, COLUMN.replace('lower="0"', 'lower="0.1"')), {}, Lift('quill', 0.1, 0.2)),
        (('rpy="0 0 0.3"', 'rpy="3.14159 0 0"'), {}, Lift('quill', 0.2, 0.0)),
        (('', ''), {'quill': 0.05}, None),
        ((COLUMN, COLUMN.replace('0 0 -1', '0 0.1 -1')), {}, None),
        ((COLUMN, COLUMN.replace('"0.2"', '"200"')), {}, None),
    ],
)  # fmt: skip
def test_a_joint_along_the_normal_is_the_lift(change: tuple[str, str], at: dict[str, float], lift: Lift | None) -> None:
    changed = SCARA.replace(*change)
    text, notes = described(changed, at=at)
    cell, tree = cell_of(text), Tree(changed)
    assert any('quill is proposed as robot.lift, up ' in note for note in notes) == bool(lift)
    assert cell.lift == lift and ('quill' in cell.hold) == (lift is None)
    assert ('# lift: {joint: quill, up: 0.0, down: 0.05}' in text) == bool(at)
    _, tip = tree.frame('tool', cell.positions)
    if lift:
        assert cell.plane.in_plane(tip)[2] == pytest.approx(0, abs=1e-12)
        assert cell.plane.in_plane(tree.frame('tool', {'quill': lift.up})[1])[2] > 0.09


def test_a_lift_between_the_joints() -> None:
    """A column after the shoulder, as some makers build it, moves the elbow along the normal."""
    made = '<link name="slide"/><joint name="column" type="prismatic"><parent link="upper_link"/><child link="slide"/>'
    made += '<axis xyz="0 0 1"/><limit lower="0" upper="0.3"/></joint></robot>'
    text = SCARA.replace('"column" type="fixed"', '"post" type="fixed"').replace(
        '<parent link="upper_link"/>', '<parent link="slide"/>'
    )
    cell = cell_of(described(text.replace('</robot>', made))[0])
    assert cell.lift == Lift('column', 0.3, 0.0) and cell.hold == CASES['scara'].at
