"""The node that makes a robot touch by itself, against the simulator that obeys."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from time import monotonic
from types import SimpleNamespace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nodes.waiting import WAIT, eventually, trigger
from rclpy.node import Node
from rclpy.qos import qos_profile_action_status_default
from rclpy.task import Future
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from benchmark.cell_nodes import DemoClient, NodeProcesses
from scara_kinetostatic.errors import CellError, InputError, OutputError
from scara_kinetostatic.nodes import touch_runner
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.nodes.touch_runner import TouchRunner
from scara_kinetostatic.pipeline import gather_touches
from scara_kinetostatic.simulation.commanded import DEMO_CELL

CELL = replace(DEMO_CELL, lift=None, tolerance=None)


class Watch:
    """What runner and robot say, with the times at which it was heard, s."""

    def __init__(self, client: DemoClient) -> None:
        self.client = client
        self.states: list[tuple[float, DiagnosticStatus]] = []
        self.joints: list[tuple[float, list[float]]] = []
        self.next: list[PoseStamped] = []
        node = client._node
        node.create_subscription(DiagnosticArray, '/touch_runner/state', self._note, LATCHED)
        node.create_subscription(PoseStamped, '/touch_runner/next_touch', self.next.append, LATCHED)
        node.create_subscription(
            JointState, '/joint_states', lambda said: self.joints.append((monotonic(), list(said.position))), 10
        )

    def _note(self, message: DiagnosticArray) -> None:
        self.states.append((monotonic(), message.status[0]))

    @property
    def values(self) -> dict[str, str]:
        return {item.key: item.value for item in self.states[-1][1].values} if self.states else {}

    def until(self, phase: str, accepted: int = 0) -> None:
        def is_there() -> bool:
            return self.values.get('phase') == phase and int(self.values.get('accepted') or 0) >= accepted

        self.client.wait(phase, is_there, WAIT)


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


@pytest.fixture
def watch(processes: NodeProcesses, client: DemoClient, cell: Path, tmp_path: Path) -> Watch:
    """The simulator and the runner, which begins at once."""
    simulated = {
        'commanded': True,
        'joint_rate': 125.0,
        'wrench_rate': 125.0,
        'publish_clock': True,
        'time_factor': 0.5,
    }
    processes.start('contact_simulator', {'cell': cell, **simulated})
    own = {'output': tmp_path / 'out', 'autostart': True, 'use_sim_time': True}
    pid = processes.start('touch_runner', {'cell': cell, **own})
    one = Watch(client)
    one.pid = pid
    return one


def test_stop_retracts_and_a_kill_leaves_the_robot_standing(watch, processes, client, tmp_path):
    """And all that was counted."""
    watch.until('approach')
    client.wait('the next touch', lambda: bool(watch.next), WAIT)
    pose = watch.next[-1].pose
    angle = 2 * np.arctan2(pose.orientation.z, pose.orientation.w)
    place = np.array([pose.position.x, pose.position.y])
    surfaces = [place - disc.radius * np.array([np.cos(angle), np.sin(angle)]) for disc in CELL.discs]
    apart = [np.hypot(s[0] - d.x, s[1] - d.y) for s, d in zip(surfaces, CELL.discs, strict=True)]
    assert min(apart) < 1e-9  # the x axis is the outward normal
    assert trigger(client, '/touch_runner/start').message == 'going on'
    assert trigger(client, '/touch_runner/stop').success
    watch.until('stopped')
    status = watch.states[-1][1]
    assert status.message == 'stopped by ~/stop'
    client.wait('the end', lambda: 'too few touches' in watch.values.get('result', ''), WAIT)
    heard = len(watch.joints)
    client.wait('some time', lambda: len(watch.joints) > heard + 60, WAIT)
    assert np.ptp([position for _, position in watch.joints[-20:]], axis=0).max() < 1e-4

    def is_pressing() -> bool:
        return watch.values.get('phase') == 'press' and int(watch.values.get('accepted') or 0) >= 1

    for _ in range(5):  # where this machine is busy, messages that come late end a run: it is begun again
        trigger(client, '/touch_runner/start')
        watch.states.clear()
        client.wait('a press', lambda: is_pressing() or watch.values.get('phase') == 'stopped', WAIT)
        if is_pressing():
            break
    assert is_pressing()
    accepted = int(watch.values['accepted'])
    os.kill(watch.pid, signal.SIGKILL)
    killed = monotonic()
    processes._running.pop('touch_runner').wait()

    def since() -> list[list[float]]:
        return [position for time, position in watch.joints if time > killed]

    def stands() -> bool:
        return len(since()) > 50 and bool(np.ptp(since()[-50:], axis=0).max() < 1e-4)

    watch.client.wait('a robot that stands', stands, WAIT)
    assert np.ptp(since(), axis=0).max() < 5e-3, 'as far as one message of a press leads, however late joints are heard'
    bag = max((tmp_path / 'out').iterdir())
    assert len(gather_touches([bag], CELL).touches) >= accepted


def test_nobody_hears_or_a_second_runner_is_there(spin, client, cell, tmp_path):
    node = spin(TouchRunner, cell=cell, output=tmp_path / 'out')
    answer = trigger(client, '/touch_runner/start')
    assert not answer.success
    assert 'nobody hears /joint_trajectory' in answer.message
    assert not trigger(client, '/touch_runner/pause').success
    assert not (tmp_path / 'out').exists()
    client._node.create_subscription(JointTrajectory, '/joint_trajectory', lambda _: None, 10)
    client._node.create_publisher(JointTrajectory, '/joint_trajectory', 10)
    assert eventually(lambda: 'another node publishes' in node._hearing())
    answer = trigger(client, '/touch_runner/start')
    assert 'another node publishes /joint_trajectory, /demo: end it' in answer.message


def test_a_cell_without_limits_is_refused(spin, cell_in):
    with pytest.raises(CellError, match='limits of the joints are missing'):
        spin(TouchRunner, cell=cell_in(CELL, limits=None))


def test_started_by_itself_it_ends_with_a_status(spin, cell, tmp_path, monkeypatch):
    monkeypatch.setattr(touch_runner, '_WAIT', 0.5)
    node = spin(TouchRunner, cell=cell, output=tmp_path / 'out', autostart=True, exit_when_done=True)
    assert eventually(lambda: node.exit_status == 3)
    assert 'nobody hears' in node._runner.status.text


def test_without_control_msgs_an_action_is_refused(spin, cell):
    with pytest.raises(InputError, match='control_msgs cannot be imported'):
        spin(TouchRunner, cell=cell, action='arm/follow')


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
            ended.set_result(SimpleNamespace(status=6, result=result))
        return answer


@pytest.fixture
def action(monkeypatch: pytest.MonkeyPatch, cell: Path, tmp_path: Path) -> dict[str, object]:
    """Parameters of a runner that commands by goals, to the stand-in."""
    monkeypatch.setattr(touch_runner, 'ActionClient', StandIn)
    kind = SimpleNamespace(Goal=lambda trajectory: SimpleNamespace(trajectory=trajectory), Result=RESULT)
    monkeypatch.setattr(touch_runner, 'follow_joint_trajectory', lambda *_: kind)
    return {'cell': cell, 'output': tmp_path / 'out', 'action': 'arm/follow', 'use_sim_time': True}


def test_who_publishes_trajectories_beside_an_action_is_refused(spin, client, action):
    spin(TouchRunner, **action)
    client._node.create_publisher(JointTrajectory, '/arm/joint_trajectory', 10)
    answer = trigger(client, '/touch_runner/start')
    client.wait('the discovery', lambda: client._node.count_publishers('/arm/joint_trajectory') > 0, WAIT)
    for _ in range(50):
        answer = trigger(client, '/touch_runner/start')
        if 'another node publishes /arm/joint_trajectory, /demo: end it' in answer.message:
            return
    pytest.fail(answer.message)


@pytest.mark.parametrize(
    ('answers', 'why', 'phase', 'says'),
    [
        ((None,), '', 'stopped', 'the controller rejects a trajectory'),
        ((0, -4), TOLERANCE, 'stopped', f'(error code -4): {TOLERANCE} (in travel)'),
        ((0, -5, 0), '', 'waiting', '(error code -5)'),
        ((0, -1, None), STOPPED, 'waiting', f'(error code -1): {STOPPED} (in travel); waiting for 30 s at most'),
        (
            (0, -1, 0),
            STOPPED,
            'judge',
            f'going on after: the controller aborts a trajectory (error code -1): {STOPPED}',
        ),
        ((0, -1, 0), PREEMPTED, 'stopped', f'{PREEMPTED}: somebody else commands the robot'),
    ],
    ids=['rejected', 'tolerance', 'late', 'inactive', 'active again', 'preempted'],
)
def test_an_action_server_is_commanded_and_may_refuse(spin, client, monkeypatch, action, answers, why, phase, says):
    monkeypatch.setattr(StandIn, 'answers', answers)
    monkeypatch.setattr(StandIn, 'why', why)
    node = spin(TouchRunner, **action)
    said, stand = standing(node, client)
    client.wait('the answer', lambda: stand() and any(p == phase and says in text for p, text in said()), WAIT)
    first, *others = StandIn.goals
    assert first.joint_names == list(CELL.joint_names)
    assert list(first.points[-1].positions) == pytest.approx(STANDS), 'a goal that moves nothing is the first'
    if answers[0] is None:
        assert not others, 'nothing has moved'
    else:
        assert len(others[0].points[0].velocities) == 2, 'the way is one goal'


STANDS = [0.5, 1.0]


def standing(node: Node, client: DemoClient) -> tuple[Callable[[], list[tuple[str, str]]], Callable[[], bool]]:
    """A robot that stands, whatever is commanded: what the runner has said, and what gives the next samples."""
    states = client._node.create_publisher(JointState, '/joint_states', 10)
    wrenches = client._node.create_publisher(WrenchStamped, '/wrench', 10)
    clock = client._node.create_publisher(Clock, '/clock', 10)
    client.wait('the clock', lambda: clock.get_subscription_count() > 0 and wrenches.get_subscription_count() > 0, WAIT)
    start = trigger(client, '/touch_runner/start')
    assert start.success, start.message
    now, said = 1.0, list[tuple[str, str]]()

    def stand() -> bool:
        nonlocal now
        now += 0.004
        clock.publish(Clock(clock=Time(seconds=now).to_msg()))
        stamp = Time(seconds=now).to_msg()
        states.publish(JointState(header=Header(stamp=stamp), name=['joint1', 'joint2'], position=STANDS))
        wrenches.publish(WrenchStamped(header=Header(stamp=stamp, frame_id='base_link')))
        status = node._runner.status
        if not said or said[-1] != status[:2]:
            said.append(status[:2])
        return True

    return lambda: said, stand


ByClock = tuple[TouchRunner, list[JointTrajectory]]


@pytest.fixture
def by_clock(spin: Callable[..., Node], client: DemoClient, cell: Path, tmp_path: Path) -> ByClock:
    """A runner with `use_sim_time`, and what it commands."""
    node = spin(TouchRunner, cell=cell, output=tmp_path / 'out', use_sim_time=True)
    sent: list[JointTrajectory] = []
    client._node.create_subscription(JointTrajectory, '/joint_trajectory', sent.append, 10)
    assert eventually(lambda: not node._controller.absence())
    return node, sent


def test_a_recording_that_fails_ends_the_run(by_clock):
    """Also where that shows as the touch is judged."""
    node, _ = by_clock
    closed: list[bool] = []

    def full() -> None:
        raise OutputError('/bags', 'no space left on the device')

    node._session = SimpleNamespace(poll=full, abandon=lambda: closed.append(True))
    node._runner._script, node._is_running, node._zero = (node._detect() for _ in range(1)), True, None
    node._runner.tick(1.0)
    assert node._runner.end.reason == 'the recording failed: /bags: no space left on the device (in idle)'
    assert closed and node._session is None


def test_a_node_that_is_ended_stops_the_robot_though_the_clock_stands(by_clock, client):
    node, sent = by_clock
    _, stand = standing(node, client)
    client.wait('a way', lambda: stand() and bool(sent) and len(sent[-1].points) > 1, WAIT)
    before = len(sent)
    node.close()
    node._is_running = False
    client.wait('the halt', lambda: len(sent) > before, WAIT)
    assert 'the node was ended' in node._runner.status.text
    assert [list(point.positions) for point in sent[-1].points] == [pytest.approx(STANDS)]


def test_by_itself_it_begins_when_the_sensor_can_be_zeroed(spin, client, zeroed, tmp_path):
    client._node.create_subscription(JointTrajectory, '/joint_trajectory', lambda _: None, 10)
    node = spin(TouchRunner, cell=zeroed, output=tmp_path / 'out', autostart=True, exit_when_done=True)
    assert eventually(lambda: not node._controller.absence())
    assert 'nobody serves /ft/zero (sensor.zero_service)' in node._absence()
    assert trigger(client, '/touch_runner/start').message == 'nobody serves /ft/zero (sensor.zero_service)'
    end = monotonic() + 0.5
    client.wait('some looks', lambda: monotonic() > end, WAIT)
    assert node.exit_status is None and not node._is_running
    client._node.create_service(Trigger, '/ft/zero', lambda _, answer: answer)
    assert eventually(lambda: node._is_running)


def test_a_goal_of_somebody_else_ends_a_run_by_messages(by_clock, client):
    goals = '/follow_joint_trajectory/_action/status'
    others = client._node.create_publisher(GoalStatusArray, goals, qos_profile_action_status_default)
    client.wait('the runner', others.get_subscription_count, WAIT)
    node, sent = by_clock
    _, stand = standing(node, client)
    client.wait('a way', lambda: stand() and bool(sent) and len(sent[-1].points) > 1, WAIT)
    for status, is_over in ((GoalStatus.STATUS_SUCCEEDED, False), (GoalStatus.STATUS_EXECUTING, True)):
        others.publish(GoalStatusArray(status_list=[GoalStatus(status=status)]))
        end = monotonic() + 0.5
        client.wait('the status', lambda: stand() and (node._runner.is_over or monotonic() > end), WAIT)  # noqa: B023
        assert node._runner.is_over == is_over
    assert 'somebody else sends goals to /follow_joint_trajectory: end that' in node._runner.end.reason
    assert 'somebody else sends goals' in trigger(client, '/touch_runner/start').message
    others.publish(GoalStatusArray())
    assert eventually(lambda: not node._absence())


@pytest.mark.parametrize('answer', [False, True], ids=['fails', 'succeeds'])
def test_the_sensor_is_zeroed_before_the_run(spin, client, zeroed, tmp_path, answer):
    node = spin(TouchRunner, cell=zeroed, output=tmp_path / 'out')
    client._node.create_subscription(JointTrajectory, '/joint_trajectory', lambda _: None, 10)
    calls: list[bool] = []

    def zero(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        calls.append(True)
        response.success, response.message = answer, 'a force acts'
        return response

    client._node.create_service(Trigger, '/ft/zero', zero)
    assert eventually(node._zero_client.service_is_ready)
    assert eventually(lambda: not node._controller.absence())
    start = trigger(client, '/touch_runner/start')
    assert start.success, start.message
    failed = '/ft/zero (sensor.zero_service) failed: a force acts'
    expected = '/joint_states is silent' if answer else failed
    client.wait('the answer', lambda: expected in node._runner.status.text, WAIT)
    assert calls == [True]
