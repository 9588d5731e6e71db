"""What is decided on loops: friction where there is friction, nothing where there is none, and what gains by it."""

from __future__ import annotations

import numpy as np
import pytest
from studies.hysteresis import SLIPS, TRUTH, slipping

from benchmark.hysteresis import alarmed, simulate_record
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.studies.loops.fit import Moments, effective_count, fit_law, predict
from scara_kinetostatic.studies.loops.laws import BACKLASH, MOTION_LAWS
from scara_kinetostatic.studies.loops.record import MOTION
from scara_kinetostatic.studies.loops.selection import Study, select_model

NOISE = 50.0
LAWS = {law.name: law for law in MOTION_LAWS}


@pytest.fixture(scope='module')
def slip_selection():
    return select_model(Study([slipping(NOISE)], MOTION))


def test_slip_is_named_and_the_error_on_unseen_sweeps_falls_to_the_noise(slip_selection):
    assert slip_selection.verdict == 'explained'
    assert slip_selection.selected.law.name == 'slip'
    assert slip_selection.rivals == ()
    assert slip_selection.p_value < 0.01 < slip_selection.p_after
    assert slip_selection.before.held_out_rms > 30 * NOISE
    assert slip_selection.selected.held_out_rms < 1.3 * NOISE
    assert slip_selection.final is slip_selection.selected
    share = {each.variable: each.share for each in slip_selection.dependence_before}
    assert share['distance_sense'] > 0.5
    assert share['displacement'] < 0.1
    study, selected, before = slip_selection.study, slip_selection.selected, slip_selection.before
    assert study.p_better(selected, selected) == 1.0
    assert study.p_better(selected, before) < 1e-3
    assert study.p_better(before, selected) > 0.99


def test_held_out_residuals_are_those_of_the_fit_that_has_not_seen_them(slip_selection):
    (path,), selected = slip_selection.study.paths, slip_selection.selected
    held_out = selected.held_out[0].residual
    for rows in path.halves:
        fitted = fit_law([Moments(selected.law, path, rows, path.size)])
        residual = predict(fitted, path, rows).residual
        assert held_out[~rows] == pytest.approx(residual[~rows])
    assert selected.held_out_rms == pytest.approx(rms(held_out[path.scored]))


def test_law_6_alone_raises_few_alarms_and_needs_nothing():
    """1 % each: more than 1 of 6 would come by chance once in 700 times."""
    records = [simulate_record(BACKLASH, TRUTH, NOISE, seed, 0.9 * (seed % 2)) for seed in range(6)]
    assert sum(map(alarmed, records)) <= 1
    selection = select_model(Study(records[:1], MOTION))
    assert (selection.verdict, selection.selected) == ('none', None)
    assert selection.final is selection.before
    assert not any(each.accepted for each in selection.candidates)


@pytest.mark.parametrize(
    ('name', 'other', 'more'),
    [
        ('softening', 'slip', SLIPS),
        ('viscous', 'friction', {'damping': 2e4}),
        ('friction', 'viscous', {'friction': 1000.0}),
        ('slip_no_gap', 'friction', {**SLIPS, 'force_zero': 1e3}),
    ],
)
def test_other_effects_are_called_by_their_own_names(name, other, more):
    """Beside what is most alike."""
    given = simulate_record(LAWS[name], {**TRUTH, **more}, NOISE, 3)
    selection = select_model(Study([given], MOTION, [LAWS[name], LAWS[other]]))
    assert selection.selected.law.name == name
    assert selection.rivals == ()
    assert selection.selected.held_out_rms < 1.1 * NOISE


def test_what_no_candidate_explains_is_said_to_be_unexplained():
    softened = simulate_record(LAWS['softening'], {**TRUTH, **SLIPS}, NOISE, 0)
    selection = select_model(Study([softened], MOTION, [LAWS['viscous']]))
    assert selection.verdict == 'unexplained'
    assert selection.p_value < 0.01


def test_samples_that_hang_together_count_less():
    white = np.random.default_rng(0).standard_normal(4000)
    assert effective_count(white) > 2500
    smooth = np.convolve(white, np.ones(20), mode='valid')
    assert effective_count(smooth) == pytest.approx(len(smooth) / 20, rel=0.5)
    assert effective_count(np.zeros(10)) == 10
