"""Recordings put together by hand: way-points of joints and force, straight lines between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise, SensorFrame, SensorSign
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.touches.clock import Samples
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3))
TOOL_REACTION = replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL, sign=SensorSign.ON_ROBOT))
START = 1_700_000_000_000_000_000


class Scene:
    """A motion that is written down step by step; each step returns the scene."""

    def __init__(self, cell=CELL, truth=PAPER_ACTUAL):
        self.cell, self.truth, self.time = cell, truth, 0.0
        self.rows = [(0.0, 0.6, 1.2, 0.0, 0.0)]
        self.holds = []

    @property
    def joints(self):
        return np.array(self.rows[-1][1:3])

    def go(self, joints, seconds, force=(0.0, 0.0)):
        self.time += seconds
        self.rows.append((self.time, *joints, *force))
        return self

    def rest(self, seconds):
        return self.go(self.joints, seconds, self.rows[-1][3:])

    def pose(self, disc, degrees, force=0.0, posture=1, clearance=0.0, center=None, radius=None):
        """Joint angles and force of a touch."""
        center = self.cell.centers[disc] if center is None else np.array(center)
        radius = self.cell.radii[disc] if radius is None else radius
        normal = np.array([np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))])
        tip = center + (radius + clearance) * normal
        joints, _ = inverse_kinetostatics(self.truth, tip[None], -max(force, 1e-6) * normal[None], posture)
        return joints[0], -force * normal

    def approach(self, disc, degrees, seconds=0.5, **where):
        self.go(self.pose(disc, degrees, clearance=0.018, **where)[0], 0.8)
        return self.go(self.pose(disc, degrees, **where)[0], seconds)

    def press(self, disc, degrees, force, hold=0.5, seconds=0.3, **where):
        joints, load = self.pose(disc, degrees, force, **where)
        self.go(joints, seconds, load)
        self.holds.append((joints, load, self.time, self.time + hold))
        return self.go(joints, hold, load)

    def retract(self, disc, degrees, **where):
        self.go(self.pose(disc, degrees, **where)[0], 0.2)
        return self.go(self.pose(disc, degrees, clearance=0.018, **where)[0], 0.2)

    def touch(self, disc, degrees, force, hold=0.5, **where):
        self.approach(disc, degrees, **where).press(disc, degrees, force, hold, **where)
        return self.retract(disc, degrees, **where)

    def touches(self, count=8):
        """Some ordinary touches, all over the discs."""
        for number in range(count):
            self.touch(number % 3, 45 * number + 20, (10.0, 25.0, 40.0)[number % 3], posture=(1, -1)[number % 2])
        return self

    def streams(self, noise=0.05, bias=(1.2, -0.8), seed=0, rates=(80.0, 98.0), without=(), drift=0.0):
        """The streams; `without` lists (topic, begin, end) of what is lost."""
        random = np.random.default_rng(seed)
        table = np.array([*self.rows, (self.time + 0.5, *self.rows[-1][1:])])
        out = []
        for rate, columns, offset, topic in ((rates[0], (1, 2), 0.0, 'joints'), (rates[1], (3, 4), 0.004, 'wrench')):
            count = int((table[-1, 0] - offset) * rate)
            time = (np.arange(count) + 0.2 * random.random(count)) / rate + offset
            for name, begin, end in without:
                time = time[~((name == topic) & (time > begin) & (time < end))]
            out.append((time, np.column_stack([np.interp(time, table[:, 0], table[:, c]) for c in columns])))
        (joint_time, joints), (wrench_time, force) = out
        force = force + bias + noise * random.standard_normal(force.shape) + drift * wrench_time[:, None]
        return Streams(
            'scene',
            JointStream(START + np.round(1e9 * joint_time).astype(np.int64), joints),
            WrenchStream(START + np.round(1e9 * wrench_time).astype(np.int64), force),
        )

    def truth_of_holds(self):
        """Joint angles and force on the object of every hold."""
        return np.array([hold[0] for hold in self.holds]), np.array([hold[1] for hold in self.holds])


def topics_of(streams, joints=0, wrench=0, others=None):
    """Both topics as they are received, at their stamps, which are then shifted, ns; None: without stamps."""
    position = streams.joints.position if others is None else np.hstack([streams.joints.position, others])
    topics = ((streams.joints.stamp, position, joints), (streams.wrench.stamp, streams.wrench.force, wrench))
    return [
        Samples(np.zeros_like(time) if shift is None else time + shift, time, values) for time, values, shift in topics
    ]


def feed(detector, topics, every=20):
    """Every answer of an online detector that found something, with when it came, ns; polled every few samples."""
    received = np.concatenate([topic.log_time for topic in topics])
    events = [row for topic in topics for row in zip(topic.stamp.tolist(), topic.values.tolist(), strict=True)]
    answers = []
    for number, place in enumerate(np.argsort(received, kind='stable').tolist()):
        add = detector.add_joint_state if place < len(topics[0].stamp) else detector.add_wrench
        add(*events[place], int(received[place]))
        if number % every == 0:
            answers.append((int(received[place]), detector.poll()))
    return [(time, answer) for time, answer in answers if answer.found]


def same_touches(one, other, force=0.005):
    """Whether both have the same touches: online and offline, say."""
    for name, tolerance in (('index', 0.0), ('disc', 0.0), ('joints', 1e-8), ('force', force)):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=0, atol=tolerance)
