"""The process in which a calibration runs, as the node `calibrator` sees it: start, news, end."""

from __future__ import annotations

import json
import queue
import signal
import subprocess
import sys
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import Any, NamedTuple

from scara_kinetostatic.errors import one_line
from scara_kinetostatic.nodes.calibration_job import Job, Reply

COMMAND = (
    sys.executable,
    '-c',
    'import sys; sys.path[:] = sys.argv[1:]; from scara_kinetostatic.nodes.calibration_job import main; main()',
)
"""Followed by the places of Python modules: those of the node, and not the folder in which it was started."""
_PACKAGES = str(Path(__file__).resolve().parents[2])
"""Where this package is, which may be that folder: before the others, so that no other version of it is taken."""
PATIENCE = 3.0
"""Time for the process to end by itself after it was told to, s."""
CANCELLED = 'cancelled; earlier results are unchanged'
"""Why there is no reply after `CalibrationProcess.cancel`."""


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
            [*COMMAND, _PACKAGES, *filter(None, sys.path)],
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
