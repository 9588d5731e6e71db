"""Cells side by side, and robots that share a topic."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nodes.waiting import WAIT, eventually, trigger
from rclpy.node import Node
from rclpy.qos import QoSPresetProfiles
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState

from benchmark.cell_nodes import DemoClient, NodeProcesses
from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import OK, WARN
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.streams import LATCHED_TOUCHES, RELIABLE_STREAM
from scara_kinetostatic.touches.detection import DISCARDED, find_touches

PLAN = """
- {disc: disc_1, angle_deg: 30, posture: left, force: 25}
- {disc: disc_1, angle_deg: -30, posture: left, force: 35}
- {disc: disc_2, angle_deg: -90, posture: left, force: 30}
"""


def test_two_cells_in_two_namespaces_do_not_mix(
    processes: NodeProcesses, client: DemoClient, cell_file: Path, tmp_path: Path
) -> None:
    """With the same description, whose topic names are relative."""
    (tmp_path / 'plan.yaml').write_text(PLAN)
    for number, space in enumerate(('left', 'right')):
        simulator = {'cell': cell_file, 'plan': tmp_path / 'plan.yaml', 'wait_for_subscribers': 1, 'time_factor': 10.0}
        processes.start('collector', {'cell': cell_file, 'output': tmp_path / space, 'autostart': True}, space)
        processes.start('contact_simulator', simulator | {'truth.theta1': 0.02 * number}, space)
    for space in ('left', 'right'):
        asked = f'/{space}/collector/stop'
        (recording,) = iter_until(client, tmp_path / space)
        client.wait('three touches', lambda: len(touches_in(recording)) >= 3, WAIT)  # noqa: B023
        answer = trigger(client, asked)
        assert answer.message.startswith('3 touches (0 more rejected)')
        assert 'publishers' not in answer.message
    first, second = (read_streams(next((tmp_path / space).iterdir()), PAPER_CELL) for space in ('left', 'right'))
    assert first.topics == ('/left/joint_states', '/left/wrench')
    assert second.topics == ('/right/joint_states', '/right/wrench')
    turned = (
        find_touches(second, PAPER_CELL).touches.joints[:, 0] - find_touches(first, PAPER_CELL).touches.joints[:, 0]
    )
    np.testing.assert_allclose(turned, -0.02, atol=2e-3)


def iter_until(client: DemoClient, folder: Path) -> list[Path]:
    client.wait('a recording', lambda: folder.exists() and any(folder.glob('touches_*')), WAIT)
    return list(folder.glob('touches_*'))


def touches_in(recording: Path) -> list[int]:
    try:
        return find_touches(read_streams(recording, PAPER_CELL), PAPER_CELL).touches.index.tolist()
    except Exception:  # nothing is recorded yet
        return []


def test_topics_are_recorded_as_they_are(spin: Callable[..., Node], tmp_path: Path) -> None:
    remaps = ('-r', 'joint_states:=/arm/state', '-r', 'wrench:=ft')
    collector = spin(Collector, '-r', '__ns:=/left', *remaps, output=tmp_path)
    joints = collector.create_publisher(JointState, '/arm/state', RELIABLE_STREAM)
    wrench = collector.create_publisher(WrenchStamped, '/left/ft', QoSPresetProfiles.SENSOR_DATA.value)
    assert eventually(lambda: joints.get_subscription_count() > 0 and wrench.get_subscription_count() > 0)
    assert collector._start()
    for stamp in range(10**18, 10**18 + 10**9, 10**7):
        joints.publish(conversion.joint_state((stamp, 0.1, 0.2), ('joint1', 'joint2')))
        wrench.publish(conversion.wrench((stamp, 0.0, 0.0), 'base'))
        sleep(0.001)
    assert eventually(lambda: all(monitor.count > 50 for monitor in collector._streams.monitors.values()))
    collector.close()
    (bag,) = tmp_path.iterdir()
    with Reader(bag) as reader:
        received = np.array([time for item, time, _ in reader.messages() if item.topic != '/cell_description'])
    assert len(np.unique(received)) > 0.9 * len(received)  # when each came, not when the queue was emptied
    assert embedded_cell(bag) == PAPER_CELL
    assert read_streams(bag, PAPER_CELL).topics == ('/arm/state', '/left/ft')


def test_two_publishers_on_a_topic_are_said(bench: Callable[..., Any], cell_file: Path, tmp_path: Path) -> None:
    b = bench(Collector, cell=cell_file, output=tmp_path)
    one, other = (b.robot.create_publisher(WrenchStamped, '/wrench', RELIABLE_STREAM) for _ in range(2))
    b.wait(b.says('/wrench: 2 publishers (/robot, /robot), whose messages mix', WARN))
    assert '/wrench: 2 publishers' in b.call('/collector/start').message
    assert '/wrench: 2 publishers' in b.call('/collector/stop').message
    b.robot.destroy_publisher(other)
    b.wait(b.says('', OK))
    b.robot.destroy_publisher(one)


def test_a_touch_is_published_and_can_be_discarded(
    processes: NodeProcesses, client: DemoClient, cell_file: Path, tmp_path: Path
) -> None:
    (tmp_path / 'plan.yaml').write_text(PLAN)
    told: list[dict[str, str]] = []
    client._node.create_subscription(
        DiagnosticArray,
        '/collector/touch',
        lambda array: told.append({item.key: item.value for item in array.status[0].values}),
        LATCHED_TOUCHES,
    )
    processes.start('collector', {'cell': cell_file, 'output': tmp_path / 'bags', 'autostart': True})
    assert 'no accepted touch' in trigger(client, '/collector/discard_last').message
    simulator = {'cell': cell_file, 'plan': tmp_path / 'plan.yaml', 'wait_for_subscribers': 1, 'time_factor': 10.0}
    processes.start('contact_simulator', simulator)
    client.wait('two touches', lambda: len(told) >= 2, WAIT)
    client.wait('the end', lambda: client.finished, WAIT)
    answer = trigger(client, '/collector/discard_last')
    assert answer.success
    number = int(answer.message.split()[1])
    client.wait('the message', lambda: any(touch['discarded'] == 'true' for touch in told), WAIT)
    stopped = trigger(client, '/collector/stop')
    assert stopped.message.startswith('2 touches (1 more rejected)')
    client.wait('all messages', lambda: len(told) == 4, WAIT)
    assert [touch['accepted'] for touch in told].count('true') == 3
    assert {touch['recording'] for touch in told} == {client.recording}
    assert float(told[0]['fx_N']) ** 2 + float(told[0]['fy_N']) ** 2 == pytest.approx(25.0**2, rel=0.1)
    assert told[0]['object'] == 'disc_1'
    detection = find_touches(read_streams(client.recording, PAPER_CELL), PAPER_CELL)
    assert [(item.index, item.reason) for item in detection.rejected] == [(number, DISCARDED)]
    assert len(detection.touches) == 2
    assert 'nothing is being recorded' in trigger(client, '/collector/discard_last').message
