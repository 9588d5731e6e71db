"""The history file and its page."""

from __future__ import annotations

import json
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from threading import Barrier
from typing import Any

import pytest
from cli.command import Run
from cli.conftest import recordings, run

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.monitoring.history import History, trends_of
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.report import history_report
from scara_kinetostatic.report.page import as_text, json_text
from scara_kinetostatic.results.document import as_document

assert recordings and run  # fixtures


def later(outcome: Outcome, created: str, start: str = '', sha256: str = '', theta2: float = 0.0) -> CalibrationRecord:
    """The calibration of the same touches at a later time, the zero of joint 2 changed by an angle in between."""
    document = as_document(outcome)
    document['created'] = created
    document['recordings'] = [{'path': 'a', 'sha256': sha256 or created, 'start': start or None}]
    place = document['model']['names'].index('theta2')
    document['model']['values'][place] += theta2
    document['covariance_with_cell']['values'][place] += theta2
    document['parameters']['theta2']['value'] += theta2
    for row in document['touches']['fitted']:
        row['joints'] = [row['joints'][0], row['joints'][1] - theta2]
    return CalibrationRecord.of_document(document, f'{created}.json')


def execute(path: Path, command: str) -> list[tuple[Any, ...]]:
    """Behind the history's back."""
    with closing(sqlite3.connect(path)) as connection, connection:
        return connection.execute(command).fetchall()


def test_it_keeps_calibrations_in_the_order_of_time(plain: Outcome, tmp_path: Path) -> None:
    first, second = later(plain, '2026-01-01T00:00:00Z'), later(plain, '2026-02-01T00:00:00Z', theta2=1e-4)
    history = History(tmp_path / 'a.sqlite', create=True)
    assert history.add([second]) == [True]
    assert history.add([first, second]) == [True, False]
    entries = History(tmp_path / 'a.sqlite').entries()
    assert [entry.record.created[:7] for entry in entries] == ['2026-01', '2026-02']
    assert entries[0].record.document == first.document and entries[0].record.arm.grade == first.arm.grade
    (trend,) = trends_of(entries)
    none, change = trend.changes
    assert none is None and trend.slow is None and change is not None and change.causes.ranking[0].name == 'theta2'
    query = "SELECT json_extract(document, '$.parameters.theta2.value') FROM calibration ORDER BY created"
    (before,), (after,) = execute(tmp_path / 'a.sqlite', query)
    assert after - before == pytest.approx(1e-4)


def test_time_is_that_of_the_recording_and_the_last_result_of_it_counts(plain: Outcome, tmp_path: Path) -> None:
    history = History(tmp_path / 'a.sqlite', create=True)
    monday, tuesday = '2025-01-06T08:00:00Z', '2025-01-07T08:00:00Z'
    history.add([later(plain, '2026-05-01T00:00:00Z', tuesday, 'b'), later(plain, '2026-05-02T00:00:00Z', monday, 'a')])
    assert [entry.record.measured for entry in history.entries()] == [monday, tuesday]
    history.add([later(plain, '2026-05-03T00:00:00Z', monday, 'a')])
    found = [(entry.record.measured, entry.record.created[:10]) for entry in history.entries()]
    assert found == [(monday, '2026-05-03'), (tuesday, '2026-05-01')]
    assert execute(tmp_path / 'a.sqlite', 'SELECT count(*) FROM calibration') == [(3,)]


def test_small_steps_add_up(plain: Outcome, tmp_path: Path) -> None:
    records = [later(plain, f'2026-0{k}-01T00:00:00Z', theta2=12e-6 * k) for k in range(1, 5)]
    history = History(tmp_path / 'a.sqlite', create=True)
    history.add(records)
    (trend,) = trends_of(history.entries())
    assert trend.changed == [] and trend.has_crept
    assert trend.slow is not None and trend.slow.causes.ranking[0].name == 'theta2' and trend.since == 1
    said = as_text(history_report([trend])).replace('\n', ' ')
    assert 'From number 1 to number 4: Changed' in said and 'the zero of joint 2 changed' in said
    assert history_report([trend]).answer.level == 'caution'
    history.add([later(plain, f'2026-1{k}-01T00:00:00Z', theta2=5e-4) for k in range(3)])
    (trend,) = trends_of(history.entries())
    assert len(trend.changed) == 1 and not trend.has_crept and trend.since == 5


def test_a_calibration_without_touches_or_a_date_is_refused(plain: Outcome) -> None:
    with pytest.raises(InputError, match='yesterday'):
        later(plain, 'yesterday')
    document = later(plain, '2026-01-01T00:00:00Z').document
    for touches in ({}, {'fitted': []}, {'fitted': [{}]}, {'fitted': 3}):
        with pytest.raises(InputError, match='damaged or old'):
            CalibrationRecord.of_document({**document, 'touches': touches}, 'bad.json')


def test_processes_that_write_at_a_time(plain: Outcome, tmp_path: Path) -> None:
    records = [later(plain, f'2026-01-0{k}T00:00:00Z') for k in range(1, 7)]
    begin = Barrier(len(records))

    def add(record: CalibrationRecord) -> list[bool]:
        begin.wait()
        return History(tmp_path / 'a.sqlite', create=True).add([record])

    with ThreadPoolExecutor(len(records)) as pool:
        assert list(pool.map(add, records)) == [[True]] * len(records)
    assert len(History(tmp_path / 'a.sqlite').entries()) == len(records)


def test_files_of_other_versions_and_damaged_entries(run: Run, plain: Outcome, tmp_path: Path) -> None:
    path = tmp_path / 'a.sqlite'
    first, second = (later(plain, f'2026-0{k}-01T00:00:00Z') for k in (1, 2))
    History(path, create=True).add([first, second])
    (kept,) = execute(path, 'SELECT document FROM calibration WHERE id = 2')
    assert json.loads(kept[0]) == json.loads(json_text(dict(second.document)))
    execute(path, "UPDATE calibration SET document = '{' WHERE id = 1")
    wrong = run('history', 'list', path)
    assert wrong.status == 2 and wrong.err.count('\n') == 1 and 'calibration 1 cannot be read' in wrong.err
    assert f'scara-kinetostatic history remove {path} 1' in wrong.err
    assert run('history', 'remove', path, 1).status == 0
    assert [entry.number for entry in History(path).entries()] == [2]
    execute(path, 'PRAGMA user_version = 9')
    (tmp_path / 'empty').touch()
    (tmp_path / 'text').write_text('text' * 1000)
    execute(tmp_path / 'other.sqlite', 'CREATE TABLE mine (a)')
    for name, create, message in (
        ('a.sqlite', False, 'got 9'),
        ('empty', False, 'is no history'),
        ('none.sqlite', False, 'no such history'),
        ('text', False, 'cannot be used'),
        ('other.sqlite', True, 'is no history'),
    ):
        with pytest.raises(InputError, match=message):
            History(tmp_path / name, create=create)


def test_other_robots_are_refused(plain: Outcome, tmp_path: Path) -> None:
    history = History(tmp_path / 'a.sqlite', create=True)
    one = later(plain, '2026-01-01T00:00:00Z')
    cell = one.arm.cell
    other = replace(one, arm=replace(one.arm, cell=replace(cell, nominal=cell.nominal.replace(l1=0.5))))
    with pytest.raises(InputError, match='another robot'):
        history.add([one, other])
    assert history.entries() == []
    assert history.add([one, replace(other, document={**other.document, 'x': 1})][:1], robot='b') == [True]
    assert {entry.robot for entry in history.entries()} == {'b'}


def test_the_command(run: Run, plain: Outcome, tmp_path: Path) -> None:
    for month in (1, 2, 3):
        record = later(plain, f'2026-0{month}-01T00:00:00Z', theta2=1e-4 * (month > 2))
        (tmp_path / f'{month}.json').write_text(json_text(dict(record.document)))
    added = run('history', 'add', 'h.sqlite', '1.json', '2.json', '3.json', '--robot', 'left')
    assert added.status == 0 and added.out.count('added') == 3
    page = run('history', 'page', 'h.sqlite', '--out', 'trend')
    assert page.status == 0 and 'the zero of joint 2 changed' in page.out
    text = (tmp_path / 'trend' / 'history.html').read_text()
    assert text.count('<svg') == 1 and 'class="verdict caution"' in text and 'days since the first' in text
    lines = 'list h.sqlite --robot right|list none|add h.sqlite|list h.sqlite 1.json|extract h.sqlite 1 2'
    lines += '|remove h.sqlite|remove h.sqlite 1 9|remove h.sqlite 1.json|extract h.sqlite ' + '9' * 30
    for line in lines.split('|'):
        wrong = run('history', *line.split())
        assert wrong.status == 2 and wrong.err.count('\n') == 1
    assert json.loads(run('history', 'extract', 'h.sqlite', 3).out) == json.loads((tmp_path / '3.json').read_text())
    assert run('history', 'remove', 'h.sqlite', 1, 3).out == 'removed: 1 3\n'
    assert [entry.number for entry in History(tmp_path / 'h.sqlite').entries()] == [2]


def test_a_history_after_analyze(tmp_path: Path) -> None:
    History(tmp_path / 'a.sqlite', create=True)
    execute(tmp_path / 'a.sqlite', 'ANALYZE')
    assert execute(tmp_path / 'a.sqlite', "SELECT * FROM sqlite_master WHERE name LIKE 'sqlite_stat%'")
    assert History(tmp_path / 'a.sqlite').entries() == []
