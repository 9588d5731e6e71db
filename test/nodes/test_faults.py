"""What goes wrong around the nodes: they say so, and go on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nodes.waiting import WAIT, eventually, meet
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from benchmark.cell_nodes import DemoClient, NodeProcesses
from benchmark.faults.services import SECONDS, TEXTS, Caller
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.nodes import conversion, streams
from scara_kinetostatic.nodes.calibrator import Calibrator
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.contact_simulator import ContactSimulator
from scara_kinetostatic.nodes.streams import RELIABLE_STREAM, Stream, StreamMonitor

NOBODY = '~nobody_of_that_name/recordings'


def play(collector: Node, names: list[str], start: int) -> None:
    """A publisher of joint states that comes, publishes 20 with the joints in this order, and goes."""
    angles = {'joint1': 0.1, 'lift': 0.7, 'joint2': 0.2}
    joints = collector.create_publisher(JointState, '/joint_states', RELIABLE_STREAM)
    wrench = collector.create_publisher(WrenchStamped, '/wrench', RELIABLE_STREAM)
    meet(collector, joints, wrench)
    monitors = collector._streams.monitors.values()
    expected = [monitor.count + 20 for monitor in monitors]
    for stamp in range(start, start + 200_000_000, 10_000_000):
        message = JointState(name=names, position=[angles[name] for name in names])
        message.header.stamp = conversion.stamp_of(stamp)
        joints.publish(message)
        wrench.publish(conversion.wrench((stamp, 0.0, 0.0), 'base'))
    assert eventually(lambda: [monitor.count for monitor in monitors] == expected)
    collector.destroy_publisher(joints)
    collector.destroy_publisher(wrench)
    heard = [item._subscription for item in collector._streams.monitors.values()]
    assert eventually(lambda: not any(item.get_publisher_count() for item in heard))


def test_a_publisher_that_comes_back_with_another_joint_order(spin: Callable[..., Node], tmp_path: Path) -> None:
    collector = spin(Collector, '--ros-args', '-p', 'autostart:=true', '-p', f'output:={tmp_path}')
    play(collector, ['joint1', 'joint2'], 1_700_000_000_000_000_000)
    play(collector, ['joint2', 'lift', 'joint1'], 1_700_000_001_000_000_000)
    assert [monitor.unusable for monitor in collector._streams.monitors.values()] == [0, 0]
    collector.close()
    (bag,) = tmp_path.iterdir()
    read = read_streams(bag, PAPER_CELL)
    assert len(read.joints.stamp) == 40
    np.testing.assert_array_equal(read.joints.position, np.tile([0.1, 0.2], (40, 1)))
    assert read.warnings == ()


def test_a_home_that_nobody_has_is_named_and_ends_no_node(spin: Callable[..., Node], client: DemoClient) -> None:
    collector = spin(Collector, '--ros-args', '-p', f'output:={NOBODY}')
    answer = client.call('/collector/start', Trigger, Trigger.Request(), WAIT)
    assert not answer.success
    assert f"parameter output: '{NOBODY}'" in answer.message
    assert NOBODY in collector._examine().message


def test_control_characters_in_a_path_are_refused(spin: Callable[..., Node], client: DemoClient) -> None:
    spin(Collector)
    request = SetParameters.Request(parameters=[Parameter('output', value='here\x01\t').to_parameter_msg()])
    client.call('/collector/set_parameters', SetParameters, request, WAIT)
    answer = client.call('/collector/start', Trigger, Trigger.Request(), WAIT)
    assert not answer.success
    assert answer.message.isprintable()
    assert 'control characters' in answer.message


def test_a_former_result_that_is_no_number_is_refused(spin: Callable[..., Node]) -> None:
    with pytest.raises(ParameterError, match=r'parameter calibrated.l1: expected a finite number'):
        spin(Calibrator, '--ros-args', '-p', 'calibrated.l1:=.nan')


@pytest.mark.parametrize('kind', [Collector, ContactSimulator, Calibrator])
def test_a_cell_in_a_home_that_nobody_has_is_refused(spin: Callable[..., Node], kind: type[Node]) -> None:
    with pytest.raises(ParameterError, match='parameter cell'):
        spin(kind, '--ros-args', '-p', f'cell:={NOBODY}')


@pytest.mark.parametrize(
    ('kind', 'arguments', 'message'),
    [
        (Collector, ['autostart:=3'], 'parameter autostart: expected true or false'),
        (Collector, ['output:=5'], 'parameter output: expected a string'),
        (Collector, ['cell:=[1, 2]'], 'parameter cell: expected a string'),
        (Calibrator, ['recording:=true'], 'parameter recording: expected a string'),
        (Calibrator, ['output:=1.5'], 'parameter output: expected a string'),
    ],
)
def test_parameters_of_a_wrong_type_are_refused(
    spin: Callable[..., Node], kind: type[Node], arguments: list[str], message: str
) -> None:
    with pytest.raises(ParameterError, match=message):
        spin(kind, '--ros-args', *(part for argument in arguments for part in ('-p', argument)))


def test_parameters_are_guarded_while_the_collector_records(
    spin: Callable[..., Node], client: DemoClient, tmp_path: Path
) -> None:
    collector = spin(Collector, '--ros-args', '-p', 'autostart:=true', '-p', f'output:={tmp_path}')

    def refusal(name: str, value: object) -> str:
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = client.call('/collector/set_parameters', SetParameters, request, WAIT).results
        return '' if result.successful else str(result.reason)

    assert 'Wrong parameter type' in refusal('output', 5)
    assert 'read-only' in refusal('cell', 'other.yaml')
    assert 'read-only' in refusal('autostart', False)
    folder = collector._session.folder
    assert refusal('output', str(tmp_path / 'next')) == ''
    assert collector._session.folder == folder


def test_calls_that_overlap_are_answered_one_by_one(
    spin: Callable[..., Node], client: DemoClient, tmp_path: Path
) -> None:
    spin(Collector, '--ros-args', '-p', f'output:={tmp_path}')
    assert 'nothing is being recorded' in client.call('/collector/stop', Trigger, Trigger.Request(), WAIT).message
    start = client._meet('/collector/start', Trigger)
    calls = [start.call_async(Trigger.Request()) for _ in range(5)]
    client.wait('the answers', lambda: all(call.done() for call in calls), WAIT)
    answers = [call.result() for call in calls]
    assert sum(answer.success for answer in answers) == 1
    assert sum('recording already' in answer.message for answer in answers) == 4
    assert len(list(tmp_path.glob('touches_*'))) == 1


def test_messages_that_were_lost_are_said(
    spin: Callable[..., Node], client: DemoClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shallow = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    monkeypatch.setattr(streams, 'RELIABLE_STREAM', shallow)
    collector = spin(Collector, '--ros-args', '-p', f'output:={tmp_path}')
    client.call('/collector/start', Trigger, Trigger.Request(), WAIT)
    publisher = collector.create_publisher(JointState, '/joint_states', RELIABLE_STREAM)
    meet(collector, publisher)
    monitor = collector._streams.monitors[Stream.JOINTS]

    def publish(stamp: int) -> None:
        message = JointState(name=['joint1', 'joint2'], position=[0.1, 0.2])
        message.header.stamp = conversion.stamp_of(stamp * 1_000_000)
        publisher.publish(message)

    def busy() -> None:
        timer.cancel()
        for stamp in range(1, 101):
            publish(stamp)
        publisher.wait_for_all_acked(Duration(seconds=WAIT))

    publish(0)
    assert eventually(lambda: monitor.count == 1)
    timer = collector.create_timer(0.0, busy)
    assert eventually(lambda: monitor.count > 1)
    assert eventually(lambda: monitor.lost + monitor.count == 101)
    assert monitor.lost >= 80
    answer = client.call('/collector/stop', Trigger, Trigger.Request(), WAIT)
    assert f'{monitor.lost} messages were lost' in answer.message


@pytest.mark.parametrize(
    ('publishers', 'numbers', 'missed'),
    [
        (1, [1, 2, 3, 4], [0, 0, 0, 0]),
        (1, [7, 8, 12, 13], [0, 0, 3, 0]),
        (1, [98, 99, 1, 2, 4], [0, 0, 0, 0, 1]),  # started anew
        (1, [8, 9, 5, 6, 9], [0, 0, 0, 0, 2]),  # started anew, and heard late
        (2, [50, 1, 51, 2, 52, 4, 54, 55], [0] * 8),  # of two publishers the numbers do not tell
        (0, [1, 2, 4], [0, 0, 1]),  # gone, its messages still wait
        (1, [None, 0, 0], [0, 0, 0]),  # a middleware without numbers
    ],
)
def test_gaps_in_the_numbers_of_messages(publishers: int, numbers: list[int | None], missed: list[int]) -> None:
    monitor, lost = StreamMonitor('/wrench'), 0
    for number, expected in zip(numbers, missed, strict=True):
        monitor.follow(number, lambda: publishers)
        lost += expected
        assert monitor.lost == lost
    assert (f'{lost} messages lost' in ''.join(monitor.report()[0])) == (lost > 0)


def test_a_driver_that_does_not_stamp_is_named(spin: Callable[..., Node], tmp_path: Path) -> None:
    collector = spin(Collector, '--ros-args', '-p', 'autostart:=true', '-p', f'output:={tmp_path}')
    publisher = collector.create_publisher(JointState, '/joint_states', RELIABLE_STREAM)
    meet(collector, publisher)
    monitor = collector._streams.monitors[Stream.JOINTS]
    for number in (1, 2):
        publisher.publish(JointState(name=['joint1', 'joint2'], position=[0.1, 0.2]))
        assert eventually(lambda: monitor.count == number)  # noqa: B023
        monitor._stamped -= 2.0  # as if 2 s had passed
    assert eventually(lambda: 'header stamps do not change' in monitor.problem)
    publisher.publish(conversion.joint_state((1_700_000_000_000_000_000, 0.1, 0.2), ('joint1', 'joint2')))
    assert eventually(lambda: monitor.count == 3)
    assert eventually(lambda: monitor.problem == '')


def test_a_hundred_calls_at_once_are_answered(processes: NodeProcesses, domain: int, tmp_path: Path) -> None:
    processes.start('collector', {'output': tmp_path})
    caller = Caller(domain)
    try:
        assert caller.spin(lambda: '/collector/start' in caller.services('collector'), WAIT)
        for clients in (1, 10):
            answered, seconds = caller.flood('/collector/start', Trigger, 100, clients)
            assert (answered, seconds < SECONDS) == (100, True)
    finally:
        caller.close()
    assert len(list(tmp_path.glob('touches*'))) == 1


def test_no_text_of_a_parameter_ends_the_collector(
    processes: NodeProcesses, client: DemoClient, tmp_path: Path
) -> None:
    processes.start('collector', {'output': tmp_path})
    refused = []
    for text in (*TEXTS, str(tmp_path)):
        request = SetParameters.Request(parameters=[Parameter('output', value=text).to_parameter_msg()])
        client.call('/collector/set_parameters', SetParameters, request, WAIT)
        if text.startswith(('x' * 300, '/dev', '/proc', str(tmp_path))):
            answer = client.call('/collector/start', Trigger, Trigger.Request(), WAIT)
            refused.append(not answer.success)
            assert '\n' not in answer.message
    processes.check()
    assert refused == [True] * (len(refused) - 1) + [False]


def test_a_second_node_of_a_name_is_said(
    processes: NodeProcesses, client: DemoClient, spin: Callable[..., Node]
) -> None:
    spin(Collector)
    processes.start('collector', {})
    said: list[str] = []
    client._node.create_subscription(
        DiagnosticArray, '/diagnostics', lambda array: said.extend(status.message for status in array.status), 10
    )
    client.wait('a warning', lambda: any('another node is named /collector' in text for text in said), WAIT)
    assert eventually(lambda: 'another node is named /collector' in processes.log('collector').read_text())
