"""A robot that obeys commands, for the tests of the runner: joints with a lag, contact by the model, a sensor with bias."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorFrame, SensorSign
from scara_kinetostatic.model.contact import contact
from scara_kinetostatic.model.kinematics import forward, rotate
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.running.commands import Command

LAG = 0.02


class Plant:
    """A robot in its cell."""

    def __init__(self, cell: Cell, truth: Parameters, joints: Floats, seed: int = 0, discs=None) -> None:
        self.cell, self.truth = cell, truth
        self.discs = cell.discs if discs is None else discs
        self.random = np.random.default_rng(seed)
        self.names = [*cell.joint_names, *([cell.lift.joint] if cell.lift else []), *cell.hold]
        lift = [cell.lift.down] if cell.lift else []
        self.wanted = np.array([*joints, *lift, *cell.hold.values()], dtype=float)
        self.at = self.wanted.copy()
        self.times, self.positions = np.array([0.0]), self.wanted[None].copy()
        self.now = self.peak = 0.0
        self.force = np.zeros(2)
        self.bias = self.random.normal(size=2) * 1.4
        self.errors = np.zeros(2), np.zeros(2)
        self.touching = False
        self.touched: list[int] = []
        self.joint_noise = cell.noise.joint_rms
        self.force_noise = cell.noise.force_rms

    def obey(self, command: Command) -> None:
        assert list(command.names) == self.names
        self.times = np.append(self.now, self.now + command.times)
        self.positions = np.vstack([self.wanted, command.positions])

    def step(self, dt: float) -> None:
        self.now += dt
        self.wanted = np.array([np.interp(self.now, self.times, column) for column in self.positions.T])
        self.at += (self.wanted - self.at) * (1 - np.exp(-dt / LAG))
        self.force = self._contact()
        self.peak = max(self.peak, float(np.hypot(*self.force)))

    def _contact(self) -> Floats:
        joints = self.at[:2]
        raised = self.cell.lift is not None and self.at[2] > 0.5 * (self.cell.lift.up + self.cell.lift.down)
        tip = forward(self.truth, joints[None])[0]
        for number, disc in enumerate(self.discs):
            near = np.hypot(tip[0] - disc.x, tip[1] - disc.y) < disc.radius + 1e-4
            if near and not raised:
                found = contact(self.truth, joints[None], np.array([[disc.x, disc.y]]), np.array([disc.radius]))
                if found.magnitude[0] > 0:
                    if not self.touching:
                        self.touching = True
                        self.touched.append(number)
                        self.errors = self.random.normal(size=(2, 2)) * [[self.joint_noise], [self.force_noise]]
                    return found.force[0]
        self.touching = False
        return np.zeros(2)

    def read(self) -> tuple[Floats, Floats]:
        """Joint angles and force as the sensors report them."""
        joints = self.at[:2] + self.errors[0]
        force = self.force + self.errors[1] * min(1.0, np.hypot(*self.force) / 20)
        if self.cell.sensor.frame is SensorFrame.TOOL:
            p = self.truth
            force = rotate(force[None], -np.array([joints.sum() + p.theta1 + p.theta2]))[0]
        if self.cell.sensor.sign is SensorSign.ON_ROBOT:
            force = -force
        return joints, force + self.bias + self.random.normal(size=2) * 0.05
