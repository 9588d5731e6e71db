"""Slopes, gaps, their standard deviations, and the checks of one run; combination of several estimates."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.studies.loops import dial_gauge
from scara_kinetostatic.studies.loops.dial_gauge import Readings, RunFit, combine_estimates, find_resolution, fit_run
from scara_kinetostatic.studies.loops.selection import UncertainValue
from scara_kinetostatic.studies.paper.study import load_cycles

P, GAP = 3.76e-5, 1.3e-4


def readings(rng: np.random.Generator | None = None, noise: float = 2e-6, extra: object = 0.0) -> Readings:
    force, sense, cycle = load_cycles()
    displacement = P * force + GAP / 2 * sense + np.asarray(extra)
    if rng is not None:
        displacement = displacement + noise * rng.standard_normal(force.shape)
    return Readings(force, displacement, cycle)


def alarmed(fit: RunFit, level: float = 1e-4) -> set[str]:
    return {check.name for check in fit.checks if check.p_value < level}


def many(number: int, **more: object) -> list[RunFit]:
    rng = np.random.default_rng(1)
    return [fit_run(readings(rng, **more)) for _ in range(number)]


def test_exact_readings_give_back_slope_gap_and_the_step_of_the_gauge():
    fit = fit_run(readings())
    assert fit.compliance.value == pytest.approx(P, rel=1e-12)
    assert fit.gap.value == pytest.approx(GAP, rel=1e-10)
    assert fit.cycle_gaps == pytest.approx([GAP] * 3)
    assert not alarmed(fit)
    assert fit.row_p.min() > 0.01
    assert find_resolution(np.array([0.0, 2e-5, -3e-5])) == pytest.approx(1e-5)
    assert find_resolution(np.array([0.0, 2e-5, -4e-5])) == pytest.approx(2e-5)
    assert find_resolution(np.array([0.0, 1.23456789e-4])) == 0


@pytest.fixture(scope='module')
def fits() -> list[RunFit]:
    return many(350)


def test_errors_agree_with_the_stated_standard_deviations(fits):
    z = np.array([((f.compliance.value - P) / f.compliance.std, (f.gap.value - GAP) / f.gap.std) for f in fits])
    assert np.sqrt((z**2).mean(axis=0)) == pytest.approx([1, 1], abs=0.12)
    assert np.abs(z.mean(axis=0)).max() < 0.15
    slopes = np.array([[(s.value - P) / s.std for s in f.slopes] for f in fits])
    assert np.sqrt((slopes**2).mean(axis=0)) == pytest.approx([1, 1], abs=0.12)
    assert np.mean([f.sigma**2 for f in fits]) == pytest.approx(4e-12, rel=0.04)


def test_p_values_of_all_checks_are_uniform(fits):
    names = 'slope_difference hysteresis curvature zero_drift gap_repeatability slope_repeatability'
    assert [check.name for check in fits[0].checks] == names.split()
    p = np.array([[check.p_value for check in fit.checks] for fit in fits])
    assert np.all((p < 0.01).mean(axis=0) <= 0.026)  # 1 % and three standard deviations
    assert (p < 0.1).mean(axis=0) == pytest.approx(0.1, abs=0.048)
    z = np.array([[check.value / check.std for check in fit.checks[:4]] for fit in fits])
    assert np.sqrt((z**2).mean(axis=0)) == pytest.approx(1, abs=0.1)


FORCE, SENSE, CYCLE = load_cycles()
UNLOADING = np.concatenate([[0], np.tile(np.repeat([0.0, 1.0], 8), 6)])


@pytest.mark.parametrize(
    ('name', 'extra', 'size'),
    [
        ('slope_difference', np.where(FORCE > 0, 1.5e-6 * FORCE, 0), 1.5e-6),
        ('hysteresis', 6e-6 * UNLOADING * SENSE, 6e-6),
        ('curvature', 3e-8 * SENSE * FORCE**2, 3e-8 * 35**2 / 4),
        ('zero_drift', 8e-6 * CYCLE, 8e-6),
    ],
)
def test_each_effect_is_found_by_its_check_and_measured(name, extra, size):
    fits = many(8, extra=extra)
    assert all(name in alarmed(fit) for fit in fits)
    values = [check.value for fit in fits for check in fit.checks if check.name == name]
    assert np.mean(values) == pytest.approx(size, rel=0.1)


def test_scatter_between_cycles_is_found_and_widens_the_standard_deviation():
    z = []
    rng = np.random.default_rng(5)
    for _ in range(100):
        jitter = 1.5e-5 * rng.standard_normal(3)
        fit = fit_run(readings(rng, extra=jitter[CYCLE.astype(int) - 1] / 2 * SENSE))
        z.append((fit.gap.value - GAP) / fit.gap.std)
    assert np.median(np.abs(z)) == pytest.approx(0.78, abs=0.2)  # Student's t of two degrees of freedom: 0.816


@pytest.mark.parametrize(
    'extra',
    [
        np.array([0.0, 1e-3, -5e-4])[CYCLE.astype(int) - 1],
        np.where(FORCE == 0, np.random.default_rng(2).uniform(-1, 1, len(FORCE)) * GAP, 0),
    ],
    ids=['a gauge set anew in each cycle', 'a part anywhere inside its backlash'],
)
def test_what_does_not_touch_slope_or_gap(extra):
    given = readings(extra=extra)
    fit, without_cycles = fit_run(given), Readings(given.force, given.displacement)
    assert (fit.compliance.value, fit.gap.value) == pytest.approx((P, GAP), rel=1e-9)
    assert np.array_equal(fit.used, FORCE != 0)
    assert np.array_equal(dial_gauge.find_passes(given)[0], dial_gauge.find_passes(without_cycles)[0])
    assert fit_run(without_cycles).gap == fit.gap


def test_loads_that_are_not_removed_say_nothing_about_hysteresis():
    force = np.array([1.0, 2, 3, -1, -2, -3] * 2)
    fit = fit_run(Readings(force, P * force + GAP / 2 * np.sign(force)))
    assert 'hysteresis' not in {check.name for check in fit.checks}
    assert fit.gap.value == pytest.approx(GAP)


@pytest.mark.parametrize(('noise', 'resolution'), [(0.0, 1e-5), (5e-6, 1e-5), (2e-6, 1e-6)])
def test_a_gauge_with_steps_is_not_trusted_beyond_them(noise, resolution):
    rng, z = np.random.default_rng(0), []
    for _ in range(50):
        p, gap = P * rng.uniform(0.8, 1.2), GAP * rng.uniform(0.8, 1.2)
        moved = p * FORCE + gap / 2 * SENSE + noise * rng.standard_normal(len(FORCE))
        fit = fit_run(Readings(FORCE, resolution * np.round(moved / resolution), CYCLE))
        assert fit.resolution > 0.99 * resolution  # by chance all readings may be even
        z.append(((fit.compliance.value - p) / fit.compliance.std, (fit.gap.value - gap) / fit.gap.std))
    assert np.sqrt((np.array(z) ** 2).mean(axis=0)) == pytest.approx([1, 1], abs=0.22)


@pytest.mark.parametrize(
    ('force', 'problem'),
    [
        ([0.0, 0.0, 0.0], 'no load'),
        ([1.0, 2.0, 3.0, 2.0], 'no reversal'),
        ([1.0, 2.0, -1.0, -2.0], 'too few'),
        ([1.0, 1.0, 1.0, -1.0, -1.0, -2.0], 'single level'),
    ],
)
def test_readings_that_cannot_tell_are_refused(force, problem):
    with pytest.raises(UnsupportedDataError, match=f'readings: gripper at 0°: .*{problem}'):
        fit_run(Readings(np.array(force), np.array(force) * P, direction=0.0))


def test_agreement_with_few_degrees_of_freedom_raises_no_false_alarm():
    rng, p = np.random.default_rng(3), []
    for _ in range(600):
        scale = np.sqrt(rng.chisquare(8, 6) / 8)
        estimates = [UncertainValue(*each) for each in np.stack([rng.standard_normal(6), scale], axis=1)]
        p.append(combine_estimates(estimates, np.full(6, 8.0)).p_value)
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.027)


def test_estimates_that_agree_are_weighted_by_their_variances():
    test = combine_estimates([UncertainValue(1.0, 0.1, 'm'), UncertainValue(1.3, 0.2, 'm')], np.full(2, 1e6))
    assert test.estimate == (pytest.approx(1.06), pytest.approx(0.2 / 5**0.5), 'm')
    assert test.p_value == pytest.approx(0.1797, abs=1e-4)
