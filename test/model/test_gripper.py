"""The general gripper of (7): exact in H̄, Ḡ and A, with the isotropic one as its special case."""

from __future__ import annotations

import numpy as np
import pytest
from model.helpers import STEPS, assert_derivative, random_poses

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import GripperSign
from scara_kinetostatic.model.contact import contact, contact_derivatives
from scara_kinetostatic.model.kinematics import Gripper
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch_equations import ContactProblem, excess_derivative, touch_equations

EXCESS = ((4e-6, 7e-6), (7e-6, -3e-6))
GRIPPERS = tuple(Gripper(sign, EXCESS) for sign in GripperSign)
PHYSICAL = GRIPPERS[0]


@pytest.mark.parametrize('gripper', GRIPPERS)
def test_direct_undoes_inverse(gripper):
    poses = random_poses(11, 2000)
    joints, torques = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, gripper)
    clear = (np.abs(torques) > 0.01 * np.hypot(*poses.force.T)[:, None]).all(axis=1)
    tip, found = direct_kinetostatics(PAPER_ACTUAL, joints[clear], poses.force[clear], gripper)
    np.testing.assert_allclose(tip, poses.tip[clear], atol=1e-11)
    np.testing.assert_allclose(found, torques[clear], atol=1e-8)


def test_contact_undoes_inverse(gripper=PHYSICAL):
    """With the printed sign the gripper's stiffness is negative, and the equilibrium is not unique."""
    poses = random_poses(12, 2000)
    joints, _ = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, gripper)
    found = contact(PAPER_ACTUAL, joints, poses.centers, poses.radii, gripper, warm_start=poses.force)
    assert found.solved.all()
    np.testing.assert_allclose(found.force, poses.force, atol=1e-8)


def test_torques_are_the_moments_of_the_force_where_it_acts():
    gripper = PHYSICAL
    poses = random_poses(13, 200)
    joints, torques = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, gripper)
    axis1 = np.array([PAPER_ACTUAL.x0, PAPER_ACTUAL.y0])
    sign = np.sign(torques)
    links = joints - torques * [PAPER_ACTUAL.p1, PAPER_ACTUAL.p2] - sign * [PAPER_ACTUAL.g1, PAPER_ACTUAL.g2]
    axis2 = axis1 + kinematics.link_vectors(PAPER_ACTUAL, links)[0]
    for k, axis in enumerate((axis1, axis2)):
        arm = poses.tip - axis
        moment = arm[:, 0] * poses.force[:, 1] - arm[:, 1] * poses.force[:, 0]
        np.testing.assert_allclose(torques[:, k], moment, atol=1e-10)


def test_a_multiple_of_the_identity_is_the_isotropic_gripper():
    poses = random_poses(14, 500)
    general = Gripper(GripperSign.PHYSICAL, ((3e-6, 0.0), (0.0, 3e-6)))
    stiffer = PAPER_ACTUAL.replace(p_ee=PAPER_ACTUAL.p_ee + 3e-6)
    one, _ = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, general)
    other, _ = inverse_kinetostatics(stiffer, poses.tip, poses.force, poses.posture)
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_derivatives_of_the_contact(gripper=PHYSICAL):
    poses = random_poses(15)
    joints, torques = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, gripper)
    keep = (np.abs(torques) / np.hypot(*poses.force.T)[:, None] > 0.01).all(axis=1)
    joints, centers, radii, warm_start = joints[keep], poses.centers[keep], poses.radii[keep], poses.force[keep]
    found = contact(PAPER_ACTUAL, joints, centers, radii, gripper, warm_start=warm_start)
    derivatives = contact_derivatives(PAPER_ACTUAL, found)

    def force(v, q):
        return contact(Parameters.from_array(v), q, centers, radii, gripper, warm_start=warm_start).force

    x = PAPER_ACTUAL.as_array()
    assert_derivative(lambda v: force(v, joints), x, derivatives.parameters, STEPS * 0.1)
    assert_derivative(lambda d: force(x, joints + d), np.zeros(2), derivatives.joints, np.full(2, 1e-7))


@pytest.mark.parametrize('sign', tuple(GripperSign))
def test_derivative_by_the_excess(sign):
    poses = random_poses(16, 100)
    gripper = Gripper(sign, EXCESS)
    joints, _ = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, gripper)
    state = contact(PAPER_ACTUAL, joints, poses.centers, poses.radii, gripper, warm_start=poses.force).state

    def residual(entries):
        changed = Gripper(sign, ((entries[0], entries[1]), (entries[2], entries[3])))
        e = touch_equations(PAPER_ACTUAL, ContactProblem(joints, poses.centers, poses.radii, changed), state)
        return np.stack([e.h.real, e.h.imag], axis=1)

    e = touch_equations(PAPER_ACTUAL, ContactProblem(joints, poses.centers, poses.radii, gripper), state)
    assert_derivative(residual, np.ravel(EXCESS), excess_derivative(state, e, gripper), np.full(4, 1e-9))


def test_senseless_matrix_is_refused():
    with pytest.raises(ParameterError, match='2×2'):
        Gripper(GripperSign.PHYSICAL, ((1.0, float('nan')), (0.0, 1.0)))
