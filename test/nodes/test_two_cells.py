"""Cells in a namespace, and robots that share a topic."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSPresetProfiles
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState

from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import OK, WARN
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.streams import RELIABLE_STREAM


def test_topics_are_recorded_as_they_are(bench: Callable[..., Any], tmp_path: Path) -> None:
    remaps = ('-r', 'joint_states:=/arm/state', '-r', 'wrench:=ft')
    b = bench(Collector, '-r', '__ns:=/left', *remaps, output=tmp_path)
    collector = b.node
    joints = b.robot.create_publisher(JointState, '/arm/state', RELIABLE_STREAM)
    wrench = b.robot.create_publisher(WrenchStamped, '/left/ft', QoSPresetProfiles.SENSOR_DATA.value)
    b.wait(lambda: joints.get_subscription_count() > 0 and wrench.get_subscription_count() > 0)
    assert collector._start()
    for stamp in range(10**18, 10**18 + 10**9, 10**7):
        joints.publish(conversion.joint_state((stamp, 0.1, 0.2), ('joint1', 'joint2')))
        wrench.publish(conversion.wrench((stamp, 0.0, 0.0), 'base'))
        sleep(0.001)
    b.wait(lambda: all(monitor.count > 50 for monitor in collector._streams.monitors.values()))
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
