"""The load before each hold: what a play operator remembers of the streams is what it remembers of the true load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, TOOL_REACTION, Scene, feed, topics_of

from scara_kinetostatic.effects.joints import JointSlip
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.model.play_operator import nested_extremes
from scara_kinetostatic.model.touch import TouchSet, torques_of
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams, simulate_touches
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector

WIDTHS = np.concatenate([[0.0], np.geomspace(0.01, 40.0, 60)])


def played(path, widths=WIDTHS):
    """State of play operators of several half-widths at the end of a path that starts relaxed."""
    state = np.zeros(len(widths))
    for value in path:
        state = np.clip(state, value - widths, value + widths)
    return state


def remembered(cell, touches):
    """States of the plays of both joints in each hold, (n, 2, widths)."""
    torque = torques_of(cell.nominal, touches.history, cell.sensor.frame)
    hold = torques_of(cell.nominal, np.hstack([touches.joints, touches.force]), cell.sensor.frame)
    return np.array([[played([*t[:, j], h[j]]) for j in (0, 1)] for t, h in zip(torque, hold, strict=True)])


@pytest.mark.parametrize('seed', range(6))
def test_nested_extremes_leave_a_play_as_the_whole_path_does(seed):
    random = np.random.default_rng(seed)
    path = random.integers(-9, 10, 80) if seed % 2 else np.cumsum(random.standard_normal(300))
    start = 0.0 if seed % 3 else path[0]  # a path from rest, and one whose start is its own
    values = np.concatenate([[start], path])
    kept = nested_extremes(values)
    assert kept == sorted(set(kept))
    np.testing.assert_array_equal(played([start, *values[kept], values[-1]]), played(values))
    swings = np.abs(np.diff(values[kept]))
    assert np.all(np.diff(swings) <= 0)


@pytest.mark.parametrize('seed', range(2))
def test_turns_within_the_noise_do_not_count(seed):
    random = np.random.default_rng(seed)
    clean = np.cumsum(random.choice([-1.0, 1.0], 60) * random.uniform(1.0, 4.0, 60))
    noisy = np.repeat(clean, 50) + 0.1 * random.uniform(-1.0, 1.0, 3000)
    values, least = np.concatenate([[0.0], noisy, clean[-1:]]), 0.25
    kept = nested_extremes(values, least)
    assert len(kept) <= len(nested_extremes(np.concatenate([[0.0], clean])))
    assert np.all(np.abs(np.diff(values[[0, *kept, -1]])) > least)
    assert np.abs(played([*values[kept], values[-1]]) - played(clean)).max() <= least


@pytest.mark.parametrize('cell', [CELL, TOOL_REACTION], ids=['base', 'tool'])
def test_streams_and_touches_of_one_seed_agree(cell):
    """A robot whose joints slip, noise of the touches and of the samples."""
    truth = ExtendedModel(PAPER_MEASURED, (JointSlip.of(0), JointSlip.of(1)), ((6e-5, 1.5), (4e-5, 0.8)))
    plan = default_plan(CELL, per_disc=6, preload=0.3)
    touches = find_touches(simulate_streams(cell, truth, plan, seed=6), cell).touches
    made = simulate_touches(cell, truth, plan, seed=6)
    assert len(touches) == len(plan)
    assert abs(touches.history.shape[1] - made.history.shape[1]) <= 2
    off = remembered(cell, touches) - remembered(cell, made)
    assert np.abs(off).max() < 0.1  # the noise of a touch is 0.3 N at up to 0.6 m, the same in both
    assert np.sqrt(np.mean(off**2)) < 0.02


@pytest.mark.parametrize(('rate', 'noise'), [(80.0, 0.3), (500.0, 0.3), (100.0, 0.0), (25.0, 0.05)])
def test_bias_of_the_turns(rate, noise):
    """Half of the deviation of the smoothed force at most; besides a peak loses 0.3 % at 100 Hz, 3.5 % at 25 Hz.

    Noise of a hold is no turn.
    """
    plan = default_plan(CELL, per_disc=6, preload=0.3)
    sensors = replace(SensorModel.ideal(rate), force_noise=noise)
    touches = find_touches(simulate_streams(CELL, PAPER_MEASURED, plan, sensors=sensors, seed=3), CELL).touches
    assert len(touches) == len(plan)
    preloaded = plan.preload > 0
    peak = ((1 + plan.preload) * plan.force)[preloaded]
    over = (np.hypot(*touches.history[:, -1, 2:].T)[preloaded] - peak) / peak
    smoothed = noise / np.sqrt(2 * round(0.015 * rate) + 1)
    flattened = (0.035 if rate < 80 else 0.003) * peak
    assert np.abs((over * peak).mean()) < 0.5 * smoothed + flattened.mean()
    assert np.all(np.abs(over * peak) < 4.0 * smoothed + flattened)
    plain = touches.history[~preloaded]
    away = np.abs(plain[..., :2] - touches.joints[~preloaded, None]).max(axis=2)
    assert np.all((away > 1e-3) | ~plain[..., 2:].any(axis=2))


def press(scene, force, seconds=0.3, hold=0.0):
    joints, load = scene.pose(0, 40, force)
    scene.go(joints, seconds, load)
    return scene.go(joints, hold, load) if hold else scene


def loads(scene, **options):
    """The forces before the last hold, N, and the detection."""
    found = find_touches(scene.streams(**options), CELL)
    return np.hypot(*found.touches.history[-1, :, 2:].T).tolist(), found


@pytest.mark.parametrize(
    ('path', 'kept'),
    [
        ((30.0, 12.0, 25.0, 14.0, 22.0, 16.0), (30.0, 12.0, 25.0, 14.0, 22.0, 16.0)),
        ((30.0, 12.0, 25.0, 10.0), (30.0, 10.0)),  # a closed loop is forgotten
    ],
)
def test_unloading_and_oscillation_in_a_contact_count(path, kept):
    scene = Scene().approach(0, 40)
    for force in path:
        press(scene, force, seconds=0.6)
    forces, _ = loads(press(scene, 20.0, hold=3.0).retract(0, 40))
    assert np.abs(np.subtract(forces, kept)).max() < 0.7


def test_holds_of_one_contact():
    scene = Scene().approach(0, 40)
    for force in (10.0, 30.0, 20.0):
        press(scene, force, hold=0.5)
    forces, found = loads(scene.retract(0, 40))
    assert len(found.touches) == 3
    np.testing.assert_allclose(forces, [30.0], rtol=0.01)
    assert not found.touches.history[:2, :, 2:].any()


def test_contacts_that_are_no_touches_count():
    scene = Scene().touch(0, 40, 10.0).touch(0, 40, 40.0, hold=0.1).touch(0, 40, 10.0)
    forces, found = loads(scene)
    assert [item.index for item in found.rejected] == [1]
    np.testing.assert_allclose(forces, [40.0, 0.0], rtol=0.01)


def test_a_contact_without_free_motion_before_it_counts():
    scene = Scene().touch(0, 40, 10.0).approach(0, 40)
    press(scene, 20.0, hold=0.5)
    press(scene, 0.0, seconds=0.05, hold=0.06)
    press(scene, 40.0, seconds=0.1, hold=0.5).retract(0, 40).touch(0, 40, 15.0)
    forces, found = loads(scene)
    assert any('no free motion' in item.reason for item in found.rejected)
    np.testing.assert_allclose(forces, [40.0, 0.0], rtol=0.01)


def test_online_history_is_that_of_the_whole_recording(cell=TOOL_REACTION):
    plan = default_plan(cell, per_disc=4, preload=0.3)
    streams = simulate_streams(cell, PAPER_MEASURED, plan, seed=4)
    offline = find_touches(streams, cell).touches
    detector = OnlineDetector(cell, horizon=15_000_000_000)
    answers = [answer for _, answer in feed(detector, topics_of(streams), 40)]
    online = TouchSet.concatenate([answer.touches for answer in [*answers, detector.finish()] if answer.found])
    np.testing.assert_array_equal(online.index, offline.index)
    np.testing.assert_allclose(remembered(cell, online), remembered(cell, offline), rtol=0, atol=0.01)
