"""Laws of the response to a load, from rest to rest and in loops: against independent loops, and what is decided."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from studies.load_records import RATE, columns, play, record, torque

from scara_kinetostatic.errors import RecordingError, UnsupportedDataError
from scara_kinetostatic.model.play_operator import play_operator
from scara_kinetostatic.report.page import as_page, as_text
from scara_kinetostatic.studies.loops.laws import LOAD_LAWS
from scara_kinetostatic.studies.loops.record import LOAD, MOTION, Record, RecordPath, load_record, what_drives
from scara_kinetostatic.studies.loops.report import hysteresis_document, hysteresis_report, verdict
from scara_kinetostatic.studies.loops.selection import (
    Selection,
    Study,
    analyse,
    analyse_both,
    p_independent,
    predict_records,
    select_model,
)

STATES = ((-2.0, 0.3), (-2.6, -0.8), (-3.0, 0.7))
"""Load and state of friction at the start."""
LAWS = [law for law in LOAD_LAWS if law.name in ('friction', 'slip')]


def wandering(seed: int) -> RecordPath:
    """A load that wanders, after a rest and before another."""
    random = np.random.default_rng(seed)
    load = np.concatenate([np.zeros(60), 3.0 + np.cumsum(random.normal(0.0, 0.3, 300)), np.zeros(60)])
    load += 1e-3 * random.standard_normal(len(load))
    return RecordPath(Record('one.csv', np.arange(len(load)) / RATE, load, 1e-4 * load))


@pytest.mark.parametrize('state', [-1.0, -0.4, 0.0, 0.9])
@pytest.mark.parametrize('half_width', [0.01, 0.5, 2.0, 50.0])
def test_the_play_operator_is_that_of_a_loop_and_of_the_calibration(state: float, half_width: float) -> None:
    """One law in both places: along a record, and over the load before each touch."""
    path = wandering(0)
    expected, found = play(path.smooth, half_width, state * half_width), path.play_operator(half_width, state)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    at_end, *_ = play_operator(path.smooth[None, :-1], path.smooth[-1:], half_width)
    np.testing.assert_allclose(path.play_operator(half_width, 0.0)[-1], at_end, rtol=0, atol=1e-12)


def test_the_sign_of_an_unloaded_gap_is_that_of_its_last_load() -> None:
    load = torque(2.0)
    path = RecordPath(record(load))
    sign = path.last_sign(8.0, -0.5)
    assert set(sign[:190]) == {-0.5}
    assert set(sign[220:]) == {1.0}


@pytest.fixture(scope='module')
def records() -> list[Record]:
    """Of a joint that slips."""
    return [record(torque(level), number, state) for number, (level, state) in enumerate(STATES)]


@pytest.fixture(scope='module')
def analysis(records: list[Record]) -> Selection:
    """Of these records."""
    return select_model(Study(records, laws=LAWS))


def scaled(each: Record, load: float, response: float) -> Record:
    """The same in other units."""
    return replace(each, load=load * each.load, response=response * each.response)


def test_units_and_signs_change_no_verdict(records: list[Record], analysis: Selection) -> None:
    load, response = -1e-6, 1e3
    other = select_model(Study([scaled(each, load, response) for each in records], laws=LAWS))
    one, two = analysis.selected, other.selected
    assert one is not None and two is not None
    assert (one.law.effect, one.law.name, analysis.verdict) == ('slip', two.law.name, other.verdict)
    assert other.study.direction == -analysis.study.direction
    assert np.log(other.p_value) == pytest.approx(np.log(analysis.p_value), rel=1e-6)
    assert two.held_out_rms == pytest.approx(response * one.held_out_rms, rel=0.02)
    compliance = abs(response / load) * one.parameters['compliance'].value
    assert two.parameters['compliance'].value == pytest.approx(compliance, rel=1e-3)


def test_no_response_after_the_unloading_is_used(analysis: Selection) -> None:
    other = record(torque(-2.8), 9, -0.5)
    changed = 1.0 + np.random.default_rng(1).normal(0.0, 0.1, len(other))
    changed[: other.judged_from] = 0.0
    altered = replace(other, response=other.response + changed)
    (found,), (same,) = (predict_records(analysis, [each]) for each in (other, altered))
    assert found.after_rms < 4e-6
    for one, two in ((found.before, same.before), (found.after, same.after)):
        assert (one.state, one.zero) == (two.state, two.zero)
        np.testing.assert_allclose(two.residual - one.residual, changed, rtol=0, atol=1e-12)


def test_law_6_is_sufficient_for_records_of_law_6() -> None:
    half_gap, levels = 60e-6, (-2.0, 2.5, -3.0)
    several = [record(torque(level), 7 + k, half_gap=half_gap) for k, level in enumerate(levels)]
    found = select_model(Study(several, laws=LAWS))
    assert (found.verdict, found.selected, found.rivals) == ('none', None, ())
    assert found.before.parameters['compliance'].value == pytest.approx(150e-6, rel=0.02)
    assert found.before.parameters['half_gap'].value == pytest.approx(half_gap, rel=0.1)
    headline, level, sentences, _ = verdict(found)
    assert (headline, level) == ('Law (6), slope and gap, is sufficient', 'good')
    assert not any('to test' in each or 'hardly' in each or 'keeps' in each for each in sentences)


def p_law6(several: list[Record]) -> float:
    _, dependence, _ = Study(several).law6()
    return p_independent(dependence)


def test_false_alarms_are_rare() -> None:
    alarms = 0
    for number in range(6):
        levels = np.random.default_rng(number).uniform(-3.0, -1.0, 2)
        alarms += p_law6([record(torque(each), 100 * k + number) for k, each in enumerate(levels)]) < 0.01
    assert alarms <= 1


def test_one_record_is_not_taken_for_several(records: list[Record]) -> None:
    """Of a slip whose own record shows no dependence beyond a gap law (6) is not called sufficient."""
    found = select_model(Study(records[:1], laws=LAWS))
    headline, level, *_ = verdict(found)
    assert (found.verdict, found.selected) == ('undecided', None)
    assert any(map(found.is_clearly_smaller, found.candidates))
    assert headline == 'These records do not show whether law (6) is sufficient'
    assert level == 'caution'
    report = hysteresis_report([found])
    assert 'less, not significantly' in as_text(report)
    assert 'class="verdict caution"' in as_page(report)


def test_what_was_not_tested_is_said() -> None:
    part = np.concatenate([torque()[:500], np.full(200, -1.0)])
    found = select_model(Study([record(part, 1), record(part, 2)], laws=()))
    assert any('to test the dependence on the load before' in each for each in verdict(found).sentences)
    tested = {each.variable: each.p_value for each in found.dependence_before}
    assert np.isnan(tested['memory']) and tested['load'] > 0.01


def test_a_record_that_tests_nothing_is_refused() -> None:
    load = np.concatenate([np.zeros(100), np.full(10, -2.0), np.full(40, -1.0)])
    with pytest.raises(UnsupportedDataError, match=r'1\.csv: the load neither comes back to rest nor lasts'):
        p_law6([record(load, 1, 0.8), record(load, 2, 0.8)])


def test_a_response_that_follows_in_the_opposite_sense_is_refused(records: list[Record], analysis: Selection) -> None:
    opposite = replace(scaled(records[2], 1.0, -1.0), source='opposite.csv')
    with pytest.raises(RecordingError, match=r'opposite\.csv: its response follows the load in the opposite sense'):
        Study([*records[:2], opposite])
    with pytest.raises(RecordingError, match=r'opposite\.csv: its response follows'):
        predict_records(analysis, [opposite])


def test_a_response_that_follows_no_load_is_said() -> None:
    several = [record(torque(), seed) for seed in (1, 2)]
    noise = [np.random.default_rng(seed).normal(0.0, 2e-6, len(each)) for seed, each in enumerate(several)]
    given = [replace(each, response=own) for each, own in zip(several, noise, strict=True)]
    found = select_model(Study(given, laws=()))
    assert 'The angle hardly follows the torque: do the columns belong to one joint?' in verdict(found).sentences


@pytest.mark.parametrize('rate', [10.0, 800.0])
def test_other_rates_of_sampling_give_the_same(rate: float) -> None:
    several = []
    for number, (level, state) in enumerate(STATES[:2]):
        load = np.repeat(torque(level), max(round(rate / RATE), 1))
        _, measured, angle = columns(load, number, state)
        several.append(Record(f'{number}.csv', np.arange(len(load)) / rate, measured, angle))
    study = Study(several)
    before, dependence, _ = study.law6()
    slip = study.candidate(LAWS[1])
    assert p_independent(dependence) < 1e-9
    assert study.p_better(slip, before) < 1e-3
    assert slip.held_out_rms < 6e-6


C, MU, SOFTNESS, HALF_GAP = 2.0, 0.3, 3e-3, 15e-3
GEAR = {'friction': C, 'friction_ratio': MU, 'compliance': SOFTNESS, 'half_gap': HALF_GAP}
LOOPS = (4.0, 4.0, 4.0, 25.0, 25.0, 25.0)


def elastic(load: np.ndarray, c: float, mu: float) -> np.ndarray:
    """What friction leaves to the spring, one sample after the other, from |τ - τ_e| ≤ c + μ |τ_e|, bisected."""
    output, here = [], 0.0
    for each in load.tolist():
        low, high = (here, each) if each > here else (each, here)
        if abs(each - here) > c + mu * abs(here):
            for _ in range(50):
                middle = (low + high) / 2
                slips = abs(each - middle) > c + mu * abs(middle)
                low, high = (middle, high) if slips == (each > here) else (low, middle)
            here = (low + high) / 2
        output.append(here)
    return np.array(output)


def gear(seed: int = 0, c: float = C, mu: float = MU, noise: float = 3e-4) -> Record:
    """Small loops, then large ones."""
    corners = [0.0, *(sign * size for size in LOOPS for sign in (1, -1)), 0.0]
    load = np.concatenate([np.linspace(*ends, 80)[:-1] for ends in pairwise(corners)])
    random = np.random.default_rng(seed)
    spring = elastic(load, c, mu) if c else load
    gap = spring / np.hypot(spring, 0.5) if c else np.sign(load)
    angle = 0.1 + SOFTNESS * spring + HALF_GAP * gap + noise * random.standard_normal(len(load))
    return Record(f'{seed}.csv', 0.06 * np.arange(len(load)), load, angle, driven_by=LOAD)


def rested(one: Record, samples: int = 200) -> Record:
    """The same after a rest."""
    random = np.random.default_rng(9)
    still = one.response[0] + 3e-4 * random.standard_normal(samples)
    load = np.concatenate([np.zeros(samples), one.load])
    return replace(one, time=0.06 * np.arange(len(load)), load=load, response=np.concatenate([still, one.response]))


@pytest.fixture(scope='module')
def of_loops() -> Selection:
    return select_model(Study([gear()]))


def test_friction_that_grows_with_the_load_is_found(of_loops: Selection) -> None:
    assert (of_loops.verdict, of_loops.final.law.name) == ('explained', 'load_friction')
    assert of_loops.final.held_out_rms < 0.05 * of_loops.before.held_out_rms
    assert of_loops.final.held_out_rms < 2 * 3e-4
    found = of_loops.final.parameters
    for name, true in GEAR.items():
        assert found[name].value == pytest.approx(true, rel=0.05)
        assert found[name].std > 0


def test_law_6_is_sufficient_for_loops_of_law_6() -> None:
    found = select_model(Study([gear(1, 0.0)], laws=LAWS))
    assert (found.verdict, found.selected) == ('none', None)
    assert found.detectable < 0.5
    assert re.search(r'Each test would have found \d+ % of its square', ' '.join(verdict(found).sentences))


def test_another_record_is_predicted_after_its_first_third(of_loops: Selection) -> None:
    other = gear(2)
    (found,) = predict_records(of_loops, [other])
    assert found.after_rms < 1e-3 < found.before_rms
    document = hysteresis_document([of_loops], [found])
    assert document['predicted'][0]['from_s'] == other.time[len(other) // 3]
    later = other.response + np.where(np.arange(len(other)) < len(other) // 3, 0.0, 1e-3)
    (moved,) = predict_records(of_loops, [replace(other, response=later)])
    assert (moved.after.state, moved.after.zero) == (found.after.state, found.after.zero)


def test_a_record_on_which_the_law_of_all_does_not_hold_is_named_with_the_figure(of_loops: Selection) -> None:
    softer = replace(gear(3), source='softer.csv', response=1.5 * gear(3).response)
    (found,) = analyse([gear(), gear(1), softer], LOAD)
    assert re.fullmatch(r'On softer.csv the law of all records errs \d+\.\d times as much .*', found.misfit)
    report = hysteresis_report([found], predict_records(found, [gear(2)]))
    assert (report.answer.level, report.answer.sentences[0]) == ('caution', found.misfit)
    assert hysteresis_document([found])['misfit'] == found.misfit
    assert not of_loops.misfit and hysteresis_document([of_loops])['misfit'] is None


def test_what_is_refused() -> None:
    one = gear()
    ramp = replace(one, load=np.linspace(0.0, 25.0, len(one)), response=np.linspace(0.0, 0.1, len(one)))
    swapped = replace(one, load=one.response, response=one.load)
    ahead = 'the angle runs ahead of the torque, as if the joint gave out energy; check whether the two columns'
    for bad, message in ((ramp, 'reverses 0 times; loops need 5 reversals'), (swapped, f'0.csv: {ahead}')):
        with pytest.raises(UnsupportedDataError, match=message):
            RecordPath(bad)


def test_records_in_loops_and_from_rest_are_taken_together() -> None:
    records, place = [gear(seed) for seed in range(3)], 0
    records[place] = rested(records[place])
    assert [each.is_at_rest_first for each in records] == [k == place for k in range(3)]
    assert what_drives(records) == LOAD
    found = select_model(Study(records, laws=[law for law in LOAD_LAWS if law.name == 'load_friction']))
    assert (found.verdict, found.final.law.name) == ('explained', 'load_friction')
    for name, true in GEAR.items():
        assert found.final.parameters[name].value == pytest.approx(true, rel=0.05)
    assert max(each.after_rms for each in found.judged) < 2 * 3e-4
    alone = Study(records[1:]).candidate(found.final.law)
    assert found.final.along[2].state == pytest.approx(alone.along[1].state, abs=0.02)


def test_a_column_of_commands_says_what_drives(tmp_path: Path) -> None:
    one = gear()
    rows = [f'{t:.3f},{q:.6f},{tau:.4f},{tau:.4f}' for t, q, tau in zip(one.time, one.response, one.load, strict=True)]
    for heading, driven in (('commanded_Nm', 'load'), ('commanded_rad', 'motion'), ('other_s2', 'motion')):
        path = tmp_path / f'{heading}.csv'
        path.write_text('\n'.join([f'time_s,angle_rad,torque_Nm,{heading}', *rows]), encoding='utf-8')
        assert what_drives([load_record(path)]) == driven


def sine_slip(noise: float = 1e-6) -> Record:
    """A joint with slip under a load that goes to and fro: 20 and 15 µrad/Nm, 1 Nm."""
    time = np.arange(600) / 50.0
    load = 10.0 * np.sin(2 * np.pi * 0.5 * time)
    angle = 2e-5 * load + 1.5e-5 * play(load, 1.0)
    random = np.random.default_rng(3).standard_normal((2, len(time)))
    return Record('sine.csv', time, load + 0.02 * random[0], angle + noise * random[1])


def test_both_are_tried_where_nothing_states_what_drives() -> None:
    (found,), (other,) = analyse_both([sine_slip()], what_drives([sine_slip()]))
    assert (found.study.driven_by, other.study.driven_by) == (LOAD, MOTION)
    assert found.final_share < 0.3 * other.final_share
    estimates = found.final.parameters
    for name, truth in (('compliance', 2e-5), ('slip_compliance', 1.5e-5), ('slip_load', 1.0)):
        assert estimates[name].value == pytest.approx(truth, rel=0.05)
    said = as_text(hysteresis_report([found], other=[other]))
    assert 'Nothing states what drives' in said
