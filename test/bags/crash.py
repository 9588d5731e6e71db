"""A recording whose process dies; run by `test_bag_writer` as a program of its own.

`crash.py FOLDER`: records the same run again and again, each time in a child process that dies just before its k-th
dealing with the file system, for k = 0, 1, …; prints for each how many messages had been secured, and in the end
`done`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from bags.forms import CELL, make_streams, messages
from bags.forms import record as write

from scara_kinetostatic.bags.writer import BagWriter

DEATH = 9


def record(folder: Path, report: Callable[[int], None]) -> None:
    """A run of 80 messages with a checkpoint every 32."""
    items = messages(make_streams(40, 40))
    with BagWriter(folder, CELL, log_time=items[0].log_time) as bag:
        for count, item in enumerate(items, start=1):
            write(bag, [item])
            if count % 32 == 0:
                bag.checkpoint()
                report(bag.recorded)


def die_at(step: int, last_words: Callable[[], None]) -> None:
    """Let the process die at once, without any cleaning up, before its `step`-th dealing with the file system."""
    left = [step]

    def deadly(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(*args: Any, **options: Any) -> Any:
            if left[0] == 0:
                last_words()
                os._exit(DEATH)
            left[0] -= 1
            return function(*args, **options)

        return wrapper

    for name in ('mkdir', 'open', 'rename', 'replace', 'unlink'):
        setattr(Path, name, deadly(getattr(Path, name)))
    for name in ('fsync', 'open', 'link'):
        setattr(os, name, deadly(getattr(os, name)))


def child(folder: Path, step: int, pipe: int) -> None:
    """One run; how many messages were secured goes into the pipe."""
    secured = [0]

    def last_words() -> None:
        os.write(pipe, str(secured[-1]).encode())

    die_at(step, last_words)
    record(folder, secured.append)
    last_words()
    os._exit(0)


def steps(parent: Path) -> None:
    for step in range(1000):
        reading, writing = os.pipe()
        process = os.fork()
        if process == 0:
            child(parent / f'run{step}', step, writing)
        os.close(writing)
        print(step, int(os.read(reading, 100)), flush=True)
        os.close(reading)
        if os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 0:
            break
    print('done')


if __name__ == '__main__':
    steps(Path(sys.argv[1]))
