"""What the visualizer publishes, in this process with a listener of its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nodes.waiting import Bench
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from scara_kinetostatic.files.calibration_file import arm_document
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.files.urdf import RobotDescription
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import PAPER_CELL, Disc, Lift, Plane
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.session import JudgedTouch
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES, RELIABLE_STREAM
from scara_kinetostatic.nodes.visualizer import Visualizer, object_markers, touch_markers

TOUCH = JudgedTouch(0, 10**9, '', 'disc_2', (0.0, 20.0), (0.8, 2.1))
NOMINAL, PLANE = PAPER_CELL.nominal, Plane()
SEEN = {'q1_rad': '0.8', 'q2_rad': '2.1', 'fx_N': '-9.8', 'fy_N': '0.1', 'accepted': 'true'}


class Cell(Bench):
    """The other nodes, and who watches."""

    def __init__(self, node: Visualizer) -> None:
        super().__init__(node)
        self.heard: dict[str, Any] = {}
        for kind, topic in (
            (MarkerArray, 'visualizer/markers'), (String, 'robot_description'), (MarkerArray, 'visualizer/arm')
        ):  # fmt: skip
            profile = 1 if topic.endswith('arm') else LATCHED
            self.on(kind, topic, lambda message, topic=topic: self.heard.update({topic: message}), profile)

    def groups(self, topic: str) -> set[str]:
        """The groups of markers of the last message."""
        return {marker.ns for marker in self.heard[topic].markers} if topic in self.heard else set()

    def links(self, group: str) -> list[Any]:
        """Shoulder, elbow and tip of an arm."""
        (line,) = (marker for marker in self.heard['visualizer/arm'].markers if marker.ns == group)
        return [(point.x, point.y) for point in line.points]


@pytest.fixture
def cell(bench: Callable[..., Any], cell_file: Path) -> Cell:
    given = {'cell': cell_file, 'frame_prefix': 'left/', 'publish_urdf': True}
    return bench(Visualizer, '-r', '__ns:=/left', on=Cell, **given)


def test_it_shows_touches_and_the_arm_before_and_after_a_calibration(cell: Cell, arm: CalibratedArm) -> None:
    cell.robot.create_publisher(DiagnosticArray, 'collector/touch', LATCHED_TOUCHES).publish(
        TOUCH.message('/left/collector', '/bags/one', 'base')
    )
    cell.wait(lambda: 'forces' in cell.groups('visualizer/markers'))
    first, *others = cell.heard['visualizer/markers'].markers
    assert first.action == Marker.DELETEALL
    assert {marker.header.frame_id for marker in (first, *others)} == {'left/base_link'}
    assert len({(marker.ns, marker.id) for marker in others}) == len(others)
    assert cell.groups('visualizer/markers') == {'', 'objects', 'touches', 'forces'}

    joints = cell.robot.create_publisher(JointState, 'joint_states', RELIABLE_STREAM)
    cell.wait(joints.get_subscription_count)
    joints.publish(conversion.joint_state((7, 0.3, 0.9), ('joint1', 'joint2')))
    cell.wait(lambda: 'nominal' in cell.groups('visualizer/arm'))
    assert cell.links('nominal')[-1] == pytest.approx(tuple(forward(NOMINAL, (0.3, 0.9))))

    def parts() -> None:
        for name, angle in (('joint1', 0.4), ('joint2', 0.8)):
            joints.publish(conversion.joint_state((8, angle), (name,)))

    cell.wait(lambda: cell.links('nominal')[-1] == pytest.approx(tuple(forward(NOMINAL, (0.4, 0.8)))), parts)
    joints.publish(conversion.joint_state((9, 0.3, 0.9), ('joint1', 'joint2')))

    results = cell.robot.create_publisher(String, 'calibrator/result', LATCHED)
    results.publish(String(data='[]'))  # said, and no harm
    document, found = arm_document(arm), arm.model.parameters
    results.publish(String(data=json.dumps(document | {'published': False})))
    cell.heard.clear()
    cell.wait(lambda: 'visualizer/arm' in cell.heard)
    assert cell.groups('visualizer/arm') == {'', 'nominal'}
    results.publish(String(data=json.dumps(document)))
    cell.wait(lambda: 'calibrated' in cell.groups('visualizer/arm') and 'visualizer/markers' in cell.heard)
    assert cell.links('calibrated')[-1] == pytest.approx(tuple(forward(found, (0.3, 0.9))))
    (dot,) = (marker for marker in cell.heard['visualizer/markers'].markers if marker.ns == 'touches')
    assert (dot.pose.position.x, dot.pose.position.y) == pytest.approx(tuple(forward(found, TOUCH.joints)))


def test_robot_description_is_the_nominal_arm(cell: Cell) -> None:
    cell.wait(lambda: 'robot_description' in cell.heard)
    robot = ElementTree.fromstring(cell.heard['robot_description'].data)
    assert [link.attrib['name'] for link in robot.iterfind('link')] == ['base_link', 'link1', 'link2', 'tool0']


def test_beside_a_driver_the_description_is_the_drivers(bench: Callable[..., Any], cell_file: Path) -> None:
    node = bench(Visualizer, cell=cell_file).node
    assert node.count_publishers('robot_description') == 0


def test_robot_description_has_limits_and_lift_of_the_cell(bench: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / 'lifted.yaml'
    path.write_text(dump_cell(replace(PAPER_CELL, limits=((-1.0, 2.0), (-2.0, 2.5)), lift=Lift('joint3', 0.02, 0.0))))
    cell = bench(Visualizer, on=Cell, cell=path, publish_urdf=True)
    cell.wait(lambda: 'robot_description' in cell.heard)
    robot = RobotDescription(cell.heard['robot_description'].data.encode(), 'robot_description')
    moving = {name: (joint.type, joint.limits) for name, joint in robot.joints.items() if joint.type != 'fixed'}
    first, second = ('revolute', (-1.0, 2.0)), ('revolute', (-2.0, 2.5))
    assert moving == {'joint1': first, 'joint2': second, 'joint3': ('prismatic', (0.0, 0.02))}


def test_objects_are_where_the_cell_says() -> None:
    block = Outline('block', ((0.1, 0.2), (0.2, 0.2), (0.2, 0.3), (0.1, 0.3)))
    (body, name), (line, _) = (object_markers([each], PLANE) for each in (Disc('disc', 0.2, 0.4, 0.05), block))
    assert (body.pose.position.x, body.pose.position.y, body.scale.x, body.scale.y) == (0.2, 0.4, 0.1, 0.1)
    assert name.text == 'disc'
    np.testing.assert_allclose([(point.x, point.y) for point in line.points], block.shape())


@pytest.mark.parametrize('frame', ['base', 'tool'])
def test_a_force_ends_at_the_tip_and_is_as_long_as_it_is_large(frame: str) -> None:
    nominal = NOMINAL.replace(theta1=0.2, theta2=-0.1)
    dot, arrow = touch_markers(SEEN | {'frame': frame}, nominal, 0.002, PLANE)
    tail, head = np.array([(point.x, point.y) for point in arrow.points])
    np.testing.assert_allclose(head, forward(nominal, (0.8, 2.1)))
    assert (dot.pose.position.x, dot.pose.position.y) == pytest.approx(tuple(head))
    c, s = (np.cos(3.0), np.sin(3.0)) if frame == 'tool' else (1.0, 0.0)
    np.testing.assert_allclose(head - tail, 0.002 * np.array([-9.8 * c - 0.1 * s, -9.8 * s + 0.1 * c]))


def test_a_touch_that_is_not_used_is_another_dot_and_one_without_a_place_is_not_drawn() -> None:
    (dot,) = touch_markers(SEEN | {'accepted': 'false'}, NOMINAL, 0.002, PLANE)
    assert (dot.ns, dot.type) == ('rejected', Marker.SPHERE)
    for wrong in ({'q1_rad': ''}, {'fx_N': 'nan'}, {'q2_rad': 'x'}):
        assert touch_markers(SEEN | wrong, NOMINAL, 0.002, PLANE) == []
