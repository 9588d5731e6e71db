"""A recording simulated in MuJoCo: whole streams, or the touches alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise, SensorFrame
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.mujoco.controller import TouchController
from scara_kinetostatic.simulation.mujoco.motion import SimulatedMotion
from scara_kinetostatic.simulation.mujoco.scene import Scene
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.sensors import SensorModel
from scara_kinetostatic.simulation.streams import START
from scara_kinetostatic.simulation.trajectory import CellState, Timing
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

PRELOAD = 1.0
"""Preload of every other touch of `preload_plan`: it is pressed to twice its force first."""


def preload_plan(cell: Cell, per_disc: int = 12) -> Plan:
    """The simulator's default plan, every other touch with preload."""
    return default_plan(cell, per_disc=per_disc, preload=PRELOAD)


def simulate_streams(
    scene: Scene,
    cell: Cell,
    plan: Plan | None = None,
    *,
    timing: Timing | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
    start: int = START,
) -> Streams:
    """Both streams of one pass through a plan.

    Args:
        scene: the true robot.
        cell: its description: nominal arm, discs, sensor, noise of a touch.
        plan: the touches; None: `preload_plan`.
        timing: durations of the phases.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: a touch is out of reach, or its force is not reached.
    """
    plan = preload_plan(cell) if plan is None else plan
    motion = TouchController(scene, cell, plan, timing).run()
    return as_streams(motion, scene, cell, sensors, seed=seed, start=start)


def simulate_touches(
    scene: Scene,
    cell: Cell,
    plan: Plan | None = None,
    *,
    timing: Timing | None = None,
    noise: Noise | None = None,
    seed: int = 0,
) -> TouchSet:
    """The touches of a plan without streams, read at the end of each hold.

    Args:
        scene: the true robot.
        cell: its description.
        plan: the touches; None: `preload_plan`.
        timing: durations of the phases.
        noise: repeatability of a touch; None: that of the cell; Noise(0, 0) for none.
        seed: of the noise.

    Returns:
        One touch per row of the plan, force in the frame of the sensor.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: a touch is out of reach, or its force is not reached.
    """
    plan = preload_plan(cell) if plan is None else plan
    motion = TouchController(scene, cell, plan, timing).run()
    return with_noise(as_touches(motion, cell, plan), cell, noise, seed)


def as_streams(
    motion: SimulatedMotion,
    scene: Scene,
    cell: Cell,
    sensors: SensorModel | None = None,
    *,
    seed: int = 0,
    start: int = START,
) -> Streams:
    """Both streams of a motion; the arguments are those of `simulate_streams`."""
    sensors = sensors or SensorModel()
    held = _as_sensed(motion, cell)[motion.holds]
    joint_errors, force_errors = sensors.touch_errors(cell, len(held), np.random.default_rng([seed, 0]), held)
    random = np.random.default_rng([seed, 1])
    duration = float(motion.time[-1])
    joint_stamps = sensors.stamps(duration, sensors.joint_rate, 0.0, random)
    wrench_stamps = sensors.stamps(duration, sensors.wrench_rate, sensors.offset, random)
    position = sensors.read_joints(_state_at(motion, cell, joint_stamps), joint_errors, random)
    turned = replace(cell, sensor=cell.sensor._replace(frame=SensorFrame.BASE))  # `_instant` has turned the force
    state = _state_at(motion, cell, wrench_stamps)
    force = sensors.read_force(turned, scene.parameters, state, force_errors, random)
    return Streams(
        source=f'physics: {scene.name}',
        joints=JointStream(joint_stamps + start, position),
        wrench=WrenchStream(wrench_stamps + start, force),
    )


def as_touches(motion: SimulatedMotion, cell: Cell, plan: Plan) -> TouchSet:
    """The touches of a motion, without noise and without the load before them, which the streams have."""
    holds = motion.holds
    return TouchSet(
        joints=motion.joints[holds],
        force=_as_sensed(motion, cell)[holds],
        disc=plan.disc,
        posture=plan.posture,
        time=motion.time[holds],
        approach=motion.approach,
        press=motion.press,
    )


def with_noise(touches: TouchSet, cell: Cell, noise: Noise | None = None, seed: int = 0) -> TouchSet:
    """Touches with the noise of a touch, that of the cell if None; the seed is that of `simulate_streams`."""
    random = np.random.default_rng([seed, 0])
    joint_errors, force_errors = SensorModel(touch_noise=noise).touch_errors(cell, len(touches), random, touches.force)
    return touches.replace(joints=touches.joints + joint_errors, force=touches.force + force_errors)


def _as_sensed(motion: SimulatedMotion, cell: Cell) -> Floats:
    """Force on the object in the sensor's frame, (k, 2), N; a tool frame is that of the engine's own link 2."""
    if cell.sensor.frame is SensorFrame.BASE:
        return motion.force
    return rotate(motion.force, -motion.link2_angle)


def _state_at(motion: SimulatedMotion, cell: Cell, stamps: NDArray[np.int64]) -> CellState:
    """The motion at stamps in ns, force in the frame of the sensor."""
    time = 1e-9 * np.asarray(stamps, dtype=float)
    tick = np.clip(np.searchsorted(motion.time, time), 0, len(motion.time) - 1)
    magnitude = np.linalg.norm(motion.force, axis=1)
    held = np.maximum(magnitude[motion.holds], 1e-9)
    values = np.column_stack([motion.joints, _as_sensed(motion, cell), magnitude / held[motion.touch], motion.progress])
    at = np.column_stack([np.interp(time, motion.time, column) for column in values.T])
    return CellState(at[:, :2], at[:, 2:4], motion.touch[tick], motion.phase[tick], at[:, 5], at[:, 4])
