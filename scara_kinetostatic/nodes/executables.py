"""The executables of the nodes: signals are caught before the imports, which take seconds on a busy machine.

Until a node has handlers of its own (`runtime`), a signal ends the process at once with status 0: no file is open yet,
and nothing has been said. This module imports nothing of its own package or of ROS.
"""

from __future__ import annotations

import os
import signal
from importlib import import_module
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM)
"""The ordinary way to end a node."""


def contact_simulator() -> int:
    """Runs the simulator."""
    return _run('contact_simulator')


def collector() -> int:
    """Runs the collector."""
    return _run('collector')


def calibrator() -> int:
    """Runs the calibrator."""
    return _run('calibrator')


def visualizer() -> int:
    """Runs the visualizer."""
    return _run('visualizer')


def monitor() -> int:
    """Runs the drift monitor."""
    return _run('monitor')


def compensator() -> int:
    """Runs the compensator."""
    return _run('compensator')


def contour_tracker() -> int:
    """Runs the contour tracker."""
    return _run('contour_tracker')


def _run(name: str) -> int:
    catch_signals()
    return int(import_module(f'scara_kinetostatic.nodes.{name}').main())


def catch_signals() -> None:
    """Lets a signal end the process at once until the node has handlers of its own."""
    for number in ENDING:
        signal.signal(number, _end)


def _end(_number: int, _: FrameType | None) -> None:
    """Not by an exception: code that is being imported could catch it, or print it."""
    os._exit(0)
