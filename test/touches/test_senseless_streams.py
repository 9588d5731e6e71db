"""Streams that make no sense raise nothing and find nothing that is not counted."""

from __future__ import annotations

import numpy as np
import pytest
from touches.scenes import CELL, Scene, feed, topics_of

from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.online import OnlineDetector
from scara_kinetostatic.touches.streams import JointStream, Streams, WrenchStream

BASE = Scene().touches(4).streams()


def check(streams):
    detection = find_touches(streams, CELL)
    indices = [*detection.touches.index.tolist(), *(rejection.index for rejection in detection.rejected)]
    assert sorted(indices) == list(range(detection.found))
    assert len(detection.episodes) == detection.found
    assert all(rejection.reason and '\n' not in rejection.reason for rejection in detection.rejected)


@pytest.mark.parametrize('seed', range(10))
def test_random_numbers(seed):
    random = np.random.default_rng(seed)
    counts = random.integers(0, 6 if seed % 4 == 0 else 300, 2)
    stamps = [random.integers(0, 10 ** int(random.integers(1, 12)), count) for count in counts]
    stamps = stamps if seed % 3 == 0 else [np.sort(stamp) for stamp in stamps]
    force = 10.0 ** random.integers(-12, 13) * random.normal(size=(counts[1], 2))
    force = force.cumsum(axis=0) if seed % 5 == 0 else np.round(force) if seed % 5 == 1 else force
    joints = JointStream(stamps[0], random.normal(size=(counts[0], 2)))
    check(Streams('random', joints, WrenchStream(stamps[1], force)))


@pytest.mark.parametrize('seed', range(4))
def test_parts_of_a_recording(seed):
    random = np.random.default_rng(seed)
    kept_joints, kept_forces = (
        np.sort(random.choice(len(stamp), random.integers(0, len(stamp)), replace=False))[random.integers(0, 800) :]
        for stamp in (BASE.joints.stamp, BASE.wrench.stamp)
    )
    joints, force = BASE.joints.position[kept_joints], BASE.wrench.force[kept_forces] * random.choice([0.1, 1, 10])
    joints[random.random(len(joints)) < 0.05] = np.inf
    force[random.random(len(force)) < 0.1] = np.nan
    streams = Streams(
        'parts',
        JointStream(BASE.joints.stamp[kept_joints], joints),
        WrenchStream(BASE.wrench.stamp[kept_forces], force),
    )
    check(streams)
    detector = OnlineDetector(CELL)
    reported = sum(answer.found for _, answer in feed(detector, topics_of(streams), every=1))
    assert reported + detector.finish().found == detector.found
