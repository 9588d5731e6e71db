"""The tip followed sample by sample is that of arrays; in a dead band noise does not move it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic.effects.registry import find
from scara_kinetostatic.model import online
from scara_kinetostatic.model.arm import CalibratedArm, Predictor, SensorErrors, force_on_object, in_sensor_frame
from scara_kinetostatic.model.cell import PAPER_CELL, SensorFrame
from scara_kinetostatic.model.extended_model import ExtendedModel, reported_force
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.online import OnlineArm, check_free
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import G_EE, P_EE

EFFECTS = (
    '', 'transmission_error[joint1]', 'anisotropic_backlash', 'base_compliance', 'joint_hardening[joint2]',
    'joint_coupling[joint1]', 'cable_pull[joint2]', 'tip_shape[three-lobed]',
)  # fmt: skip


@pytest.fixture(scope='module')
def arm() -> CalibratedArm:
    return sk.calibrate(sk.simulate(PAPER_CELL, sk.PAPER_ACTUAL), PAPER_CELL).arm


def with_effect(arm: CalibratedArm, label: str) -> CalibratedArm:
    if not label:
        return arm
    effect = find(PAPER_CELL, label)
    model = ExtendedModel(arm.model.parameters, (effect,), (effect.typical,))
    size = len(model.names)
    covariance = np.diag([*np.diag(arm.covariance), *(1e-4 * np.array(effect.typical) ** 2)])
    return replace(arm, model=model, covariance=covariance, undetermined=np.zeros((size, 0)))


@pytest.mark.parametrize('label', EFFECTS)
def test_one_by_one_as_in_arrays(arm: CalibratedArm, label: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(online, 'WIDTH', 0.0)  # without hysteresis
    random, count = np.random.default_rng(0), 200
    joints = np.stack(
        [random.uniform(-3, 3, count), random.choice([-1, 1], count) * random.uniform(0.2, 2.8, count)], -1
    )
    force = random.normal(0, 15, (count, 2))
    force[:3] = 0
    follower = OnlineArm(with_effect(arm, label))
    found = [follower.locate(*q, *f) for q, f in zip(joints.tolist(), force.tolist(), strict=True)]
    expected = follower.predictor.locate(joints, force, measured=True)
    np.testing.assert_allclose([(one.x, one.y) for one in found], expected.position, rtol=0, atol=1e-10)
    assert [one.status for one in found] == expected.status.tolist()
    covariance = np.array([one.covariance[:2, :2] for one in found])
    std = np.sqrt(np.einsum('nii->ni', expected.covariance))
    error = np.abs(covariance - expected.covariance) / (std[:, :, None] * std[:, None, :])
    assert error[expected.loaded].max() < 1e-3


def test_the_gap_is_as_uncertain_as_it_is_known(arm: CalibratedArm) -> None:
    """Without a force nothing depends on the size of a gap, except how far the tip may be off."""
    joints, none = np.array([[0.4, 1.1]]), np.zeros((1, 2))
    before = Predictor(arm).locate(joints, none).covariance[0]
    covariance = np.array(arm.covariance)
    covariance[G_EE, G_EE] += 9e-8
    wider = replace(arm, covariance=covariance)
    expected = before + 3e-8 * np.eye(2)
    np.testing.assert_allclose(Predictor(wider).locate(joints, none).covariance[0], expected, rtol=1e-9)
    one, other = (OnlineArm(each).locate(0.4, 1.1, 0.0, 0.0).covariance for each in (wider, arm))
    np.testing.assert_allclose((one - other)[:2, :2], 3e-8 * np.eye(2), rtol=0, atol=1e-14)
    # one force level: p_ee and g_ee trade places at 30 N
    free = np.zeros((12, 1))
    free[G_EE], free[P_EE] = 1e-3, -1e-3 / 30
    unknown = replace(arm, undetermined=free)
    forces = np.array([[0.0, 0.0], [30.0, 0.0], [15.0, 0.0]])
    statuses = ['undetermined', 'ok', 'undetermined']
    assert Predictor(unknown).locate(np.repeat(joints, 3, axis=0), forces).status.tolist() == statuses
    assert [OnlineArm(unknown).locate(0.4, 1.1, *force).status for force in forces.tolist()][::2] == statuses[::2]


def test_noise_within_a_dead_band_does_not_move_the_tip(arm: CalibratedArm) -> None:
    random, follower = np.random.default_rng(1), OnlineArm(arm)
    forces = random.normal(0, 0.3, (500, 2))
    tips = np.array([follower.locate(0.4, 1.1, *force)[:2] for force in forces.tolist()])
    jumping = follower.predictor.locate(np.tile([0.4, 1.1], (500, 1)), forces).position
    moves, jumps = (np.abs(np.diff(part[100:], axis=0)).mean() for part in (tips, jumping))
    assert moves < 0.15 * jumps
    pressed = [follower.locate(0.4, 1.1, x, 0.0)[:2] for x in np.linspace(0, 30, 3001).tolist()]
    assert np.abs(np.diff(pressed, axis=0)).max() < 1e-5
    assert pressed[-1] == pytest.approx(
        follower.predictor.locate(np.array([[0.4, 1.1]]), np.array([[30.0, 0]])).position[0], abs=1e-9
    )


def test_the_covariance_follows(arm: CalibratedArm) -> None:
    follower, angles = OnlineArm(arm), np.linspace(0.3, 2.5, 1000)
    for angle in angles.tolist():
        found = follower.locate(0.4, angle, 20.0, 25.0)
        if found.status == 'ok':
            expected = follower.predictor.locate(np.array([[0.4, angle]]), np.array([[20.0, 25.0]]), measured=True)
            np.testing.assert_allclose(found.covariance[0, 0], expected.covariance[0, 0, 0], rtol=0.05)


@pytest.mark.parametrize('frame', list(SensorFrame))
def test_the_errors_of_the_sensor_are_removed(arm: CalibratedArm, frame: SensorFrame) -> None:
    cell = replace(PAPER_CELL, sensor=PAPER_CELL.sensor._replace(frame=frame))
    biased = replace(with_effect(arm, 'sensor_bias'), cell=cell, sensor=SensorErrors(gain=0.01, rotation=0.02))
    joints, force = np.array([[0.4, 1.1], [-1.0, -0.7]]), np.array([[20.0, -5.0], [3.0, 17.0]])
    own = in_sensor_frame(biased, force, joints)
    reported = 1.01 * rotate(reported_force(biased.model, own), np.full(2, 0.02))
    np.testing.assert_allclose(force_on_object(biased, reported, joints), force, rtol=0, atol=1e-9)
    one = OnlineArm(biased).true_force(*joints[0], *reported[0])
    assert one == pytest.approx(tuple(force[0]), abs=1e-9)
    angle = joints.sum(axis=1) + arm.model.parameters.theta1 + arm.model.parameters.theta2
    np.testing.assert_allclose(own, rotate(force, -angle) if frame is SensorFrame.TOOL else force)


BLOCK = Outline('block', ((0.10, 0.35), (0.20, 0.35), (0.20, 0.45), (0.10, 0.45)))
BIAS = np.array([1.2, -0.8])


@pytest.mark.parametrize(('pressed', 'off', 'reported', 'name'), [
    (25.0, 0.0, 25.0, 'disc_1'), (25.0, 0.0, 25.0, 'block'), (5.0, 0.0, 5.0, 'disc_1'), (5.0, 0.0, 5.0, 'block'),
    (0.0, 2e-4, 0.0, ''), (0.0, 2e-4, 25.0, ''), (0.0, -3e-3, 0.0, ''),  # a large zero; an object that is not there
])  # fmt: skip
def test_the_tip_presses_against_a_known_object(arm, pressed, off, reported, name) -> None:
    """By the joint angles, and by a force that has the zero of the sensor in it."""
    disc = PAPER_CELL.discs[0]
    place, out = np.array([disc.x, disc.y - disc.radius]), np.array([0.0, -1.0])
    if name == 'block':
        arm, place = (
            replace(arm, cell=replace(PAPER_CELL, discs=(disc, BLOCK), tip_radius=0.005)),
            np.array([0.15, 0.345]),
        )
    joints = sk.compensate(arm, place + off * out, -pressed * out, 'left').joints
    for bias in (0.0, BIAS):
        force = np.array([-reported * out]) + bias
        if not name:
            check_free(arm, joints, force)
            continue
        with pytest.raises(sk.UnsupportedDataError, match=f"the tip presses against '{name}' with {pressed:.2g} N"):
            check_free(arm, joints, force)
