"""Two robots on one topic are seen, one robot is not taken for two."""

from __future__ import annotations

import numpy as np
import pytest
from touches.scenes import CELL

from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_streams
from scara_kinetostatic.touches.detection import find_touches
from scara_kinetostatic.touches.streams import Streams, interleaved_seconds, is_interleaved

PLAN = default_plan(CELL).select(np.arange(6))
TIME = np.arange(1000) / 1000.0


def motion(phase: float) -> np.ndarray:
    return np.column_stack([np.sin(TIME + phase), 0.5 * np.cos(1.3 * TIME + phase)])


@pytest.mark.parametrize('burst', [1, 3, 10])
def test_two_motions_in_turn(burst):
    first = (np.arange(1000) // burst) % 2 == 0
    assert is_interleaved(np.where(first[:, None], motion(0.0), motion(0.3)))


@pytest.mark.parametrize('seed', range(3))
def test_noise_steps_and_oscillations_of_one_robot_are_none(seed):
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(1000, 2))
    assert not is_interleaved(noise)
    assert not is_interleaved(noise[:100])
    assert not is_interleaved(motion(0.0) + 1e-4 * noise)
    assert not is_interleaved(1e-3 * np.round(noise / 2))
    assert not is_interleaved(0.1 * np.sin(2 * np.pi * 8 * TIME)[:, None] * [1.0, 0.5])


def mixed(gap: float) -> Streams:
    """Two cells with the same plan, whose messages come in turn."""
    streams = simulate_streams(CELL, PAPER_MEASURED, PLAN, seed=1, start=0)
    streams.joints.position[1::2] += gap
    return streams


def test_a_recording_of_two_robots():
    both, alone = mixed(0.02), mixed(0.0)
    assert interleaved_seconds(both.joints.stamp, both.joints.position) > 10
    assert interleaved_seconds(alone.joints.stamp, alone.joints.position) == 0


def test_no_touch_is_the_mean_of_two_robots():
    detection = find_touches(mixed(0.005), CELL)
    assert detection.found == 6
    assert len(detection.touches) == 0
    assert 'messages of two robots on one topic?' in detection.rejected[0].reason
