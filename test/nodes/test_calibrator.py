from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from nodes.waiting import Bench
from std_msgs.msg import String
from std_srvs.srv import Trigger

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.nodes import calibration_job as module
from scara_kinetostatic.nodes.calibrator import Calibrator
from scara_kinetostatic.nodes.cell_node import ERROR
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams

PROGRESS = {'message': 'fitting 72 touches', 'part': 0.3}
GROWN = 5e-5
"""By which the radius of the second disc is larger than the cell says, m."""


@pytest.fixture(scope='module')
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / 'touches'
    streams = simulate_streams(PAPER_CELL, PAPER_ACTUAL, default_plan(PAPER_CELL), seed=3)
    write_streams(path, streams, PAPER_CELL)
    return path


@pytest.fixture(scope='module')
def grown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with a disc that is larger than its cell description says."""
    first, second, *rest = PAPER_CELL.discs
    true = replace(PAPER_CELL, discs=(first, second._replace(radius=second.radius + GROWN), *rest))
    path = tmp_path_factory.mktemp('bags') / 'grown'
    write_streams(path, simulate_streams(true, PAPER_ACTUAL, default_plan(PAPER_CELL), seed=3), PAPER_CELL)
    return path


class Calling(Bench):
    """With calls of the services, and the progress that is heard."""

    def __init__(self, node: Calibrator) -> None:
        super().__init__(node)
        self.heard: list[dict[str, Any]] = []
        self.on(String, '/calibrator/progress', lambda message: self.heard.append(json.loads(message.data)))

    def calibrate(self) -> Trigger.Response:
        return self.call('/calibrator/calibrate')

    def begin(self) -> Any:
        """Calls for a calibration, and waits until it runs; returns the answer to come."""
        caller = self.robot.create_client(Trigger, '/calibrator/calibrate')
        self.wait(caller.service_is_ready)
        answer = caller.call_async(Trigger.Request())
        self.wait(lambda: self.node._process is not None)
        return answer

    def values(self, group: str) -> list[float]:
        return [self.node.get_parameter(f'{group}.{name}').value for name in NAMES]


@pytest.fixture
def calling(bench: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Calling]:
    """With `code`, that is what the process of a calibration does."""

    def make(*arguments: str, code: str = '', **given: object) -> Calling:
        if code:
            monkeypatch.setattr(module, 'COMMAND', (sys.executable, '-c', code))
        made: Calling = bench(Calibrator, *arguments, on=Calling, **given)
        return made

    return make


def files_in(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_calibration_becomes_parameters_and_files_and_a_failure_leaves_them(calling, grown, grown_outcome, tmp_path):
    b = calling(output=tmp_path)
    answer = b.calibrate()
    assert not answer.success and 'no recording is named' in answer.message
    assert not b.node.has_parameter('calibrated.l1')

    assert b.set('recording', str(grown)) == ''
    answer = b.calibrate()
    assert answer.success, answer.message
    assert len(answer.message.splitlines()) == 1
    label = f'object_radius[{PAPER_CELL.discs[1].name}]'
    for part in ('72 of 72 touches used', f'missing effects: explained, {label};', str(tmp_path)):
        assert part in answer.message
    figures = b.node._condition.values
    assert figures['effects'] == label
    assert float(figures['held_out_force_error.extended']) < 0.1 * float(figures['force_error.nominal'])
    final = grown_outcome.final
    expected = pytest.approx(list(final.parameters.as_dict().values()), rel=1e-9)  # the job has fewer threads
    assert b.values('calibrated') == expected
    assert b.values('calibrated_std') == pytest.approx(list(final.std), rel=1e-9)
    stored = yaml.safe_load((tmp_path / 'calibration.yaml').read_text())['/**']['ros__parameters']
    assert list(stored['calibrated'].values()) == b.values('calibrated')
    assert (tmp_path / 'report.html').is_file()
    for guarded in ('calibrated.l1', 'calibrated_std.l1'):
        assert 'read-only' in b.set(guarded, 1.0)

    files = files_in(tmp_path)
    assert b.set('recording', '/no/such/bag') == ''
    answer = b.calibrate()
    assert not answer.success and '/no/such/bag' in answer.message
    assert b.node._condition.level == ERROR
    assert (b.values('calibrated'), files_in(tmp_path)) == (expected, files)


@pytest.fixture(scope='module')
def grown_outcome(grown: Path) -> Outcome:
    return calibrate_recordings([grown], PAPER_CELL)


@pytest.mark.parametrize(
    ('code', 'message'),
    [
        ('raise ZeroDivisionError("by zero")', 'ended with status 1 and without a reply'),
        ('import os; os.kill(os.getpid(), 9)', 'has the memory run out?'),
        ('print(\'{"error": "internal error: ZeroDivisionError: by zero"}\')', 'ZeroDivisionError: by zero'),
    ],
)
def test_a_surprise_in_a_calibration_does_not_end_the_node(calling, recording, code, message):
    b = calling(code=code, recording=recording)
    for _ in range(2):
        answer = b.calibrate()
        assert not answer.success
        assert message in answer.message
        assert b.node._condition.level == ERROR
    b.wait(lambda: [item['state'] for item in b.heard] == 2 * ['running', 'failed'])
    assert b.heard[-1] == {'state': 'failed', 'message': answer.message, 'part': 0.0}, 'the work is not done'


def test_a_second_call_is_refused_while_one_runs_and_a_running_one_can_be_cancelled(calling, recording):
    slow = f'import time; print({json.dumps({"progress": PROGRESS})!r}, flush=True); time.sleep(3600)'
    b = calling(code=slow, recording=recording)
    assert b.call('/calibrator/cancel').message == 'no calibration is running'
    for _ in range(2):
        later = b.begin()
        assert b.node._condition.message == f'calibrating from {recording}'
        b.wait(lambda: b.heard[-1:] == [{'state': 'running', **PROGRESS}])
        second = b.calibrate()
        assert not second.success
        assert 'running already' in second.message
        assert b.set('output', 'elsewhere') == '', 'the node answers while it calibrates'
        answer = b.call('/calibrator/cancel')
        assert answer.success, answer.message
        b.wait(later.done)
        assert not later.result().success
        assert later.result().message == answer.message == 'cancelled; earlier results are unchanged'
        assert b.node._condition.message == 'no calibration yet'
        b.wait(lambda: b.heard[-1] == {'state': 'cancelled', 'message': answer.message, 'part': 0.3})  # noqa: B023
    b.begin()
    process = b.node._process._process
    b.node.close()
    assert process.poll() is not None, 'a calibration ends with the node'


def test_a_calibration_that_does_not_end_is_killed(calling, recording, monkeypatch, tmp_path):
    deaf = tmp_path / 'deaf'
    code = f'signal.signal(signal.SIGTERM, signal.SIG_IGN); open({str(deaf)!r}, "w"); time.sleep(999)'
    monkeypatch.setattr(module, 'PATIENCE', 0.2)
    b = calling(code=f'import signal, time; {code}', recording=recording)
    answer = b.begin()
    b.wait(deaf.exists)
    assert b.call('/calibrator/cancel').success
    b.wait(answer.done)
    assert 'cancelled' in answer.result().message


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('cell', '{wrong}', 'radius'),
        ('leave_out', ['7-5'], 'parameter leave_out: 7-5: expected a range'),
        ('fixed', ['l1=long'], 'parameter fixed:'),
    ],
)
def test_what_makes_no_sense_is_said_when_it_is_used(calling, recording, tmp_path, cell_file, name, value, message):
    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text(cell_file.read_text().replace('radius: 0.15', 'radius: -0.15'))
    b = calling(recording=recording)
    assert b.set(name, str(wrong) if name == 'cell' else value) == ''
    answer = b.calibrate()
    assert not answer.success and message in answer.message
