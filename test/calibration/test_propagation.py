"""The tip under a force obeys the law of the joints in every pose, also where a torque changes its sign."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.propagation import tip_under_force
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.gripper import Gripper
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL


def test_angles_torques_and_tip_are_those_of_one_state() -> None:
    random = np.random.default_rng(5)
    joints = random.uniform(-3.0, 3.0, (40_000, 2))
    joints = joints[np.abs(np.sin(joints[:, 1])) > 0.1]
    # forces nearly along link 2 or through the base: there the torques change their signs
    link2 = joints.sum(axis=1) + PAPER_ACTUAL.theta1 + PAPER_ACTUAL.theta2
    direction = link2 + np.where(random.random(len(joints)) < 0.5, 0.0, np.pi) + random.normal(0, 2e-3, len(joints))
    force = 25.0 * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    tip, torques = tip_under_force(ExtendedModel(PAPER_ACTUAL), joints, force, Gripper())
    clear = np.abs(torques).min(axis=1) > 1e-6  # a floating joint may be anywhere in its dead band
    assert 0.1 < clear.mean() < 1.0
    back, found = direct_kinetostatics(PAPER_ACTUAL, joints[clear], torques[clear], Gripper())
    np.testing.assert_allclose(found, force[clear], rtol=0, atol=1e-6)
    np.testing.assert_allclose(back, tip[clear], rtol=0, atol=1e-9)
