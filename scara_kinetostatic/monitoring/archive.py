"""Recalibration of an archive: each recording by itself, in parallel processes or on a Dask cluster.

Every task reads one recording and writes one folder, as `calibrate` does. On a cluster, recordings and results must be
under the same paths on all machines, and every worker must have this version of the package. Whatever happens to one
recording, a lost process included, is its answer, and the others go on. A run that was interrupted is completed by
another one that leaves out what is done.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic import __version__
from scara_kinetostatic.bags.reader import recorded_cell
from scara_kinetostatic.errors import InputError, ScaraKinetostaticError
from scara_kinetostatic.files.atomic import recording_checksum
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.results.calibration_json import NAME
from scara_kinetostatic.results.report import NAME as PAGE_NAME
from scara_kinetostatic.results.write import write_results


class Task(NamedTuple):
    """One recording to calibrate.

    Attributes:
        recording: its path.
        cell: path of the cell description; empty: the one in the recording.
        folder: for the results.
        resume: whether to leave it out where `folder` holds the result of the same recording, cell and version.
        report: whether to draw the page, which takes several times as long as the calibration.
    """

    recording: str
    cell: str
    folder: str
    resume: bool = False
    report: bool = True


class Done(NamedTuple):
    """What became of a task.

    Attributes:
        task: the task.
        grade: of the result; empty where there is none.
        problem: why there is none, one line; empty where there is one.
        earlier: whether the result was there before.
    """

    task: Task
    grade: str
    problem: str
    earlier: bool = False


def tasks_of(
    recordings: Sequence[Path], cell: Path | None, out: Path, *, resume: bool = False, report: bool = True
) -> list[Task]:
    """One task per recording, each with a folder of its own in `out`, named as the recording.

    Raises:
        InputError: two recordings would have the same folder.
    """
    names: dict[str, Path] = {}
    for path in recordings:
        name = path.resolve().name if path.is_dir() else path.stem
        if name in names:
            problem = f'has the name of {names[name]}: both results would be in {out / name}'
            raise InputError(path, problem, 'rename one')
        names[name] = path
    place, folder = str(cell.resolve()) if cell else '', out.resolve()
    return [Task(str(path.resolve()), place, str(folder / name), resume, report) for name, path in names.items()]


def recalibrate(task: Task) -> Done:
    """One task; what is wrong with the recording is part of the answer."""
    try:
        cell = load_cell(task.cell) if task.cell else recorded_cell([Path(task.recording)], '--cell')
        if task.resume and (grade := _grade_before(task, cell)):
            return Done(task, grade, '', earlier=True)
        outcome = calibrate_recordings([task.recording], cell)
        write_results(outcome, task.folder, report=task.report)
    except ScaraKinetostaticError as error:
        return Done(task, '', str(error).removeprefix(f'{task.recording}: '))
    except Exception as error:  # one recording does not stop the others
        return Done(task, '', f'internal error, {type(error).__name__}: {" ".join(str(error).split()):.200}')
    return Done(task, outcome.assessment.grade.value, '')


def _grade_before(task: Task, cell: Cell) -> str:
    """Grade of the result in the folder, if it is of this recording, cell description and version; empty if not."""
    try:
        before = CalibrationRecord.load(Path(task.folder) / NAME)
    except InputError:
        return ''
    is_same = before.arm.cell == cell and before.document.get('version') == __version__
    is_same &= before.checksums == {recording_checksum(task.recording)}
    is_same &= not task.report or (Path(task.folder) / PAGE_NAME).is_file()
    return before.arm.grade if is_same else ''


def in_processes(tasks: Sequence[Task], number: int) -> Iterator[Done]:
    """The tasks in parallel processes of one thread each, in their order.

    Ctrl-C ends it when the tasks that are being worked are done; no task is left half done.

    Args:
        tasks: the tasks.
        number: of processes; 1 works in this one.
    """
    if number == 1:
        yield from map(recalibrate, tasks)
        return
    os.environ |= dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')
    # Ctrl-C goes to all processes of a terminal: those that are started here do not heed it
    number, context = min(number, max(len(tasks), 1)), multiprocessing.get_context('spawn')
    pool = ProcessPoolExecutor(number, context, signal.signal, (signal.SIGINT, signal.SIG_IGN))
    try:
        for task, future in zip(tasks, [pool.submit(recalibrate, task) for task in tasks], strict=True):
            yield _answer(task, future.result)
    finally:
        pool.shutdown(cancel_futures=True)


def on_cluster(tasks: Sequence[Task], address: str, patience: float = 10.0) -> Iterator[Done]:
    """The tasks on a running Dask cluster, in their order.

    Args:
        tasks: the tasks.
        address: of its scheduler, such as ``tcp://host:8786``.
        patience: for the scheduler to answer and for its first worker, s.

    Raises:
        InputError: Dask is not installed, there is no scheduler, or it has no worker.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError('--dask', 'Dask is not installed', "pip install 'dask[distributed]'") from error
    try:
        client = Client(address, timeout=patience)
    except Exception as error:  # whatever another kind of server makes of it
        raise InputError('--dask', f'there is no scheduler at {address}', 'start one by `dask scheduler`') from error
    try:
        client.wait_for_workers(1, timeout=patience)
        for task, future in zip(tasks, client.map(recalibrate, tasks, pure=False), strict=True):
            yield _answer(task, future.result)
    except TimeoutError as error:
        remedy = f'start some by `dask worker {address}`'
        raise InputError('--dask', f'the cluster at {address} has no worker', remedy) from error
    finally:
        client.close()


def _answer(task: Task, result: Callable[[], Done]) -> Done:
    """The result of a task; where its process was lost, or a worker lacks this package, that is the answer."""
    try:
        return result()
    except Exception as error:  # BrokenProcessPool, KilledWorker and others of their kind
        lost = f'its process was lost, {type(error).__name__}, as by lack of memory or of this package on a worker'
        return Done(task, '', f'{lost}; repeat with --resume and fewer processes')
