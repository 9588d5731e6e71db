"""Slip with memory in the engine: a spring beside friction, in series with the spring of the joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mujoco_cell.conftest import CELL
from studies.load_records import play

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model import kinematics
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.motion import minimum_jerk
from scara_kinetostatic.simulation.mujoco import TouchController
from scara_kinetostatic.simulation.mujoco.engine import TICK, Engine, Scene, scene_named
from scara_kinetostatic.simulation.plan import Plan

COMPLIANCE, TORQUE = 2e-5, 2.0
RAMP, REST = 0.3, 0.3
LOOP = (5.0, 2.0, 4.0, 0.0, -3.0, 0.0)


@pytest.fixture
def joint() -> tuple[Engine, int]:
    """An engine whose first joint slips, far from the discs, and the number of its link 1."""
    scene = Scene(slip_compliance=(COMPLIANCE, 0.0), slip_torque=(TORQUE, 0.0), quasi_static=True)
    engine = Engine(scene, CELL, np.array([0.5, 0.8]))
    return engine, engine.model.body('beam1').id


def load(joint: tuple[Engine, int], start: float, end: float) -> None:
    """Changes the torque on link 1, Nm, smoothly, and rests."""
    engine, link = joint
    for part in minimum_jerk(np.linspace(0.0, 1.0, round(RAMP / TICK))):
        engine.data.xfrc_applied[link, 5] = start + part * (end - start)
        engine.advance()
    rest(engine, REST)


def rest(engine: Engine, duration: float) -> None:
    for _ in range(round(duration / TICK)):
        engine.advance()


def angles(engine: Engine) -> Floats:
    """Deflection of the slipping spring and of the whole joint, rad, in the sense of the torque on the link."""
    return np.array([engine.data.joint('slip1').qpos[0], engine.links[0] - engine.joints[0]])


def test_the_deflection_is_the_play_of_the_torque(joint: tuple[Engine, int]) -> None:
    previous = 0.0
    for torque, place in zip(LOOP, play(np.array(LOOP), TORQUE), strict=True):
        load(joint, previous, torque)
        slipped, total = angles(joint[0])
        spring = COMPLIANCE * place + PAPER_ACTUAL.p1 * torque
        assert slipped == pytest.approx(COMPLIANCE * place, abs=0.01 * COMPLIANCE * TORQUE)
        if torque:  # else the link is anywhere in its backlash
            backlash = PAPER_ACTUAL.g1 * np.sign(torque)
            assert total == pytest.approx(spring + backlash, abs=0.01 * COMPLIANCE * TORQUE)
        previous = torque


def test_friction_at_its_limit_hardly_creeps(joint: tuple[Engine, int]) -> None:
    load(joint, 0.0, 5.0)
    for before, torque in ((5.0, 5.0), (5.0, 0.0)):
        load(joint, before, torque)
        start = angles(joint[0])[0]
        rest(joint[0], 1.0)
        assert 0 < abs(angles(joint[0])[0] - start) < 3e-9  # rad in a second


def test_the_memory_follows_from_the_contact_torques(few: Plan) -> None:
    """Inertia changes the state by less than a tenth of the slip torque."""
    scene = scene_named('joint_slip')
    controller = TouchController(scene, CELL, few)
    slipped, tick = [], controller._tick

    def watch(progress: float = 0.0) -> None:
        tick(progress)
        slipped.append(controller.engine.data.joint('slip2').qpos[0])

    controller._tick = watch  # type: ignore[method-assign]
    motion = controller.run()
    torques = -np.einsum('nij,ni->nj', kinematics.jacobian(PAPER_ACTUAL, motion.links), motion.force)[:, 1]
    half_width, compliance = scene.slip_torque[1], scene.slip_compliance[1]
    place = play(torques, half_width)[motion.holds]
    error = np.array(slipped)[motion.holds] / compliance - place
    assert np.abs(place).max() > 2 * half_width
    assert np.abs(error).max() < 0.1 * half_width


def test_a_slipping_spring_needs_a_torque() -> None:
    with pytest.raises(ParameterError, match='slip_torque'):
        replace(scene_named('joint_slip'), slip_torque=(0.0, 0.0))
