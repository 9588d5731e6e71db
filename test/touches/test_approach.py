"""The last movement before a hold: from the last turning round, the same from streams and without them."""

from __future__ import annotations

import numpy as np
import pytest
from touches.scenes import CELL, Scene

from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED
from scara_kinetostatic.simulation.motion import Timing, Trajectory
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams, simulate_touches
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.load_history import SMALLEST_REVERSAL, last_movement


@pytest.mark.parametrize(
    ('path', 'expected'),
    [
        ([0.0, 1.0, 2.0], 3.0),
        ([6.0, 5.0, 4.0], -3.0),
        ([0.0, 5.0, 4.0], -2.0),
        ([0.0, 5.0, 1.0, 2.0], 2.0),
        ([9.0, 1.0, 1.05, 2.0, 1.95], 2.0),
        ([3.05, 2.95, 3.0], 0.0),
        ([3.05, 2.95, 4.0, 3.05], -1.0),
        ([], 0.0),
    ],
)
def test_last_movement_of_a_path_to_3(path, expected):
    both = np.array([path, np.negative(path)]).T.reshape(-1, 2)
    np.testing.assert_allclose(last_movement(np.vstack([both, [[3.0, -3.0]]]), [3.0, -3.0], 0.1), [expected, -expected])


@pytest.mark.parametrize('truth', [PAPER_ACTUAL, PAPER_MEASURED], ids=['actual', 'measured'])
@pytest.mark.parametrize('preload', [0.0, 0.3])
def test_streams_and_touches_agree(truth, preload):
    plan = default_plan(CELL, preload=preload)
    found = find_touches(simulate_streams(CELL, truth, plan, seed=2), CELL).touches
    made = simulate_touches(CELL, truth, plan, seed=2)
    clear = np.abs(made.approach) > 1.5 * SMALLEST_REVERSAL
    assert clear.sum() > 0.98 * clear.size
    np.testing.assert_array_equal(np.sign(found.approach[clear]), np.sign(made.approach[clear]))
    np.testing.assert_allclose(found.approach, made.approach, rtol=0.02, atol=8e-5)
    preloaded = plan.preload > 0
    np.testing.assert_allclose(found.approach[preloaded], made.approach[preloaded], rtol=0.05, atol=3e-6)
    clear = np.abs(made.press) > 4 * SMALLEST_REVERSAL
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(np.sign(found.press[clear]), np.sign(made.press[clear]))
    np.testing.assert_allclose(found.press, made.press, rtol=0.06, atol=1e-5)
    motion = Trajectory(CELL, truth, plan)
    turned = np.abs(motion.peak_joints - motion.hold_joints) > 4 * SMALLEST_REVERSAL
    for touches in (found, made):
        moved = touches.press != 0
        assert np.all(np.abs(touches.press[moved]) <= np.abs(touches.approach[moved]) + 1e-5)
        np.testing.assert_allclose(touches.press[turned], touches.approach[turned], rtol=0.02, atol=2e-5)


@pytest.mark.parametrize(
    ('sensors', 'timing', 'clearly'),
    [
        (SensorModel(joint_rate=20.0, wrench_rate=25.0), None, 1e-5),
        (SensorModel(joint_rate=30.0), None, 1e-5),
        (SensorModel(joint_noise=1e-5, force_noise=0.12), None, 6e-5),
        (SensorModel(resolution=1e-5), None, 4e-5),
        (SensorModel(), Timing(pause=0.0), 1e-5),
        (SensorModel(), Timing(ease=0.08, hold=0.25), 1e-5),
    ],
)
def test_sense_at_other_rates_and_noise(sensors, timing, clearly):
    plan = default_plan(CELL, preload=0.3)
    streams = simulate_streams(CELL, PAPER_MEASURED, plan, sensors=sensors, timing=timing, seed=5)
    found = find_touches(streams, CELL).touches
    made = simulate_touches(CELL, PAPER_MEASURED, plan, seed=5)
    assert len(found) == len(plan), 'the peak of a press is no touch of its own'
    clear = np.abs(made.approach) > clearly
    assert clear.sum() > 0.9 * clear.size
    np.testing.assert_array_equal(np.sign(found.approach[clear]), np.sign(made.approach[clear]))


def test_joint_that_turns_round_at_the_contact_counts_from_there():
    plan = default_plan(CELL)
    motion = Trajectory(CELL, PAPER_MEASURED, plan)
    travel, press = motion.contact_joints - motion.free_joints, motion.hold_joints - motion.contact_joints
    turned = (travel * press < 0) & (np.abs(press) > 1e-5)
    found = find_touches(simulate_streams(CELL, PAPER_MEASURED, plan), CELL).touches.approach
    assert turned.sum() >= 2
    np.testing.assert_allclose(found[turned], press[turned], rtol=0.05, atol=5e-6)
    np.testing.assert_allclose(found[~turned], (travel + press)[~turned], rtol=0.02, atol=8e-5)


def test_staircase_up_and_down():
    scene = Scene().touches(2).approach(0, 30)
    for level in (10.0, 30.0, 20.0, 40.0):
        scene.press(0, 30, level, hold=0.4, seconds=0.15)
    found = find_touches(scene.retract(0, 30).streams(), CELL).touches.approach[2:]
    pressed = np.array([scene.pose(0, 30, level)[0] for level in (10.0, 30.0, 20.0, 40.0)])
    free = scene.pose(0, 30, clearance=0.018)[0]
    up = np.sign(pressed[1] - pressed[0])
    np.testing.assert_array_equal(np.sign(found), [np.sign(pressed[0] - free), up, -up, up])
    np.testing.assert_allclose(found[2:], [pressed[2] - pressed[1], pressed[3] - pressed[2]], atol=3e-6)
