"""The experiments of section 5.2 as a whole: figure 4(d) comes back, and what is odd is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.point_analysis import analyse_points
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, JOINT1, JOINT2, TIP, DialGaugeReadings, join
from scara_kinetostatic.studies.dial_gauge.result import PointAnalysis
from scara_kinetostatic.studies.dial_gauge.simulation import (
    DialGaugeSensors,
    DialGaugeTruth,
    LoadPlan,
    simulate_experiments,
    simulate_gripper,
    simulate_joint,
)

TRUTH = DialGaugeTruth()


@pytest.fixture(scope='module')
def analyses() -> list[PointAnalysis]:
    return [analyse_points(simulate_experiments(seed=seed)) for seed in range(25)]


def test_all_values_of_figure_4d_come_back_in_all_directions(analyses):
    z = []
    for each in analyses:
        for run in each.part(GRIPPER).runs:
            z.append((run.compliance.value - TRUTH.p_ee) / run.compliance.std)
            z.append((run.gap.value - TRUTH.gripper_gap(run.direction)) / run.gap.std)
        for name, p, gap in ((JOINT1, TRUTH.p1, TRUTH.gap1), (JOINT2, TRUTH.p2, TRUTH.gap2)):
            part = each.part(name)
            z += [(part.compliance.value - p) / part.compliance.std, (part.gap.value - gap) / part.gap.std]
    assert len(z) == 25 * 28
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.1)
    assert np.abs(z).max() < 5


def test_only_the_backlash_depends_on_the_direction(analyses):
    for each in analyses:
        gripper = each.part(GRIPPER)
        assert gripper.compliance_map.isotropy.p_value > 1e-4
        assert gripper.gap_map.isotropy.p_value < 1e-12
        ellipse = gripper.gap_map.ellipse
        assert ellipse.major.value == pytest.approx(2.05e-4, abs=5 * ellipse.major.std)
        assert ellipse.minor.value == pytest.approx(5.49e-5, abs=5 * ellipse.minor.std)
    assert np.mean([bool(each.warnings) for each in analyses]) <= 0.05


def test_half_the_gap_is_the_g_of_the_model(analyses):
    part = analyses[0].part(JOINT1)
    assert part.half_gap.value == part.gap.value / 2
    assert part.half_gap.value == pytest.approx(TRUTH.with_one_joint(1).g1, abs=5 * part.half_gap.std)
    assert part.units == ('rad/Nm', 'rad')
    assert analyses[0].part(GRIPPER).runs[3].half_gap.value == analyses[0].part(GRIPPER).runs[3].gap.value / 2


def joint_at_the_tip(seed: int) -> DialGaugeReadings:
    rng = np.random.default_rng(seed)
    return simulate_joint(2, TRUTH, LoadPlan(), DialGaugeSensors(), rng, gauge_at=TIP)


@pytest.mark.parametrize('directions', [(0.0, 90.0), (15.0, 45.0, 75.0, 105.0, 135.0, 165.0)], ids=['there', 'ellipse'])
def test_at_the_tip_the_gripper_is_subtracted(directions):
    z = []
    for seed in range(30):
        plan = LoadPlan(directions=tuple(np.radians(directions)))
        gripper = simulate_gripper(TRUTH, plan, DialGaugeSensors(), np.random.default_rng(seed + 1000))
        part = analyse_points(join([gripper, joint_at_the_tip(seed)])).part(JOINT2)
        z.append(
            ((part.compliance.value - TRUTH.p2) / part.compliance.std, (part.gap.value - TRUTH.gap2) / part.gap.std)
        )
    assert np.sqrt(np.mean(np.square(z), axis=0)) == pytest.approx([1, 1], abs=0.4)
    assert np.abs(z).max() < 4.5


def test_at_the_tip_without_the_gripper_it_is_said_what_the_numbers_include():
    found = analyse_points(joint_at_the_tip(0))
    assert found.part(JOINT2).compliance.value == pytest.approx(TRUTH.p2 + TRUTH.p_ee / 0.33**2, rel=0.01)
    assert any('include those of the gripper' in warning for warning in found.warnings)


def with_column(readings: DialGaugeReadings, **changes: object) -> DialGaugeReadings:
    return replace(readings, **changes)


ONE = simulate_gripper(TRUTH, LoadPlan(directions=(0.0,)), DialGaugeSensors(), np.random.default_rng(7))


def test_a_wrong_sign_a_wrong_unit_and_a_slip_are_pointed_out():
    assert not analyse_points(ONE).warnings
    swapped = analyse_points(with_column(ONE, displacement=-ONE.displacement)).warnings
    assert any('positive along the positive force' in warning for warning in swapped)
    metres = analyse_points(with_column(ONE, displacement=1e3 * ONE.displacement)).warnings
    assert any('are the units and signs right?' in warning for warning in metres)
    slip = np.array(ONE.displacement)
    slip[20] *= 10
    lines = np.arange(2, len(ONE) + 2)
    found = analyse_points(with_column(ONE, displacement=slip, line=lines)).warnings
    assert any('line 22: far from the straight line' in warning for warning in found)


def test_repeated_runs_that_disagree_are_reported_and_widen_the_mean():
    rng = np.random.default_rng(0)
    runs = []
    for gap in (2.0e-4, 3.0e-4):
        one = simulate_joint(1, replace(TRUTH, gap1=gap), LoadPlan(), DialGaugeSensors(), rng)
        runs.append(one)
    found = analyse_points(join(runs))
    part = found.part(JOINT1)
    assert len(part.runs) == 2
    assert part.gap.std > 2e-5
    assert any('inconsistent in gap' in warning for warning in found.warnings)


def test_what_cannot_be_analysed_is_named():
    with pytest.raises(UnsupportedDataError, match='gripper at 0 deg: there is no reversal'):
        analyse_points(ONE.select(ONE.force >= 0))
    with pytest.raises(ParameterError, match='lever'):
        analyse_points(DialGaugeReadings.of([1.0, -1.0], [0.0, 0.0], part=JOINT1))
    with pytest.raises(ParameterError, match='was not measured'):
        analyse_points(ONE).part(JOINT1)


def test_readings_are_checked_when_made():
    with pytest.raises(ParameterError, match='finite'):
        DialGaugeReadings.of([1.0, np.nan], [0.0, 0.0])
    with pytest.raises(ParameterError, match='one of'):
        DialGaugeReadings.of([1.0], [0.0], part='elbow')
    with pytest.raises(ValueError, match='read-only'):
        ONE.force[0] = 1.0
