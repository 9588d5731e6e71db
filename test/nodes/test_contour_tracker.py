"""The contour tracker publishes the outline while a slide is played, and says what it cannot trace."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Path as PathMessage
from nodes.waiting import Bench as AnyBench
from sensor_msgs.msg import JointState
from std_msgs.msg import String

import scara_kinetostatic as sk
from benchmark.common import normal_error
from scara_kinetostatic.files.calibration_file import arm_document
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.nodes.cell_node import ERROR, WARN
from scara_kinetostatic.nodes.contact_simulator import Playback
from scara_kinetostatic.nodes.contour_tracker import ContourTracker
from scara_kinetostatic.nodes.conversion import joint_state, wrench
from scara_kinetostatic.nodes.streams import LATCHED, RELIABLE_STREAM
from scara_kinetostatic.simulation.plan import Circle, Slide
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.streams import Streams

DISC = Circle((0.2, 0.3), 0.03)
SPEED = 10.0
"""Of the playback, in simulated seconds per second at most."""


@pytest.fixture(scope='module')
def slide(arm: CalibratedArm) -> Streams:
    """Once round a disc."""
    return simulate_streams(arm.cell, sk.PAPER_ACTUAL, (Slide(DISC, 15, 0.1, 0.04, end=1.05),), start=0)


class Bench(AnyBench):
    """With the robot, and the outlines."""

    def __init__(self, node: ContourTracker) -> None:
        super().__init__(node)
        make = self.robot.create_publisher
        self.joints = make(JointState, '/joint_states', RELIABLE_STREAM)
        self.force = make(WrenchStamped, '/wrench', RELIABLE_STREAM)
        self.result = make(String, '/calibrator/result', LATCHED)
        self.paths = self.hear(PathMessage, '/contour_tracker/path')

    def play(self, streams: Streams, halfway: Callable[[], Any] = lambda: True, start: int = 10**18) -> None:
        """A recording as messages, each batch as soon as the node has taken the one before; `halfway` is awaited in
        the middle.
        """
        self.wait(lambda: self.joints.get_subscription_count() and self.force.get_subscription_count())
        playback, elapsed, sent = Playback(streams, start), 0.0, self.heard()
        while not playback.finished:
            elapsed += 0.1
            for is_wrench, sample in playback.advance(elapsed):
                sent += 1
                if is_wrench:
                    self.force.publish(wrench(sample, 'base_link'))
                else:
                    self.joints.publish(joint_state(sample, ('joint1', 'joint2')))
            self.wait(lambda: self.heard() >= sent)  # noqa: B023
            if elapsed > 0.5e-9 * streams.joints.stamp[-1]:
                self.wait(halfway)
            sleep(0.1 / SPEED)

    def heard(self) -> int:
        """Messages that the node has taken."""
        return sum(monitor.count for monitor in self.node._streams.monitors.values())


@pytest.fixture
def bench(bench: Callable[..., Any], arm_file: Callable[..., Any]) -> Callable[..., Bench]:
    given = {'period': 0.05, 'calibration': arm_file()}
    return lambda **changes: bench(ContourTracker, on=Bench, **(given | changes))


def places(message: PathMessage) -> np.ndarray:
    return np.array([(pose.pose.position.x, pose.pose.position.y) for pose in message.poses]).reshape(-1, 2)


def test_a_slide_is_traced_while_it_is_played(bench, slide):
    b = bench()
    b.play(slide, lambda: any(message.poses for message in b.paths))
    b.wait(lambda: len(b.paths) and np.hypot(*(places(b.paths[-1])[[0, -1]].T @ [1, -1])) < 1e-9)
    found = places(b.paths[-1])
    assert rms(normal_error(DISC, found)) < 1.2e-5
    assert np.hypot(*np.diff(found, axis=0).T).sum() == pytest.approx(2 * np.pi * 0.03, rel=5e-3)
    lengths = [len(message.poses) for message in b.paths]
    assert any(0 < length < len(found) for length in lengths)  # it has grown
    header = b.paths[-1].header
    assert header.frame_id == 'base_link'
    assert 10**9 + 2 < header.stamp.sec < 10**9 + 1e-9 * slide.joints.stamp[-1] + 1
    turn = b.paths[-1].poses[10].pose.orientation
    along, outward = found[11] - found[9], found[10] - (0.2, 0.3)
    assert 2 * np.arctan2(turn.z, turn.w) == pytest.approx(np.arctan2(along[1], along[0]), abs=1e-6)
    assert outward[0] * along[1] - outward[1] * along[0] > 0  # the object is on the left
    b.wait(lambda: b.value('outline') == 'closed')
    assert float(b.value('length [mm]')) == pytest.approx(188.5, abs=1)
    assert 1.0 < float(b.value('standard uncertainty [µm]')) < 20.0
    answer = b.call('/contour_tracker/clear')
    assert answer.success and answer.message == 'outlines forgotten: 1'
    b.wait(lambda: not b.paths[-1].poses)


def test_what_cannot_be_traced_is_said(bench, slide):
    b = bench()
    b.wait(b.says('/joint_states: no messages', WARN))
    assert not b.call('/contour_tracker/tare').success
    joints = slide.joints
    position, leap = joints.position.copy(), int(0.6 * len(joints.stamp))
    position[leap:] += 0.05

    def leap_said() -> bool:
        played = b.node._online.now - 10**18 > joints.stamp[leap] + 10**8
        return any('the tip jumps by' in s.message for s in b.statuses) if played else b.value('outlines') == '1'

    b.play(replace(slide, joints=replace(joints, position=position)), leap_said)
    b.wait(lambda: b.value('outlines') == '2')
    b.node._felt -= 1.0
    assert 'no force of the last 0.5 s' in b.call('/contour_tracker/tare').message
    stamp = int(slide.wrench.stamp[-1]) + 10**18 + 10**7
    forces = wrench((stamp, 0.0, 0.0), 'base_link')
    b.wait(lambda: b.node._felt > monotonic() - 0.2, lambda: b.force.publish(forces))
    assert b.call('/contour_tracker/tare').success
    assert b.value('zero of the force [N]') != 'not known'


def test_results_of_the_calibrator_begin_new_outlines(bench, arm, slide):
    b = bench(calibration='')
    assert not b.call('/contour_tracker/clear').success
    document = arm_document(arm) | {'schema': 'scara_kinetostatic/result/1', 'published': True}
    b.result.publish(String(data=json.dumps(document)))
    b.wait(lambda: b.paths)
    b.play(slide)
    b.wait(lambda: b.paths[-1].poses)
    b.result.publish(String(data=json.dumps(document)))
    b.result.publish(String(data='{"schema": 3}'))
    b.wait(b.says('expected the schema', ERROR))
    assert b.paths[-1].poses
    newer = replace(arm, created='2027-01-01T00:00:00Z')
    b.result.publish(String(data=json.dumps(arm_document(newer))))
    b.wait(lambda: not b.paths[-1].poses)
