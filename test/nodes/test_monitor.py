"""The drift monitor as a node: touches of the collector's topic, alarms, bad input."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from monitoring.simulated import CELL, TRUTH, touches_of

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.drift import DriftMonitor
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN, RefusedError
from scara_kinetostatic.nodes.conversion import touch_of
from scara_kinetostatic.nodes.monitor import Monitor, String, was_seen
from scara_kinetostatic.nodes.session import JudgedTouch
from scara_kinetostatic.nodes.streams import LATCHED_TOUCHES
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report.page import json_text
from scara_kinetostatic.results.document import as_document
from scara_kinetostatic.touches.detection import DISCARDED


@pytest.fixture(scope='module')
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('result') / 'calibration.json'
    document = as_document(calibrate_touches(touches_of(CELL, 0, world=None), CELL))
    document['recordings'] = [{'path': 'bags/seen', 'sha256': 'ab', 'start': None}]
    document['touches']['found'] = 40
    path.write_text(json_text(document))
    return path


def messages(touches: TouchSet, recording: str, **changes: Any) -> list[Any]:
    judged = [
        JudgedTouch(
            k, 0, '', CELL.discs[touches.disc[k]].name, tuple(touches.force[k]), tuple(touches.joints[k])
        )._replace(**changes)
        for k in range(len(touches))
    ]
    return [touch.message('/collector', recording, CELL.sensor.frame.value) for touch in judged]


@pytest.fixture
def watching(bench: Callable[..., Any]) -> Callable[..., Monitor]:
    """A monitor of touches that somebody publishes."""

    def start(**given: object) -> Monitor:
        b = bench(Monitor, **given)
        b.robot.create_publisher(DiagnosticArray, 'collector/touch', LATCHED_TOUCHES)
        return b.node

    return start


def feed(node: Monitor, touches: TouchSet, recording: str, **changes: Any) -> None:
    for message in messages(touches, recording, **changes):
        node._note_touch(message)


def test_a_change_is_raised_and_reset(watching, calibration, monkeypatch):
    node = watching(calibration=calibration)
    monday = touches_of(CELL, 1, world=None).select(np.arange(8))
    feed(node, monday, '/monday')
    condition = node._report()
    assert condition.level == OK and condition.message == '8 touches agree with the calibration'
    feed(node, monday, '/monday')  # latched messages come again
    seen = touches_of(CELL, 3, world=None).select(np.arange(5))
    feed(node, seen, '/data/bags/seen')
    assert node._report().values['touches'] == '8'
    assert node._report().values['touches of the calibration'] == '5'
    changed = touches_of(CELL, 2, TRUTH.replace(l1=TRUTH.l1 + 1e-4), world=None).select(np.arange(10))
    feed(node, changed, '/tuesday')
    condition = node._report()
    assert condition.level == ERROR and 'link 1 changed its length' in condition.message
    assert condition.values['changed'] == 'l1'
    assert re.search('since touch [0-3] of tuesday', condition.message)
    assert node._report().values['rejected touches in a row'] == '0'
    said: list[str] = []
    monkeypatch.setattr(node, 'get_logger', lambda: SimpleNamespace(error=said.append))
    best = node._monitor.alarm.best
    other = best._replace(name='base')
    node._monitor.alarm = node._monitor.alarm._replace(best=other)  # named wrongly at first
    later = touches_of(CELL, 4, TRUTH.replace(l1=TRUTH.l1 + 1e-4), world=None).select(np.arange(2))
    feed(node, later, '/wednesday')
    (line,) = said  # the corrected name, once
    assert 'link 1 changed its length' in line
    feed(node, later, '/wednesday', reason=DISCARDED)
    feed(node, changed, '/tuesday', reason=DISCARDED)
    assert node._report().level == OK and node._report().values['touches'] == '8'
    assert node._report().values['rejected touches in a row'] == '0'
    assert node._reset() == 'touches count anew from here'
    assert node._report().values['touches'] == '0'


def test_later_touches_of_the_recording_count_and_the_last_is_taken_back(watching, calibration):
    node = watching(calibration=calibration)
    touches = touches_of(CELL, 1, world=None).select(np.arange(4))
    for number, message in enumerate(messages(touches, '/data/bags/seen'), 38):
        status = message.status[0]
        next(item for item in status.values if item.key == 'touch').value = str(number)
        node._note_touch(message)
        if number == 40:
            statistic = node._monitor.statistic
    assert node._report().values['touches'] == '2'
    next(item for item in status.values if item.key == 'accepted').value = 'false'
    node._note_touch(message)
    assert node._monitor.count == 1 and node._monitor.statistic == statistic
    assert not was_seen('/data/other/seen', '0', node._monitor.record)


def test_the_direction_of_approach_is_taken_over(calibration):
    (message,) = messages(touches_of(CELL, 1, world=None).select([0]), '/a', approach=(0.1, -0.2, 0.01, -0.02))
    values = {item.key: item.value for item in message.status[0].values}
    touch = touch_of(values, CalibrationRecord.load(calibration).arm)
    assert touch.approach.tolist() == [[0.1, -0.2]] and touch.press.tolist() == [[0.01, -0.02]]


def test_what_the_topic_does_not_say_is_assumed_and_said(watching, calibration, monkeypatch):
    monkeypatch.setattr(Predictor, 'assumptions', 'as at the end of the calibration')
    node = watching(calibration=calibration)
    assert node._report().level == WARN and 'as at the end of the calibration' in node._report().message


def test_only_newer_results_are_taken(watching, calibration, tmp_path):
    node = watching(calibration=calibration)
    feed(node, touches_of(CELL, 1, world=None).select([0, 1]), '/a')
    for created, count in (('2000-01-01T00:00:00Z', 2), (node._monitor.record.created, 2), ('2100-01-01T00:00:00Z', 0)):
        document = json.loads(calibration.read_text()) | {'created': created}
        (tmp_path / 'calibration.json').write_text(json.dumps(document))
        said = {'published': True, 'created': created, 'files': {'folder': str(tmp_path)}}
        node._calibration._take_result(String(data=json.dumps(said)))
        assert node._monitor.count == count and node._report().level == OK
    assert node.get_subscriptions_info_by_topic('/calibrator/result')


def test_bad_touches_and_a_failing_update_are_said_and_survived(watching, calibration, monkeypatch):
    node = watching(calibration=calibration)
    touch = touches_of(CELL, 1, world=None).select([0])
    for change in ({'object': 'nothing'}, {'force': ()}, {'joints': (float('nan'), 0.0)}, {'joints': (1e308, 0.0)}):
        feed(node, touch, '/b', **change)
        assert node._report().level == WARN, change
    (message,) = messages(touch, '/a')
    next(item for item in message.status[0].values if item.key == 'touch').value = 'x'
    node._note_touch(message)
    assert node._report().level == WARN and 'touch x cannot be evaluated' in node._report().message

    def fail(*_: object) -> None:
        raise np.linalg.LinAlgError('not positive definite')

    with monkeypatch.context() as patch:
        patch.setattr(DriftMonitor, '_evaluate', fail)
        feed(node, touch, '/a')
    assert node._report().level == WARN and node._monitor.count == 0
    feed(node, touch, '/a')
    assert node._report().level == OK and node._report().message == '1 touch agrees with the calibration'


def test_touches_that_are_rejected_one_after_the_other(watching, calibration):
    node = watching(calibration=calibration)
    touches = touches_of(CELL, 1, world=None)
    assert node._report().message == 'no touch yet'
    feed(node, touches.select([0, 1]), '/a', reason='no object there')
    assert node._report().level == OK
    feed(node, touches.select([2]), '/a', reason='no object there')
    assert node._report().level == WARN and 'the last 3 touches were rejected' in node._report().message
    assert node._reset() == 'touches count anew from here'
    assert node._report().level == OK
    feed(node, touches.select([0, 1, 2]), '/b', reason='no object there')
    assert node._report().level == WARN
    feed(node, touches.select([4]), '/b')
    assert node._report().level == OK


def test_the_calibration_of_the_calibrator(watching, calibration):
    node = watching()
    assert node._report().level == WARN and 'no calibration yet' in node._report().message
    with pytest.raises(RefusedError, match='no calibration yet'):
        node._reset()
    created = json.loads(calibration.read_text())['created']
    said = {'published': True, 'created': created, 'files': {'folder': str(calibration.parent)}}
    for wrong in ('{', '[]', '{}', json.dumps(said | {'created': 'x'}), json.dumps(said | {'files': {'folder': ''}})):
        node._calibration._take_result(String(data=wrong))
        assert node._report().level == WARN and 'not taken' in node._report().message
    node._calibration._take_result(String(data=json.dumps(said)))
    assert node._report().level == OK
    node._calibration._take_result(String(data='{'))
    feed(node, touches_of(CELL, 1, world=None).select([0]), '/a')
    assert node._report().level == WARN and 'not taken' in node._report().message


def test_what_is_not_watched_is_said(bench, calibration, tmp_path):
    document = json.loads(calibration.read_text())
    document['assessment']['grade'] = 'unfit'
    (tmp_path / 'unfit.json').write_text(json.dumps(document))
    with pytest.raises(InputError):
        bench(Monitor, calibration=tmp_path / 'none.json')
    rclpy.shutdown()
    said = bench(Monitor, calibration=tmp_path / 'unfit.json').node._report()
    assert said.level == WARN and 'nobody publishes /collector/touch' in said.message and 'unfit' in said.message
