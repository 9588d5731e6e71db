"""The closed forms of the diagnosis against explicit fits."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from diagnosis.simulated import CELL, effect, examined, simulate
from scipy import stats

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.diagnosis.candidates import gather
from scara_kinetostatic.diagnosis.comparison import _pool, discriminating_touches
from scara_kinetostatic.diagnosis.linear_problem import f_test, pose_problem
from scara_kinetostatic.diagnosis.mixed_model import fit_mixed
from scara_kinetostatic.diagnosis.model_selection import score_subsets, significance
from scara_kinetostatic.diagnosis.search import start_from
from scara_kinetostatic.effects.registry import catalogue
from scara_kinetostatic.model.kinematics import jacobian, quarter_turn
from scara_kinetostatic.model.kinetostatics import drag, press_aside

SEVERAL = ('encoder_gain[joint1]', 'base_compliance', 'transmission_error[joint2]', 'object_radius[disc_3]')


def several():
    return [effect(label) for label in SEVERAL]


def test_sums_of_squares_of_sets_are_those_of_least_squares():
    problem = pose_problem(calibrate(simulate(seed=2), CELL))
    candidate_set = gather(problem, several())
    scored_subsets = score_subsets(problem, candidate_set)
    sets = [tuple(map(id, subset.members)) for subset in scored_subsets.subsets]
    assert len(set(sets)) == len(sets)
    for subset in scored_subsets.subsets[:40]:
        columns = [problem.columns(candidate.trial) for candidate in subset.members]
        together = np.concatenate([problem.base, *columns], axis=1)
        together = together / np.linalg.norm(together, axis=0)
        fitted, *_ = np.linalg.lstsq(together, problem.left, rcond=1e-6)
        rest = float(np.sum((problem.left - together @ fitted) ** 2))
        assert np.isclose(subset.rest, rest, rtol=1e-3)


def test_scores_penalise_parameters_and_the_search():
    problem = pose_problem(calibrate(simulate(seed=3), CELL))
    candidate_set = gather(problem, several())
    scored_subsets = score_subsets(problem, candidate_set)
    penalty = {subset.labels: subset.penalty for subset in scored_subsets.subsets if len(subset.members) == 1}
    n, count = len(problem.left) / 2, len(SEVERAL)
    assert np.isclose(penalty['encoder_gain[joint1]',], np.log(n) + 2 * np.log(count))
    assert np.isclose(penalty['base_compliance',], 2 * np.log(n) + 2 * np.log(count))
    assert penalty['transmission_error[joint2]',] > 3 * np.log(n) + 2 * np.log(200)
    assert scored_subsets.subsets[0].members == ()  # clean data: nothing pays


def test_a_fitted_effect_that_adds_nothing_to_the_base_model_is_not_significant():
    problem = pose_problem(calibrate(simulate(), CELL))
    candidate = gather(problem, catalogue(CELL)).candidates[0]
    assert significance(problem, candidate)[0] < 1
    assert significance(problem, candidate._replace(unit=candidate.unit[:, :0])) == (1.0, 0.0)


def test_discriminating_touches_are_those_where_rivals_differ():
    fit, _ = examined('encoder_gain[joint1]', (6e-5,))
    problem = pose_problem(fit)
    candidate_set = gather(problem, [effect('encoder_gain[joint1]'), effect('object_position[disc_1]')])
    starts = [start_from(problem, [candidate]) for candidate in candidate_set.candidates]
    rivals = [fit_mixed(fit, catalogue(CELL), start).fit for start in starts]
    touches = discriminating_touches(fit, rivals)
    assert 1 <= len(touches) <= 4
    assert all(touch.in_std > 2 and touch.difference > 0 for touch in touches)
    assert all(a.in_std >= b.in_std for a, b in pairwise(touches))
    assert not discriminating_touches(fit, [rivals[0], rivals[0]])
    limited = replace(fit, cell=replace(fit.cell, limits=((-0.5, 2.0), (0.0, 2.2))))
    pool, *_ = _pool(limited)
    assert limited.cell.can_take(pool.joints).all()
    assert 0 < len(pool) < 0.5 * len(_pool(fit)[0])
    assert all(touch.posture == 1 for touch in discriminating_touches(limited, rivals))


@pytest.mark.parametrize('is_dragged', [False, True])
def test_touches_to_discriminate_by_are_pressed_as_those_made(is_dragged):
    fit = calibrate(simulate(), CELL)
    if is_dragged:
        t, on_object = fit.touches, fit.force / np.hypot(*fit.force.T)[:, None]
        press = press_aside(fit.parameters, t.joints, on_object, drag(np.arctan2(*-on_object.T[::-1]), t.posture))
        fit = calibrate(t.replace(press=press), CELL)
    pool, *_ = _pool(fit)
    moved = (jacobian(fit.parameters, pool.joints) @ pool.press[..., None])[..., 0]
    towards = (moved * pool.force).sum(axis=1)
    aside = np.abs((moved * quarter_turn(pool.force)).sum(axis=1) / towards)
    assert (np.median(aside) > 0.3) == is_dragged
    unloaded = pool.history[:, 0, 2:].any(axis=1)
    assert (towards[unloaded] < 0).all()
    assert (towards[~unloaded] > 0).all()


def test_everything_in_the_catalogue_is_ranked_once():
    _, found = examined('encoder_gain[joint1]', (6e-5,))
    labels = [item.effect.label for item in found.ranking if item.effect.name != 'unnamed']
    assert sorted(labels) == sorted(item.label for item in catalogue(CELL))
    best = found.ranking[0]
    assert best.effect.label == 'encoder_gain[joint1]'
    assert best.role == 'found'


def test_f_test_is_that_of_the_textbook():
    """Against a regression by hand: two columns, beside three that are in the fit already."""
    rng = np.random.default_rng(4)
    design, values = rng.normal(size=(40, 5)), rng.normal(size=40)
    values += 0.4 * design[:, 4]
    base, _ = np.linalg.qr(design[:, :3])
    residual = values - base @ (base.T @ values)
    more, _ = np.linalg.qr(design[:, 3:] - base @ (base.T @ design[:, 3:]))
    before = residual @ residual
    after = np.linalg.lstsq(design, values, rcond=None)[1][0]
    expected = stats.f.sf((before - after) / 2 / (after / 35), 2, 35)
    assert f_test(more, residual, 37) == pytest.approx((expected, 1 - after / before))
    assert f_test(more[:, :0], residual, 37) is None
    assert f_test(more, residual, 2) is None
    assert f_test(more, 0 * residual, 37) is None
    expected = stats.f.sf((before - after) / 2 / 4.0, 2, 35)  # where the noise is known to be larger
    assert f_test(more, residual, 37, 4.0) == pytest.approx((expected, 1 - after / before))
