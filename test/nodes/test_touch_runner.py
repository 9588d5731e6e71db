"""The node that makes a robot touch by itself, against the simulator that obeys, and against a robot that stands."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from time import monotonic
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nodes.waiting import WAIT, Bench
from rcl_interfaces.srv import GetParameters
from rclpy.qos import qos_profile_action_status_default
from rclpy.task import Future
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from benchmark.cell_nodes import DemoClient, NodeProcesses
from scara_kinetostatic.errors import CellError, OutputError
from scara_kinetostatic.nodes import touch_runner
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.conversion import joint_state, stamp_of, wrench
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.nodes.touch_runner import Controller, TouchRunner
from scara_kinetostatic.running.robot import Command
from scara_kinetostatic.simulation.commanded import DEMO_CELL

CELL = replace(DEMO_CELL, lift=None, tolerance=None)
STANDS = [0.5, 1.0]
"""The joints of a robot that stands, rad."""


@pytest.fixture(autouse=True)
def no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A runner in this process makes no touches that are calibrated: it starts no process for that."""
    monkeypatch.setattr(touch_runner, 'ProcessPoolExecutor', lambda *_: ThreadPoolExecutor(1))


@pytest.fixture
def cell(cell_in: Callable[..., Path]) -> Path:
    return cell_in(CELL)


@pytest.fixture
def zeroed(cell_in: Callable[..., Path]) -> Path:
    """A cell whose sensor is set to zero."""
    return cell_in(CELL, sensor=CELL.sensor._replace(zero_service='/ft/zero'))


class Watch:
    """What runner and robot say, with the times at which it was heard, s."""

    def __init__(self, client: DemoClient) -> None:
        self.client = client
        self.states: list[DiagnosticStatus] = []
        self.joints: list[tuple[float, list[float]]] = []
        self.next: list[PoseStamped] = []
        hear = client._node.create_subscription
        hear(DiagnosticArray, '/touch_runner/state', lambda array: self.states.extend(array.status), LATCHED)
        hear(PoseStamped, '/touch_runner/next_touch', self.next.append, LATCHED)
        hear(JointState, '/joint_states', lambda said: self.joints.append((monotonic(), list(said.position))), 10)

    @property
    def values(self) -> dict[str, str]:
        return {item.key: item.value for item in self.states[-1].values} if self.states else {}

    def until(self, *phases: str) -> None:
        self.client.wait(' or '.join(phases), lambda: self.values.get('phase') in phases, WAIT)

    def until_it_stands(self, since: float) -> np.ndarray:
        """All positions after a time, (k, j), rad: the last 50 are one."""

        def heard() -> list[list[float]]:
            return [position for time, position in self.joints if time > since]

        def stands() -> bool:
            return len(heard()) > 50 and bool(np.ptp(heard()[-50:], axis=0).max() < 1e-4)

        self.client.wait('a robot that stands', stands, WAIT)
        return np.array(heard())


def test_a_kill_leaves_the_robot_standing(
    processes: NodeProcesses, client: DemoClient, cell: Path, tmp_path: Path
) -> None:
    rates = {'joint_rate': 125.0, 'wrench_rate': 125.0, 'publish_clock': True, 'time_factor': 0.5}
    processes.start('contact_simulator', {'cell': cell, 'commanded': True, **rates})
    own = {'output': tmp_path / 'out', 'autostart': True, 'use_sim_time': True}
    pid, watch = processes.start('touch_runner', {'cell': cell, **own}), Watch(client)
    for _ in range(5):  # where this machine is busy, messages that come late end a run: it is begun again
        watch.until('press', 'stopped')
        if watch.values['phase'] == 'press':
            break
        client.wait('the end', lambda: bool(watch.values.get('result')), WAIT)
        client.call('/touch_runner/start', Trigger, Trigger.Request(), WAIT)
        watch.states.clear()
    assert watch.values['phase'] == 'press'
    os.kill(pid, signal.SIGKILL)
    killed = monotonic()
    processes._running.pop('touch_runner').wait()
    moved = np.ptp(watch.until_it_stands(killed), axis=0).max()
    assert moved < 5e-3, 'as far as one message of a press leads, however late joints are heard'
    pose = watch.next[-1].pose
    angle = 2 * np.arctan2(pose.orientation.z, pose.orientation.w)
    place = np.array([pose.position.x, pose.position.y])
    surfaces = [place - disc.radius * np.array([np.cos(angle), np.sin(angle)]) for disc in CELL.discs]
    apart = [np.hypot(s[0] - d.x, s[1] - d.y) for s, d in zip(surfaces, CELL.discs, strict=True)]
    assert min(apart) < 1e-9  # the x axis is the outward normal


def test_without_a_robot_nothing_begins(bench, cell, tmp_path):
    b = bench(TouchRunner, cell=cell, output=tmp_path / 'out')
    answer = b.call('/touch_runner/start')
    assert not answer.success
    assert 'nobody hears /joint_trajectory' in answer.message
    assert not b.call('/touch_runner/pause').success
    assert not (tmp_path / 'out').exists()


@pytest.mark.parametrize(
    ('limits', 'action', 'error', 'says'),
    [
        (None, '', CellError, 'limits of the joints are missing'),
        (CELL.limits, 'arm/follow', ModuleNotFoundError, 'control_msgs'),
    ],
    ids=['limits', 'control_msgs'],
)
def test_what_is_missing_is_said(bench, cell_in, limits, action, error, says):
    with pytest.raises(error, match=says):
        bench(TouchRunner, cell=cell_in(CELL, limits=limits), action=action)


def test_started_by_itself_it_ends_with_a_status(bench, cell, tmp_path, monkeypatch):
    monkeypatch.setattr(touch_runner, '_WAIT', 0.1)
    b = bench(TouchRunner, cell=cell, output=tmp_path / 'out', autostart=True, exit_when_done=True)
    b.wait(lambda: b.node.exit_status == 3)
    assert 'nobody hears' in b.node._runner.status.text


RESULT = SimpleNamespace(INVALID_GOAL=-1, GOAL_TOLERANCE_VIOLATED=-5)
"""Error codes of FollowJointTrajectory: control_msgs is not needed here."""
TOLERANCE = 'Aborted due to path tolerance violation'
STOPPED = 'Current goal cancelled during deactivate transition.'
PREEMPTED = 'Current goal preempted by new incoming action.'
"""What joint_trajectory_controller says."""


class StandIn:
    """In the place of rclpy's action client; a goal has the answer that `answers` says, from the last one on the same.

    An answer is None where the goal is rejected, 0 where it goes on, else the code with which it is aborted, and `why`
    what is said then.
    """

    answers: tuple[int | None, ...] = (0,)
    why = ''
    goals: list[JointTrajectory]

    def __init__(self, *_: object) -> None:
        StandIn.goals = self.goals = []

    def server_is_ready(self) -> bool:
        return True

    def send_goal_async(self, goal: SimpleNamespace) -> Future:
        code = self.answers[min(len(self.goals), len(self.answers) - 1)]
        self.goals.append(goal.trajectory)
        answer, ended = Future(), Future()
        answer.set_result(SimpleNamespace(accepted=code is not None, get_result_async=lambda: ended))
        if code:
            result = SimpleNamespace(error_code=code, error_string=self.why)
            ended.set_result(SimpleNamespace(status=GoalStatus.STATUS_ABORTED, result=result))
        return answer


@pytest.fixture
def action(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """The parameter of a runner that commands by goals, to the stand-in."""
    monkeypatch.setattr(touch_runner, 'ActionClient', StandIn)
    kind = SimpleNamespace(Goal=lambda trajectory: SimpleNamespace(trajectory=trajectory), Result=RESULT)
    monkeypatch.setattr(touch_runner, 'follow_joint_trajectory', lambda *_: kind)
    return {'action': 'arm/follow'}


@pytest.mark.parametrize('topic', ['/joint_trajectory', '/arm/joint_trajectory'], ids=['messages', 'action'])
def test_who_publishes_trajectories_as_well_is_refused(bench, cell, action, topic):
    b = bench(TouchRunner, cell=cell, **(action if 'arm' in topic else {}))
    b.hear(JointTrajectory, topic, 10)
    b.robot.create_publisher(JointTrajectory, topic, 10)
    b.wait(lambda: 'another node publishes' in b.node._hearing())
    b.wait(lambda: not b.node._controller.absence())
    assert f'another node publishes {topic}, /robot: end it' in b.call('/touch_runner/start').message


@pytest.mark.parametrize(
    ('code', 'why', 'says', 'passes'),
    [
        (None, '', 'the controller rejects a trajectory: it is not active, or its log says why', True),
        (-4, TOLERANCE, f'the controller aborts a trajectory (error code -4): {TOLERANCE}', False),
        (-5, '', 'the controller aborts a trajectory (error code -5): ', True),
        (-1, STOPPED, f'the controller aborts a trajectory (error code -1): {STOPPED}', True),
        (-1, PREEMPTED, f'(error code -1): {PREEMPTED}: somebody else commands the robot', False),
        (-9, '', '(error code -9): ', False),
    ],
)
def test_how_a_goal_failed_and_whether_that_may_pass(bench, action, monkeypatch, code, why, says, passes):
    monkeypatch.setattr(StandIn, 'answers', (code, 0))
    monkeypatch.setattr(StandIn, 'why', why)
    failed: list[tuple[str, bool]] = []
    controller = Controller(bench(Collector).node, CELL.joint_names, action['action'], lambda *how: failed.append(how))
    command = Command(CELL.joint_names, np.array([0.1]), np.array([STANDS]), np.zeros((1, 0)))
    controller.send(command)
    ((reason, may_pass),) = failed
    assert (reason.endswith(says), may_pass) == (True, passes)
    controller.send(command)
    assert len(failed) == 1, 'the second goal goes on'
    controller._take_answer(1, controller._client.send_goal_async(SimpleNamespace(trajectory=None)))
    assert len(failed) == 1, 'the end of a goal in whose place another came'


@pytest.mark.parametrize(
    ('given', 'says'),
    [
        ({'open_loop_control': True, 'joints': list(CELL.joint_names)}, ''),
        ({'open_loop_control': False}, 'set open_loop_control: true: else each command begins at the measured joints'),
        ({'open_loop_control': True, 'interpolate_from_desired_state': False, 'interpolation_method': 'splines'}, ''),
        ({'open_loop_control': False, 'interpolate_from_desired_state': False}, 'set interpolate_from_desired_state: '),
        (
            {'interpolation_method': 'none', 'constraints.goal_time': 0.5},
            'splines: else it steps at the end of each po',
        ),
        ({'constraints.goal_time': 0.5}, 'set constraints.goal_time: 0.0'),
        ({'joints': ['a', *CELL.joint_names]}, 'set allow_partial_joints_goal: true: else name a in robot.hold'),
        ({'joints': ['a', *CELL.joint_names], 'allow_partial_joints_goal': True}, ''),
    ],
)
def test_what_is_to_be_set_in_a_controller(bench, given, says):
    b = bench(Collector)
    arm = rclpy.create_node('arm')
    for name, value in given.items():
        arm.declare_parameter(name, value)
    b._executor.add_node(arm)
    controller = Controller(b.node, CELL.joint_names, '', lambda *_: None)
    controller._parameters = b.node.create_client(GetParameters, '/arm/get_parameters')
    b.wait(lambda: controller.ask() or len(controller._found) == 6)
    assert says in controller.advice()
    assert bool(controller.advice()) == bool(says)
    arm.destroy_node()


class Standing(Bench):
    """A robot that stands, whatever is commanded, and its clock.

    Attributes:
        sent: what is commanded by messages.
        said: phase and text, whenever they change.
        clock_stands: whether there are no further messages on `/clock`.
    """

    clock_stands = False

    def __init__(self, node: TouchRunner) -> None:
        super().__init__(node)
        make = self.robot.create_publisher
        self._states, self._wrenches = make(JointState, '/joint_states', 10), make(WrenchStamped, '/wrench', 10)
        self._clock = make(Clock, '/clock', 10)
        self.sent = self.hear(JointTrajectory, '/joint_trajectory', 10)
        self.said: list[tuple[str, str]] = []
        self._now, self._samples = 10**9, 0

    def begin(self) -> None:
        self.meet(self._states, self._wrenches)
        self.wait(lambda: not self.node._controller.absence() and self._clock.get_subscription_count() > 0)
        self.wait(self.node.now, self.sample)
        start = self.call('/touch_runner/start')
        assert start.success, start.message

    def stand(self, until: Callable[[], Any]) -> None:
        """Until a condition holds: the next samples come as soon as the runner has taken the last ones."""
        self.wait(until, self.sample)

    def stand_for(self, seconds: float) -> None:
        end = self._now + seconds * 1e9
        self.stand(lambda: self._now > end or self.node._runner.is_over)

    def until_it_moves(self) -> None:
        """Until a way is commanded by messages; the first command leads to where it stands."""
        self.stand(lambda: self.sent and len(self.sent[-1].points) > 1)

    def sample(self) -> None:
        taken = min(monitor.count for monitor in self.node._streams.monitors.values())
        if self._samples and (taken < self._samples or (self.node.now() < self._now and not self.clock_stands)):
            return
        self._now, self._samples = self._now + 4_000_000, self._samples + 1
        if not self.clock_stands:
            self._clock.publish(Clock(clock=stamp_of(self._now)))
        self._states.publish(joint_state((self._now, *STANDS), CELL.joint_names))
        self._wrenches.publish(wrench((self._now, 0.0, 0.0), 'base_link'))
        if (status := self.node._runner.status[:2]) not in self.said[-1:]:
            self.said.append(status)


@pytest.fixture
def standing(bench: Callable[..., Any], cell: Path, tmp_path: Path) -> Callable[..., Standing]:
    """Begins a run with a robot that stands."""

    def make(**more: object) -> Standing:
        given = {'cell': cell, 'output': tmp_path / 'out', 'use_sim_time': True, **more}
        made: Standing = bench(TouchRunner, on=Standing, **given)
        return made

    return make


@pytest.mark.parametrize(
    ('answers', 'ways', 'phases'),
    [((None,), 0, ['stopped']), ((0, -4), 1, ['stopped']), ((0, -1, 0), 1, ['waiting', 'judge'])],
    ids=['rejected', 'tolerance', 'active again'],
)
def test_an_action_server_is_commanded_and_may_refuse(standing, action, monkeypatch, answers, ways, phases):
    monkeypatch.setattr(StandIn, 'answers', answers)
    monkeypatch.setattr(StandIn, 'why', STOPPED)
    b = standing(**action)
    b.begin()
    b.stand(lambda: b.said and b.said[-1][0] == phases[-1])
    assert [phase for phase, _ in b.said if phase not in ('idle', 'plan', 'travel')] == phases
    first, *others = StandIn.goals
    assert first.joint_names == list(CELL.joint_names)
    assert list(first.points[-1].positions) == pytest.approx(STANDS), 'a goal that moves nothing is the first'
    assert [len(goal.points[0].velocities) for goal in others if len(goal.points) > 1] == [2] * ways, 'one goal a way'
    text = b.said[-1][1]
    if 'waiting' in phases:
        assert text == f'going on after: the controller aborts a trajectory (error code -1): {STOPPED} (in travel)'
        assert 'waiting for 30 s at most' in dict(b.said)['waiting']
    else:
        assert text.startswith('the controller ')


def test_a_recording_that_fails_ends_the_run(standing):
    """Also where that shows as the touch is judged."""
    node, closed = standing().node, list[bool]()

    def full() -> None:
        raise OutputError('/bags', 'no space left on the device')

    node._session = SimpleNamespace(poll=full, abandon=lambda: closed.append(True))
    node._runner._script, node._is_running, node._zero = (node._detect() for _ in range(1)), True, None
    node._runner.tick(1.0)
    assert node._runner.end.reason == 'the recording failed: /bags: no space left on the device (in idle)'
    assert closed and node._session is None


def test_in_place_of_a_calibration_process_that_was_killed_there_is_another_one(standing):
    node = standing().node
    node._work = Mock(submit=Mock(side_effect=BrokenExecutor))
    assert node._submit(abs, -1).result(WAIT) == 1


def test_a_node_that_is_ended_stops_the_robot_though_the_clock_stands(standing):
    b = standing()
    b.begin()
    b.until_it_moves()
    before = len(b.sent)
    b.node.close()
    b.node._is_running = False
    b.wait(lambda: len(b.sent) > before)
    assert 'the node was ended' in b.node._runner.status.text
    assert [list(point.positions) for point in b.sent[-1].points] == [pytest.approx(STANDS)]


@pytest.mark.parametrize(
    ('hears', 'says'), [(False, 'is silent'), (True, '(in travel)')], ids=['nothing comes', 'sensors go on']
)
def test_where_the_clock_stands_steady_time_goes_on(standing, hears, says):
    b = standing()
    assert 'nothing comes on /clock' in b.call('/touch_runner/start').message or b.node._controller.absence()
    b.begin()
    b.until_it_moves()
    assert b.set('use_sim_time', False) == 'the robot is moved by this clock: call ~/stop first'
    assert b.set('use_sim_time', True) == ''
    b.clock_stands = True
    b.wait(lambda: b.node._runner.status.phase == 'waiting', b.sample if hears else lambda: None)
    assert says in b.node._runner.status.text
    answer = b.call('/touch_runner/stop', b.sample if hears else lambda: None)
    assert not answer.success
    assert 'the run has ended, but the tip may not be retracted: ' in answer.message and says in answer.message
    b.wait(lambda: b.node._runner.is_over, b.sample if hears else lambda: None)
    assert len(b.sent[-1].points) == 1, 'the last command is a halt'


def test_a_run_is_stopped_and_ended_by_a_goal_of_somebody_else(standing):
    b = standing()
    states = b.hear(DiagnosticArray, '/touch_runner/state')
    goals = '/follow_joint_trajectory/_action/status'
    others = b.robot.create_publisher(GoalStatusArray, goals, qos_profile_action_status_default)
    b.wait(others.get_subscription_count)
    b.begin()
    b.until_it_moves()
    assert b.call('/touch_runner/start', b.sample).message == 'going on'
    assert b.call('/touch_runner/stop', b.sample).success
    b.stand(lambda: b.node._runner.is_over and not b.node._is_running)
    assert b.node._runner.status.text == 'stopped by ~/stop'
    b.wait(lambda: any('too few touches' in item.value for item in states[-1].status[0].values))
    del b.sent[:]
    b.begin()
    b.until_it_moves()
    for status, is_over in ((GoalStatus.STATUS_SUCCEEDED, False), (GoalStatus.STATUS_EXECUTING, True)):
        others.publish(GoalStatusArray(status_list=[GoalStatus(status=status)]))
        b.stand_for(0.2)
        assert b.node._runner.is_over == is_over
    assert 'somebody else sends goals to /follow_joint_trajectory: end that' in b.node._runner.end.reason
    assert 'somebody else sends goals' in b.call('/touch_runner/start').message
    others.publish(GoalStatusArray())
    b.wait(lambda: not b.node._absence())


def test_by_itself_it_begins_when_the_sensor_can_be_zeroed(bench, zeroed, tmp_path):
    b = bench(TouchRunner, cell=zeroed, output=tmp_path / 'out', autostart=True, exit_when_done=True)
    b.hear(JointTrajectory, '/joint_trajectory', 10)
    b.wait(lambda: not b.node._controller.absence())
    assert 'nobody serves /ft/zero (sensor.zero_service)' in b.node._absence()
    assert b.call('/touch_runner/start').message == 'nobody serves /ft/zero (sensor.zero_service)'
    said = len(b.statuses)
    b.wait(lambda: len(b.statuses) > said + 2)  # it has looked again
    assert b.node.exit_status is None and not b.node._is_running
    b.robot.create_service(Trigger, '/ft/zero', lambda _, answer: answer)
    b.wait(lambda: b.node._is_running)


@pytest.mark.parametrize('answer', [False, True], ids=['fails', 'succeeds'])
def test_the_sensor_is_zeroed_before_the_run(bench, zeroed, tmp_path, answer):
    b = bench(TouchRunner, cell=zeroed, output=tmp_path / 'out')
    b.hear(JointTrajectory, '/joint_trajectory', 10)
    calls: list[bool] = []

    def zero(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        calls.append(True)
        response.success, response.message = answer, 'a force acts'
        return response

    b.robot.create_service(Trigger, '/ft/zero', zero)
    b.wait(lambda: not b.node._absence())
    start = b.call('/touch_runner/start')
    assert start.success, start.message
    failed = '/ft/zero (sensor.zero_service) failed: a force acts'
    expected = '/joint_states is silent' if answer else failed
    b.wait(lambda: expected in b.node._runner.status.text)
    assert calls == [True]
