"""What the visualizer publishes, in this process with a listener of its own."""

from __future__ import annotations

import json
from collections.abc import Callable
from math import cos, dist, sin
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nodes.waiting import Bench
from rcl_interfaces.msg import Log
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from scara_kinetostatic.model.cell import PAPER_CELL, Plane
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.calibrator import _summary as summary
from scara_kinetostatic.nodes.session import JudgedTouch
from scara_kinetostatic.nodes.streams import LATCHED, LATCHED_TOUCHES, RELIABLE_STREAM
from scara_kinetostatic.nodes.visualizer import Visualizer
from scara_kinetostatic.report.json_file import json_text
from scara_kinetostatic.results.calibration_json import as_document

TOUCH = JudgedTouch(0, 10**9, '', 'disc_2', (0.0, 20.0), (0.8, 2.1))


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

    def touch(self) -> None:
        touches = self.robot.create_publisher(DiagnosticArray, 'collector/touch', LATCHED_TOUCHES)
        touches.publish(TOUCH.message('/left/collector', '/bags/one', 'base'))
        self.wait(lambda: 'forces' in self.groups('visualizer/markers'))

    def stand(self, *joints: tuple[str, float]) -> None:
        """The joint states."""
        out = self.robot.create_publisher(JointState, 'joint_states', RELIABLE_STREAM)
        self.wait(out.get_subscription_count)
        names, angles = zip(*joints, strict=True)
        out.publish(conversion.joint_state((7, *angles), names))
        self.wait(lambda: 'visualizer/arm' in self.heard)

    def result(self, outcome: Any, folder: Path | None = None, **more: object) -> None:
        results = self.robot.create_publisher(String, 'calibrator/result', LATCHED)
        files = {'folder': folder and str(folder)}
        results.publish(String(data=json.dumps(summary(as_document(outcome)) | {'files': files} | more)))


@pytest.fixture
def cell(bench: Callable[..., Any], cell_file: Path) -> Cell:
    return bench(Visualizer, '-r', '__ns:=/left', on=Cell, cell=cell_file, frame_prefix='left/')


def test_it_shows_touches_arm_and_result(cell, grown, tmp_path):
    cell.touch()
    first, *others = cell.heard['visualizer/markers'].markers
    assert first.action == Marker.DELETEALL
    assert {marker.header.frame_id for marker in (first, *others)} == {'left/base_link'}
    assert len({(marker.ns, marker.id) for marker in others}) == len(others)
    assert cell.groups('visualizer/markers') == {'', 'objects', 'touches', 'forces'}

    cell.stand(('joint1', 0.3), ('joint2', 0.9))
    (links,) = (item for item in cell.heard['visualizer/arm'].markers if item.type == Marker.LINE_STRIP)
    assert (links.points[2].x, links.points[2].y) == pytest.approx(tuple(forward(PAPER_CELL.nominal, (0.3, 0.9))))

    cell.robot.create_publisher(String, 'calibrator/result', LATCHED).publish(String(data='[]'))  # said, and no harm
    (tmp_path / 'calibration.json').write_text(json_text(as_document(grown)))
    cell.result(grown, tmp_path)
    cell.wait(lambda: 'summary' in cell.groups('visualizer/markers'))
    assert 'residuals' in cell.groups('visualizer/markers')  # from the file
    cell.wait(lambda: 'calibrated' in cell.groups('visualizer/arm'))


def test_it_shows_the_next_touch(cell):
    state = cell.robot.create_publisher(DiagnosticArray, 'touch_runner/state', LATCHED)
    pose = cell.robot.create_publisher(PoseStamped, 'touch_runner/next_touch', LATCHED)
    said = 'next: disc_2 at 170°, left, 40 N, it sharpens l2'
    state.publish(DiagnosticArray(status=[DiagnosticStatus(message=said)]))
    pose.publish(conversion.pose_stamped(1, Plane(), (0.15, 0.4, 3.0)))
    topic = 'visualizer/markers'

    def shown() -> list[Marker]:
        return [marker for marker in cell.heard[topic].markers if marker.ns == 'next'] if topic in cell.heard else []

    cell.wait(lambda: said in {marker.text for marker in shown()})
    (arrow,) = (marker for marker in shown() if marker.type == Marker.ARROW)
    tail, head = ((point.x, point.y) for point in arrow.points)
    assert head == (0.15, 0.4)
    assert (tail[0] - head[0], tail[1] - head[1]) == pytest.approx((0.072 * cos(3.0), 0.072 * sin(3.0)))


@pytest.mark.parametrize(('created', 'said'), [
    (None, 'there is no such file; check the path'),
    ('1970-01-01T00:00:00Z', '{folder}/calibration.json: is of another result, 1970-01-01T00:00:00Z; calibrate again'),
])  # fmt: skip
def test_a_result_without_its_file_is_shown_without_residuals(cell, plain, tmp_path, created, said):
    if created:
        (tmp_path / 'calibration.json').write_text(json_text(as_document(plain) | {'created': created}))
    heard = cell.hear(Log, '/rosout', 10)
    cell.wait(lambda: cell.robot.count_publishers('/rosout') > 1)
    cell.result(plain, tmp_path)
    cell.wait(lambda: 'summary' in cell.groups('visualizer/markers'))
    assert 'residuals' not in cell.groups('visualizer/markers')
    assert any(item.text.endswith('not shown, no file') for item in cell.heard['visualizer/markers'].markers)
    cell.wait(lambda: any(item.msg.endswith(said.format(folder=tmp_path)) for item in heard))


def test_a_result_that_is_not_published_leaves_the_calibrated_arm_alone(cell, plain):
    cell.result(plain, published=False)
    cell.wait(lambda: 'summary' in cell.groups('visualizer/markers'))
    cell.stand(('joint1', 0.3), ('joint2', 0.9))
    assert cell.groups('visualizer/arm') == {'', 'nominal'}


def test_forces_are_drawn_anew_when_their_scale_is_set(cell):
    def length() -> float:
        arrows = [item for item in cell.heard['visualizer/markers'].markers if item.ns == 'forces']
        return dist(*((point.x, point.y) for point in arrows[0].points)) if arrows else 0.0

    cell.touch()
    assert length() == pytest.approx(0.002 * 20.0)
    (answer,) = cell.node.set_parameters([Parameter('force_scale', value=0.01)])
    assert answer.successful
    cell.wait(lambda: length() == pytest.approx(0.01 * 20.0))
    (answer,) = cell.node.set_parameters([Parameter('force_scale', value=-1.0)])
    assert not answer.successful


def test_robot_description_is_the_nominal_arm(cell):
    cell.wait(lambda: 'robot_description' in cell.heard)
    robot = ElementTree.fromstring(cell.heard['robot_description'].data)
    assert [link.attrib['name'] for link in robot.iterfind('link')] == ['base_link', 'link1', 'link2', 'tool0']
