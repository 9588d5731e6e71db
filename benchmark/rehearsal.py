"""A run in a simulated cell, as fast as the machine allows: runner, plant, the collector's detection, one clock."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.planning.next_touches import Planner
from scara_kinetostatic.running.robot import Command
from scara_kinetostatic.running.runner import Runner, Status
from scara_kinetostatic.simulation.commanded import Plant, Reading
from scara_kinetostatic.touches.online import OnlineDetector

_EPOCH = 1_000_000_000
"""Stamp of the first sample, ns: a stamp of 0 is none."""


class Rehearsal:
    """A run.

    Args:
        cell: as described.
        plant: the robot.
        most: accepted touches after which it ends.
        rate: samples of both sensors per second.
        planner: to begin with.
        calibrating: simulated time that a calibration takes, s.
        patience: of the runner, s.

    Attributes:
        runner: the runner.
        plant: as given.
        history: time, s, and status, whenever that changes.
        contacts: names of the objects touched: of what was meant, empty where nothing was, and of what was met.
        fastest: largest speed of the joints that was seen, rad/s.
    """

    def __init__(
        self,
        cell: Cell,
        plant: Plant,
        most: int = 100,
        rate: float = 250.0,
        planner: Planner | None = None,
        calibrating: float = 4.0,
        patience: float = 0.0,
    ) -> None:
        self.cell, self.plant = cell, plant
        self._detector = OnlineDetector(cell)
        self.runner = Runner(cell, most, self._detector.poll, self._work, planner, patience)
        self.history: list[tuple[float, Status]] = []
        self.contacts: list[tuple[str, str]] = []
        self.fastest = 0.0
        self.time = plant.time
        self._period, self._touched = 1 / rate, ''
        self._before: Floats | None = None
        self._calibrating = calibrating
        self._found: list[tuple[float, Callable[[], Any]]] = []

    def _work(self, do: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Does it now, and gives the result later."""
        future: Future[Any] = Future()
        try:
            found = do(*arguments)
            self._found.append((self.time + self._calibrating, lambda: future.set_result(found)))
        except Exception as error:  # as an executor does
            self._found.append((self.time, partial(future.set_exception, error)))
        return future

    def step(self) -> Command | None:
        """One sample of the sensors, and what the runner makes of it."""
        reading = self.plant.step(self.time + self._period)
        self.time = self.plant.time
        self.hear(reading)
        return self.answer()

    def hear(self, reading: Reading) -> None:
        """The runner and the detection hear of a sample, now."""
        stamp = _EPOCH + round(1e9 * reading.time)
        runner, senses = self.runner, self.runner.senses
        if reading.joints is not None:
            joints, others = self.cell.angles(np.array(reading.joints[:2])), reading.joints[2:]
            angles = joints.tolist()
            moved = [
                f'expected {name} at {wanted:g}, got {at:.3g}'
                for (name, wanted), at in zip(
                    self.cell.hold.items(), others[len(others) - len(self.cell.hold) :], strict=True
                )
                if abs(at - wanted) > 1e-3
            ]
            senses.add_joints(self.time, reading.time, angles, others[0] if self.cell.lift else None)
            if moved:
                senses.refuse(moved[0], moved=True)
            else:
                self._detector.add_joint_state(stamp, angles, _EPOCH + round(1e9 * self.time))
            if self._before is not None:
                self.fastest = max(self.fastest, float(np.abs(joints - self._before).max()) / self._period)
            self._before = joints
        if reading.force is not None:
            senses.add_force(self.time, reading.time, reading.force)
            self._detector.add_wrench(stamp, reading.force, _EPOCH + round(1e9 * self.time))
        if reading.touched and not self._touched:
            target = runner.target
            meant = '' if target is None else self.cell.discs[target.place()[0]].name
            self.contacts.append((meant, reading.touched))
        self._touched = reading.touched

    def answer(self) -> Command | None:
        """What the runner makes of what it has heard, carried out."""
        while self._found and self.time >= self._found[0][0]:
            self._found.pop(0)[1]()
        command = self.runner.tick(self.time)
        if command is not None:
            with suppress(ParameterError):  # its drives have stopped
                self.plant.command(command.names, *(part.tolist() for part in command[1:]))
        if not self.history or self.history[-1][1] is not self.runner.status:
            self.history.append((self.time, self.runner.status))
        return command

    def run(self, until: Callable[[Rehearsal], bool] | None = None, longest: float = 3600.0) -> None:
        """Goes on until the run is over, a condition holds or a time is over, s."""
        began = self.time
        while not self.runner.is_over and self.time - began < longest and not (until and until(self)):
            self.step()
