"""What would spoil a recording is said while it can be mended."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from sensor_msgs.msg import JointState

from scara_kinetostatic.nodes import session
from scara_kinetostatic.nodes.cell_node import OK, WARN
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.streams import Stream, StreamMonitor

GIB = 1 << 30


def test_the_collector_warns_of_the_disk(bench, tmp_path, monkeypatch):
    monkeypatch.setattr(session.shutil, 'disk_usage', lambda _: SimpleNamespace(free=GIB // 2))
    collector = bench(Collector, autostart=True, output=tmp_path).node
    condition = collector._examine()
    assert condition.level == WARN
    assert f'the disk of {tmp_path} has' in condition.message
    collector.close()
    collector._session = None
    assert collector._examine().level == OK


@pytest.mark.parametrize(
    ('name', 'is_given', 'expected'),
    [('/left/contact_simulator', False, False), ('/left/driver', False, True), ('/left/driver', True, False)],
)
def test_a_robot_taken_for_the_example_cell_is_said(bench, cell_file, name, is_given, expected):
    collector = bench(Collector, cell=cell_file if is_given else '').node
    collector._streams.look_at_publishers = lambda: None
    collector._streams.monitors[Stream.JOINTS].publishers = [name]
    assert ('taken for the example cell' in collector._examine().message) == expected
    assert (collector._examine().level == WARN) == expected


def test_a_robot_taken_for_the_example_cell_is_said_as_the_recording_begins(bench, tmp_path):
    b = bench(Collector, output=tmp_path / 'bags')
    b.robot.create_publisher(JointState, '/joint_states', 10)
    b.wait(lambda: b.node.count_publishers('/joint_states') == 1)
    answer = b.call('/collector/start')
    assert answer.success
    assert 'taken for the example cell' in answer.message


def test_publishers_that_mix_are_named_and_a_driver_of_other_joints_is_none():
    monitor = StreamMonitor('/joint_states')
    monitor.publishers = ['/a/driver']
    assert monitor.mixture() == ''
    monitor.publishers.append('/b/driver')
    assert '2 publishers (/a/driver, /b/driver)' in monitor.mixture()
    monitor.accept()
    monitor.refuse('other joints')
    monitor.report()
    assert monitor.mixture() == ''
    monitor.publishers.append('/gripper')
    assert '3 publishers' in monitor.mixture()


def test_publishers_of_parts_do_not_mix_and_a_silent_joint_is_named():
    monitor = StreamMonitor('/joint_states')
    monitor.publishers = ['/shoulder', '/elbow', '/gripper']
    for _ in range(50):
        monitor.note_part('joint2')
        monitor.accept()
        monitor.refuse('expected positions of joint1 and joint2')
    assert monitor.mixture() == ''  # before the first report
    assert not any(monitor.report()[0])
    monitor.note_part('joint2')
    monitor.refuse('joint2 is silent')
    assert monitor.report()[0] == ['/joint_states: joint2 is silent', '']
    assert (monitor.count, monitor.unusable, monitor.parts) == (152, 51, 51)
    monitor.accept()
    assert '3 publishers' in monitor.report()[0][-1]  # no parts since the last report


def test_a_held_joint_that_has_moved_is_known_until_a_message_can_be_used():
    monitor = StreamMonitor('/joint_states')
    monitor.refuse('joint4 is at 0.6', has_moved=True)
    monitor.note_part('joint2')
    assert (monitor.refusal, monitor.has_moved) == ('joint4 is at 0.6', True)
    monitor.accept()
    assert (monitor.refusal, monitor.has_moved) == ('', False)
    monitor.note_part('joint2')
    assert (monitor.refusal, monitor.has_moved) == ('nothing yet of joint2', False)
