"""Every test in a ROS domain of its own."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')

from nodes.waiting import Bench  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402

import scara_kinetostatic as sk  # noqa: E402
from benchmark.cell_nodes import DemoClient, NodeProcesses  # noqa: E402
from scara_kinetostatic.files.calibration_file import arm_document  # noqa: E402
from scara_kinetostatic.files.cell_file import dump_cell  # noqa: E402
from scara_kinetostatic.model.arm import CalibratedArm  # noqa: E402
from scara_kinetostatic.model.cell import PAPER_CELL, Cell, Sensor  # noqa: E402
from scara_kinetostatic.nodes.cell_node import CellNode  # noqa: E402
from scara_kinetostatic.nodes.demo import THIS_MACHINE, own_domain, ros_value  # noqa: E402


@pytest.fixture
def domain() -> Iterator[int]:
    """One that nothing else on this machine has, whatever it runs beside these tests."""
    with own_domain() as number:
        yield number


def begin(domain: int, *arguments: str, **parameters: object) -> None:
    """Begins ROS with arguments and parameters of the nodes to come, on this machine only."""
    os.environ.update(THIS_MACHINE)
    given = [part for name, value in parameters.items() for part in ('-p', f'{name}:={ros_value(value)}')]
    options = {'domain_id': domain, 'signal_handler_options': SignalHandlerOptions.NO}
    rclpy.init(args=['--ros-args', *arguments, *given], **options)


@pytest.fixture
def bench(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """Makes one bench of a node, with ROS arguments and parameters; what it does every second, it does ten times."""
    made: list[Bench] = []
    every = CellNode.every
    monkeypatch.setattr(CellNode, 'every', lambda node, period, do: every(node, min(period, 0.1), do))

    def make(kind: type[Node], *arguments: str, on: type[Bench] = Bench, **parameters: object) -> Bench:
        begin(domain, *arguments, **parameters)
        made.append(on(kind()))
        return made[-1]

    yield make
    for each in made:
        each.close()
    rclpy.try_shutdown()


@pytest.fixture(scope='session')
def arm() -> CalibratedArm:
    """A calibration of the example cell."""
    cell = replace(PAPER_CELL, sensor=Sensor(), tip_radius=0.005)
    calibration = sk.calibrate(sk.simulate(cell, sk.PAPER_ACTUAL), cell)
    return replace(calibration.arm, grade='fit', created='2026-01-01T00:00:00Z')


@pytest.fixture
def arm_file(arm: CalibratedArm, tmp_path: Path) -> Callable[..., Path]:
    """Writes it, as that of another cell."""

    def write(cell: Cell = arm.cell) -> Path:
        path = tmp_path / 'calibration.json'
        path.write_text(json.dumps(arm_document(replace(arm, cell=cell))))
        return path

    return write


@pytest.fixture
def cell_in(tmp_path: Path) -> Callable[..., Path]:
    """Writes a cell description."""

    def write(cell: Cell = PAPER_CELL, **changes: Any) -> Path:
        path = tmp_path / 'cell.yaml'
        path.write_text(dump_cell(replace(cell, **changes)))
        return path

    return write


@pytest.fixture
def cell_file(cell_in: Callable[..., Path]) -> Path:
    return cell_in()


@pytest.fixture
def processes(domain: int, tmp_path: Path) -> Iterator[NodeProcesses]:
    with NodeProcesses(domain, tmp_path / 'logs') as running:
        yield running


@pytest.fixture
def client(domain: int, processes: NodeProcesses) -> Iterator[DemoClient]:
    with DemoClient(domain, processes.check) as watching:
        yield watching
