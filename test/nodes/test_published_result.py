"""What the calibrator makes of a result: parameters, answer, level, topics. The calibration itself is canned."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from math import isnan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nodes.waiting import WAIT
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

from benchmark.cell_nodes import DemoClient
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.files.calibration_file import RESULT_SCHEMA
from scara_kinetostatic.model.cell import PAPER_CELL, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.nodes import calibration_job as module
from scara_kinetostatic.nodes.calibrator import Calibrator
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report.json_file import json_text
from scara_kinetostatic.results.calibration_json import as_document
from scara_kinetostatic.results.parameter_file import FACTS, facts, parameter_text
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

Calibrated = Callable[..., Trigger.Response]


@pytest.fixture(scope='module')
def outcome() -> Any:
    touches = simulate_touches(PAPER_CELL, PAPER_ACTUAL, default_plan(PAPER_CELL), Noise(1e-5, 0.3), 3)
    return calibrate_touches(touches, PAPER_CELL, sources=['monday'])


def write(folder: Path, outcome: Any, **changed: Any) -> None:
    """The files of a result, with some of the facts, or `l1`, changed; `l2` has no standard deviation."""
    tree = yaml.safe_load(parameter_text(outcome))
    given = tree['/**']['ros__parameters']
    given['calibrated']['l1'] = changed.pop('l1', given['calibrated']['l1'])
    given['calibrated_std']['l2'] = float('nan')
    given['calibration'] |= changed
    folder.mkdir(parents=True, exist_ok=True)
    (folder / 'calibration.yaml').write_text(yaml.safe_dump(tree))
    (folder / 'calibration.json').write_text(json_text(as_document(outcome)))


@pytest.fixture
def calibrated(client: DemoClient, outcome: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Calibrated:
    """Calibrates; the result in the folder `results` is the canned one with some facts changed."""
    said = tmp_path / 'reply.json'
    monkeypatch.setattr(module, 'COMMAND', (sys.executable, '-c', f'print(open({str(said)!r}).read())'))

    def call(note: str = '', **changed: Any) -> Trigger.Response:
        write(tmp_path / 'results', outcome, **changed)
        said.write_text(json.dumps({'reply': {'folder': str(tmp_path / 'results'), 'note': note}}))
        return client.call('/calibrator/calibrate', Trigger, Trigger.Request(), WAIT)

    return call


def start(spin: Callable[..., Node], tmp_path: Path, *arguments: str) -> Node:
    (tmp_path / 'bag').mkdir()
    return spin(Calibrator, '--ros-args', '-p', f'recording:={tmp_path / "bag"}', *arguments)


def test_an_unfit_result_leaves_the_parameters_unless_told_to_replace_them(
    spin: Callable[..., Node], calibrated: Calibrated, client: DemoClient, outcome: Any, tmp_path: Path
) -> None:
    node = start(spin, tmp_path)
    heard: list[dict[str, Any]] = []
    listen = lambda message: heard.append(json.loads(message.data))  # noqa: E731
    client._node.create_subscription(String, '/calibrator/result', listen, LATCHED)
    answer = calibrated(assessment='unfit', actions=['mend it'])
    assert not answer.success
    assert 'parameters calibrated.* are left as they were' in answer.message
    assert '; mend it; ' in answer.message
    assert not node.has_parameter('calibrated.l1')
    assert node._report().values['present result'] == 'none'

    assert calibrated().success
    former = node.get_parameter('calibrated.l1').value
    assert node._report().values['present result'].startswith('fit, of 20')
    assert node._report().values['present result'].endswith(', from monday')
    worse = {'assessment': 'unfit', 'l1': 1.0}
    assert not calibrated(**worse).success
    assert node.get_parameter('calibrated.l1').value == former
    assert node._condition.level == ERROR

    node.set_parameters([Parameter('publish_unfit', value=True)])
    answer = calibrated(**worse)
    assert not answer.success
    assert node.get_parameter('calibrated.l1').value == 1.0
    client.wait('the results', lambda: len(heard) == 4, WAIT)
    assert [item['published'] for item in heard] == [False, True, False, True]
    assert heard[-1]['message'] == answer.message
    assert heard[-1]['schema'] == RESULT_SCHEMA
    assert heard[-1]['files'] == {'folder': str(tmp_path / 'results')}
    assert heard[-1]['assessment'] == as_document(outcome)['assessment']
    assert heard[-1]['identifiability']['rank'] == 12


def test_a_result_keeps_the_rules_with_which_it_was_begun(
    spin: Callable[..., Node], outcome: Any, tmp_path: Path
) -> None:
    """Its files are written by these rules already."""
    node = start(spin, tmp_path)
    job = node._job()
    node.set_parameters([Parameter('publish_unfit', value=True), Parameter('name', value='next')])
    shown: list[str] = []
    node._result = SimpleNamespace(publish=lambda message: shown.append(message.data))
    write(tmp_path / 'results', outcome, assessment='unfit')
    node._take(tmp_path / 'results', '', job)
    assert not node.has_parameter('calibrated.l1')
    assert json.loads(shown[0])['name'] == ''


@pytest.mark.parametrize(
    ('changes', 'level', 'said'),
    [
        ({}, OK, 'written to '),
        ({'assessment': 'caution'}, WARN, 'caution: '),
        ({'verdict': 'unexplained'}, WARN, 'missing effects: unexplained'),
        ({'warnings': list('abcde')}, WARN, 'warnings: a; b; c; 2 more'),
        ({'note': 'the earlier result is kept'}, OK, 'the earlier result is kept'),
    ],
)
def test_the_level_follows_assessment_verdict_and_warnings(
    spin: Callable[..., Node], calibrated: Calibrated, tmp_path: Path, changes: dict[str, Any], level: bytes, said: str
) -> None:
    node = start(spin, tmp_path)
    answer = calibrated(**changes)
    assert answer.success
    assert said in answer.message
    assert node._condition.level == level
    assert node.has_parameter('calibrated.l1'), 'published all the same'


def test_what_the_numbers_are_made_from_and_worth_is_in_parameters(
    spin: Callable[..., Node], calibrated: Calibrated, outcome: Any, tmp_path: Path
) -> None:
    node = start(spin, tmp_path)
    calibrated()
    assert {name: node.get_parameter(f'calibration.{name}').value for name in FACTS} == facts(outcome)
    assert isnan(node.get_parameter('calibrated_std.l2').value)
    (refused,) = node.set_parameters([Parameter('calibration.assessment', value='fit')])
    assert 'read-only' in refused.reason


@pytest.mark.parametrize(('grade', 'level'), [('fit', OK), ('caution', WARN), ('unfit', ERROR), ('', WARN)])
def test_the_status_says_which_result_was_loaded_from_a_file(
    spin: Callable[..., Node], outcome: Any, tmp_path: Path, grade: str, level: bytes
) -> None:
    tree = yaml.safe_load(parameter_text(outcome))
    given = tree['/**']['ros__parameters']
    given['calibration']['assessment'] = grade
    if not grade:
        del given['calibration']  # a file of an earlier version
    origin = ', of 20' if grade else ', of unknown origin'
    path = tmp_path / 'calibration.yaml'
    path.write_text(yaml.safe_dump(tree))
    status = start(spin, tmp_path, '--params-file', str(path))._report()
    assert status.level == level
    assert 'loaded from a parameter file' in status.message
    assert status.message.startswith(f'{grade or "not assessed"}: ')
    assert status.values['present result'].startswith(f'{grade or "not assessed"}{origin}')


def test_results_are_kept_by_name_and_loaded_again(
    spin: Callable[..., Node], client: DemoClient, outcome: Any, tmp_path: Path
) -> None:
    def load(name: str) -> Trigger.Response:
        node.set_parameters([Parameter('name', value=name)])
        return client.call('/calibrator/load', Trigger, Trigger.Request(), WAIT)

    node = start(spin, tmp_path, '-p', f'output:={tmp_path}')
    write(tmp_path / 'monday', outcome)
    write(tmp_path / 'bad', outcome, assessment='unfit')
    heard: list[dict[str, Any]] = []
    listen = lambda message: heard.append(json.loads(message.data))  # noqa: E731
    client._node.create_subscription(String, '/calibrator/result', listen, LATCHED)
    answer = load('monday')
    assert answer.success, answer.message
    assert answer.message.startswith(f'fit: result loaded from {tmp_path / "monday"}, of 20')
    assert node.get_parameter('calibrated.l1').value == outcome.final.parameters.l1
    assert node._condition.level == OK
    client.wait('the result', lambda: bool(heard), WAIT)
    assert (heard[0]['name'], heard[0]['published']) == ('monday', True)
    assert heard[0]['files'] == {'folder': str(tmp_path / 'monday')}
    for name, message in (('tuesday', "there is no result 'tuesday'"), ('bad', 'unfit for use; publish_unfit:=true')):
        answer = load(name)
        assert not answer.success
        assert message in answer.message
    assert load('tuesday').message.endswith('there are bad, monday')
    node.set_parameters([Parameter('publish_unfit', value=True)])
    assert load('bad').success
    assert node._condition.level == ERROR
    (tmp_path / 'monday' / 'calibration.json').write_text('{"schema": "scara_kinetostatic/calibration/1"}')
    assert 'calibration.json: is damaged' in load('monday').message
    (tmp_path / 'monday' / 'calibration.json').unlink()
    assert 'calibration.json: cannot be read' in load('monday').message


def test_recordings_of_a_collector_that_was_started_anew_go_together(
    spin: Callable[..., Node], client: DemoClient, tmp_path: Path
) -> None:
    bags = [tmp_path / name for name in ('a', 'b', 'c', 'd')]
    for bag in bags:
        bag.mkdir()
    node = spin(Calibrator)

    def announce(*paths: Path) -> None:
        publisher = client._node.create_publisher(String, '/collector/recording', LATCHED)
        for path in paths:
            publisher.publish(String(data=str(path)))
            client.wait(str(path), lambda path=path: node._announced.chosen('last') == [str(path)], WAIT)  # type: ignore[misc]
        client._node.destroy_publisher(publisher)

    announce(bags[0], bags[1])
    assert node._job().recordings == [str(bags[1])]
    announce(bags[2])
    job = node._job()
    assert job.recordings == [str(bags[1]), str(bags[2])]
    assert job.output == f'{bags[2]}_calibration'
    node.set_parameters([Parameter('announced', value='all'), Parameter('name', value='all_of_them')])
    assert node._job().recordings == [str(bag) for bag in bags[:3]]
    assert node._job().output == f'{bags[2]}_calibration/all_of_them'
    node.set_parameters([Parameter('recordings', value=[str(bags[3]), '']), Parameter('recording', value=str(bags[0]))])
    assert node._job().recordings == [str(bags[0]), str(bags[3])]


def test_after_stop_another_session_begins(spin: Callable[..., Node], client: DemoClient, tmp_path: Path) -> None:
    bags = [tmp_path / name for name in ('monday', 'tuesday')]
    for bag in bags:
        bag.mkdir()
    node = spin(Calibrator)

    def say(topic: str, path: Path, heard: Callable[[], bool]) -> None:
        publisher = client._node.create_publisher(String, topic, LATCHED)  # of another process each time
        publisher.publish(String(data=str(path)))
        client.wait(topic, heard, WAIT)
        client._node.destroy_publisher(publisher)

    say('/collector/recording', bags[0], lambda: node._announced.chosen('last') == [str(bags[0])])
    say('/collector/stopped', bags[0], lambda: node._announced._stopped == str(bags[0]))
    say('/collector/recording', bags[1], lambda: node._announced.chosen('last') == [str(bags[1])])
    assert node._job().recordings == [str(bags[1])]


@pytest.mark.parametrize(
    ('argument', 'message'),
    [
        ('announced:=some', 'expected session, last, all'),
        ('name:=../elsewhere', 'expected letters'),
        ('name:=unfit', 'folder of results that are not fit'),
        ("leave_out:=['7-5']", 'expected a range'),
        ('fixed:=[l1=long]', 'parameter fixed'),
        ('calibration.rank:=12.5', 'calibration.rank'),
    ],
)
def test_parameters_that_make_no_sense_are_refused(spin: Callable[..., Node], argument: str, message: str) -> None:
    with pytest.raises((ParameterError, ParameterException), match=message):
        spin(Calibrator, '--ros-args', '-p', argument)


def test_the_status_of_two_cells_do_not_collide(spin: Callable[..., Node], client: DemoClient) -> None:
    node = spin(Calibrator, '--ros-args', '-r', '__ns:=/plant/left')
    heard: list[DiagnosticStatus] = []
    client._node.create_subscription(DiagnosticArray, '/diagnostics', lambda m: heard.extend(m.status), 10)
    client.wait('a status', lambda: bool(heard), WAIT)
    assert node.get_namespace() == '/plant/left'
    assert (heard[0].name, heard[0].hardware_id) == ('/plant/left/calibrator: calibration', 'plant/left')
