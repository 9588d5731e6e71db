"""An archive of recordings, each calibrated by itself on a Dask cluster; the trend of each robot.

A task is a few paths: a worker reads a recording and writes a folder, as `calibrate` does, and what comes back is a row
of the table. So recordings, cell description and results are under the same paths for all workers, which have this
version of the package. Whatever happens to one recording is its row. Dask gives the work of a worker that ends to
another one; recordings beside which workers end again and again are tried once more, one at a time, so that the one
that ends its worker is told from those that stood in its queue.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

from scara_kinetostatic import __version__
from scara_kinetostatic.bags.reader import recorded_cell
from scara_kinetostatic.errors import InputError, ScaraKinetostaticError
from scara_kinetostatic.files.atomic import check_different, recording_checksum
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.tables import csv_cell, csv_lines
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.quantities import count
from scara_kinetostatic.monitoring.history import Entry, trends_of
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm, robot_name
from scara_kinetostatic.monitoring.report import history_report
from scara_kinetostatic.pipeline import calibrate_files
from scara_kinetostatic.report.page import Block, Report, Section, Table, Verdict, drawn
from scara_kinetostatic.results.document import JSON, write_results
from scara_kinetostatic.results.report import NAME as PAGE_NAME
from scara_kinetostatic.threads import one_thread
from scara_kinetostatic.touches.detection import cell_of_files

PATIENCE = 10.0
"""For the scheduler to answer and for its first worker, s."""
_HEADING = ('recording', 'robot', 'date', 'grade', 'verdict', 'effects', 'folder', 'reason')
_ALONE = Lock()  # a worker of several threads calibrates one recording at a time: Matplotlib is not made for more


class Task(NamedTuple):
    """One recording to calibrate.

    Attributes:
        recording: its path.
        cell: path of the cell description; empty: the one in the recording.
        folder: for the results.
        report: whether to draw the page.
        version: of the package that asks.
    """

    recording: str
    cell: str
    folder: str
    report: bool = True
    version: str = __version__


Row = dict[str, str]
"""What became of a recording: cells of `archive.csv` by heading. `reason` is empty where there is a result."""


def tasks_of(recordings: Sequence[Path], cell: Path | None, out: Path, *, report: bool = True) -> list[Task]:
    """One task for each recording. Its folder in `out` has its name, with those of the folders above it where another
    one has the same.

    Raises:
        InputError: a recording is given twice.
    """
    check_different(recordings)
    paths = [path.resolve() for path in recordings]

    def names(path: Path) -> Iterator[str]:
        yield path.name if path.is_dir() else path.stem
        yield from (str(Path(*path.parts[-depth:])).lstrip('/') for depth in range(1, len(path.parts) + 1))

    longer = [names(path) for path in paths]
    found = [next(each) for each in longer]
    while len(number := Counter(found)) < len(found):
        found = [next(each) if number[name] > 1 else name for name, each in zip(found, longer, strict=True)]
    place, folder = str(cell.resolve()) if cell else '', out.resolve()
    return [Task(str(path), place, str(folder / name), report) for path, name in zip(paths, found, strict=True)]


def recalibrate(task: Task) -> tuple[Row, bool]:
    """One task: its row, and whether the result was there before; what is wrong with the recording is in the row."""
    recording, robot = Path(task.recording), ''
    try:
        if task.version != __version__:
            raise InputError('the worker', f'has version {__version__}, the command {task.version}', 'install one')
        cell = load_cell(task.cell) if task.cell else recorded_cell([recording], '--cell')
        robot = robot_name(cell) or cell.identification.cell or recording.parent.name
        with _ALONE, one_thread:
            is_there = _is_result(task, cell_of_files(cell, [recording]))
            if not is_there:
                outcome = calibrate_files([recording], Path(task.cell) if task.cell else None)
                write_results(outcome, task.folder, report=task.report)
        return _row(task, robot), is_there
    except Exception as error:  # one recording does not stop the others
        return _failed(task, error, robot), False


def _is_result(task: Task, cell: Cell) -> bool:
    """Whether the folder has the result of this recording, cell description and version."""
    try:
        record = CalibrationRecord.load(Path(task.folder) / JSON)
    except InputError:
        return False
    is_same = record.arm.cell == cell and record.document.get('version') == __version__
    is_same &= not task.report or (Path(task.folder) / PAGE_NAME).is_file()
    return is_same and record.checksums == {recording_checksum(task.recording)}


def _row(task: Task, robot: str) -> Row:
    """That of the result in the folder; SI units, empty where there is no number."""
    record = CalibrationRecord.load(Path(task.folder) / JSON)
    found = record.document['diagnosis']['effects']
    effects = '; '.join(f'{one["name"]}[{one["target"]}]' if one['target'] else one['name'] for one in found)
    known = task.recording, robot, record.measured, record.arm.grade, record.arm.verdict, effects, task.folder, ''
    row = dict(zip(_HEADING, known, strict=True))
    for name, part in record.document['parameters'].items():
        numbers = {name: part['value'], f'{name}_std': part['std']}
        row |= {key: '' if number is None else repr(number) for key, number in numbers.items()}
    return row


def _failed(task: Task, error: Exception, robot: str = '') -> Row:
    """That of a recording without a result."""
    reason = _reason(error).removeprefix(f'{task.recording}: ')
    return {'recording': task.recording, 'robot': robot, 'folder': task.folder, 'reason': reason}


def _reason(error: Exception) -> str:
    """What went wrong, in one line."""
    if isinstance(error, ScaraKinetostaticError):
        return str(error)
    if type(error).__name__ == 'KilledWorker':
        return 'KilledWorker: its worker ended again and again, as by lack of memory'
    return f'internal error, {type(error).__name__}: {" ".join(str(error).split()):.200}'


def _trend(job: tuple[str, str, Sequence[str]]) -> tuple[str, Block]:
    """Level and section of the trend of a robot.

    Args:
        job: names of its figure and of the robot; folders of its results in the order of time.

    Raises:
        InputError: a result cannot be read, or they are of different robots.
    """
    figure, robot, results = job
    records = [CalibrationRecord.load(Path(folder) / JSON) for folder in results]
    for record in records[1:]:
        check_same_arm(records[0].arm.cell, record.arm.cell, records[0].source, record.source)
    entries = [Entry(number, robot, record) for number, record in enumerate(records, 1)]
    report = history_report(trends_of(entries), figure)
    return report.answer.level, drawn(report.blocks[0])


def recalibrate_archive(
    tasks: Sequence[Task], address: str, heard: Callable[[Row, bool], None]
) -> tuple[list[Row], Report]:
    """The tasks on a Dask cluster, then the trend of each robot.

    Args:
        tasks: the tasks.
        address: of the scheduler of a running cluster, such as ``tcp://host:8786``; empty: all cores of this machine.
        heard: called with each row as it comes, and with whether its result was there before.

    Returns:
        The rows in the order of the tasks, and the report.

    Raises:
        InputError: there is no scheduler, it has no worker, or it has ended.
        ImportError: Dask is not installed.
    """
    rows = dict[int, Row]()
    with _client(address) as client:
        for k, answer in _answers(client, recalibrate, tasks):
            rows[k], is_earlier = (_failed(tasks[k], answer), False) if isinstance(answer, Exception) else answer
            heard(rows[k], is_earlier)
        robots: dict[str, list[str]] = {}
        ordered = [rows[k] for k in range(len(tasks))]
        for row in sorted((row for row in ordered if not row['reason']), key=lambda row: row['date']):
            robots.setdefault(row['robot'], []).append(row['folder'])
        jobs = [(f'robot{k}', robot, robots[robot]) for k, robot in enumerate(sorted(robots))]
        trends = dict(_answers(client, _trend, jobs))
    sections, changed = [], []
    for k, (_, robot, _) in enumerate(jobs):
        trend = trends[k]
        level, section = ('', Section(robot, (_reason(trend),))) if isinstance(trend, Exception) else trend
        sections.append(section)
        changed += [robot] * (level == 'caution')
    failed = tuple((row['recording'], row['reason']) for row in ordered if row['reason'])
    headline = f'{len(rows) - len(failed)} of {count(len(rows), "recording")} calibrated'
    headline += f'; changed: {", ".join(changed)}' if changed else ''
    blocks = (Table(('not calibrated', 'reason'), ('', ''), failed), Section('', tuple(sections), shown='page'))
    answer = Verdict(headline, 'caution' if failed or changed else 'good')
    report = Report('Calibrations of an archive', answer, blocks[not failed :], footer='all rows in archive.csv')
    return ordered, report


def archive_table(rows: Sequence[Row]) -> str:
    """`archive.csv`: all rows, those without a result with nothing but their reason."""
    names = dict.fromkeys(chain(_HEADING, *rows))
    return csv_lines({name: [csv_cell(row.get(name, '')) for row in rows] for name in names})


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """A client of a running cluster or of one for itself.

    Raises:
        InputError: there is no scheduler, or it has no worker.
        ImportError: Dask is not installed.
    """
    from distributed import Client, LocalCluster

    logging.getLogger('distributed.client').setLevel(logging.CRITICAL)  # what goes wrong is said in one line
    deaf = 'import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)'  # Ctrl-C goes to all processes of a terminal
    own = {'threads_per_worker': 1, 'silence_logs': logging.CRITICAL, 'preload': [deaf]}
    with ExitStack() as together:
        cluster = address or together.enter_context(LocalCluster(dashboard_address='127.0.0.1:0', **own))
        problem, remedy = f'there is no scheduler at {address}', 'start one by `dask scheduler`'
        try:
            client = together.enter_context(Client(cluster, timeout=PATIENCE))
            problem, remedy = f'the cluster at {address} has no worker', f'start some by `dask worker {address}`'
            client.wait_for_workers(1, timeout=PATIENCE)
        except (OSError, ValueError, TimeoutError) as error:
            raise InputError('--dask', problem, remedy) from error
        yield client


def _answers(client: Any, function: Callable[[Any], Any], jobs: Sequence[Any]) -> Iterator[tuple[int, Any]]:
    """The number of each job with its result or error, as they come.

    Raises:
        InputError: the scheduler has ended.
    """
    from distributed import as_completed

    groups = [range(len(jobs))]
    for group in groups:
        futures = dict(zip(client.map(function, [jobs[k] for k in group], pure=False), group, strict=True))
        for future in as_completed(futures):
            if future.cancelled():
                raise InputError('--dask', 'the scheduler has ended', 'repeat it: what is done is not done again')
            k, answer = futures.pop(future), future.exception() or future.result()
            if type(answer).__name__ == 'KilledWorker' and len(group) > 1:
                groups.append(range(k, k + 1))  # alone: another one may have ended its worker
            else:
                yield k, answer
