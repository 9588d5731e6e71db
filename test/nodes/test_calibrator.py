from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from nodes.waiting import WAIT
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String
from std_srvs.srv import Trigger

from benchmark.cell_nodes import DemoClient, NodeProcesses
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.nodes import calibration_job as module
from scara_kinetostatic.nodes.calibrator import Calibrator
from scara_kinetostatic.nodes.cell_node import ERROR
from scara_kinetostatic.nodes.streams import LATCHED
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.results.write import write_results
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams

PROGRESS = {'state': 'running', 'message': 'fitting 72 touches', 'part': 0.3}
STARTED = '{"progress": {"step": "deaf", "part": 0.1}}'
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


def calibrate(client: DemoClient) -> Trigger.Response:
    return client.call('/calibrator/calibrate', Trigger, Trigger.Request(), WAIT)


def listen(client: DemoClient, topic: str) -> list[dict[str, Any]]:
    """What comes on a topic with JSON, latched, in the order of time."""
    heard: list[dict[str, Any]] = []
    client._node.create_subscription(String, topic, lambda message: heard.append(json.loads(message.data)), LATCHED)
    return heard


def set_parameter(client: DemoClient, name: str, value: object) -> str:
    """Sets a parameter from outside.

    Returns:
        Why it was refused; empty if it was not.
    """
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    (result,) = client.call('/calibrator/set_parameters', SetParameters, request, WAIT).results
    return '' if result.successful else result.reason


def values(node: Node, group: str) -> list[float]:
    return [node.get_parameter(f'{group}.{name}').value for name in NAMES]


def effects(node: Node) -> dict[str, float]:
    """The parameters of effects that the node has, by name."""
    groups = ('effects', 'effects_std')
    return {f'{group}.{name}': p.value for group in groups for name, p in node.get_parameters_by_prefix(group).items()}


def test_a_calibration_becomes_parameters_and_files_and_a_failure_leaves_them(
    spin: Callable[..., Node], client: DemoClient, grown: Path, grown_outcome: Outcome, tmp_path: Path
) -> None:
    node = spin(Calibrator, '--ros-args', '-p', f'output:={tmp_path}')
    answer = calibrate(client)
    assert not answer.success and 'no recording is named' in answer.message
    assert not node.has_parameter('calibrated.l1') and effects(node) == {}

    assert set_parameter(client, 'recording', str(grown)) == ''
    answer = calibrate(client)
    assert answer.success, answer.message
    assert len(answer.message.splitlines()) == 1
    label = f'object_radius[{PAPER_CELL.discs[1].name}]'
    for part in ('72 of 72 touches used', f'missing effects: explained, {label}; with them', str(tmp_path)):
        assert part in answer.message
    figures = node._condition.values
    assert figures['effects'] == label
    held_out = 'held_out_force_error'
    assert float(figures[f'{held_out}.extended']) < 0.5 * float(figures[f'{held_out}.calibrated'])
    name = f'object_radius.{PAPER_CELL.discs[1].name}.radius'
    found = effects(node)
    assert list(found) == [f'effects.{name}', f'effects_std.{name}']
    assert abs(found[f'effects.{name}'] - GROWN) < 4 * found[f'effects_std.{name}']
    final = grown_outcome.final
    assert values(node, 'calibrated') == pytest.approx(list(final.parameters.as_dict().values()), rel=1e-9)
    assert values(node, 'calibrated_std') == pytest.approx(list(final.std), rel=1e-9)  # the job has fewer threads
    stored = yaml.safe_load((tmp_path / 'calibration.yaml').read_text())['/**']['ros__parameters']
    assert list(stored['calibrated'].values()) == values(node, 'calibrated')
    assert (tmp_path / 'report.html').is_file()
    for guarded in ('calibrated.l1', 'calibrated_std.l1', f'effects.{name}'):
        assert 'read-only' in set_parameter(client, guarded, 1.0)

    files = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    assert set_parameter(client, 'recording', '/no/such/bag') == ''
    answer = calibrate(client)
    assert not answer.success and '/no/such/bag' in answer.message
    assert node._condition.level == ERROR
    assert values(node, 'calibrated') == pytest.approx(list(final.parameters.as_dict().values()), rel=1e-9)
    assert effects(node) == found
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == files


@pytest.fixture(scope='module')
def grown_outcome(grown: Path) -> Outcome:
    return calibrate_recordings([grown], PAPER_CELL)


def test_results_can_be_loaded_again_and_effects_come_and_go_with_them(
    spin: Callable[..., Node], client: DemoClient, recording: Path, grown_outcome: Outcome, tmp_path: Path
) -> None:
    first = write_results(grown_outcome, tmp_path / 'grown', report=False)
    plain = calibrate_recordings([recording], PAPER_CELL, fixed={'g_ee': 1e-4})
    write_results(plain, tmp_path / 'plain', report=False)
    node = spin(Calibrator, '--ros-args', '--params-file', str(first.parameters), '-p', f'output:={tmp_path}')
    ((value,),) = ([v.value for v in item.values] for item in grown_outcome.diagnosis.found)
    name, deviation = effects(node)
    assert effects(node)[name] == value
    assert 'read-only' in set_parameter(client, deviation, 1.0)
    for loaded in ('plain', 'grown', 'plain'):
        assert set_parameter(client, 'name', loaded) == ''
        answer = client.call('/calibrator/load', Trigger, Trigger.Request(), WAIT)
        assert answer.success, answer.message
        assert list(effects(node)) == ([name, deviation] if loaded == 'grown' else [])
    np.testing.assert_array_equal(values(node, 'calibrated'), plain.final.parameters.as_array())
    np.testing.assert_array_equal(values(node, 'calibrated_std'), plain.final.std)
    assert 'read-only' in set_parameter(client, 'calibrated.g_ee', 1.0)


def test_a_calibrator_that_is_started_again_takes_its_result(
    spin: Callable[..., Node], grown_outcome: Outcome, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_results(grown_outcome, recording.with_name('touches_calibration'), report=False)
    monkeypatch.chdir(recording.parent)
    node = spin(Calibrator, '--ros-args', '-p', 'restore:=true', '-p', 'recording:=touches')
    np.testing.assert_array_equal(values(node, 'calibrated'), grown_outcome.final.parameters.as_array())
    assert 'result loaded from' in node._report().message
    assert node._job().recordings == [str(recording)]


@pytest.mark.parametrize(
    ('code', 'message'),
    [
        ('raise ZeroDivisionError("by zero")', 'ended with status 1 and without a reply'),
        ('import os; os.kill(os.getpid(), 9)', 'has the memory run out?'),
        ('print(\'{"error": "internal error: ZeroDivisionError: by zero"}\')', 'ZeroDivisionError: by zero'),
    ],
)
def test_a_surprise_in_a_calibration_does_not_end_the_node(
    spin: Callable[..., Node],
    client: DemoClient,
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    code: str,
    message: str,
) -> None:
    monkeypatch.setattr(module, 'COMMAND', (sys.executable, '-c', code))
    node = spin(Calibrator, '--ros-args', '-p', f'recording:={recording}')
    heard = listen(client, '/calibrator/progress')
    for number in range(2):
        answer = calibrate(client)
        assert not answer.success
        assert message in answer.message
        assert node._condition.level == ERROR
        client.wait('the end', lambda number=number: sum(item['state'] == 'failed' for item in heard) > number, WAIT)
        assert heard[-1]['part'] < 1.0, 'the work is not done'


def test_a_second_call_is_refused_while_one_runs_and_a_running_one_can_be_cancelled(
    spin: Callable[..., Node], client: DemoClient, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    step = '{"progress": {"step": "fitting 72 touches", "part": 0.3}}'
    slow = f'import time; print({step!r}, flush=True); time.sleep(3600)'
    monkeypatch.setattr(module, 'COMMAND', (sys.executable, '-c', slow))
    node = spin(Calibrator, '--ros-args', '-p', f'recording:={recording}')
    assert client.call('/calibrator/cancel', Trigger, Trigger.Request(), WAIT).message == 'no calibration is running'
    heard = listen(client, '/calibrator/progress')
    for _ in range(2):
        calibrate_later = client._meet('/calibrator/calibrate', Trigger).call_async(Trigger.Request())
        client.wait('progress', lambda: heard[-1:] == [PROGRESS], WAIT)
        assert node._condition.message == 'calibrating: fitting 72 touches'
        assert node._condition.values == {'progress': '30 %'}
        second = calibrate(client)
        assert not second.success
        assert 'running already' in second.message
        assert 'is running' in client.call('/calibrator/load', Trigger, Trigger.Request(), WAIT).message
        assert set_parameter(client, 'output', 'elsewhere') == '', 'the node answers while it calibrates'
        answer = client.call('/calibrator/cancel', Trigger, Trigger.Request(), WAIT)
        assert answer.success, answer.message
        client.wait('the end', calibrate_later.done, WAIT)
        assert not calibrate_later.result().success
        assert calibrate_later.result().message == answer.message == 'cancelled; earlier results are unchanged'
        assert node._condition.message == 'no calibration yet'
        client.wait('progress', lambda: heard[-1]['state'] == 'cancelled', WAIT)
        assert heard[-1]['part'] == PROGRESS['part']


def test_a_calibration_that_does_not_end_is_killed(
    spin: Callable[..., Node], client: DemoClient, recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deaf = (
        'import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print("{}", flush=True); time.sleep(999)'
    )
    monkeypatch.setattr(module, 'COMMAND', (sys.executable, '-c', deaf.replace('"{}"', f"'{STARTED}'")))
    monkeypatch.setattr(module, 'PATIENCE', 0.2)
    spin(Calibrator, '--ros-args', '-p', f'recording:={recording}')
    heard = listen(client, '/calibrator/progress')
    answer = client._meet('/calibrator/calibrate', Trigger).call_async(Trigger.Request())
    client.wait('progress', lambda: bool(heard) and heard[-1]['message'] == 'deaf', WAIT)
    assert client.call('/calibrator/cancel', Trigger, Trigger.Request(), WAIT).success
    client.wait('the end', answer.done, WAIT)
    assert 'cancelled' in answer.result().message


def test_a_wrong_cell_is_refused_by_name(
    spin: Callable[..., Node], client: DemoClient, tmp_path: Path, cell_file: Path
) -> None:
    spin(Calibrator)
    wrong = tmp_path / 'wrong.yaml'
    wrong.write_text(cell_file.read_text().replace('radius: 0.15', 'radius: -0.15'))
    assert 'radius' in set_parameter(client, 'cell', str(wrong))
    assert 'Wrong parameter type' in set_parameter(client, 'cell', 3)
    assert set_parameter(client, 'cell', str(cell_file)) == ''


def test_a_calibration_gives_up_when_the_node_ends(
    processes: NodeProcesses, client: DemoClient, recording: Path, tmp_path: Path
) -> None:
    processes.start('calibrator', {'recording': recording, 'output': tmp_path / 'results'})
    call = client._node.create_client(Trigger, '/calibrator/calibrate')
    client.wait('the service', call.service_is_ready, WAIT)
    heard = listen(client, '/calibrator/progress')
    call.call_async(Trigger.Request())
    client.wait('its begin', lambda: bool(heard), WAIT)
    assert processes.stop() == {'calibrator': 0}
    assert 'Traceback' not in processes.log('calibrator').read_text()
