"""Every reason to reject a touch, provoked."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from touches.scenes import CELL, START, Scene

from scara_kinetostatic.model.cell import Lift
from scara_kinetostatic.report.quantities import rounded_down
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


def test_short_hold():
    reason = only_rejection(Scene().touches(8).touch(0, 30, 25.0, hold=0.1))
    assert reason.startswith('hold too short')


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

    detector, online = OnlineDetector(cell), []
    rows = [
        (int(s), 'joint', (*q, *o))
        for s, q, o in zip(streams.joints.stamp, streams.joints.position, others, strict=True)
    ]
    rows += [(int(s), 'force', f) for s, f in zip(streams.wrench.stamp, streams.wrench.force, strict=True)]
    for number, (stamp, kind, values) in enumerate(sorted(rows, key=lambda row: row[0])):
        (detector.add_joint_state if kind == 'joint' else detector.add_wrench)(stamp, values)
        if number % 20 == 0:
            online += detector.poll().episodes
    online += detector.finish().episodes
    assert [(one.index, one.reason) for one in online] == [(one.index, one.reason) for one in found.episodes]


def test_nothing_need_be_known_of_other_joints():
    streams, detector = Scene().touches(3).streams(), OnlineDetector(replace(CELL, hold={'joint4': 0.5}))
    for stamp, row in zip(streams.joints.stamp.tolist(), streams.joints.position, strict=True):
        detector.add_joint_state(stamp, row)
    for stamp, row in zip(streams.wrench.stamp.tolist(), streams.wrench.force, strict=True):
        detector.add_wrench(stamp, row)
    assert len(detector.finish().touches) == 3


def test_tap():
    scene = Scene().touches(8).approach(0, 30)
    scene.press(0, 30, 25.0, hold=0.02, seconds=0.05).retract(0, 30)
    assert only_rejection(scene).startswith('hold too short')


def test_oscillation_never_settles():
    scene = Scene().touches(8).approach(0, 30)
    for number in range(24):
        joints, force = scene.pose(0, 30, 20.0 + 4.0 * (-1) ** number)
        scene.go(joints, 0.06, force)
    assert 'no steady force' in only_rejection(scene.retract(0, 30))


@pytest.mark.parametrize('seconds', [1.0, 4.0])
def test_creeping_force_never_settles(seconds):
    scene = Scene().touches(8).approach(0, 30)
    scene.press(0, 30, 10.0, hold=0.0).press(0, 30, 30.0, hold=0.0, seconds=seconds).retract(0, 30)
    assert 'no steady force' in only_rejection(scene)


@pytest.mark.parametrize('degrees', [3, 60])
def test_slide(degrees):
    scene = Scene().touches(8).approach(0, 30).press(0, 30, 25.0, hold=0.0)
    for part in range(30):
        joints, force = scene.pose(0, 30 + degrees * (part + 1) / 30, 25.0)
        scene.go(joints, 0.05, force)
    reason = only_rejection(scene.retract(0, 30 + degrees))
    assert reason.startswith('the tip slides')


@pytest.mark.parametrize('topic', ['joints', 'wrench'])
@pytest.mark.parametrize('begin', [-0.25, 0.15])
def test_gap_in_press_or_hold(topic, begin):
    scene = Scene().touches(8).touch(0, 30, 25.0, hold=1.0)
    start = scene.holds[-1][2] + begin
    reason = only_rejection(scene, without=[(topic, start, start + 0.2)])
    name = CELL.sensor.joint_states if topic == 'joints' else CELL.sensor.wrench
    assert 'gap of 0.2' in reason
    assert name in reason


def test_gap_elsewhere_does_no_harm():
    scene = Scene().touches(9)
    end_of_hold = scene.holds[4][3]
    lost = [('wrench', end_of_hold + 0.05, end_of_hold + 0.3), ('joints', end_of_hold + 0.5, end_of_hold + 0.9)]
    detection = find_touches(scene.streams(without=lost), CELL)
    assert len(detection.touches) == detection.found == 9


def test_gap_from_one_contact_to_the_next():
    scene = Scene().touches(9)
    lost = [('wrench', scene.holds[4][3] + 0.1, scene.holds[5][2] + 0.1)]
    detection = find_touches(scene.streams(without=lost), CELL)
    assert detection.touches.index.tolist() == [0, 1, 2, 3, 4, 6, 7, 8]
    assert 'gap' in detection.rejected[0].reason


def test_joint_states_that_end():
    scene = Scene().touches(9)
    detection = find_touches(scene.streams(without=[('joints', scene.holds[8][2] - 0.05, np.inf)]), CELL)
    assert len(detection.touches) == 8
    assert CELL.sensor.joint_states in detection.rejected[0].reason


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


def test_what_is_too_little_is_never_rounded_up_to_enough():
    scene = Scene().touches(8).touch(0, 30, 25.0, hold=0.1)
    (least,) = re.findall(r'for (0\.\d\d) s, expected 0.2 s', only_rejection(scene))
    assert float(least) < 0.2
    assert (rounded_down(0.1999), rounded_down(0.0999)) == ('0.19', '0.09')


def test_joints_that_do_not_rest_are_not_called_a_force_that_is_not_steady():
    scene = Scene().touches(8)
    scene.approach(0, 30)
    joints, load = scene.pose(0, 30, 25.0)
    scene.go(joints, 0.3, load)
    for number in range(12):
        scene.go(joints + 3e-3 * (-1) ** number, 0.1, load)
    scene.retract(0, 30)
    assert only_rejection(scene).startswith('the joints do not rest: they do during only ')


@pytest.mark.parametrize('center', [(-0.05, 0.5), (0.25, 0.15)])
def test_unknown_object(center):
    scene = Scene().touches(8).touch(0, 200, 25.0, center=center, radius=0.03)
    assert only_rejection(scene).startswith('no object there; the nearest, ')


def test_frozen_force():
    scene = Scene().touches(8).touch(0, 30, 25.0, hold=0.6)
    streams = scene.streams()
    time = 1e-9 * (streams.wrench.stamp - streams.joints.stamp[0])
    frozen = (time > scene.holds[-1][2] + 0.02) & (time < scene.holds[-1][3])
    streams.wrench.force[frozen] = streams.wrench.force[np.flatnonzero(frozen)[0]]
    detection = find_touches(streams, CELL)
    assert [rejection.index for rejection in detection.rejected] == [8]
    assert 'frozen' in detection.rejected[0].reason


@pytest.mark.parametrize('axis', [0, 1])
def test_saturated_axis(axis):
    streams = Scene().touches(8).touch(0, 30, 60.0).streams()
    np.clip(streams.wrench.force, -25.0, 45.0, out=streams.wrench.force)
    if axis == 1:
        streams = Scene().touches(8).touch(0, 60, 60.0).streams()
        np.clip(streams.wrench.force, -45.0, 45.0, out=streams.wrench.force)
    detection = find_touches(streams, CELL)
    assert 8 in [rejection.index for rejection in detection.rejected]
    assert 'saturated: ' in detection.rejected[-1].reason
    assert f'f{"xy"[axis]} = ' in detection.rejected[-1].reason


def test_no_contact_at_all():
    scene = Scene().go((0.1, 0.8), 1.0).go((1.0, 1.8), 2.0)
    detection = find_touches(scene.streams(), CELL)
    assert detection.found == len(detection.touches) == len(detection.rejected) == 0
