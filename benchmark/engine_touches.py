"""The touches of a plan in the physics engine without streams, read at the end of each hold."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.motion import Phase
from scara_kinetostatic.simulation.mujoco import SimulatedMotion, TouchController, as_sensed
from scara_kinetostatic.simulation.mujoco.engine import Scene
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.streams import SensorModel
from scara_kinetostatic.touches.load_history import last_movement


def simulate_touches(scene: Scene, cell: Cell, plan: Plan, *, noise: Noise | None = None, seed: int = 0) -> TouchSet:
    """One touch per row of the plan, force in the frame of the sensor; the arguments are those of `with_noise`."""
    return with_noise(as_touches(TouchController(scene, cell, plan).run(), cell, plan), cell, noise, seed)


def as_touches(motion: SimulatedMotion, cell: Cell, plan: Plan) -> TouchSet:
    """The touches of a motion, without noise and without the load before them, which the streams have."""
    joints, holds, lowered = motion.joints, motion.holds, motion.last(Phase.PAUSE)
    touching = [a + int(motion.force[a:b].any(axis=1).argmax()) for a, b in zip(lowered, holds, strict=True)]
    approach, press = (
        np.array([last_movement(joints[a:b], joints[b]) for a, b in zip(begins, holds, strict=True)])
        for begins in (lowered, touching)
    )
    return TouchSet(
        joints=joints[holds],
        force=as_sensed(motion, cell)[holds],
        disc=plan.disc,
        posture=plan.posture,
        time=motion.time[holds],
        approach=approach,
        press=press,
    )


def with_noise(touches: TouchSet, cell: Cell, noise: Noise | None = None, seed: int = 0) -> TouchSet:
    """Touches with the noise of a touch, that of the cell if None; the seed is that of `simulate_streams`."""
    unit = np.random.default_rng([seed, 0]).standard_normal((2, len(touches), 2))
    joint_errors, force_errors = SensorModel(touch_noise=noise).touch_errors(cell, unit, touches.force)
    return touches.replace(joints=touches.joints + joint_errors, force=touches.force + force_errors)
