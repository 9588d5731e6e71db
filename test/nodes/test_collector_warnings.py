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


ARM, ONE, TWO, OTHERS = map(frozenset, (('joint1', 'joint2'), ('joint1',), ('joint2',), ('finger', 'thumb')))


@pytest.mark.parametrize(
    ('heard', 'most'), [([ARM], 1), ([ARM, OTHERS], 2), ([ONE, TWO], 2), ([ONE, TWO, OTHERS], 3), ([], 1)]
)
def test_publishers_that_mix_are_named_and_one_for_each_joint_is_none(heard, most):
    monitor = StreamMonitor('/joint_states')
    for _ in range(2):
        monitor.publishers = ['/driver'] * most
        monitor.joints.update(heard)
        monitor.accept()
        assert monitor.mixture() == ''
        monitor.publishers.append('/b/driver')
        assert f'{most + 1} publishers (/b/driver, /driver' in monitor.mixture()
        monitor.report()
        assert f'{most + 1} publishers' in monitor.mixture()


def test_a_silent_joint_is_named():
    monitor = StreamMonitor('/joint_states')
    monitor.publishers = ['/shoulder', '/elbow']
    monitor.joints.add(ONE)
    monitor.note_part('joint2')
    monitor.refuse('joint2 is silent')
    assert monitor.report()[0] == ['/joint_states: joint2 is silent', '']
    assert (monitor.count, monitor.unusable, monitor.parts) == (2, 1, 1)


def test_positions_that_alternate_are_said():
    monitor = StreamMonitor('/joint_states')
    for k in range(200):
        monitor.accept((0.3 + 1e-3 * k, 0.5), *[(0.0, 0.0)] * (k % 8 == 7))
    assert monitor.report()[0][-1] == '/joint_states: the positions alternate: two publishers?'
    for k in range(200):
        monitor.accept((0.3 + 1e-3 * k, 0.5))
    assert monitor.report()[0][-1] == ''


def test_a_held_joint_that_has_moved_is_known_until_a_message_can_be_used():
    monitor = StreamMonitor('/joint_states')
    monitor.refuse('joint4 is at 0.6', has_moved=True)
    monitor.note_part('joint2')
    assert (monitor.refusal, monitor.has_moved) == ('joint4 is at 0.6', True)
    monitor.accept()
    assert (monitor.refusal, monitor.has_moved) == ('', False)
    monitor.note_part('joint2')
    assert (monitor.refusal, monitor.has_moved) == ('nothing yet of joint2', False)
