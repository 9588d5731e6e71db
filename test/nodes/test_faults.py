"""What goes wrong around the nodes: they say so, and go on."""

from __future__ import annotations

import pytest
from nodes.waiting import WAIT
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from benchmark.faults.services import TEXTS
from scara_kinetostatic.errors import CellError, ParameterError
from scara_kinetostatic.nodes import conversion, streams
from scara_kinetostatic.nodes.calibrator import Calibrator
from scara_kinetostatic.nodes.collector import Collector
from scara_kinetostatic.nodes.contact_simulator import ContactSimulator
from scara_kinetostatic.nodes.streams import RELIABLE_STREAM, Stream, StreamMonitor

NOBODY = '~nobody_of_that_name/recordings'
BIAS = "effects:=['sensor_bias:x=1.0,y=-0.5']"


@pytest.mark.parametrize(
    ('kind', 'arguments', 'message'),
    [
        (Collector, [f'cell:={NOBODY}'], 'parameter cell'),
        (Collector, ['autostart:=3'], 'parameter autostart'),
        (Calibrator, ['recording:=true'], 'parameter recording'),
        (Calibrator, ['calibrated.l1:=.nan'], 'parameter calibrated.l1: expected a finite number'),
        (Calibrator, ['calibrated.l1:=long'], 'calibrated.l1'),
        (Calibrator, ['calibrated.l1:=0.33', 'calibration.recordings:=3'], 'calibration.recordings: expected'),
        (ContactSimulator, ['time_factor:=2'], 'parameter time_factor'),
        (ContactSimulator, ["effects:=['sensor_bias:x=1']"], 'expected x, y once each'),
        (ContactSimulator, ['effects:=gravity'], 'parameter effects'),
        (ContactSimulator, ['cell:=/no/such/cell.yaml'], '/no/such/cell.yaml'),
        (ContactSimulator, ['commanded:=true', 'scene:=nowhere'], "scene: there is no 'nowhere'"),
        (ContactSimulator, ['commanded:=true', 'fault:=nonsense'], 'parameter fault: expected does_not_follow, moved'),
        (ContactSimulator, ['commanded:=true', 'lag:=-1.0'], 'parameter lag'),
        (ContactSimulator, ['commanded:=true', 'plan:=plan.yaml'], 'commanded: a commanded robot has no plan'),
        (ContactSimulator, ['commanded:=true', 'scene:=plain', BIAS], 'a scene has its own'),
    ],
)
def test_parameters_that_make_no_sense_are_refused(bench, kind, arguments, message):
    with pytest.raises((ParameterError, ParameterException, CellError), match=message):
        bench(kind, *(part for argument in arguments for part in ('-p', argument)))


def test_parameters_are_guarded_while_the_collector_records(bench, tmp_path):
    b = bench(Collector, autostart=True, output=tmp_path)
    assert 'Wrong parameter type' in b.set('output', 5)
    assert 'read-only' in b.set('cell', 'other.yaml')
    assert 'read-only' in b.set('autostart', False)
    folder = b.node._session.folder
    assert b.set('output', str(tmp_path / 'next')) == ''
    assert b.node._session.folder == folder


def test_messages_that_were_lost_are_said(bench, tmp_path, monkeypatch):
    shallow = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
    monkeypatch.setattr(streams, 'RELIABLE_STREAM', shallow)
    b = bench(Collector, output=tmp_path, autostart=True)
    publisher = b.robot.create_publisher(JointState, '/joint_states', RELIABLE_STREAM)
    b.meet(publisher)
    monitor = b.node._streams.monitors[Stream.JOINTS]

    def publish(stamp: int) -> None:
        publisher.publish(conversion.joint_state((stamp * 1_000_000, 0.1, 0.2), ('joint1', 'joint2')))

    publish(0)
    b.wait(lambda: monitor.count == 1)
    for stamp in range(1, 101):  # the node is busy
        publish(stamp)
    publisher.wait_for_all_acked(Duration(seconds=WAIT))
    # where the last ones are among the lost, the next one tells
    b.wait(lambda: monitor.lost + monitor.count >= 101, lambda: publish(101))
    assert monitor.lost >= 80
    assert f'{monitor.lost} messages were lost' in b.call('/collector/stop').message


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
def test_gaps_in_the_numbers_of_messages(publishers, numbers, missed):
    monitor, lost = StreamMonitor('/wrench'), 0
    for number, expected in zip(numbers, missed, strict=True):
        monitor.follow(number, lambda: publishers)
        lost += expected
        assert monitor.lost == lost
    assert (f'{lost} messages lost' in ''.join(monitor.report()[0])) == (lost > 0)


def test_no_text_of_a_parameter_ends_the_collector(bench, tmp_path):
    b, refused = bench(Collector, output=NOBODY), []
    assert f"parameter output: '{NOBODY}'" in b.call('/collector/start').message
    assert NOBODY in b.node._examine().message
    for text in (*TEXTS, str(tmp_path)):
        b.set('output', text)
        if text.startswith(('x' * 300, '/dev', '/proc', 'a\n', str(tmp_path))):
            answer = b.call('/collector/start')
            refused.append(not answer.success)
            assert answer.message.isprintable()
            assert ('control characters' in answer.message) == ('\n' in text)
    assert refused == [True] * (len(refused) - 1) + [False]
