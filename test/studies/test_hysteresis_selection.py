"""What is decided on loops: friction where there is friction, nothing where there is none, and what gains by it."""

from __future__ import annotations

import numpy as np
import pytest
from studies.hysteresis import SLIP_NEGATIVE, SLIP_POSITIVE, TRUTH, slipping

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.studies.dial_gauge.readings import DialGaugeReadings
from scara_kinetostatic.studies.hysteresis.analysis import analyse_hysteresis, check_tensions
from scara_kinetostatic.studies.hysteresis.fit import fit
from scara_kinetostatic.studies.hysteresis.laws import (
    BACKLASH,
    FRICTION,
    SLIP,
    SLIP_NO_GAP,
    SOFTENING,
    VISCOUS,
    simulate_record,
)
from scara_kinetostatic.studies.hysteresis.model_selection import (
    dependences,
    effective_count,
    p_better,
    p_independent,
    select_model,
)

NOISE = 50.0
_SLIPS = {'slip_positive': SLIP_POSITIVE, 'slip_negative': SLIP_NEGATIVE}


@pytest.fixture(scope='module')
def slip_selection():
    return select_model(slipping(NOISE))


def test_slip_is_named_and_the_error_on_unseen_sweeps_falls_to_the_noise(slip_selection):
    assert slip_selection.verdict == 'explained'
    assert slip_selection.selected.law.name == 'slip'
    assert slip_selection.rivals == ()
    assert slip_selection.p_value < 0.01
    assert slip_selection.before.held_out_rms > 30 * NOISE
    assert slip_selection.selected.held_out_rms < 1.3 * NOISE
    assert slip_selection.final is slip_selection.selected
    assert slip_selection.p_after > 0.01


def test_the_distance_since_the_reversal_betrays_it(slip_selection):
    share = {each.variable: each.share for each in slip_selection.dependence_before}
    assert share['distance_sense'] > 0.5
    assert share['displacement'] < 0.1


def test_held_out_residuals_are_those_of_the_fit_that_has_not_seen_them(slip_selection):
    motion, selected = slipping(NOISE), slip_selection.selected
    earlier, later = selected.halves
    assert selected.held_out[motion.earlier] == pytest.approx(later.residual[motion.earlier])
    assert selected.held_out[~motion.earlier] == pytest.approx(earlier.residual[~motion.earlier])
    alone = fit(SLIP, motion, motion.earlier | ~motion.scored)
    assert selected.later_rms == pytest.approx(alone.rms(~motion.earlier))


def test_law_6_alone_raises_few_alarms():
    """1 % each: more than 2 of 20 would come by chance once in 1000 times."""
    alarms = 0
    for seed in range(20):
        motion = simulate_record(BACKLASH, TRUTH, NOISE, seed, correlation=0.9 * (seed % 2))
        residual = fit(BACKLASH, motion, np.ones(len(motion), dtype=bool)).residual
        alarms += p_independent(dependences(motion, residual)) < 0.01
    assert alarms <= 2


@pytest.mark.parametrize('seed', [0, 1])
def test_law_6_alone_needs_nothing(seed):
    selection = select_model(simulate_record(BACKLASH, TRUTH, NOISE, seed))
    assert selection.verdict == 'none'
    assert selection.selected is None
    assert selection.final is selection.before
    assert not any(each.accepted for each in selection.candidates)


@pytest.mark.parametrize(
    ('law', 'more'),
    [
        (SOFTENING, _SLIPS),
        (VISCOUS, {'damping': 2e4}),
        (FRICTION, {'friction': 1000.0}),
        (SLIP_NO_GAP, {**_SLIPS, 'start': 0.0}),
    ],
)
def test_other_effects_are_called_by_their_own_names(law, more):
    values = {each.name: {**TRUTH, **more}[each.name] for each in law.parameters}
    selection = select_model(simulate_record(law, values, NOISE, 3))
    assert selection.selected.law.name == law.name
    assert selection.rivals == ()
    assert selection.selected.held_out_rms < 1.1 * NOISE


def test_what_no_candidate_explains_is_said_to_be_unexplained():
    motion = simulate_record(BACKLASH, TRUTH, NOISE, 0)
    selection = select_model(motion, candidates=(VISCOUS,))
    assert selection.verdict == 'none'
    softened = simulate_record(SOFTENING, {**TRUTH, **_SLIPS}, NOISE, 0)
    selection = select_model(softened, candidates=(VISCOUS,))
    assert selection.verdict == 'unexplained'
    assert selection.p_value < 0.01


def test_a_law_is_no_better_than_itself(slip_selection):
    motion = slipping(NOISE)
    assert p_better(slip_selection.selected, slip_selection.selected, motion) == 1.0
    assert p_better(slip_selection.selected, slip_selection.before, motion) < 1e-3
    assert p_better(slip_selection.before, slip_selection.selected, motion) > 0.99


def test_samples_that_hang_together_count_less():
    rng = np.random.default_rng(0)
    white = rng.standard_normal(4000)
    assert effective_count(white) > 2500
    smooth = np.convolve(white, np.ones(20), mode='valid')
    assert effective_count(smooth) == pytest.approx(len(smooth) / 20, rel=0.5)
    assert effective_count(np.zeros(10)) == 10


def table(motion, name):
    return DialGaugeReadings.of(motion.force, motion.displacement, time=motion.time, source=name)


def test_a_tension_is_predicted_from_the_others_where_the_law_is_a_line():
    tensions = (10.0, 20.0, 30.0)
    tables = []
    for tension in tensions:
        slips = {'slip_positive': 400 * tension, 'slip_negative': 300 * tension, 'start': 0.0}
        tables.append(table(simulate_record(SLIP, {**TRUTH, **slips}, NOISE, int(tension)), f'{tension:g}'))
    study = analyse_hysteresis(tables, tensions)
    assert [each.tension for each in study.leave_one_out] == list(tensions)
    for each in study.leave_one_out:
        assert each.slips == pytest.approx((400 * each.tension, 300 * each.tension), rel=0.02)
        assert each.by_tension < 4 * NOISE < 0.2 * each.backlash
        assert each.identified < 4 * NOISE
        assert each.own < 1.2 * NOISE


@pytest.mark.parametrize('tensions', [(1.0,), (1.0, 2.0), (1.0, 1.0, 2.0)])
def test_tensions_that_make_no_line_are_refused(tensions):
    with pytest.raises(ParameterError, match='tension'):
        check_tensions(3 if len(tensions) == 1 else len(tensions), tensions)


def test_a_table_that_is_no_loop_is_named():
    with pytest.raises(UnsupportedDataError, match=r'short\.csv: .*sweeps'):
        analyse_hysteresis(
            [DialGaugeReadings.of(np.arange(99.0), np.arange(99.0), time=np.arange(99.0), source='short.csv')]
        )
