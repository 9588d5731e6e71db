"""What encoders and force sensor make of the engine's motion: streams, or only the touches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model.cell import Cell, Noise, SensorFrame
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.mujoco.motion import Played
from scara_kinetostatic.simulation.mujoco.player import Player
from scara_kinetostatic.simulation.mujoco.scene import Scene
from scara_kinetostatic.simulation.plan import Plan, default_plan
from scara_kinetostatic.simulation.sensors import SensorModel
from scara_kinetostatic.simulation.streams import START
from scara_kinetostatic.simulation.trajectory import Instant, Timing
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

Floats = NDArray[np.float64]

PRELOAD = 1.0
"""Every other touch of the usual plan is pressed to twice its force first."""


def usual_plan(cell: Cell, per_disc: int = 12) -> Plan:
    """The simulator's default plan, every other touch with preload."""
    return default_plan(cell, per_disc=per_disc, preload=PRELOAD)


def play(
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
        scene: the robot, as built.
        cell: what is declared of it: nominal arm, discs, sensor, noise of a touch.
        plan: the touches; None: `usual_plan`.
        timing: how long the phases last.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: a touch is out of reach, or its force does not come about.
    """
    plan = usual_plan(cell) if plan is None else plan
    played = Player(scene, cell, plan, timing).play()
    return as_streams(played, scene, cell, sensors, seed=seed, start=start)


def play_touches(
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
        scene: the robot, as built.
        cell: what is declared of it.
        plan: the touches; None: `usual_plan`.
        timing: how long the phases last.
        noise: repeatability of a touch; None: that of the cell; Noise(0, 0) for what the engine gives.
        seed: of the noise.

    Returns:
        One touch per row of the plan, force in the frame of the sensor.

    Raises:
        InputError: MuJoCo is not installed.
        UnsupportedDataError: a touch is out of reach, or its force does not come about.
    """
    plan = usual_plan(cell) if plan is None else plan
    played = Player(scene, cell, plan, timing).play()
    return with_noise(as_touches(played, cell, plan), cell, noise, seed)


def as_streams(
    played: Played,
    scene: Scene,
    cell: Cell,
    sensors: SensorModel | None = None,
    *,
    seed: int = 0,
    start: int = START,
) -> Streams:
    """Both streams of what was played; the arguments are those of `play`."""
    sensors = sensors or SensorModel()
    joint_errors, force_errors = sensors.touch_errors(cell, len(played.holds), np.random.default_rng([seed, 0]))
    random = np.random.default_rng([seed, 1])
    duration = float(played.time[-1])
    joint_stamps = sensors.stamps(duration, sensors.joint_rate, 0.0, random)
    wrench_stamps = sensors.stamps(duration, sensors.wrench_rate, sensors.offset, random)
    position = sensors.read_joints(_instant(played, cell, joint_stamps), joint_errors, random)
    turned = replace(cell, sensor=cell.sensor._replace(frame=SensorFrame.BASE))  # `_instant` has turned the force
    seen = _instant(played, cell, wrench_stamps)
    force = sensors.read_force(turned, scene.parameters, seen, force_errors, random)
    return Streams(
        source=f'physics: {scene.name}',
        joints=JointStream(joint_stamps + start, position),
        wrench=WrenchStream(wrench_stamps + start, force),
    )


def as_touches(played: Played, cell: Cell, plan: Plan) -> TouchSet:
    """The touches of what was played, without noise."""
    holds = played.holds
    return TouchSet(
        joints=played.joints[holds],
        force=_as_sensed(played, cell)[holds],
        disc=plan.disc,
        posture=plan.posture,
        time=played.time[holds],
        approach=played.approach,
        press=played.press,
    )


def with_noise(touches: TouchSet, cell: Cell, noise: Noise | None = None, seed: int = 0) -> TouchSet:
    """Touches with the noise of a touch: that of the cell if None; a seed gives the same as in `play`."""
    random = np.random.default_rng([seed, 0])
    joint_errors, force_errors = SensorModel(touch_noise=noise).touch_errors(cell, len(touches), random)
    return touches.replace(joints=touches.joints + joint_errors, force=touches.force + force_errors)


def _as_sensed(played: Played, cell: Cell) -> Floats:
    """Force on the object in the sensor's frame, (k, 2), N; a tool frame is that of the engine's own link 2."""
    if cell.sensor.frame is SensorFrame.BASE:
        return played.force
    return rotate(played.force, -played.link2_angle)


def _instant(played: Played, cell: Cell, stamps: NDArray[np.int64]) -> Instant:
    """The played motion at stamps in ns, force in the frame of the sensor."""
    time = 1e-9 * np.asarray(stamps, dtype=float)
    tick = np.clip(np.searchsorted(played.time, time), 0, len(played.time) - 1)
    magnitude = np.linalg.norm(played.force, axis=1)
    held = np.maximum(magnitude[played.holds], 1e-9)
    values = np.column_stack([played.joints, _as_sensed(played, cell), magnitude / held[played.touch], played.progress])
    at = np.column_stack([np.interp(time, played.time, column) for column in values.T])
    return Instant(at[:, :2], at[:, 2:4], played.touch[tick], played.phase[tick], at[:, 5], at[:, 4])
