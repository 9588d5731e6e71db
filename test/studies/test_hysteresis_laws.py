"""Laws of the force along a motion, against an independent simulator and against one another."""

from __future__ import annotations

import numpy as np
import pytest
from studies.hysteresis import SLIPS, TRUTH, slipping

from benchmark.hysteresis import simulate_record
from scara_kinetostatic.studies.loops.fit import fit_motion
from scara_kinetostatic.studies.loops.laws import BACKLASH, MOTION_LAWS
from scara_kinetostatic.studies.loops.motion import cut_at_reversals
from scara_kinetostatic.studies.loops.selection import MotionStudy

LAWS = {law.name: law for law in MOTION_LAWS}
SLIP, SLIP_NO_GAP = LAWS['slip'], LAWS['slip_no_gap']


def test_slip_agrees_with_an_independent_simulation_in_small_steps():
    motion = cut_at_reversals(slipping())
    assert motion.driven[0] == TRUTH['force_zero']  # inside the gap, where the reading tells no place
    force = SLIP.function(motion, {**TRUTH, **SLIPS, 'start': motion.driver[0]})
    assert np.abs(force - motion.driven).max() < 1e-6 * SLIPS['slip_positive']
    assert force.max() == pytest.approx(SLIPS['slip_positive'] + TRUTH['force_zero'])


def test_without_slip_it_is_law_6():
    motion = cut_at_reversals(simulate_record(BACKLASH, TRUTH, 0.0, 0))
    start = motion.driver[0] - motion.driver.mean() - TRUTH['zero']
    first = motion.driven[0] - TRUTH['force_zero']
    place = np.clip(first / (0.02 * motion.driven_range), -1, 1)
    state = TRUTH['compliance'] * first + TRUTH['half_gap'] * place
    high = {'slip_positive': 1e9, 'slip_negative': 1e9, 'start': start - state}
    assert SLIP.function(motion, {**TRUTH, **high}) == pytest.approx(motion.driven, abs=1e-6)


def test_no_gap_is_slip_with_a_gap_of_zero():
    motion = cut_at_reversals(slipping())
    values = {**SLIPS, 'start': 1e-4, 'compliance': 1e-6}
    with_gap = SLIP.function(motion, {**values, 'half_gap': 0.0, 'force_zero': 0.0})
    assert SLIP_NO_GAP.function(motion, values) == pytest.approx(with_gap, abs=1e-9)


def test_other_laws_are_law_6_with_what_their_name_says():
    motion = cut_at_reversals(slipping())
    spring = BACKLASH.function(motion, TRUTH)
    added = {'damping': 2e4, 'friction': 1e3}
    viscous, friction = (LAWS[name].function(motion, {**TRUTH, **added}) for name in ('viscous', 'friction'))
    assert viscous - spring == pytest.approx(2e4 * motion.speed, abs=1e-9)
    assert friction - spring == pytest.approx(1e3 * motion.sense, abs=1e-9)
    soft = LAWS['softening'].function(motion, {**TRUTH, **SLIPS}) - TRUTH['force_zero']
    elastic = spring - TRUTH['force_zero']
    top = np.where(elastic > 0, SLIPS['slip_positive'], SLIPS['slip_negative'])
    assert soft == pytest.approx(top * np.tanh(elastic / top), rel=1e-6)


@pytest.mark.parametrize('noise', [1.0, 100.0])
def test_parameters_come_back(noise):
    study = MotionStudy(slipping(noise))
    found = study.with_std(study.candidate(SLIP)).parameters
    for name in (*SLIPS, 'compliance', 'half_gap', 'force_zero'):
        truth = {**TRUTH, **SLIPS}[name]
        scale = {'half_gap': 2e-6, 'compliance': 1e-10}.get(name, 0.5)
        assert found[name].value == pytest.approx(truth, abs=max(6 * found[name].std, scale)), name
        assert found[name].std < 0.02 * abs(truth) + 0.2 * noise, name


def test_parameters_come_back_from_half_of_the_sweeps():
    motion = cut_at_reversals(slipping(50.0))
    for rows in (motion.earlier, ~motion.earlier):
        fitted = fit_motion(SLIP, motion, rows | ~motion.scored)
        assert fitted.values['slip_positive'] == pytest.approx(SLIPS['slip_positive'], rel=0.01)
        assert fitted.values['half_gap'] == pytest.approx(TRUTH['half_gap'], rel=0.03)
        residual = (motion.driven - SLIP.function(motion, fitted.values))[rows | ~motion.scored]
        assert fitted.square == pytest.approx(residual @ residual)
