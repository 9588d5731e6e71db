"""Start, spin and stop of every node: one process, one exit status.

Ctrl-C and SIGTERM are the ordinary way to end a node. By default `rclpy` shuts the context down in the middle of a
callback. Here the signals are only noted; the node ends between two callbacks, closes its files, and a second Ctrl-C
does not interrupt that. `ros2 launch` always sends a second one, which often arrives after the interpreter has
restored its handlers; so at the end both signals are ignored.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Protocol

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.nodes.executables import ENDING

EXIT_DONE = 0
EXIT_WRONG_INPUT = 2
LAST_ANSWERS = 3
"""Callbacks after a node has closed: answers of services that were waiting for something that now will not come."""
WAKE_UP = 0.2
"""Longest time from a signal to its effect, s."""


class Stoppable(Protocol):
    """A node that has files or threads to close before it ends."""

    def close(self) -> None:
        """Closes them; called once, after the last callback has begun."""

    def destroy_node(self) -> None:
        """Leave the ROS graph."""


def run(
    make_node: Callable[[], Stoppable],
    args: Sequence[str] | None = None,
    make_executor: Callable[[], Executor] = SingleThreadedExecutor,
    rest: float = 0.0,
) -> int:
    """Runs one node until a signal ends it.

    Args:
        make_node: makes the node; its errors are those of parameters and files.
        args: command line with the ROS arguments; `sys.argv` if None.
        make_executor: makes the executor that spins the node.
        rest: between two callbacks, s. A round of the executor costs several times as much as a message; a node that
            takes all waiting messages of a topic at once needs less time if several are waiting.

    Returns:
        Exit status: 0 after Ctrl-C or SIGTERM, 2 if a parameter, a file or a
        ROS argument is wrong (one line on stderr says which).
    """
    signals = _note_signals()
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = make_node()
    except (ScaraKinetostaticError, ParameterException) as error:
        return _refuse(str(error))
    except (RCLError, UnknownROSArgsError) as error:
        return _refuse(f'ROS arguments: {error}')
    executor = make_executor()
    executor.add_node(node)
    try:
        while not signals and rclpy.ok():
            executor.spin_once(timeout_sec=WAKE_UP)
            if rest:
                time.sleep(rest)
    except ExternalShutdownException:
        pass
    finally:
        node.close()
        for _ in range(LAST_ANSWERS):
            executor.spin_once(timeout_sec=0)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        _ignore_signals()
    return EXIT_DONE


def _refuse(message: str) -> int:
    print(' '.join(message.split()), file=sys.stderr)
    rclpy.try_shutdown()
    _ignore_signals()
    return EXIT_WRONG_INPUT


def _note_signals() -> list[int]:
    """Replaces Python's handlers by one that fills the returned list."""
    seen: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        seen.append(number)

    for number in ENDING:
        signal.signal(number, note)
    return seen


def _ignore_signals() -> None:
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
