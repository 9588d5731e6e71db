"""Recordings in every form and cell files, damaged in many ways: the outcome of reading each."""

from __future__ import annotations

import random
import shutil
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from time import perf_counter
from types import FrameType
from typing import NamedTuple

import numpy as np

from benchmark.faults.damage import mutated, mutated_yaml
from scara_kinetostatic.bags.reader import embedded_cell, read_streams, recorded_cell
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.files.cell_file import dump_cell, load_cell, parse_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.pipeline import calibrate_recordings
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.streams import Streams

LONGEST = 5.0
"""No file may take longer, s."""
METADATA = 'metadata.yaml'
CANARY = 'canary'
"""A folder that appears where something in a file is executed."""


class Verdict(Enum):
    """Outcome of reading a damaged file."""

    REFUSED = 'refused in one line'
    WARNED = 'read with a warning'
    SAME = 'read, the damage changes nothing'
    SILENT = 'another result without a warning'
    CRASHED = 'crashed'
    SLOW = f'took over {LONGEST:g} s'
    EXECUTED = 'executed'


FAILURES = (Verdict.CRASHED, Verdict.SLOW, Verdict.EXECUTED)
"""What must not happen to any file."""


class Outcome(NamedTuple):
    """Outcome of reading a damaged file, with its message and time.

    Attributes:
        verdict: in a word.
        said: the refusal, the warnings, or what failed.
        shift: how far the result is from that of the intact file; 0 where it is the same or there is none.
        seconds: how long it took.
    """

    verdict: Verdict
    message: str
    shift: float
    seconds: float


class TooSlowError(BaseException):
    """Not an `Exception`, so that no reader takes it for damage."""


@dataclass(frozen=True)
class Form:
    """A recording in one form.

    Attributes:
        name: of the form.
        root: what is given to the reader, a file or folder.
        files: content of each file, by path.
        target: the file that is damaged.
        protected: whether checksums cover all that is read.
    """

    name: str
    root: str
    files: Mapping[str, bytes]
    target: str
    protected: bool


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Ends what takes too long.

    Raises:
        TooSlowError: it does.
    """

    def late(number: int, frame: FrameType | None) -> None:
        raise TooSlowError

    former = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, former)


def outcome_of(read: Callable[[], tuple[float, str]], folder: Path) -> Outcome:
    """What becomes of a reading.

    Args:
        read: reads; gives how far the result is from that of the intact file, and the warnings.
        folder: where nothing may appear.
    """
    start, shift = perf_counter(), 0.0
    try:
        with time_limit(LONGEST):
            shift, message = read()
        verdict = Verdict.WARNED if message else Verdict.SILENT if shift else Verdict.SAME
    except ScaraKinetostaticError as error:
        verdict, message = Verdict.REFUSED, str(error)
    except TooSlowError:
        verdict, message = Verdict.SLOW, ''
    except Exception as error:  # what this looks for
        verdict, message = Verdict.CRASHED, f'{type(error).__name__}: {error}'
    if not message.isprintable():
        verdict = Verdict.CRASHED
    if list(folder.rglob(CANARY)) or Path(CANARY).exists():
        verdict = Verdict.EXECUTED
    return Outcome(verdict, message, shift, perf_counter() - start)


def damaged_recording(form: Form, number: int, folder: Path) -> Path:
    """Damages a recording; the same number gives the same damage.

    Args:
        form: the intact recording.
        number: of the damage.
        folder: for the damaged one; emptied first.

    Returns:
        Where it is.
    """
    rng = random.Random(f'{form.name} {number}')
    shutil.rmtree(folder, ignore_errors=True)
    content = form.files[form.target]
    if form.target.endswith(METADATA):
        bad = mutated_yaml(content.decode(), rng)
    else:
        bad = mutated(content, rng.choice(list(form.files.values())), rng)
    for path, data in form.files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(bad if path == form.target else data)
    return folder / form.root


def reading_outcome(form: Form, number: int, whole: Streams, cell: Cell, folder: Path) -> Outcome:
    """Damages a recording and reads it.

    Args:
        form: the intact recording.
        number: of the damage.
        whole: what is in it.
        cell: that it carries.
        folder: for the damaged one.
    """
    root = damaged_recording(form, number, folder)

    def read() -> tuple[float, str]:
        carried, streams = embedded_cell(root), read_streams(root, cell)
        find_touches(streams, cell)
        return float(carried != cell or not _equal(streams, whole)), '; '.join(streams.warnings)

    return outcome_of(read, folder)


def calibration_outcome(form: Form, number: int, intact: Calibration, folder: Path) -> Outcome:
    """Damages a recording and calibrates from it; the shift is the largest of a parameter, in standard deviations."""
    root = damaged_recording(form, number, folder)

    def read() -> tuple[float, str]:
        outcome = calibrate_recordings([root], recorded_cell([root], '--cell'))
        shift = np.abs(outcome.final.parameters.as_array() - intact.parameters.as_array()) / intact.std
        return float(shift.max()), '; '.join(outcome.warnings)

    return outcome_of(read, folder)


def cell_outcome(text: str, number: int, folder: Path) -> Outcome:
    """Damages a cell file and reads it; a cell that is read must be valid and survive a round trip."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    path = folder / 'cell.yaml'
    path.write_bytes(mutated_yaml(text, random.Random(f'cell {number}')))

    def read() -> tuple[float, str]:
        cell = load_cell(path)
        if parse_cell(dump_cell(cell)) != cell:
            raise ValueError('comes back as another cell')
        numbers = [*cell.nominal.as_dict().values(), *(value for disc in cell.discs for value in disc[1:-1])]
        if not np.all(np.isfinite(numbers)):
            raise ValueError('not finite')
        return float(cell != parse_cell(text)), ''

    return outcome_of(read, folder)


def _equal(read: Streams, whole: Streams) -> bool:
    return (
        np.array_equal(read.joints.stamp, whole.joints.stamp)
        and np.array_equal(read.joints.position, whole.joints.position)
        and np.array_equal(read.wrench.stamp, whole.wrench.stamp)
        and np.array_equal(read.wrench.force, whole.wrench.force)
    )
