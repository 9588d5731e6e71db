"""The steps of the encoders are seen in the readings of the touches, and are the least noise of the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.calibration.noise import raised, reading_noise
from scara_kinetostatic.model.cell import PAPER_CELL, Noise
from scara_kinetostatic.model.parameters import PAPER_MEASURED
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import SensorModel, simulate_streams, simulate_touches
from scara_kinetostatic.touches.detection import find_touches

PLAN = default_plan(PAPER_CELL)
FINE = Noise(2e-6, 0.1)


def turn(bits):
    """The step of an encoder of so many bits, rad."""
    return 2 * np.pi / 2**bits


@pytest.mark.parametrize('bits', [12, 14, 16])
@pytest.mark.parametrize('count', [24, 72])
@pytest.mark.parametrize('coupling', [0.0, 0.25])
def test_steps_are_seen(bits, count, coupling):
    cell, step = replace(PAPER_CELL, coupling=coupling, direction=(1, -1)), turn(bits)
    readings = np.random.default_rng(count).uniform(-2.0, 2.0, (count, 2))
    first, second = reading_noise(cell, cell.angles(np.round(readings / step) * step)) * np.sqrt(12.0)
    assert (first, second) == pytest.approx((step, np.hypot(1.0, coupling) * step), rel=1e-4)


@pytest.mark.parametrize(
    'change', [np.float64, np.float32, lambda q: np.round(q, 6), lambda q: np.repeat(q, 2, axis=0)]
)
def test_no_steps_where_there_are_none(change):
    for seed in range(40):
        random = np.random.default_rng(seed)
        readings = np.asarray(change(random.uniform(-2.0, 2.0, (random.integers(8, 90), 2))), dtype=float)
        assert not reading_noise(PAPER_CELL, readings).any()


def test_harmless_steps_change_nothing():
    joints = np.round(np.random.default_rng(0).uniform(-2.0, 2.0, (72, 2)) / turn(20)) * turn(20)
    assert raised(Noise(1e-5, 0.3), PAPER_CELL, joints) == Noise(1e-5, 0.3)


@pytest.mark.parametrize('noise', [None, Noise(1e-5, 0.1)], ids=['estimated', 'stated'])
@pytest.mark.parametrize('is_table', [True, False])
def test_encoders_of_12_bits(noise, is_table):
    cell, step = replace(PAPER_CELL, noise=noise), turn(12)
    if is_table:
        touches = simulate_touches(cell, PAPER_MEASURED, PLAN, FINE, seed=1)
        outcome = calibrate_touches(touches.replace(joints=np.round(touches.joints / step) * step), cell)
    else:  # some readings change to the next step and back
        sensors = SensorModel(touch_noise=FINE, resolution=step, joint_noise=2e-5)
        detection = find_touches(simulate_streams(cell, PAPER_MEASURED, PLAN, sensors=sensors, seed=1), cell)
        assert len(detection.touches) == detection.found == len(PLAN)
        outcome = calibrate_touches(detection, cell)
    assert outcome.final.noise.joint_rms == pytest.approx(step / np.sqrt(12.0), rel=0.05)
    assert outcome.diagnosis.verdict == 'none'
    assert outcome.assessment.grade.value == 'fit'
    assert any('read in steps of 1.5 mrad' in text for text in outcome.assessment.reasons)
    off = [getattr(outcome.final.parameters, name) - getattr(PAPER_MEASURED, name) for name in PAPER_MEASURED.names]
    assert np.abs(off / outcome.final.std).max() < 4.0
