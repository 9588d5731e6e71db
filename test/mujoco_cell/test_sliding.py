"""The tip slides in MuJoCo, an independent engine: force held, friction found, surface found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contour.slides import CELL, OBJECTS, arm

from benchmark.common import normal_error
from benchmark.engine_slides import SlideController
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.motion import SlidePhase
from scara_kinetostatic.simulation.mujoco.engine import Scene
from scara_kinetostatic.simulation.plan import Slide
from scara_kinetostatic.simulation.streams import SensorModel, recorded

NO_BACKLASH = PAPER_ACTUAL.replace(g_ee=0.0, g1=0.0, g2=0.0)
LIMIT = 4e-6
"""Of the error along the normal, m: the contact yields by 1.5 µm at most, the force is smoothed."""


@pytest.mark.parametrize(
    ('name', 'robot', 'friction'),
    [('disc', NO_BACKLASH, 0.0), ('rounded square', PAPER_ACTUAL, 0.1)],
    ids=['smooth disc', 'square, backlash'],
)
def test_surface_in_another_engine(name, robot, friction):
    """The tip slides without vibration, and the contour is found, with friction and backlash."""
    outline = OBJECTS[name]
    scene = Scene(parameters=robot, contact_friction=friction)
    motion = SlideController(scene, CELL, Slide(outline, 15, speed=0.03, begin=0.13, end=0.2)).run()
    force = np.hypot(*motion.force[motion.phase == SlidePhase.SLIDE].T)[-500:]
    assert force.mean() == pytest.approx(15 * np.hypot(1, friction), rel=0.05)
    assert np.abs(np.diff(force)).max() < 0.5
    exact = replace(arm(), model=ExtendedModel(robot))
    contour = trace_contour(recorded('engine', CELL, robot, motion, SensorModel.ideal(200), 0), exact)
    assert contour.friction.coefficient == pytest.approx(friction, abs=0.01)
    assert rms(normal_error(outline, contour.surface)) < LIMIT
