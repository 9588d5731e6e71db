"""Laws of the force along a motion, against an independent simulator and one another; what is decided on loops."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from studies.load_records import play

from benchmark.hysteresis import alarmed, exact_force, simulate_record, sine
from scara_kinetostatic.model.arrays import effective_count, rms
from scara_kinetostatic.report.page import as_text
from scara_kinetostatic.studies.loops.fit import FitSamples, evaluate, fit_law, predict
from scara_kinetostatic.studies.loops.laws import BACKLASH, MOTION_LAWS
from scara_kinetostatic.studies.loops.record import MOTION, Record, RecordPath
from scara_kinetostatic.studies.loops.report import hysteresis_document, hysteresis_report
from scara_kinetostatic.studies.loops.selection import Study, select_model

TRUTH = {'zero': 0.001, 'compliance': 1e-6, 'half_gap': 2e-3, 'force_zero': 50.0}
SLIPS = {'slip_positive': 8e3, 'slip_negative': 6e3}


def slipping(noise: float = 0.0, seed: int = 0, fine: int = 40) -> Record:
    """A joint with gap that slips, sample by sample, finely, the spring's end dragged along when it slips."""
    time, moved = sine()
    p, g = TRUTH['compliance'], TRUTH['half_gap']
    places = np.interp(np.linspace(0, len(time) - 1, fine * (len(time) - 1) + 1), np.arange(len(time)), moved)
    rising, falling = (g + p * each for each in SLIPS.values())
    stretch = places - play(places - (rising - falling) / 2, (rising + falling) / 2)
    forces = np.sign(stretch) * np.maximum(np.abs(stretch) - g, 0.0) / p
    noisy = forces[::fine] + TRUTH['force_zero'] + noise * np.random.default_rng(seed).standard_normal(len(time))
    return Record('loops.csv', time, noisy, moved, 'N')


LAWS = {law.name: law for law in MOTION_LAWS}
SLIP = LAWS['slip']


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


def test_laws_are_law_6_with_what_their_name_says():
    path = RecordPath(simulate_record(BACKLASH, TRUTH, 0.0, 0), MOTION)
    high = {'slip_positive': 1e9, 'slip_negative': 1e9}
    state = state_of(path.driver[0] - path.driver.mean() - TRUTH['zero'], TRUTH['half_gap'], high)
    assert exact_force(SLIP, path, {**TRUTH, **high, 'state': state}) == pytest.approx(path.driven, abs=1e-3)
    path = RecordPath(slipping(), MOTION)
    values = {**SLIPS, 'state': 0.3, 'compliance': 1e-6}
    with_gap = exact_force(SLIP, path, {**values, 'half_gap': 0.0, 'force_zero': 0.0})
    assert exact_force(LAWS['slip_no_gap'], path, values) == pytest.approx(with_gap, abs=1e-9)
    spring = exact_force(BACKLASH, path, TRUTH)
    added = {'damping': 2e4, 'friction': 1e3}
    viscous, friction = (exact_force(LAWS[name], path, {**TRUTH, **added}) for name in ('viscous', 'friction'))
    assert viscous - spring == pytest.approx(2e4 * path.speed, abs=1e-9)
    assert friction - spring == pytest.approx(1e3 * path.sense, abs=1e-9)
    soft = exact_force(LAWS['softening'], path, {**TRUTH, **SLIPS}) - TRUTH['force_zero']
    elastic = spring - TRUTH['force_zero']
    top = np.where(elastic > 0, SLIPS['slip_positive'], SLIPS['slip_negative'])
    assert soft == pytest.approx(top * np.tanh(elastic / top), rel=1e-6)


def test_a_force_counted_the_other_way_is_the_same_law():
    given = slipping(50.0)
    study = Study([replace(given, load=-given.load)], MOTION)
    found = study.candidate(SLIP).parameters
    assert study.direction == -1.0
    assert found['compliance'].value == pytest.approx(TRUTH['compliance'], rel=0.01)
    assert found['slip_positive'].value == pytest.approx(SLIPS['slip_positive'], rel=0.01)
    assert found['force_zero'].value == pytest.approx(-TRUTH['force_zero'], abs=10)


NOISE = 50.0


@pytest.fixture(scope='module')
def slip_selection():
    return select_model(Study([slipping(NOISE)], MOTION, MOTION_LAWS[2:]))


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


def test_parameters_come_back(slip_selection):
    found = slip_selection.selected.parameters
    for name in (*SLIPS, 'compliance', 'half_gap', 'force_zero'):
        truth = {**TRUTH, **SLIPS}[name]
        scale = {'half_gap': 2e-6, 'compliance': 1e-10}.get(name, 0.5)
        assert found[name].value == pytest.approx(truth, abs=max(6 * found[name].std, scale)), name
        assert found[name].std < 0.02 * abs(truth) + 0.2 * NOISE, name


def test_held_out_residuals_are_those_of_the_fit_that_has_not_seen_them(slip_selection):
    (path,), selected = slip_selection.study.paths, slip_selection.selected
    held_out = selected.held_out[0].residual
    for rows in path.halves:
        fitted = fit_law([FitSamples(SLIP, path, rows, path.size)])
        assert fitted.reported['slip_positive'] == pytest.approx(SLIPS['slip_positive'], rel=0.01)
        assert fitted.reported['half_gap'] == pytest.approx(TRUTH['half_gap'], rel=0.03)
        residual = predict(fitted, path, rows).residual
        assert held_out[~rows] == pytest.approx(residual[~rows])
        along = (path.driven - fitted.zero - evaluate(fitted, path, fitted.states[0]))[rows]
        assert fitted.square == pytest.approx(along @ along)
    assert selected.held_out_rms == pytest.approx(rms(held_out[path.scored]))


def test_law_6_alone_raises_few_alarms_and_needs_nothing():
    """1 % each: more than 1 of 4 would come by chance once in 1700 times."""
    records = [simulate_record(BACKLASH, TRUTH, NOISE, seed, 0.9 * (seed % 2)) for seed in range(4)]
    assert sum(map(alarmed, records)) <= 1
    selection = select_model(Study(records[:1], MOTION, [LAWS['viscous'], LAWS['friction']]))
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
    assert {str(each.std) for each in selection.stated(selection.before).values()} == {'nan'}
    document = hysteresis_document([selection])['records'][0]
    assert {str(each.std) for law in document['candidates'] for each in law['parameters'].values()} == {'nan'}
    said = ' '.join(as_text(hysteresis_report([selection])).split())
    assert 'before: fit only' in said and 'this is no compliance and no gap of the joint' in said


def test_samples_that_hang_together_count_less():
    white = np.random.default_rng(0).standard_normal(4000)
    assert effective_count(white) > 2500
    smooth = np.convolve(white, np.ones(20), mode='valid')
    assert effective_count(smooth) == pytest.approx(len(smooth) / 20, rel=0.5)
    assert effective_count(np.zeros(10)) == 10
