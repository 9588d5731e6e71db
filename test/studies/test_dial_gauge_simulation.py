"""The simulated gauge experiments obey the model."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, JOINT1, JOINT2, TIP
from scara_kinetostatic.studies.dial_gauge.simulation import (
    _STRETCHED,
    DialGaugeSensors,
    DialGaugeTruth,
    LoadPlan,
    joint_displacement,
    simulate_experiments,
    simulate_joint,
)

TRUTH, EXACT = DialGaugeTruth(), DialGaugeSensors(noise=0.0)


def test_backlash_spans_the_measured_range_over_the_directions():
    gaps = TRUTH.gripper_gap(LoadPlan().directions)
    assert gaps.max() == pytest.approx(2.05e-4, rel=1e-12)
    assert gaps.min() == pytest.approx(5.49e-5, rel=1e-12)
    np.testing.assert_allclose(gaps[:6], gaps[6:], rtol=1e-12)  # a gap has no sense


def test_every_part_is_loaded_three_times_in_both_senses():
    readings = simulate_experiments(sensors=EXACT)
    assert [int((readings.part == part).sum()) for part in (GRIPPER, JOINT1, JOINT2)] == [12 * 97, 97, 97]
    assert np.all(np.isfinite(readings.lever) == (readings.part != GRIPPER))
    one = readings.select(readings.part == JOINT1)
    assert set(one.cycle) == {1, 2, 3}
    assert one.force.max() == -one.force.min() == 40.0


@pytest.mark.parametrize(('joint', 'lever'), [(1, 0.66), (2, 0.33)])
def test_a_joint_moves_the_end_by_lever_times_its_deflection(joint, lever):
    force, sense, _ = LoadPlan().run()
    p, gap = (TRUTH.p1, TRUTH.gap1) if joint == 1 else (TRUTH.p2, TRUTH.gap2)
    displacement = joint_displacement(TRUTH.with_one_joint(joint), force, sense)
    np.testing.assert_allclose(displacement, p * lever**2 * force + gap / 2 * lever * sense, rtol=0, atol=2e-9)


@pytest.mark.parametrize('joint', [1, 2])
def test_displacement_is_that_of_the_inverse_kinetostatics(joint):
    """Where the loaded end stands, Ḡ must ask for the very joint angles that were held."""
    parameters = TRUTH.with_one_joint(joint)
    force = np.array([25.0, -40.0, 5.0])
    displacement = joint_displacement(parameters, force, np.sign(force))
    angle = displacement / (0.33 if joint == 2 else 0.66)
    links = _STRETCHED - np.stack([np.arcsin(angle), np.zeros(3)] if joint == 1 else [np.zeros(3), np.arcsin(angle)], 1)
    ends = np.stack([np.cos(links[:, 0]), np.sin(links[:, 0])], 1) * 0.33
    ends += np.stack([np.cos(links.sum(1)), np.sin(links.sum(1))], 1) * 0.33
    ends *= 1 - 1e-14  # not a rounding error out of reach
    on_object = np.stack([-force, np.zeros(3)], axis=1)
    posture = np.where(np.sin(links[:, 1]) >= 0, 1, -1)
    held, _ = inverse_kinetostatics(parameters, ends, on_object, posture)
    np.testing.assert_allclose(held, np.broadcast_to(_STRETCHED, held.shape), rtol=0, atol=1e-6)


def test_at_the_tip_the_gripper_is_seen_as_well():
    plan = LoadPlan(cycles=1)
    force, sense, _ = plan.run()
    rng = np.random.default_rng(0)
    alone = simulate_joint(2, TRUTH, plan, EXACT, rng)
    both = simulate_joint(2, TRUTH, plan, EXACT, rng, gauge_at=TIP)
    more = TRUTH.p_ee * force + TRUTH.gap_major / 2 * sense
    np.testing.assert_allclose(both.displacement - alone.displacement, more, rtol=0, atol=1e-15)


def test_sensors_round_and_scatter():
    readings = simulate_experiments(sensors=DialGaugeSensors(noise=3e-6, resolution=1e-6, force_noise=0.1), seed=4)
    exact = simulate_experiments(sensors=EXACT)
    assert np.std(readings.displacement - exact.displacement) == pytest.approx(np.hypot(3e-6, 1e-6 / 12**0.5), rel=0.1)
    assert np.std(readings.force - exact.force) == pytest.approx(0.1, rel=0.1)
    np.testing.assert_allclose(readings.displacement / 1e-6, np.round(readings.displacement / 1e-6), atol=1e-6)


def test_the_same_seed_gives_the_same_readings():
    first, second, other = (simulate_experiments(seed=seed).displacement for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert np.any(first != other)


def test_senseless_plans_are_refused():
    with pytest.raises(ParameterError, match='rising'):
        LoadPlan(levels=(5.0, 5.0))
    with pytest.raises(ParameterError, match='cycles'):
        LoadPlan(cycles=0)
    with pytest.raises(ParameterError, match='1 or 2'):
        simulate_joint(3, TRUTH, LoadPlan(), EXACT, np.random.default_rng(0))
