"""The executables of the nodes: signals are caught before the imports, which take seconds on a busy machine.

Until a node has handlers of its own (`runtime`), a signal ends the process at once with status 0: no file is open yet,
and nothing has been said. This module imports nothing of ROS, or that takes time.
"""

from __future__ import annotations

import os
import signal
import sys
from functools import partial
from importlib import import_module
from types import FrameType

from scara_kinetostatic.threads import process_of_one_thread

ENDING = (signal.SIGINT, signal.SIGTERM)
"""The ordinary way to end a node."""


def _run(name: str, kind: str) -> int:
    for number in ENDING:
        signal.signal(number, _end)
    process_of_one_thread()
    from scara_kinetostatic.errors import MissingLibraryError, naming_missing_libraries

    try:
        with naming_missing_libraries():
            runtime, module = (import_module(f'scara_kinetostatic.nodes.{each}') for each in ('runtime', name))
            return int(runtime.run(getattr(module, kind)))
    except MissingLibraryError as error:
        print(error, file=sys.stderr)
        return 2


def _end(_number: int, _: FrameType | None) -> None:
    """Not by an exception: code that is being imported could catch it, or print it."""
    os._exit(0)


contact_simulator = partial(_run, 'contact_simulator', 'ContactSimulator')
collector = partial(_run, 'collector', 'Collector')
calibrator = partial(_run, 'calibrator', 'Calibrator')
visualizer = partial(_run, 'visualizer', 'Visualizer')
monitor = partial(_run, 'monitor', 'Monitor')
compensator = partial(_run, 'compensator', 'Compensator')
contour_tracker = partial(_run, 'contour_tracker', 'ContourTracker')
touch_runner = partial(_run, 'touch_runner', 'TouchRunner')
