"""The history file, its page, and archives that are recalibrated."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest
from cli.command import Run
from cli.conftest import recordings, run

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.monitoring.archive import in_processes, on_cluster, tasks_of
from scara_kinetostatic.monitoring.history import History, changes_of
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.render.json_file import json_text
from scara_kinetostatic.report.document import as_document

assert recordings and run  # fixtures


def later(outcome: Outcome, created: str, **changes: float) -> CalibrationRecord:
    document = as_document(outcome)
    document['created'] = created
    for name, change in changes.items():
        place = document['model']['names'].index(name)
        document['model']['values'][place] += change
        document['covariance_with_cell']['values'][place] += change
        document['parameters'][name]['value'] += change
    return CalibrationRecord.of_document(document, f'{created}.json')


def test_it_keeps_calibrations_in_the_order_of_time(plain: Outcome, tmp_path: Path) -> None:
    first, second = later(plain, '2026-01-01T00:00:00Z'), later(plain, '2026-02-01T00:00:00Z', l1=1e-4)
    history = History(tmp_path / 'a.sqlite', create=True)
    assert history.add([second]) == [True]
    assert history.add([first, second]) == [True, False]
    entries = History(tmp_path / 'a.sqlite').entries()
    assert [entry.created[:7] for entry in entries] == ['2026-01', '2026-02']
    assert entries[0].record.document == first.document and entries[0].grade == first.arm.grade
    none, change = changes_of(entries)
    assert none is None and change is not None and change.ranking[0].name == 'l1'
    with sqlite3.connect(tmp_path / 'a.sqlite') as connection:
        query = "SELECT value FROM parameter JOIN calibration ON id = calibration WHERE name = 'l1' ORDER BY created"
        (before,), (after,) = connection.execute(query).fetchall()
    connection.close()
    assert after - before == pytest.approx(1e-4)


def test_other_robots_and_other_files_are_refused(plain: Outcome, tmp_path: Path) -> None:
    history = History(tmp_path / 'a.sqlite', create=True)
    one = later(plain, '2026-01-01T00:00:00Z')
    cell = one.arm.cell
    other = replace(one, arm=replace(one.arm, cell=replace(cell, nominal=cell.nominal.replace(l1=0.5))))
    with pytest.raises(InputError, match='another robot'):
        history.add([one, other])
    assert history.entries() == []
    assert history.add([one, replace(other, document={**other.document, 'x': 1})][:1], robot='b') == [True]
    assert history.robots() == ['b']
    with pytest.raises(InputError, match='no such history'):
        History(tmp_path / 'none.sqlite')
    (tmp_path / 'text').write_text('text' * 1000)
    with pytest.raises(InputError, match='cannot be used'):
        History(tmp_path / 'text')
    with sqlite3.connect(tmp_path / 'other.sqlite') as connection:
        connection.execute('CREATE TABLE mine (a)')
    connection.close()
    with pytest.raises(InputError, match='another program'):
        History(tmp_path / 'other.sqlite', create=True)


def test_the_command(run: Run, plain: Outcome, tmp_path: Path) -> None:
    for month in (1, 2, 3):
        record = later(plain, f'2026-0{month}-01T00:00:00Z', g1=1e-4 * (month > 2))
        (tmp_path / f'{month}.json').write_text(json_text(dict(record.document)))
    added = run('history', 'add', 'h.sqlite', '1.json', '2.json', '3.json', '--robot', 'left')
    assert added.status == 0 and added.out.count('added') == 3
    page = run('history', 'page', 'h.sqlite', '--out', 'trend')
    assert page.status == 0 and 'the backlash of joint 1 changed' in page.out
    assert (tmp_path / 'trend' / 'history.html').read_text().count('<svg') == 1
    for words in (
        ('list', 'h.sqlite', '--robot', 'right'),
        ('list', 'none'),
        ('add', 'h.sqlite'),
        ('list', 'h.sqlite', '1.json'),
    ):
        wrong = run('history', *words)
        assert wrong.status == 2 and wrong.err.count('\n') == 1


def test_an_archive_by_command(run: Run, recordings: Path, tmp_path: Path) -> None:
    cell = recordings / 'cell.yaml'
    done = run('recalibrate', recordings / 'plain', recordings / 'few', '--cell', cell, '--history', 'h.sqlite')
    assert done.status == 3 and done.err.count('\n') == 1 and '1 of 2' in done.err
    assert 'plain: fit' in done.out and 'few: ' in done.out and '1 results added' in done.out
    assert len(History(tmp_path / 'h.sqlite').entries()) == 1
    assert run('recalibrate', recordings / 'plain', '--cell', cell, '--dask', 'nonsense').status == 2


def test_processes_give_the_same_results(recordings: Path, tmp_path: Path) -> None:
    found = []
    for number in (1, 2):
        tasks = tasks_of([recordings / 'good', recordings / 'plain'], recordings / 'cell.yaml', tmp_path / str(number))
        assert [done.problem for done in in_processes(tasks, number)] == ['', '']
        found.append([parameters(task.folder) for task in tasks])
    assert found[0] == found[1]
    with pytest.raises(InputError, match='has the name of'):
        tasks_of([Path('a/x.mcap'), Path('b/x.mcap')], None, tmp_path)


def parameters(folder: str) -> object:
    return json.loads((Path(folder) / 'calibration.json').read_text())['parameters']


def test_a_cluster_gives_the_same_results(recordings: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip('distributed')
    tasks = tasks_of([recordings / 'good'], recordings / 'cell.yaml', tmp_path)
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None) as cluster:
        assert [done.problem for done in on_cluster(tasks, cluster.scheduler_address)] == ['']
    (here,) = in_processes(tasks_of([recordings / 'good'], recordings / 'cell.yaml', tmp_path / 'here'), 1)
    assert parameters(tasks[0].folder) == parameters(here.task.folder)
