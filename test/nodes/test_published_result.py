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
from nodes.waiting import Bench
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.files.calibration_file import RESULT_SCHEMA
from scara_kinetostatic.model.cell import PAPER_CELL, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.nodes import calibration_job as module
from scara_kinetostatic.nodes.calibrator import Calibrator
from scara_kinetostatic.nodes.cell_node import ERROR, OK, WARN
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report.page import json_text
from scara_kinetostatic.results.document import as_document, facts, parameter_text
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches


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


class Calling(Bench):
    """With the results that are published; a calibration gives the canned one in the folder `results`."""

    folder: Path
    outcome: Any

    def __init__(self, node: Calibrator) -> None:
        super().__init__(node)
        self.results: list[dict[str, Any]] = []
        self.on(String, '/calibrator/result', lambda message: self.results.append(json.loads(message.data)))

    def calibrate(self, note: str = '', **changed: Any) -> Trigger.Response:
        """With some of the facts changed."""
        write(self.folder / 'results', self.outcome, **changed)
        reply = {'folder': str(self.folder / 'results'), 'note': note}
        (self.folder / 'reply.json').write_text(json.dumps({'reply': reply}))
        return self.call('/calibrator/calibrate')


@pytest.fixture
def calling(
    bench: Callable[..., Any], outcome: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Calling]:
    def make(*arguments: str, **given: object) -> Calling:
        code = f'print(open({str(tmp_path / "reply.json")!r}).read())'
        monkeypatch.setattr(module, 'COMMAND', (sys.executable, '-c', code))
        (tmp_path / 'bag').mkdir()
        made: Calling = bench(Calibrator, *arguments, on=Calling, recording=tmp_path / 'bag', **given)
        made.folder, made.outcome = tmp_path, outcome
        return made

    return make


def test_an_unfit_result_leaves_the_parameters_unless_told_to_replace_them(calling, outcome, tmp_path):
    b = calling()
    node, heard = b.node, b.results
    answer = b.calibrate(assessment='unfit', actions=['mend it'])
    assert not answer.success
    assert 'parameters calibrated.* are left as they were' in answer.message
    assert '; mend it; ' in answer.message
    assert not node.has_parameter('calibrated.l1')
    assert node._report().values['present result'] == 'none'

    assert b.calibrate().success
    former = node.get_parameter('calibrated.l1').value
    assert node._report().values['present result'].startswith('fit, of 20')
    assert node._report().values['present result'].endswith(', from monday')
    worse = {'assessment': 'unfit', 'l1': 1.0}
    assert not b.calibrate(**worse).success
    assert node.get_parameter('calibrated.l1').value == former
    assert node._condition.level == ERROR

    node.set_parameters([Parameter('publish_unfit', value=True)])
    answer = b.calibrate(**worse)
    assert not answer.success
    assert node.get_parameter('calibrated.l1').value == 1.0
    b.wait(lambda: len(heard) == 4)
    assert [item['published'] for item in heard] == [False, True, False, True]
    assert heard[-1]['message'] == answer.message
    assert heard[-1]['schema'] == RESULT_SCHEMA
    assert heard[-1]['files'] == {'folder': str(tmp_path / 'results')}
    assert heard[-1]['assessment'] == as_document(outcome)['assessment']
    assert heard[-1]['identifiability']['rank'] == 12


def test_a_result_keeps_the_rules_with_which_it_was_begun(calling, outcome, tmp_path):
    """Its files are written by these rules already."""
    node = calling().node
    job = node._job()
    node.set_parameters([Parameter('publish_unfit', value=True)])
    shown: list[str] = []
    node._result = SimpleNamespace(publish=lambda message: shown.append(message.data))
    write(tmp_path / 'results', outcome, assessment='unfit')
    node._take(tmp_path / 'results', '', job)
    assert not node.has_parameter('calibrated.l1')
    assert json.loads(shown[0])['published'] is False


def test_the_level_follows_assessment_verdict_and_warnings(calling, outcome):
    b = calling()
    for changes, level, said in (
        ({}, OK, 'written to '),
        ({'assessment': 'caution'}, WARN, 'caution: '),
        ({'verdict': 'unexplained'}, WARN, 'missing effects: unexplained'),
        ({'warnings': list('abcde')}, WARN, 'warnings: a; b; c; 2 more'),
        ({'note': 'the earlier result is kept', 'l1': 0.5}, OK, 'the earlier result is kept'),
    ):
        answer = b.calibrate(**changes)
        assert answer.success
        assert said in answer.message
        assert b.node._condition.level == level
    assert b.node.get_parameter('calibrated.l1').value == 0.5
    assert b.node._facts == facts(outcome)
    assert isnan(b.node.get_parameter('calibrated_std.l2').value)
    (refused,) = b.node.set_parameters([Parameter('calibrated.l1', value=1.0)])
    assert 'read-only' in refused.reason


@pytest.mark.parametrize(('grade', 'level'), [('fit', OK), ('unfit', ERROR), ('', WARN)])
def test_the_status_says_which_result_was_loaded_from_a_file(calling, outcome, tmp_path, grade, level):
    tree = yaml.safe_load(parameter_text(outcome))
    given = tree['/**']['ros__parameters']
    given['calibration']['assessment'] = grade
    if not grade:
        del given['calibration']  # a file of an earlier version
    origin = ', of 20' if grade else ', of unknown origin'
    path = tmp_path / 'calibration.yaml'
    path.write_text(yaml.safe_dump(tree))
    status = calling('--params-file', str(path)).node._report()
    assert status.level == level
    assert 'loaded from a parameter file' in status.message
    assert status.message.startswith(f'{grade or "not assessed"}, of ')
    assert status.values['present result'].startswith(f'{grade or "not assessed"}{origin}')


def test_the_recordings_are_those_named_or_the_last_that_was_announced(bench, tmp_path):
    bags = [tmp_path / name for name in ('a', 'b')]
    for bag in bags:
        bag.mkdir()
    b = bench(Calibrator)
    publisher = b.robot.create_publisher(String, '/collector/recording', LATCHED)
    for bag in bags:
        publisher.publish(String(data=str(bag)))
        b.wait(lambda bag=bag: b.node._announced == str(bag))
    job = b.node._job()
    assert job.recordings == [str(bags[1])]
    assert job.output == f'{bags[1]}_calibration'
    named = [Parameter('recordings', value=[str(bags[1]), '']), Parameter('recording', value=str(bags[0]))]
    b.node.set_parameters(named)
    assert b.node._job().recordings == [str(bags[0]), str(bags[1])]


def test_the_status_of_two_cells_do_not_collide(bench):
    b = bench(Calibrator, '-r', '__ns:=/plant/left')
    b.wait(lambda: b.statuses)
    assert b.node.get_namespace() == '/plant/left'
    assert (b.statuses[0].name, b.statuses[0].hardware_id) == ('/plant/left/calibrator: calibration', 'plant/left')
