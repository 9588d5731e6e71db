"""The tip under load: what the noise of a measured pose does to it, against differences."""

from __future__ import annotations

import numpy as np
import pytest
from model.helpers import random_poses

from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import Gripper, GripperSign
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.model.tip import Force, Law, inverse_of_rows, tip_by_joints, tip_by_noise, tip_under_load


@pytest.mark.parametrize('sign', list(GripperSign))
def test_noise_of_a_pose(sign):
    """Columns by q1, q2, F_x and F_y, each one standard deviation."""
    noise, gripper = Noise((1e-5, 3e-5), 0.2, 0.01), Gripper(sign)
    law = Law(ExtendedModel(PAPER_ACTUAL), gripper, noise)
    poses = random_poses(5, 80)
    joints, _ = inverse_kinetostatics(PAPER_ACTUAL, poses.tip, poses.force, poses.posture, gripper)
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
