"""H̄, Ḡ and A with effects: H̄∘Ḡ and A∘Ḡ are identities."""

from __future__ import annotations

import numpy as np
import pytest
from effects.scenes import EFFECTS, LABELS, plausible, random_scene
from model.helpers import ROBOTS

from scara_kinetostatic.model.contact import contact
from scara_kinetostatic.model.extension import Extension
from scara_kinetostatic.model.gripper import Gripper, GripperSign
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics
from scara_kinetostatic.model.law import TouchMetadata

ROBOT = [effect for effect in EFFECTS if not effect.on_object]
OBJECT = [effect for effect in EFFECTS if effect.on_object]
SKEWED = Gripper(GripperSign.PHYSICAL, ((3e-6, 1e-6), (-2e-6, -4e-6)))
BOTH = pytest.mark.parametrize('robot', ROBOTS, ids=['actual', 'measured'])


def of_all():
    """All effects of the robot, and their values."""
    return tuple(ROBOT), tuple(value for effect in ROBOT for value in plausible(effect))


def moves_robot(effect):
    at = random_scene(0, 20).touch_state(effect, plausible(effect))
    return any(part is not None and part.any() for part in effect.shift(at, plausible(effect)))


def check_identity(scene, parameters, extension, gripper):
    poses = scene.poses
    joints, torques = inverse_kinetostatics(
        parameters, poses.tip, poses.force, poses.posture, gripper, extension=extension
    )
    tip, force = direct_kinetostatics(parameters, joints, torques, gripper, extension=extension)
    np.testing.assert_allclose(tip, poses.tip, rtol=0, atol=1e-12)
    np.testing.assert_allclose(force, poses.force, rtol=0, atol=1e-9)
    return joints


@BOTH
@pytest.mark.parametrize('gripper', [Gripper(), SKEWED], ids=['isotropic', 'skewed'])
@pytest.mark.parametrize('effect', ROBOT, ids=[effect.label for effect in ROBOT])
def test_direct_undoes_inverse_and_contact_gives_the_force_back(effect, robot, gripper):
    scene = random_scene(5, 300, robot)
    parameters = robot.replace(extra=tuple(plausible(effect)))
    extension = Extension((effect,), scene.metadata)
    joints = check_identity(scene, parameters, extension, gripper)
    plain, _ = inverse_kinetostatics(robot, scene.poses.tip, scene.poses.force, scene.poses.posture, gripper)
    assert (np.abs(joints - plain).max() > 1e-7) == moves_robot(effect)
    discs = scene.poses.centers, scene.poses.radii
    found = contact(parameters, joints, *discs, gripper, warm_start=scene.poses.force, extension=extension)
    assert found.solved.all()
    np.testing.assert_allclose(found.force, scene.poses.force, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.tip, scene.poses.tip, rtol=0, atol=1e-11)


@BOTH
def test_all_effects_of_the_robot_at_once(robot):
    scene = random_scene(6, 300, robot)
    effects, values = of_all()
    parameters, extension = robot.replace(extra=values), Extension(effects, scene.metadata)
    joints = check_identity(scene, parameters, extension, Gripper())
    found = contact(
        parameters, joints, scene.poses.centers, scene.poses.radii, warm_start=scene.poses.force, extension=extension
    )
    assert found.solved.mean() > 0.99
    np.testing.assert_allclose(found.force[found.solved], scene.poses.force[found.solved], rtol=0, atol=1e-8)


@pytest.mark.parametrize('effect', OBJECT, ids=[effect.label for effect in OBJECT])
def test_effects_of_the_object_are_no_matter_of_the_robot(effect):
    scene = random_scene(7, 100)
    parameters = scene.parameters.replace(extra=tuple(plausible(effect)))
    extension, poses = Extension((effect,), scene.metadata), scene.poses
    extended = inverse_kinetostatics(parameters, poses.tip, poses.force, poses.posture, extension=extension)
    plain = inverse_kinetostatics(parameters, poses.tip, poses.force, poses.posture)
    np.testing.assert_array_equal(extended, plain)
    again = direct_kinetostatics(parameters, *plain, extension=extension)
    np.testing.assert_array_equal(again, direct_kinetostatics(parameters, *plain))


@pytest.mark.parametrize('label', ['link_bending[link1]', 'transmission_error[joint2]', 'thermal_drift'])
def test_without_force_and_out_of_reach(label):
    effect = EFFECTS[LABELS.index(label)]
    parameters = ROBOTS[0].replace(extra=tuple(plausible(effect)))
    tip, force = np.array([[0.3, 0.3], [0.9, 0.3]]), np.array([[0.0, 0.0], [5.0, 0.0]])
    extension = Extension((effect,), TouchMetadata.plain(2)._replace(time=np.array([100.0, 200.0])))
    joints, torques = inverse_kinetostatics(parameters, tip, force, 1, extension=extension)
    assert np.isnan(joints[1]).all()
    assert not torques[0].any()
    back, still = direct_kinetostatics(parameters, joints[:1], torques[:1], extension=extension.select(np.array([0])))
    np.testing.assert_allclose(back, tip[:1], rtol=0, atol=1e-13)
    assert not still.any()
