"""Plays the touches of a plan: travels, approaches, presses until the force is there, holds, retracts.

The controller knows the nominal arm and the declared discs alone. It aims at a point on
the normal of the disc, moves it inwards until the sensed force reaches its level, and then
keeps the motors where they are. A touch with preload is pressed harder first and
eased down to its level, so that the joints come to it from the other side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.kinematics import inverse, wrap
from scara_kinetostatic.simulation.mujoco.engine import TICK, Engine
from scara_kinetostatic.simulation.mujoco.mjcf import LIFT
from scara_kinetostatic.simulation.mujoco.motion import Played, Tick
from scara_kinetostatic.simulation.mujoco.scene import Scene
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.trajectory import (
    APPROACH,
    EASE,
    HOLD,
    PAUSE,
    PRESS,
    RELEASE,
    RETRACT,
    TRAVEL,
    Timing,
    minimum_jerk,
)

Floats = NDArray[np.float64]

DEEPEST = 0.02
"""The controller gives up when it aims this deep into a disc and the force is not there, m."""
GRID = 60
"""Aims between the free pose and the deepest, for which the motor angles are worked out."""
NEAR = 7e-3
"""Closer than this to where the contact is expected the tip goes, m,"""
NEAR_SPEED = 0.01
"""at this speed, m/s, so that it hardly knocks."""
FIRST_FORCE = 0.5
"""Sensed force that ends the approach, N;"""
FIRM_FORCE = 2.0
"""from there the tip creeps on up to this force, N,"""
CREEP_SPEED = 4e-3
"""at this speed, m/s."""
BOUNCE = 0.04
"""Rest between the first contact and the creeping, s."""
FILTER = 0.004
"""Time constant of the controller's filter of the force, s."""
PRESS_SPEED = (2e-4, 0.015)
"""Slowest and fastest aim while it presses, m/s."""
SOFTNESS = (5e-6, 3e-4)
"""Limits of what the controller believes of the compliance it feels, m/N."""
REACTION = 0.05
"""Time constant with which it comes to the level, s."""
CLOSE = 0.005
"""Part of the level by which the force may miss it."""
PATIENCE = 5.0
"""Longest time for a press, s."""
LIFTING = 0.1
"""Time in which the third axis lifts or lowers the tip, s."""


class Player:
    """One pass through a plan.

    Args:
        scene: the robot.
        cell: nominal arm and declared discs.
        plan: the touches.
        timing: how long the phases last; those of the press follow from the force.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: the plan is empty or out of reach.
    """

    def __init__(self, scene: Scene, cell: Cell, plan: Plan, timing: Timing | None = None) -> None:
        self.plan, self.timing = plan, timing or Timing()
        if not len(plan):
            raise UnsupportedDataError('the plan holds no touch', 'plan at least one')
        self._depths = np.linspace(-self.timing.clearance, DEEPEST, GRID)
        self._paths = self._motor_paths(cell)
        self._home = self._paths[[0, -1], 0] + (0.25, -0.15)
        self.engine = Engine(scene, cell, self._home[0])
        self._aim, self._depth, self._lift = self._home[0], 0.0, LIFT
        self._touch, self._phase = 0, TRAVEL
        self._force, self._first, self._softness = 0.0, (0.0, 0.0), SOFTNESS[0]
        self._ticks: list[Tick] = []

    def play(self) -> Played:
        """Plays all touches.

        Raises:
            UnsupportedDataError: a force does not reach its level.
        """
        holds, begins, links, speed = [], [], [], []
        for touch in range(len(self.plan)):
            self._touch = touch
            self._travel(self._paths[self._touch, 0])
            begins.append(self._lower())
            self._come()
            self._rest(HOLD, self.timing.hold)
            holds.append(len(self._ticks) - 1)
            links.append(self.engine.links)
            speed.append(self.engine.speed)
            self._go()
        self._travel(self._home[1])
        return Played.of(self._ticks, TICK, begins, holds, np.array(links), np.array(speed))

    def _motor_paths(self, cell: Cell) -> Floats:
        """Motor angles for the aims of each touch by the nominal arm, (m, GRID, 2), rad."""
        aims = self.plan.contact(cell)[:, None] - self._depths[:, None] * self.plan.normal()[:, None]
        poses = inverse(cell.nominal, aims, self.plan.posture[:, None])
        lost = np.flatnonzero(~np.isfinite(poses).all(axis=(1, 2)))
        if len(lost):
            raise UnsupportedDataError(
                f'the nominal arm cannot press touch {lost[0]} of the plan', 'leave it out, or move the disc'
            )
        return poses[:, :1] + wrap(poses - poses[:, :1])

    def _tick(self, progress: float = 0.0) -> None:
        self.engine.command(self._aim, self._lift)
        self.engine.advance()
        force = self.engine.force()
        self._force += TICK / (TICK + FILTER) * (float(np.hypot(*force)) - self._force)
        self._ticks.append(Tick(self.engine.joints, force, self.engine.link2_angle, self._touch, self._phase, progress))

    def _at(self, depth: float) -> Floats:
        path = self._paths[self._touch]
        return np.array([np.interp(depth, self._depths, path[:, joint]) for joint in (0, 1)])

    def _travel(self, goal: Floats) -> None:
        self._phase, start = TRAVEL, self._aim
        distance = float(np.abs(goal - start).max())
        for part in _law(max(self.timing.travel, distance / self.timing.speed)):
            self._aim = start + part * (goal - start)
            self._tick(part)

    def _raise(self, lift: float) -> None:
        start = self._lift
        for part in _law(LIFTING):
            self._lift = start + part * (lift - start)
            self._tick()

    def _rest(self, phase: int, duration: float) -> None:
        self._phase = phase
        for _ in range(round(duration / TICK)):
            self._tick()

    def _lower(self) -> int:
        """Lowers the tip beside the disc; returns the number of the tick then."""
        self._phase = PAUSE
        self._raise(0.0)
        self._rest(PAUSE, self.timing.pause)
        return len(self._ticks) - 1

    def _come(self) -> None:
        """From the free pose to the force of the hold."""
        speed, passed = self.timing.clearance / self.timing.approach, 0.0
        self._phase, self._depth = APPROACH, -self.timing.clearance
        while self._force < FIRST_FORCE:
            passed += TICK
            self._deepen(NEAR_SPEED if self._depth > -NEAR else speed * min(1.0, passed / LIFTING))
        self._rest(PRESS, BOUNCE)
        while self._force < FIRM_FORCE:
            self._deepen(CREEP_SPEED)
        self._first, self._softness = (self._depth, self._force), SOFTNESS[0]
        level, beyond = float(self.plan.force[self._touch]), float(self.plan.preload[self._touch])
        self._press((1.0 + beyond) * level)
        if beyond:
            self._phase = EASE
            self._press(level)

    def _deepen(self, speed: float) -> None:
        self._depth += speed * TICK
        if self._depth > DEEPEST:
            raise UnsupportedDataError(
                f'touch {self._touch} of the plan: the force is not there {1e3 * DEEPEST:.0f} mm inside the disc',
                'check the discs, or play a stiffer robot',
            )
        self._aim = self._at(self._depth)
        self._tick()

    def _press(self, level: float) -> None:
        """Moves the aim, ever in the same sense, until the force reaches a level."""
        sense, (depth, force) = np.sign(level - self._force), self._first
        for _ in range(round(PATIENCE / TICK)):
            missing = sense * (level - self._force)
            if missing < CLOSE * level:
                return
            if sense > 0 and self._force > force + FIRM_FORCE:
                self._softness = float(np.clip((self._depth - depth) / (self._force - force), *SOFTNESS))
            self._deepen(sense * float(np.clip(missing * self._softness / REACTION, *PRESS_SPEED)))
        raise UnsupportedDataError(
            f'touch {self._touch} of the plan: the force stays at {self._force:.1f} N instead of {level:.1f} N',
            'play a robot with less friction, or a stiffer one',
        )

    def _go(self) -> None:
        """Retracts and lifts the tip."""
        start, goal = self._depth, -self.timing.clearance
        for part in _law(self.timing.release + self.timing.retract):
            self._phase = RELEASE if self._ticks[-1].force.any() else RETRACT
            self._aim = self._at(start + part * (goal - start))
            self._tick()
        self._phase = RETRACT
        self._raise(LIFT)


def _law(duration: float) -> Floats:
    """The minimum-jerk law at each tick of a movement, (k,), the last one 1."""
    return minimum_jerk(np.linspace(0.0, 1.0, max(2, round(duration / TICK)) + 1)[1:])
