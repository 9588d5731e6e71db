"""The commanded cell in MuJoCo: the same class, another body."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np
import pytest

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.model.cell import PAPER_CELL, Lift, SensorFrame
from scara_kinetostatic.model.kinematics import inverse, rotate
from scara_kinetostatic.model.kinetostatics import drag, inverse_kinetostatics, press_aside
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.commanded import Plant, Reading
from scara_kinetostatic.simulation.mujoco import scene_named
from scara_kinetostatic.simulation.mujoco.engine import EngineBody
from scara_kinetostatic.simulation.streams import SensorModel

CELL = replace(PAPER_CELL, lift=Lift('z', 0.02, 0.0))
DISC = CELL.discs[1]


def go(at: Plant, joints: np.ndarray, lift: float, duration: float) -> Reading:
    at.command(at.names, [duration], [[*joints, lift]])
    return at.step(at.time + duration + 0.3)


def test_a_pressed_tip_has_the_force_of_the_model() -> None:
    """The engine's joints come to rest where the model has them, frictionless, to 1 % of the force."""
    cell = replace(CELL, sensor=CELL.sensor._replace(frame=SensorFrame.TOOL))
    at = Plant(cell, EngineBody(scene_named('plain'), cell), sensors=SensorModel.ideal(250.0))
    out = np.array([np.cos(-2.0), np.sin(-2.0)])
    place = np.array([[DISC.x, DISC.y]]) + DISC.radius * out
    free = inverse(PAPER_ACTUAL, place + 0.01 * out, 1)[0]
    pressed = inverse_kinetostatics(PAPER_ACTUAL, place, -30.0 * out[None], np.array([1]), cell.gripper_sign)[0][0]
    assert go(at, free, 0.02, 2.0).touched == ''
    assert go(at, free, 0.0, 0.3).touched == ''
    last = go(at, pressed, 0.0, 2.0)
    assert last.touched == 'disc_2'
    assert last.true_force == pytest.approx(-30.0 * out, abs=0.3)
    assert last.joints == pytest.approx([*at.body.joints, 0.0], abs=1e-6)
    assert last.force == pytest.approx(rotate(np.array(last.true_force), -at.body._engine.link2_angle))
    go(at, free, 0.0, 1.0)
    assert go(at, free, 0.02, 0.3).true_force == (0.0, 0.0)


def test_a_tip_that_is_dragged_aside_has_the_whole_friction() -> None:
    """Under the force, and as it eases, whatever the tip did before: the force is off the normal by the coefficient."""
    at = Plant(CELL, EngineBody(replace(scene_named('plain'), contact_friction=0.15), CELL))
    for angle, side in ((0.3, 1), (2.4, -1)):
        out = np.array([[np.cos(angle), np.sin(angle)]])
        place, other = np.array([[DISC.x, DISC.y]]) + DISC.radius * out, np.array([-out[0, 1], out[0, 0]])
        free, begin = (inverse(PAPER_ACTUAL, place + off * out, side)[0] for off in (0.01, 0.0))
        aside = drag(np.array([angle]), side)
        pressed = begin + press_aside(PAPER_ACTUAL, begin[None], -60 * out, aside)[0]
        eased = pressed + press_aside(PAPER_ACTUAL, pressed[None], 15 * out, -aside)[0]
        go(at, free, 0.02, 1.5)
        go(at, free, 0.0, 0.3)
        go(at, begin, 0.0, 0.5)
        for joints, least in ((pressed, 30.0), (eased, 20.0)):
            force = np.array(go(at, joints, 0.0, 1.0).true_force)
            assert np.hypot(*force) > least
            center = np.array([DISC.x, DISC.y]) - at.body._engine.tip
            turned = center[0] * force[1] - center[1] * force[0]
            assert turned / (center @ force) == pytest.approx(0.15 * np.sign(aside[0]), rel=0.02)
        assert np.sign((at.body._engine.tip - place[0]) @ other) == -np.sign(aside[0])
        go(at, free, 0.0, 0.5)
        go(at, free, 0.02, 0.3)


def test_a_tip_that_slides_as_it_retracts_stays_in_contact_until_the_force_is_gone() -> None:
    """With contacts as hard as the engine makes them it bounces, and the force jumps by tens of newtons."""
    at = Plant(CELL, EngineBody(replace(scene_named('plain'), contact_friction=0.1), CELL))
    for side, angle in ((-1, 1.9), (1, 3.4)):
        out = np.array([[np.cos(angle), np.sin(angle)]])
        place = np.array([[DISC.x, DISC.y]]) + DISC.radius * out
        free, pressed = (inverse(PAPER_ACTUAL, place + off * out, side)[0] for off in (0.01, -1.5e-3))
        go(at, free, 0.02, 1.5)
        go(at, free, 0.0, 0.3)
        assert hypot(*go(at, pressed, 0.0, 2.0).true_force) > 20.0
        at.command(at.names, [2.3], [[*free, 0.0]])  # 5 mm/s
        force = [hypot(*at.step(at.time + 0.004).true_force) for _ in range(600)]
        assert force[-1] == 0.0
        assert max(np.diff(force)) < 1.0
        go(at, free, 0.02, 0.3)


def test_obstacles_are_refused() -> None:
    cell = replace(CELL, obstacles=(((0.3, 0.0), (0.4, 0.0), (0.4, 0.1)),))
    with pytest.raises(CellError, match='discs only'):
        EngineBody(scene_named('plain'), cell)
