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
import queue
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from time import monotonic
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from scara_kinetostatic.errors import OutputError, ScaraKinetostaticError, one_line

if TYPE_CHECKING:
    from scara_kinetostatic.assessment.outcome import Outcome
    from scara_kinetostatic.report.json_file import Document

UNFIT = 'unfit'
"""Folder, in that of the results, for one that is not fit for use."""
COMMAND = (
    sys.executable,
    '-c',
    'import sys; sys.path[:] = sys.argv[1:]; from scara_kinetostatic.nodes.calibration_job import main; main()',
)
"""Followed by the places of Python modules: that of this package, before all others, and those of the node."""
PATIENCE = 3.0
"""Time for the process to end by itself after it was told to, s."""
CANCELLED = 'cancelled; earlier results are unchanged'
"""Why there is no reply after `CalibrationProcess.cancel`."""


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
        values: the twelve parameters, SI units.
        deviations: their standard deviations; NaN where there is none.
        effects: path, value, standard deviation, unit and meaning of each parameter of the effects found.
        facts: what the result is made from and worth (`report.facts`).
        document: what `calibration.json` holds.
        folder: that holds the files.
        note: what was kept of an earlier result; empty if nothing.
        unwritten: why the files could not be written; empty if they were.
    """

    line: str
    grade: str
    verdict: str
    warnings: list[str]
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
    from scara_kinetostatic.pipeline import calibrate_files
    from scara_kinetostatic.results.document import as_document
    from scara_kinetostatic.results.parameter_file import effect_parameters, facts
    from scara_kinetostatic.results.write import write_results

    outcome = calibrate_files(
        job.recordings,
        Path(job.cell) if job.cell else None,
        job.fixed,
        job.left_out,
        options=('the parameter cell', 'parameter fixed:', 'parameter leave_out'),
        joined=job.joined,
        progress=_over_all_steps(progress),
    )
    grade = outcome.assessment.grade.value
    folder = Path(job.output) / (UNFIT if grade == UNFIT and not job.publish_unfit else '')
    progress('writing the results', 0.8)
    note = unwritten = ''
    try:
        with _taken_back():
            note = write_results(outcome, folder).note
    except OutputError as error:
        unwritten = str(error)
    return Reply(
        line=line_of(outcome),
        grade=grade,
        verdict=outcome.verdict,
        warnings=list(outcome.warnings),
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


def _over_all_steps(progress: Callable[[str, float], None]) -> Callable[[str, float], None]:
    """From the progress of reading, then of fitting, each from 0 to 1, to that of the whole work."""
    read = False

    def report(step: str, part: float) -> None:
        nonlocal read
        progress(step, 0.3 + 0.5 * part if read else 0.3 * part)
        read = read or part >= 1.0

    return report


def line_of(outcome: Outcome) -> str:
    """Assessment, touches, force error before and after, goodness of fit, verdict, effects, in one line."""
    result, compared = outcome.final, outcome.comparison
    alone, extended = compared.base, compared.extended
    sources = f' from {len(outcome.sources)} recordings' if len(outcome.sources) > 1 else ''
    parts = [
        outcome.assessment.headline,
        f'{int(result.used.sum())} of {outcome.found} touches used{sources}',
        f'force error {compared.nominal:.4g} N before, {alone.force_error:.4g} N after',
        f'reduced chi-square {alone.reduced_chi_square:.3g}',
    ]
    for group in result.identifiability.confounded:
        parts.append(f'confounded: {" ".join(group)}')
    parts.append(f'missing effects: {_verdict(outcome)}')
    if outcome.diagnosis.extended:
        parts.append(
            f'with them {extended.force_error:.4g} N, reduced chi-square {extended.reduced_chi_square:.3g}, '
            f'on touches not used {alone.held_out:.4g} N before, {extended.held_out:.4g} N after'
        )
    return '; '.join(parts)


def _verdict(outcome: Outcome) -> str:
    """The verdict and the effects behind it; rivals in brackets."""
    from scara_kinetostatic.assessment.grade import LIMITS

    d = outcome.diagnosis
    found = [item.effect.label for item in d.found if item.is_found]
    possible = [f'possible: {item.effect.label}' for item in d.found if item.in_every_model and item.is_possible]
    open_ones = [f'one of ({", ".join(group)})' for group in d.rivals]
    checked = '' if outcome.final.degrees_of_freedom >= LIMITS.least_freedoms else ' (too few touches to check)'
    return ', '.join([d.verdict + checked, *found, *possible, *open_ones])


def warnings_in_line(warnings: Sequence[str]) -> str:
    """The first warnings, and the number of the others; empty if there are none."""
    more = len(warnings) - 3
    named = [*warnings[:3], *([f'{more} more'] if more > 0 else [])]
    return f'warnings: {"; ".join(named)}' if named else ''


def stored_document(folder: Path) -> Document | None:
    """`calibration.json` of a result; None where it cannot be read or is no such document."""
    try:
        document = json.loads((folder / 'calibration.json').read_text(encoding='utf-8'))
        summary(document)
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return None
    return dict(document)


def summary(document: Document) -> Document:
    """What `~/result` carries of `calibration.json`: all but the single touches and the details of the diagnosis."""
    from scara_kinetostatic.files.calibration_file import RESULT_SCHEMA

    shared = (
        'created', 'recordings', 'warnings', 'cell', 'parameters', 'model', 'noise', 'force_error',
        'held_out_force_error', 'reduced_chi_square', 'tip_error', 'tip_uncertainty', 'assessment',
    )  # fmt: skip
    parts = {
        'touches': ('found', 'used', 'rejected'),
        'identifiability': ('rank', 'confounded', 'advice'),
        'diagnosis': ('verdict', 'p_value', 'effects', 'possible', 'rivals', 'rival_effects', 'advice'),
    }
    some = {part: {key: document[part][key] for key in keys} for part, keys in parts.items()}
    return {'schema': RESULT_SCHEMA, **{key: document[key] for key in shared}, **some}


class Progress(NamedTuple):
    """What the process does.

    Attributes:
        step: in words.
        part: of the work that is done, 0 to 1.
    """

    step: str
    part: float


class CalibrationProcess:
    """A calibration that runs.

    Args:
        job: what to calibrate.
    """

    def __init__(self, job: Job) -> None:
        self._process = subprocess.Popen(
            [*COMMAND, str(Path(__file__).resolve().parents[2]), *filter(None, sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            encoding='utf-8',
            start_new_session=True,  # Ctrl-C reaches the node alone, which ends this process
        )
        self._news: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._cancelled_at: float | None = None
        self._thread = Thread(target=self._converse, args=(json.dumps(job._asdict()),), daemon=True)
        self._thread.start()

    def _converse(self, order: str) -> None:
        """Gives the order and passes on what the process says; in a thread of its own."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(order + '\n')
            self._process.stdin.close()
        except OSError:  # it has ended already
            pass
        with self._process.stdout as said:
            for line in said:
                self._news.put(line)
        self._news.put(None)

    def poll(self) -> Progress | Reply | str | None:
        """The latest news, without waiting.

        Returns:
            Progress, the reply, or why there is none; None where nothing is new.
        """
        if self._cancelled_at is not None and monotonic() > self._cancelled_at + PATIENCE:
            self._process.kill()
        latest: Progress | None = None
        while not self._news.empty():
            line = self._news.get()
            if line is None:
                return self._ended()
            try:
                said: dict[str, Any] = json.loads(line)
                if 'progress' in said:
                    latest = Progress(**said['progress'])
                    continue
                ended = Reply(**said['reply']) if 'reply' in said else str(said['error'])
            except (ValueError, KeyError, TypeError):
                self._process.kill()
                ended = one_line(f'the calibration gave no reply but {line[:80]!r}')
            self._finish()
            return ended
        return latest

    def cancel(self) -> None:
        """Tells the process to end; `poll` says when it has. What it was writing is taken back."""
        self._cancelled_at = self._cancelled_at or monotonic()
        self._process.send_signal(signal.SIGTERM)

    def close(self) -> None:
        """Ends the process and waits for that."""
        self.cancel()
        self._finish()

    def _finish(self) -> int:
        """The exit status, when the process has ended, by SIGKILL if need be."""
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._thread.join()
        return self._process.returncode

    def _ended(self) -> str:
        """Why the process ended without a reply."""
        status = self._finish()
        if self._cancelled_at is not None:
            return CANCELLED
        if status == -signal.SIGKILL:
            return 'the calibration was killed (SIGKILL); has the memory run out?'
        return one_line(f'the calibration ended with status {status} and without a reply; see what the node prints')


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
