"""Exported files have the kinematics, and the C header the kinetostatics, of the calibrated model."""

from __future__ import annotations

import csv
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from files.robots import Tree

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.files.export import exported
from scara_kinetostatic.files.urdf import TOOL_FRAME
from scara_kinetostatic.interface import simulate
from scara_kinetostatic.model.arm import CalibratedArm, Predictor
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, GripperSign, Lift, Plane, Region
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward, inverse
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL

WEIGHT = {'s1': 1.6, 's2': 0.5, 'phi1': 0.2, 'phi2': -0.4}
JOINTS = np.random.default_rng(0).uniform(-np.pi, np.pi, (30, 2))
PROGRAM = """\
#include <stdio.h>
#include "arm.h"
int main(void)
{
    double q[2], f[2], tip[2], back[2], torque[2];
    while (scanf("%lf %lf %lf %lf", &q[0], &q[1], &f[0], &f[1]) == 4) {
        int status = scara_locate(q, f, tip);
        double bend = SCARA_DIRECTION2 * (q[1] - SCARA_COUPLING * q[0]) + SCARA_THETA2;
        int elbow = sin(bend) > 0 ? SCARA_LEFT : SCARA_RIGHT;
        status += scara_compensate(tip, f, elbow, back, torque);
        printf("%d %.17g %.17g %.17g ", status, tip[0], tip[1], back[0]);
        printf("%.17g %.17g %.17g\\n", back[1], torque[0], torque[1]);
    }
    return 0;
}
"""


def arm_of(weight: dict[str, Any] = {}, **changes: Any) -> CalibratedArm:  # noqa: B006 - not changed
    """An arm that was calibrated; with other offsets than it was touched with, far from the nominal ones."""
    nominal = PAPER_CELL.nominal.replace(**weight)
    cell = replace(PAPER_CELL, nominal=nominal, joint_names=('shoulder', 'elbow & ${more}'), **changes)
    true = replace(cell, gripper_sign=GripperSign.PHYSICAL)
    made = calibrate(simulate(true, PAPER_ACTUAL.replace(**weight)), cell).arm
    return replace(made, model=ExtendedModel(PAPER_ACTUAL.replace(theta1=2.0, theta2=-1.0, **weight)))


@pytest.fixture(scope='module')
def arm() -> CalibratedArm:
    return arm_of()


def text_of(arm: CalibratedArm, kind: str) -> str:
    return exported(arm, kind, 'a -- b */ <c>.json')[0]


def corrections(arm: CalibratedArm, step: float, *forces: float) -> list[dict[str, str]]:
    return rows_of(exported(arm, 'csv', 'a.json', step=step, forces=forces)[0])


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith('#')))


def columns(rows: list[dict[str, str]], *names: str) -> np.ndarray:
    return np.array([[float(row[name]) for name in names] for row in rows])


def check_tree(text: str, arm: CalibratedArm) -> None:
    robot = Tree(text)
    for q in JOINTS:
        readings = dict(zip(arm.cell.joint_names, arm.cell.readings(q).tolist(), strict=True))
        axes, at = robot.frame(TOOL_FRAME, arm.cell.positions | readings)
        plane, p = arm.cell.plane, arm.model.parameters
        np.testing.assert_allclose(at, plane.in_robot(forward(p, q)), rtol=0, atol=1e-12)
        along = q.sum() + p.theta1 + p.theta2
        expected = plane.axes[:, :2] @ [np.cos(along), np.sin(along)]
        np.testing.assert_allclose(axes[:, 0], expected, rtol=0, atol=1e-12)


LIMITS, LIFT = ((-1.0, 2.5), (-2.0, 2.2)), Lift('${quill}', up=-0.1, down=0.02)
PLANE = Plane('world', (0.1, 0.2, 0.3), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 'flange')


@pytest.fixture(
    params=[
        *({}, {'coupling': 16 / 76}, {'coupling': 0.3, 'direction': (-1, 1)}, {'plane': PLANE, 'direction': (1, -1)}),
        *({'limits': LIMITS, 'lift': LIFT}, {'limits': LIMITS, 'coupling': -0.3, 'direction': (1, -1)}),
    ],
    ids=['', 'coupled', 'turned', 'upright', 'lifted', 'limited'],
)
def coupled(request: pytest.FixtureRequest, arm: CalibratedArm) -> CalibratedArm:
    return replace(arm, cell=replace(arm.cell, **request.param))


def check_bounds(text: str, cell: Cell) -> None:
    """The readings of all angles within the limits of the cell are within those of the joints, which they reach."""
    robot, corners = ElementTree.fromstring(text), np.array(cell.limits or LIMITS)
    readings = cell.readings(np.stack(np.meshgrid(*corners), axis=-1).reshape(-1, 2))
    bounds = dict(zip(cell.joint_names, zip(readings.min(axis=0), readings.max(axis=0), strict=True), strict=True))
    bounds = (bounds if cell.limits else {}) | ({LIFT.joint: (-0.1, 0.02)} if cell.lift else {})
    found = {joint.get('name'): (joint.get('type'), joint.find('limit')) for joint in robot.iterfind('joint')}
    assert bounds.keys() == {name for name, (_, limit) in found.items() if limit is not None}
    for name, pair in bounds.items():
        kind, limit = found[name]
        assert kind == ('prismatic' if name == LIFT.joint else 'revolute')
        assert [float(limit.get(key)) for key in ('lower', 'upper')] == pytest.approx(pair)
    if cell.lift:
        tree = Tree(text)
        heights = [tree.frame(TOOL_FRAME, {LIFT.joint: at})[1][2] for at in (LIFT.down, LIFT.up)]
        assert heights == pytest.approx([0.0, 0.12])


def test_urdf(coupled: CalibratedArm) -> None:
    text = text_of(coupled, 'urdf')
    check_tree(text, coupled)
    check_bounds(text, coupled.cell)
    robot = ElementTree.fromstring(text)
    for kind in ('link', 'joint'):
        names = [each.attrib['name'] for each in robot.iterfind(kind)]
        assert len({*names}) == len(names)


def test_xacro(coupled: CalibratedArm, tmp_path: Path) -> None:
    arm = coupled
    text = text_of(arm, 'xacro')
    assert ElementTree.fromstring(text).tag == 'robot'
    xacro = pytest.importorskip('xacro')
    (tmp_path / 'arm.xacro').write_text(text)
    expanded = xacro.process_file(str(tmp_path / 'arm.xacro')).toprettyxml()
    check_tree(expanded, arm)
    check_bounds(expanded, arm.cell)
    (tmp_path / 'two.xacro').write_text(
        '<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="standalone" default="false"/>'
        '<xacro:include filename="arm.xacro"/><link name="world"/>'
        '<xacro:calibrated_scara parent="world" prefix="a_"/></robot>'
    )
    tree = ElementTree.fromstring(
        xacro.process_file(str(tmp_path / 'two.xacro'), mappings={'standalone': 'false'}).toprettyxml()
    )
    assert [link.attrib['name'] for link in tree.iterfind('link')] == [
        'world', 'a_link1', 'a_link2', 'a_tool0', *(['a_coupling'] if arm.cell.coupling else []),
        *(['a_lift'] if arm.cell.lift else []),
    ]  # fmt: skip


def test_dh(arm: CalibratedArm) -> None:
    rows = rows_of(text_of(arm, 'dh'))
    assert [row['joint_name'] for row in rows[1:]] == list(arm.cell.joint_names)
    for q in JOINTS:
        at, turned = complex(float(rows[0]['x_m']), float(rows[0]['y_m'])), 0.0  # in the complex plane
        for row, angle in zip(rows[1:], q.tolist(), strict=True):
            turned += float(row['theta_offset_rad']) + angle
            at += float(row['a_m']) * np.exp(1j * turned)
        np.testing.assert_allclose([at.real, at.imag], forward(arm.model.parameters, q), rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    'given',
    [
        *({'gripper_sign': sign} for sign in GripperSign),
        *({'coupling': 16 / 76, 'direction': (1, sense)} for sense in (1, -1)),
        {'weight': WEIGHT | {'gravity': (1.2, -9.7)}},
    ],
)
def test_the_header_gives_the_tip_and_the_joint_angles(given: dict[str, Any], tmp_path: Path) -> None:
    compiler = shutil.which('cc')
    if compiler is None:
        pytest.skip('there is no C compiler')
    arm = arm_of(**given)
    (tmp_path / 'arm.h').write_text(text_of(arm, 'header'))
    (tmp_path / 'main.c').write_text(PROGRAM)
    options = ['-std=c99', '-Wall', '-Wextra', '-pedantic', '-Werror']
    subprocess.run([compiler, *options, 'main.c', '-o', 'main', '-lm'], check=True, cwd=tmp_path)
    force = np.random.default_rng(1).uniform(-40, 40, JOINTS.shape)
    force[:3] = 0
    force[3:12] *= np.geomspace(1e-3, 0.1, 9)[:, None]  # within the dead bands
    given = '\n'.join(' '.join(map(repr, row)) for row in np.hstack([arm.cell.readings(JOINTS), force]).tolist())
    done = subprocess.run([tmp_path / 'main'], input=given, capture_output=True, text=True, check=True)
    found = np.array([[float(word) for word in line.split()] for line in done.stdout.splitlines()])
    assert not found[:, 0].any()
    predictor = Predictor(arm)
    tip = predictor.locate(JOINTS, force)
    assert 5 < np.sum(~tip.loaded) < 25 or 'weight' in given
    np.testing.assert_allclose(found[:, 1:3], tip.position, rtol=0, atol=1e-12)
    posture = np.where(np.sin(JOINTS[:, 1] + arm.model.parameters.theta2) > 0, 1, -1)
    angles = predictor.compensate(tip.position, force, posture)
    assert np.abs((arm.cell.angles(found[:, 3:5]) - angles.joints + np.pi) % (2 * np.pi) - np.pi).max() < 1e-11
    np.testing.assert_allclose(found[:, 5:], arm.cell.in_sense(angles.torques), rtol=0, atol=1e-9)


def test_the_corrections_bring_the_nominal_arm_to_the_place(coupled: CalibratedArm) -> None:
    arm = replace(coupled, model=ExtendedModel(PAPER_ACTUAL))
    rows = corrections(arm, 0.2, 0.0, 30.0)
    assert {row['elbow'] for row in rows} == {'left', 'right'} and len(rows) > 100
    tip, force = columns(rows, 'x_m', 'y_m'), columns(rows, 'fx_N', 'fy_N')
    start = columns(rows, 'q1_nominal_rad', 'q2_nominal_rad')
    joints = arm.cell.angles(start + columns(rows, 'dq1_rad', 'dq2_rad'))
    loaded = np.array([row['status'] == 'ok' for row in rows])
    assert loaded.sum() > 50
    found, _ = direct_kinetostatics(arm.model, joints, force, arm.cell.gripper_sign)
    np.testing.assert_allclose(found[loaded], tip[loaded], rtol=0, atol=1e-9)
    nominal, _ = direct_kinetostatics(arm.model, arm.cell.angles(start), force, arm.cell.gripper_sign)
    miss = np.linalg.norm(nominal - tip, axis=1)
    np.testing.assert_allclose(miss[loaded], columns(rows, 'miss_m')[loaded, 0], rtol=0, atol=2e-5)  # in the dead bands


def test_forces_beyond_those_of_the_touches_are_said(arm: CalibratedArm) -> None:
    _, note = exported(arm, 'csv', 'a.json', step=0.2, forces=(500.0,))[1]
    assert note.startswith('500 N is outside of the forces of the calibration')


def test_the_error_between_the_places_of_a_correction_table_is_stated(arm: CalibratedArm) -> None:
    text, (note,) = exported(arm, 'csv', 'a.json', step=0.1, forces=(20.0,))
    rows = [row for row in rows_of(text) if row['elbow'] == 'left']
    places = map(tuple, columns(rows, 'x_m', 'y_m', 'fx_N', 'fy_N').round(6).tolist())
    found = dict(zip(places, columns(rows, 'dq1_rad', 'dq2_rad'), strict=True))
    errors = []
    for x, y, *force in found:
        square = [(x, y), (round(x + 0.1, 6), y), (x, round(y + 0.1, 6)), (round(x + 0.1, 6), round(y + 0.1, 6))]
        changes = [found.get((*corner, *force)) for corner in square]
        if all(change is not None for change in changes):
            middle = np.array([[x + 0.05, y + 0.05]])
            joints = inverse(arm.cell.nominal, middle, 1) + np.mean(changes, axis=0)
            tip = Predictor(arm).locate(joints, np.array([force])).position
            errors.append(float(np.linalg.norm(tip - middle)))
    assert len(errors) > 100
    stated, _ = note.split(' mm where the arm')
    assert 1e-3 * float(stated.rsplit(' ', 1)[1]) >= 0.99 * max(errors) > 1e-5
    assert f'# P{note[1:]}.' in text


def test_a_region_bounds_a_correction_table(arm: CalibratedArm) -> None:
    bounded = replace(arm, cell=replace(arm.cell, region=Region(0.1, 0.4, 0.1, 0.4)))
    places = columns(corrections(bounded, 0.025, 20.0), 'x_m', 'y_m')
    assert len(places) > 100 and ((places >= 0.1) & (places <= 0.4)).all()


def test_what_a_format_cannot_hold_is_refused_or_said(arm: CalibratedArm) -> None:
    model = ExtendedModel(arm.model.parameters, (find(arm.cell, 'encoder_gain[joint1]'),), ((1e-3,),))
    other = replace(arm, model=model, covariance=np.zeros((13, 13)), undetermined=np.zeros((13, 0)))
    with pytest.raises(UnsupportedDataError, match=r'encoder_gain\[joint1\]'):
        text_of(other, 'header')
    text, notes = exported(other, 'urdf', 'a.json')
    # a gain of 1e-3 turns joint 1 by π mrad at ±π, the tip l1 + l2 from its axis
    assert notes == ['the file cannot hold encoder_gain[joint1], up to 2.07 mm at the unloaded tip; `locate` does']
    assert 'Not contained: encoder_gain[joint1], up to 2.07 mm at the unloaded tip.' in text
    table, notes = exported(other, 'csv', 'a.json', step=0.2)
    assert len(notes) == 1 and 'found: encoder_gain[joint1].' in table and 'Not contained' not in table
    assert exported(arm, 'urdf', 'a.json')[1] == []
    heavy = arm_of(WEIGHT | {'gravity': (0.0, -9.81)})
    (note,) = exported(heavy, 'dh', 'a.json')[1]
    assert note.startswith('the file cannot hold deflection by gravity, up to ')
    assert exported(heavy, 'header', 'a.json')[1] == []


def test_what_is_not_determined_or_unfit_is_said(arm: CalibratedArm) -> None:
    free = np.zeros((12, 2))
    free[NAMES.index('p_ee'), 0] = free[NAMES.index('l1'), 1] = 1.0
    other = replace(arm, undetermined=free, grade='unfit')
    text, (unfit, rigid) = exported(other, 'dh', 'a.json')
    assert 'unfit for use' in unfit
    assert text.startswith(f'# {unfit[:1].upper()}{unfit[1:]}.\n'), 'also at the head of the file'
    assert 'do not determine l1:' in rigid
    assert 'do not determine l1, p_ee:' in exported(other, 'header', 'a.json')[1][1]


def test_limits_bound_corrections(arm: CalibratedArm) -> None:
    limited = replace(arm, cell=replace(arm.cell, limits=((-0.5, 2.0), (-1.5, 2.2))))
    every, some = (corrections(one, 0.05, 30.0) for one in (arm, limited))
    joints = columns(every, 'q1_nominal_rad', 'q2_nominal_rad') + columns(every, 'dq1_rad', 'dq2_rad')
    assert some == [row for row, can in zip(every, limited.cell.can_take(joints).tolist(), strict=True) if can]
    assert 0 < len(some) < 0.5 * len(every)


@pytest.mark.parametrize('limits', [((1.0, 5.5), (-2.2, 2.2)), ((-3.1, 3.1), (-2.2, 2.2))])
def test_the_corrections_command_angles_within_the_limits(
    arm: CalibratedArm, limits: tuple[tuple[float, float], tuple[float, float]]
) -> None:
    limited = replace(arm, cell=replace(arm.cell, limits=limits, coupling=0.2))
    rows = corrections(limited, 0.05, 0.0, 30.0)
    start, change = (
        columns(rows, f'{name}1{end}', f'{name}2{end}') for name, end in (('q', '_nominal_rad'), ('dq', '_rad'))
    )
    commands, nominal = limited.cell.angles(start + change), limited.cell.angles(start)
    low, high = np.array(limits).T
    assert ((commands >= low - 1e-8) & (commands <= high + 1e-8)).all()
    assert commands[:, 0].max() > 3.0
    np.testing.assert_allclose(forward(limited.cell.nominal, nominal), columns(rows, 'x_m', 'y_m'), rtol=0, atol=1e-9)
