"""The cell description: what it says comes back, what is not valid is refused by its key, in one line."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from scara_kinetostatic.errors import CellError, ParameterError
from scara_kinetostatic.files.calibration_file import cell_entry, stored_cell
from scara_kinetostatic.files.cell_file import dump_cell, load_cell, parse_cell
from scara_kinetostatic.files.yaml_file import dump_yaml, parse_yaml
from scara_kinetostatic.model.cell import (
    PAPER_CELL,
    PAPER_DISCS,
    ArmClass,
    Cell,
    Disc,
    EffectSizes,
    GripperSign,
    Identification,
    Lift,
    Noise,
    Plate,
    Region,
    Sensor,
    SensorFrame,
    SensorSign,
    SizeMode,
    TouchMotion,
    Uncertainty,
    different_parts,
)
from scara_kinetostatic.model.parameters import PAPER_MEASURED, PAPER_NOMINAL, Parameters

CONTRACT = """
robot:
  joint_names: [joint1, joint2]     # q1, q2 in JointState, matched by name; other joints are ignored
  nominal: {x0: 0.0, y0: 0.0, theta1: 0.0, l1: 0.33, theta2: 0.0, l2: 0.33,
            p_ee: 1.0e-5, p1: 1.0e-5, p2: 1.0e-5, g_ee: 0.0, g1: 0.0, g2: 0.0}
objects:                            # discs of known position
  - {name: disc_1, center: [-0.25, 0.30], radius: 0.15}
  - {name: disc_2, center: [0.20, 0.40], radius: 0.05}
  - {name: disc_3, center: [0.05, 0.25], radius: 0.08}
sensor:
  joint_states: /joint_states       # sensor_msgs/msg/JointState
  wrench: /wrench                   # geometry_msgs/msg/WrenchStamped
  frame: base                       # base | tool
  sign: on_object                   # on_object | on_robot: whose force the sensor reports
noise: {joint: 1.0e-5, force: 0.3}  # optional: estimated if absent
model: {gripper_sign: physical}     # optional
"""


DISC_3 = '  - {name: disc_3, center: [0.05, 0.25], radius: 0.08}\n'
BARE = replace(PAPER_CELL, discs=PAPER_DISCS)
PLAIN = dump_cell(BARE)
STATED = PLAIN.replace(
    'radius: 0.15}', 'radius: 0.15, uncertainty: {center: 1.5e-5, radius: 5.0e-6}, plate: a}'
).replace(
    'objects:',
    """  limits: {joint1: [-2.6, 2.5], joint2: [-2.4, 2.3]}
  lift: {joint: joint3, up: 0.02, down: 0.0}
  hold: {joint4: 0.5}
  coupling: 0.25
objects:""",
)
STATED += """
plates:
  - {name: a, origin: [0.0, 0.3], uncertainty: {center: 1.0e-3, angle: 2.0e-3}}
uncertainty:
  radius: 5.0e-6
  force_gain: 0.005
  force_rotation: 1.0e-3
  nominal: {l1: 1.0e-3, l2: 1.0e-3}
tolerance: {tip: 5.0e-5}
region: {x: [-0.35, 0.35], y: [0.20, 0.55]}
tip: {radius: 0.005}
gravity: [0.0, 0.0]
obstacles: [{outline: [[0.3, 0.1], [0.5, 0.1], [0.5, 0.3]]}]
touch: {force: [20, 50], max_force: 80, contact_speed: 0.005}
identification: {robot: TS60, serial_number: "0047", operator: Ä. Sato}
"""
"""The paper's cell with what it leaves out: how well it is known, and how the robot may move."""


def changed(old: str, new: str) -> str:
    assert old in CONTRACT
    return CONTRACT.replace(old, new)


@pytest.mark.parametrize('weight', [0.15, 0.0, -0.3])
def test_weight_of_a_tool(weight):
    text = dump_cell(BARE).replace('frame: base', f'frame: tool\n  tool_weight: {weight}')
    cell = parse_cell(text + 'gravity: [0.0, -9.81]\n', 'cell.yaml')
    assert cell.sensor.tool_weight == weight
    assert parse_cell(dump_cell(cell), 'again') == cell
    for wrong in (text, text.replace('frame: tool', 'frame: base') + 'gravity: [0.0, -9.81]\n'):
        with pytest.raises(
            CellError, match=r'sensor\.tool_weight: it shows under gravity alone, in the frame of the tool'
        ):
            parse_cell(wrong, 'cell.yaml')


def test_reads_the_contract(tmp_path: Path) -> None:
    path = tmp_path / 'cell.yaml'
    path.write_text(CONTRACT)
    assert load_cell(path) == Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3))
    path.write_bytes(b'\xef\xbb\xbf' + CONTRACT.partition('sensor:')[0].replace('  joint_names', '  #').encode())
    assert load_cell(path) == Cell(PAPER_NOMINAL, PAPER_DISCS), 'a byte order mark, and defaults'


def test_numbers_as_people_write_them() -> None:
    text = changed('p_ee: 1.0e-5', 'p_ee: 1e-5').replace('x0: 0.0', 'x0: 0').replace('0.40]', '+.4]')
    assert parse_cell(text).nominal == PAPER_NOMINAL


def test_dump_is_read_by_any_yaml_reader() -> None:
    data = yaml.safe_load(dump_cell(Cell(PAPER_MEASURED, PAPER_DISCS)))
    assert data['robot']['nominal'] == PAPER_MEASURED.as_dict()
    assert data['objects'][0] == {'name': 'disc_1', 'center': [-0.25, 0.3], 'radius': 0.15}


@pytest.mark.parametrize('text', ['08', '.5e3', '1e5', '-.inf', '~'])
def test_a_string_that_looks_like_a_number_stays_one(text: str) -> None:
    assert parse_yaml(dump_yaml({'name': text}), 'it', CellError) == {'name': text}


SENSOR = Sensor('joint_states', 'arm/wrench', zero_service='/ft/zero')
LEVELS = st.floats(1e-9, 1e-3) | st.sampled_from([(1e-5, 2e-5), (1e-5, 1e-5)])
small = st.floats(0, 1e-3)
names = st.text(
    st.characters(exclude_categories=['Cc', 'Cs', 'Zs', 'Zl', 'Zp', 'Cn', 'Cf', 'Co'], exclude_characters='=+-@'),
    min_size=1,
)


@settings(deadline=None, max_examples=40)
@given(
    nominal=st.builds(
        Parameters, x0=small, y0=small, theta1=st.floats(-3, 3), p_ee=small, p1=small, p2=small, g_ee=small, g1=small
    ),
    joint_names=st.lists(names, min_size=2, max_size=2, unique=True).map(tuple),
    disc_name=names,
    sensor=st.builds(
        SENSOR._replace,
        frame=st.sampled_from(SensorFrame),
        sign=st.sampled_from(SensorSign),
        time_offset=st.none() | st.floats(-4e9, 4e9),
        rotation=st.floats(-6, 6),
    ),
    noise=st.none() | st.builds(Noise, LEVELS, LEVELS, st.none() | st.floats(0, 0.2)),
    gripper=st.sampled_from(GripperSign),
)
def test_round_trip(nominal, joint_names, disc_name, sensor, noise, gripper) -> None:  # type: ignore[no-untyped-def]
    cell = Cell(nominal, (Disc(disc_name, 0.2, 0.4, 0.05),), joint_names, sensor, noise, gripper)
    assert parse_cell(dump_cell(cell)) == cell


STATED_WRONG = [
    ('plate: a', 'plate: b', "disc_1: plate: no plate 'b' in the cell; add it to plates"),
    ('center: 1.0e-3', 'center: 0.03', 'plates[0].uncertainty.center: expected 0 to 0.02 m, got 0.03'),
    ('radius: 5.0e-6}', 'radius: 5.0}', 'expected 0 to 0.002 m, got 5; it is in m: 1.5e-5 for 15 µm'),
    ('force_gain: 0.005', 'force_gain: 0.5', 'expected 0 to 0.2, got 0.5; it is a part of 1: 0.005 for 0.5 %'),
    ('tip: 5.0e-5', 'tip: 50', 'tip: expected above 0, at most 0.005 m, got 50; give it in m: 5.0e-5 for 50'),
    ('l2: 1.0e-3}', 'l2: 0}', 'uncertainty.nominal.l2: expected a number above 0'),
    ('x: [-0.35, 0.35]', 'x: [0.35, -0.35]', 'region.x: expected the lower limit first, got [0.35, -0.35]'),
    ('gravity: [0.0, 0.0]', 'gravity: [0.0, -98.1]', 'gravity: expected at most 25 m/s² in size'),
    ('[-2.6, 2.5]', '[-150, 2.5]', 'robot.limits.joint1.lower limit: expected -12.6 to 12.6 rad, got -150'),
    ('up: 0.02', 'up: 0.0', 'robot.lift.up: up and down are both 0: it does not lift'),
    ('joint: joint3', 'joint: joint1', "robot: 'joint1' is named twice"),
    ('joint4', 'joint3', "robot: 'joint3' is named twice"),
    ('{joint4: 0.5}', '[joint4]', 'robot.hold: expected a mapping'),
    ('joint4', '"a\\nb"', 'robot.hold: expected names of joints'),
    ('[0.3, 0.1], ', '', 'obstacles[0].outline: expected 3 to 50 corners'),
    ('[0.3, 0.1]', '[0.3]', 'obstacles[0].outline.corner 0: expected [x, y], got [0.3]'),
    ('max_force: 80', 'max_force: 50', 'touch.max_force: expected more than the largest force of 50 N'),
    ('[20, 50]', '[50, 20]', 'touch.force: expected the smallest force first'),
    ('contact_speed: 0.005', 'contact_speed: 0.5', 'touch.contact_speed: expected above 0, at most 0.05 m/s, got 0.5'),
]
SIZES_WRONG = [
    ('large', "uncertainty.effects: expected estimated or typical or none, got 'large'"),
    ('', 'uncertainty.effects: expected a string, got None'),
    ('{shift: 1.0e-5}', 'uncertainty.effects.shift: is a size in several units'),
    ('{sizes: typical, arm: wooden}', 'effects.arm: expected industrial or desktop or printed, got '),
    ('{base_complience: 1e-7}', "effects: unknown key 'base_complience'; did you mean 'base_compliance'?"),
    ('{base_compliance: -1.0e-7}', 'uncertainty.effects.base_compliance: expected 0 to 1e-05, got -1e-07'),
]
SIZES = {
    'none': EffectSizes(SizeMode.NONE),
    '{sizes: none, base_compliance: 1.0e-7}': EffectSizes(SizeMode.NONE, stated={'base_compliance': 1e-7}),
    'typical': EffectSizes(SizeMode.TYPICAL),
    '{sizes: estimated, arm: desktop}': EffectSizes(SizeMode.ESTIMATED, ArmClass.DESKTOP),
    '{sizes: typical, arm: printed, base_compliance: 2.0e-7, "transmission_error[joint1]": 0}': EffectSizes(
        SizeMode.TYPICAL, ArmClass.PRINTED, {'base_compliance': 2e-7, 'transmission_error[joint1]': 0.0}
    ),
}


def with_sizes(text: str) -> str:
    return f'{PLAIN}uncertainty: {{effects: {text}}}\n'


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('', 'expected a mapping with robot, objects'),
        (changed('objects:', 'objetcs:'), "unknown key 'objetcs'; did you mean 'objects'?"),
        (changed('radius: 0.15', 'radius: 0.15, diameter: 1'), "objects[0]: unknown key 'diameter'"),
        (changed('l1: 0.33, ', ''), "robot.nominal: the key 'l1' is missing"),
        (changed('l1: 0.33, ', '').replace('l2: 0.33,', ''), "robot.nominal: the keys 'l1', 'l2' are missing"),
        (changed('radius: 0.15', 'radius: -0.15'), 'objects[0].radius: expected a number above 0'),
        (changed('  sign: on', '  time_offset: 5.0e+9\n  sign: on'), 'time_offset: expected -4e+09 to 4e+09 s'),
        (changed('radius: 0.15', 'radius: true'), 'objects[0].radius: expected a number, got True'),
        (changed('radius: 0.15', 'radius: "0.15"'), 'objects[0].radius: expected a number'),
        (changed('radius: 0.15', 'radius: .nan'), 'objects[0].radius: expected a finite number'),
        (changed('radius: 0.15', 'radius: ' + '9' * 5000), 'objects[0].radius: expected a finite number'),
        (changed('radius: 0.15', 'radius: 150'), 'lengths are in m, not mm'),
        (changed('theta1: 0.0', 'theta1: 90'), 'angles are in rad, not degrees'),
        (changed('[-0.25, 0.30]', '[-0.25]'), 'objects[0].center: expected [x, y]'),
        (changed('name: disc_2', 'name: disc_1'), "another disc is named 'disc_1'"),
        (changed('name: disc_2', 'name: 2'), 'objects[1].name: expected a string'),
        (changed('name: disc_2', 'name: " "'), 'objects[1].name: expected a name'),
        (changed('l1: 0.33', 'l1: 0,33'), 'robot.nominal.l1: 0,33 has a decimal comma; write 0.33'),
        (changed('radius: 0.15', 'radius: "0,15"'), "got '0,15'; write 0.15: decimals have a point, not a comma"),
        (changed('[-0.25, 0.30]', '[-0,25, 0,30]'), 'expected [x, y], got [0, 25, 0, 30]; decimals have a point'),
        (changed('l1: 0.33', 'l1: 0'), 'robot.nominal.l1: expected a number above 0'),
        (changed('p1: 1.0e-5', 'p1: -1.0e-5'), 'robot.nominal.p1: expected 0 or more'),
        (changed('joint: 1.0e-5', 'joint: 0'), 'noise.joint: expected 1e-15 to 0.01 rad, got 0'),
        (changed('joint: 1.0e-5', 'joint: [1.0e-5]'), 'noise.joint: expected [joint 1, joint 2], got [1e-05]'),
        (changed('force: 0.3', 'force: [0.3, 0]'), 'noise.force.y: expected 1e-12 to 100 N, got 0'),
        (changed(', force: 0.3}', '}'), "noise: the key 'force' is missing; add it"),
        (changed('[0.20, 0.40]', '[-0.20, 0.40]'), "discs 'disc_1' and 'disc_2' overlap by 0.0882 m"),
        (changed('[0.20, 0.40]', '[0.70, 0.40]'), "object 'disc_2' is out of reach"),
        (changed('[0.20, 0.40]', '[0.01, 0.01]'), "object 'disc_2' covers the base"),
        (changed('[joint1, joint2]', '[joint1, joint1]'), "robot: 'joint1' is named twice; joint_names, lift and hold"),
        (changed('[joint1, joint2]', '[joint1]'), 'robot.joint_names: expected [q1, q2], got'),
        (changed('joint2]', 'joint2]\n  coupling: belt'), "robot.coupling: expected a number, got 'belt'"),
        (changed('joint2]', 'joint2]\n  coupling: 4.75'), 'robot.coupling: expected -2 to 2, got 4.75; it is a'),
        (changed('[joint1, joint2]', '[1, 2]'), 'robot.joint_names.q1: expected a string, got 1'),
        (changed('/wrench ', '/joint_states '), 'both topics are named /joint_states'),
        (changed('/wrench ', '/my wrench '), "a topic other than /cell_description, got '/my wrench'"),
        (changed('/wrench ', 'cell_description '), "a topic other than /cell_description, got 'cell_"),
        (changed('frame: base', 'frame: world'), "sensor.frame: expected base or tool, got 'world'"),
        ('robot: {}\nobjects: []', "robot: the key 'nominal' is missing"),
        (CONTRACT.partition('objects:')[0] + 'objects: []', 'objects: expected a list of discs'),
        (CONTRACT.partition('objects:')[0] + 'objects: [3]', 'objects[0]: expected a mapping'),
        (CONTRACT + 'noise: {joint: 1, force: 1}', "line 17: the key 'noise' is given twice"),
        ('a: [', 'not valid YAML: line 1'),
        ('a: 1\0', 'not valid YAML'),
        ('a: &x 1', 'anchors and aliases are not allowed'),
        ('!!python/object/apply:os.system [ls]', 'is not allowed'),
        ('? [a, b]\n: 1', 'a key must be a word'),
        ('[' * 5_000, 'nested deeper than 32'),
        (CONTRACT + '#' * 300_000, 'expected at most 256 KiB'),
        (changed('[0.20, 0.40]', '[0.20, 0.14]').replace('l1: 0.33', 'l1: 0.6').replace('l2: 0.33', 'l2: 0.2').replace(
            DISC_3, ''), "'disc_2' is out of reach, 0.1941 to 0.2941 m from the base; the tip reaches 0.4 to 0.8 m"),
        (PLAIN + 'identification: {serial_number: 0047}',
         'identification.serial_number: expected a string, got 47; put it in quotes'),
        *((PLAIN.replace(old, f"'{name}'"), 'is a formula to spreadsheets; begin it with a letter')
          for old in ('disc_1', 'joint1') for name in ('=HYPERLINK("http://x")', '+1', '-1', '@a')),
        *((STATED.replace(old, new), message) for old, new, message in STATED_WRONG),
        *((with_sizes(text), message) for text, message in SIZES_WRONG),
    ],
)  # fmt: skip
def test_invalid_descriptions_are_refused(text: str, expected: str) -> None:
    assert text not in (PLAIN, STATED)
    with pytest.raises(CellError) as caught:
        parse_cell(text, 'my/cell.yaml')
    message = str(caught.value)
    assert message.startswith('my/cell.yaml: ')
    assert expected in message
    assert '\n' not in message


def test_touching_discs_are_fine() -> None:
    cell = parse_cell(changed('[0.20, 0.40]', '[-0.05, 0.30]').replace(DISC_3, ''))
    assert np.isclose(np.linalg.norm(cell.centers[1] - cell.centers[0]), cell.radii.sum())


@pytest.mark.parametrize(
    ('make', 'expected'),
    [
        (lambda path: None, 'there is no such file'),
        (lambda path: path.mkdir(), 'got a folder'),
        (lambda path: path.write_bytes(b'name: \xff'), 'not UTF-8 text (byte 6)'),
        (lambda path: path.write_bytes(b' ' * 300_000), 'expected at most 256 KiB'),
        (lambda path: path.symlink_to(path), 'there is no such file|cannot be read'),
        (lambda path: path.symlink_to('/dev/zero'), 'expected a file of YAML, got something else'),
    ],
)
def test_files_that_cannot_be_read(tmp_path: Path, make, expected: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / 'cell.yaml'
    make(path)
    with pytest.raises(CellError) as caught:
        load_cell(path)
    assert str(path) in str(caught.value)
    assert any(part in str(caught.value) for part in expected.split('|'))


def test_what_is_stated_is_read_written_and_stored() -> None:
    cell = parse_cell(STATED)
    assert cell.discs[0] == Disc('disc_1', -0.25, 0.3, 0.15, center_std=1.5e-5, radius_std=5e-6, plate='a')
    assert cell.discs[1] == BARE.discs[1]
    assert cell.plates == (Plate('a', 0.0, 0.3, center_std=1e-3, angle_std=2e-3),)
    assert parse_cell(STATED.replace('center: 1.0e-3', 'center: 0.02')).plates[0].center_std == 0.02
    assert cell.uncertainty == Uncertainty(5e-6, 0.005, 1e-3, {'l1': 1e-3, 'l2': 1e-3})
    assert (cell.tolerance, cell.tip_radius) == (5e-5, 0.005)
    assert cell.region == Region(-0.35, 0.35, 0.20, 0.55)
    assert cell.limits == ((-2.6, 2.5), (-2.4, 2.3))
    assert (cell.lift, cell.hold) == (Lift('joint3', 0.02, 0.0), {'joint4': 0.5})
    assert cell.obstacles == (((0.3, 0.1), (0.5, 0.1), (0.5, 0.3)),)
    assert cell.touch == TouchMotion((20.0, 50.0), 80.0, contact_speed=0.005)
    assert cell.coupling == 0.25
    assert cell.identification == Identification(robot='TS60', serial_number='0047', operator='Ä. Sato')
    parts = ['robot', 'disc_1', 'plates', 'uncertainty', 'tolerance', 'region']
    assert different_parts(cell, BARE) == parts
    other = replace(cell, identification=cell.identification._replace(operator='B'))
    assert different_parts(cell, other) == []
    other = replace(cell, identification=cell.identification._replace(serial_number='0048'))
    assert different_parts(cell, other) == ['identification']
    assert parse_cell(dump_cell(cell)) == stored_cell(cell_entry(cell), 'file') == cell
    assert (parse_cell(PLAIN), dump_cell(parse_cell(PLAIN))) == (BARE, PLAIN)
    assert (BARE.limits, BARE.lift, BARE.obstacles) == (None, None, ())
    assert BARE.uncertainty == Uncertainty()


def test_a_cell_made_in_python_is_checked_alike() -> None:
    disc = Disc('pin', 0.3, 0.2, 0.05)
    for bad in (disc._replace(center_std=-1e-5), disc._replace(radius_std=float('nan')), disc._replace(plate='a')):
        with pytest.raises(ParameterError):
            Cell(PAPER_NOMINAL, (bad,))
    with pytest.raises(ParameterError):
        Cell(PAPER_NOMINAL, (disc,), tolerance=0.0)
    for wrong in ({'radius': -1.0}, {'nominal': {'l3': 1e-3}}, {'nominal': {'l1': 0.0}}):
        with pytest.raises(ParameterError):
            Uncertainty(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize('text', SIZES)
def test_sizes_of_undetected_effects(text: str) -> None:
    cell = parse_cell(with_sizes(text))
    assert cell.uncertainty.effects == SIZES[text]
    assert parse_cell(dump_cell(cell)) == cell


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_a_number_that_is_written_is_one_for_every_reader(number: float) -> None:
    """Of YAML 1.1, which takes 1e-15 as a string, and of YAML 1.2."""
    text = dump_yaml({'a': number, 'b': [number]}, flow=True)
    assert yaml.safe_load(text) == parse_yaml(text, 'cell.yaml', CellError) == {'a': number, 'b': [number]}
