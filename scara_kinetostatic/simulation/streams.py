"""A simulated recording: whole streams, or the touches alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel, as_model
from scara_kinetostatic.model.parameters import Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.contact_forces import PlannedLoads, Timing, load_histories
from scara_kinetostatic.simulation.plan import Plan
from scara_kinetostatic.simulation.sensors import SensorModel, reported_force, sensor_angle
from scara_kinetostatic.simulation.trajectory import CellState, Trajectory
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

START = 1_700_000_000_000_000_000
"""Stamp of the start of a simulated recording, ns."""
Sensed = tuple[CellState, Floats, Floats]
"""A state, and the errors of joint angles, rad, and of the force, N."""


def simulate_streams(
    cell: Cell,
    truth: ExtendedModel | Parameters,
    plan: Plan,
    *,
    timing: Timing | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
    start: int = START,
    repeated: bool = False,
) -> Streams:
    """Both streams of one pass through a plan, with the effects of the robot.

    Args:
        cell: discs, sensor, noise of a touch.
        truth: the simulated robot: its parameters, or the model with its effects.
        plan: the touches.
        timing: how long the phases last.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.
        repeated: whether joints with memory come from another pass through the plan instead of the relaxed state.

    Raises:
        UnsupportedDataError: the simulated robot cannot reach a touch, or hold its force.
    """
    sensors = sensors or SensorModel()
    trajectory = Trajectory(cell, truth, plan, timing, repeated)
    joint_errors, force_errors = _touch_errors(sensors, cell, truth, trajectory, seed)

    def at(time: Floats) -> Sensed:
        return trajectory.state_at(time), joint_errors, force_errors

    return recorded('simulation', cell, truth, sensors, trajectory.duration, at, seed, start)


def recorded(
    source: str,
    cell: Cell,
    truth: ExtendedModel | Parameters,
    sensors: SensorModel,
    duration: float,
    at: Callable[[Floats], Sensed],
    seed: int,
    start: int,
) -> Streams:
    """Both streams of any motion as the sensors report them.

    Args:
        source: for messages.
        cell: frame and sign of the sensor.
        truth: the simulated robot.
        sensors: noise, bias and rates.
        duration: of the motion, s.
        at: the state at times in s, (k,), and the errors of joint angles and force, base frame, that it numbers.
        seed: of white noise and stamps.
        start: stamp of the start, ns.
    """
    random = np.random.default_rng([seed, 1])
    joint_stamps = sensors.stamps(duration, sensors.joint_rate, 0.0, random)
    wrench_stamps = sensors.stamps(duration, sensors.wrench_rate, sensors.offset, random)
    state, joint_errors, _ = at(1e-9 * joint_stamps.astype(np.float64))
    position = sensors.read_joints(state, joint_errors, random)
    state, _, force_errors = at(1e-9 * wrench_stamps.astype(np.float64))
    force = sensors.read_force(cell, truth, state, force_errors, random)
    return Streams(source, JointStream(joint_stamps + start, position), WrenchStream(wrench_stamps + start, force))


def simulate_touches(
    cell: Cell, truth: ExtendedModel | Parameters, plan: Plan, noise: Noise | None = None, seed: int = 0
) -> TouchSet:
    """The touches of a plan without streams: Ḡ, the effects of the robot, and the noise of one touch.

    The same seed gives the same noise of the touches as in `simulate_streams`.

    Args:
        cell: discs, sensor.
        truth: the simulated robot: its parameters, or the model with its effects.
        plan: the touches.
        noise: repeatability; None: that of the cell; Noise(0, 0) for exact touches.
        seed: of the noise.

    Returns:
        One touch per row of the plan, force in the frame of the sensor.

    Raises:
        UnsupportedDataError: the simulated robot cannot reach a touch, or hold its force.
    """
    trajectory = Trajectory(cell, truth, plan)
    sensors = SensorModel(touch_noise=noise)
    joint_errors, force_errors = _touch_errors(sensors, cell, truth, trajectory, seed)
    joints = trajectory.hold_joints + joint_errors
    force = reported_force(
        cell, truth, trajectory.hold_joints, trajectory.hold_force, force_errors, metadata=trajectory.metadata
    )
    beyond = np.hypot(*trajectory.peak_force.T) / np.hypot(*trajectory.hold_force.T)
    errors = beyond[:, None] * force_errors
    peak_force = reported_force(
        cell, truth, trajectory.peak_joints, trajectory.peak_force, errors, beyond, trajectory.metadata
    )
    loads = PlannedLoads(trajectory.peak_joints + joint_errors, peak_force, joints, force)
    return TouchSet(
        joints=joints,
        force=force,
        disc=plan.disc,
        posture=plan.posture,
        time=trajectory.hold_time,
        approach=trajectory.metadata.approach,
        press=trajectory.metadata.press,
        history=load_histories(loads, plan.preload > 0, cell.nominal, cell.sensor.frame).hold,
    )


def _touch_errors(
    sensors: SensorModel, cell: Cell, truth: ExtendedModel | Parameters, trajectory: Trajectory, seed: int
) -> tuple[Floats, Floats]:
    """The errors of each touch of a trajectory, base frame, (n, 2) each, rad and N."""
    joints, force = trajectory.hold_joints, trajectory.hold_force
    angle = sensor_angle(cell, as_model(truth).parameters, joints)
    return sensors.touch_errors(cell, len(joints), np.random.default_rng([seed, 0]), force, angle)
