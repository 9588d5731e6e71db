"""H̄ and Ḡ through the interface: identities, and their uncertainty against that of sigma points."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinetostatics import direct_kinetostatics, inverse_kinetostatics

FORCE = np.array([[-20.0, 5.0], [0.0, 30.0], [12.0, -9.0], [3.0, 4.0]])
POSITION = np.array([[0.3, 0.2], [-0.25, 0.3], [0.1, 0.4], [-0.1, -0.35]])
ELBOW = ['left', 'right', 'left', 'right']
CELL = sk.load_cell(Path(__file__).parents[2] / 'config' / 'cell.yaml')


@pytest.fixture(scope='module')
def outcome():
    """With an effect of a joint, and all those too small to be found."""
    effect = 'transmission_error[joint1]:amplitude=2e-4,phase=0.7,cycles=7.3'
    found = sk.diagnose(sk.simulate(CELL, sk.PAPER_ACTUAL, effects=effect, per_disc=18, seed=3), CELL)
    assert found.verdict == 'explained'
    return found


def test_uncertainty_is_that_of_sigma_points(outcome):
    """Models that have the mean and the covariance of the estimate: exact for laws that are linear in that range."""
    c = outcome.final
    angles = sk.compensate(outcome, POSITION, FORCE, ELBOW)
    place = sk.locate(outcome, angles.joints, FORCE)
    values, vectors = np.linalg.eigh(c.covariance)
    spread = np.sqrt(len(values) * np.maximum(values, 0)) * vectors
    drawn = c.full_model.as_array() + np.hstack([spread, -spread]).T
    models = [c.full_model.with_array(values) for values in drawn]
    gripper, sides = c.cell.gripper_sign, np.array([1, -1, 1, -1])
    tips = np.array([direct_kinetostatics(model, angles.joints, FORCE, gripper)[0] for model in models])
    joints = np.array([inverse_kinetostatics(model, POSITION, FORCE, sides, gripper)[0] for model in models])
    assert place.loaded.all()
    np.testing.assert_allclose(place.position, POSITION, rtol=0, atol=1e-12)
    assert angles.joints.shape == angles.torques.shape == angles.std.shape == (4, 2)
    for found, sample in ((place, tips), (angles, joints)):
        np.testing.assert_allclose(found.std, sample.std(axis=0), rtol=0.02)
        for k in range(4):
            correlation = np.corrcoef(sample[:, k].T)[0, 1]
            assert correlation == pytest.approx(found.covariance[k, 0, 1] / np.prod(found.std[k]), abs=0.02)


def test_within_the_dead_bands_the_half_width_is_part_of_the_uncertainty(outcome):
    c, p = outcome.final, outcome.final.parameters
    joints = np.tile([0.4, 1.1], (3, 1))
    free = sk.locate(outcome, joints, [[0.0, 0.0], [1e-9, 0.0], [2.9 * c.noise.force, 0.0]])
    assert not free.loaded.any()
    assert free.status.tolist() == ['unloaded'] * 3
    np.testing.assert_allclose(free.position[1], free.position[0], rtol=0, atol=1e-12)
    jacobian = kinematics.jacobian(p, joints)
    band = jacobian * [p.g1, p.g2] @ (jacobian * [p.g1, p.g2]).swapaxes(1, 2) / 3 + p.g_ee**2 / 3 * np.eye(2)
    np.testing.assert_allclose(free.std[:2], np.sqrt(np.diagonal(band, axis1=1, axis2=2))[:2], rtol=0.05)
    assert (free.std[2] < free.std[0]).all()
    both = sk.locate(outcome, joints[:2], [[5.0, 0.0], [-5.0, 0.0]])
    assert both.loaded.all()
    np.testing.assert_allclose(both.position.mean(axis=0), free.position[0], rtol=0, atol=5e-6)
    np.testing.assert_allclose(sk.compensate(outcome, free.position[0]).joints, joints[:1], rtol=0, atol=1e-9)


@pytest.mark.parametrize('direction', [0.4, 0.4 + np.pi])
def test_the_dead_bands_are_crossed_without_a_jump(outcome, direction):
    """As the force turns through the line of a link, pulling and pressing, and as it changes its sign."""
    joints, turn = np.array([[0.4, 1.1]]), np.linspace(-0.3, 0.3, 4001)
    sweeps = [
        20 * np.stack([np.cos(direction + 1.1 + turn), np.sin(direction + 1.1 + turn)], axis=-1),
        10 * turn[:, None] * np.array([[-0.8, 0.6]]),
    ]
    for force in sweeps:
        place = sk.locate(outcome, np.tile(joints, (len(force), 1)), force)
        back = sk.compensate(outcome, place.position, force)
        np.testing.assert_allclose(back.joints, np.tile(joints, (len(force), 1)), rtol=0, atol=1e-9)
        assert set(place.status) == {'ok', 'unloaded'}
        assert np.abs(np.diff(place.position, axis=0)).max() < 3e-6
        assert np.abs(np.diff(place.std, axis=0)).max() < 3e-5


def test_a_force_through_a_joint_axis_leaves_the_sign_of_one_backlash_open(outcome):
    c, p = outcome.final, outcome.final.parameters
    place = sk.locate(outcome, [0.8, 2.1]).position
    angle = 2.9 + p.theta1 + p.theta2 + np.array([0.0, 1e-8, 3e-6, 1e-3])  # along link 2
    angles = sk.compensate(outcome, np.tile(place, (4, 1)), 20 * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    assert not angles.loaded.any()
    np.testing.assert_allclose(angles.std[:, 1], p.g2 / np.sqrt(3), rtol=0.05)
    assert (angles.std[:, 0] < 0.2 * p.g1).all()
    assert c.noise.force < 1


def test_the_edge_of_reach_has_an_uncertainty(outcome):
    p = outcome.final.parameters
    reach = np.array([p.x0 + p.l1 + p.l2, p.y0])
    angles = sk.compensate(outcome, reach - [[1e-7, 0.0], [-1e-3, 0.0], [0.1, 0.1]], [20.0, 5.0])
    inside = sk.compensate(outcome, reach - [p.p_ee * 20 + p.g_ee + 1e-7, 0.0], [20.0, 0.0])
    assert np.isfinite(inside.std).all()
    assert np.isnan(angles.std[1]).all()
    assert angles.status[1:].tolist() == ['out_of_reach', 'ok']


def test_an_effect_of_time_needs_the_time():
    cell = replace(CELL, noise=sk.Noise(1e-5, 0.3))
    label = 'thermal_drift[joint1]'
    touches = sk.simulate(cell, sk.PAPER_ACTUAL, effects=[f'{label}:rate=1e-6'], seed=1)
    (drift,) = (effect for effect in sk.catalogue(cell) if effect.label == label)
    fit = sk.calibrate(touches, cell, effects=[drift])
    with pytest.warns(UserWarning, match=r'thermal_drift\[joint1\] depends on time, which is not given'):
        begin = sk.compensate(fit, [0.3, 0.2], [0.0, 30.0])
    later = sk.compensate(fit, [0.3, 0.2], [0.0, 30.0], time=1000.0)
    rate = fit.effects[label]['rate'].value
    np.testing.assert_allclose(later.joints - begin.joints, [[-1000 * rate, 0.0]], rtol=0, atol=1e-9)
    back = sk.locate(fit, later.joints, [0.0, 30.0], time=[1000.0])
    np.testing.assert_allclose(back.position, [[0.3, 0.2]], rtol=0, atol=1e-12)


def test_an_effect_of_the_load_before_takes_none_and_says_so():
    cell = replace(CELL, noise=sk.Noise(1e-5, 0.3))
    touches = sk.simulate(cell, sk.PAPER_ACTUAL, effects='joint_slip[joint1]:compliance=1e-4,slip_torque=1.5')
    start = ExtendedModel(cell.nominal, (find(cell, 'joint_slip[joint1]'),), ((8e-5, 1.3),))
    fit = sk.calibrate(touches, cell, start=start)
    compliance, slip_torque = fit.model.effect_arrays[0].tolist()
    with pytest.warns(UserWarning, match=r'joint_slip\[joint1\] depends on the load before, which is not given'):
        angles = sk.compensate(fit, [0.3, 0.2], [0.0, 30.0], elbow='right')
    with pytest.warns(UserWarning, match='no preload'):
        assert sk.locate(fit, angles.joints, [0.0, 30.0]).position == pytest.approx(np.array([[0.3, 0.2]]))
    plain = inverse_kinetostatics(fit.parameters, [[0.3, 0.2]], [[0.0, 30.0]], -1)[0]
    torque = angles.torques[0, 0]
    lag = compliance * np.sign(torque) * (abs(torque) - slip_torque)
    assert angles.joints[0, 0] - plain[0, 0] == pytest.approx(lag, rel=0.15)


def test_arrays_become_touches_as_tables_do():
    joints, force = [[0.8355, 2.1317], [2.9658, -2.1322]], [[-9.8, -0.1], [-25.1, 0.1]]
    made = sk.make_touches(joints, force, CELL, objects='disc_1', time=[1.7e9, 1.7e9 + 5], approach=[[1, -1], [1, 1]])
    assert made.time.tolist() == [0.0, 5.0]
    assert not made.press.any()
    assert made.disc.tolist() == [0, 0]
    with pytest.raises(sk.InputError, match='give one row per touch'):
        sk.make_touches(joints, force[0], CELL)


def test_touches_that_are_given_twice_are_counted_and_rejected():
    touches = sk.simulate(CELL, sk.PAPER_ACTUAL, effects='object_radius[disc_2]:radius=6e-5', seed=1)
    names = [CELL.discs[k].name for k in touches.disc]
    joints, force = (np.vstack([part, part[:1]]) for part in (touches.joints, touches.force))
    repeated = sk.make_touches(joints, force, CELL, objects=[*names, names[0]])
    outcome = sk.diagnose(repeated, CELL, fixed={'l1': 0.3302})
    assert outcome['l1'].status == 'fixed'
    assert len(outcome.calibration.touches) < len(repeated)
    assert outcome.found == len(repeated) == len(outcome.rejected) + outcome.final.used.sum()


def test_what_the_data_do_not_determine_has_no_uncertainty():
    touches = sk.simulate(CELL, sk.PAPER_ACTUAL, per_disc=18, preload=0.0, seed=3)
    size = np.hypot(*touches.force.T)
    calibration = sk.calibrate(touches.select(np.abs(size - 25) < 5), CELL)
    assert calibration['p_ee'].status == 'confounded'
    place = sk.locate(calibration, [[0.4, 1.1]] * 2, [[25.0, 0.0], [250.0, 0.0]])
    assert np.isfinite(place.std[0]).all()
    assert np.isnan(place.std[1]).any()


def test_predicted_forces_are_measured_less_residual(outcome):
    c = outcome.final
    np.testing.assert_allclose(sk.predict_force(outcome, c.touches), c.force - c.residual, rtol=0, atol=1e-9)
    names = [c.cell.discs[number].name for number in c.touches.disc]
    alone = sk.predict_force(outcome, c.touches.joints, names)
    assert np.median(np.hypot(*(alone - c.force).T)) < 1.0


@pytest.mark.parametrize(
    ('call', 'message'),
    [
        (lambda o: sk.locate(o, [1, 2, 3]), r'joints: expected shape \(n, 2\), got \(3,\)'),
        (lambda o: sk.locate(o, [[1, 'a']]), 'joints: expected numbers, got'),
        (lambda o: sk.locate(o, np.empty((0, 2))), r'joints: expected shape \(n, 2\), got \(0, 2\)'),
        (lambda o: sk.locate(o, [1, 2], [np.nan, 0]), 'force: expected finite numbers, got nan'),
        (lambda o: sk.locate(o, [[1, 2]] * 3, [[1, 2]] * 2), r'force: expected shape \(3, 2\), got \(2, 2\)'),
        (lambda o: sk.locate('result', [1, 2]), 'result: expected what diagnose or calibrate return, got str'),
        (lambda o: sk.compensate(o, [0.3, 0.2], elbow='up'), "elbow: there is no 'up'; the names are right, left"),
        (lambda o: sk.compensate(o, [0.3, 0.2], elbow=['left'] * 2), 'elbow: expected one name or 1, got 2'),
        (lambda o: sk.predict_force(o, [1, 2]), 'objects: is missing'),
        (lambda o: sk.predict_force(o, [1, 2], 'disc_9'), "there is no 'disc_9'; the names are disc_1, disc_2"),
        (lambda o: sk.predict_force(o, [[1, 2]] * 2, ['disc_1']), 'objects: expected one name or 2, got 1'),
        (lambda o: sk.diagnose(o.calibration, o.final.cell), 'source: expected touches of read_touches'),
        (lambda o: sk.diagnose([], o.final.cell), 'paths: expected one or more files, got none'),
        (lambda o: sk.simulate(o.final.cell, {'l3': 1.0}), "unknown parameter 'l3'"),
        (lambda o: sk.simulate(o.final.cell, {}, effects=['rust']), "effect 'rust': no such effect"),
        (lambda o: sk.make_touches([1, 2], [3, 4], o.final.cell), 'touch 0: no object there; the nearest'),
        (lambda o: sk.make_touches([1, 2], [3, 4], o.final.cell, time=[1, 2]), 'time: expected shape'),
        (lambda o: sk.make_touches([1, 2], [3, 4], 'cell.yaml'), 'cell: expected Cell, got str'),
        (lambda o: sk.diagnose('touches.csv', 'cell.yaml'), 'cell: expected Cell, got str'),
        (lambda o: sk.simulate(o.final.cell, [1.0]), 'truth: expected Mapping, got list'),
        (lambda o: o['l3'], "no parameter 'l3'"),
    ],
)  # fmt: skip
def test_wrong_arguments_are_one_clear_line(outcome, call, message):
    with pytest.raises((sk.InputError, KeyError), match=message):
        call(outcome)


def test_predicted_and_measured_forces_come_in_one_frame():
    cell = sk.load_cell(Path(__file__).parents[2] / 'bags' / 'measured.yaml')
    truth = {'x0': 2e-3, 'theta1': -1.7e-3, 'l1': cell.nominal.l1 + 2e-4}
    touches = sk.simulate(cell, truth, per_disc=6)
    outcome = sk.diagnose(touches, cell)
    off = sk.predict_force(outcome, outcome.final.touches) - outcome.final.touches.force
    np.testing.assert_allclose(np.hypot(*off.T), np.hypot(*outcome.residuals.T), atol=0.03)
    assert np.hypot(*off.T).mean() < 1.0
