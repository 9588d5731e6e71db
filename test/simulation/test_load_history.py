"""The load before the holds of a plan: enough for every joint with memory, and the same as of whole streams."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.studies import CELL, EXACT

from scara_kinetostatic.calibration.fit_point import force_residual
from scara_kinetostatic.calibration.observations import observe
from scara_kinetostatic.effects.joints import JointSlip
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.model.play_operator import play_operator
from scara_kinetostatic.model.touch import torques_of
from scara_kinetostatic.simulation.motion import Trajectory
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

PLAN = default_plan(CELL, 3, preload=0.4)
SLIP = ExtendedModel(PAPER_ACTUAL, (JointSlip.of(0), JointSlip.of(1)), ((6e-5, 1.5), (4e-5, 2.0)))


@pytest.fixture(scope='module')
def slipping():
    return Trajectory(CELL, SLIP, PLAN)


def test_the_memory_goes_from_touch_to_touch(slipping):
    """The state of friction of each hold, step by step through all peaks, holds and free motions."""
    trajectory = slipping
    touches = simulate_touches(CELL, SLIP, PLAN, EXACT)
    peaks = torques_of(PAPER_ACTUAL, np.concatenate([trajectory.peak_joints, trajectory.peak_force], axis=1))
    holds = torques_of(PAPER_ACTUAL, np.concatenate([trajectory.hold_joints, trajectory.hold_force], axis=1))
    found = torques_of(PAPER_ACTUAL, touches.history)
    path = np.zeros((0, 2))
    for k, (peak, hold, preload) in enumerate(zip(peaks, holds, PLAN.preload > 0, strict=True)):
        path = np.concatenate([path, peak[None]]) if preload else path
        for joint, width in ((0, 1.5), (1, 2.0), (0, 0.3)):
            expected = play_operator(path[None, :, joint], hold[joint : joint + 1], width)[0]
            enough = play_operator(found[k : k + 1, :, joint], hold[joint : joint + 1], width)[0]
            np.testing.assert_allclose(enough, expected, rtol=0, atol=0.02)  # another extreme of nearly the same size
        path = np.concatenate([path, hold[None], np.zeros((1, 2))])


def test_both_joints_slip_as_on_an_arm():
    """The force is that of the plan also where a joint is about to slip."""
    plan = default_plan(CELL, 2, levels=(4.0, 10.0, 20.0), preload=0.3)
    both = ExtendedModel(PAPER_ACTUAL, (JointSlip.of(0), JointSlip.of(1)), ((1.9e-4, 2.2), (1.9e-4, 2.2)))
    touches = simulate_touches(CELL, both, plan, EXACT)
    np.testing.assert_allclose(np.hypot(*touches.force.T), plan.force, rtol=1e-12)
    np.testing.assert_allclose(force_residual(observe(touches, CELL), both), 0.0, rtol=0, atol=1e-6)


def test_a_preloaded_joint_keeps_a_part_of_its_deflection(slipping):
    """Unloaded from the preload by less than twice the slip torque, the joint angle stays ahead of the force."""
    alone = ExtendedModel(PAPER_ACTUAL, (JointSlip.of(0),), ((6e-5, 50.0),))
    still = Trajectory(CELL, alone, PLAN)
    rigid = Trajectory(CELL, PAPER_ACTUAL, PLAN)
    np.testing.assert_allclose(still.hold_joints, rigid.hold_joints, rtol=0, atol=1e-6)  # never slips
    assert np.abs(slipping.hold_joints - rigid.hold_joints).max() > 1e-4
    np.testing.assert_allclose(np.hypot(*slipping.hold_force.T), PLAN.force, rtol=1e-12)
