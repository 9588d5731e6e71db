"""What the visualizer publishes, in this process with a listener of its own."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from math import cos, dist, sin
from pathlib import Path
from time import monotonic
from typing import Any
from xml.etree import ElementTree

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nodes.waiting import WAIT
from rcl_interfaces.msg import Log, SetParametersResult
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
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


class Cell:
    """The other nodes, and who watches; in the process and the context of the visualizer."""

    def __init__(self, spin: Callable[..., Node], cell_file: Path) -> None:
        arguments = ('--ros-args', '-r', '__ns:=/left', '-p', f'cell:={cell_file}', '-p', 'frame_prefix:=left/')
        self.visualizer = spin(Visualizer, *arguments)
        self.node = rclpy.create_node('others', namespace='/left')
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.heard: dict[str, Any] = {}
        for kind, topic in ((MarkerArray, 'visualizer/markers'), (String, 'robot_description')):
            self.node.create_subscription(kind, topic, self._hear(topic), LATCHED)
        self.node.create_subscription(MarkerArray, 'visualizer/arm', self._hear('visualizer/arm'), 1)

    def _hear(self, topic: str) -> Callable[[Any], None]:
        return lambda message: self.heard.update({topic: message})

    def wait(self, until: Callable[[], Any]) -> None:
        end = monotonic() + WAIT
        while not until():
            assert monotonic() < end
            self.executor.spin_once(timeout_sec=0.1)

    def groups(self, topic: str) -> set[str]:
        """The groups of markers of the last message."""
        return {marker.ns for marker in self.heard[topic].markers} if topic in self.heard else set()


@pytest.fixture
def cell(spin: Callable[..., Node], cell_file: Path) -> Iterator[Cell]:
    made = Cell(spin, cell_file)
    yield made
    made.executor.shutdown()
    made.node.destroy_node()


def test_it_shows_touches_arm_and_result(cell: Cell, grown: Any, tmp_path: Path) -> None:
    touches = cell.node.create_publisher(type(TOUCH.message('', '', '')), 'collector/touch', LATCHED_TOUCHES)
    touches.publish(TOUCH.message('/left/collector', '/bags/one', 'base'))
    cell.wait(lambda: 'forces' in cell.groups('visualizer/markers'))
    first, *others = cell.heard['visualizer/markers'].markers
    assert first.action == Marker.DELETEALL
    assert {marker.header.frame_id for marker in (first, *others)} == {'left/base_link'}
    assert len({(marker.ns, marker.id) for marker in others}) == len(others)
    assert cell.groups('visualizer/markers') == {'', 'objects', 'touches', 'forces'}

    joints = cell.node.create_publisher(JointState, 'joint_states', RELIABLE_STREAM)
    cell.wait(joints.get_subscription_count)
    for name, angle in (('joint1', 0.3), ('joint2', 0.9)):  # of two drivers
        joints.publish(conversion.joint_state((7, angle), (name,)))
    cell.wait(lambda: 'visualizer/arm' in cell.heard)
    (links,) = (item for item in cell.heard['visualizer/arm'].markers if item.type == Marker.LINE_STRIP)
    assert (links.points[2].x, links.points[2].y) == pytest.approx(tuple(forward(PAPER_CELL.nominal, (0.3, 0.9))))

    results = cell.node.create_publisher(String, 'calibrator/result', LATCHED)
    results.publish(String(data='[]'))  # said, and no harm
    document = as_document(grown)
    (tmp_path / 'calibration.json').write_text(json_text(document))
    results.publish(String(data=json.dumps(summary(document) | {'files': {'folder': str(tmp_path)}})))
    cell.wait(lambda: 'summary' in cell.groups('visualizer/markers'))
    assert 'residuals' in cell.groups('visualizer/markers')  # from the file
    cell.wait(lambda: 'calibrated' in cell.groups('visualizer/arm'))
    assert 'uncertainty' in cell.groups('visualizer/arm')


@pytest.mark.parametrize('name', ['calibrator', 'touch_runner'])
def test_it_shows_the_next_touch(cell: Cell, name: str) -> None:
    state = cell.node.create_publisher(DiagnosticArray, f'{name}/state', LATCHED)
    pose = cell.node.create_publisher(PoseStamped, f'{name}/next_touch', LATCHED)
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
    pose.publish(PoseStamped())  # none is needed
    cell.wait(lambda: not shown())


@pytest.mark.parametrize(('created', 'said'), [
    (None, 'give the calibration.json that calibrate writes'),
    ('1970-01-01T00:00:00Z', '{folder}/calibration.json: is of another result, 1970-01-01T00:00:00Z; calibrate again'),
])  # fmt: skip
def test_a_result_without_its_file_is_shown_without_residuals(
    cell: Cell, plain: Any, tmp_path: Path, created: str | None, said: str
) -> None:
    document = as_document(plain)
    if created:
        (tmp_path / 'calibration.json').write_text(json_text(document | {'created': created}))
    heard: list[str] = []
    cell.node.create_subscription(Log, '/rosout', lambda message: heard.append(message.msg), 10)
    cell.wait(lambda: cell.node.count_publishers('/rosout') > 1)
    results = cell.node.create_publisher(String, 'calibrator/result', LATCHED)
    results.publish(String(data=json.dumps(summary(document) | {'files': {'folder': str(tmp_path)}})))
    cell.wait(lambda: 'summary' in cell.groups('visualizer/markers'))
    assert 'residuals' not in cell.groups('visualizer/markers')
    assert any(item.text.endswith('not shown, no file') for item in cell.heard['visualizer/markers'].markers)
    cell.wait(lambda: any(item.endswith(said.format(folder=tmp_path)) for item in heard))


def test_a_result_that_is_not_published_leaves_the_calibrated_arm_alone(cell: Cell, plain: Any) -> None:
    cell.wait(lambda: 'robot_description' in cell.heard)
    before = cell.heard['robot_description'].data
    results = cell.node.create_publisher(String, 'calibrator/result', LATCHED)
    unfit = summary(as_document(plain)) | {'files': {'folder': None}, 'published': False}
    results.publish(String(data=json.dumps(unfit)))
    cell.wait(lambda: 'summary' in cell.groups('visualizer/markers'))
    joints = cell.node.create_publisher(JointState, 'joint_states', RELIABLE_STREAM)
    cell.wait(joints.get_subscription_count)
    joints.publish(conversion.joint_state((0, 0.3, 0.9), ('joint1', 'joint2')))
    cell.wait(lambda: 'visualizer/arm' in cell.heard)
    assert cell.groups('visualizer/arm') == {'', 'nominal'}
    assert cell.heard['robot_description'].data == before


def test_forces_are_drawn_anew_when_their_scale_is_set(cell: Cell) -> None:
    def length() -> float:
        arrows = [item for item in cell.heard['visualizer/markers'].markers if item.ns == 'forces']
        return dist(*((point.x, point.y) for point in arrows[0].points)) if arrows else 0.0

    touches = cell.node.create_publisher(type(TOUCH.message('', '', '')), 'collector/touch', LATCHED_TOUCHES)
    touches.publish(TOUCH.message('/left/collector', '/bags/one', 'base'))
    cell.wait(lambda: 'forces' in cell.groups('visualizer/markers'))
    assert length() == pytest.approx(0.002 * 20.0)
    (answer,) = cell.visualizer.set_parameters([Parameter('force_scale', value=0.01)])
    assert answer.successful
    cell.wait(lambda: length() == pytest.approx(0.01 * 20.0))
    (answer,) = cell.visualizer.set_parameters([Parameter('force_scale', value=-1.0)])
    assert not answer.successful


def test_the_description_of_the_robot_has_the_calibrated_arm_once_there_is_one(cell: Cell, plain: Any) -> None:
    def links() -> list[str]:
        robot = ElementTree.fromstring(cell.heard['robot_description'].data)
        return [link.attrib['name'] for link in robot.iterfind('link')]

    cell.wait(lambda: 'robot_description' in cell.heard)
    assert links() == ['base_link', 'link1', 'link2', 'tool0']
    results = cell.node.create_publisher(String, 'calibrator/result', LATCHED)
    results.publish(String(data=json.dumps(summary(as_document(plain)) | {'files': {'folder': None}})))
    cell.wait(lambda: 'calibrated_tool0' in links())


def test_robot_state_publisher_is_given_each_description(cell: Cell, plain: Any) -> None:
    told: list[SetParameters.Request] = []

    def take(request: SetParameters.Request, response: SetParameters.Response) -> SetParameters.Response:
        told.append(request)
        response.results = [SetParametersResult(successful=True)]
        return response

    cell.node.create_service(SetParameters, 'robot_state_publisher/set_parameters', take)
    cell.wait(lambda: told)
    results = cell.node.create_publisher(String, 'calibrator/result', LATCHED)
    results.publish(String(data=json.dumps(summary(as_document(plain)) | {'files': {'folder': None}})))
    cell.wait(lambda: len(told) == 2)
    for request, calibrated in zip(told, (False, True), strict=True):
        (parameter,) = request.parameters
        assert parameter.name == 'robot_description'
        assert ('calibrated_tool0' in parameter.value.string_value) == calibrated
