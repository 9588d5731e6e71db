"""Gravity in the plane of the arm: torques, dead bands, derivatives, recovery; without it nothing changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic import pipeline
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.calibration_file import load_predictor
from scara_kinetostatic.files.cell_file import dump_cell, parse_cell
from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.model.cell import PAPER_DISCS, Uncertainty
from scara_kinetostatic.model.contact_force import contact, free_state
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import MOMENTS
from scara_kinetostatic.model.touch_derivatives import contact_derivatives
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

GRAVITY = (1.2, -9.7)
BESIDE = {'phi1': 0.15, 'phi2': -0.3}
TRUTH = sk.PAPER_ACTUAL.replace(s1=1.6, s2=0.5, gravity=GRAVITY, **BESIDE)
CELL = sk.Cell(
    sk.PAPER_NOMINAL.replace(s1=1.3, s2=0.4, gravity=GRAVITY, **BESIDE),
    PAPER_DISCS,
    noise=sk.Noise(joint=1e-5, force=0.3),
)
RADIUS = 0.08


def poses(n=300, seed=4):
    random = np.random.default_rng(seed)
    angle = random.uniform(-np.pi, np.pi, n)
    unit = np.array([np.cos(angle), np.sin(angle)]).T
    force = random.uniform(8.0, 60.0, n)[:, None] * unit
    tip = np.array([random.uniform(-0.3, 0.3, n), random.uniform(0.2, 0.5, n)]).T
    joints, torques = inverse_kinetostatics(TRUTH, tip, force, 1)
    return tip, force, joints, torques, tip + RADIUS * unit


def test_an_unloaded_arm_hangs_in_its_gaps():
    joints = np.array([[0.2, 0.3], [2.9, -0.3]])
    state = free_state(TRUTH, joints, np.array([[0.3, 0.3]] * 2))
    _, torques = direct_kinetostatics(TRUTH, joints, np.zeros((2, 2)))
    sag = joints - np.array(state[:2]).T
    expected = np.array([TRUTH.p1, TRUTH.p2]) * torques + np.array([TRUTH.g1, TRUTH.g2]) * np.sign(torques)
    np.testing.assert_allclose(sag, expected, rtol=1e-9)
    assert (torques[0] > 0).all() and torques[1, 0] < 0
    free = contact(TRUTH, joints, np.array([[5.0, 5.0]] * 2), RADIUS)
    assert not free.force.any()
    np.testing.assert_allclose(joints - free.links, expected, rtol=1e-9)


def test_direct_inverse_and_contact_agree():
    tip, force, joints, torques, centers = poses()
    back, same = direct_kinetostatics(TRUTH, joints, force)
    np.testing.assert_allclose(back, tip, atol=1e-12)
    np.testing.assert_allclose(same, torques, atol=1e-9)
    found = contact(TRUTH, joints, centers, RADIUS, warm_start=force)
    assert found.solved.all()
    np.testing.assert_allclose(found.force, force, atol=1e-7)


@pytest.mark.parametrize('name', TRUTH.names)
def test_derivatives_of_the_force(name):
    _, force, joints, _, centers = poses()
    found = contact(TRUTH, joints, centers, RADIUS, warm_start=force)
    analytic = contact_derivatives(TRUTH, found).parameters[:, :, TRUTH.names.index(name)]
    step = 1e-4 if name in MOMENTS else 1e-8
    up, down = (
        contact(TRUTH.replace(**{name: getattr(TRUTH, name) + sign * step}), joints, centers, RADIUS, warm_start=force)
        for sign in (1, -1)
    )
    numeric = (up.force - down.force) / (2 * step)
    same = (up.state.mode1 == down.state.mode1) & (up.state.mode2 == down.state.mode2)
    assert same.mean() > 0.95
    np.testing.assert_allclose(analytic[same], numeric[same], atol=1e-5 * np.abs(analytic).max())


def test_a_joint_floats_where_its_torque_vanishes():
    """Near a sign change of C the joint rests in its gap: C = 0 there, and the place inside it is free."""
    p = TRUTH.replace(g1=4e-3, g2=4e-3)
    random = np.random.default_rng(8)
    joints = np.array([random.uniform(0.2, 2.5, 4000), random.uniform(0.5, 2.2, 4000)]).T
    rigid, _ = direct_kinetostatics(p, joints, np.zeros((4000, 2)))
    angle = random.uniform(-np.pi, np.pi, 4000)
    unit = np.array([np.cos(angle), np.sin(angle)]).T
    found = contact(p, joints, rigid + (RADIUS - random.uniform(0, 1.5e-3, 4000))[:, None] * unit, RADIUS)
    floats = found.solved & (found.magnitude > 1) & (found.state.mode1 == 0) & (found.state.mode2 != 0)
    assert floats.sum() > 3
    # with the backlash of joint 1 gone and its angle that of the link, the same force holds without any torque
    held = p.replace(g1=0.0)
    _, torques = direct_kinetostatics(held, np.array([found.links[:, 0], joints[:, 1]]).T, found.force)
    assert np.abs(torques[floats, 0]).max() < 1e-9
    assert (np.abs(joints[floats, 0] - found.links[floats, 0]) <= p.g1 + 1e-12).all()


def test_exact_touches_give_the_moments_back():
    quiet = replace(CELL, noise=sk.Noise(joint=1e-15, force=1e-12))
    found = sk.calibrate(sk.simulate(quiet, TRUTH), quiet)
    np.testing.assert_allclose(found.parameters.as_array(), TRUTH.as_array(), rtol=1e-7, atol=1e-11)


def test_moments_within_their_uncertainty_and_no_touch_rejected():
    for seed in (31, 32, 33):
        found = sk.calibrate(sk.simulate(CELL, TRUTH, seed=seed), CELL)
        assert found.used.all()
        off = found.parameters.as_array() - TRUTH.as_array()
        assert off @ np.linalg.solve(found.covariance, off) < 45.0  # chi-square of 14 degrees: 1 in 24 000


def test_touches_that_do_not_tell_the_flank_of_a_joint_are_left_out():
    truth = TRUTH.replace(s1=8.0 / 9.81, s2=2.0 / 9.81, gravity=(0.0, -9.81))
    nominal = sk.PAPER_NOMINAL.replace(s1=0.8 * truth.s1, s2=0.8 * truth.s2, gravity=truth.gravity, **BESIDE)
    cell = replace(CELL, nominal=nominal)
    exact = sk.simulate(replace(cell, noise=sk.Noise(joint=1e-15, force=1e-12)), truth)
    _, torques = direct_kinetostatics(truth, exact.joints, exact.force)
    for seed in (80001, 80004, 80055):  # with all 72 touches each of these fits has wrong flanks
        found = sk.calibrate(sk.simulate(cell, truth, seed=seed), cell)
        assert 55 < len(found.touches) < 70
        left_out = [item.index for item in found.rejected if 'side of its backlash' in item.reason]
        np.testing.assert_array_equal(np.sort([*left_out, *found.touches.index]), np.arange(72))
        state = found.projection.adjusted.state
        flanks = np.array([state.mode1, state.mode2]).T[found.used]
        np.testing.assert_array_equal(flanks, np.sign(torques[found.touches.index][found.used]))


def test_without_backlash_no_touch_is_left_out():
    rigid = {'g1': 0.0, 'g2': 0.0}
    cell = replace(CELL, nominal=CELL.nominal.replace(**rigid))
    found = sk.calibrate(sk.simulate(cell, TRUTH.replace(**rigid), seed=3), cell, fixed=rigid)
    assert len(found.touches) == 72


def test_uncertainty_of_the_tip_is_that_of_its_derivatives():
    arm = sk.calibrate(sk.simulate(CELL, TRUTH, seed=7), CELL).arm
    joints, force = np.array([[0.3, 1.0]]), np.array([[-30.0, 25.0]])
    found = Predictor(arm).locate(joints, force)
    assert found.loaded.all()
    columns = []
    for k, std in enumerate(np.sqrt(np.diag(arm.covariance))):
        step = 1e-3 * std * np.eye(len(arm.covariance))[k]
        up, down = (
            Predictor(replace(arm, model=arm.model.with_array(arm.model.as_array() + sign * step))) for sign in (1, -1)
        )
        columns.append((up.locate(joints, force).position - down.locate(joints, force).position)[0] / (2e-3 * std))
    derivative = np.array(columns).T
    np.testing.assert_allclose(found.covariance[0], derivative @ arm.covariance @ derivative.T, rtol=1e-4)


def test_without_compliance_and_backlash_the_moments_are_named():
    rigid = {'p1': 0.0, 'p2': 0.0, 'g1': 0.0, 'g2': 0.0}
    cell = replace(CELL, nominal=CELL.nominal.replace(**rigid))
    found = sk.calibrate(sk.simulate(cell, TRUTH.replace(**rigid)), cell, fixed=rigid)
    assert found.status['s1'] == found.status['s2'] == 'confounded'
    assert 'static moments act through' in found.identifiability.advice


def test_held_and_trusted_moments():
    touches = sk.simulate(CELL, TRUTH, seed=9)
    held = sk.calibrate(touches, CELL, fixed={'s1': TRUTH.s1, 's2': TRUTH.s2})
    assert held['s1'].status == 'fixed' and held['p1'].std < sk.calibrate(touches, CELL)['p1'].std
    trusted = replace(CELL, uncertainty=Uncertainty(nominal={'s1': 0.01}))
    assert sk.calibrate(touches, trusted)['s1'].std <= 0.0101


def test_gravity_that_was_forgotten_is_named(monkeypatch):
    monkeypatch.setattr(pipeline, 'diagnose', lambda _: Diagnosis('unexplained', 0.0))
    outcome = sk.diagnose(sk.simulate(CELL, TRUTH, seed=3), replace(CELL, nominal=sk.PAPER_NOMINAL))
    assert 'upright' in ' '.join((*outcome.assessment.reasons, *outcome.assessment.actions))
    for likely, said in ((0.6, 'may stand upright (60 %)'), (0.0, '')):
        found = Diagnosis('ambiguous', 0.0, inclusion={'base_tilt': likely} if likely else {'sensor_bias': 0.6})
        other = replace(outcome, diagnosis=found)
        words = ' '.join((*other.assessment.reasons, *other.assessment.actions))
        assert said in words and ('upright' in words) == bool(said)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (dump_cell(replace(CELL, nominal=sk.PAPER_NOMINAL)) + 'gravity: [9.81]\n', 'gravity.* expected'),
        (dump_cell(CELL).replace(f'gravity: {list(GRAVITY)}', ''), 'moments'),
    ],
)
def test_refuses_gravity_that_is_no_vector_and_moments_without_it(text, problem):
    with pytest.raises(sk.ScaraKinetostaticError, match=problem) as caught:
        parse_cell(text)
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('gravity', [(0.0, -98.1), (np.nan, 0.0), (9.81,), 9.81])
def test_parameters_refuse_gravity_that_no_arm_holds(gravity):
    with pytest.raises(sk.ScaraKinetostaticError, match='gravity'):
        sk.Parameters(gravity=gravity)


def test_a_weightless_nominal_arm_is_refused_under_gravity(tmp_path):
    path = tmp_path / 'cell.yaml'
    path.write_text(dump_cell(replace(CELL, nominal=CELL.nominal.replace(s1=0.0, s2=0.0))))
    with pytest.raises(InputError, match=r'no weight; give robot\.moments'):
        load_predictor(path)


def test_a_gap_is_not_taken_for_other_moments():
    """A soft arm with a wide backlash: a joint on the wrong flank looks like moments that deflect it by the gap."""
    nominal = sk.Parameters(
        theta1=1.3154, l1=0.3266, theta2=-0.0092, l2=0.489, p_ee=1e-5, p1=1e-5, p2=1e-5,
        s1=3.4264, s2=2.2812, gravity=(0.0, -9.81), phi1=0.0362, phi2=0.438,
    )  # fmt: skip
    truth = nominal.replace(
        x0=-1.13e-3, y0=1.66e-3, theta1=1.31355, l1=0.32702, theta2=-8.2e-4, l2=0.48883, p_ee=6.3e-5, p1=5.45e-5,
        p2=3.63e-5, g_ee=1.99e-4, g1=2.44e-4, g2=2.15e-4, s1=3.199, s2=1.867,
    )  # fmt: skip
    discs = (
        sk.Disc('a', 0.65638, 0.16126, 0.03795), sk.Disc('b', 0.09963, 0.4196, 0.05279),
        sk.Disc('c', -0.15796, 0.4297, 0.07504),
        Outline('block', ((0.43695, 0.31398), (0.44676, 0.4296), (0.30425, 0.44169), (0.29444, 0.32607))),
    )  # fmt: skip
    limits = ((-1.7628, 1.7628), (0.0698 - np.pi, -0.0698))
    known = Uncertainty(nominal={'s1': 1.03, 's2': 0.684})
    noise = sk.Noise(joint=1e-5, force=0.3)
    cell = sk.Cell(nominal, discs, noise=noise, limits=limits, tip_radius=0.005, uncertainty=known)
    plan = default_plan(cell, 18, (20.0, 40.0, 60.0))
    plan = plan.select(np.linspace(0, len(plan) - 1, 72).astype(int))
    for seed in (40, 42):
        found = sk.calibrate(simulate_touches(cell, ExtendedModel(truth), plan, cell.noise, seed), cell)
        z = (found.parameters.as_array() - truth.as_array()) / found.std
        assert np.abs(z).max() < 4.0 and found.reduced_chi_square < 1.7


@pytest.mark.parametrize('seed', range(2))
def test_a_backlash_of_which_one_flank_is_guessed_is_not_determined(seed):
    """A short, heavy forearm: gravity holds the elbow on one flank in nearly all touches."""
    nominal = sk.Parameters(
        theta1=1.3154, l1=0.3266, theta2=0.2237, l2=0.1737, p_ee=1e-5, p1=1e-5, p2=1e-5,
        s1=3.4264, s2=1.8686, gravity=(0.0, -9.81), phi1=0.036, phi2=0.211,
    )  # fmt: skip
    discs = (sk.Disc('a', 0.3, 0.1, 0.05), sk.Disc('b', 0.2, 0.3, 0.05), sk.Disc('c', 0.3, -0.15, 0.04))
    limits = ((-1.76, 1.76), (-3.07, -0.07))
    cell = sk.Cell(nominal, discs, noise=sk.Noise(joint=1e-5, force=0.3), limits=limits)
    random = np.random.default_rng([seed, 9])
    scale = random.uniform(0.75, 1.25, 2)
    truth = nominal.replace(
        p_ee=1e-6, p1=1e-5, p2=1e-5, g_ee=2e-5, g1=8e-5, g2=8e-5, s1=scale[0] * nominal.s1, s2=scale[1] * nominal.s2
    )
    plan = default_plan(cell, 16, (20.0, 40.0, 60.0))
    plan = plan.select(np.linspace(0, len(plan) - 1, min(72, len(plan))).astype(int))
    found = sk.calibrate(simulate_touches(cell, ExtendedModel(truth), plan, cell.noise, seed), cell)
    z = (found.parameters.as_array() - truth.as_array()) / found.std
    assert np.nanmax(np.abs(z)) < 5.0 and np.isfinite(z).sum() >= 4


def test_gravity_stated_upside_down_is_named():
    turned = replace(CELL, nominal=CELL.nominal.replace(gravity=(-GRAVITY[0], -GRAVITY[1])))
    outcome = sk.diagnose(sk.simulate(CELL, TRUTH, seed=3), turned)
    assert any('upside down' in reason for reason in outcome.assessment.reasons)
