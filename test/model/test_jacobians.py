"""Every analytic derivative of the model against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from model.helpers import ROBOTS, STEPS, assert_derivative, random_poses

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import GripperSign, Noise
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.extended_model import ExtendedModel, TouchMetadata
from scara_kinetostatic.model.joint_law import joint_deflection
from scara_kinetostatic.model.kinematics import LoadedJoints, forward_by_parameters, tip_by_parameters
from scara_kinetostatic.model.kinetostatics import (
    Force,
    Law,
    direct_kinetostatics,
    inverse_kinetostatics,
    inverse_of_rows,
    joints_under_load,
    tip_by_joints,
    tip_by_noise,
    tip_by_values,
    tip_under_load,
)
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch_derivatives import contact_derivatives

SIGNS = tuple(GripperSign)
SMALL = np.full(2, 1e-6)


def clear_of_dead_bands(robot, poses, gripper):
    """Poses whose torques keep their sign under a small change."""
    joints, torques = inverse_kinetostatics(robot, poses.tip, poses.force, poses.posture, gripper)
    keep = (np.abs(torques) > 0.01 * np.hypot(*poses.force.T)[:, None]).all(axis=1)
    return type(poses)(*(part[keep] for part in poses)), joints[keep], torques[keep]


def test_jacobian_is_the_derivative_of_h_and_not_the_printed_one():
    rng = np.random.default_rng(1)
    joints = rng.uniform(-3, 3, (50, 2))
    jacobian = kinematics.jacobian(PAPER_ACTUAL, joints)
    assert_derivative(lambda dq: kinematics.forward(PAPER_ACTUAL, joints + dq), np.zeros(2), jacobian, SMALL)
    printed = kinematics.quarter_turn(kinematics.link_vectors(PAPER_ACTUAL, joints)[0])
    assert np.abs(jacobian[:, :, 0] - printed).max() > 0.3


@pytest.mark.parametrize('robot', ROBOTS)
def test_rigid_robot(robot):
    poses = random_poses(2)
    joints = kinematics.inverse(robot, poses.tip, poses.posture)
    found = forward_by_parameters(robot, joints)
    assert_derivative(lambda v: kinematics.forward(Parameters.from_array(v), joints), robot.as_array(), found, STEPS)


@pytest.mark.parametrize('sign', SIGNS)
@pytest.mark.parametrize('robot', ROBOTS)
def test_loaded_tip(robot, sign):
    """∂S/∂L̄ at fixed Q and F, in full, and up to the change of the lever arms by the deflection."""
    poses, joints, torques = clear_of_dead_bands(robot, random_poses(3), sign)
    law, load, plain = Law(ExtendedModel(robot), sign), Force.of(poses.force), TouchMetadata.plain(len(joints))
    loading = joints_under_load(law, poses.tip, load, poses.posture, plain).loading
    found = tip_by_values(law, tip_by_joints(loading, inverse_of_rows(loading, load)), loading, load, None)

    def tip(v):
        return direct_kinetostatics(Parameters.from_array(v), joints, poses.force, sign)[0]

    assert_derivative(tip, robot.as_array(), found, STEPS)
    at = LoadedJoints(torque=tuple(torques.T), sense=tuple(np.sign(torques).T))
    links = joints - joint_deflection(robot, torques)
    rough = tip_by_parameters(robot, links, poses.force, sign.factor, at)
    away = np.abs(rough - found).max(axis=(0, 1)) / np.abs(found).max(axis=(0, 1))
    assert 1e-5 < away.max() < 0.03


@pytest.mark.parametrize('gripper', SIGNS)
@pytest.mark.parametrize('robot', ROBOTS)
def test_contact(robot, gripper):
    poses, joints, _ = clear_of_dead_bands(robot, random_poses(5), gripper)

    def force(p, q):
        return contact(p, q, poses.centers, poses.radii, gripper, warm_start=poses.force)

    found = contact_derivatives(robot, force(robot, joints))
    assert_derivative(lambda d: force(robot, joints + d).force, np.zeros(2), found.joints, np.full(2, 1e-7))
    x, steps = robot.as_array(), STEPS * 0.1
    assert_derivative(lambda v: force(Parameters.from_array(v), joints).force, x, found.parameters, steps)


def test_contact_with_a_floating_joint_does_not_depend_on_it():
    """Inside the dead band of joint 1 neither q1 nor g1 nor p1 moves the force."""
    robot = PAPER_ACTUAL
    links = np.array([[0.4, 1.2], [1.0, -0.9]])
    tip = kinematics.forward(robot, links)
    unit = (tip - [robot.x0, robot.y0]) / np.hypot(*(tip - [robot.x0, robot.y0]).T)[:, None]
    force = 25 * unit
    real = tip - (robot.p_ee * 25 + robot.g_ee) * unit
    joints, _ = inverse_kinetostatics(robot, real, force, [1, -1])
    joints = joints + np.array([0.3 * robot.g1, 0.0])
    centers, radii = real + 0.08 * unit, np.full(2, 0.08)
    found = contact(robot, joints, centers, radii, warm_start=force)
    derivatives = contact_derivatives(robot, found)
    assert (found.state.mode1 == 0).all()
    np.testing.assert_array_equal(derivatives.joints[:, :, 0], 0)
    np.testing.assert_array_equal(derivatives.parameters[:, :, [2, 7, 10]], 0)

    def moved(v):
        return contact(Parameters.from_array(v), joints, centers, radii, warm_start=force).force

    assert_derivative(moved, robot.as_array(), derivatives.parameters, STEPS * 0.1)


def test_no_contact_no_derivative():
    joints = np.array([[0.3, 0.9]])
    found = contact(PAPER_ACTUAL, joints, [[0.9, 0.9]], [0.05])
    derivatives = contact_derivatives(PAPER_ACTUAL, found)
    assert not derivatives.joints.any()
    assert not derivatives.parameters.any()


@pytest.mark.parametrize('sign', SIGNS)
def test_tip_by_the_noise_of_a_pose(sign):
    """Columns by q1, q2, F_x and F_y, each one standard deviation."""
    noise = Noise((1e-5, 3e-5), 0.2, 0.01)
    law = Law(ExtendedModel(PAPER_ACTUAL), sign, noise)
    poses = random_poses(5, 80)
    joints, _ = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, sign)
    metadata = TouchMetadata.plain(len(joints))

    def tip(q, f):
        return tip_under_load(law, q, Force.of(f, noise)._replace(std=force.std, place=force.place), metadata).tip

    force = Force.of(poses.force, noise)
    at = tip_under_load(law, joints, force, metadata)
    found = tip_by_noise(law, tip_by_joints(at.loading, inverse_of_rows(at.loading, force)), at.loading, force)
    outside = ~at.loading.in_band
    assert 40 < outside.sum() < 80
    for column in range(4):
        step = np.zeros(4)
        step[column] = 1e-7 if column < 2 else 1e-4
        difference = tip(joints + step[:2], poses.force + step[2:]) - tip(joints - step[:2], poses.force - step[2:])
        std = noise.joint_levels[column] if column < 2 else force.std
        expected = difference / (2 * step[column]) * np.reshape(std, (-1, 1))
        np.testing.assert_allclose(found[outside, :, column], expected[outside], rtol=1e-5, atol=1e-10)
        np.testing.assert_allclose(found[..., column], expected, rtol=0.02, atol=5e-8)  # inside to first order
