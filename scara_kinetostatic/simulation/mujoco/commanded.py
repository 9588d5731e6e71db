"""The robot of a scene in MuJoCo as the body of a commanded cell."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, SensorFrame
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.simulation.mujoco.engine import LIFT, TICK, Engine, Scene, load_engine


class EngineBody:
    """A `simulation.commanded.Body`.

    Args:
        scene: the robot and its discs as they truly are.
        cell: with the discs.

    Attributes:
        joints: angles of the motors, rad.
        force: of the tip on what it touches, base frame, N.
        touched: name of the disc, empty in free motion.

    Raises:
        InputError: MuJoCo is not installed, or the cell has obstacles.
    """

    tick = TICK

    def __init__(self, scene: Scene, cell: Cell) -> None:
        load_engine()
        if cell.obstacles:
            raise CellError('obstacles', 'the physics engine has discs only', 'leave them out')
        self._scene, self._cell = scene, cell
        self.begin((0.0, 0.0), 1.0)

    def begin(self, joints: tuple[float, float], lift: float) -> None:
        """Stands at motor angles, rad, with the lift at a part of its way up."""
        self._engine = Engine(self._scene, self._cell, np.array(joints), lift=LIFT * lift, smooth=True)
        self.joints, self.force, self.touched = joints, (0.0, 0.0), ''

    def advance(self, time: float, joints: tuple[float, float], lift: float) -> None:
        """On to a time, s, in whole ticks; the motors are then commanded to be at `joints`, rad."""
        engine = self._engine
        engine.command(np.array(joints), LIFT * lift)
        while engine.data.time < time - 0.5 * TICK:
            engine.advance()
        (q1, q2), (x, y) = engine.joints.tolist(), engine.force().tolist()
        self.joints, self.force, self.touched = (q1, q2), (x, y), ''
        if x or y:
            near = int(self._cell.surfaces.distances(engine.tip[None])[0].argmin())
            self.touched = self._cell.discs[int(self._cell.surfaces.object[near])].name

    def sensed(self, share: float) -> Floats:
        """The force in the frame of the sensor; a tool frame is that of the engine's own link 2."""
        turn = self._engine.link2_angle if self._cell.sensor.frame is SensorFrame.TOOL else 0.0
        return rotate(np.array(self.force), -turn)
