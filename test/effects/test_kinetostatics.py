"""H̄, Ḡ and A with effects: H̄∘Ḡ and A∘Ḡ are identities."""

from __future__ import annotations

import numpy as np
import pytest
from effects.scenes import EFFECTS, KINDS, plausible, random_scene, with_effect
from model.helpers import ROBOTS

from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.kinematics import GripperSign
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics

ROBOT = [effect for effect in EFFECTS if not effect.on_object]
OBJECT = [effect for effect in KINDS if effect.on_object]


def moves_robot(effect):
    at = random_scene(0, 20).touch_state
    return any(part is not None and part.any() for part in effect.shift(at, plausible(effect)))


def check_identity(scene, model, gripper):
    poses = scene.poses
    joints, torques = inverse_kinetostatics(
        model, poses.tip, poses.force, poses.posture, gripper, metadata=scene.metadata
    )
    clear = (np.abs(torques) > 0.01 * np.hypot(*poses.force.T)[:, None]).all(axis=1)
    metadata = scene.metadata.select(clear)
    tip, found = direct_kinetostatics(model, joints[clear], poses.force[clear], gripper, metadata)
    np.testing.assert_allclose(tip, poses.tip[clear], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found, torques[clear], rtol=0, atol=1e-9)
    return joints


@pytest.mark.parametrize(('robot', 'gripper'), zip(ROBOTS, GripperSign, strict=True), ids=['actual', 'measured'])
@pytest.mark.parametrize(
    'effect', [effect for effect in KINDS if not effect.on_object], ids=lambda effect: effect.label
)
def test_direct_undoes_inverse_and_contact_gives_the_force_back(effect, robot, gripper):
    scene = random_scene(5, 300, robot)
    model = with_effect(effect, robot)
    joints = check_identity(scene, model, gripper)
    plain, _ = inverse_kinetostatics(robot, scene.poses.tip, scene.poses.force, scene.poses.posture, gripper)
    assert (np.abs(joints - plain).max() > 1e-7) == moves_robot(effect)
    discs = scene.poses.centers, scene.poses.radii
    found = contact(model, joints, *discs, gripper, warm_start=scene.poses.force, metadata=scene.metadata)
    assert found.solved.all()
    np.testing.assert_allclose(found.force, scene.poses.force, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.tip, scene.poses.tip, rtol=0, atol=1e-11)


@pytest.mark.parametrize('effect', OBJECT, ids=[effect.label for effect in OBJECT])
def test_effects_of_the_object_are_no_matter_of_the_robot(effect):
    scene = random_scene(7, 100)
    model, poses, metadata = with_effect(effect, scene.parameters), scene.poses, scene.metadata
    extended = inverse_kinetostatics(model, poses.tip, poses.force, poses.posture, metadata=metadata)
    plain = inverse_kinetostatics(scene.parameters, poses.tip, poses.force, poses.posture)
    np.testing.assert_array_equal(extended, plain)
    again = direct_kinetostatics(model, plain[0], poses.force, metadata=metadata)
    np.testing.assert_array_equal(again, direct_kinetostatics(scene.parameters, plain[0], poses.force))
