"""The calibration that the node `calibrator` orders, without the node."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from nodes.waiting import WAIT

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.bags.writer import write_streams
from scara_kinetostatic.errors import CellError, InputError, OutputError, RecordingError
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import PAPER_CELL, Cell
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.nodes.calibration_job import Job, do
from scara_kinetostatic.results import report as page
from scara_kinetostatic.results.parameter_file import load_result
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.left_out import REASON

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


class Result(NamedTuple):
    """The files of a job."""

    folder: Path
    facts: dict[str, Any]
    document: dict[str, Any]


def calibrated(job: Job) -> Result:
    folder = Path(do(job, lambda: None)['folder'])
    document = json.loads((folder / 'calibration.json').read_text())
    return Result(folder, load_result(folder / 'calibration.yaml').facts, document)


def cell_file(folder: Path, cell: Cell) -> str:
    path = folder / 'cell.yaml'
    path.write_text(dump_cell(cell))
    return str(path)


def test_two_recordings_are_calibrated_together(job, bags):
    facts = calibrated(job(recordings=[str(bags[0]), str(bags[1])])).facts
    assert (facts['assessment'], facts['verdict'], facts['warnings']) == ('fit', 'none', [])
    assert facts['touches.used'] == 72
    assert facts['recordings'] == [str(bags[0]), str(bags[1])]


def test_recordings_and_touches_can_be_left_out(job, bags):
    several = job(recordings=[str(bags[2]), str(bags[0])])
    with pytest.raises(RecordingError, match='broken'):
        calibrated(several)
    kept = calibrated(several._replace(left_out=['broken', 'first:3', 'first:4-5']))
    assert kept.facts['recordings'] == [str(bags[0])]
    assert kept.document['touches']['rejected'] == [{'index': k, 'reason': REASON} for k in (3, 4, 5)]
    with pytest.raises(InputError, match="'third' is none of the recordings"):
        calibrated(job(left_out=['third']))


def test_another_cell_description_is_a_warning_and_an_unfit_result_does_not_replace_files(job, bags, tmp_path):
    strict = job(cell=cell_file(tmp_path, replace(PAPER_CELL, noise=None, tolerance=1e-6)))
    result = calibrated(strict)
    warning = f'{bags[0]} contains another cell description (noise, tolerance); that of the parameter cell is used'
    assert result.facts['warnings'] == result.document['warnings'] == [warning]
    assert result.facts['assessment'] == 'unfit'
    assert result.folder == tmp_path / 'out' / 'unfit'
    assert [path.name for path in (tmp_path / 'out').iterdir()] == ['unfit']
    assert calibrated(strict._replace(publish_unfit=True)).folder == tmp_path / 'out'
    write_streams(tmp_path / 'third', read_streams(bags[1], PAPER_CELL), replace(PAPER_CELL, noise=None))
    with pytest.raises(RecordingError, match='third: contains another cell description than'):
        calibrated(job(recordings=[str(bags[0]), str(tmp_path / 'third')]))


def test_what_contradicts_the_cell_or_cannot_be_written_is_named(job, bags, tmp_path):
    sensor = PAPER_CELL.sensor._replace(
        sign=next(s for s in type(PAPER_CELL.sensor.sign) if s != PAPER_CELL.sensor.sign)
    )
    path = cell_file(tmp_path, replace(PAPER_CELL, sensor=sensor))
    with pytest.raises(CellError, match=path):
        calibrated(job(cell=path))
    (tmp_path / 'out').write_text('a file')
    with pytest.raises(OutputError, match=str(tmp_path / 'out')):
        calibrated(job())


CODE = 'from scara_kinetostatic.nodes.calibration_job import main; main()'


def test_the_process_speaks_json_only(bags, tmp_path):
    order = Job([str(bags[2])], '', [], [], str(tmp_path), False)
    command = [sys.executable, '-c', CODE, json.dumps(order._asdict())]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=WAIT)
    said = json.loads(ended.stdout)
    assert list(said) == ['error']
    assert 'broken' in said['error']
    assert ended.stderr == ''


def test_the_process_ends_with_the_node(bags, tmp_path):
    order = Job([str(bags[0])], '', [], [], str(tmp_path / 'out'), False)
    command = [sys.executable, '-c', CODE, json.dumps(order._asdict())]
    process = subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    assert process.stderr.read() == ''
    assert process.wait(WAIT) == 1
    process.stderr.close()
    assert not (tmp_path / 'out').exists()
