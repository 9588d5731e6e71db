"""A closed loop on this machine: a simulated robot that is commanded, and the runner that makes it touch by itself.

Both nodes are spun in turn by one executor: simulated time passes as fast as both can, and never while the runner is
busy. On the way between them is nothing but ROS topics, in a domain of their own.
"""

from __future__ import annotations

import os
import random
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.signals import SignalHandlerOptions

from scara_kinetostatic.errors import InputError, UnsupportedDataError
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.nodes.cell_node import CellNode
from scara_kinetostatic.nodes.contact_simulator import ContactSimulator
from scara_kinetostatic.nodes.touch_runner import RESULT, TouchRunner
from scara_kinetostatic.results.document import YAML, StoredResult, load_result
from scara_kinetostatic.simulation.commanded import DEMO_CELL

RATE = 125.0
"""Of both sensors, Hz."""
THIS_MACHINE = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
"""Environment of nodes that look for others on this machine only."""


class DemoResult(NamedTuple):
    """The result of a demonstration.

    Attributes:
        message: why the run ended.
        truth: the true parameters of the simulator, (12,).
        estimate: what the calibration found.
        recording: folder of the bag.
        results: folder of the report.
    """

    message: str
    truth: list[float]
    estimate: StoredResult
    recording: Path
    results: Path


Progress = Callable[[int, float | None, str], None]
"""Called with the number of touches so far, the largest expanded uncertainty of the tip by those that are calibrated
already, m, None before the first calibration, and the last touch, and why it was made.
"""


def run_demo(folder: Path, cell: Cell | None, settings: Mapping[str, object], progress: Progress) -> DemoResult:
    """A simulated robot touches by itself, and is calibrated.

    Args:
        folder: where everything goes.
        cell: None for `DEMO_CELL`.
        settings: further parameters of the simulator.
        progress: called with each touch.

    Raises:
        InputError: a parameter or the cell is wrong.
        UnsupportedDataError: the run was given up, or there is no calibration.
    """
    path = folder / 'cell.yaml'
    path.write_text(dump_cell(cell or DEMO_CELL), encoding='utf-8')
    simulated = {'commanded': True, 'publish_clock': True, 'joint_rate': RATE, 'wrench_rate': RATE, **settings}
    running = {'autostart': True, 'exit_when_done': True, 'use_sim_time': True, 'output': folder}
    given = {'cell': path, **{f'contact_simulator:{name}': value for name, value in simulated.items()}}
    given |= {f'touch_runner:{name}': value for name, value in running.items()}
    arguments = [part for name, value in given.items() for part in ('-p', f'{name}:={ros_value(value)}')]
    os.environ.update(THIS_MACHINE)
    nodes: list[CellNode] = []
    with own_domain() as domain:
        arguments = ['--ros-args', '--log-level', 'error', *arguments]
        rclpy.init(args=arguments, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        try:
            nodes.append(ContactSimulator())
            nodes.append(runner := TouchRunner())
            truth = [nodes[0].get_parameter(f'truth.{name}').value for name in NAMES]
            state = _spin(nodes[0], runner, progress)
        except ParameterException as error:
            raise InputError('demo', str(error)) from error
        finally:
            for node in nodes:
                node.close()
                node.destroy_node()
            rclpy.try_shutdown()
            set_logger_level('', LoggingSeverity.INFO)  # it belongs to the process
    results = folder / RESULT
    if not (results / YAML).exists():
        raise UnsupportedDataError(f'touch_runner: {state["text"]}; {state["result"]}')
    return DemoResult(state['text'], truth, load_result(results / YAML), Path(state['recording']), results)


@contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain that no process on this machine uses, chosen at random, and kept from others that look for one.

    Two that look at the same time would both find the ports of DDS free until the first participant has bound them,
    seconds later where a process is started: the one who holds TCP port 7400 + 250 d, of which DDS makes no use, has
    the domain. Where all 99 are taken it is shared.
    """
    domains = random.sample(range(1, 100), 99)  # their ports lie below the ones that Linux hands out
    with socket.socket() as lock:
        yield next((one for one in domains if is_free(one) and not _is_taken(lock, 7400 + 250 * one)), domains[0])


def is_free(domain: int) -> bool:
    """Whether nobody holds the domain (`own_domain`) and its ports (DDSI-RTPS) are free: 7400 + 250 d, and 7410 + 250 d
    of its first participant, which alone is bound where a process discovers others on this machine only.
    """
    for kind, port in ((socket.SOCK_STREAM, 7400), (socket.SOCK_DGRAM, 7400), (socket.SOCK_DGRAM, 7410)):
        with socket.socket(socket.AF_INET, kind) as probe:
            if _is_taken(probe, port + 250 * domain):
                return False
    return True


def _is_taken(probe: socket.socket, port: int) -> bool:
    try:
        probe.bind(('', port))
    except OSError:
        return True
    return False


def ros_value(value: object) -> str:
    """A value as ROS reads it from the command line: strings in quotes, numbers and switches plain."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, (int, float)) else "'" + str(value).replace("'", "''") + "'"


def _spin(simulator: CellNode, runner: TouchRunner, progress: Progress) -> dict[str, str]:
    """Both nodes in turn until the run has ended; returns the last state of the runner."""
    executor, touch, accepted, recording = SingleThreadedExecutor(), '', 0, ''
    for node in (simulator, runner):
        executor.add_node(node)
    while runner.exit_status is None:
        executor.spin_once(timeout_sec=0.1)
        facts = runner.facts()
        if int(facts.get('accepted', 0)) > accepted:
            accepted, found = int(facts['accepted']), facts['uncertainty_m']
            progress(accepted, float(found) if found else None, touch)
        if 'next' in facts:
            touch = f'{facts["next"]}: {facts["why"]}'
        recording = facts['recording'] or recording
    executor.shutdown()
    return runner.facts() | {'recording': recording}
