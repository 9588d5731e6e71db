"""Start, spin and stop of every node: one process, one exit status.

Ctrl-C and SIGTERM are the ordinary way to end a node. By default `rclpy` shuts the context down in the middle of a
callback. Here the signals are only noted; the node ends between two callbacks, closes its files, and a second Ctrl-C
does not interrupt that. `ros2 launch` always sends a second one, which often arrives after the interpreter has
restored its handlers; so at the end both signals are ignored.
"""

from __future__ import annotations

import gc
import signal
import sys
import time
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError, WaitSet
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.constants import S_TO_NS
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, ShutdownException, SingleThreadedExecutor, TimeoutException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from scara_kinetostatic.errors import ScaraKinetostaticError
from scara_kinetostatic.nodes.cell_node import CellNode
from scara_kinetostatic.nodes.executables import ENDING

_SERVE = 0.25
"""Between two rounds for timers and services of a polled node, s; while they wait, with each message."""


def run(kind: type[CellNode]) -> int:
    """Runs one node until a signal ends it, or it has done what it had to.

    Args:
        kind: of the node; the errors of its constructor are those of parameters and files.

    Returns:
        Exit status: 0 after Ctrl-C or SIGTERM, that of a node which ends by itself, 2 if a parameter, a file or a
        ROS argument is wrong (one line on stderr says which).
    """
    signals: list[int] = []
    for number in ENDING:
        signal.signal(number, lambda received, _: signals.append(received))
    problem = ''
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        node: CellNode = kind()
    except (ScaraKinetostaticError, ParameterException) as error:
        problem = str(error)
    except (RCLError, UnknownROSArgsError) as error:
        problem = f'ROS arguments: {error}'
    if problem:
        print(' '.join(problem.split()), file=sys.stderr)
        rclpy.try_shutdown()
        _ignore_signals()
        return 2
    executor = node.executor_type()
    executor.add_node(node)
    try:
        while not signals and rclpy.ok() and node.exit_status is None:
            executor.spin_once(timeout_sec=0.2)  # the longest time from a signal to its effect
            time.sleep(node.rest)
    except ExternalShutdownException:
        pass
    finally:
        node.close()
        for _ in range(3):  # answers of services that were waiting for something that now will not come
            executor.spin_once(timeout_sec=0)
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown()
        _ignore_signals()
    return node.exit_status or 0


def _ignore_signals() -> None:
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


class PolledGroup(ReentrantCallbackGroup):
    """Of subscriptions that no executor waits for."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False


class PollingExecutor(SingleThreadedExecutor):
    """Waits for one subscription of its node, calls `poll`, and now and then what waits besides.

    The wait is on one entity, and its set is made once; an executor makes one of all entities in each round.
    """

    def __init__(self) -> None:
        super().__init__()
        self._polled: Any = None
        self._wait_set: Any = None
        self._next = 0.0

    def add_node(self, node: Node) -> bool:
        """The one node, with `awaited`, a subscription, and `poll`; what is there stays and is no garbage."""
        self._polled, self._wait_set = node, WaitSet(1, 0, 0, 0, 0, 0, self._context.handle)
        gc.freeze()
        gc.set_threshold(10_000)  # a sample leaves nothing; a search takes milliseconds
        return bool(super().add_node(node))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """One round."""
        if timeout_sec:
            self._wait(min(timeout_sec, max(self._next - time.monotonic(), 0.0)))  # not while a call is waiting
            self._polled.poll()
        if not timeout_sec or time.monotonic() >= self._next:
            found = self._serve() or self._serve()  # the first may only have ended the round before
            self._next = time.monotonic() + (0.0 if found else _SERVE)

    def _serve(self) -> bool:
        """One callback of what waits besides; whether there was one."""
        try:
            handler, _, _ = self.wait_for_ready_callbacks(timeout_sec=0)
        except (TimeoutException, ShutdownException):
            return False
        handler()
        if (error := handler.exception()) is not None:
            raise error
        return True

    def _wait(self, timeout: float) -> None:
        with self._polled.awaited.handle:
            self._wait_set.clear_entities()
            self._wait_set.add_subscription(self._polled.awaited.handle)
            self._wait_set.wait(int(timeout * S_TO_NS))
