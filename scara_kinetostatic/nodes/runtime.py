"""How every node starts, spins and stops: one process, one exit status.

Ctrl-C and SIGTERM are the ordinary way to end a node: `rclpy` shuts the
context down, the executor returns, the node is closed and the status is 0. A
second Ctrl-C while the node closes its files must not break into that, so
Python's own handler is replaced by one that only takes note.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Protocol

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor

from scara_kinetostatic.errors import ScaraKinetostaticError

EXIT_DONE = 0
EXIT_WRONG_INPUT = 2


class Stoppable(Protocol):
    """A node that has something to put away before it goes."""

    def close(self) -> None:
        """Put it away; called once, after the last callback."""

    def destroy_node(self) -> None:
        """Leave the ROS graph."""


def run(
    make_node: Callable[[], Stoppable],
    args: Sequence[str] | None = None,
    make_executor: Callable[[], Executor] = SingleThreadedExecutor,
) -> int:
    """Runs one node until it is told to stop.

    Args:
        make_node: makes the node; its errors are about what it was started with.
        args: command line with the ROS arguments; `sys.argv` if None.
        make_executor: makes the executor that spins the node.

    Returns:
        Exit status: 0 after Ctrl-C or SIGTERM, 2 if a parameter, a file or a
        ROS argument is wrong (one line on stderr says which).
    """
    stopped = _note_signals()
    try:
        rclpy.init(args=args)
        node = make_node()
    except (ScaraKinetostaticError, InvalidParameterTypeException, InvalidParameterValueException) as error:
        return _refuse(str(error))
    except Exception as error:
        if isinstance(error, ExternalShutdownException) or stopped:
            return EXIT_DONE
        if type(error).__module__.startswith('rclpy'):
            return _refuse(f'{type(error).__name__}: {error}')
        raise
    try:
        if not stopped:
            _spin(node, make_executor())
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()
    return EXIT_DONE


def _spin(node: Stoppable, executor: Executor) -> None:
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        executor.shutdown()


def _note_signals() -> list[int]:
    """Replaces Python's handlers by one that fills the returned list; `rclpy` does the rest."""
    seen: list[int] = []

    def note(number: int, _: FrameType | None) -> None:
        seen.append(number)

    signal.signal(signal.SIGINT, note)
    signal.signal(signal.SIGTERM, note)
    return seen


def _refuse(message: str) -> int:
    print(' '.join(message.split()), file=sys.stderr)
    rclpy.try_shutdown()
    return EXIT_WRONG_INPUT
