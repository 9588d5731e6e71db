"""One calibration as the node `calibrator` orders it, done in a process of its own.

Such a process can be ended at any time by SIGTERM, gives all its memory back, and leaves the node free to answer. Its
order is its argument; it writes news and the reply to its output, one JSON object per line:

    {"progress": {"message": "fitting 72 touches", "part": 0.3}}
    {"reply": {"folder": "/results", "note": ""}}    the result is in the files of this folder; what was kept of another
    {"error": "…"}                                   there is no result; one line
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any, NamedTuple

from scara_kinetostatic.errors import ScaraKinetostaticError, naming_missing_libraries, one_line
from scara_kinetostatic.threads import process_of_one_thread

UNFIT = 'unfit'
"""Folder, in that of the results, for one that is not fit for use."""
COMMAND = (
    sys.executable,
    '-c',
    'import sys; sys.path[:] = sys.argv[2:]; from scara_kinetostatic.nodes.calibration_job import main; main()',
)
"""Followed by the order, as JSON, and the places of Python modules: that of this package, then those of the node."""
_READ, _FITTED = 0.3, 0.8
"""Parts of the work: after reading, and after the fit."""
PATIENCE = 3.0
"""Time for the process to end by itself after it was told to, s."""


class Job(NamedTuple):
    """What to calibrate.

    Attributes:
        recordings: paths of recordings and touch tables.
        cell: path of the cell description; empty for the one in the recordings.
        fixed: parameters to hold, as the parameter `fixed` has them.
        left_out: touches and recordings to leave out, as the parameter `leave_out` has them.
        output: folder for the results.
        publish_unfit: whether a result that is not fit for use replaces an earlier one.
    """

    recordings: list[str]
    cell: str
    fixed: list[str]
    left_out: list[str]
    output: str
    publish_unfit: bool


def do(job: Job, progress: Callable[[str, float], None]) -> dict[str, str]:
    """Calibrates and writes the files.

    Args:
        job: what to calibrate.
        progress: called with each step and the part of the work that is done, 0 to 1; may end the work.

    Returns:
        `folder` of the files, and `note`: what was kept of an earlier result, empty if nothing.

    Raises:
        ScaraKinetostaticError: there is no result, or its files cannot be written.
    """
    from scara_kinetostatic.pipeline import calibrate_files
    from scara_kinetostatic.results.document import write_results

    has_read = False

    def over_all(step: str, part: float) -> None:  # of reading, then of fitting, each from 0 to 1
        nonlocal has_read
        progress(step, _READ + (_FITTED - _READ) * part if has_read else _READ * part)
        has_read |= part >= 1.0

    outcome = calibrate_files(
        job.recordings,
        Path(job.cell) if job.cell else None,
        job.fixed,
        job.left_out,
        options=('the parameter cell', 'parameter fixed:', 'parameter leave_out'),
        progress=over_all,
    )
    progress('writing the results', _FITTED)
    aside = outcome.assessment.grade.value == UNFIT and not job.publish_unfit
    folder = Path(job.output) / (UNFIT if aside else '')
    return {'folder': str(folder.absolute()), 'note': write_results(outcome, folder).note}


class CalibrationProcess:
    """A calibration that runs.

    Args:
        job: what to calibrate.

    Attributes:
        news: what it has written last; empty at first.
    """

    def __init__(self, job: Job) -> None:
        places = str(Path(__file__).resolve().parents[2]), *filter(None, sys.path)
        self._process = subprocess.Popen(
            [*COMMAND, json.dumps(job._asdict()), *places],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C reaches the node alone, which ends this process
        )
        assert self._process.stdout is not None
        self._stdout, self._said = self._process.stdout, b''
        os.set_blocking(self._stdout.fileno(), False)
        self.news: dict[str, Any] = {}
        self._cancelled_at: float | None = None

    def poll(self) -> dict[str, Any] | None:
        """The reply, without waiting; None while it calibrates.

        Returns:
            As the process writes it; `cancelled` or `error` with the reason where it ended without one.
        """
        if self._cancelled_at is not None and monotonic() > self._cancelled_at + PATIENCE:
            self._process.kill()
        status = self._process.poll()
        *lines, self._said = (self._said + (self._stdout.read() or b'')).split(b'\n')
        self.news = json.loads(lines[-1]) if lines else self.news
        if status is None:
            return None
        self._stdout.close()
        if self.news and 'progress' not in self.news:
            return self.news
        if self._cancelled_at is not None:
            return {'cancelled': 'cancelled; earlier results are unchanged'}
        if status == -signal.SIGKILL:
            return {'error': 'the calibration was killed (SIGKILL); has the memory run out?'}
        return {'error': f'the calibration ended with status {status} and without a reply; see what the node prints'}

    def cancel(self) -> None:
        """Tells the process to end; `poll` says when it has. What it was writing is taken back."""
        self._cancelled_at = self._cancelled_at or monotonic()
        self._process.send_signal(signal.SIGTERM)

    def close(self) -> None:
        """Ends the process, by SIGKILL if need be, and waits for that."""
        self.cancel()
        try:
            self._process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()


def main() -> None:
    """Does the job that is the argument of the process."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what is being written is taken back
    process_of_one_thread()
    output = os.fdopen(os.dup(sys.stdout.fileno()), 'w', encoding='utf-8')
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no reply

    def send(**said: object) -> None:
        output.write(f'{json.dumps(said)}\n')
        output.flush()

    try:
        job = Job(**json.loads(sys.argv[1]))
        with naming_missing_libraries():
            send(reply=do(job, lambda step, part: send(progress={'message': step, 'part': part})))
    except ScaraKinetostaticError as error:
        send(error=str(error))
    except (KeyboardInterrupt, BrokenPipeError):  # told to end, or the node has gone
        os._exit(1)
    except Exception as error:  # the node says so and stays up
        traceback.print_exc()
        send(error=one_line(f'internal error: {type(error).__name__}: {error}'))
