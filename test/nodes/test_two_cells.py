"""Cells side by side, and robots that share a topic."""

from __future__ import annotations

from time import sleep

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nodes.waiting import WAIT, eventually, trigger
from rclpy.qos import QoSPresetProfiles
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState

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


def test_two_cells_do_not_mix_and_a_touch_of_one_can_be_discarded(processes, client, cell_file, tmp_path):
    """With the same description, whose topic names are relative."""
    (tmp_path / 'plan.yaml').write_text(PLAN)
    told: dict[str, list[dict[str, str]]] = {'left': [], 'right': []}
    for number, (space, heard) in enumerate(told.items()):
        client._node.create_subscription(
            DiagnosticArray,
            f'/{space}/collector/touch',
            lambda array, heard=heard: heard.append({item.key: item.value for item in array.status[0].values}),
            LATCHED_TOUCHES,
        )
        simulator = {'cell': cell_file, 'plan': tmp_path / 'plan.yaml', 'wait_for_subscribers': 1, 'time_factor': 5.0}
        processes.start('collector', {'cell': cell_file, 'output': tmp_path / space, 'autostart': True}, space)
        assert 'no accepted touch' in trigger(client, f'/{space}/collector/discard_last').message
        processes.start('contact_simulator', simulator | {'truth.theta1': 0.02 * number}, space)
    client.wait('all touches', lambda: all(len(heard) >= 3 for heard in told.values()), WAIT)
    answer = trigger(client, '/left/collector/discard_last')
    assert answer.success
    left = told['left']
    client.wait('the message', lambda: any(touch['discarded'] == 'true' for touch in left), WAIT)
    for space, said in (('left', '2 touches (1 more rejected)'), ('right', '3 touches (0 more rejected)')):
        stopped = trigger(client, f'/{space}/collector/stop').message
        assert stopped.startswith(said)
        assert 'publishers' not in stopped
    assert 'nothing is being recorded' in trigger(client, '/left/collector/discard_last').message
    recordings = [next((tmp_path / space).iterdir()) for space in ('left', 'right')]
    first, second = (read_streams(path, PAPER_CELL) for path in recordings)
    assert first.topics == ('/left/joint_states', '/left/wrench')
    assert second.topics == ('/right/joint_states', '/right/wrench')
    one, other = (find_touches(streams, PAPER_CELL) for streams in (first, second))
    turned = other.touches.joints[:2, 0] - one.touches.joints[:, 0]
    np.testing.assert_allclose(turned, -0.02, atol=2e-3)
    assert [(item.index, item.reason) for item in one.rejected] == [(int(answer.message.split()[1]), DISCARDED)]
    assert [touch['accepted'] for touch in left] == ['true', 'true', 'true', 'false']
    assert {touch['recording'] for touch in left} == {str(recordings[0])}
    assert float(left[0]['fx_N']) ** 2 + float(left[0]['fy_N']) ** 2 == pytest.approx(25.0**2, rel=0.1)
    assert left[0]['object'] == 'disc_1'


def test_topics_are_recorded_as_they_are(spin, tmp_path):
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


def test_two_publishers_on_a_topic_are_said(bench, cell_file, tmp_path):
    b = bench(Collector, cell=cell_file, output=tmp_path)
    one, other = (b.robot.create_publisher(WrenchStamped, '/wrench', RELIABLE_STREAM) for _ in range(2))
    b.wait(b.says('/wrench: 2 publishers (/robot, /robot), whose messages mix', WARN))
    assert '/wrench: 2 publishers' in b.call('/collector/start').message
    assert '/wrench: 2 publishers' in b.call('/collector/stop').message
    b.robot.destroy_publisher(other)
    b.wait(b.says('', OK))
    b.robot.destroy_publisher(one)
