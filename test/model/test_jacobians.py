"""Every analytic derivative of the model against finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from model.helpers import ROBOTS, STEPS, assert_derivative, random_poses

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.contact import contact, contact_derivatives
from scara_kinetostatic.model.kinematics import Gripper, LoadedJoints, forward_by_parameters, tip_by_parameters
from scara_kinetostatic.model.kinetostatics import (
    direct_kinetostatics,
    inverse_kinetostatics,
    joint_deflection,
    loaded_tip_by_parameters,
)
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters

SIGNS = tuple(GripperSign)
SMALL = np.full(2, 1e-6)


def clear_of_dead_bands(robot, poses, sign=GripperSign.PHYSICAL):
    """Poses whose torques keep their sign under a small change."""
    joints, torques = inverse_kinetostatics(robot, poses.tip, poses.force, poses.posture, sign)
    lever = np.abs(torques) / np.hypot(*poses.force.T)[:, None]
    keep = (lever > 0.01).all(axis=1)
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
    x = robot.as_array()
    assert_derivative(
        lambda v: kinematics.forward(Parameters.from_array(v), joints), x, forward_by_parameters(robot, joints), STEPS
    )


@pytest.mark.parametrize('sign', SIGNS)
@pytest.mark.parametrize('robot', ROBOTS)
def test_loaded_tip(robot, sign):
    """∂S/∂L̄ at fixed Q and F, in full, and up to the change of the lever arms by the deflection."""
    poses, joints, torques = clear_of_dead_bands(robot, random_poses(3), sign)
    found = loaded_tip_by_parameters(robot, poses.tip, poses.force, poses.posture, sign)

    def tip(v):
        return direct_kinetostatics(Parameters.from_array(v), joints, poses.force, sign)[0]

    assert_derivative(tip, robot.as_array(), found, STEPS)
    at = LoadedJoints(torque=tuple(torques.T), sense=tuple(np.sign(torques).T))
    links = joints - joint_deflection(robot, torques)
    rough = tip_by_parameters(robot, links, poses.force, Gripper(sign).factor, at)
    away = np.abs(rough - found).max(axis=(0, 1)) / np.abs(found).max(axis=(0, 1))
    assert 1e-5 < away.max() < 0.03


@pytest.mark.parametrize('sign', SIGNS)
@pytest.mark.parametrize('robot', ROBOTS)
def test_contact(robot, sign):
    poses, joints, _ = clear_of_dead_bands(robot, random_poses(5), sign)

    def force(p, q):
        return contact(p, q, poses.centers, poses.radii, sign, warm_start=poses.force).force

    found = contact(robot, joints, poses.centers, poses.radii, sign, warm_start=poses.force)
    derivatives = contact_derivatives(robot, found)
    small = np.full(2, 1e-7)
    assert_derivative(lambda d: force(robot, joints + d), np.zeros(2), derivatives.joints, small)
    assert_derivative(
        lambda v: force(Parameters.from_array(v), joints), robot.as_array(), derivatives.parameters, STEPS * 0.1
    )


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
