"""The experiments of section 5.2 as a whole: figure 4(d) comes back, and what is odd is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.loops.dial_gauge import DialGaugeAnalysis, DirectionMap, analyse_points, direction_map
from scara_kinetostatic.studies.loops.estimates import Estimate
from scara_kinetostatic.studies.loops.readings import GRIPPER, JOINT1, JOINT2, TIP, DialGaugeReadings, join
from scara_kinetostatic.studies.loops.simulation import (
    DialGaugeSensors,
    DialGaugeTruth,
    LoadPlan,
    joint_displacement,
    simulate_experiments,
    simulate_gripper,
    simulate_joint,
)

TRUTH, EXACT, COARSE = DialGaugeTruth(), DialGaugeSensors(noise=0.0), DialGaugeSensors(3e-6, 1e-6, 0.1)


@pytest.fixture(scope='module')
def analyses() -> list[DialGaugeAnalysis]:
    return [analyse_points(simulate_experiments(seed=seed)) for seed in range(10)]


def test_all_values_of_figure_4d_come_back_in_all_directions(analyses):
    z = []
    for each in analyses:
        for run in each.parts[GRIPPER].runs:
            z.append((run.compliance.value - TRUTH.p_ee) / run.compliance.std)
            z.append((run.gap.value - TRUTH.gripper_gap(run.direction)) / run.gap.std)
        for name, p, gap in ((JOINT1, TRUTH.p1, TRUTH.gap1), (JOINT2, TRUTH.p2, TRUTH.gap2)):
            part = each.parts[name]
            z += [(part.compliance.value - p) / part.compliance.std, (part.gap.value - gap) / part.gap.std]
    assert len(z) == 10 * 28
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.13)
    assert np.abs(z).max() < 5


def test_only_the_backlash_depends_on_the_direction(analyses):
    for each in analyses:
        compliance, gap = (each.parts[GRIPPER].maps[name] for name in ('compliance', 'gap'))
        assert compliance.isotropy.p_value > 1e-4
        assert gap.isotropy.p_value < 1e-12
        assert gap.ellipse.major.value == pytest.approx(2.05e-4, abs=5 * gap.ellipse.major.std)
        assert gap.ellipse.minor.value == pytest.approx(5.49e-5, abs=5 * gap.ellipse.minor.std)
        assert gap.mean.value == pytest.approx(gap.value.mean())
    assert np.mean([bool(each.warnings) for each in analyses]) <= 0.1


def test_half_the_gap_is_the_g_of_the_model(analyses):
    part = analyses[0].parts[JOINT1]
    assert part.gap.half == (part.gap.value / 2, part.gap.std / 2)
    assert part.gap.half.value == pytest.approx(TRUTH.with_one_joint(1).g1, abs=5 * part.gap.half.std)
    assert part.units == ('rad/Nm', 'rad')


DIRECTIONS = np.radians(np.arange(0, 360, 30))


def noisy_map(values: np.ndarray, std: float, rng: np.random.Generator, power: int) -> DirectionMap:
    """Of values with noise, and what runs of 82 degrees of freedom say of their standard deviation."""
    stds = std * np.sqrt(rng.chisquare(82, len(values)) / 82)
    estimates = [Estimate(*each) for each in np.stack([values + std * rng.standard_normal(len(values)), stds], axis=1)]
    return direction_map(DIRECTIONS, estimates, np.full(12, 82.0), power)


@pytest.mark.parametrize(('power', 'major', 'minor', 'std'), [(1, 5e-5, 3e-5, 2e-7), (2, 2.05e-4, 5.49e-5, 1e-6)])
def test_ellipse_gives_back_its_principal_values(power, major, minor, std):
    axis, rng, z, p = 0.4, np.random.default_rng(0), [], []
    turned = DIRECTIONS - axis
    truth = (major**power * np.cos(turned) ** 2 + minor**power * np.sin(turned) ** 2) ** (1 / power)
    for _ in range(100):
        each = noisy_map(truth, std, rng, power)
        found = each.ellipse
        assert found is not None
        z.append([(e.value - t) / e.std for e, t in zip(found[:3], (major, minor, axis), strict=True)])
        p.append((found.p_value, each.isotropy.p_value))
    assert np.sqrt((np.array(z) ** 2).mean(axis=0)) == pytest.approx(1, abs=0.15)
    assert np.mean(np.array(p)[:, 0] < 0.05) == pytest.approx(0.05, abs=0.05)
    assert np.array(p)[:, 1].max() < 1e-10


def test_isotropy_is_not_doubted_without_reason_and_what_is_no_ellipse_is_noticed():
    rng = np.random.default_rng(2)
    p = [noisy_map(np.full(12, 1e-4), 1e-6, rng, 2).isotropy.p_value for _ in range(200)]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.046)
    square = noisy_map(1e-4 + 1e-5 * np.cos(4 * DIRECTIONS), 1e-6, rng, 2).ellipse
    assert square is not None
    assert square.p_value < 1e-6


def test_no_ellipse_from_two_axes_or_from_no_gap():
    two = np.radians([0, 90, 180, 270])
    assert direction_map(two, [Estimate(1e-4, 1e-6)] * 4, np.full(4, 82.0), 1).ellipse is None
    assert direction_map(DIRECTIONS, [Estimate(1e-6, 1e-6)] * 12, np.full(12, 82.0), 2).ellipse is None


def joint_at_the_tip(seed: int) -> DialGaugeReadings:
    rng = np.random.default_rng(seed)
    return simulate_joint(2, TRUTH, LoadPlan(), DialGaugeSensors(), rng, gauge_at=TIP)


def test_at_the_tip_the_gripper_along_the_same_direction_is_subtracted():
    z = []
    for seed in range(12):
        plan = LoadPlan(directions=(np.pi / 2, np.pi))
        gripper = simulate_gripper(TRUTH, plan, DialGaugeSensors(), np.random.default_rng(seed + 1000))
        part = analyse_points(join([gripper, joint_at_the_tip(seed)])).parts[JOINT2]
        z.append(
            ((part.compliance.value - TRUTH.p2) / part.compliance.std, (part.gap.value - TRUTH.gap2) / part.gap.std)
        )
    assert np.sqrt(np.mean(np.square(z), axis=0)) == pytest.approx([1, 1], abs=0.6)
    assert np.abs(z).max() < 4.5


def test_at_the_tip_without_the_gripper_it_is_said_what_the_numbers_include():
    across = simulate_gripper(TRUTH, LoadPlan(directions=(np.pi / 2,)), DialGaugeSensors(), np.random.default_rng(0))
    for readings in (joint_at_the_tip(0), join([across, joint_at_the_tip(0)])):
        found = analyse_points(readings)
        assert found.parts[JOINT2].compliance.value == pytest.approx(TRUTH.p2 + TRUTH.p_ee / 0.33**2, rel=0.01)
        assert any('include those of the gripper' in warning for warning in found.warnings)


ONE = simulate_gripper(TRUTH, LoadPlan(directions=(0.0,)), DialGaugeSensors(), np.random.default_rng(7))


def test_a_wrong_sign_a_wrong_unit_and_a_slip_are_pointed_out():
    assert not analyse_points(ONE).warnings
    swapped = analyse_points(replace(ONE, displacement=-ONE.displacement)).warnings
    assert any('positive along the positive force' in warning for warning in swapped)
    metres = analyse_points(replace(ONE, displacement=1e3 * ONE.displacement)).warnings
    assert any('are the units and signs right?' in warning for warning in metres)
    slip = np.array(ONE.displacement)
    slip[20] *= 10
    lines = np.arange(2, len(ONE) + 2)
    found = analyse_points(replace(ONE, displacement=slip, line=lines)).warnings
    assert any('line 22: far from the straight line' in warning for warning in found)


def test_repeated_runs_that_disagree_are_reported_and_widen_the_mean():
    rng = np.random.default_rng(0)
    runs = []
    for gap in (2.0e-4, 3.0e-4):
        one = simulate_joint(1, replace(TRUTH, gap1=gap), LoadPlan(), DialGaugeSensors(), rng)
        runs.append(one)
    found = analyse_points(join(runs))
    part = found.parts[JOINT1]
    assert len(part.runs) == 2
    assert part.gap.std > 2e-5
    assert any('inconsistent in gap' in warning for warning in found.warnings)


def test_what_cannot_be_analysed_is_named():
    with pytest.raises(UnsupportedDataError, match='gripper at 0°: there is no reversal'):
        analyse_points(ONE.select(ONE.force >= 0))
    with pytest.raises(ParameterError, match='lever'):
        analyse_points(DialGaugeReadings.of([1.0, -1.0], [0.0, 0.0], part=JOINT1))


@pytest.mark.parametrize(('joint', 'lever'), [(1, 0.66), (2, 0.33)])
def test_a_simulated_joint_moves_the_end_by_lever_times_its_deflection(joint, lever):
    force, sense, _ = LoadPlan().run()
    p, gap = (TRUTH.p1, TRUTH.gap1) if joint == 1 else (TRUTH.p2, TRUTH.gap2)
    displacement = joint_displacement(TRUTH.with_one_joint(joint), force, sense)
    np.testing.assert_allclose(displacement, p * lever**2 * force + gap / 2 * lever * sense, rtol=0, atol=2e-9)


def test_simulated_experiments_are_those_of_the_plan():
    exact, readings = simulate_experiments(sensors=EXACT), simulate_experiments(sensors=COARSE, seed=4)
    assert [int((exact.part == part).sum()) for part in (GRIPPER, JOINT1, JOINT2)] == [12 * 97, 97, 97]
    one = exact.select(exact.part == JOINT1)
    assert (set(one.cycle), one.force.max(), one.force.min()) == ({1, 2, 3}, 40.0, -40.0)
    assert np.std(readings.displacement - exact.displacement) == pytest.approx(np.hypot(3e-6, 1e-6 / 12**0.5), rel=0.1)
    assert np.std(readings.force - exact.force) == pytest.approx(0.1, rel=0.1)
    np.testing.assert_allclose(readings.displacement / 1e-6, np.round(readings.displacement / 1e-6), atol=1e-6)
    again = simulate_experiments(sensors=COARSE, seed=4)
    np.testing.assert_array_equal(again.displacement, readings.displacement)
    assert np.any(simulate_experiments(sensors=COARSE, seed=5).force != readings.force)
