"""Laws of the force along a motion, against an independent simulator and against one another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.hysteresis import SLIPS, TRUTH, slipping

from benchmark.hysteresis import exact_force, simulate_record
from scara_kinetostatic.studies.loops.fit import Moments, evaluate, fit_law
from scara_kinetostatic.studies.loops.laws import BACKLASH, MOTION_LAWS
from scara_kinetostatic.studies.loops.record import MOTION, RecordPath
from scara_kinetostatic.studies.loops.selection import Study

LAWS = {law.name: law for law in MOTION_LAWS}
SLIP, SLIP_NO_GAP = LAWS['slip'], LAWS['slip_no_gap']


def state_of(deflection: float, half_gap: float, slips: dict[str, float]) -> float:
    """State of friction in which a joint with a compliance of `TRUTH` begins at a deflection, -1 to 1."""
    rising, falling = (half_gap + TRUTH['compliance'] * each for each in slips.values())
    return ((rising - falling) / 2 - deflection) / ((rising + falling) / 2)


def test_slip_agrees_with_an_independent_simulation_in_small_steps():
    path = RecordPath(slipping(), MOTION)
    assert path.driven[0] == TRUTH['force_zero']  # inside the gap, where the reading tells no place
    state = state_of(path.driver[0], TRUTH['half_gap'], SLIPS)
    force = exact_force(SLIP, path, {**TRUTH, **SLIPS, 'state': state})
    assert np.abs(force - path.driven).max() < 1e-6 * SLIPS['slip_positive']
    assert force.max() == pytest.approx(SLIPS['slip_positive'] + TRUTH['force_zero'])


def test_without_slip_it_is_law_6():
    path = RecordPath(simulate_record(BACKLASH, TRUTH, 0.0, 0), MOTION)
    high = {'slip_positive': 1e9, 'slip_negative': 1e9}
    start = path.driver[0] - path.driver.mean() - TRUTH['zero']
    state = state_of(start, TRUTH['half_gap'], high)
    assert exact_force(SLIP, path, {**TRUTH, **high, 'state': state}) == pytest.approx(path.driven, abs=1e-3)


def test_no_gap_is_slip_with_a_gap_of_zero():
    path = RecordPath(slipping(), MOTION)
    values = {**SLIPS, 'state': 0.3, 'compliance': 1e-6}
    with_gap = exact_force(SLIP, path, {**values, 'half_gap': 0.0, 'force_zero': 0.0})
    assert exact_force(SLIP_NO_GAP, path, values) == pytest.approx(with_gap, abs=1e-9)


def test_other_laws_are_law_6_with_what_their_name_says():
    path = RecordPath(slipping(), MOTION)
    spring = exact_force(BACKLASH, path, TRUTH)
    added = {'damping': 2e4, 'friction': 1e3}
    viscous, friction = (exact_force(LAWS[name], path, {**TRUTH, **added}) for name in ('viscous', 'friction'))
    assert viscous - spring == pytest.approx(2e4 * path.speed, abs=1e-9)
    assert friction - spring == pytest.approx(1e3 * path.sense, abs=1e-9)
    soft = exact_force(LAWS['softening'], path, {**TRUTH, **SLIPS}) - TRUTH['force_zero']
    elastic = spring - TRUTH['force_zero']
    top = np.where(elastic > 0, SLIPS['slip_positive'], SLIPS['slip_negative'])
    assert soft == pytest.approx(top * np.tanh(elastic / top), rel=1e-6)


@pytest.mark.parametrize('noise', [1.0, 100.0])
def test_parameters_come_back(noise):
    study = Study([slipping(noise)], MOTION)
    found = study.with_std(study.candidate(SLIP)).parameters
    for name in (*SLIPS, 'compliance', 'half_gap', 'force_zero'):
        truth = {**TRUTH, **SLIPS}[name]
        scale = {'half_gap': 2e-6, 'compliance': 1e-10}.get(name, 0.5)
        assert found[name].value == pytest.approx(truth, abs=max(6 * found[name].std, scale)), name
        assert found[name].std < 0.02 * abs(truth) + 0.2 * noise, name


def test_a_force_counted_the_other_way_is_the_same_law():
    given = slipping(50.0)
    study = Study([replace(given, load=-given.load)], MOTION)
    found = study.candidate(SLIP).parameters
    assert study.direction == -1.0
    assert found['compliance'].value == pytest.approx(TRUTH['compliance'], rel=0.01)
    assert found['slip_positive'].value == pytest.approx(SLIPS['slip_positive'], rel=0.01)
    assert found['force_zero'].value == pytest.approx(-TRUTH['force_zero'], abs=10)


def test_parameters_come_back_from_half_of_the_sweeps():
    path = RecordPath(slipping(50.0), MOTION)
    for rows in path.halves:
        fitted = fit_law([Moments(SLIP, path, rows, path.size)])
        assert fitted.reported['slip_positive'] == pytest.approx(SLIPS['slip_positive'], rel=0.01)
        assert fitted.reported['half_gap'] == pytest.approx(TRUTH['half_gap'], rel=0.03)
        residual = (path.driven - fitted.zero - evaluate(fitted, path, fitted.states[0]))[rows]
        assert fitted.square == pytest.approx(residual @ residual)
