"""An archive of recordings on a Dask cluster."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import dask
import pytest
from cli.command import Run
from cli.conftest import run

from benchmark.common import CELL, dump_touch_table
from scara_kinetostatic import simulate
from scara_kinetostatic.cli.main import main
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.files.tables import TouchTable
from scara_kinetostatic.model.cell import Identification
from scara_kinetostatic.monitoring import archive
from scara_kinetostatic.monitoring.archive import Task, _answers, recalibrate, tasks_of

assert run  # a fixture


@pytest.fixture(scope='module')
def client() -> Iterator[Any]:
    """Of the cluster that the command makes for itself; a job may end one worker alone."""
    with dask.config.set({'distributed.scheduler.allowed-failures': 0}), archive._client('') as made:
        yield made


@pytest.fixture(scope='module')
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`cell.yaml`, `named.yaml`, and tables of two robots, each in a folder of its own."""
    place = tmp_path_factory.mktemp('archive')
    (place / 'cell.yaml').write_text(dump_cell(CELL), encoding='utf-8')
    (place / 'named.yaml').write_text(dump_cell(replace(CELL, identification=Identification('R7', '11'))))
    for seed, name in enumerate(('left/monday', 'left/tuesday', 'right/monday')):
        touches = simulate(CELL, {'l1': 0.3302 + 1e-4 * (name == 'left/tuesday')}, per_disc=6, seed=seed)
        table = TouchTable(touches.joints, touches.force, ('',) * len(touches), touches.time, touches.approach, (), '')
        (place / name).parent.mkdir(exist_ok=True)
        (place / f'{name}.csv').write_text(dump_touch_table(table), encoding='utf-8')
    (place / 'right/broken.mcap').write_bytes(b'broken')
    return place


def rows(path: Path) -> dict[str, dict[str, str]]:
    """Of `archive.csv`, by the last two names of the recordings."""
    with path.open(encoding='utf-8', newline='') as stream:
        return {'/'.join(Path(row['recording']).parts[-2:]): row for row in csv.DictReader(stream)}


def test_an_archive(run: Run, client: Any, folder: Path, tmp_path: Path) -> None:
    tables = sorted(folder.glob('*/*'))
    common = ('--cell', folder / 'cell.yaml', '--out', 'a', '--no-report', '--dask', client.scheduler.address)
    assert run('recalibrate', folder / 'left/tuesday.csv', *common).status == 0
    before = (tmp_path / 'a/tuesday/calibration.json').stat()
    done = run('recalibrate', *tables, *common)
    assert done.status == 3 and done.err.count('\n') == 1 and '1 of 4 recordings' in done.err
    assert 'tuesday.csv: fit, as before' in done.out and 'left/monday.csv: fit\n' in done.out
    assert '3 of 4 recordings calibrated; changed: left' in done.out
    assert (tmp_path / 'a/tuesday/calibration.json').stat() == before
    found = rows(tmp_path / 'a/archive.csv')
    assert [*found] == ['/'.join(path.parts[-2:]) for path in tables]
    assert [row['robot'] for row in found.values()] == ['left', 'left', 'right', 'right']
    assert [row['grade'] for row in found.values()] == ['fit', 'fit', '', 'fit']
    assert [Path(row['folder']).relative_to(tmp_path / 'a') for row in found.values()] == [
        Path(name) for name in ('left/monday.csv', 'tuesday', 'broken', 'right/monday.csv')
    ]
    assert 'not a recording' in found['right/broken.mcap']['reason']
    for name, row in found.items():
        if not row['reason']:
            actual = 0.3303 if 'tuesday' in name else 0.3302
            assert abs(float(row['l1']) - actual) < 4 * float(row['l1_std']) < 1e-4
    page = (tmp_path / 'a/archive.html').read_text(encoding='utf-8')
    assert page.count('<svg') == 2 and 'link 1 changed its length' in page and 'not a recording' in page


def test_what_is_done_is_told_by_its_content(folder: Path, tmp_path: Path) -> None:
    cell, recording = folder / 'cell.yaml', folder / 'left/monday.csv'
    (task,) = tasks_of([recording], cell, tmp_path, report=False)
    assert [recalibrate(task)[1] for _ in range(2)] == [False, True]
    row, is_there = recalibrate(task._replace(cell=str(folder / 'named.yaml')))
    assert not is_there and row['robot'] == 'R7 11', 'another cell description'
    assert not recalibrate(task._replace(recording=str(folder / 'right/monday.csv')))[1], 'another recording'
    row, _ = recalibrate(task._replace(version='9.9'))
    assert row['reason'].startswith('the worker: has version') and 'grade' not in row
    assert 'no cell description' in recalibrate(task._replace(cell=''))[0]['reason']


def test_an_internal_error_is_a_row(monkeypatch: pytest.MonkeyPatch, folder: Path, tmp_path: Path) -> None:
    def fail(*_: object) -> None:
        raise MemoryError('no room')

    monkeypatch.setattr(archive, 'calibrate_files', fail)
    row, _ = recalibrate(Task(str(folder / 'left/monday.csv'), str(folder / 'cell.yaml'), str(tmp_path)))
    assert row['reason'] == 'internal error, MemoryError: no room' and row['robot'] == 'left'


def test_workers_leave_ctrl_c_to_the_command_and_have_one_thread(client: Any) -> None:
    found = client.run(lambda: (signal.getsignal(signal.SIGINT), os.environ['OPENBLAS_NUM_THREADS']))
    assert set(found.values()) == {(signal.SIG_IGN, '1')}
    assert set(client.nthreads().values()) == {1}


def test_a_job_that_ends_its_worker_costs_no_other(client: Any) -> None:
    def work(number: int) -> int:
        if number == 1:
            os._exit(9)
        return number + 1

    answers = dict(_answers(client, work, range(6)))
    error = answers.pop(1)
    assert answers == {k: k + 1 for k in (0, 2, 3, 4, 5)}
    assert archive._reason(error).startswith('KilledWorker')


def test_folders_of_the_same_name(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ('a/x.mcap', 'b/x.mcap', 'b/x.csv', 'b/y.csv', 'x')]
    paths[-1].mkdir()
    found = [Path(task.folder).relative_to(tmp_path / 'out') for task in tasks_of(paths, None, tmp_path / 'out')]
    assert len(set(found)) == 5 and found[3] == Path('y') and found[2] == Path('x.csv')
    assert found[:2] == [Path('a/x.mcap'), Path('b/x.mcap')]


@contextmanager
def scheduler_without_workers(file: Path) -> Iterator[str]:
    """Its address; a process of its own."""
    options = ['--host', '127.0.0.1', '--port', '0', '--no-dashboard', '--scheduler-file', str(file)]
    with subprocess.Popen([sys.executable, '-m', 'distributed.cli.dask_scheduler', *options]) as process:
        try:
            end = monotonic() + 300
            while not (file.exists() and file.read_text(encoding='utf-8').endswith('}')):
                assert process.poll() is None and monotonic() < end
                sleep(0.05)
            yield json.loads(file.read_text(encoding='utf-8'))['address']
        finally:
            process.kill()


def test_a_cluster_that_cannot_be_used(run: Run, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    common = ('recalibrate', folder / 'left/monday.csv', '--cell', folder / 'cell.yaml', '--out', 'a')
    wrong = run(*common, '--dask', 'nonsense')
    assert wrong.status == 2 and 'no scheduler at nonsense; start one by `dask scheduler`' in wrong.err
    monkeypatch.setattr(archive, 'PATIENCE', 0.2)
    with scheduler_without_workers(tmp_path / 'scheduler.json') as address:
        wrong = run(*common, '--dask', address)
    assert wrong.status == 2 and 'has no worker' in wrong.err
    monkeypatch.setitem(sys.modules, 'distributed', None)
    wrong = run(*common)
    assert wrong.status == 2 and wrong.err.count('\n') == 1
    assert "distributed: not installed; pip install 'scara_kinetostatic[cluster]'" in wrong.err
    assert main(['recalibrate', str(folder / 'a/archive.csv'), '--out', str(folder / 'a')]) == 2, 'an input'
