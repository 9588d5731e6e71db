"""The tip slides in MuJoCo, an independent engine: force held, friction found, surface found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contour.slides import CELL, OBJECTS, arm

from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.mujoco.scene import Scene
from scara_kinetostatic.simulation.mujoco.sliding import SlideController
from scara_kinetostatic.simulation.sensors import SensorModel
from scara_kinetostatic.simulation.sliding.motion import SLIDE
from scara_kinetostatic.simulation.sliding.slide import Slide
from scara_kinetostatic.simulation.sliding.streams import sensed

NO_BACKLASH = PAPER_ACTUAL.replace(g_ee=0.0, g1=0.0, g2=0.0)


@pytest.mark.parametrize('name', OBJECTS)
@pytest.mark.parametrize(('friction', 'limit'), [(0.0, 1e-5), (0.1, 4e-5)], ids=['smooth', 'friction'])
def test_surface_in_another_engine(name, friction, limit):
    """Without backlash: with it, and with friction, the contour is off by tens of µm; why is not known."""
    outline = OBJECTS[name]
    scene = Scene(parameters=NO_BACKLASH, contact_friction=friction)
    motion = SlideController(scene, CELL, Slide(outline, 15, 0.0, 0.02, begin=0.13, end=0.2)).run()
    force = np.hypot(*motion.force[motion.phase == SLIDE].T)
    assert force.mean() == pytest.approx(15 * np.hypot(1, friction), rel=0.05)
    exact = replace(arm(), model=ExtendedModel(NO_BACKLASH))
    contour = trace_contour(sensed(motion, CELL, SensorModel.ideal(200), 0), exact)
    assert contour.friction.coefficient == pytest.approx(friction, abs=0.01)
    assert rms(outline.normal_error(contour.surface)) < limit
    ball = motion.state_at(contour.time).tip
    assert rms(((contour.tip - ball) * contour.normal).sum(axis=1)) < limit
