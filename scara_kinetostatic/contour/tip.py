"""The centre of the tip in contact, by H̄ of a calibrated arm, with what its place depends on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.compensation.arm import CalibratedArm
from scara_kinetostatic.model import kinematics, sensor_error
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Sensor, SensorFrame, SensorSign
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import posture, rotate
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, joint_torques
from scara_kinetostatic.model.parameters import NAMES


def force_on_object(
    model: ExtendedModel, arm: CalibratedArm, sensor: Sensor, joints: Floats, reported: Floats
) -> Floats:
    """F on the object in the base frame, (n, 2), N, from what the sensor reports less its zero.

    Args:
        model: with the errors of the sensor that were found; its theta1 and theta2 place the tool frame.
        arm: gain and rotation of the sensor within their declared uncertainty.
        sensor: its frame and sign.
        joints: Q, (n, 2), rad.
        reported: (n, 2), N.
    """
    force = reported * (-1.0 if sensor.sign is SensorSign.ON_ROBOT else 1.0)
    force = sensor_error.true_force(model, force, metadata_of(model, joints))
    p = model.parameters
    turn = np.full(len(joints), -arm.sensor.rotation)
    if sensor.frame is SensorFrame.TOOL:
        turn = turn + joints.sum(axis=1) + p.theta1 + p.theta2
    return rotate(force, turn) / (1.0 + arm.sensor.gain)


def metadata_of(model: ExtendedModel, joints: Floats) -> TouchMetadata:
    """What is known of the poses besides Q and F: their posture; they are after all touches."""
    return TouchMetadata.plain(len(joints))._replace(posture=posture(model.parameters, joints))


class TipPlaces(NamedTuple):
    """Centre of the tip in n poses under load.

    Attributes:
        center: S, (n, 2), m.
        by_model: ∂S/∂(values of the model), (n, 2, 12 + k).
        systematic: covariance of S by the calibration, (n, 2, 2), m².
        noise: covariance by the noise of joint angles and force and by the place of joints in their dead bands,
            (n, 2, 2), m².
    """

    center: Floats
    by_model: Floats
    systematic: Floats
    noise: Floats


_STEPS = 1e-6, 1e-3
"""Steps of central differences over a joint angle, rad, and a force, N."""
_VALUE_STEP = 1e-6
"""Step over a value of the base model, in its unit."""
_EFFECT_STEP = 1e-3
"""Step over a value of an effect, in plausible sizes."""
_SIGN_KNOWN = 3.0
"""Standard deviations from zero at which the sign of a torque is known."""
_PASSES = 4


def tip_center(
    arm: CalibratedArm, model: ExtendedModel, joints: Floats, force: Floats, std: float
) -> tuple[Floats, Floats]:
    """H̄: S, (n, 2), m, and the place of each joint in its dead band, -1 to 1, (n, 2).

    Args:
        arm: the form of the gripper.
        model: of the arm.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
        std: standard deviation of a component of the force, N.
    """
    p, gripper, metadata = model.parameters, arm.cell.gripper, metadata_of(model, joints)
    links, slack = joints, np.zeros_like(joints)
    for _ in range(_PASSES):
        torques = joint_torques(p, links, force)
        levers = np.linalg.norm(kinematics.jacobian(p, links), axis=1)
        slack = np.clip(torques / (_SIGN_KNOWN * std * levers), -1.0, 1.0)
        links = joints - (p.p1, p.p2) * torques - (p.g1, p.g2) * slack
    crossing = (p.g1, p.g2) * (np.sign(torques) - slack)
    return direct_kinetostatics(model, joints + crossing, torques, gripper, metadata=metadata)[0], slack


def tip_places(arm: CalibratedArm, joints: Floats, force: Floats) -> TipPlaces:
    """S with its uncertainty for the calibrated model.

    Args:
        arm: the calibrated arm.
        joints: Q, (n, 2), rad.
        force: F on the object, base frame, (n, 2), N.
    """
    model, noise = arm.model, arm.noise
    typical = noise.force_at(float(np.median(np.hypot(*force.T))))

    def at(changed: ExtendedModel = model, turn: Floats | float = 0.0, push: Floats | float = 0.0) -> Floats:
        return tip_center(arm, changed, joints + turn, force + push, typical)[0]

    center, slack = tip_center(arm, model, joints, force, typical)
    axes = np.eye(2)
    by_joints = np.stack([(at(turn=_STEPS[0] * e) - at(turn=-_STEPS[0] * e)) / (2 * _STEPS[0]) for e in axes], axis=-1)
    by_force = np.stack([(at(push=_STEPS[1] * e) - at(push=-_STEPS[1] * e)) / (2 * _STEPS[1]) for e in axes], axis=-1)
    values, steps = model.as_array(), np.append(np.full(len(NAMES), _VALUE_STEP), _EFFECT_STEP * model.effect_scales)
    columns = []
    for k, step in enumerate(steps):
        change = step * (np.arange(len(values)) == k)
        up, down = (at(model.with_array(values + sign * change)) for sign in (1, -1))
        columns.append((up - down) / (2 * step))
    by_model = np.stack(columns, axis=-1)
    p = model.parameters
    in_band = np.array([p.g1, p.g2]) ** 2 / 3 * (1 - slack**2)
    turns = np.array(noise.joint_levels) ** 2 + in_band
    return TipPlaces(
        center,
        by_model,
        (by_model @ arm.covariance) @ by_model.swapaxes(1, 2),
        (by_joints * turns[:, None, :]) @ by_joints.swapaxes(1, 2) + by_force @ by_force.swapaxes(1, 2) * typical**2,
    )
