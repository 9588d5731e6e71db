from __future__ import annotations

import os
import signal
from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nodes.waiting import WAIT, Bench
from rclpy.publisher import Publisher
from rosbags.rosbag2 import Reader
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from touches.scenes import CELL, START, Scene

from scara_kinetostatic.bags.reader import embedded_cell, read_streams
from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.model.cell import PAPER_CELL, Lift, Sensor
from scara_kinetostatic.nodes import conversion
from scara_kinetostatic.nodes.cell_node import ERROR, WARN, RefusedError
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.streams import LATCHED_TOUCHES, RELIABLE_STREAM
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.detection import find_touches


def publishers(b: Bench) -> tuple[Publisher, Publisher]:
    """Of joint states and wrenches, which the collector hears."""
    kinds = (JointState, '/joint_states'), (WrenchStamped, '/wrench')
    joints, wrench = (b.robot.create_publisher(*kind, RELIABLE_STREAM) for kind in kinds)
    b.meet(joints, wrench)
    return joints, wrench


def publish(b: Bench, count: int, names: tuple[str, str] = ('joint1', 'joint2')) -> None:
    """Publishes joint states and wrenches in which nothing is touched."""
    joints, wrench = publishers(b)
    for number in range(count):
        stamp = 1_700_000_000_000_000_000 + 10_000_000 * number
        joints.publish(conversion.joint_state((stamp, 0.1, 0.2), names))
        wrench.publish(conversion.wrench((stamp, 0.0, 0.0), 'base'))


def test_start_and_stop_each_make_sense_once(bench, cell_file, tmp_path):
    b = bench(Collector, cell=cell_file, output=tmp_path / 'bags')
    recordings = b.hear(String, '/collector/recording')
    assert 'nothing is being recorded' in b.call('/collector/stop').message
    started = b.call('/collector/start')
    assert started.success
    b.wait(lambda: recordings)
    first = recordings[0].data
    assert first in started.message

    again = b.call('/collector/start')
    assert not again.success
    assert 'recording already' in again.message

    assert b.call('/collector/stop').success
    assert b.call('/collector/start').success
    b.wait(lambda: len(recordings) == 2)
    second = recordings[1].data
    assert second != first
    assert embedded_cell(first) == PAPER_CELL
    b.node.close()
    assert embedded_cell(second) == PAPER_CELL


def test_a_touch_in_which_a_held_joint_moves_is_rejected_and_is_so_in_the_recording(bench, cell_in, tmp_path):
    """The wrist stands elsewhere in the third of four touches, and between others; messages of their own."""
    cell = replace(
        CELL,
        sensor=Sensor('joint_states', 'wrench', time_offset=0.0),
        lift=Lift('joint3', 0.02, 0.0),
        hold={'joint4': 0.5},
    )
    b = bench(Collector, autostart=True, cell=cell_in(cell), output=tmp_path / 'bags')
    collector = b.node
    judged = b.hear(DiagnosticArray, '/collector/touch', LATCHED_TOUCHES)
    joints, force = publishers(b)
    scene = Scene(cell).touches(4)
    streams, (_, _, begin, end) = scene.streams(), scene.holds[2]
    for stamp, (q1, q2) in zip(streams.joints.stamp.tolist(), streams.joints.position.tolist(), strict=True):
        time = 1e-9 * (stamp - START)
        wrist = 0.6 if begin < time < end or end + 0.5 < time < end + 0.8 else 0.5
        for part in ({'joint3': 0.0}, {'joint2': q2, 'joint1': q1}, {'joint4': wrist}):
            message = JointState(name=list(part), position=list(part.values()))
            message.header.stamp = conversion.stamp_of(stamp)
            joints.publish(message)
    for stamp, (x, y) in zip(streams.wrench.stamp.tolist(), streams.wrench.force.tolist(), strict=True):
        force.publish(conversion.wrench((stamp, x, y), 'base'))
    counts = 3 * len(streams.joints.stamp), len(streams.wrench.stamp)
    monitors = collector._streams.monitors.values()
    b.wait(lambda: tuple(monitor.count for monitor in monitors) == counts)
    assert [monitor.unusable for monitor in monitors] == [0, 0]
    reason = 'joint4 is at 0.6, expected 0.5 (robot.hold)'
    b.wait(b.says(reason, WARN))
    answer = collector._end()
    assert '3 touches (1 more rejected)' in answer
    assert f'1 of 4 touches rejected, the last: {reason}' in answer, 'many of them'
    b.wait(lambda: f'touch 2 rejected: {reason}' in {array.status[0].message for array in judged})
    (bag,) = (tmp_path / 'bags').iterdir()
    read = read_streams(bag, cell)
    assert any(f'while {reason}' in warning for warning in read.warnings)
    found = find_touches(read, cell)
    assert [(item.index, item.reason) for item in found.rejected] == [(2, reason)]
    assert len(found.touches) == 3


def test_a_message_for_each_joint_from_a_publisher_each(bench, cell_in, tmp_path):
    """The touches are those of the recording, and of messages with both joints; no publishers mix."""
    cell = replace(CELL, sensor=Sensor('joint_states', 'wrench', time_offset=0.0))
    b = bench(Collector, autostart=True, cell=cell_in(cell), output=tmp_path / 'bags')
    collector = b.node
    joints, force = publishers(b)
    other = b.robot.create_publisher(JointState, '/joint_states', RELIABLE_STREAM)
    b.wait(lambda: collector.count_publishers('/joint_states') == 2)
    streams = Scene(cell).touches(4).streams()
    stamps, (q1, q2) = streams.joints.stamp, streams.joints.position.T
    later = stamps + 4_000_000
    q2 = np.interp(later - stamps[0], stamps - stamps[0], q2)
    for stamp, then, one, two in zip(stamps.tolist(), later.tolist(), q1.tolist(), q2.tolist(), strict=True):
        joints.publish(conversion.joint_state((stamp, one), ('joint1',)))
        other.publish(conversion.joint_state((then, two), ('joint2',)))
    for stamp, (x, y) in zip(streams.wrench.stamp.tolist(), streams.wrench.force.tolist(), strict=True):
        force.publish(conversion.wrench((stamp, x, y), 'base'))
    counts = 2 * len(stamps), len(streams.wrench.stamp)
    monitors = collector._streams.monitors.values()
    b.wait(lambda: tuple(monitor.count for monitor in monitors) == counts)
    assert [monitor.unusable for monitor in monitors] == [0, 0]
    answer = b.call('/collector/stop').message
    assert answer.startswith('4 touches (0 more rejected)'), answer
    assert 'mix' not in answer
    (bag,) = (tmp_path / 'bags').iterdir()
    read, whole = read_streams(bag, cell), find_touches(streams, cell).touches
    assert not read.warnings
    found = find_touches(read, cell).touches
    np.testing.assert_allclose(found.joints, whole.joints, atol=2e-6)
    np.testing.assert_allclose(found.force, whole.force, atol=0.02)


def test_a_recording_without_usable_joint_states_is_no_success(bench, tmp_path):
    b = bench(Collector, autostart=True, output=tmp_path)
    collector = b.node
    publish(b, 20, names=('shoulder', 'elbow'))
    b.wait(lambda: all(monitor.count == 20 for monitor in collector._streams.monitors.values()))
    b.wait(lambda: 'expected positions of joint1 and joint2' in collector._examine().message)
    assert collector._examine().level == WARN
    assert 'shoulder elbow' in collector._examine().message
    with pytest.raises(RefusedError, match='/joint_states: expected positions of joint1 and joint2'):
        collector._stop()


def test_a_disk_that_fails_ends_the_recording_and_not_the_node(bench, tmp_path, monkeypatch):
    b = bench(Collector, autostart=True, output=tmp_path)
    collector = b.node
    folder = collector._session.folder

    def full(*_: object) -> None:
        raise OutputError(folder, 'cannot be written: No space left on device')

    monkeypatch.setattr(collector._session._writer, 'write_wrench', full)
    publish(b, 20)
    b.wait(lambda: collector._session is None)
    assert 'No space left on device' in collector._examine().message
    with pytest.raises(RefusedError, match='No space left on device'):
        collector._stop()


def test_senseless_messages_do_not_end_the_node(bench, tmp_path):
    b = bench(Collector, autostart=True, output=tmp_path)
    collector = b.node
    publish(b, 50)
    joints, wrench = publishers(b)
    names = ('joint1', 'joint2')
    for stamp in (0, 2_000_000_000_000_000_000, 1_700_000_000_000_000_000, 1_600_000_000_000_000_000):
        joints.publish(JointState())
        joints.publish(JointState(name=['joint1', 'joint2'], position=[1.0]))
        joints.publish(conversion.joint_state((stamp, nan, inf), names))
        joints.publish(conversion.joint_state((stamp, 1e300, -1e300), names))
        wrench.publish(WrenchStamped())
        wrench.publish(conversion.wrench((stamp, nan, 0.0), ''))
        wrench.publish(conversion.wrench((stamp, 1e300, -1e300), ''))
        detector = collector._session._detector
        b.wait(lambda: detector._polled == detector._pair.wrench.total)  # noqa: B023
    b.wait(lambda: [m.count for m in collector._streams.monitors.values()] == [66, 62])
    assert [monitor.unusable for monitor in collector._streams.monitors.values()] == [16, 8]
    assert '0 touches' in collector._stop()
    assert collector._start().startswith('recording to ')


def test_a_folder_that_cannot_be_written_leaves_the_node_up(bench, tmp_path):
    (tmp_path / 'bags').write_text('a file where the folder should be')
    b = bench(Collector, autostart=True, output=tmp_path / 'bags')
    collector = b.node
    for _ in range(2):
        assert collector._examine().level == ERROR
        assert str(tmp_path / 'bags') in collector._examine().message
        with pytest.raises(RefusedError, match='bags'):
            collector._start()
    (tmp_path / 'bags').unlink()
    assert collector._start().startswith('recording to ')


def test_simulated_time_begins_with_the_clock_and_every_message_of_a_fast_stream_is_recorded(bench, tmp_path):
    b = bench(Collector, use_sim_time=True, autostart=True, output=tmp_path)
    collector = b.node
    assert 'waiting for /clock' in collector._examine().message
    with pytest.raises(RefusedError, match='/clock'):
        collector._start()
    assert collector._examine().level == WARN  # it waits, nothing has failed
    clock = b.robot.create_publisher(ClockMessage, '/clock', 1)

    message = ClockMessage(clock=conversion.stamp_of(1000 * SECOND))
    b.wait(lambda: collector._session is not None, lambda: clock.publish(message))
    publish(b, 1000)
    b.wait(lambda: all(monitor.count == 1000 for monitor in collector._streams.monitors.values()))
    collector.close()
    (bag,) = tmp_path.iterdir()
    with Reader(bag) as reader:
        assert reader.start_time == 1000 * SECOND
        assert reader.duration < SECOND
    streams = read_streams(bag, PAPER_CELL)
    assert len(streams.joints.stamp) == len(streams.wrench.stamp) == 1000


def test_the_end_of_a_silent_stream_is_secured(bench, tmp_path):
    b = bench(Collector, autostart=True, output=tmp_path)
    collector = b.node
    publish(b, 20)
    b.wait(lambda: collector._session._writer.recorded == 40)


def test_reported_touches_survive_a_kill(processes, client, cell_file, tmp_path):
    collector = processes.start('collector', {'cell': cell_file, 'output': tmp_path / 'bags', 'autostart': True})
    processes.start('contact_simulator', {'cell': cell_file, 'wait_for_subscribers': 1, 'time_factor': 20.0})
    enough = 4
    client.wait('touches', lambda: client.touches >= enough and client.recording != '', WAIT)
    os.kill(collector, signal.SIGKILL)
    cell = embedded_cell(client.recording)
    assert cell == PAPER_CELL
    assert len(find_touches(read_streams(client.recording, cell), cell).touches) >= client.touches >= enough
