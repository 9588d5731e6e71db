"""Start, spin and stop of every node: one process, one exit status.

Ctrl-C and SIGTERM are the ordinary way to end a node. By default `rclpy` shuts the context down in the middle of a
callback. Here the signals are only noted; the node ends between two callbacks, closes its files, and a second Ctrl-C
does not interrupt that. `ros2 launch` always sends a second one, which often arrives after the interpreter has
restored its handlers; so at the end both signals are ignored.
"""

from __future__ import annotations

import gc
import re
import signal
import sys
from itertools import chain, pairwise

import rclpy
from rclpy._rclpy_pybind11 import RCLError, UnknownROSArgsError
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from scara_kinetostatic.errors import ScaraKinetostaticError, did_you_mean, naming_missing_libraries
from scara_kinetostatic.files.yaml_file import node_sections
from scara_kinetostatic.nodes.cell_node import PARAMETERS, CellNode
from scara_kinetostatic.nodes.executables import ENDING


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
        files = {file: node_sections(file) for option, file in pairwise(sys.argv) if option == '--params-file'}
        with naming_missing_libraries():
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
    say_what_is_unused(node, files)
    gc.freeze()  # what is there stays and is no garbage
    gc.set_threshold(10_000)  # a search takes milliseconds
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        while not signals and rclpy.ok() and node.exit_status is None:
            node.spin(executor)
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


def say_what_is_unused(node: CellNode, files: dict[str, dict[str, re.Pattern[str]]]) -> None:
    """Warns of parameter files without a section for a node, and of parameters given that no node has.

    Args:
        node: that was started with them.
        files: the sections of each, see `node_sections`.
    """
    name, say = node.get_fully_qualified_name(), node.get_logger().warning
    for file, sections in files.items():
        if not any(pattern.match(name) for pattern in sections.values()):
            say(f'{file}: nothing in it is for {name}; it has {" ".join(sections) or "no section"}')
    of_any = {*chain(*PARAMETERS.values())}  # a section may be for several nodes, a result for all
    for given in sorted(node._parameter_overrides.keys() - of_any):
        if not (node.has_parameter(given) or given.startswith(('calibrated', 'calibration.'))):
            say(f'parameter {given}: no node has it; {did_you_mean(given, node.stated)}')


def _ignore_signals() -> None:
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
