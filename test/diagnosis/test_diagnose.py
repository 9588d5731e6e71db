"""The verdict on data of a complete model, and of one that lacks something; trusted nominal values; messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from calibration.studies import CELL, NOISE, touches
from diagnosis.simulated import MORE, check_explained, deviations, effect, named, simulate

from benchmark import odds
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.diagnosis import search
from scara_kinetostatic.diagnosis.advice import open_questions
from scara_kinetostatic.diagnosis.diagnose import contradictions, diagnose
from scara_kinetostatic.diagnosis.result import Diagnosis, EffectSet
from scara_kinetostatic.diagnosis.verdict import suspects
from scara_kinetostatic.errors import UnsupportedDataError
from scara_kinetostatic.model.cell import Noise, Uncertainty
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_MEASURED
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches


def test_clean_data_raise_no_alarm():
    cases = ((PAPER_ACTUAL, CELL), (PAPER_MEASURED, replace(CELL, noise=None)))
    for robot, cell in cases:
        found = diagnose(calibrate(touches(robot), cell))
        assert (found.verdict, found.found, found.extended) == ('none', (), None)
        assert 1e-3 < found.p_value <= 1


def test_a_cause_without_another_in_its_place_is_no_pair_that_cannot_be_distinguished():
    text = open_questions('ambiguous', (), (('sensor_bias', 'base_tilt'), ('base_bow',)), ())
    pair, single = text.split('. ')
    assert pair == 'these touches cannot distinguish sensor_bias and base_tilt'
    assert single == 'These touches do not show whether there is base_bow'


def test_of_many_causes_the_first_are_named_and_the_others_counted():
    labels = tuple(f'effect_{k}' for k in range(6))
    assert 'effect_3 and 1 other' in open_questions('ambiguous', (), (labels[:5],), ())
    assert 'effect_3 and 2 others' in open_questions('ambiguous', (), (labels,), ())


def test_two_force_levels_show_no_curve_over_the_force():
    plan = default_plan(CELL, per_disc=18, levels=(10, 25), preload=0.3)
    data = simulate_touches(CELL, PAPER_MEASURED, plan, Noise(5e-6, 0.5), 3)
    assert diagnose(calibrate(data, replace(CELL, noise=None))).verdict == 'none'


@pytest.mark.parametrize('stated', [NOISE, Noise((8e-6, 1.2e-5), (0.34, 0.25))], ids=['common', 'of each axis'])
@pytest.mark.parametrize(
    ('noise', 'verdict', 'said'),
    [(Noise(3e-5, 0.9), 'unexplained', 'too small'), (Noise(3e-6, 0.1), 'none', 'too large')],
)
def test_wrongly_stated_noise_is_distinguished_from_an_effect(stated, noise, verdict, said):
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1, noise=noise), replace(CELL, noise=stated)))
    assert (found.verdict, found.dependences, found.found) == (verdict, (), ())
    assert said in found.advice


@pytest.mark.parametrize(('noise', 'move'), [(NOISE, 1e-4), (NOISE, 3e-2), (None, 2e-3)])
def test_a_displaced_disc_shows_whether_the_noise_is_known_or_not(noise, move):
    first, second, third = CELL.discs
    moved = replace(CELL, noise=noise, discs=(first, second._replace(x=second.x + move), third))
    found = diagnose(calibrate(touches(PAPER_ACTUAL, 1), moved))
    assert found.verdict != 'none'
    assert not any('disc number' in item.name for item in found.dependences)
    if move < 1e-3:
        assert 'object_position[disc_2]' in named(found)


def test_exact_data_are_not_unexplained():
    for robot, noise in ((PAPER_ACTUAL, None), (PAPER_ACTUAL.replace(g_ee=0.0, g1=0.0, g2=0.0), NOISE)):
        found = calibrate(touches(robot, noise=Noise(0.0, 0.0)), replace(CELL, noise=noise))
        assert diagnose(found).verdict == 'none'


OFF = PAPER_ACTUAL.l1 - CELL.nominal.l1


def trusting(noise: bool, **nominal: float):
    cell = replace(CELL, uncertainty=Uncertainty(nominal=nominal), noise=CELL.noise if noise else None)
    return calibrate(simulate(), cell)


def test_a_wrong_one_is_named_and_left_out():
    found = diagnose(trusting(False, l1=abs(OFF) / 20))
    assert found.verdict == 'unexplained'
    assert found.p_value < 1e-6
    assert [test.name for test in found.contradicted] == ['l1']
    assert '20 times its uncertainty) off' in found.advice
    free = trusting(False)
    assert found.refitted is not None
    assert found.refitted['l1'].value == pytest.approx(free['l1'].value, abs=3 * found.refitted['l1'].std)


def test_one_that_is_right_within_its_uncertainty_stays():
    found = diagnose(trusting(False, l1=abs(OFF)))
    assert found.verdict == 'none'
    assert not found.contradicted


def test_the_test_is_that_of_a_fit_without_the_value():
    u = 2 * abs(OFF)
    (test,) = contradictions(trusting(True, l1=u))
    free = trusting(True)
    expected = abs(free['l1'].value - CELL.nominal.l1) / np.hypot(u, free['l1'].std / np.sqrt(free.enlargement))
    assert test.deviation == pytest.approx(expected, rel=1e-3)
    assert abs(test.off) == pytest.approx(abs(free['l1'].value - CELL.nominal.l1), rel=1e-3)


def test_noise_stated_too_large_masks_no_effect():
    cell = replace(CELL, noise=Noise(3 * NOISE.joint, 3 * NOISE.force))
    found = diagnose(calibrate(simulate((effect('encoder_gain[joint1]'), (6e-5,)), seed=3), cell))
    check_explained(found, 'encoder_gain[joint1]', (6e-5,))
    assert found.extended.noise_source == 'estimated'


@pytest.mark.parametrize(
    ('verdict', 'none', 'expected'), [('none', 0.3, True), ('none', 0.7, False), ('ambiguous', 0.0, True)]
)
def test_touches_may_decide_where_something_is_rather_missing_than_nothing(verdict, none, expected):
    sets = (EffectSet((), none), EffectSet(('encoder_gain[joint1]',), 1 - none))
    assert Diagnosis(verdict, 0.1, probabilities=sets).is_undecided == expected
    assert not Diagnosis('explained', 0.1, probabilities=sets).is_undecided


def test_a_wave_of_usual_size_at_one_frequency_is_no_gross_effect_and_in_the_fit():
    wave = effect('transmission_error[joint1]')
    found = diagnose(calibrate(simulate((wave, (2e-5, 0.4, 7.0)), plan=MORE), CELL))
    assert found.verdict == 'none'
    assert 0.5 < found.inclusion[wave.label] < 0.95
    assert found.is_undecided
    assert [one.label for one in found.refitted.model.effects] == [wave.label]
    assert np.abs(deviations(found.refitted)).max() < 4


@pytest.fixture(scope='module')
def three_times() -> tuple[odds.Drawn, Calibration]:
    """All small errors at three times their sizes, one touch rejected: no fit that a search begins at explains it."""
    task = odds.Task('', 300317, None)
    drawn = odds.draw(task)
    return drawn, calibrate(drawn.touches(task), drawn.cell)


def test_no_verdict_is_based_on_a_fit_with_names_where_there_is_none_without(three_times, monkeypatch):
    fit = search.fit_mixed

    def only_with_names(c, known, named=None, **options):
        if named is not None and all(effect.grid_parameter for effect in named.effects):
            raise UnsupportedDataError('no fit')
        return fit(c, known, named, **options)

    monkeypatch.setattr(search, 'fit_mixed', only_with_names)
    assert diagnose(three_times[1]).verdict != 'none'


def test_where_no_fit_that_the_search_began_at_explains_the_touches_small_errors_do_where_it_ended(three_times):
    drawn, calibration = three_times
    found = diagnose(calibration)
    assert (found.verdict, found.has_small_errors) == ('none', True)
    fit = found.refitted
    assert fit.p_value > 1e-3
    size = {c: c.effect.size(c.parameter, drawn.cell.uncertainty.effects.arm) for c in fit.random.columns}
    amounts = dict(zip(fit.random.columns, fit.random.size * fit.random_values, strict=True))
    beyond = {c.effect.label for c, amount in amounts.items() if abs(amount) > size[c]}
    assert {item.effect.label for item in suspects(fit)} == beyond != set()
    values = {item.effect.label: item.values[0].value for item in suspects(fit) if len(item.effect.parameters) == 1}
    assert values == {c.effect.label: pytest.approx(a) for c, a in amounts.items() if c.effect.label in values}
