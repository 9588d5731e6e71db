"""H̄ undoes Ḡ over the workspace: with every effect of the robot, every gripper, in and out of the dead bands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effects.scenes import KINDS

import scara_kinetostatic as sk
from scara_kinetostatic.model.arm import STATUSES, CalibratedArm, Predictor
from scara_kinetostatic.model.cell import PAPER_CELL, GripperSign
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.kinetostatics import Force, inverse_kinetostatics, load_arm
from scara_kinetostatic.model.parameters import PAPER_MEASURED

COUNT = 1000


@pytest.fixture(scope='module')
def arm() -> CalibratedArm:
    return sk.calibrate(sk.simulate(PAPER_CELL, PAPER_MEASURED), PAPER_CELL).arm


def poses() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Half of the forces are along a link, pulling or pressing, or hardly there."""
    random = np.random.default_rng(0)
    side = random.choice([1, -1], COUNT)
    links = np.stack([random.uniform(-np.pi, np.pi, COUNT), side * random.uniform(0.1, 3.0, COUNT)], axis=-1)
    tip = forward(PAPER_MEASURED, links)
    size, angle = random.uniform(0, 60, COUNT), random.uniform(0, 7, COUNT)
    half = slice(COUNT // 2)
    angle[half] = (
        links.sum(axis=1)[half] + np.pi * random.choice([0, 1], COUNT // 2) + random.normal(0, 0.01, COUNT // 2)
    )
    size[: COUNT // 8] *= 0.01
    size[:9] = 0.0
    return tip, np.stack([size * np.cos(angle), size * np.sin(angle)], axis=-1), side


def distance(arm: CalibratedArm) -> float:
    predictor, (tip, force, side) = Predictor(arm), poses()
    angles = predictor.compensate(tip, force, side)
    reached = np.isfinite(angles.joints).all(axis=1)
    assert reached.mean() > 0.98
    assert set(angles.status) <= set(STATUSES)
    back = predictor.locate(angles.joints[reached], force[reached])
    assert 0.1 < back.loaded.mean() < 0.9
    return float(np.abs(back.position - tip[reached]).max())


@pytest.mark.parametrize(
    'effect', [effect for effect in KINDS if not effect.on_object], ids=lambda effect: effect.label
)
def test_with_every_effect(arm: CalibratedArm, effect: sk.Effect) -> None:
    model = ExtendedModel(arm.model.parameters, (effect,), (effect.typical,))
    size = len(model.names)
    assert distance(replace(arm, model=model, covariance=np.eye(size), undetermined=np.zeros((size, 0)))) < 1e-9


@pytest.mark.parametrize('sign', list(GripperSign))
def test_with_every_gripper(arm: CalibratedArm, sign: GripperSign) -> None:
    assert distance(replace(arm, cell=replace(PAPER_CELL, gripper_sign=sign))) < 1e-9


def test_outside_the_dead_bands_it_is_the_law_itself(arm: CalibratedArm) -> None:
    tip, force, side = poses()
    found = Predictor(arm).compensate(tip, force, side)
    exact, torques = inverse_kinetostatics(arm.model, tip, force, side)
    assert found.loaded.sum() > 250
    np.testing.assert_allclose(found.joints[found.loaded], exact[found.loaded], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.torques[found.loaded], torques[found.loaded], rtol=0, atol=1e-9)


def test_a_dead_band_is_crossed_on_a_straight_line() -> None:
    """s = c / b with b = 3 σ_F ‖J‖ + 4 g f (l1 + l2), at most 1 in size; one arm as floats, or many as arrays."""
    p, links = PAPER_MEASURED, (0.3, 0.1, -0.05, 0.25)
    sizes = np.array([0.02, 0.2, 2.0, 20.0])
    zero, one, std = np.zeros(4), np.ones(4), np.full(4, 0.1)
    found = load_arm(p, links, (0.0, 0.0), Force(zero, sizes, sizes, std, one, zero, one))
    torques = np.outer((0.25, -0.05), sizes)
    own = 4 * (p.l1 + p.l2) * sizes
    bands = 0.3 * np.hypot(0.25, 0.35) + p.g1 * own, 0.3 * p.l2 + p.g2 * own
    np.testing.assert_allclose((found.c1, found.c2), torques, rtol=1e-12)
    np.testing.assert_allclose((found.s1, found.s2), np.clip(torques / bands, -1, 1), rtol=1e-12)
    inside = np.abs(torques) < bands
    assert found.in_band.tolist() == [True, True, True, False]
    slopes = np.array([[p.p1], [p.p2]]) + np.where(inside, np.array([[p.g1], [p.g2]]) / bands, 0.0)
    np.testing.assert_allclose((found.k1, found.k2), slopes, rtol=1e-12)
    single = load_arm(p, links, (0.0, 0.0), Force(0.0, 0.2, 0.2, 0.1, 1.0, 0.0, 1.0))
    assert single[5:11] == pytest.approx([part[1] for part in found[5:11]], rel=1e-12)
