"""Laws of the force along a motion, against an independent simulator and against one another."""

from __future__ import annotations

import numpy as np
import pytest
from studies.hysteresis import SLIP_NEGATIVE, SLIP_POSITIVE, TRUTH, slipping

from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.hysteresis.fit import fit, refit, with_std
from scara_kinetostatic.studies.hysteresis.laws import (
    BACKLASH,
    CANDIDATES,
    RESET,
    SLIP,
    SLIP_NO_GAP,
    simulate_record,
    sine,
)
from scara_kinetostatic.studies.hysteresis.motion import cut_at_reversals, motion_from_readings, repeatability

_SLIPS = {'slip_positive': SLIP_POSITIVE, 'slip_negative': SLIP_NEGATIVE}
VALUES = {**TRUTH, **_SLIPS, 'start': 0.0}


def everything(motion):
    return np.ones(len(motion), dtype=bool)


def test_slip_agrees_with_an_independent_simulation_in_small_steps():
    motion = slipping()
    assert motion.force[0] == TRUTH['force_zero']  # inside the gap, where the reading tells no place
    force = SLIP.force({**VALUES, 'start': motion.displacement[0]}, motion)
    assert np.abs(force - motion.force).max() < 1e-6 * SLIP_POSITIVE
    assert force.max() == pytest.approx(SLIP_POSITIVE + TRUTH['force_zero'])


def test_without_slip_it_is_law_6():
    motion = simulate_record(BACKLASH, TRUTH, 0.0, 0)
    start = motion.displacement[0] - motion.displacement.mean() - TRUTH['zero']
    first = motion.force[0] - TRUTH['force_zero']
    place = np.clip(first / (0.02 * motion.force_range), -1, 1)
    state = TRUTH['compliance'] * first + TRUTH['half_gap'] * place
    high = {'slip_positive': 1e9, 'slip_negative': 1e9, 'start': start - state}
    assert SLIP.force({**TRUTH, **high}, motion) == pytest.approx(motion.force, abs=1e-6)


def test_no_gap_is_slip_with_a_gap_of_zero():
    motion = slipping()
    values = {**_SLIPS, 'start': 1e-4, 'compliance': 1e-6}
    with_gap = SLIP.force({**values, 'half_gap': 0.0, 'force_zero': 0.0}, motion)
    assert SLIP_NO_GAP.force(values, motion) == pytest.approx(with_gap, abs=1e-9)


def test_told_the_force_law_6_starts_every_sweep_where_it_was_measured():
    motion = slipping()
    force = RESET.force(TRUTH, motion)
    step = np.abs(np.diff(motion.displacement))[motion.begins[1:]] / TRUTH['compliance']
    assert np.all(np.abs(force[motion.edges[1:-1]] - motion.force[motion.begins[1:]]) <= step + 1e-6)
    assert np.abs(force - motion.force).max() > SLIP_POSITIVE  # it never slips


@pytest.mark.parametrize('noise', [1.0, 100.0])
def test_parameters_come_back(noise):
    motion = slipping(noise)
    found = with_std(fit(SLIP, motion, everything(motion)), motion)
    for name, truth in {**TRUTH, **_SLIPS}.items():
        if name != 'zero':
            scale = {'half_gap': 2e-6, 'compliance': 1e-10}.get(name, 0.5)
            assert found[name].value == pytest.approx(truth, abs=max(6 * found[name].std, scale)), name
            assert found[name].std < 0.02 * abs(truth) + 0.2 * noise, name


def test_parameters_come_back_from_half_of_the_sweeps():
    motion = slipping(50.0)
    for rows in (motion.earlier, ~motion.earlier):
        fitted = fit(SLIP, motion, rows | ~motion.scored)
        assert fitted.values['slip_positive'] == pytest.approx(SLIP_POSITIVE, rel=0.01)
        assert fitted.values['half_gap'] == pytest.approx(TRUTH['half_gap'], rel=0.03)


def test_only_some_parameters_are_fitted_on_request():
    motion = slipping(10.0)
    fitted = fit(SLIP, motion, everything(motion))
    wrong = fitted._replace(values={**fitted.values, 'slip_positive': 5e3, 'compliance': 1.02e-6})
    found = refit(wrong, motion, everything(motion), only=('slip_positive',))
    assert found.values['compliance'] == 1.02e-6
    assert found.values['slip_positive'] == pytest.approx(SLIP_POSITIVE, rel=0.1)


def test_the_motion_is_cut_at_its_reversals_and_its_still_ends_are_left_out():
    time, moved = sine(640)
    still = np.full(100, moved[-1])
    force = np.arange(740.0)
    motion = cut_at_reversals(np.arange(740) * (time[1] - time[0]), np.concatenate([moved, still]), force)
    assert motion.sweeps == 11
    assert len(motion) < 645
    assert set(np.unique(motion.sense)) == {-1.0, 1.0}
    assert np.all(np.diff(motion.displacement) * motion.sense[1:] >= 0)
    assert np.abs(np.diff(motion.distance)[motion.edges[1:-1] - 1]).min() > 1e-3  # far from the reversal, then near it
    assert motion.distance[motion.edges[1:-1]].max() < 1e-3
    with pytest.raises(ValueError, match='read-only'):
        motion.force[0] = 1.0


def test_repeatability_is_the_scatter_where_the_motion_repeats():
    assert repeatability(slipping(50.0)) == pytest.approx(50.0, rel=0.15)
    time = np.linspace(0, 10, 500)
    growing = cut_at_reversals(time, time * np.sin(np.pi * time), time)
    assert np.isnan(repeatability(growing))


@pytest.mark.parametrize(
    ('time', 'moved', 'force', 'problem'),
    [
        (np.zeros(99), np.arange(99.0), np.arange(99.0), 'does not rise'),
        (np.arange(99.0), np.zeros(99), np.arange(99.0), 'never changes'),
        (np.arange(99.0), np.arange(99.0), np.ones(99), 'never changes'),
        (np.arange(99.0), np.arange(99.0), np.arange(99.0), '1 sweeps'),
        (np.arange(20.0), np.sin(np.arange(20.0)), np.arange(20.0), 'are needed'),
        (np.zeros(1), np.zeros(1), np.zeros(1), 'one sample'),
    ],
)
def test_records_that_are_no_loops_are_refused(time, moved, force, problem):
    with pytest.raises(UnsupportedDataError, match=problem):
        cut_at_reversals(time, moved, force)


def test_loops_need_times():
    with pytest.raises(UnsupportedDataError, match='time'):
        motion_from_readings(DialGaugeReadings.of([1.0, 2.0], [0.0, 1.0]))


def test_every_candidate_has_starts_and_a_finite_force():
    motion = slipping()
    for law in (BACKLASH, *CANDIDATES):
        for start in law.starts(motion)[:5]:
            force = law.force(start, motion)
            assert force.shape == motion.force.shape
            assert np.all(np.isfinite(force))
