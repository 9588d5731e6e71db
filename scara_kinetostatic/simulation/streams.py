"""A simulated recording as the sensors report it: whole streams, or the touches alone.

There are two kinds of noise. The noise of one touch (`Noise`, `cell.noise`) is its repeatability: an error that is
constant during the touch, so that averaging does not reduce it. Its force part is proportional to the contact force;
otherwise the tare before the touch would remove it. The noise of the samples is white.

An effect that is an error of the force sensor is treated alike: the part of it that does not depend on the force, a
bias, is scaled with the contact force up to its full value in the hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scara_kinetostatic.model import extended_model
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise, SensorFrame, SensorSign
from scara_kinetostatic.model.extended_model import TouchMetadata, as_model
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import MICRO, NANO, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.simulation.motion import Motion, Robot, SlidingMotion, Timing, Trajectory, load_histories
from scara_kinetostatic.simulation.plan import Plan, Slide, check_numbers
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

TYPICAL_NOISE = Noise(joint=1e-5, force=0.3)
"""Repeatability of a touch where neither the sensors nor the cell give one."""


@dataclass(frozen=True)
class SensorModel:
    """Encoders and force sensor.

    Attributes:
        touch_noise: repeatability of one touch; None: that of the cell.
        joint_noise: white noise of the joint samples, rad.
        force_noise: white noise of the force samples, N.
        bias: reading of the force sensor without force, in its own frame and sign, N.
        resolution: step of the encoders, rad; 0 for none.
        joint_rate: joint states per second.
        wrench_rate: wrenches per second.
        jitter: 1-sigma of a stamp's lateness, in periods; also makes rare gaps of a few periods.
        offset: lateness of the first wrench after the first joint state, s.

    Raises:
        ParameterError: a negative noise, a rate that is not above 0.
    """

    touch_noise: Noise | None = None
    joint_noise: float = 0.0
    force_noise: float = 0.05
    bias: tuple[float, float] = (1.2, -0.8)
    resolution: float = MICRO
    joint_rate: float = 80.0
    wrench_rate: float = 98.0
    jitter: float = 0.1
    offset: float = 0.0037

    def __post_init__(self) -> None:
        zero = ('touch_noise', 'joint_noise', 'force_noise', 'resolution', 'jitter', 'offset')
        check_numbers('sensors', self, zero=zero, signed=('bias',))

    @classmethod
    def ideal(cls, rate: float = 100.0) -> SensorModel:
        """Sensors without any error, both at one even rate."""
        return cls(Noise(0.0, 0.0), 0.0, 0.0, (0.0, 0.0), 0.0, rate, rate, 0.0, 0.0)

    def touch_errors(
        self, cell: Cell, unit: Floats, force: Floats, sensor_angle: Floats | None = None, share: Floats | float = 1.0
    ) -> tuple[Floats, Floats]:
        """Errors of the joint angles and of the force of each touch, (n, 2) each, rad and N, base frame.

        Args:
            cell: its noise is taken where the sensors have none.
            unit: both errors in standard deviations, (2, n, 2).
            force: (n, 2), N: the noise may grow with it.
            sensor_angle: of the sensor's x axis in the base frame, (n,), rad; None for 0.
            share: of the part of the force's error that does not grow, (n,): the force over that of the hold.
        """
        noise = self.touch_noise or cell.noise or TYPICAL_NOISE
        joint_errors = np.array(noise.joint_levels) * unit[0]
        levels = np.multiply.outer(share, noise.force_levels)
        force_errors = np.hypot(levels, noise.growth * np.hypot(*force.T)[:, None]) * unit[1]
        if noise.is_plain or sensor_angle is None:
            return joint_errors, force_errors
        return joint_errors, rotate(force_errors, sensor_angle)

    def stamps(self, duration: float, rate: float, offset: float, random: np.random.Generator) -> NDArray[np.int64]:
        """Stamps of one topic from `offset` to `duration`, increasing, (k,), ns since the start."""
        count = max(2, int(np.floor((duration - offset) * rate)) + 1)
        lateness = np.abs(random.standard_normal(count)) * self.jitter
        lateness += (random.random(count) < 0.01) * self.jitter * 20.0
        due = (np.arange(count) + lateness) / rate + offset
        stamps = np.maximum.accumulate(np.round(due * SECOND).astype(np.int64))
        return np.unique(stamps[stamps <= round(duration * SECOND)])

    def stepped(self, angles: Floats) -> Floats:
        """Angles in the steps of the encoders, rad."""
        return np.round(angles / self.resolution) * self.resolution if self.resolution else angles

    def forces(self, sign: SensorSign, exact: Floats, white: Floats) -> Floats:
        """Forces as the sensor gives them, (..., 2), N: its sign, its bias, white noise in standard deviations."""
        return np.asarray(sign.factor * exact + self.bias + self.force_noise * white)


def in_sensor_frame(cell: Cell, truth: Parameters, joints: Floats, force: Floats) -> Floats:
    """A force in the base frame, (k, 2), N, as seen from the frame the sensor reports in."""
    angle = sensor_angle(cell, truth, joints)
    return force if angle is None else rotate(force, -angle)


def sensor_angle(cell: Cell, truth: Parameters, joints: Floats) -> Floats | None:
    """Angle of the sensor's x axis in the base frame, (k,), rad; None where it is the base frame's."""
    if cell.sensor.frame is SensorFrame.BASE:
        return None
    return np.asarray(joints.sum(axis=1) + truth.theta1 + truth.theta2)


def reported_force(
    cell: Cell,
    truth: Robot,
    joints: Floats,
    force: Floats,
    error: Floats,
    relative_force: Floats | None = None,
    metadata: TouchMetadata | None = None,
) -> Floats:
    """Reading of the sensor for a force on the object, without its sign and bias, (k, 2), N, in its frame.

    Args:
        cell: frame of the sensor.
        truth: places the tool frame; its effects may be errors of the sensor.
        joints: Q, (k, 2), rad.
        force: true force, base frame, (k, 2), N.
        error: noise of the touch, base frame, (k, 2), N.
        relative_force: force over that of the hold, (k,); None in the hold.
        metadata: of the touches of these moments, (k,).
    """
    model = as_model(truth)
    reported = in_sensor_frame(cell, model.parameters, joints, force + error)
    if model.effects:
        true = in_sensor_frame(cell, model.parameters, joints, force)
        reported = reported + extended_model.reported_force(model, true, metadata) - true
        if relative_force is not None:
            at_rest = extended_model.reported_force(model, np.zeros_like(true), metadata)
            reported -= (1.0 - relative_force)[:, None] * at_rest
    return reported


START = 1_700_000_000_000_000_000
"""Stamp of the start of a simulated recording, ns."""


def simulate_streams(
    cell: Cell,
    truth: Robot,
    plan: Plan | tuple[Slide, ...],
    *,
    timing: Timing | None = None,
    sensors: SensorModel | None = None,
    seed: int = 0,
    start: int = START,
) -> Streams:
    """Both streams of one pass through a plan, with the effects of the robot.

    Args:
        cell: discs, sensor, noise of a touch, radius of the tip.
        truth: the simulated robot: its parameters, or the model with its effects.
        plan: the touches, or the slides.
        timing: how long the phases of touches last.
        sensors: noise, bias and rates.
        seed: of all random numbers.
        start: stamp of the start, ns.

    Raises:
        UnsupportedDataError: the plan is empty, or the simulated robot cannot reach a touch, hold its force, or reach a
            slide.
        ParameterError: an outline is too narrow for the tip.
    """
    motion: Motion
    if isinstance(plan, Plan):
        motion = Trajectory(cell, truth, plan, timing)
    else:
        motion = SlidingMotion(cell, truth, plan, seed=seed)
    return recorded('simulation', cell, truth, motion, sensors or SensorModel(), seed, start)


def recorded(
    source: str, cell: Cell, truth: Robot, motion: Motion, sensors: SensorModel, seed: int, start: int = START
) -> Streams:
    """Both streams of any motion as the sensors report them.

    Args:
        source: for messages.
        cell: frame and sign of the sensor.
        truth: the simulated robot.
        motion: any.
        sensors: noise, bias and rates.
        seed: of errors, white noise and stamps.
        start: stamp of the start, ns.
    """
    random, model = np.random.default_rng([seed, 1]), as_model(truth)
    joint_stamps = sensors.stamps(motion.duration, sensors.joint_rate, 0.0, random)
    wrench_stamps = sensors.stamps(motion.duration, sensors.wrench_rate, sensors.offset, random)

    times = [NANO * stamps.astype(np.float64) for stamps in (joint_stamps, wrench_stamps)]
    states = [motion.state_at(time) for time in times]
    (error, _), (_, force_error) = (
        sensors.touch_errors(
            cell,
            motion.errors_at(time, state, seed),
            state.force,
            sensor_angle(cell, model.parameters, state.joints),
            state.relative_force,
        )
        for time, state in zip(times, states, strict=True)
    )
    position = sensors.stepped(states[0].joints + error + sensors.joint_noise * random.standard_normal(error.shape))
    state, error = states[1], force_error
    touch = TouchMetadata.plain(len(error))._replace(order=state.touch)
    force = reported_force(cell, model, state.joints, state.force, error, state.relative_force, touch)
    force = sensors.forces(cell.sensor.sign, force, random.standard_normal(force.shape))
    return Streams(source, JointStream(joint_stamps + start, position), WrenchStream(wrench_stamps + start, force))


def simulate_touches(cell: Cell, truth: Robot, plan: Plan, noise: Noise | None = None, seed: int = 0) -> TouchSet:
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
    t, sensors = Trajectory(cell, truth, plan), SensorModel(touch_noise=noise)
    unit = np.random.default_rng([seed, 0]).standard_normal((2, len(plan), 2))
    angle = sensor_angle(cell, t.truth, t.hold_joints)
    joint_errors, force_errors = sensors.touch_errors(cell, unit, t.hold_force, angle)
    joints = t.hold_joints + joint_errors
    force = reported_force(cell, truth, t.hold_joints, t.hold_force, force_errors, metadata=t.metadata)
    beyond = 1.0 + plan.preload
    errors = beyond[:, None] * force_errors
    peak_force = reported_force(cell, truth, t.peak_joints, t.peak_force, errors, beyond, t.metadata)
    peaks, holds = np.hstack([t.peak_joints + joint_errors, peak_force]), np.hstack([joints, force])
    return TouchSet(
        joints=joints,
        force=force,
        disc=plan.disc,
        posture=plan.posture,
        time=t.hold_time,
        approach=t.metadata.approach,
        press=t.metadata.press,
        history=load_histories(peaks, holds, plan.preload > 0, cell.nominal, cell.sensor.frame)[1],
    )
