"""Undetected effects as a source of uncertainty."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from diagnosis.simulated import check_explained
from scipy import stats

from benchmark import lone_flaws
from benchmark.diagnosis.cells import NOISE, seed_of
from benchmark.lone_flaws import flaw, small
from benchmark.population import DECLARED, Task, draw, judge
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.tip_uncertainty import tip_uncertainty
from scara_kinetostatic.diagnosis import mixed_model
from scara_kinetostatic.diagnosis.comparison import objects_left_out
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.mixed_model import HEAVY_TAILS, fit_mixed
from scara_kinetostatic.diagnosis.model_averaging import averaged, with_places
from scara_kinetostatic.diagnosis.weighing import weigh
from scara_kinetostatic.effects.registry import catalogue, find
from scara_kinetostatic.gaussian.variance_components import size_prior
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.cell import PAPER_DISCS, ArmClass, Cell, Disc, EffectSizes, Noise, SizeMode, Uncertainty
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES, P2, PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.monitoring.comparison import compare
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.results.document import as_document
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = Cell(
    PAPER_NOMINAL,
    PAPER_DISCS,
    noise=Noise(joint=1e-5, force=0.3),
    uncertainty=Uncertainty(effects=EffectSizes(SizeMode.ESTIMATED)),
)
TOUCHES = simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL, 12, preload=0.3), seed=4)


def declaring(cell: Cell, **sizes) -> Cell:
    return replace(cell, uncertainty=replace(cell.uncertainty, effects=EffectSizes(**sizes)))


def mixed(cell: Cell, touches=TOUCHES):
    return fit_mixed(calibrate(touches, cell), catalogue(cell)).fit


@pytest.mark.parametrize(
    ('label', 'stated', 'alias', 'part'),
    [('base_compliance', (2e-6, 0.0), 'common', 'p_ee'), ('anisotropic_gripper', (2e-6,), 'excess', 'p2')],
)
def test_what_of_a_named_effect_is_a_part_of_the_arm_has_the_size_of_the_effect(label, stated, alias, part):
    effect, size = find(CELL, label), 2e-6
    true = ExtendedModel(PAPER_ACTUAL, (effect,), ((*stated, size),))
    touches = simulate_touches(CELL, true, default_plan(CELL, 12, preload=0.3), seed=4)
    alone = calibrate(touches, CELL, [effect])
    assert (alone.effects[label][alias].value, alone.effects[label][alias].status) == (0.0, 'fixed')
    fit = fit_mixed(calibrate(touches, CELL), catalogue(CELL), alone.model).fit
    assert 0.5 * size < fit.effects[label][alias].std < 2 * size
    assert abs(fit[part].value - getattr(PAPER_ACTUAL, part)) < 3 * fit.std_of(part)
    assert fit.std_of(part) > 5 * alone.std_of(part)
    both = [fit.model.names.index(name) for name in (part, f'{label}.{alias}')]
    (square, mixed), (_, other) = fit.covariance[np.ix_(both, both)]
    assert abs(mixed) > 0.9 * np.sqrt(square * other)
    force = np.tile([10.0, -20.0], (len(touches), 1))
    one, two = (Predictor(each.arm).locate(touches.joints, force).position for each in (fit, alone))
    np.testing.assert_allclose(one, two, rtol=0, atol=2e-5)


def test_without_effects_everything_is_as_the_fit_has_it(capfd):
    none = declaring(CELL, sizes=SizeMode.NONE)
    fit = calibrate(TOUCHES, none)
    found = mixed(none)
    np.testing.assert_allclose(found.model.as_array(), fit.model.as_array(), rtol=0, atol=1e-4 * fit.std.max())
    np.testing.assert_allclose(found.covariance, fit.covariance, rtol=1e-3, atol=1e-3 * np.abs(fit.covariance).min())
    assert diagnose(fit).refitted is None
    assert capfd.readouterr() == ('', '')  # LAPACK complains of matrices without rows


def test_a_robot_as_described_takes_two_linearisations(monkeypatch):
    solved = []
    solve = mixed_model._solve
    monkeypatch.setattr(mixed_model, '_solve', lambda *given: solved.append(given) or solve(*given))
    fit_mixed(calibrate(TOUCHES, CELL), catalogue(CELL))
    assert len(solved) <= 3


def test_small_effects_together_do_not_imitate_friction():
    """At the last linearisation soft discs and a bent sensor, far beyond their sizes, explain it as well."""
    places = ((0.242, -0.116, 0.056), (-0.307, -0.051, 0.053), (0.158, 0.399, 0.106))
    discs = tuple(Disc(f'disc_{k + 1}', *place, 3e-6, 3e-6) for k, place in enumerate(places))
    limits = ((-2.71, 2.71), (-2.79, 2.79))
    cell = replace(CELL, nominal=PAPER_NOMINAL.replace(l1=0.3705, l2=0.2519), discs=discs, limits=limits)
    zeros = {'x0': -0.0048, 'theta1': 0.00156, 'theta2': 0.00223, 'l1': 0.371, 'l2': 0.25184}
    soft = {'p_ee': 7e-6, 'p1': 7.6e-6, 'p2': 3.3e-5, 'g_ee': 1.7e-4, 'g1': 5.7e-5, 'g2': 2.4e-4}
    arm = PAPER_NOMINAL.replace(**zeros, **soft)
    true = ExtendedModel(arm, (find(cell, 'contact_friction'),), ((0.03,),))
    touches = simulate_touches(cell, true, default_plan(cell, 18), seed=1)
    check_explained(diagnose(calibrate(touches, cell)), 'contact_friction', (0.03,), arm)


def test_the_contributions_add_up():
    fit, found = calibrate(TOUCHES, CELL), mixed(CELL)
    total = np.sum([part.covariance for part in found.contributions], axis=0)
    assert np.allclose(total, found.covariance, rtol=1e-9, atol=0)
    assert np.all(found.std > fit.std)
    assert {part.label for part in found.contributions} >= {'noise', 'undetected[transmission_error]'}


def test_a_robot_with_small_errors_is_not_moved_by_the_names_of_them():
    """Named effects that were free moved the base of such robots by millimetres."""
    setup, robot, touches = draw(Task('paper', 'all', 1.0, False, 'estimated', 901))
    plain = calibrate(touches, setup.cell)
    found = diagnose(plain)
    judged = judge(found.extended or found.refitted, robot, 0)
    assert judged['error'] < 80e-6
    assert judged['coverage'] > 0.75 > judge(plain, robot, 0)['coverage']
    assert judged['ratio'] < 4


def test_a_named_effect_is_hardly_shrunk():
    law, values = find(CELL, 'object_position[disc_2]'), (9e-5, -6e-5)
    robot = ExtendedModel(PAPER_ACTUAL, (law,), (values,))
    found = diagnose(calibrate(simulate_touches(CELL, robot, default_plan(CELL, 18, preload=0.3), CELL.noise, 3), CELL))
    check_explained(found, law.label, values)
    assert all(value.std < 2e-5 for value in found.found[0].values)  # the places of the others are assumed


def test_an_alias_has_its_declared_size_only():
    """Link 2 that bends is another p2: a third of its compliance, whatever the touches say."""
    size = 3e-6
    found = mixed(declaring(CELL, sizes=SizeMode.NONE, stated={'link_bending[link2]': size}))
    (part,) = (part for part in found.contributions if part.label.startswith('undetected'))
    assert part.label == 'undetected[link_bending]'
    assert np.isclose(part.covariance[P2, P2] ** 0.5, size / 3, rtol=1e-3)
    others = [k for k in range(len(NAMES)) if k != P2]
    assert np.all(np.diag(part.covariance)[others] ** 0.5 < 1e-2 * found.std[others])
    tip = [tip_uncertainty(c).median for c in (found, calibrate(TOUCHES, CELL))]
    assert np.isclose(*tip, rtol=1e-3)  # and the tip is where it is


def test_typical_sizes_are_those_of_the_class_of_the_arm():
    effect = find(CELL, 'transmission_error[joint1]')
    assert effect.size(0, ArmClass.DESKTOP) == 5 * effect.size()
    stds = [mixed(declaring(CELL, sizes=SizeMode.TYPICAL, arm=arm)).std for arm in ArmClass]
    assert np.all(stds[0] < stds[1])
    assert np.all(stds[1] < stds[2])


def test_the_prior_of_the_sizes_is_half_t_in_the_logarithm():
    """Against SciPy's, and its derivatives against finite differences."""
    rng = np.random.default_rng(3)
    logs, freedoms = rng.normal(size=4), np.array([1.0, 3.0, 3.0, 1.0])
    off = np.append(logs[:-1] - logs[-1], logs[-1])
    density = stats.t.logpdf(np.exp(off), freedoms) + off  # of the logarithm
    at_one = stats.t.logpdf(1.0, freedoms)
    value, slope, curve = size_prior(logs, freedoms)
    assert value - size_prior(np.zeros(4), freedoms)[0] == pytest.approx(-2 * (density - at_one).sum())
    for k in range(4):
        step = 1e-4 * np.eye(4)[k] if k < 3 else np.full(4, 1e-4)  # τ_0 alone
        higher, lower = (size_prior(logs + sign * step, freedoms) for sign in (1, -1))
        assert slope[k] == pytest.approx((higher[0] - lower[0]) / 2e-4, rel=1e-6)
        assert curve[k] == pytest.approx((higher[1][k] - lower[1][k]) / 2e-4, rel=1e-6)


@pytest.mark.parametrize(('factor', 'limits'), [(0.0, (0.0, 0.8)), (3.0, (1.2, 10.0))])
def test_the_sizes_come_from_the_touches(factor, limits):
    """Of a robot without errors they are smaller than typical, of one with large ones larger."""
    effects = tuple(effect for effect in catalogue(CELL) if not (effect.is_stepwise or effect.grid_parameter))
    signs = iter(np.resize([1, -1, -1], 200).tolist())
    values = tuple(tuple(factor * next(signs) * e.size(k) for k in range(len(e.start))) for e in effects)
    robot = ExtendedModel(PAPER_ACTUAL, effects, values)
    touches = simulate_touches(CELL, robot, default_plan(CELL, 12, preload=0.3), seed=4)
    model = fit_mixed(calibrate(touches, CELL), catalogue(CELL))
    assert limits[0] < np.exp(model.solved.logs[-1]) < limits[1]


def test_other_tails_begin_where_the_fit_is():
    effect = find(CELL, 'encoder_gain[joint1]')
    robot = ExtendedModel(PAPER_ACTUAL, (effect,), ((1e-4,),))
    cell = replace(CELL, noise=None)
    plain = calibrate(simulate_touches(cell, robot, default_plan(cell, 60, preload=0.3), CELL.noise, seed=2), cell)
    heavy = fit_mixed(plain, catalogue(cell), robot, freedoms=HEAVY_TAILS)
    anew, going_on = (fit_mixed(plain, catalogue(cell), heavy.fit.model, begin=begin).fit for begin in (None, heavy))
    assert going_on.used.all()
    assert going_on.noise.joint_rms == pytest.approx(anew.noise.joint_rms, rel=0.02)
    off = np.abs(going_on.parameters.as_array() - anew.parameters.as_array()) / anew.std
    assert off.max() < 0.2


@pytest.fixture(scope='module')
def hardly_shown():
    """A small arm with two discs, its joints coupled by ten typical sizes: named it is not."""
    task = lone_flaws.Task('joint_coupling[joint1]', 10.0, 100)
    touches = simulate_touches(small().cell, flaw(task).robot(small().truth), small().plan, NOISE, seed_of(*task))
    return calibrate(touches, replace(small().cell, noise=None))


def test_a_flaw_that_the_touches_hardly_show_counts(hardly_shown):
    found = diagnose(hardly_shown)
    alone = fit_mixed(hardly_shown, catalogue(hardly_shown.cell)).fit
    truth = small().truth.as_array()
    with_it, without = (
        np.nanmax(np.abs(fit.parameters.as_array() - truth) / fit.std) for fit in (found.refitted, alone)
    )
    assert found.verdict == 'none'
    assert without > 10
    assert with_it < 5
    part = {item.label: item.covariance for item in found.refitted.contributions}['undetected[large_effect]']
    std = np.sqrt(np.diag(found.refitted.covariance))
    assert np.linalg.eigvalsh(part / np.outer(std, std)).min() > -1e-9


def test_what_is_declared_is_no_undetected_effect():
    discs = tuple(disc._replace(center_std=DECLARED) for disc in PAPER_DISCS)
    labels = {part.label for part in mixed(replace(CELL, discs=discs)).contributions}
    assert 'undetected[object_position]' not in labels
    assert 'undetected[object_radius]' in labels


@pytest.fixture(scope='module')
def outcome():
    return calibrate_touches(TOUCHES, CELL)


def test_the_file_holds_the_same_uncertainty(outcome):
    document = json.loads(json.dumps(as_document(outcome)))
    record = CalibrationRecord.of_document(document, 'calibration')
    joints, force = outcome.final.touches.joints[:20], outcome.final.force[:20]
    one, other = (Predictor(arm).locate(joints, force).covariance for arm in (outcome.arm, record.arm))
    assert np.allclose(one, other, rtol=1e-9)
    assert record.arm.effects == ()
    fit = Predictor(calibrate(TOUCHES, CELL).arm).locate(joints, force).covariance
    assert np.all(np.trace(one, axis1=1, axis2=2) > np.trace(fit, axis1=1, axis2=2))


def test_a_comparison_is_of_the_same_robot(outcome):
    """What undetected effects do is the same in both calibrations: it hides no change."""
    again = calibrate_touches(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL, 12, preload=0.3), seed=5), CELL)
    records = [CalibrationRecord.of_outcome(each) for each in (outcome, again)]
    change = compare(*records)
    assert [part.name for part in change.parameters] == list(NAMES)
    std = np.hypot(calibrate(TOUCHES, CELL).std, again.final.std_noise)
    assert np.allclose([part.std for part in change.parameters], std, rtol=0.05)


def test_a_file_of_before_the_alias_of_a_named_effect_is_compared():
    true = ExtendedModel(PAPER_ACTUAL, (find(CELL, 'base_compliance'),), ((3e-6, -2e-6, 0.0),))
    again = calibrate_touches(simulate_touches(CELL, true, default_plan(CELL, 12, preload=0.3), seed=5), CELL)
    new = CalibrationRecord.of_outcome(again)
    document, place = as_document(again), again.arm.model.names.index('base_compliance.common')
    model, joint = document['model'], document['covariance_with_cell']
    for entry, matrix in ((model, 'covariance'), (joint, 'matrix')):
        lists = entry['names'], entry['values'], *entry[matrix], entry[matrix]
        for rows in (*lists, *(entry['undetermined'] if entry is model else ())):
            del rows[place]
    del joint['undetected']['rows'][place], joint['undetected']['matrix'][place]
    old = CalibrationRecord.of_document(document, 'old')
    assert old.names == new.names
    assert old.undetected.rows == new.undetected.rows
    assert not old.covariance[place].any() and new.covariance[place, place] > 1e-13
    assert compare(old, new).tip < 1e-9


def test_an_object_left_out_checks_what_is_stated():
    found = objects_left_out(mixed(CELL))
    assert 0.6 < found.error / found.stated < 1.4
    first, *others = PAPER_DISCS
    displaced = replace(CELL, discs=(first._replace(x=first.x + 3e-4), *others))
    wrong = objects_left_out(calibrate(TOUCHES, replace(displaced, noise=None)))
    assert wrong.error > 2 * wrong.stated


def test_places_on_a_grid_count_by_their_scatter():
    """One place adds nothing; two a step apart, alike, its square, and nothing to what is fixed."""
    wave = find(CELL, 'transmission_error[joint2]')
    touches = simulate_touches(CELL, ExtendedModel(PAPER_ACTUAL, (wave,), ((2e-4, 0.5, 2.7),)), default_plan(CELL, 12))
    held = calibrate(touches, CELL, fixed={'l1': PAPER_ACTUAL.l1})
    fit = fit_mixed(held, (), ExtendedModel(held.parameters, (wave,), ((2e-4, 0.5, 2.7),))).fit
    cycles, x0 = fit.model.names.index('transmission_error[joint2].cycles'), 0
    change = np.zeros((2, len(fit.model.names)))
    assert with_places(fit, wave, change[:1], np.ones(1)).covariance == pytest.approx(fit.covariance, abs=1e-18)
    change[1, [x0, cycles]] = 1e-3, 0.4
    more = with_places(fit, wave, change, np.array([0.5, 0.5])).covariance - fit.covariance
    assert more[x0, x0] == pytest.approx(0.5e-6, rel=0.01)
    assert more[x0, cycles] == pytest.approx(0.5 * 0.4e-3, rel=0.01)
    assert not more[NAMES.index('l1')].any()


def test_with_rivals_the_estimate_is_their_mean_and_the_touches_still_agree():
    cell = replace(CELL, uncertainty=replace(CELL.uncertainty, force_rotation=2e-3))
    displaced = [find(cell, f'object_position[{name}]') for name in ('disc_1', 'disc_2')]
    robot = ExtendedModel(PAPER_ACTUAL, tuple(displaced[:1]), ((5e-5, -3e-5),))
    c = calibrate(simulate_touches(cell, robot, default_plan(cell, 12, preload=0.3), cell.noise, 4), cell)
    model = fit_mixed(c, catalogue(cell), ExtendedModel(c.parameters, tuple(displaced), ((0.0, 0.0),) * 2))
    union, (every, undetected) = model.fit, weigh(model, catalogue(cell)).mixture()
    assert ('object_position[disc_1]',) in {item.effects for item in every}
    assert len(every) > 1
    weight = np.array([item.probability for item in every])
    assert weight.sum() == pytest.approx(1.0)
    found = averaged(union, every, undetected)
    values = np.array([item.change for item in every])[:, :12]
    moved = found.parameters.as_array() - union.parameters.as_array()
    np.testing.assert_allclose(moved, weight @ values, rtol=0, atol=1e-12)
    assert np.ptp(values / union.std, axis=0).max() > 1, 'they do not agree'
    scatter = np.sqrt(weight @ (values - moved) ** 2)
    assert (found.std >= scatter * (1 - 1e-9)).all()
    assert found.force_error < 1.15 * union.force_error
    far = averaged(union, [item._replace(change=20 * item.change) for item in every], undetected)
    assert far.enlargement == union.enlargement, 'what the mean does not explain is no noise'
    assert averaged(union, (), undetected) is union


def test_the_values_by_an_error_that_is_declared_are_stated():
    """disc_1 is ten times as far off as declared, and no effect of the fit: the declared error is."""
    discs = tuple(disc._replace(center_std=5e-6) for disc in CELL.discs)
    cell, place = replace(CELL, discs=discs), find(CELL, 'object_position[disc_1]')
    robot = ExtendedModel(PAPER_ACTUAL, (place,), ((5e-5, -3e-5),))
    c = calibrate(simulate_touches(cell, robot, default_plan(cell, 12, preload=0.3), cell.noise, 4), cell)
    fit = (weighed := weigh(fit_mixed(c, catalogue(cell)), catalogue(cell))).model.fit
    by_set = {item.effects: item for item in weighed.mixture().alternatives}
    one = by_set['object_position[disc_1]',]
    at = len(fit.model.names) + fit.observe().declared.places[place.label]
    errors = fit.errors[at - len(fit.model.names)] + one.change[at]
    np.testing.assert_allclose(5e-6 * errors, (5e-5, -3e-5), atol=4 * 5e-6 * np.sqrt(one.covariance[at, at].max()))
    stated = sum(p for labels, p in weighed.odds.probabilities.items() if 'unnamed' not in labels)
    assert one.probability == pytest.approx(weighed.odds.probabilities[frozenset([place.label])] / stated, abs=0.01)


def test_a_disc_with_so_few_touches_that_a_shift_has_one_moment_is_weighed():
    c = calibrate(simulate_touches(CELL, ExtendedModel(PAPER_ACTUAL), default_plan(CELL, 3), CELL.noise, 1), CELL)
    weighed = weigh(fit_mixed(c, catalogue(CELL)), catalogue(CELL))
    moments = [item.tried for item in weighed.candidates.candidates if item.effect.label == 'shift[disc_1]']
    assert moments == [1]
    assert weighed.odds.none > 0.5


def test_a_shift_that_has_one_moment_is_weighed_where_it_is_named():
    shift = find(CELL, 'shift[disc_1]')
    touches = simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL, 3), CELL.noise, 1)
    c = calibrate(touches, CELL)
    moment = float(np.median(touches.order[touches.disc == 0])) + 0.5
    weighed = weigh(
        fit_mixed(c, catalogue(CELL), ExtendedModel(c.parameters, (shift,), ((1e-4, 0.0, moment),))), catalogue(CELL)
    )
    (candidate,) = (item for item in weighed.candidates.candidates if item.effect == shift)
    assert len(candidate.trial.columns) == 2
