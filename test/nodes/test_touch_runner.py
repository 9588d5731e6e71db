"""The node that makes a robot touch by itself, against the simulator that obeys."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import monotonic
from types import SimpleNamespace

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nodes.waiting import WAIT, eventually, trigger
from rclpy.node import Node
from rclpy.task import Future
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import JointTrajectory

from scara_kinetostatic.errors import CellError, InputError, UnsupportedDataError
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.nodes import touch_runner
from scara_kinetostatic.nodes.demo_client import DemoClient, NodeProcesses
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

    def for_a_while(self, seconds: float) -> None:
        end = monotonic() + seconds
        self.client.wait('some time', lambda: monotonic() > end, WAIT)


def cell_in(folder: Path) -> Path:
    path = folder / 'cell.yaml'
    path.write_text(dump_cell(CELL))
    return path


@pytest.fixture
def watch(processes: NodeProcesses, client: DemoClient, tmp_path: Path) -> Watch:
    """The simulator and the runner, which begins at once."""
    cell = cell_in(tmp_path)
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


def test_a_kill_leaves_the_robot_standing_and_all_that_was_counted(
    watch: Watch, processes: NodeProcesses, tmp_path: Path
) -> None:
    watch.until('press', accepted=1)
    accepted = int(watch.values['accepted'])
    os.kill(watch.pid, signal.SIGKILL)
    killed = monotonic()
    processes._running.pop('touch_runner').wait()

    def later() -> list[list[float]]:
        return [position for time, position in watch.joints if time > killed + 0.4]

    watch.client.wait('joint states', lambda: len(later()) > 50, WAIT)
    assert np.ptp(later(), axis=0).max() < 1e-4
    (bag,) = (tmp_path / 'out').iterdir()
    assert len(gather_touches([bag], CELL).touches) >= accepted


def test_stop_retracts_and_says_why(watch: Watch, client: DemoClient) -> None:
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
    watch.for_a_while(0.5)
    assert np.ptp([position for _, position in watch.joints[-20:]], axis=0).max() < 1e-4


def test_nobody_hears(spin: Callable[..., Node], client: DemoClient, tmp_path: Path) -> None:
    spin(TouchRunner, '--ros-args', '-p', f'cell:={cell_in(tmp_path)}', '-p', f'output:={tmp_path / "out"}')
    answer = trigger(client, '/touch_runner/start')
    assert not answer.success
    assert 'nobody hears /joint_trajectory' in answer.message
    assert not trigger(client, '/touch_runner/pause').success
    assert not (tmp_path / 'out').exists()


def test_a_second_runner_is_refused(spin: Callable[..., Node], client: DemoClient, tmp_path: Path) -> None:
    node = spin(TouchRunner, '--ros-args', '-p', f'cell:={cell_in(tmp_path)}', '-p', f'output:={tmp_path / "out"}')
    client._node.create_subscription(JointTrajectory, '/joint_trajectory', lambda _: None, 10)
    client._node.create_publisher(JointTrajectory, '/joint_trajectory', 10)
    assert eventually(lambda: 'another node publishes' in node._hearing())
    answer = trigger(client, '/touch_runner/start')
    assert 'another node publishes /joint_trajectory, /demo: end it' in answer.message


def test_started_by_itself_it_ends_with_a_status(
    spin: Callable[..., Node], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(touch_runner, '_WAIT', 0.5)
    given = {'cell': cell_in(tmp_path), 'output': tmp_path / 'out', 'autostart': 'true', 'exit_when_done': 'true'}
    node = spin(TouchRunner, '--ros-args', *(part for k, v in given.items() for part in ('-p', f'{k}:={v}')))
    assert eventually(lambda: node.exit_status == 3)
    assert 'nobody hears' in node._runner.status.text


def test_without_control_msgs_an_action_is_refused(spin: Callable[..., Node], tmp_path: Path) -> None:
    with pytest.raises(InputError, match='control_msgs cannot be imported'):
        spin(TouchRunner, '--ros-args', '-p', f'cell:={cell_in(tmp_path)}', '-p', 'action:=arm/follow')


def test_an_action_server_is_commanded_and_may_refuse(
    spin: Callable[..., Node], client: DemoClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a stand-in for rclpy's action client: control_msgs is not needed here."""
    goals, answers = [], list[Future]()

    class Client:
        server_is_ready = staticmethod(lambda: True)

        def send_goal_async(self, goal: JointTrajectory) -> Future:
            goals.append(goal)
            answers.append(Future())
            answers[-1].set_result(SimpleNamespace(accepted=len(goals) < 20))
            return answers[-1]

    monkeypatch.setattr(
        TouchRunner,
        '_action_client',
        lambda self, name: (Client(), SimpleNamespace(Goal=lambda trajectory: trajectory)),
    )
    given = {'cell': cell_in(tmp_path), 'output': tmp_path / 'out', 'action': 'arm/follow', 'use_sim_time': 'true'}
    node = spin(TouchRunner, '--ros-args', *(part for k, v in given.items() for part in ('-p', f'{k}:={v}')))
    states = client._node.create_publisher(JointState, '/joint_states', 10)
    wrenches = client._node.create_publisher(WrenchStamped, '/wrench', 10)
    clock = client._node.create_publisher(Clock, '/clock', 10)
    client.wait('the clock', lambda: clock.get_subscription_count() > 0 and wrenches.get_subscription_count() > 0, WAIT)
    start = trigger(client, '/touch_runner/start')
    assert start.success, start.message
    now = 1.0

    def stand() -> bool:
        nonlocal now
        now += 0.004
        stamp = Time(seconds=now).to_msg()
        clock.publish(Clock(clock=stamp))
        states.publish(JointState(header=Header(stamp=stamp), name=['joint1', 'joint2'], position=[0.5, 1.0]))
        wrenches.publish(WrenchStamped(header=Header(stamp=stamp, frame_id='base_link')))
        return 'refuses' in node._runner.status.text or node._runner.is_over

    client.wait('the refusal', stand, WAIT)
    assert goals[0].joint_names == list(CELL.joint_names)
    assert 'the controller refuses a trajectory' in node._runner.status.text


@pytest.mark.parametrize(
    ('change', 'error', 'says'),
    [
        ({'limits': None}, CellError, 'limits of the joints are missing'),
        ({'tolerance': 1e-8}, UnsupportedDataError, 'the tolerance is'),
    ],
    ids=['limits', 'tolerance'],
)
def test_what_is_wrong_is_said_at_the_start(
    spin: Callable[..., Node], tmp_path: Path, change: dict[str, object], error: type[Exception], says: str
) -> None:
    path = tmp_path / 'cell.yaml'
    path.write_text(dump_cell(replace(CELL, **change)))
    with pytest.raises(error, match=says):
        spin(TouchRunner, '--ros-args', '-p', f'cell:={path}')
    assert PAPER_CELL.limits is None
