"""The commanded cell in MuJoCo: the same class, another body."""

from __future__ import annotations

from dataclasses import replace
from math import hypot

import numpy as np
import pytest

from scara_kinetostatic.effects.contact_friction import YieldingFriction
from scara_kinetostatic.errors import CellError
from scara_kinetostatic.model.cell import PAPER_CELL, Lift, SensorFrame
from scara_kinetostatic.model.contact import contact
from scara_kinetostatic.model.effect_law import TouchMetadata
from scara_kinetostatic.model.extended_model import ExtendedModel
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


def test_friction_along_the_normal_is_that_of_an_arm_that_yields_aside() -> None:
    """Pressed along the normal the force is off it by up to 40 mrad; the law leaves a third of that.

    Where the tip hangs in the gap of the gripper at first, which nobody measures, is the rest.
    """
    scene = replace(scene_named('contact_friction'), contact_friction=0.04)
    at = Plant(CELL, EngineBody(scene, CELL), sensors=SensorModel.ideal(250.0))
    base, law = ExtendedModel(PAPER_ACTUAL), ExtendedModel(PAPER_ACTUAL, (YieldingFriction(),), ((0.04,),))
    off = []

    def follow(tips: np.ndarray, side: int, lift: float, duration: float) -> np.ndarray:
        joints = inverse(PAPER_ACTUAL, tips, np.full(len(tips), side))
        times = duration * np.arange(1, len(tips) + 1) / len(tips)
        at.command(at.names, times.tolist(), [[*q, lift] for q in joints])
        last = at.step(at.time + duration + 0.3)
        return np.array([*last.joints[:2], *last.true_force])

    for number in (0, 1):
        disc = CELL.discs[number]
        for angle in 0.3 + np.pi / 3 * np.arange(6):
            out = np.array([np.cos(angle), np.sin(angle)])
            line = [np.array([disc.x, disc.y]) + (disc.radius + np.linspace(*ends, 20)[:, None]) * out
                    for ends in ((0.01, 0.01), (0.01, 1e-4), (1e-4, -7e-4), (-7e-4, 0.01))]  # fmt: skip
            for side in (1, -1):
                follow(line[0], side, 0.02, 1.5)
                begin = follow(line[1], side, 0.0, 1.0)[:2]
                pressed = follow(line[2], side, 0.0, 1.0)
                follow(line[3], side, 0.0, 0.5)
                follow(line[0], side, 0.02, 0.3)
                metadata = TouchMetadata.plain(1)._replace(
                    disc=np.array([number]), press=(pressed[:2] - begin)[None], posture=np.array([side])
                )
                touch = pressed[None, :2], np.array([[disc.x, disc.y]]), np.array([disc.radius])
                for model in (base, law):
                    force = contact(model, *touch, CELL.gripper, metadata=metadata).force[0]
                    off.append(pressed[2:] - force)
    sizes = np.sqrt((np.array(off).reshape(-1, 2, 2) ** 2).sum(axis=-1).mean(axis=0))
    assert sizes[0] > 1.0
    assert sizes[1] < 0.4 * sizes[0]


def test_a_tip_that_slides_as_it_retracts_stays_in_contact_until_the_force_is_gone() -> None:
    """With contacts as hard as the engine makes them it bounces, and the force jumps by tens of newtons."""
    at = Plant(CELL, EngineBody(replace(scene_named('plain'), contact_friction=0.1), CELL))
    for side in (1, -1):
        for angle in (0.3, 1.9, 3.4, 5.0):
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
