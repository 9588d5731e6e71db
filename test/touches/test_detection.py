"""Touches found in ordinary and in awkward recordings are those that were made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, START, TOOL_REACTION, Scene

from scara_kinetostatic.model.cell import SensorSign
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED
from scara_kinetostatic.simulation.motion import Timing
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams, simulate_touches
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.streams import WrenchStream

PLAN = default_plan(CELL)
WRONG = PAPER_MEASURED.replace(x0=0.02, y0=-0.02, theta1=0.052, theta2=-0.052, l1=0.34, l2=0.32)


def check_against_plan(cell, truth, plan, sensors, seed, force=0.06, joint=2e-6, timing=None):
    """The touches found agree with those made up to white noise and resolution."""
    detection = find_touches(simulate_streams(cell, truth, plan, sensors=sensors, seed=seed, timing=timing), cell)
    made = simulate_touches(cell, truth, plan, sensors.touch_noise, seed)
    assert [rejection.reason for rejection in detection.rejected] == []
    assert detection.found == len(plan)
    found = detection.touches
    np.testing.assert_array_equal(found.disc, plan.disc)
    np.testing.assert_array_equal(found.posture, plan.posture)
    np.testing.assert_allclose(found.force, made.force, rtol=0, atol=force)
    np.testing.assert_allclose(found.joints, made.joints, rtol=0, atol=joint)
    return found, made


@pytest.mark.parametrize(
    ('truth', 'seed'), [(PAPER_ACTUAL, 0), (PAPER_MEASURED, 1), (WRONG, 1)], ids=['actual', 'measured', 'wrong']
)
def test_every_touch_of_the_plan_is_found(truth, seed):
    cell = (CELL, TOOL_REACTION)[seed]
    bias = tuple(2.0 * np.random.default_rng(seed).standard_normal(2))
    found, _ = check_against_plan(cell, truth, PLAN, SensorModel(bias=bias), seed)
    assert np.all(found.samples > 20)
    assert 0.02 < np.median(found.force_scatter) < 0.08


def test_means_are_not_biased():
    errors = []
    for seed in range(3):
        found, made = check_against_plan(CELL, PAPER_MEASURED, PLAN, SensorModel(), seed)
        errors.append(np.hstack([found.force - made.force, found.joints - made.joints]))
    mean = np.concatenate(errors).mean(axis=0)
    assert np.abs(mean[:2]).max() < 0.002  # N, of 0.3 N noise of a touch
    assert np.abs(mean[2:]).max() < 1e-7  # rad, of 1e-5 rad


@pytest.mark.parametrize(
    ('sensors', 'force', 'joint'),
    [
        (SensorModel.ideal(), 1e-4, 1e-8),
        (SensorModel(joint_noise=1e-5, force_noise=0.12), 0.12, 8e-6),
        (SensorModel(joint_rate=500.0, wrench_rate=1000.0), 0.02, 2e-6),
        (SensorModel(joint_rate=1000.0, wrench_rate=1000.0), 0.02, 2e-6),
        (SensorModel(joint_rate=50.0, wrench_rate=50.0), 0.1, 2e-6),
        (SensorModel(joint_rate=30.0, wrench_rate=50.0), 0.1, 2e-6),
        (SensorModel(joint_rate=125.0, wrench_rate=40.0, jitter=0.15), 0.1, 2e-6),
        (SensorModel(force_noise=0.01, bias=(-3.0, 2.5), resolution=1e-5), 0.02, 6e-6),
    ],
)
def test_rates_and_noise(sensors, force, joint):
    check_against_plan(CELL, PAPER_ACTUAL, PLAN.select(np.arange(24)), sensors, 3, force, joint)


@pytest.mark.parametrize('levels', [(3.0, 5.0), (2.5, 300.0), (150.0, 400.0)])
def test_force_levels(levels):
    plan = default_plan(CELL, per_disc=4, levels=levels)
    sensors = SensorModel(force_noise=0.03, bias=(2.0, 1.5))
    check_against_plan(replace(CELL, noise=CELL.noise._replace(force=0.05)), PAPER_ACTUAL, plan, sensors, 0)


def test_shortest_hold_and_slow_press():
    plan = PLAN.select(np.arange(12))
    check_against_plan(CELL, PAPER_ACTUAL, plan, SensorModel(), 0, timing=Timing(hold=0.2), force=0.25, joint=1e-5)
    check_against_plan(CELL, PAPER_ACTUAL, plan, SensorModel(), 0, timing=Timing(press=2.5, hold=4.0, travel=3.0))


@pytest.mark.parametrize('speed', [1e-4, 2e-4, 1e-3])
def test_the_steady_part_of_a_slow_press_is_the_hold(speed):
    scene = Scene(CELL, PAPER_MEASURED)
    for number in range(9):
        where = {'disc': number % 3, 'degrees': 45 * number + 20, 'posture': (1, -1)[number % 2]}
        force = (10.0, 25.0, 40.0)[number // 3]
        free, loaded = (forward(PAPER_MEASURED, scene.pose(**where, force=size)[0]) for size in (0.0, force))
        seconds = float(np.hypot(*(loaded - free))) / speed
        scene.approach(**where).press(**where, force=force, hold=0.7, seconds=seconds)
        scene.go(scene.pose(**where)[0], seconds).retract(**where)
    detection = find_touches(scene.streams(noise=0.3 if speed == 1e-3 else 0.05), CELL)
    assert detection.found == len(detection.touches) == 9
    middle = np.array([0.5 * (begin + end) for _, _, begin, end in scene.holds])
    np.testing.assert_allclose(detection.touches.time, middle, rtol=0, atol=0.4)
    np.testing.assert_allclose(detection.touches.force, scene.truth_of_holds()[1], rtol=0, atol=0.3)


@pytest.mark.parametrize(('speed', 'noise'), [(5e-5, 0.02), (1e-4, 0.05)])
def test_pieces_of_a_slow_press_are_no_touches(speed, noise):
    scene, where = Scene(CELL, PAPER_MEASURED), {'disc': 1, 'degrees': 60, 'posture': 1}
    for force in (10.0, 25.0, 40.0):
        free, loaded = (forward(PAPER_MEASURED, scene.pose(**where, force=size)[0]) for size in (0.0, force))
        seconds = float(np.hypot(*(loaded - free))) / speed
        scene.approach(**where).press(**where, force=force, hold=0.0, seconds=seconds).retract(**where)
    detection = find_touches(scene.streams(noise=noise), CELL)
    assert detection.found == len(detection.rejected) == 3


def test_weight_of_the_tool_in_motion_is_no_touch():
    plan = PLAN.select(np.arange(24))
    streams = simulate_streams(CELL, PAPER_ACTUAL, plan)
    time = 1e-9 * (streams.joints.stamp - START)
    speed = np.gradient(streams.joints.position, time, axis=0)
    inertia = 0.05 * np.gradient(speed, time, axis=0)
    at = 1e-9 * (streams.wrench.stamp - START)
    streams.wrench.force[:] += np.column_stack([np.interp(at, time, column) for column in inertia.T])
    assert np.abs(inertia).max() > 1.5
    detection = find_touches(streams, CELL)
    assert len(detection.touches) == detection.found == len(plan)
    assert any('weak forces' in warning for warning in detection.warnings)


def test_slow_noise_of_the_sensor():
    streams = simulate_streams(CELL, PAPER_ACTUAL, PLAN, sensors=SensorModel(force_noise=0.0, wrench_rate=500.0))
    noise = np.random.default_rng(0).standard_normal((len(streams.wrench.force) + 30, 2))
    noise = np.column_stack([np.convolve(column, np.ones(31) / 31**0.5, 'valid') for column in noise.T])
    streams.wrench.force[:] += 0.08 * noise
    detection = find_touches(streams, CELL)
    assert len(detection.touches) == detection.found == len(PLAN)


def test_long_rests_do_not_pass_for_the_zero():
    scene = Scene().touch(0, 30, 25.0, hold=40.0).touch(1, 60, 10.0, hold=30.0)
    detection = find_touches(scene.streams(), CELL)
    joints, force = scene.truth_of_holds()
    np.testing.assert_allclose(detection.touches.force, force, atol=0.05)
    np.testing.assert_allclose(detection.touches.joints, joints, atol=1e-6)


@pytest.mark.parametrize('step', [-1, 1])
def test_staircase_gives_a_touch_per_level(step):
    levels = (10.0, 20.0, 32.0, 45.0)[::step]
    scene = Scene().touches(4).approach(0, 30)
    for level in levels:
        scene.press(0, 30, level, hold=0.4, seconds=0.15)
    detection = find_touches(scene.retract(0, 30).streams(), CELL)
    assert len(detection.touches) == detection.found == 8
    np.testing.assert_allclose(np.linalg.norm(detection.touches.force[4:], axis=1), levels, atol=0.1)
    assert np.unique([episode.contact for episode in detection.episodes[4:]], axis=0).shape == (1, 2)


def test_disturbed_hold_is_one_touch():
    scene = Scene().touches(4).approach(0, 30).press(0, 30, 20.0, hold=0.4)
    scene.press(0, 30, 24.0, hold=0.0, seconds=0.04).press(0, 30, 20.0, hold=0.4, seconds=0.04).retract(0, 30)
    detection = find_touches(scene.streams(), CELL)
    assert len(detection.touches) == detection.found == 5
    assert np.linalg.norm(detection.touches.force[4]) == pytest.approx(20.0, abs=0.05)


def test_spikes_and_drift_and_lost_values():
    scene = Scene().touches(12)
    streams = scene.streams(drift=0.08)
    random = np.random.default_rng(1)
    streams.wrench.force[random.choice(len(streams.wrench.force), 30, replace=False)] += 30.0
    streams.wrench.force[random.choice(len(streams.wrench.force), 10, replace=False)] = np.nan
    streams.joints.position[random.choice(len(streams.joints.position), 10, replace=False)] = np.inf
    streams.wrench.force[:20] = streams.joints.position[:15] = np.nan  # before the hardware is ready
    detection = find_touches(streams, CELL)
    assert detection.rejected == ()
    np.testing.assert_allclose(detection.touches.force, scene.truth_of_holds()[1], atol=0.25)
    assert any('not finite' in warning for warning in detection.warnings)
    assert any('zero of the force sensor changes' in warning for warning in detection.warnings)


def test_stamps_out_of_order_and_repeated():
    streams = Scene().touches(4).streams()
    expected = find_touches(streams, CELL).touches
    order = np.arange(len(streams.wrench.stamp))
    order[100:1100:7], order[101:1101:7] = order[101:1101:7].copy(), order[100:1100:7].copy()
    order = np.append(order, order[-200:])
    mixed = replace(streams, wrench=WrenchStream(streams.wrench.stamp[order], streams.wrench.force[order]))
    np.testing.assert_array_equal(find_touches(mixed, CELL).touches.force, expected.force)


def test_topics_on_different_clocks():
    streams = Scene().touches(3).streams()
    apart = WrenchStream(streams.wrench.stamp + 10**15, streams.wrench.force)
    detection = find_touches(replace(streams, wrench=apart), CELL)
    assert len(detection.touches) == 0
    assert any('0.0 s in common' in warning for warning in detection.warnings)


def test_another_sign_is_said():
    wrong = replace(CELL, sensor=CELL.sensor._replace(sign=SensorSign.ON_ROBOT))
    detection = find_touches(simulate_streams(CELL, PAPER_ACTUAL, PLAN), wrong)
    assert {item.kind for item in detection.rejected} == {'no object'}
    assert len(detection.touches) + len(detection.rejected) == len(detection.held) == len(PLAN)
    assert any(text.startswith('most touches meet no object: check sensor.frame') for text in detection.warnings)


def test_episodes_tell_where_the_touches_lie():
    scene = Scene().touches(6)
    detection = find_touches(scene.streams(bias=(1.2, -0.8)), CELL)
    assert abs(detection.start - START) < 1e9
    for episode, hold in zip(detection.episodes, scene.holds, strict=True):
        assert episode.contact[0] < episode.hold[0] < episode.hold[1] < episode.contact[1]
        assert episode.hold[0] == pytest.approx(hold[2], abs=0.05)
        assert episode.hold[1] == pytest.approx(hold[3], abs=0.05)
    np.testing.assert_allclose(detection.touches.force, find_touches(scene.streams(), CELL).touches.force, atol=0.05)
    middles = [sum(episode.hold) / 2 for episode in detection.episodes]
    np.testing.assert_allclose(detection.touches.time, middles, rtol=0, atol=0.08)
