"""One calibration as the node `calibrator` orders it, done in a process of its own.

Such a process can be ended at any time by SIGTERM, gives all its memory back, and leaves the node free to answer. It
reads the order from its input and writes news and the reply to its output, one JSON object per line:

    {"progress": {"step": "fitting 72 touches", "part": 0.3}}
    {"reply": …}     the fields of `Reply`
    {"error": "…"}   there is no result; one line
"""

from __future__ import annotations

import json
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, NoReturn

from scara_kinetostatic.errors import CellError, OutputError, RecordingError, ScaraKinetostaticError, one_line

UNFIT = 'unfit'
"""Folder, in that of the results, for one that is not fit for use."""
_READING, _WRITING = 0.3, 0.8
"""Parts of the work after which the recordings are read, and the model is fitted."""


class Job(NamedTuple):
    """What to calibrate.

    Attributes:
        recordings: paths of recordings and touch tables.
        joined: whether the node put them together by itself; then one that cannot be used is left out with a warning.
        cell: path of the cell description; empty for the one in the recordings.
        fixed: parameters to hold, as the parameter `fixed` has them.
        left_out: touches and recordings to leave out, as the parameter `leave_out` has them.
        output: folder for the results.
        publish_unfit: whether a result that is not fit for use replaces an earlier one.
        name: under which the result is kept.
    """

    recordings: list[str]
    joined: bool
    cell: str
    fixed: list[str]
    left_out: list[str]
    output: str
    publish_unfit: bool
    name: str = ''


class Reply(NamedTuple):
    """The result of a calibration.

    Attributes:
        line: the result in one line.
        grade: ``fit``, ``caution`` or ``unfit``.
        verdict: of the diagnosis.
        warnings: irregularities of the recordings, one sentence each.
        details: the figures by name.
        values: the twelve parameters, SI units.
        deviations: their standard deviations; NaN where there is none.
        effects: path, value, standard deviation, unit and meaning of each parameter of the effects found.
        facts: what the result is made from and worth (`results.facts`).
        document: what `calibration.json` holds.
        folder: that holds the files.
        note: what was kept of an earlier result; empty if nothing.
        unwritten: why the files could not be written; empty if they were.
    """

    line: str
    grade: str
    verdict: str
    warnings: list[str]
    details: dict[str, str]
    values: list[float]
    deviations: list[float]
    effects: list[list[Any]]
    facts: dict[str, Any]
    document: dict[str, Any]
    folder: str
    note: str
    unwritten: str


def do(job: Job, progress: Callable[[str, float], None]) -> Reply:
    """Calibrates and writes the files.

    Args:
        job: what to calibrate.
        progress: called with each step and the part of the work that is done, 0 to 1.

    Raises:
        ScaraKinetostaticError: there is no result.
    """
    from scara_kinetostatic.files.checksum import check_different
    from scara_kinetostatic.nodes.outcome_text import details
    from scara_kinetostatic.nodes.outcome_text import one_line as outcome_line
    from scara_kinetostatic.results.document import as_document
    from scara_kinetostatic.results.facts import facts
    from scara_kinetostatic.results.parameter_file import effect_parameters
    from scara_kinetostatic.results.write import write_results

    check_different([Path(path) for path in job.recordings])
    outcome = _calibrate(job, progress)
    grade = outcome.assessment.grade.value
    folder = Path(job.output) / (UNFIT if grade == UNFIT and not job.publish_unfit else '')
    progress('writing the results', _WRITING)
    note = unwritten = ''
    try:
        with _taken_back():
            note = write_results(outcome, folder).note
    except OutputError as error:
        unwritten = str(error)
    return Reply(
        line=outcome_line(outcome),
        grade=grade,
        verdict=outcome.verdict,
        warnings=list(outcome.warnings),
        details=details(outcome),
        values=list(outcome.final.parameters.as_dict().values()),
        deviations=outcome.final.std.tolist(),
        effects=[list(item) for item in effect_parameters(outcome.diagnosis.found)],
        facts=facts(outcome),
        document=as_document(outcome),
        folder=str(folder),
        note=note,
        unwritten=unwritten,
    )


@contextmanager
def _taken_back() -> Iterator[None]:
    """Where SIGTERM takes back what was written; elsewhere it ends the process at once."""

    def interrupt(_: int, __: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    former = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former)


def _calibrate(job: Job, progress: Callable[[str, float], None]) -> Any:
    """The outcome; recordings that the node joined by itself and that cannot be used are left out.

    Of these the cell description of the last one counts: it is the one that the user has written last.

    Raises:
        ScaraKinetostaticError: there is no result.
    """
    from scara_kinetostatic.bags.inputs import other_descriptions, recorded_cell
    from scara_kinetostatic.calibration.calibrate import fixed_values
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.pipeline import calibrate_recordings
    from scara_kinetostatic.touches.left_out import check_named, kept_recordings, parse_left_out

    left_out = parse_left_out(job.left_out, 'parameter leave_out')
    paths = list(map(Path, kept_recordings(job.recordings, left_out)))
    left_out = tuple(entry for entry in left_out if entry.numbers is not None)
    warnings: list[str] = []
    while True:
        try:
            latest_first = paths[::-1] if job.joined else paths
            cell = load_cell(Path(job.cell)) if job.cell else recorded_cell(latest_first, 'the parameter cell')
            fixed = fixed_values(job.fixed, cell.nominal, 'parameter fixed:')
            outcome = calibrate_recordings(
                paths, cell, fixed=fixed, left_out=left_out, progress=_over_all_steps(progress)
            )
            break
        except RecordingError as error:
            useless = [path for path in paths if Path(error.where).is_relative_to(path)]  # or one of its files
            if not job.joined or not useless or len(paths) == 1:
                raise
            if useless[0] != paths[-1]:
                check_named(left_out)
            left_out = tuple(entry for entry in left_out if not entry.recording or not entry.names(useless[0]))
            paths = [path for path in paths if path not in useless]
            warnings.append(f'{error}: left out')
        except CellError as error:  # the data contradict it: name its file
            where = job.cell or f'the cell description in {paths[0]}'
            raise CellError(f'{where}: {error.where}', error.problem, error.remedy) from error
    if job.cell:
        warnings += other_descriptions(cell, paths, 'the parameter cell')
    return replace(outcome, warnings=(*outcome.warnings, *warnings))


def _over_all_steps(progress: Callable[[str, float], None]) -> Callable[[str, float], None]:
    """From the progress of reading, then of fitting, each from 0 to 1, to that of the whole work."""
    read = False

    def report(step: str, part: float) -> None:
        nonlocal read
        progress(step, _READING + (_WRITING - _READING) * part if read else _READING * part)
        read = read or part >= 1.0

    return report


def main() -> None:
    """Does the job on the input of the process."""
    output = os.fdopen(os.dup(sys.stdout.fileno()), 'w', encoding='utf-8')
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no reply

    def send(kind: str, value: object) -> None:
        output.write(json.dumps({kind: value}) + '\n')
        output.flush()

    try:
        job = Job(**json.loads(sys.stdin.readline()))
        reply = do(job, lambda step, part: send('progress', {'step': step, 'part': part}))
        send('reply', reply._asdict())
    except ScaraKinetostaticError as error:
        send('error', str(error))
    except (KeyboardInterrupt, BrokenPipeError):  # told to end, or the node has gone
        os._exit(1)
    except Exception as error:  # the node says so and stays up
        traceback.print_exc()
        send('error', one_line(f'internal error: {type(error).__name__}: {error}'))


if __name__ == '__main__':
    main()
