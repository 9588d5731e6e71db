"""The memory of a load: the play against its definition step by step, and the turning points that are enough for it."""

from __future__ import annotations

import numpy as np
import pytest
from model.helpers import ROBOTS, random_poses

from scara_kinetostatic.model.cell import SensorFrame
from scara_kinetostatic.model.joint_law import joint_torques
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.play_operator import play_limits, play_operator, play_range, remembered
from scara_kinetostatic.model.touch import torques_of


def test_loaded_from_zero_it_lags_by_its_half_width_and_keeps_as_much_unloaded():
    loads = np.array([-9.0, -1.0, 0.5, 7.0])
    nothing = np.empty((4, 0))
    np.testing.assert_allclose(play_operator(nothing, loads, 2.0)[0], [-7.0, 0.0, 0.0, 5.0])
    np.testing.assert_allclose(play_operator(loads[:, None], np.zeros(4), 2.0)[0], [-2.0, 0.0, 0.0, 2.0])
    half = play_operator(loads[:, None], loads - np.sign(loads), 2.0)  # unloaded by less than 2 r
    np.testing.assert_allclose(half[0], [-7.0, 0.0, 0.0, 5.0])
    np.testing.assert_allclose(half[1], [1.0, 0.0, 0.0, -1.0])


def test_the_derivative_and_many_widths_at_once():
    random = np.random.default_rng(3)
    history, load, widths = random.normal(0, 5, (50, 6)), random.normal(0, 5, 50), np.array([[0.7], [1.9], [6.1]])
    state = play_operator(history, load, widths)
    assert state[0].shape == (3, 50)
    up, down = (play_operator(history, load, widths + sign * 1e-6)[0] for sign in (1, -1))
    np.testing.assert_allclose(state[1], (up - down) / 2e-6, atol=1e-8)
    for row, width in zip(state[0], widths[:, 0], strict=True):
        np.testing.assert_array_equal(row, play_operator(history, load, float(width))[0])


def test_what_is_remembered_is_enough_for_every_play_of_both_joints():
    random = np.random.default_rng(4)
    for _ in range(10):
        load = np.round(random.normal(0, 5, (60, 2)) * random.integers(0, 2, (60, 1)), 1)  # back to 0 again and again
        last = random.normal(0, 5, 2)
        few = load[remembered([(one, other) for one, other in load.tolist()])]
        assert len(few) < 25
        for joint in (0, 1):
            for width in (0.05, 0.5, 1.5, 4.0):
                all_of_it, enough = (
                    play_operator(part[None, :, joint], last[joint : joint + 1], width)[0] for part in (load, few)
                )
                np.testing.assert_allclose(enough, all_of_it, rtol=0, atol=1e-12)


@pytest.mark.parametrize('robot', ROBOTS)
def test_torques_in_both_frames(robot):
    poses = random_poses(2, 50, robot)
    joints = np.random.default_rng(2).uniform(-2, 2, (50, 2))
    expected = joint_torques(robot, joints, poses.force)
    found = torques_of(robot, np.concatenate([joints, poses.force], axis=1))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    seen = rotate(poses.force, -(joints.sum(axis=1) + robot.theta1 + robot.theta2))
    found = torques_of(robot, np.concatenate([joints, seen], axis=1), SensorFrame.TOOL)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_friction_that_grows_with_the_load() -> None:
    """Against its definition |C - p| ≤ r + μ |p|, one small step after the other, and its derivatives."""
    random = np.random.default_rng(4)
    turns, r, mu = random.uniform(-10.0, 10.0, (8, 4)), 0.7, 0.35
    found = play_operator(turns[:, :-1], turns[:, -1], r, mu)
    value, here = np.zeros(8), np.zeros(8)
    for turn in turns.T:
        for load in np.linspace(here, turn, 301)[1:]:
            for _ in range(60):  # friction lets through what it cannot hold
                excess = np.abs(load - value) - r - mu * np.abs(value)
                value = value + 0.3 * np.sign(load - value) * np.maximum(excess, 0.0)
                if not (excess > 1e-9).any():
                    break
        here = turn
    np.testing.assert_allclose(found.value, value, atol=1e-6)
    step = 1e-6
    for k, derivative in ((0, found.by_half_width), (1, found.by_ratio)):
        up, down = (
            play_operator(turns[:, :-1], turns[:, -1], *(np.array([r, mu]) + sign * step * np.eye(2)[k])).value
            for sign in (1, -1)
        )
        np.testing.assert_allclose((up - down) / (2 * step), derivative, atol=1e-6)


def test_the_range_of_the_operator_holds_every_beginning() -> None:
    load = np.cumsum(np.random.default_rng(5).normal(0.0, 1.0, 300))
    low, high = play_range(load, 0.5, 0.3)
    for end in (1, 17, 300):
        value = play_operator(load[None, : end - 1], load[end - 1 : end], 0.5, 0.3).value[0]
        assert low[end - 1] - 1e-12 <= value <= high[end - 1] + 1e-12
        least, most = play_limits(load[0], 0.5, 0.3)
        start = min(max(0.0, least), most)
        assert np.clip(start, low[end - 1], high[end - 1]) == pytest.approx(value)
