"""Recalibration of an archive: each recording by itself, in parallel processes or on a Dask cluster.

Every task reads one recording and writes one folder, as `calibrate` does. On a cluster, recordings and results must be
under the same paths on all machines.
"""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.bags.inputs import recorded_cell
from scara_kinetostatic.errors import InputError, ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.report.write import write_results

_ONE_THREAD = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')

_PATIENCE = 10.0
"""For the scheduler of a cluster to answer, s."""


class Task(NamedTuple):
    """One recording to calibrate.

    Attributes:
        recording: its path.
        cell: path of the cell description; empty: the one in the recording.
        folder: for the results.
    """

    recording: str
    cell: str
    folder: str


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


def tasks_of(recordings: Sequence[Path], cell: Path | None, out: Path) -> list[Task]:
    """One task per recording, each with a folder of its own in `out`, named as the recording.

    Raises:
        InputError: two recordings would have the same folder.
    """
    names: dict[str, Path] = {}
    for path in recordings:
        name = path.resolve().name if path.is_dir() else path.stem
        if name in names:
            raise InputError(
                path, f'has the name of {names[name]}: both results would be in {out / name}', 'rename one'
            )
        names[name] = path
    place = str(cell.resolve()) if cell else ''
    return [Task(str(path.resolve()), place, str((out / name).resolve())) for name, path in names.items()]


def recalibrate(task: Task) -> Done:
    """One task; what is wrong with the recording is part of the answer."""
    try:
        cell = load_cell(task.cell) if task.cell else recorded_cell([Path(task.recording)], '--cell')
        outcome = calibrate_recordings([task.recording], cell)
        write_results(outcome, task.folder)
    except ScaraKinetostaticError as error:
        return Done(task, '', str(error))
    return Done(task, outcome.assessment.grade.value, '')


def in_processes(tasks: Sequence[Task], number: int) -> Iterator[Done]:
    """The tasks in parallel processes of one thread each, in their order.

    Args:
        tasks: the tasks.
        number: of processes; 1 works in this one.
    """
    if number == 1:
        yield from map(recalibrate, tasks)
        return
    former = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(_ONE_THREAD)  # before a process imports NumPy
    try:
        context = multiprocessing.get_context('spawn')
        with ProcessPoolExecutor(min(number, max(len(tasks), 1)), mp_context=context) as pool:
            yield from pool.map(recalibrate, tasks)
    finally:
        for name, value in former.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def on_cluster(tasks: Sequence[Task], address: str) -> Iterator[Done]:
    """The tasks on a running Dask cluster, in their order.

    Args:
        tasks: the tasks.
        address: of its scheduler, such as ``tcp://host:8786``.

    Raises:
        InputError: Dask is not installed, or there is no scheduler.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError('--dask', 'Dask is not installed', "pip install 'dask[distributed]'") from error
    try:
        client = Client(address, timeout=_PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError('--dask', f'there is no scheduler at {address}', 'start one by `dask scheduler`') from error
    try:
        for future in client.map(recalibrate, tasks, pure=False):
            yield future.result()
    finally:
        client.close()
