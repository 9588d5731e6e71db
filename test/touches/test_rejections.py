"""Every reason to reject a touch, provoked."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, START, Scene, feed, topics_of

from scara_kinetostatic.model.cell import Lift
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector


def only_rejection(scene, **how):
    """The reason why the ninth of nine touches is rejected; the eight before it are fine."""
    detection = find_touches(scene.streams(**how), CELL)
    assert detection.found == 9
    assert len(detection.touches) == 8
    (rejection,) = detection.rejected
    assert rejection.index == 8
    assert detection.episodes[8].reason == rejection.reason
    return rejection.reason


def tap(scene):
    return scene.approach(0, 30).press(0, 30, 25.0, hold=0.02, seconds=0.05).retract(0, 30)


def oscillate(scene):
    scene.approach(0, 30)
    for number in range(24):
        joints, force = scene.pose(0, 30, 20.0 + 4.0 * (-1) ** number)
        scene.go(joints, 0.06, force)
    return scene.retract(0, 30)


def creep(scene, seconds):
    scene.approach(0, 30).press(0, 30, 10.0, hold=0.0).press(0, 30, 30.0, hold=0.0, seconds=seconds)
    return scene.retract(0, 30)


def slide(scene, degrees):
    scene.approach(0, 30).press(0, 30, 25.0, hold=0.0)
    for part in range(30):
        joints, force = scene.pose(0, 30 + degrees * (part + 1) / 30, 25.0)
        scene.go(joints, 0.05, force)
    return scene.retract(0, 30 + degrees)


def tremble(scene):
    joints, load = scene.approach(0, 30).pose(0, 30, 25.0)
    scene.go(joints, 0.3, load)
    for number in range(12):
        scene.go(joints + 3e-3 * (-1) ** number, 0.1, load)
    return scene.retract(0, 30)


def elsewhere(scene, *center):
    return scene.touch(0, 200, 25.0, center=center, radius=0.03)


@pytest.mark.parametrize(
    ('ninth', 'how', 'reason'),
    [
        (lambda scene: scene.touch(0, 30, 25.0, hold=0.1), (), 'hold too short: at rest for 0.1'),
        (tap, (), 'hold too short'),
        (oscillate, (), 'no steady force'),
        (creep, (4.0,), 'no steady force'),
        (slide, (3,), 'the joints do not rest'),
        (slide, (60,), 'no steady force'),
        (tremble, (), 'the joints do not rest: they do during only '),
        (elsewhere, (-0.05, 0.5), 'no object there; the nearest, '),
    ],
)
def test_a_touch_that_is_none(ninth, how, reason):
    assert only_rejection(ninth(Scene().touches(8), *how)).startswith(reason)


@pytest.mark.parametrize(
    ('begin', 'end', 'rejected'),
    [(-0.1, 0.1, [3]), (0.3, 0.35, [3]), (-1.5, -0.9, []), (-100.0, 100.0, [*range(8)])],
    ids=['press', 'hold', 'travel', 'always'],
)
def test_a_joint_that_is_to_be_held_moves(begin, end, rejected):
    """While the fourth touch is pressed, in its hold, in the travel before it, all the time; online as offline."""
    scene = Scene().touches(8)
    cell = replace(CELL, lift=Lift('joint3', 0.02, 0.0), hold={'joint4': 0.5, 'not_published': 1.0})
    streams, hold = scene.streams(), scene.holds[3][2]
    time = 1e-9 * (streams.joints.stamp - START)
    wrist = np.where((time > hold + begin) & (time < hold + end), 0.52, 0.5 + 5e-4)
    others = np.stack([0.01 * np.sin(time), wrist, np.full(len(time), np.nan)], axis=-1)
    found = find_touches(replace(streams, joints=replace(streams.joints, others=others)), cell)
    assert found.found == 8
    assert [item.index for item in found.rejected] == rejected
    assert {item.reason for item in found.rejected} <= {'joint4 is at 0.52, expected 0.5 (robot.hold)'}

    detector = OnlineDetector(cell)
    answers = [answer for _, answer in feed(detector, topics_of(streams, others=others))]
    online = [one for answer in [*answers, detector.finish()] for one in answer.episodes]
    assert [(one.index, one.reason) for one in online] == [(one.index, one.reason) for one in found.episodes]


def test_gaps_and_the_end_of_a_topic():
    scene = Scene().touches(9)
    after, press, last = scene.holds[4][3], scene.holds[5][2], scene.holds[8][2]
    for lost, rejected, reason in (
        ([('wrench', after + 0.05, after + 0.3), ('joints', after + 0.5, after + 0.9)], [], None),
        ([('wrench', after + 0.1, press + 0.1)], [5], 'gap'),
        ([('wrench', press + 0.15, press + 0.35)], [5], f'gap of 0.2.*{CELL.sensor.wrench}'),
        ([('joints', last - 0.05, np.inf)], [8], CELL.sensor.joint_states),
    ):
        detection = find_touches(scene.streams(without=lost), CELL)
        assert detection.found == 9
        assert [item.index for item in detection.rejected] == rejected
        assert all(re.search(reason, item.reason) for item in detection.rejected)


def test_begins_in_contact():
    scene = Scene()
    joints, force = scene.pose(0, 30, 25.0)
    scene.rows = [(0.0, *joints, *force)]
    scene.rest(0.8).retract(0, 30).touches(8)
    detection = find_touches(scene.streams(), CELL)
    assert detection.found == 9
    assert [rejection.index for rejection in detection.rejected] == [0]
    assert detection.rejected[0].reason.startswith('no free motion before it')


@pytest.mark.parametrize(
    ('rates', 'free', 'said'),
    [
        ((500.0, 10.0), 0.3, r'/wrench is sampled too slowly: (\d) of 5 samples needed for the force zero in the'),
        ((500.0, 10.0), 1.0, r'/wrench is sampled too slowly: (\d) of 10 samples needed for a hold in the'),
        ((10.0, 500.0), 1.0, r'/joint_states is sampled too slowly: (\d) of 10 samples needed for a hold in the'),
    ],
)
def test_topics_that_are_sampled_too_slowly(rates, free, said):
    scene = Scene()
    for number in range(9):
        disc, degrees, posture = number % 3, 45 * number + 20, (1, -1)[number % 2]
        scene.go(scene.pose(disc, degrees, posture=posture)[0], free).press(disc, degrees, 25.0, posture=posture)
        scene.go(scene.pose(disc, degrees, posture=posture)[0], 0.1)
    reasons = [each.reason for each in find_touches(scene.streams(rates=rates), CELL).rejected]
    found = [match for reason in reasons if (match := re.match(said, reason))]
    assert 2 * len(found) > len(reasons) >= 5
    assert all(int(match[1]) < 10 for match in found)


@pytest.mark.parametrize(
    ('which', 'begin', 'said'),
    [('joints', -0.45, 'the joint readings are frozen'), ('wrench', 0.02, 'the force reading is frozen')],
)
def test_frozen_sensor(which, begin, said):
    scene = Scene().touches(8).touch(0, 30, 25.0, hold=0.6)
    streams = scene.streams()
    joints, wrench = streams.joints, streams.wrench
    stamp, values = (joints.stamp, joints.position) if which == 'joints' else (wrench.stamp, wrench.force)
    time = 1e-9 * (stamp - joints.stamp[0])
    frozen = (time > scene.holds[-1][2] + begin) & (time < scene.holds[-1][3])
    values[frozen] = values[np.flatnonzero(frozen)[0]]
    detection = find_touches(streams, CELL)
    assert [rejection.index for rejection in detection.rejected] == [8]
    assert said in detection.rejected[0].reason


@pytest.mark.parametrize('axis', [0, 1])
def test_saturated_axis(axis):
    streams = Scene().touches(8).touch(0, (30, 60)[axis], 60.0).streams()
    np.clip(streams.wrench.force, (-25.0, -45.0)[axis], 45.0, out=streams.wrench.force)
    detection = find_touches(streams, CELL)
    assert 8 in [rejection.index for rejection in detection.rejected]
    assert 'saturated: ' in detection.rejected[-1].reason
    assert f'f{"xy"[axis]} = ' in detection.rejected[-1].reason


def test_no_touch_is_the_mean_of_two_robots_on_one_topic():
    streams = Scene().touches(6).streams()
    streams.joints.position[1::2] += 0.005
    detection = find_touches(streams, CELL)
    assert detection.found == 6
    assert len(detection.touches) == 0
    assert 'messages of two robots on one topic?' in detection.rejected[0].reason


def test_no_contact_at_all():
    scene = Scene().go((0.1, 0.8), 1.0).go((1.0, 1.8), 2.0)
    detection = find_touches(scene.streams(), CELL)
    assert detection.found == len(detection.touches) == len(detection.rejected) == 0
