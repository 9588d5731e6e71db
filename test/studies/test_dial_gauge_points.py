"""The experiments of section 5.2 as a whole: figure 4(d) comes back, and what is odd is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.studies.loops.dial_gauge import (
    GRIPPER,
    JOINT1,
    JOINT2,
    TIP,
    DialGaugeAnalysis,
    Readings,
    analyse_runs,
)
from scara_kinetostatic.studies.paper.study import DialGaugeBench, load_cycles, simulate_experiments

BENCH, EXACT = DialGaugeBench(), DialGaugeBench(noise=0.0)


@pytest.fixture(scope='module')
def analyses() -> list[DialGaugeAnalysis]:
    return [analyse_runs(simulate_experiments(seed=seed)) for seed in range(10)]


def test_all_values_of_figure_4d_come_back_in_all_directions(analyses):
    z = []
    for parts, _ in analyses:
        for run in parts[GRIPPER].runs:
            z.append((run.compliance.value - BENCH.p_ee) / run.compliance.std)
            z.append((run.gap.value - BENCH.gripper_gap(run.readings.direction)) / run.gap.std)
        for name, p, gap in zip((JOINT1, JOINT2), BENCH.p, BENCH.gap, strict=True):
            part = parts[name]
            z += [(part.compliance.value - p) / part.compliance.std, (part.gap.value - gap) / part.gap.std]
            assert part.gap.over(2) == (part.gap.value / 2, part.gap.std / 2, 'rad')  # g of the model
            assert part.compliance.unit == 'rad/Nm'
    assert len(z) == 10 * 28
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.13)
    assert np.abs(z).max() < 5


def test_only_the_backlash_depends_on_the_direction(analyses):
    for parts, _ in analyses:
        gripper = parts[GRIPPER]
        assert gripper.combined['compliance'].p_value > 1e-4
        assert gripper.combined['gap'].p_value < 1e-12
        assert gripper.gap.value == pytest.approx(np.mean([run.gap.value for run in gripper.runs]))
    assert np.mean([bool(warnings) for _, warnings in analyses]) <= 0.1


def joint_at_the_tip(seed: int) -> Readings:
    """Joint and gripper in series."""
    run = BENCH.run(np.random.default_rng(seed), JOINT2)
    _, sense, _ = load_cycles()
    gripper = BENCH.p_ee * run.force + BENCH.gripper_gap(0.0) / 2 * sense
    return replace(run, displacement=run.displacement + gripper, gauge_at=TIP)


def test_at_the_tip_the_gripper_along_the_same_direction_is_subtracted():
    z = []
    for seed in range(12):
        rng = np.random.default_rng(seed + 1000)
        gripper = [BENCH.run(rng, GRIPPER, direction) for direction in (np.pi / 2, np.pi)]
        part = analyse_runs([*gripper, joint_at_the_tip(seed)])[0][JOINT2]
        pairs = zip((part.compliance, part.gap), (BENCH.p[1], BENCH.gap[1]), strict=True)
        z.append([(found.value - true) / found.std for found, true in pairs])
    assert np.sqrt(np.mean(np.square(z), axis=0)) == pytest.approx([1, 1], abs=0.6)
    assert np.abs(z).max() < 4.5


def test_at_the_tip_without_the_gripper_it_is_said_what_the_numbers_include():
    across = BENCH.run(np.random.default_rng(0), GRIPPER, np.pi / 2)
    for readings in ([joint_at_the_tip(0)], [across, joint_at_the_tip(0)]):
        parts, warnings = analyse_runs(readings)
        assert parts[JOINT2].compliance.value == pytest.approx(BENCH.p[1] + BENCH.p_ee / 0.33**2, rel=0.01)
        assert any('include those of the gripper' in warning for warning in warnings)


ONE = BENCH.run(np.random.default_rng(7), GRIPPER)


def test_a_wrong_sign_a_wrong_unit_and_a_slip_are_pointed_out():
    def warnings(**changed: np.ndarray) -> tuple[str, ...]:
        return analyse_runs([replace(ONE, **changed)]).warnings

    assert not warnings()
    swapped = warnings(displacement=-ONE.displacement)
    assert any('positive along the positive force' in warning for warning in swapped)
    assert any('are the units and signs right?' in warning for warning in warnings(displacement=1e3 * ONE.displacement))
    slip = np.array(ONE.displacement)
    slip[20] *= 10
    found = warnings(displacement=slip, line=np.arange(2, len(ONE) + 2))
    assert any('line 22: far from the straight line' in warning for warning in found)


def test_repeated_runs_that_disagree_are_reported_and_widen_the_mean():
    rng = np.random.default_rng(0)
    parts, warnings = analyse_runs([replace(BENCH, gap=(gap, 0.0)).run(rng, JOINT1) for gap in (2.0e-4, 3.0e-4)])
    part = parts[JOINT1]
    assert len(part.runs) == 2
    assert part.gap.std > 2e-5
    assert any('inconsistent in gap' in warning for warning in warnings)
