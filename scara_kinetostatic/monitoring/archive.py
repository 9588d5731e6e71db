"""Recalibration of an archive: each recording by itself, in parallel processes.

Every task reads one recording and writes one folder, as `calibrate` does. Whatever happens to one recording, a lost
process included, is its answer, and the others go on.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.bags.reader import recorded_cell
from scara_kinetostatic.errors import InputError, ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.results.write import write_results


class Task(NamedTuple):
    """One recording to calibrate.

    Attributes:
        recording: its path.
        cell: path of the cell description; empty: the one in the recording.
        folder: for the results.
        report: whether to draw the page, which takes several times as long as the calibration.
    """

    recording: str
    cell: str
    folder: str
    report: bool = True


class Done(NamedTuple):
    """What became of a task.

    Attributes:
        task: the task.
        grade: of the result; empty where there is none.
        problem: why there is none, one line; empty where there is one.
    """

    task: Task
    grade: str
    problem: str


def tasks_of(recordings: Sequence[Path], cell: Path | None, out: Path, *, report: bool = True) -> list[Task]:
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
    return [Task(str(path.resolve()), place, str(folder / name), report) for name, path in names.items()]


def recalibrate(task: Task) -> str:
    """One task; returns the grade of its result."""
    cell = load_cell(task.cell) if task.cell else recorded_cell([Path(task.recording)], '--cell')
    outcome = calibrate_recordings([task.recording], cell)
    write_results(outcome, task.folder, report=task.report)
    return outcome.assessment.grade.value


def in_processes(tasks: Sequence[Task], number: int) -> Iterator[Done]:
    """The tasks in parallel processes of one thread each, in their order.

    Ctrl-C ends it when the tasks that are being worked are done; no task is left half done.

    Args:
        tasks: the tasks.
        number: of processes; 1 works in this one.
    """
    if number == 1:
        yield from (_answer(task, partial(recalibrate, task)) for task in tasks)
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


def _answer(task: Task, result: Callable[[], str]) -> Done:
    """The result of a task, or what is wrong with the recording; where its process was lost, that is the answer."""
    try:
        return Done(task, result(), '')
    except ScaraKinetostaticError as error:
        return Done(task, '', str(error).removeprefix(f'{task.recording}: '))
    except Exception as error:  # one recording does not stop the others; BrokenProcessPool: for lack of memory, say
        return Done(task, '', f'internal error, {type(error).__name__}: {" ".join(str(error).split()):.200}')
