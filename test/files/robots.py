"""Robots as URDF: one of this folder's own, those of example-robot-data; and their kinematics, worked out apart."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import pytest

SCARA = """\
<?xml version="1.0"?>
<robot name="scara">  <!-- a comment of the user -->
  <link name="base"/>
  <joint name="column" type="fixed">
    <parent link="base"/> <child link="frame"/>
    <origin xyz="0.1 0.2 0.4" rpy="0 0 0.3"/>
  </joint>
  <link name="frame"/>
  <joint name="shoulder" type="revolute">
    <parent link="frame"/>
    <child link="upper_link"/>
    <origin rpy="0 0 0.1" xyz="0.0 0.0 0.05"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2.5" upper="2.2" effort="1" velocity="1"/>
  </joint>
  <link name="upper_link"><inertial><mass value="4"/><origin xyz="0.1 0.01 0"/></inertial></link>
  <joint name="elbow" type="continuous">
    <parent link="upper_link"/>
    <child link="fore_link"/>
    <origin xyz="0.3 0.02 0.03"/>
    <axis xyz="0 0 -1"/>
  </joint>
  <link name="fore_link"><inertial><mass value="2"/><origin xyz="0.1 0 0"/></inertial></link>
  <joint name="quill" type="prismatic">
    <parent link="fore_link"/>
    <child link="quill_link"/>
    <origin xyz="0.25 0 -0.1" rpy="0 0 0"/>
    <axis xyz="0 0 -1"/>
    <limit lower="0" upper="0.2" effort="1" velocity="1"/>
  </joint>
  <link name="quill_link"/>
  <joint name="flange" type="revolute">
    <parent link="quill_link"/> <child link="tool"/>
    <axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <link name="tool"/>
</robot>
"""


class Case(NamedTuple):
    """Two joints of a robot, and where the others are held."""

    file: str
    joints: tuple[str, str]
    tip: str
    at: dict[str, float]


CASES = {
    'scara': Case('', ('shoulder', 'elbow'), 'tool', {'quill': 0.05, 'flange': 0.4}),
    'ur5': Case(
        'ur_description/urdf/ur5_robot.urdf', ('shoulder_lift_joint', 'elbow_joint'), 'tool0',
        {'shoulder_pan_joint': 0.3, 'wrist_1_joint': -0.5, 'wrist_2_joint': 0.4},
    ),
    'panda': Case(
        'panda_description/urdf/panda.urdf', ('panda_joint2', 'panda_joint4'), 'panda_hand_tcp',
        {'panda_joint1': -0.4, 'panda_joint6': 1.5, 'panda_finger_joint1': 0.02},
    ),
    'xarm': Case('xarm_description/urdf/xarm7.urdf', ('joint2', 'joint4'), 'link_eef', {'joint6': 0.7, 'joint1': 0.3}),
    'z1': Case('z1_description/urdf/z1.urdf', ('joint2', 'joint3'), 'link06', {'joint4': 0.4, 'joint1': 0.3}),
}  # fmt: skip


def text_of(case: Case) -> str:
    """The URDF; the test is skipped where example-robot-data is not installed."""
    if not case.file:
        return SCARA
    try:
        found = [file for file in files('example-robot-data') or [] if str(file).endswith(case.file)]
    except PackageNotFoundError:
        found = []
    if not found:
        pytest.skip('example-robot-data is not installed')
    return Path(str(found[0].locate())).read_text()


def _turn(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _numbers(element: ElementTree.Element | None, key: str, usual: str = '0 0 0') -> np.ndarray:
    return np.array([float(word) for word in (usual if element is None else element.get(key, usual)).split()])


class Tree:
    """Links and joints of a URDF."""

    def __init__(self, text: str) -> None:
        self.root = ElementTree.fromstring(text)
        self.joints = {joint.find('child').get('link'): joint for joint in self.root.findall('joint')}

    def frame(self, link: str, positions: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and place of a link."""
        if link not in self.joints:
            return np.eye(3), np.zeros(3)
        joint = self.joints[link]
        turn, place = self.frame(joint.find('parent').get('link'), positions)
        place = place + turn @ _numbers(joint.find('origin'), 'xyz')
        for axis, angle in zip(np.eye(3)[::-1], _numbers(joint.find('origin'), 'rpy')[::-1], strict=True):
            turn = turn @ _turn(axis, angle)
        axis, at = _numbers(joint.find('axis'), 'xyz', '1 0 0'), positions.get(joint.get('name'), 0.0)
        if (mimic := joint.find('mimic')) is not None:
            at = positions.get(mimic.get('joint'), 0.0) * float(mimic.get('multiplier', 1))
        if joint.get('type') == 'prismatic':
            return turn, place + turn @ axis * at
        return (turn, place) if joint.get('type') == 'fixed' else (turn @ _turn(axis, at), place)

    def holding_torque(self, name: str, positions: dict[str, float]) -> float:
        """Of a joint against gravity, Nm: -a · Σ (r - o) × m g over the links that it moves."""
        (link,) = (link for link, joint in self.joints.items() if joint.get('name') == name)
        turn, origin = self.frame(link, positions)
        total = np.zeros(3)
        for each in self.root.findall('link'):
            mass = each.find('inertial/mass')
            if mass is not None and self.is_moved(each.get('name'), link):
                of, at = self.frame(each.get('name'), positions)
                center = at + of @ _numbers(each.find('inertial/origin'), 'xyz')
                total += np.cross(center - origin, float(mass.get('value')) * np.array([0, 0, -9.81]))
        return float(-turn @ _numbers(self.joints[link].find('axis'), 'xyz', '1 0 0') @ total)

    def is_moved(self, link: str, by: str) -> bool:
        while link in self.joints and link != by:
            link = self.joints[link].find('parent').get('link')
        return link == by
