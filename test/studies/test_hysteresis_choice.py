"""What is decided on loops: friction where there is friction, nothing where there is none, and what gains by it."""

from __future__ import annotations

import numpy as np
import pytest
from studies.hysteresis import SLIP_NEGATIVE, SLIP_POSITIVE, TRUTH, slipping

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.hysteresis.analysis import check_tensions, hysteresis_study
from scara_kinetostatic.studies.hysteresis.dependence import anything_left, dependences
from scara_kinetostatic.studies.hysteresis.fit import fit
from scara_kinetostatic.studies.hysteresis.laws import (
    BACKLASH,
    FRICTION,
    REFINEMENTS,
    SLIP,
    SLIP_NO_GAP,
    SOFTENING,
    VISCOUS,
    played,
    refined,
)
from scara_kinetostatic.studies.hysteresis.model_selection import choose, effective_count, p_better

NOISE = 50.0
SLIPS = {'slip_positive': SLIP_POSITIVE, 'slip_negative': SLIP_NEGATIVE}


@pytest.fixture(scope='module')
def slip_choice():
    return choose(slipping(NOISE))


def test_slip_is_named_and_the_error_on_unseen_sweeps_falls_to_the_noise(slip_choice):
    assert slip_choice.verdict == 'explained'
    assert slip_choice.winner.law.name == 'slip'
    assert slip_choice.rivals == ()
    assert slip_choice.p_value < 0.01
    assert slip_choice.before.held_out_rms > 30 * NOISE
    assert slip_choice.winner.held_out_rms < 1.3 * NOISE
    assert slip_choice.after.law.name == 'slip'  # no refinement where there is none
    assert slip_choice.p_left > 0.01


def test_the_distance_since_the_reversal_betrays_it(slip_choice):
    share = {each.variable: each.share for each in slip_choice.structure}
    assert share['distance_sense'] > 0.5
    assert share['displacement'] < 0.1


def test_held_out_residuals_are_those_of_the_fit_that_has_not_seen_them(slip_choice):
    motion, winner = slipping(NOISE), slip_choice.winner
    earlier, later = winner.halves
    assert winner.held_out[motion.earlier] == pytest.approx(later.residual[motion.earlier])
    assert winner.held_out[~motion.earlier] == pytest.approx(earlier.residual[~motion.earlier])
    alone = fit(SLIP, motion, motion.earlier | ~motion.scored)
    assert winner.later_rms == pytest.approx(alone.rms(~motion.earlier))


def test_law_6_alone_raises_few_alarms():
    """1 % each: more than 4 of 50 would come by chance once in 5000 times."""
    alarms = 0
    for seed in range(50):
        motion = played(BACKLASH, TRUTH, NOISE, seed, correlation=0.9 * (seed % 2))
        residual = fit(BACKLASH, motion, np.ones(len(motion), dtype=bool)).residual
        alarms += anything_left(dependences(motion, residual)) < 0.01
    assert alarms <= 4


@pytest.mark.parametrize('seed', [0, 1])
def test_law_6_alone_needs_nothing(seed):
    choice = choose(played(BACKLASH, TRUTH, NOISE, seed))
    assert choice.verdict == 'none'
    assert choice.winner is None
    assert choice.after is choice.before
    assert not any(each.accepted for each in choice.candidates)


@pytest.mark.parametrize(
    ('law', 'more'),
    [
        (SOFTENING, SLIPS),
        (VISCOUS, {'damping': 2e4}),
        (FRICTION, {'friction': 1000.0}),
        (SLIP_NO_GAP, {**SLIPS, 'start': 0.0}),
    ],
)
def test_other_effects_are_called_by_their_own_names(law, more):
    values = {each.name: {**TRUTH, **more}[each.name] for each in law.parameters}
    choice = choose(played(law, values, NOISE, 3))
    assert choice.winner.law.name == law.name
    assert choice.rivals == ()
    assert choice.winner.held_out_rms < 1.1 * NOISE


def test_what_no_candidate_explains_is_said_to_be_unexplained():
    motion = played(BACKLASH, TRUTH, NOISE, 0)
    choice = choose(motion, candidates=(VISCOUS,))
    assert choice.verdict == 'none'
    bent = played(SOFTENING, {**TRUTH, **SLIPS}, NOISE, 0)
    choice = choose(bent, candidates=(VISCOUS,))
    assert choice.verdict == 'unexplained'
    assert choice.p_value < 0.01


def test_a_law_is_no_better_than_itself(slip_choice):
    motion = slipping(NOISE)
    assert p_better(slip_choice.winner, slip_choice.winner, motion) == 1.0
    assert p_better(slip_choice.winner, slip_choice.before, motion) < 1e-3
    assert p_better(slip_choice.before, slip_choice.winner, motion) > 0.99


def test_samples_that_hang_together_count_less():
    rng = np.random.default_rng(0)
    white = rng.standard_normal(4000)
    assert effective_count(white) > 2500
    smooth = np.convolve(white, np.ones(20), mode='valid')
    assert effective_count(smooth) == pytest.approx(len(smooth) / 20, rel=0.5)
    assert effective_count(np.zeros(10)) == 10


def table(motion, name):
    return DialGaugeReadings.of(motion.force, motion.displacement, time=motion.time, source=name)


def test_refinements_of_one_record_are_tried_on_another():
    rounding = next(each for each in REFINEMENTS if each.name == 'rounding')
    values = {**TRUTH, **SLIPS, 'start': 0.0, 'rounding': 6e-4}
    tables = [table(played(refined(SLIP, rounding), values, NOISE, seed), str(seed)) for seed in (0, 1)]
    study = hysteresis_study(tables)
    assert [record.choice.after.law.name for record in study.records] == ['slip+rounding'] * 2
    assert [(each.record, each.other) for each in study.borrowed] == [(0, 1), (1, 0)]
    for each in study.borrowed:
        assert each.score.held_out_rms < 1.1 * NOISE
        assert each.score.held_out_rms < 0.7 * study.records[each.record].choice.winner.held_out_rms


def test_a_tension_is_predicted_from_the_others_where_the_law_is_a_line():
    tensions = (10.0, 20.0, 30.0)
    tables = []
    for tension in tensions:
        slips = {'slip_positive': 400 * tension, 'slip_negative': 300 * tension, 'start': 0.0}
        tables.append(table(played(SLIP, {**TRUTH, **slips}, NOISE, int(tension)), f'{tension:g}'))
    study = hysteresis_study(tables, tensions)
    assert [each.tension for each in study.transfers] == list(tensions)
    for each in study.transfers:
        assert each.slips == pytest.approx((400 * each.tension, 300 * each.tension), rel=0.02)
        assert each.after < 4 * NOISE < 0.2 * each.before
        assert each.shown < 4 * NOISE
        assert each.own < 1.2 * NOISE


@pytest.mark.parametrize('tensions', [(1.0,), (1.0, 2.0), (1.0, 1.0, 2.0)])
def test_tensions_that_make_no_line_are_refused(tensions):
    with pytest.raises(ParameterError, match='tension'):
        check_tensions(3 if len(tensions) == 1 else len(tensions), tensions)


def test_a_table_that_is_no_loop_is_named():
    with pytest.raises(UnsupportedDataError, match=r'short\.csv: .*sweeps'):
        hysteresis_study(
            [DialGaugeReadings.of(np.arange(99.0), np.arange(99.0), time=np.arange(99.0), source='short.csv')]
        )
