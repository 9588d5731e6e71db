"""Laws of the model: H∘G, H̄∘Ḡ and A∘Ḡ are identities; the contact is in equilibrium."""

from __future__ import annotations

import numpy as np
import pytest
from model.helpers import ROBOTS, random_poses

from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import PAPER_DISCS, GripperSign
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics, press_aside, tip_yield
from scara_kinetostatic.model.parameters import PAPER_ACTUAL


@pytest.mark.parametrize('robot', ROBOTS)
def test_forward_undoes_inverse_in_both_postures(robot):
    poses = random_poses(1, 2000)
    for posture in (1, -1):
        joints = kinematics.inverse(robot, poses.tip, posture)
        np.testing.assert_allclose(kinematics.forward(robot, joints), poses.tip, atol=1e-12)
        assert (kinematics.posture(robot, joints) == posture).all()


def test_inverse_undoes_forward(robot=PAPER_ACTUAL):
    rng = np.random.default_rng(2)
    joints = np.stack([rng.uniform(-3, 3, 1000), rng.choice([-1, 1], 1000) * rng.uniform(0.1, 3.0, 1000)], axis=1)
    posture = kinematics.posture(robot, joints)
    back = kinematics.inverse(robot, kinematics.forward(robot, joints), posture)
    np.testing.assert_allclose(back, joints, atol=1e-12)


@pytest.mark.parametrize('aside', [0.0, 0.5, -0.5])
def test_a_press_aside_adds_its_force_where_the_tip_may_slide_and_drags_it(aside, robot=PAPER_ACTUAL):
    disc = PAPER_DISCS[1]
    angle = np.linspace(0.0, 6.0, 13)
    out, centers = np.stack([np.cos(angle), np.sin(angle)], axis=-1), np.tile([disc.x, disc.y], (13, 1))
    tip, radii, posture = centers + disc.radius * out, np.full(13, disc.radius), np.ones(13, dtype=int)
    joints = inverse_kinetostatics(robot, tip, -20 * out, posture)[0]
    more = press_aside(robot, joints, -5 * out, np.full(13, aside))
    found = contact(robot, joints + more, centers, radii)
    np.testing.assert_allclose(found.magnitude, 25.0, rtol=5e-3)
    inward = -out
    across = (found.force * kinematics.quarter_turn(inward)).sum(axis=1)  # the normal turns as the tip slides
    if aside:
        assert (np.sign(across) == -np.sign(aside)).all()
    moved = (kinematics.jacobian(robot, joints) @ more[..., None])[..., 0]
    slope = (moved * kinematics.quarter_turn(inward)).sum(axis=1) / (moved * inward).sum(axis=1)
    assert (np.sign(aside) * slope >= np.tan(np.abs(aside)) - 1e-12).all()
    held = np.linalg.solve(_compliance(robot, joints), moved[..., None])[..., 0]
    turned = np.arctan2((held * kinematics.quarter_turn(inward)).sum(axis=1), (held * inward).sum(axis=1))
    assert (np.sign(aside) * turned >= np.abs(aside) - 1e-12).all()
    assert aside or np.abs(turned).max() < 1e-12


def _compliance(robot, joints):
    """C, column by column."""
    units = (np.tile(unit, (len(joints), 1)) for unit in np.eye(2))
    return np.stack([tip_yield(robot, joints, unit) for unit in units], axis=-1)


@pytest.mark.parametrize('gripper', GripperSign)
@pytest.mark.parametrize('robot', ROBOTS)
def test_direct_undoes_inverse_kinetostatics(robot, gripper):
    poses = random_poses(3, 3000)
    joints, torques = inverse_kinetostatics(robot, poses.tip, poses.force, poses.posture, gripper)
    # where a torque is small, a joint pressed along its link may rest on either flank
    clear = (np.abs(torques) > 0.01 * np.hypot(*poses.force.T)[:, None]).all(axis=1)
    assert clear.mean() > 0.8
    tip, found = direct_kinetostatics(robot, joints[clear], poses.force[clear], gripper)
    np.testing.assert_allclose(tip, poses.tip[clear], atol=1e-12)
    np.testing.assert_allclose(found, torques[clear], atol=1e-10)


def test_torques_are_the_moments_of_the_force_where_it_acts(robot=PAPER_ACTUAL):
    poses = random_poses(13, 200)
    joints, torques = inverse_kinetostatics(robot, poses.tip, poses.force, poses.posture)
    links = joints - torques * [robot.p1, robot.p2] - np.sign(torques) * [robot.g1, robot.g2]
    axis = np.array([robot.x0, robot.y0])
    for k, at in enumerate((axis, axis + kinematics.link_vectors(robot, links)[0])):
        arm = poses.tip - at
        moment = arm[:, 0] * poses.force[:, 1] - arm[:, 1] * poses.force[:, 0]
        np.testing.assert_allclose(torques[:, k], moment, atol=1e-10)


def test_angles_torques_and_tip_are_those_of_one_state_also_where_a_torque_changes_its_sign():
    random = np.random.default_rng(5)
    joints = random.uniform(-3.0, 3.0, (20_000, 2))
    joints = joints[np.abs(np.sin(joints[:, 1])) > 0.1]
    # forces nearly along link 2 or through the base: there the torques change their signs
    link2 = joints.sum(axis=1) + PAPER_ACTUAL.theta1 + PAPER_ACTUAL.theta2
    direction = link2 + np.where(random.random(len(joints)) < 0.5, 0.0, np.pi) + random.normal(0, 2e-3, len(joints))
    force = 25.0 * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    tip, torques = direct_kinetostatics(PAPER_ACTUAL, joints, force)
    clear = np.abs(torques).min(axis=1) > 1e-6  # a floating joint may be anywhere in its dead band
    assert 0.1 < clear.mean() < 1.0
    posture = kinematics.posture(PAPER_ACTUAL, joints)
    back, found = inverse_kinetostatics(PAPER_ACTUAL, tip[clear], force[clear], posture[clear])
    np.testing.assert_allclose(found, torques[clear], rtol=0, atol=1e-6)
    np.testing.assert_allclose(kinematics.wrap(back - joints[clear]), 0, rtol=0, atol=1e-9)


@pytest.mark.parametrize('gripper', GripperSign)
@pytest.mark.parametrize('robot', ROBOTS)
def test_contact_gives_back_the_force_of_inverse_kinetostatics(robot, gripper):
    poses = random_poses(4, 3000)
    joints, _ = inverse_kinetostatics(robot, poses.tip, poses.force, poses.posture, gripper)
    found = contact(robot, joints, poses.centers, poses.radii, gripper, warm_start=poses.force)
    assert found.solved.all()
    np.testing.assert_allclose(found.force, poses.force, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.tip, poses.tip, atol=1e-12)


@pytest.mark.parametrize('joint', [0, 1])
@pytest.mark.parametrize('robot', ROBOTS)
def test_contact_inside_the_dead_band(robot, joint):
    """The force passes through a joint's axis; the joint is anywhere in its backlash."""
    rng = np.random.default_rng(5)
    n = 400
    links = np.stack([rng.uniform(-3, 3, n), rng.choice([-1, 1], n) * rng.uniform(0.4, 2.7, n)], axis=1)
    tip = kinematics.forward(robot, links)
    axis = np.broadcast_to([robot.x0, robot.y0], tip.shape)
    if joint == 1:
        axis = axis + kinematics.link_vectors(robot, links)[0]
    away = (tip - axis) / np.hypot(*(tip - axis).T)[:, None]
    force = rng.uniform(2, 60, n)[:, None] * rng.choice([-1, 1], n)[:, None] * away
    # the rigid tip lies on the line of force, so the real tip, deflected along it, does as well
    unit = force / np.hypot(*force.T)[:, None]
    real = tip - (robot.p_ee * np.hypot(*force.T) + robot.g_ee)[:, None] * unit
    slack = np.zeros((n, 2))
    slack[:, joint] = rng.uniform(-0.99, 0.99, n)
    joints, torques = inverse_kinetostatics(robot, real, force, kinematics.posture(robot, links))
    joints = joints + slack * [robot.g1, robot.g2]
    assert (torques[:, joint] == 0).all()
    radii = np.full(n, 0.08)
    found = contact(robot, joints, real + radii[:, None] * unit, radii, warm_start=force)
    np.testing.assert_allclose(found.force, force, atol=1e-8)


def test_without_a_hint_the_contact_is_in_equilibrium_and_rarely_another_one():
    poses = random_poses(6, 5000)
    joints, _ = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture)
    found = contact(PAPER_ACTUAL, joints, poses.centers, poses.radii)
    # the tip is on the circle, the force radial, and Ḡ of both leads back to the same joint angles
    np.testing.assert_allclose(np.hypot(*(found.tip - poses.centers).T), poses.radii, atol=1e-12)
    back, _ = inverse_kinetostatics(PAPER_ACTUAL, found.tip, found.force, poses.posture)
    np.testing.assert_allclose(back, joints, atol=1e-11)
    other = np.abs(found.force - poses.force).max(axis=1) > 1e-8
    assert other.mean() < 5e-3


def test_no_contact_no_force():
    poses = random_poses(7, 500)
    joints = kinematics.inverse(PAPER_ACTUAL, poses.tip, poses.posture)
    clear = poses.radii - 1.5e-3  # more than all play of the joints and the gripper
    found = contact(PAPER_ACTUAL, joints, poses.centers, clear)
    assert not found.force.any()
    np.testing.assert_allclose(found.tip, poses.tip, atol=1e-12)
    np.testing.assert_array_equal(found.links, joints)


def test_grazing_contact_sets_in_continuously():
    """Pressed from just clear to just touching, the force starts at zero and grows without a jump."""
    robot, n = PAPER_ACTUAL, 4001
    disc = PAPER_DISCS[1]
    normal = np.array([np.cos(1.0), np.sin(1.0)])
    depth = np.linspace(-1e-3, 1e-3, n)
    tip = np.array([disc.x, disc.y]) - (disc.radius - depth)[:, None] * normal
    joints = kinematics.inverse(robot, tip, 1)
    force = contact(robot, joints, [disc.x, disc.y], disc.radius).force
    size = np.hypot(*force.T)
    first = np.flatnonzero(size)[0]
    assert 0 < first < n - 1
    assert not size[:first].any()
    assert (np.diff(size[first - 1 :]) > 0).all()
    assert np.diff(size).max() < 0.2


def test_tension_continues_the_force_smoothly():
    poses = random_poses(8, 500)
    joints = kinematics.inverse(PAPER_ACTUAL, poses.tip, poses.posture)
    pulled = contact(PAPER_ACTUAL, joints, poses.centers, poses.radii - 3e-3, tension=True)
    pushed = contact(PAPER_ACTUAL, joints, poses.centers, poses.radii + 3e-3, tension=True)
    assert (pulled.magnitude < 0).all()
    assert (pushed.magnitude > 0).all()


def test_a_pressed_disc_has_the_force_and_the_others_none():
    centers, radii = np.array([[d.x, d.y] for d in PAPER_DISCS]), np.array([d.radius for d in PAPER_DISCS])
    normal = np.array([[np.cos(2.0), np.sin(2.0)]] * 3)
    joints, _ = inverse_kinetostatics(PAPER_ACTUAL, centers - radii[:, None] * normal, 30 * normal, 1)
    for shift in range(3):
        order = np.roll(np.arange(3), shift)
        force = contact(PAPER_ACTUAL, joints, centers[order], radii[order]).force
        np.testing.assert_allclose(force, 30 * normal if shift == 0 else np.zeros((3, 2)), atol=1e-9)
    # the gripper as the paper printed it has another equilibrium with other joint angles
    printed = contact(PAPER_ACTUAL, joints, centers, radii, GripperSign.PAPER).force
    assert np.abs(printed - 30 * normal).max() > 1.0
