"""The URDF of an arm has the kinematics of the model."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from files.robots import Tree

from scara_kinetostatic.files.urdf import CALIBRATED, TOOL_FRAME, Arm, arm_urdf, side_by_side
from scara_kinetostatic.model.cell import PAPER_CELL, Plane
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL

JOINTS = ('shoulder', 'elbow & more')
CELL = replace(PAPER_CELL, joint_names=JOINTS)


@pytest.mark.parametrize(('seed', 'coupling'), [(0, 0.0), (1, 0.0), (2, 0.0), (3, 16 / 76), (4, -1.0)])
@pytest.mark.parametrize('direction', [(1, 1), (-1, 1), (-1, -1)])
def test_the_tip_is_that_of_the_rigid_arm(seed: int, coupling: float, direction: tuple[int, int]) -> None:
    cell, random = replace(CELL, coupling=coupling, direction=direction), np.random.default_rng(seed)
    parameters = PAPER_ACTUAL.replace(theta1=random.uniform(-3, 3), theta2=random.uniform(-3, 3), l2=0.1 + seed)
    robot = Tree(side_by_side('arm', cell, parameters))
    for q in random.uniform(-np.pi, np.pi, (20, 2)):
        angles = dict(zip(JOINTS, cell.readings(q).tolist(), strict=True))
        for prefix, arm in (('', PAPER_NOMINAL), (CALIBRATED, parameters)):
            axes, at = robot.frame(prefix + TOOL_FRAME, angles)
            np.testing.assert_allclose(at, [*forward(arm, q), 0], rtol=0, atol=1e-12)
            along = q.sum() + arm.theta1 + arm.theta2
            np.testing.assert_allclose(axes[:2, 0], [np.cos(along), np.sin(along)], rtol=0, atol=1e-12)


def test_it_is_one_tree_with_names_of_its_own() -> None:
    robot = ElementTree.fromstring(side_by_side('arm', CELL, PAPER_ACTUAL))
    links = [link.attrib['name'] for link in robot.iterfind('link')]
    joints = [joint.attrib['name'] for joint in robot.iterfind('joint')]
    children = [joint.attrib['link'] for joint in robot.iterfind('joint/child')]
    assert len({*links}) == len(links) and len({*joints}) == len(joints)
    assert sorted([*children, 'base_link']) == sorted(links)
    assert [name for name in joints if name in JOINTS] == list(JOINTS)


def test_a_single_arm_has_no_mimicking_joint() -> None:
    text = arm_urdf('arm', CELL, [Arm(PAPER_NOMINAL)])
    assert 'mimic' not in text and CALIBRATED not in text
    assert side_by_side('arm', CELL, None) == text


def test_the_arm_stands_in_its_plane() -> None:
    plane = Plane('world', (0.1, 0.2, 0.3), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    text = arm_urdf('arm', replace(CELL, plane=plane, direction=(1, -1)), [Arm(PAPER_ACTUAL)])
    expected = plane.in_robot(forward(PAPER_ACTUAL, [0.4, 0.9]))
    tip = Tree(text).frame(TOOL_FRAME, {JOINTS[0]: 0.4, JOINTS[1]: -0.9})[1]
    np.testing.assert_allclose(tip, expected, rtol=0, atol=1e-12)
