"""The compensator says where the tip is, answers wanted poses, and says what it cannot."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import cycle
from math import atan2, nan
from time import monotonic
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, Transform, Wrench, WrenchStamped
from nodes.waiting import Bench as AnyBench
from sensor_msgs.msg import JointState, MultiDOFJointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

import scara_kinetostatic as sk
from scara_kinetostatic.files.calibration_file import arm_document
from scara_kinetostatic.model.cell import PAPER_CELL, Identification, Lift, Plane, Sensor
from scara_kinetostatic.model.online import OnlineArm
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN
from scara_kinetostatic.nodes.compensator import Compensator
from scara_kinetostatic.nodes.conversion import joint_state, wrench
from scara_kinetostatic.nodes.streams import LATCHED

CELL = replace(PAPER_CELL, sensor=Sensor())
JOINTS, FORCE = (0.4, 1.1), (20.0, -5.0)
LIMITED = replace(
    CELL,
    limits=((-2.0, 2.0), (-2.3, 2.3)),
    obstacles=(((0.30, 0.10), (0.50, 0.10), (0.50, 0.30)),),
    lift=Lift('joint3', 0.02, 0.0),
    hold={'joint4': 0.5},
)


class Bench(AnyBench):
    """With the robot, its wishes, and what is answered."""

    def __init__(self, node: Compensator) -> None:
        super().__init__(node)
        self.stamp = self.second = 0
        make = self.robot.create_publisher
        self.joints, self.force = make(JointState, '/joint_states', 10), make(WrenchStamped, '/wrench', 10)
        self.request = make(MultiDOFJointState, '/compensator/compensate', 10)
        self.result = make(String, '/calibrator/result', LATCHED)
        self.poses = self.hear(PoseWithCovarianceStamped, '/compensator/pose', 10)
        self.trajectories = self.hear(JointTrajectory, '/compensator/joint_trajectory', 10)
        self.answers = self.hear(DiagnosticArray, '/compensator/answer', 10)

    def move(self, joints: tuple[float, float] = JOINTS, force: tuple[float, ...] | None = FORCE) -> None:
        self.stamp += 1_000_000
        if force is not None:
            self.force.publish(wrench((self.stamp, *force), 'base'))
        self.joints.publish(joint_state((self.stamp, *joints), CELL.joint_names))

    def ask(self, place: tuple[float, ...], force: tuple[float, ...] | None, frame: str = '') -> None:
        """A request, place and force in one message."""
        message = MultiDOFJointState(transforms=[Transform()])
        message.header.frame_id, message.header.stamp.sec = frame, self.second
        at = message.transforms[0].translation
        at.x, at.y, at.z = (*place, 0.0)[:3]
        if force is not None:
            message.wrench = [Wrench()]
            pressed = message.wrench[0].force
            pressed.x, pressed.y, pressed.z = (*force, 0.0)[:3]
        self.request.publish(message)

    def answer(self, publish: Callable[[], None], move: Callable[[], None] | None = None) -> Any:
        """What is said of a wish: values, level and message; wishes are known by their stamps."""
        self.second += 1

        def step() -> None:
            (move or self.move)()
            publish()

        def said() -> list[Any]:
            return [array.status[0] for array in self.answers if array.header.stamp.sec == self.second]

        self.wait(said, step)
        values = {item.key: item.value for item in said()[0].values}
        return values | {'level': said()[0].level, 'message': said()[0].message}

    @property
    def place(self) -> tuple[float, float]:
        """Of the last pose."""
        at = self.poses[-1].pose.pose.position
        return at.x, at.y


@pytest.fixture
def bench(bench: Callable[..., Any], arm_file: Callable[..., Any]) -> Callable[..., Bench]:
    return lambda cell=CELL, **given: bench(Compensator, on=Bench, **({'calibration': arm_file(cell)} | given))


@pytest.fixture
def b(bench: Callable[..., Bench]) -> Bench:
    """One with limits, an obstacle, a lift and a held joint."""
    return bench(LIMITED, speed=0.5)


def turned(*pairs: float) -> Any:
    return pytest.approx(pairs, abs=1e-9)


def test_the_tip_by_a_message_for_each_joint(bench):
    b = bench()
    b.wait(lambda: b.poses, b.move)
    whole, parts = b.place, cycle(zip(CELL.joint_names, (0.5, 1.0), strict=True))

    def move() -> None:
        name, angle = next(parts)
        b.stamp += 1_000_000
        b.force.publish(wrench((b.stamp, *FORCE), 'base'))
        b.joints.publish(joint_state((b.stamp, angle), (name,)))

    b.wait(lambda: b.place != turned(*whole), move)
    number = len(b.poses)
    b.wait(lambda: len(b.poses) > number + 2, move)
    joined, number = b.place, len(b.poses)
    b.wait(lambda: len(b.poses) > number + 4, lambda: b.move((0.5, 1.0)))
    assert b.place == turned(*joined)


def test_the_tip_under_load_with_its_covariance(b, arm):
    b.wait(lambda: b.poses, b.move)
    message, expected = b.poses[-1], OnlineArm(arm).locate(*JOINTS, *FORCE)
    turn = message.pose.pose.orientation
    assert (*b.place, message.pose.pose.position.z) == turned(expected.x, expected.y, 0.0)
    assert 2 * atan2(turn.z, turn.w) == pytest.approx(expected.yaw, abs=1e-9)
    assert message.header.frame_id == 'base_link'
    assert message.header.stamp.nanosec % 1_000_000 == 0
    matrix = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_allclose(matrix[np.ix_([0, 1, 5], [0, 1, 5])], expected.covariance, rtol=1e-9)
    assert not matrix[2:5].any()
    b.wait(b.says('the force is not tared: call ~/tare', WARN), b.move)
    b.call('/compensator/tare', lambda: b.move(force=(0.0, 0.0)))
    b.wait(b.says('following the tip', OK), b.move)


def test_a_place_on_the_surface_of_a_disc_is_answered(b, arm):
    place, force = (0.20, 0.40 - 0.05), (0.0, 20.0)
    found, expected = b.answer(lambda: b.ask(place, force)), sk.compensate(arm, place, force, 'left')
    assert (found['level'], found['status'], found['elbow']) == (OK, 'ok', 'present')
    names = 'q1_rad', 'q2_rad', 'c1_Nm', 'c2_Nm', 'std_normal_m', 'x_m', 'y_m', 'fx_N', 'fy_N'
    numbers = *expected.joints[0], *expected.torques[0], expected.std_normal[0], *place, *force
    assert [float(found[name]) for name in names] == pytest.approx(numbers)
    answer = b.trajectories[-1]
    assert answer.points[0].positions[:2].tolist() == turned(*expected.joints[0])
    assert (answer.header.stamp.sec, answer.header.stamp.nanosec) == (0, 0)
    duration = answer.points[0].time_from_start
    move = np.abs(expected.joints[0] - JOINTS).max() / 0.5
    assert duration.sec + 1e-9 * duration.nanosec == pytest.approx(move, abs=1e-6)


def test_a_robot_is_heard_and_answered_in_its_own_frame_and_the_angles_of_its_drives(bench, arm):
    """The plane stands upright in `world`, as the wrench does, both joints turn clockwise, the drives are coupled."""
    plane = Plane('world', (0.1, 0.2, 0.3), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    cell = replace(CELL, plane=plane, direction=(-1, -1), coupling=0.25)
    b = bench(cell)
    move = partial(b.move, readings(*JOINTS), tuple(np.array(FORCE) @ cell.force_axes))
    b.wait(lambda: b.poses, move)
    expected = OnlineArm(arm).locate(*JOINTS, *FORCE)
    assert b.poses[-1].header.frame_id == 'world'
    place = *b.place, b.poses[-1].pose.pose.position.z
    assert place == turned(*plane.in_robot(np.array([expected.x, expected.y])))
    there = tuple(plane.in_robot(np.array([0.3, 0.2])).tolist())
    answer = b.answer(lambda: b.ask(there, (0.0, 5.0, 30.0), 'world'), move)
    found = sk.compensate(arm, [0.3, 0.2], [0.0, 30.0], 'left')
    joints = turned(*readings(*found.joints[0]))
    assert tuple(float(answer[name]) for name in ('q1_rad', 'q2_rad')) == joints
    assert tuple(float(answer[name]) for name in ('c1_Nm', 'c2_Nm')) == turned(*-found.torques[0])
    assert tuple(b.trajectories[-1].points[0].positions) == joints


def readings(q1: float, q2: float) -> tuple[float, float]:
    return -q1, -q2 - 0.25 * q1


REFUSED: tuple[tuple[Any, Any, str, str], ...] = (
    ((0.9, 0.0), (0.0, 20.0), '', 'out of reach'),
    ((-0.2, 0.30), (0.0, 20.0), '', 'is inside disc_1'),
    ((0.21, 0.42), (0.0, 0.0), '', 'is inside disc_2'),
    ((0.45, 0.15), (0.0, 20.0), '', 'is inside an obstacle'),
    ((-0.3, -0.45), (0.0, 20.0), '', 'is beyond the limits of joint1'),
    ((0.15, 0.12), (0.0, 0.0), '', 'is beyond the limits of joint2'),
    ((0.3, 0.2), (500.0, 0.0), 'camera', "expected the frame base_link, got 'camera'"),
    ((0.3, 0.2), (nan, 0.0), '', 'expected plausible numbers'),
    ((nan, 0.2), (0.0, 20.0), '', 'expected plausible numbers'),
    ((0.3, 0.2), None, '', 'expected one transform and one wrench, got 1 transforms and 0 wrenches'),
)


def test_a_refused_request_has_a_status_and_no_answer(b):
    for place, force, frame, said in REFUSED:
        found = b.answer(lambda: b.ask(place, force, frame))  # noqa: B023
        assert (found['level'], found['status']) == (ERROR, 'refused')
        assert said in found['message']
    b.wait(b.says('~/compensate is not answered: ', WARN), b.move)
    assert not b.trajectories
    good = b.answer(lambda: b.ask((0.3, 0.2), (20.0, 30.0), 'base_link'))
    assert (good['level'], good['status']) == (OK, 'ok')
    for trajectory in b.trajectories:  # none of those refused
        assert trajectory.points[0].positions[:2] == pytest.approx([float(good['q1_rad']), float(good['q2_rad'])])


def test_the_other_joints_of_the_controller_are_sent_along(bench):
    b = bench(LIMITED)

    def move(lift: float | None, wrist: float) -> Callable[[], None]:
        def publish() -> None:
            names, at = [*CELL.joint_names, 'joint4'], [*JOINTS, wrist]
            names, at = (names, at) if lift is None else ([*names, 'joint3'], [*at, lift])
            b.joints.publish(JointState(name=names, position=at))
            b.force.publish(wrench((1, *FORCE), 'base'))

        return publish

    def request() -> None:
        b.ask((0.3, 0.2), (0.0, 20.0))

    for lift, expected in (None, 0.0), (0.013, 0.013):
        while not b.trajectories or b.trajectories[-1].points[0].positions[2:].tolist() != [expected, 0.5]:
            b.answer(request, move(lift, 0.5))  # a wish may come before the state
        assert list(b.trajectories[-1].joint_names) == [*CELL.joint_names, 'joint3', 'joint4']
    b.wait(b.says('joint4 is at 0.7, expected 0.5 (robot.hold)', WARN), move(0.0, 0.7))
    b.wait(lambda: 'no recent joint angles' in b.answer(request, move(0.0, 0.7))['message'])


def test_stale_and_extrapolated(bench):
    b = bench(timeout=0.05)
    b.wait(b.says('no recent joint angles', WARN))
    b.wait(b.says('no recent forces', WARN), lambda: b.move(force=None))
    assert not b.poses
    b.wait(b.says('poses extrapolated', WARN), lambda: b.move(force=(150.0, 0.0)))


def test_an_answer_beyond_the_calibration_is_said(b):
    found = b.answer(lambda: b.ask((0.3, 0.2), (150.0, 0.0)))
    assert (found['level'], found['status']) == (WARN, 'extrapolated')
    b.wait(b.says('the last answer is extrapolated: (0.300000, 0.200000) m under (150, 0) N', WARN), b.move)
    b.wait(lambda: b.trajectories)


def test_results_of_the_calibrator_are_exchanged(bench, arm):
    b = bench(calibration='')

    def publish(document: dict[str, Any]) -> None:
        b.result.publish(String(data=json.dumps(document)))

    b.wait(b.says('no calibration yet', ERROR), b.move)
    assert not b.poses
    arm = replace(arm, cell=CELL)
    publish(arm_document(arm) | {'schema': 'scara_kinetostatic/result/1', 'published': True})
    b.wait(lambda: b.poses, b.move)
    moved = replace(arm, model=arm.model.replace(x0=0.05))
    publish(arm_document(replace(moved, grade='unfit')))
    b.wait(b.says('unfit for use', ERROR), b.move)
    publish({'schema': 3})
    b.wait(b.says('expected the schema', ERROR), b.move)
    publish(arm_document(replace(moved, cell=replace(CELL, joint_names=('a', 'b')))))
    b.wait(b.says('another robot', ERROR), b.move)
    before, _ = b.place
    assert before == pytest.approx(OnlineArm(arm).locate(*JOINTS, *FORCE).x, abs=1e-9)
    publish(arm_document(moved))
    b.wait(lambda: abs(b.place[0] - before) > 1e-3, b.move)
    assert b.place[0] - before == pytest.approx(0.05 - arm.model.parameters.x0, abs=1e-6)


def test_the_zero_of_the_force(b, arm):
    move = partial(b.move, force=(3.0, -4.0))
    b.wait(lambda: len(b.poses) > 5, move)
    assert b.call('/compensator/tare', move).message == 'zero of the force: (3, -4) N'
    free, seen = OnlineArm(arm).locate(*JOINTS, 0.0, 0.0), len(b.poses)
    b.wait(lambda: len(b.poses) > seen + 5, move)
    assert b.place == pytest.approx((free.x, free.y), abs=3e-4)  # the hysteresis of the dead bands


def test_no_zero_is_taken_on_a_known_object(b, arm):
    """25 N would move every pose by 0.35 mm; after a move away it is taken."""
    disc, force = CELL.discs[0], (0.0, 25.0)
    pressed = sk.compensate(arm, (disc.x, disc.y - disc.radius), force, 'left').joints[0]
    b.wait(lambda: len(b.poses) > 5, partial(b.move, tuple(pressed), force))
    answer = b.call('/compensator/tare', partial(b.move, tuple(pressed), force))
    assert (answer.success, b.node._zero) == (False, None)
    assert answer.message == "by its joint angles the tip presses against 'disc_1' with 25 N; move it away, then tare"
    free, end = partial(b.move, force=(0.0, 0.0)), monotonic() + 0.6  # of the forces of the last 0.5 s
    b.wait(lambda: monotonic() > end, free)
    assert b.call('/compensator/tare', free).success


def test_a_result_of_another_robot_is_refused(bench, arm):
    followed = bench().node._calibration
    followed.cell = replace(CELL, identification=Identification(robot='A 1'))
    for name in ('A 1', 'B 77'):
        cell = replace(CELL, identification=Identification(robot=name))
        message = String(data=json.dumps(arm_document(replace(arm, cell=cell))))
        followed._take_result(message)
        assert bool(followed.refused) is (name != 'A 1')
    assert "robot 'B 77'" in followed.refused


def test_another_frame_of_the_forces_needs_another_zero(b):
    b.wait(lambda: len(b.poses) > 5, b.move)
    assert b.node._tare() == pytest.approx(FORCE)
    b.node._turned(b'', False)
    assert b.node._zero is not None
    b.node._turned(b'', True)
    assert b.node._zero is None and not b.node._forces
