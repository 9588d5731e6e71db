"""The engine against the model: they agree where nothing is added, and differ where something is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from mujoco_cell.conftest import BRISK, CELL

from benchmark.engine_touches import as_touches, with_noise
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.contact_force import contact
from scara_kinetostatic.model.joint_law import joint_torques
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.mujoco import SimulatedMotion, TouchController
from scara_kinetostatic.simulation.mujoco.engine import SCENES, Engine, Scene, build, scene_named
from scara_kinetostatic.simulation.plan import Plan, default_plan

Play = Callable[[str], SimulatedMotion]


def predicted(joints: np.ndarray, centers: np.ndarray) -> np.ndarray:
    """A(Q, L̄) of all discs, of which one at most is pressed, (n, 2), N."""
    pairs = zip(centers, CELL.radii, strict=True)
    return np.sum([contact(PAPER_ACTUAL, joints, center, radius).force for center, radius in pairs], axis=0)


def error_of_the_model(motion: SimulatedMotion) -> float:
    """Largest difference between A(Q, L̄) of the arm as built and the engine's force, N."""
    joints, force = motion.joints[motion.holds], motion.force[motion.holds]
    return float(np.abs(predicted(joints, CELL.centers) - force).max())


def test_twelve_parameters_explain_the_plain_scene(motion: Play, plan: Plan) -> None:
    calibration = calibrate(as_touches(motion('plain'), CELL, plan), CELL)
    assert calibration.used.all()
    assert np.abs(calibration.residual).max() < 1e-5  # N
    error = calibration.parameters.as_array() - PAPER_ACTUAL.as_array()
    # what the engine's stops and contacts give way beside the springs is 2e-9 m/N
    scale = np.array([1e-8, 1e-8, 1e-8, 1e-8, 1e-8, 1e-8, 4e-9, 4e-9, 4e-9, 1e-8, 1e-8, 1e-8])
    assert np.all(np.abs(error) < scale)
    assert error_of_the_model(motion('plain')) < 0.02


@pytest.mark.parametrize('name', [name for name in SCENES if name not in ('plain', 'two', 'joint_slip_fast')])
def test_every_other_scene_differs_from_the_model(played_few: Play, name: str) -> None:
    assert error_of_the_model(played_few(name)) > 1.0  # N


def test_bearing_friction_holds_the_link_back(half: Plan) -> None:
    scene = scene_named('joint_friction')
    friction = TouchController(scene, CELL, half, BRISK).run()
    joints, links, force = (part[friction.holds] for part in (friction.joints, friction.links, friction.force))
    torques = np.einsum('nij,ni->nj', kinematics.jacobian(PAPER_ACTUAL, links), force)
    wound = (joints - links)[:, 1]
    spring = np.sign(wound) * np.maximum(np.abs(wound) - PAPER_ACTUAL.g2, 0.0) / PAPER_ACTUAL.p2
    approach = as_touches(friction, CELL, half).approach
    share = (spring - torques[:, 1]) / scene.bearing_friction[1] * np.sign(approach[:, 1])
    assert np.abs(share).max() < 1.02
    assert np.mean(share > 0.9) > 0.6


def test_contact_friction_takes_either_sense_and_any_size(half: Plan) -> None:
    friction = TouchController(scene_named('contact_friction'), CELL, half, BRISK).run()
    links, force = friction.links[friction.holds], friction.force[friction.holds]
    inward = CELL.centers[half.disc] - kinematics.forward(PAPER_ACTUAL, links)
    ratio = (inward * kinematics.quarter_turn(-force)).sum(axis=1) / (inward * force).sum(axis=1)
    coefficient = scene_named('contact_friction').contact_friction
    assert np.all(np.abs(ratio) < 1.1 * coefficient)
    assert ratio.min() < -0.02 and ratio.max() > 0.02
    assert np.ptp(np.abs(ratio)) > 0.3 * coefficient


def test_a_moved_disc_is_found_where_it_stands(played_few: Play) -> None:
    displaced = played_few('displaced_disc')
    joints, force = displaced.joints[displaced.holds], displaced.force[displaced.holds]
    centers = CELL.centers.copy()
    centers[1] += scene_named('displaced_disc').displacement
    assert np.abs(predicted(joints, centers) - force).max() < 0.02


def test_preload_brings_the_joints_from_the_other_side(motion: Play, plan: Plan) -> None:
    plain, preloaded = motion('plain'), plan.preload > 0
    force = np.linalg.norm(plain.force, axis=1)
    assert np.allclose(force[plain.holds], plan.force, rtol=0.03)
    peak = np.array([force[plain.touch == touch].max() for touch in range(len(plan))]) / plan.force
    assert np.all(peak[preloaded] > 1.8) and np.all(peak[~preloaded] < 1.2)
    approach = np.abs(as_touches(plain, CELL, plan).approach).max(axis=1)
    assert approach[~preloaded].min() > 0.01 > approach[preloaded].max()


def test_upright_the_links_weigh_what_the_parameters_say() -> None:
    """The springs turn by what the static moments, beside the links, load them with: p_1 C_1 and p_2 C_2."""
    p = PAPER_ACTUAL.replace(gravity=(0.0, -9.81), s1=4.0, s2=1.7, phi1=0.1, phi2=0.4, g1=0.0, g2=0.0)
    engine = Engine(Scene(parameters=p, masses=(3.9, 8.0)), CELL, np.array([0.3, 0.8]), smooth=True)
    for _ in range(1500):
        engine.advance()
    torques = joint_torques(p, engine.links[None], np.zeros((1, 2)))[0]
    assert np.abs(torques).min() > 1.0
    np.testing.assert_allclose(engine.joints - engine.links, [p.p1, p.p2] * torques, rtol=1e-6)


def test_senseless_scenes_and_plans_are_refused(plan: Plan) -> None:
    with pytest.raises(ParameterError, match='contact_friction'):
        Scene(contact_friction=-0.1)
    with pytest.raises(ParameterError, match='p1'):
        Scene(parameters=PAPER_ACTUAL.replace(p1=0.0))
    with pytest.raises(ParameterError, match='nonsense'):
        scene_named('nonsense')
    upright = PAPER_ACTUAL.replace(gravity=(0.0, -9.81), s1=2.0, s2=0.7)
    for more in ({'quasi_static': True}, {'link_compliance': 1e-4}, {'masses': (6.0, 0.0)}):
        with pytest.raises(ParameterError, match='upright has heavy links that do not bend'):
            Scene(parameters=upright, **more)
    with pytest.raises(UnsupportedDataError, match='no touch'):
        TouchController(Scene(), CELL, plan.select(np.arange(0)))
    far = replace(CELL, discs=(CELL.discs[0]._replace(x=2.0),))
    with pytest.raises(UnsupportedDataError, match='touch 0'):
        TouchController(Scene(), far, plan.select(plan.disc == 0))


BLOCK = Outline('block', ((-0.03, 0.34), (0.07, 0.34), (0.07, 0.44), (-0.03, 0.44)), 0.003)
WITH_BLOCK = replace(CELL, discs=(CELL.discs[0], BLOCK), tip_radius=0.005)


def test_the_model_explains_a_block() -> None:
    plan = default_plan(WITH_BLOCK, 5, preload=0.3)
    motion = TouchController(SCENES['plain'], WITH_BLOCK, plan, BRISK).run()
    touches = as_touches(motion, WITH_BLOCK, plan)
    exact = calibrate(touches, WITH_BLOCK)
    assert exact.used.all()
    touched = exact.touches.surface[exact.touches.disc == 1]
    assert len(set(touched.tolist())) >= 4
    assert (~WITH_BLOCK.surfaces.is_edge[touched]).sum() >= 2
    assert np.abs(exact.residual).max() < 0.02  # N
    noise = Noise(1e-5, 0.3)
    noisy = calibrate(with_noise(touches, WITH_BLOCK, noise, seed=3), replace(WITH_BLOCK, noise=noise))
    assert np.abs((noisy.parameters.as_array() - PAPER_ACTUAL.as_array()) / noisy.std).max() < 4


def test_an_inner_corner_is_refused() -> None:
    ell = Outline('ell', ((0.1, 0.3), (0.3, 0.3), (0.3, 0.36), (0.2, 0.36), (0.2, 0.45), (0.1, 0.45)), 0.008)
    with pytest.raises(ParameterError, match='inner corner'):
        build(SCENES['plain'], replace(CELL, discs=(CELL.discs[0], ell), tip_radius=0.005))
