"""The commanded cell in MuJoCo: the same class, another body."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np
import pytest

from scara_kinetostatic.errors import CellError
from scara_kinetostatic.model.cell import PAPER_CELL, Lift, SensorFrame
from scara_kinetostatic.model.kinematics import inverse, rotate
from scara_kinetostatic.model.kinetostatics import inverse_kinetostatics
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.commanded import Plant, PlantSettings, Reading
from scara_kinetostatic.simulation.mujoco import scene_named
from scara_kinetostatic.simulation.mujoco.commanded import EngineBody
from scara_kinetostatic.simulation.streams import SensorModel

CELL = replace(PAPER_CELL, lift=Lift('z', 0.02, 0.0))
DISC = CELL.discs[1]


def go(at: Plant, joints: np.ndarray, lift: float, duration: float) -> Reading:
    at.command(at.names, [duration], [[*joints, lift]])
    return at.step(at.time + duration + 0.3)


@pytest.mark.parametrize('frame', list(SensorFrame))
def test_a_pressed_tip_has_the_force_of_the_model(frame: SensorFrame) -> None:
    """The engine's joints come to rest where the model has them, frictionless, to 1 % of the force."""
    cell = replace(CELL, sensor=CELL.sensor._replace(frame=frame))
    at = Plant(cell, EngineBody(scene_named('plain'), cell), sensors=SensorModel.ideal(250.0))
    for angle in (-1.2, -2.0):
        out = np.array([np.cos(angle), np.sin(angle)])
        place = np.array([[DISC.x, DISC.y]]) + DISC.radius * out
        free = inverse(PAPER_ACTUAL, place + 0.01 * out, 1)[0]
        pressed = inverse_kinetostatics(PAPER_ACTUAL, place, -30.0 * out[None], np.array([1]), cell.gripper)[0][0]
        assert go(at, free, 0.02, 2.0).touched == ''
        assert go(at, free, 0.0, 0.3).touched == ''
        last = go(at, pressed, 0.0, 2.0)
        assert last.touched == 'disc_2'
        assert last.true_force == pytest.approx(-30.0 * out, abs=0.3)
        assert last.joints == pytest.approx([*at.body.joints, 0.0], abs=1e-6)
        angle_of_link = at.body._engine.link2_angle if frame is SensorFrame.TOOL else 0.0
        assert last.force == pytest.approx(rotate(np.array(last.true_force), -angle_of_link))
        go(at, free, 0.0, 1.0)
        assert go(at, free, 0.02, 0.3).true_force == (0.0, 0.0)


def test_without_a_lift_it_meets_the_disc_from_the_side_and_stops() -> None:
    cell = replace(CELL, lift=None)
    at = Plant(cell, EngineBody(scene_named('contact_friction'), cell), settings=PlantSettings(overload=100.0))
    way = np.array([[DISC.x - 0.02, DISC.y - DISC.radius - 0.04], [DISC.x - 0.02, DISC.y - DISC.radius + 0.03]])
    free, inside = inverse(PAPER_ACTUAL, way, np.array([1, 1]))
    at.command(at.names, [1.0], [free])
    assert at.step(1.5).touched == ''
    at.command(at.names, [0.4], [inside])
    last = at.step(2.5)
    assert last.touched == 'disc_2'
    assert at.stopped
    assert at.peak_force > 100 > hypot(*last.true_force) > 10, 'an impact, then at rest'
    at.reset()
    at.command(at.names, [0.5], [free])
    assert at.step(4.0).touched == ''


def test_obstacles_are_refused() -> None:
    cell = replace(CELL, obstacles=(((0.3, 0.0), (0.4, 0.0), (0.4, 0.1)),))
    with pytest.raises(CellError, match='discs only'):
        EngineBody(scene_named('plain'), cell)
