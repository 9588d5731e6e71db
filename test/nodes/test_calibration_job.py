"""The calibration that the node `calibrator` orders, without the node."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from nodes.waiting import WAIT

from scara_kinetostatic import pipeline
from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.errors import InputError, RecordingError
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.nodes.calibration_job import Job, do
from scara_kinetostatic.pipeline import REASON, calibrate_files
from scara_kinetostatic.results import report as page
from scara_kinetostatic.results.document import load_result
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams

HALVES = (range(0, 72, 2), range(1, 72, 2))
Make = Callable[..., Job]


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two recordings, with every other touch of the plan each, and one that is no recording."""
    folder = tmp_path_factory.mktemp('bags')
    plan = default_plan(PAPER_CELL)
    for name, half in zip(('first', 'second'), HALVES, strict=True):
        streams = simulate_streams(PAPER_CELL, PAPER_ACTUAL, plan.select(list(half)), seed=3)
        write_streams(folder / name, streams, PAPER_CELL)
    (folder / 'broken').mkdir()
    return [folder / name for name in ('first', 'second', 'broken')]


@pytest.fixture
def job(bags: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Makes a job; the page, which takes most of the time, is left out."""
    monkeypatch.setattr(page, 'html_text', lambda _: 'page')
    usual = Job([str(bags[0])], '', [], [], str(tmp_path / 'out'), False)
    return lambda **changes: usual._replace(**changes)


def calibrated(
    job: Job, progress: Callable[..., None] = lambda *_: None
) -> tuple[Path, dict[str, Any], dict[str, Any]]:
    """The folder of a job, the facts and the document in it."""
    folder = Path(do(job, progress)['folder'])
    document = json.loads((folder / 'calibration.json').read_text())
    return folder, load_result(folder / 'calibration.yaml').facts, document


def test_recordings_are_calibrated_together_and_touches_left_out(job, bags):
    several = job(recordings=[str(bag) for bag in (bags[2], *bags[:2])])
    with pytest.raises(RecordingError, match='broken'):
        do(several, lambda *_: None)
    heard: list[tuple[str, float]] = []
    _, facts, document = calibrated(several._replace(left_out=['broken']), lambda *news: heard.append(news))
    assert heard[0] == (f'reading {bags[0]}', 0.0) and heard[-1] == ('writing the results', 0.8)
    assert [part for _, part in heard] == sorted(part for _, part in heard), 'it goes on'
    assert (facts['assessment'], facts['verdict'], facts['warnings']) == ('fit', 'none', [])
    assert (facts['touches.used'], facts['recordings']) == (72, [str(bags[0]), str(bags[1])])
    _, _, document = calibrated(job(left_out=['3', '4-5']))
    assert document['touches']['rejected'] == [{'index': k, 'reason': REASON} for k in (3, 4, 5)]
    with pytest.raises(InputError, match="'third' is none of the recordings"):
        do(job(left_out=['third']), lambda *_: None)


def test_another_cell_description_is_a_warning_and_an_unfit_result_does_not_replace_files(
    job, bags, tmp_path, monkeypatch
):
    (tmp_path / 'cell.yaml').write_text(dump_cell(replace(PAPER_CELL, noise=None, tolerance=1e-6)))
    strict = job(cell=str(tmp_path / 'cell.yaml'))
    made: list[Outcome] = []

    def once(*arguments: Any, **options: Any) -> Outcome:
        made.extend([] if made else [calibrate_files(*arguments, **options)])
        return made[0]

    with monkeypatch.context() as patch:
        patch.setattr(pipeline, 'calibrate_files', once)
        folder, facts, document = calibrated(strict)
        assert folder == tmp_path / 'out' / 'unfit'
        assert [path.name for path in (tmp_path / 'out').iterdir()] == ['unfit']
        assert calibrated(strict._replace(publish_unfit=True))[0] == tmp_path / 'out'
    warning = f'{bags[0]} contains another cell description (noise, tolerance); that of the parameter cell is used'
    assert facts['warnings'] == document['warnings'] == [warning]
    assert facts['assessment'] == 'unfit'
    write_streams(tmp_path / 'third', read_streams(bags[1], PAPER_CELL), replace(PAPER_CELL, noise=None))
    with pytest.raises(RecordingError, match='third: contains another cell description than'):
        do(job(recordings=[str(bags[0]), str(tmp_path / 'third')]), lambda *_: None)


def command(order: Job) -> list[str]:
    code = 'from scara_kinetostatic.nodes.calibration_job import main; main()'
    return [sys.executable, '-c', code, json.dumps(order._asdict())]


def test_the_process_speaks_json_only(job, bags):
    order = command(job(recordings=[str(bags[2])]))
    ended = subprocess.run(order, capture_output=True, text=True, timeout=WAIT)
    said = json.loads(ended.stdout)
    assert list(said) == ['error']
    assert 'broken' in said['error']
    assert ended.stderr == ''


def test_the_process_ends_with_the_node(job, tmp_path):
    process = subprocess.Popen(command(job()), text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    assert process.stderr.read() == ''
    assert process.wait(WAIT) == 1
    process.stderr.close()
    assert not (tmp_path / 'out').exists()
