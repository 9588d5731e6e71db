"""The compensator says where the tip is, answers wanted poses, and says what it cannot."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from math import atan2, nan
from pathlib import Path
from time import time_ns
from typing import Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Transform, Wrench, WrenchStamped
from nodes.waiting import WAIT
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState, MultiDOFJointState
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

import scara_kinetostatic as sk
from scara_kinetostatic.files.calibration_file import arm_document
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Identification, Lift, Plane, Sensor
from scara_kinetostatic.model.online import OnlineArm
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN
from scara_kinetostatic.nodes.compensator import Compensator
from scara_kinetostatic.nodes.conversion import PlanarPose, joint_state, pose_bytes, wrench
from scara_kinetostatic.nodes.demo import THIS_MACHINE
from scara_kinetostatic.nodes.streams import LATCHED

CELL = replace(PAPER_CELL, sensor=Sensor())
JOINTS, FORCE = (0.4, 1.1), (20.0, -5.0)


@pytest.fixture(scope='module')
def arm() -> CalibratedArm:
    calibration = sk.calibrate(sk.simulate(CELL, sk.PAPER_ACTUAL), CELL)
    return replace(CalibratedArm.of(calibration), grade='fit', created='2026-01-01T00:00:00Z')


class Bench:
    """The node, and one that plays the robot and hears the answers, spun in this thread."""

    def __init__(self, node: Compensator) -> None:
        self.node, self.stamp = node, 0
        self.robot = Node('robot')
        self.poses: list[PoseWithCovarianceStamped] = []
        self.trajectories: list[JointTrajectory] = []
        self.answers: list[DiagnosticArray] = []
        self.statuses: list[Any] = []
        make = self.robot.create_publisher
        self.joints, self.force = make(JointState, '/joint_states', 10), make(WrenchStamped, '/wrench', 10)
        self.pose, self.wanted = (
            make(kind, f'/compensator/target_{name}', 10)
            for kind, name in ((PoseStamped, 'pose'), (WrenchStamped, 'wrench'))
        )
        self.request = make(MultiDOFJointState, '/compensator/compensate', 10)
        self.result = make(String, '/calibrator/result', LATCHED)
        hear = self.robot.create_subscription
        hear(PoseWithCovarianceStamped, '/compensator/pose', self.poses.append, 10)
        hear(JointTrajectory, '/compensator/joint_trajectory', self.trajectories.append, 10)
        hear(DiagnosticArray, '/compensator/answer', self.answers.append, 10)
        hear(DiagnosticArray, '/diagnostics', lambda message: self.statuses.append(message.status[0]), 10)
        self.tare = self.robot.create_client(Trigger, '/compensator/tare')
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._executor.add_node(self.robot)

    def wait(self, condition: Callable[[], Any], publish: Callable[[], None] = lambda: None) -> None:
        """Until a condition holds, publishing again and again."""
        for _ in range(int(WAIT / 0.02)):
            publish()
            self._executor.spin_once(timeout_sec=0.02)
            self.node.poll()
            if condition():
                return
        raise AssertionError([(s.level, s.message) for s in self.statuses[-1:]])

    def move(self, joints: tuple[float, float] = JOINTS, force: tuple[float, float] | None = FORCE) -> None:
        self.stamp += 1_000_000
        if force is not None:
            self.force.publish(wrench((self.stamp, *force), 'base'))
        self.joints.publish(joint_state((self.stamp, *joints), CELL.joint_names))

    def move_joint(self, angle: float) -> None:
        """Joint 1 alone."""
        self.stamp += 1_000_000
        self.joints.publish(joint_state((self.stamp, angle), CELL.joint_names[:1]))

    def want(self, x: float, y: float, frame: str = 'base_link', second: int = 0) -> None:
        message = PoseStamped()
        message.header.frame_id, message.header.stamp.sec = frame, second
        message.pose.position.x, message.pose.position.y = x, y
        self.pose.publish(message)

    def ask(self, place: tuple[float, float], force: tuple[float, float], frame: str = '', second: int = 0) -> None:
        """A request, place and force in one message."""
        message = MultiDOFJointState(transforms=[Transform()], wrench=[Wrench()])
        message.header.frame_id, message.header.stamp.sec = frame, second
        message.transforms[0].translation.x, message.transforms[0].translation.y = place
        message.wrench[0].force.x, message.wrench[0].force.y = force
        self.request.publish(message)

    def answer_of(self, second: int) -> dict[str, str]:
        """What was said of a wish with that stamp: its values, level and message."""
        for array in self.answers:
            if array.header.stamp.sec == second:
                (status,) = array.status
                values = {item.key: item.value for item in status.values}
                return values | {'level': status.level, 'message': status.message}
        return {}

    def answer(self, publish: Callable[[int], None], second: int, move: Callable[[], None] | None = None) -> Any:
        """Waits for what is said of a wish."""

        def both() -> None:
            (move or self.move)()
            publish(second)

        self.wait(lambda: self.answer_of(second), both)
        return self.answer_of(second)

    def says(self, text: str, level: bytes) -> Callable[[], bool]:
        return lambda: any(text in s.message and s.level == level for s in self.statuses[-1:])


@pytest.fixture
def bench(domain: int, arm: CalibratedArm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Makes the bench; the node is spun by it alone."""
    made: list[Bench] = []

    for name, value in THIS_MACHINE.items():
        monkeypatch.setenv(name, value)

    def make(*arguments: str, calibrated: bool = True, cell: Cell = CELL) -> Bench:
        path = tmp_path / 'calibration.json'
        path.write_text(json.dumps(arm_document(replace(arm, cell=cell))))
        given = ['-p', f'calibration:={path}'] if calibrated else []
        more = [part for argument in arguments for part in ('-p', argument)]
        args = ['--ros-args', *given, *more]
        rclpy.init(args=args, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        made.append(Bench(Compensator()))
        return made[-1]

    yield make
    for each in made:
        each.robot.destroy_node()
        each.node.destroy_node()
    rclpy.try_shutdown()


def test_the_tip_under_load_with_its_covariance(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    b = bench()
    b.wait(lambda: b.poses, b.move)
    message, expected = b.poses[-1], OnlineArm(arm).locate(*JOINTS, *FORCE)
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    assert (place.x, place.y, place.z) == pytest.approx((expected.x, expected.y, 0.0), abs=1e-9)
    assert 2 * atan2(turn.z, turn.w) == pytest.approx(expected.yaw, abs=1e-9)
    assert message.header.frame_id == 'base_link'
    assert message.header.stamp.nanosec % 1_000_000 == 0
    matrix = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_allclose(matrix[np.ix_([0, 1, 5], [0, 1, 5])], expected.covariance, rtol=1e-9)
    assert not matrix[2:5].any()
    b.wait(b.says('the force is not tared: call ~/tare', WARN), b.move)
    free = b.tare.call_async(Trigger.Request())
    b.wait(free.done, lambda: b.move(force=(0.0, 0.0)))
    b.wait(b.says('following the tip', b'\0'), b.move)


def test_joint_angles_in_parts_are_joined(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    b, late = bench(), 400_000

    def move() -> None:
        b.stamp += 1_000_000
        b.force.publish(wrench((b.stamp, *FORCE), 'base'))
        for joint, name in enumerate(CELL.joint_names):
            b.joints.publish(joint_state((b.stamp + joint * late, JOINTS[joint]), [name]))

    b.wait(lambda: b.poses, move)
    expected, place = OnlineArm(arm).locate(*JOINTS, *FORCE), b.poses[-1].pose.pose.position
    assert (place.x, place.y) == pytest.approx((expected.x, expected.y), abs=1e-9)
    assert b.poses[-1].header.stamp.nanosec % 1_000_000 in (0, late)
    b.wait(b.says('the force is not tared', WARN), move)
    b.wait(b.says('joint2 is silent', WARN), lambda: b.move_joint(JOINTS[0]))


def test_a_wanted_pose_and_force_are_answered(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    b = bench('speed:=0.5')
    force = wrench((0, 0.0, 30.0), '')

    def ask() -> None:
        b.move()
        b.wanted.publish(force)
        b.want(0.3, 0.2)

    angles = sk.compensate(arm, [0.3, 0.2], [0.0, 30.0], 'left').joints[0]

    def answered() -> bool:
        return any(np.allclose(t.points[0].positions, angles, rtol=0, atol=1e-9) for t in b.trajectories)

    b.wait(answered, ask)
    answer = b.trajectories[-1]
    assert list(answer.joint_names) == list(CELL.joint_names)
    assert (answer.header.stamp.sec, answer.header.stamp.nanosec) == (0, 0)
    duration = answer.points[0].time_from_start
    expected = np.abs(angles - JOINTS).max() / 0.5
    assert duration.sec + 1e-9 * duration.nanosec == pytest.approx(expected, abs=1e-6)


def test_a_coupled_drive_is_heard_and_answered_in_its_own_angles(
    bench: Callable[..., Bench], arm: CalibratedArm
) -> None:
    b = bench(cell=replace(CELL, coupling=0.25))
    reported = JOINTS[0], JOINTS[1] + 0.25 * JOINTS[0]
    b.wait(lambda: b.poses, lambda: b.move(reported))
    place, expected = b.poses[-1].pose.pose.position, OnlineArm(arm).locate(*JOINTS, *FORCE)
    assert (place.x, place.y) == pytest.approx((expected.x, expected.y), abs=1e-9)
    answer = b.answer(lambda second: b.ask((0.3, 0.2), (0.0, 30.0), second=second), 7, lambda: b.move(reported))
    ((q1, q2),) = sk.compensate(arm, [0.3, 0.2], [0.0, 30.0], 'left').joints
    wanted = pytest.approx((q1, q2 + 0.25 * q1), abs=1e-9)
    assert (float(answer['q1_rad']), float(answer['q2_rad'])) == wanted
    assert b.trajectories[-1].points[0].positions.tolist() == wanted


def test_a_robot_is_heard_and_answered_in_its_own_frame(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    """The plane stands upright in `world`, both joints turn clockwise, the wrench is in `world`."""
    plane = Plane('world', (0.1, 0.2, 0.3), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    cell = replace(CELL, plane=plane, direction=(-1, -1))
    b = bench(cell=cell)
    reported = -JOINTS[0], -JOINTS[1]
    seen = tuple(np.array(FORCE) @ cell.force_axes)

    def move() -> None:
        b.move(reported, seen)

    b.wait(lambda: b.poses, move)
    place, expected = b.poses[-1].pose.pose.position, OnlineArm(arm).locate(*JOINTS, *FORCE)
    assert b.poses[-1].header.frame_id == 'world'
    assert (place.x, place.y, place.z) == pytest.approx(plane.in_robot(np.array([expected.x, expected.y])), abs=1e-9)

    def ask(second: int) -> None:
        message = MultiDOFJointState(transforms=[Transform()], wrench=[Wrench()])
        message.header.frame_id, message.header.stamp.sec = 'world', second
        at, force = message.transforms[0].translation, message.wrench[0].force
        at.x, at.y, at.z = plane.in_robot(np.array([0.3, 0.2])).tolist()
        force.x, force.y, force.z = 0.0, 5.0, 30.0
        b.request.publish(message)

    answer = b.answer(ask, 7, move)
    found = sk.compensate(arm, [0.3, 0.2], [0.0, 30.0], 'left')
    joints, torques = -found.joints[0], -found.torques[0]
    assert [float(answer[name]) for name in ('q1_rad', 'q2_rad')] == pytest.approx(joints, abs=1e-9)
    assert [float(answer[name]) for name in ('c1_Nm', 'c2_Nm')] == pytest.approx(torques, abs=1e-9)
    assert b.trajectories[-1].points[0].positions.tolist() == pytest.approx(joints, abs=1e-9)


@pytest.mark.parametrize(
    ('wish', 'said'),
    [
        ((0.9, 0.0), 'out of reach'),
        ((nan, 0.2), 'expected plausible numbers'),
        ((0.3, 0.2, 'camera'), "expected the frame base_link, got 'camera'"),
    ],
)
def test_what_cannot_be_answered_is_said(bench: Callable[..., Bench], wish: tuple[Any, ...], said: str) -> None:
    b = bench()

    def ask() -> None:
        b.move()
        b.want(*wish)

    b.wait(b.says(said, b'\1'), ask)
    assert not b.trajectories


LIMITED = replace(
    CELL,
    limits=((-2.0, 2.0), (-2.3, 2.3)),
    obstacles=(((0.30, 0.10), (0.50, 0.10), (0.50, 0.30)),),
    lift=Lift('joint3', 0.02, 0.0),
    hold={'joint4': 0.5},
)


@pytest.mark.parametrize(
    ('place', 'force', 'frame', 'said'),
    [
        ((0.9, 0.0), (0.0, 20.0), '', 'out of reach'),
        ((-0.2, 0.30), (0.0, 20.0), '', 'is inside disc_1'),
        ((0.21, 0.42), (0.0, 0.0), '', 'is inside disc_2'),
        ((0.45, 0.15), (0.0, 20.0), '', 'is inside an obstacle'),
        ((-0.3, -0.45), (0.0, 20.0), '', 'needs joint1 at '),
        ((0.15, 0.12), (0.0, 0.0), '', 'needs joint2 at 2.5'),
        ((0.3, 0.2), (500.0, 0.0), 'camera', "expected the frame base_link, got 'camera'"),
        ((0.3, 0.2), (nan, 0.0), '', 'expected plausible numbers'),
    ],
)
def test_a_refused_request_has_a_status_and_no_answer(
    bench: Callable[..., Bench], place: Any, force: Any, frame: str, said: str
) -> None:
    b = bench(cell=LIMITED)
    found = b.answer(lambda second: b.ask(place, force, frame, second), 7)
    assert (found['level'], found['status'], found['topic']) == (ERROR, 'refused', '~/compensate')
    assert said in found['message']
    assert not b.trajectories
    good = b.answer(lambda second: b.ask((0.3, 0.2), (20.0, 30.0), 'base_link', second), 8)
    assert (good['level'], good['status']) == (OK, 'ok')
    for trajectory in b.trajectories:  # none of the one refused
        assert trajectory.points[0].positions[:2] == pytest.approx([float(good['q1_rad']), float(good['q2_rad'])])


def test_a_place_on_the_surface_of_a_disc_is_answered(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    b = bench(cell=LIMITED)
    place, force = (0.20, 0.40 - 0.05), (0.0, 20.0)
    found = b.answer(lambda second: b.ask(place, force, '', second), 5)
    expected = sk.compensate(arm, place, force, 'left')
    assert (found['level'], found['status'], found['elbow']) == (OK, 'ok', 'present')
    assert [float(found[name]) for name in ('q1_rad', 'q2_rad')] == pytest.approx(expected.joints[0].tolist())
    assert [float(found[name]) for name in ('c1_Nm', 'c2_Nm')] == pytest.approx(expected.torques[0].tolist())
    assert float(found['std_normal_m']) == pytest.approx(expected.std_normal[0])
    assert [float(found[name]) for name in ('x_m', 'y_m', 'fx_N', 'fy_N')] == [*place, *force]


def test_the_other_joints_of_the_controller_are_sent_along(bench: Callable[..., Bench]) -> None:
    b = bench(cell=LIMITED)

    def move(lift: float | None, wrist: float) -> Callable[[], None]:
        def publish() -> None:
            names, at = [*CELL.joint_names, 'joint4'], [*JOINTS, wrist]
            names, at = (names, at) if lift is None else ([*names, 'joint3'], [*at, lift])
            b.joints.publish(JointState(name=names, position=at))
            b.force.publish(wrench((1, *FORCE), 'base'))

        return publish

    def request(second: int) -> None:
        b.ask((0.3, 0.2), (0.0, 20.0), '', second)

    for second, (lift, expected) in enumerate([(None, 0.0), (0.013, 0.013)], 1):
        b.answer(request, second, move(lift, 0.5))
        assert list(b.trajectories[-1].joint_names) == [*CELL.joint_names, 'joint3', 'joint4']
        assert b.trajectories[-1].points[0].positions[2:].tolist() == [expected, 0.5]
    b.wait(b.says('joint4 is at 0.7, expected 0.5 (robot.hold)', WARN), move(0.0, 0.7))
    number = len(b.trajectories)
    found = b.answer(request, 3, move(0.0, 0.7))
    assert 'no recent joint angles' in found['message']
    assert len(b.trajectories) == number


@pytest.mark.parametrize(
    ('force', 'frame'), [((500.0, 0.0), 'camera'), ((nan, 0.0), 'base_link'), ((0.0, 1e9), 'base_link')]
)
def test_a_pose_is_not_answered_with_the_former_force_after_one_that_is_refused(
    bench: Callable[..., Bench], force: tuple[float, float], frame: str
) -> None:
    b = bench()

    def want(size: tuple[float, float], frame: str) -> Callable[[int], None]:
        def publish(second: int) -> None:
            b.wanted.publish(wrench((0, *size), frame))
            b.want(0.3, 0.2, second=second)

        return publish

    assert b.answer(want((0.0, 30.0), ''), 1)['fy_N'] == '30.0'
    b.wait(lambda: b.node._wanted is None, lambda: b.wanted.publish(wrench((0, *force), frame)))
    number = len(b.trajectories)
    for second in (2, 3):  # the force once more, and the pose alone
        found = b.answer(want(force, frame) if second == 2 else lambda second: b.want(0.3, 0.2, second=second), second)
        assert found['message'] == '~/target_pose is not answered: the last force on ~/target_wrench was refused'
        assert found['status'] == 'refused'
    assert len(b.trajectories) == number
    b.wait(lambda: b.node._wanted == (0.0, 10.0), lambda: b.wanted.publish(wrench((0, 0.0, 10.0), '')))
    assert b.answer(lambda second: b.want(0.3, 0.2, second=second), 4)['fy_N'] == '10.0'


def test_a_request_without_a_force_is_refused(bench: Callable[..., Bench]) -> None:
    b = bench()

    def request(second: int) -> None:
        message = MultiDOFJointState(transforms=[Transform()])
        message.header.stamp.sec = second
        b.request.publish(message)

    found = b.answer(request, 1)
    assert 'expected one transform and one wrench, got 1 transforms and 0 wrenches' in found['message']
    assert not b.trajectories


def test_stale_and_extrapolated(bench: Callable[..., Bench]) -> None:
    b = bench('timeout:=0.05')
    b.wait(b.says('no recent joint angles', b'\1'))
    b.wait(b.says('no recent forces', b'\1'), lambda: b.move(force=None))
    assert not b.poses
    b.wait(b.says('poses extrapolated', b'\1'), lambda: b.move(force=(150.0, 0.0)))


def test_an_answer_beyond_the_calibration_is_said(bench: Callable[..., Bench]) -> None:
    b = bench()

    def ask() -> None:
        b.move()
        b.wanted.publish(wrench((0, 150.0, 0.0), 'base_link'))
        b.want(0.3, 0.2)

    b.wait(b.says('the last answer is extrapolated: (0.300000, 0.200000) m under (150, 0) N', b'\1'), ask)
    assert b.trajectories
    (status,) = b.answers[-1].status
    assert (status.level, status.message.endswith('extrapolated')) == (WARN, True)


def test_results_of_the_calibrator_are_exchanged(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    b = bench(calibrated=False)
    b.wait(b.says('no calibration yet', b'\2'), b.move)
    assert not b.poses
    document = arm_document(arm) | {'schema': 'scara_kinetostatic/result/1', 'published': True}
    b.result.publish(String(data=json.dumps(document)))
    b.wait(lambda: b.poses, b.move)
    moved = replace(arm, model=arm.model.replace(x0=0.05))
    unfit = arm_document(replace(moved, grade='unfit'))
    b.result.publish(String(data=json.dumps(unfit)))
    b.wait(b.says('unfit for use', b'\2'), b.move)
    b.result.publish(String(data='{"schema": 3}'))
    b.wait(b.says('expected the schema', b'\2'), b.move)
    other = replace(moved, cell=replace(CELL, joint_names=('a', 'b')))
    b.result.publish(String(data=json.dumps(arm_document(other))))
    b.wait(b.says('another robot', b'\2'), b.move)
    before = b.poses[-1].pose.pose.position.x
    assert before == pytest.approx(OnlineArm(arm).locate(*JOINTS, *FORCE).x, abs=1e-9)
    b.result.publish(String(data=json.dumps(arm_document(moved))))
    b.wait(lambda: abs(b.poses[-1].pose.pose.position.x - before) > 1e-3, b.move)
    assert b.poses[-1].pose.pose.position.x - before == pytest.approx(0.05 - arm.model.parameters.x0, abs=1e-6)


def test_the_zero_of_the_force(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    b = bench()
    b.wait(lambda: len(b.poses) > 5, lambda: b.move(force=(3.0, -4.0)))
    future = b.tare.call_async(Trigger.Request())
    b.wait(future.done, lambda: b.move(force=(3.0, -4.0)))
    assert future.result().message == 'zero of the force: (3, -4) N'
    free, seen = OnlineArm(arm).locate(*JOINTS, 0.0, 0.0), len(b.poses)
    b.wait(lambda: len(b.poses) > seen + 5, lambda: b.move(force=(3.0, -4.0)))
    place = b.poses[-1].pose.pose.position
    assert (place.x, place.y) == pytest.approx((free.x, free.y), abs=3e-4)  # the hysteresis of the dead bands


def test_the_bytes_of_a_pose_are_those_of_the_message() -> None:
    for frame in ('base_link', 'left/base_link', '', 'abc'):
        covariance = [[1.0, 2.0, 3.0], [2.0, 4.0, 5.0], [3.0, 5.0, 6.0]]
        message = deserialize_message(
            pose_bytes(1_500_000_007, Plane(frame), PlanarPose(0.1, 0.2, 0.3, covariance)), PoseWithCovarianceStamped
        )
        assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_007)
        assert message.header.frame_id == frame
        assert (message.pose.pose.position.x, message.pose.pose.position.y) == (0.1, 0.2)
        assert np.reshape(message.pose.covariance, (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])].tolist() == covariance


def test_an_older_result_from_before_the_start_is_not_taken(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    """A latched one; one that is published later is wanted, as by `~/load`."""
    node = bench().node
    older = arm_document(replace(arm, created='2025-01-01T00:00:00Z'))
    node._calibration._take_result(String(data=json.dumps(older)), {'source_timestamp': 1})
    assert node._calibration.present.created == arm.created
    node._calibration._take_result(String(data=json.dumps(older)), {'source_timestamp': time_ns()})
    assert node._calibration.present.created == '2025-01-01T00:00:00Z'


def test_a_result_of_another_robot_is_refused(bench: Callable[..., Bench], arm: CalibratedArm) -> None:
    b = bench()
    for name in ('A 1', 'B 77'):
        cell = replace(CELL, identification=Identification(robot=name))
        b.node._calibration.cell = replace(CELL, identification=Identification(robot='A 1'))
        message = String(data=json.dumps(arm_document(replace(arm, cell=cell))))
        b.node._calibration._take_result(message, {'source_timestamp': time_ns()})
        assert bool(b.node._calibration.refused) is (name != 'A 1')
    assert "robot 'B 77'" in b.node._calibration.refused


def test_another_frame_of_the_forces_needs_another_zero(bench: Callable[..., Bench]) -> None:
    b = bench()
    b.wait(lambda: len(b.poses) > 5, b.move)
    b.node._tip.tare()
    assert b.node._tip.zero == pytest.approx(FORCE)
    b.node._turned(b'', False)
    assert b.node._tip.zero is not None
    b.node._turned(b'', True)
    assert b.node._tip.zero is None


def test_two_publishers_of_joint_states_are_said(bench: Callable[..., Bench]) -> None:
    b = bench()
    other = b.robot.create_publisher(JointState, '/joint_states', 10)
    b.wait(b.says('2 publishers', WARN), b.move)
    assert other.topic_name == '/joint_states'
