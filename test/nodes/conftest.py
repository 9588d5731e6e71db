"""Every test in a ROS domain of its own."""

from __future__ import annotations

import os
import random
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Event, Thread

import pytest

rclpy = pytest.importorskip('rclpy')

from rclpy.executors import Executor, SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402

from benchmark.cell_nodes import DemoClient, NodeProcesses  # noqa: E402
from scara_kinetostatic.files.cell_file import dump_cell  # noqa: E402
from scara_kinetostatic.model.cell import PAPER_CELL  # noqa: E402
from scara_kinetostatic.nodes.demo import THIS_MACHINE, is_free  # noqa: E402


@pytest.fixture
def domain() -> int:
    """Of the domains of this worker, one that is free: two workers never choose the same one."""
    number = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
    domains = range(1 + number % 8, 100, 8)
    return next(one for one in random.sample(domains, len(domains)) if is_free(one))


@pytest.fixture
def cell_file(tmp_path: Path) -> Path:
    path = tmp_path / 'cell.yaml'
    path.write_text(dump_cell(PAPER_CELL))
    return path


@pytest.fixture
def processes(domain: int, tmp_path: Path) -> Iterator[NodeProcesses]:
    with NodeProcesses(domain, tmp_path / 'logs') as running:
        yield running


@pytest.fixture
def client(domain: int, processes: NodeProcesses) -> Iterator[DemoClient]:
    with DemoClient(domain, processes.check) as watching:
        yield watching


@pytest.fixture
def spin(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Node]]:
    """Makes one node in this process, started with ROS arguments, and spins it in a thread."""
    for name, value in THIS_MACHINE.items():
        monkeypatch.setenv(name, value)
    stop = Event()
    started: list[Thread] = []
    nodes: list[Node] = []

    def make(kind: type[Node], *arguments: str) -> Node:
        rclpy.init(args=list(arguments), domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        nodes.append(kind())
        started.append(Thread(target=_spin, args=(SingleThreadedExecutor(), nodes[-1], stop)))
        started[-1].start()
        return nodes[-1]

    yield make
    stop.set()
    for thread in started:
        thread.join()
    for node in nodes:  # as `nodes.runtime` does, after the last callback
        node.close()
        node.destroy_node()
    rclpy.try_shutdown()


def _spin(executor: Executor, node: Node, stop: Event) -> None:
    executor.add_node(node)
    while not stop.is_set():
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
