"""Continuous loops: gap and slope at every reversal of a synthetic record of the measured ones' form."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.analysis import LOOPS, POINTS, analyse_tables
from scara_kinetostatic.studies.dial_gauge.loop_analysis import LoopAnalysis, analyse_loops
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings

RATE, PERIOD = 512.0, 2.0
SLIP, INSIDE, UNLOADING, COMPLIANCE, GAP = 10e3, 0.0, 2e-7, 4e-7, 2.5e-3


def record(
    gap: float = GAP, lag: float = 0.0, offset: float = 0.0, noise: tuple[float, float] = (1e-6, 2.0), seed: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, displacement, force: seven swings that grow, then fade, 0.5 Hz, after which nothing moves.

    After each reversal: unloading to 0, the gap, loading, slip. `lag` (s) makes the gap grow with the speed.
    """
    time = np.arange(0, 18, 1 / RATE)
    size = 0.025 * np.clip(np.minimum(time / 6, (16 - time) / 4), 0, 1)
    displacement = size * np.sin(2 * np.pi * time / PERIOD)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(displacement, append=displacement[-1]))) != 0) + 1
    turns = turns[time[turns] < 15.9]
    force = np.zeros_like(time)
    edges = [0, *turns.tolist(), len(time)]
    speed = np.abs(np.gradient(displacement, time))
    for first, last in pairwise(edges):
        rows = slice(first, last)
        sense = np.sign(displacement[last - 1] - displacement[first]) or 1.0
        distance = sense * (displacement[rows] - displacement[first])
        crossing = np.argmax(distance >= SLIP * UNLOADING + gap / 2) if len(distance) else 0
        width = gap + lag * (speed[rows][crossing] - 0.03)
        knots = np.cumsum([0.0, SLIP * UNLOADING, width, SLIP * COMPLIANCE])
        force[rows] = sense * np.interp(distance, knots, [-SLIP, -1e-3, 1e-3, SLIP])
    force[: turns[0]] = SLIP * np.tanh(displacement[: turns[0]] / 1e-4)
    rng = np.random.default_rng(seed)
    displacement = displacement + noise[0] * rng.standard_normal(len(time))
    return time, displacement, force + offset + noise[1] * rng.standard_normal(len(time))


def analysis(**more: object) -> LoopAnalysis:
    return analyse_loops(*record(**more))


def test_gap_and_slope_come_back_at_every_reversal():
    found = analysis()
    assert len(found.reversals) >= 12
    for each in found.reversals:
        assert each.gap.value == pytest.approx(GAP, abs=max(5 * each.gap.std, 2e-6))
        assert each.compliance.value == pytest.approx(COMPLIANCE, rel=5e-3)
        assert each.unloading.value == pytest.approx(UNLOADING, rel=5e-3)
    assert {sense.sense for sense in found.senses} == {1, -1}
    for sense in found.senses:
        assert sense.gap.p_value > 1e-3
        assert sense.plateau == pytest.approx(sense.sense * SLIP, rel=0.01)


def test_errors_agree_with_the_stated_standard_deviations():
    z, p = [], []
    for seed in range(12):
        for each in analysis(seed=seed, noise=(1e-5, 2.0)).senses:
            z += [(r.gap.value - GAP) / r.gap.std for r in each.reversals]
            z += [(r.compliance.value - COMPLIANCE) / r.compliance.std for r in each.reversals]
            p.append(each.gap.p_value)
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1, abs=0.1)
    assert min(p) > 1e-4


def test_zero_of_the_force_sensor_does_not_matter():
    for sense in analysis(offset=-400.0).senses:
        assert sense.level == pytest.approx(-400, abs=30)
        assert sense.gap.mean == pytest.approx(GAP, abs=5e-6)


def test_a_gap_that_depends_on_the_speed_is_found_and_said():
    lag = -0.02
    found = analysis(lag=lag, noise=(5e-6, 2.0))
    for sense in found.senses:
        assert sense.gap.p_value < 1e-6
        trend = next(each for each in sense.trends if (each.quantity, each.variable) == ('gap', 'speed'))
        assert trend.slope.value == pytest.approx(lag, rel=0.15)
        assert sense.gap.between > 5e-5
        assert sense.gap.std > sense.gap.between / np.sqrt(len(sense.reversals)) * 0.9
    time, displacement, force = record(lag=lag, noise=(5e-6, 2.0))
    warnings = analyse_tables([DialGaugeReadings.of(force, displacement, time=time)]).warnings
    assert any('changes with the speed' in warning for warning in warnings)
    assert any('the reversals are inconsistent in gap' in warning for warning in warnings)


def test_steady_loops_raise_no_warning():
    time, displacement, force = record(noise=(5e-6, 2.0))
    assert analyse_tables([DialGaugeReadings.of(force, displacement, time=time)]).warnings == ()


def test_noise_is_that_of_the_stretch_without_motion():
    found = analysis(noise=(2e-6, 5.0))
    assert found.noise == pytest.approx((2e-6, 5.0), rel=0.3)


def test_a_reversal_without_slip_before_it_is_left_out_with_its_reason():
    time, displacement, force = record()
    turn = time[np.argmax(np.where(time < 1, displacement, -1))]
    found = analyse_loops(time, displacement, np.where(time < turn + 0.2, np.minimum(force, 0.3 * SLIP), force))
    assert found.rejected[0].time == pytest.approx(turn, abs=0.02)
    assert 'no full loop' in found.rejected[0].reason
    assert min(each.time for each in found.reversals) > turn + 0.5


def test_a_record_too_coarse_says_so():
    time, displacement, force = record()
    with pytest.raises(UnsupportedDataError, match='no reversal has a gap'):
        analyse_loops(time[::40], displacement[::40], force[::40])


@pytest.mark.parametrize(
    ('time', 'problem'),
    [(np.zeros(50), 'does not rise'), (np.arange(50.0), 'no reversal has'), (np.zeros(1), 'does not rise')],
)
def test_records_that_are_no_loops_are_refused(time, problem):
    with pytest.raises(UnsupportedDataError, match=problem):
        analyse_loops(time, np.zeros_like(time), np.zeros_like(time))


def test_tables_are_told_apart_by_their_columns():
    time, displacement, force = record()
    loops = DialGaugeReadings.of(force, displacement, time=time)
    assert analyse_tables([loops]).points is None
    assert len(analyse_tables([loops], kind=LOOPS).loops) == 1
    steps = np.array([1.0, 2, 3, 2, 1, -1, -2, -3, -2, -1])
    points = DialGaugeReadings.of(steps, 1e-5 * steps + 1e-5 * np.sign(steps), time=np.arange(10.0), cycle=1)
    assert analyse_tables([points]).loops == ()
    assert analyse_tables([points], kind=POINTS).points is not None
    with pytest.raises(UnsupportedDataError, match='time_s'):
        analyse_tables([DialGaugeReadings.of(steps, steps)], kind=LOOPS)
