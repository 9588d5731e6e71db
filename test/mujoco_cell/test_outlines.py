"""A block in the engine: the model explains the touches of its edges and corners."""

from dataclasses import replace

import numpy as np
import pytest
from mujoco_cell.conftest import BRISK, CELL

from benchmark.engine_touches import as_touches, with_noise
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.model.cell import Noise
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.simulation.mujoco.engine import SCENES, build
from scara_kinetostatic.simulation.mujoco.streams import TouchController
from scara_kinetostatic.simulation.plan import default_plan

BLOCK = Outline('block', ((-0.03, 0.34), (0.07, 0.34), (0.07, 0.44), (-0.03, 0.44)), 0.003)
WITH_BLOCK = replace(CELL, discs=(CELL.discs[0], BLOCK), tip_radius=0.005)


def test_the_model_explains_a_block() -> None:
    plan = default_plan(WITH_BLOCK, 12, preload=0.3)
    plan = plan.select(np.arange(len(plan)) % 3 < 2)
    motion = TouchController(SCENES['plain'], WITH_BLOCK, plan, BRISK).run()
    touches = as_touches(motion, WITH_BLOCK, plan)
    exact = calibrate(touches, WITH_BLOCK)
    assert exact.used.all()
    touched = exact.touches.surface[exact.touches.disc == 1]
    assert len(set(touched.tolist())) >= 4
    assert (~WITH_BLOCK.surfaces.is_edge[touched]).sum() >= 2
    assert np.abs(exact.residual).max() < 0.02  # N
    noisy = calibrate(
        with_noise(touches, WITH_BLOCK, Noise(1e-5, 0.3), seed=3), replace(WITH_BLOCK, noise=Noise(1e-5, 0.3))
    )
    error = (noisy.parameters.as_array() - PAPER_ACTUAL.as_array()) / noisy.std
    assert np.abs(error).max() < 4


def test_an_inner_corner_is_refused() -> None:
    ell = Outline('ell', ((0.1, 0.3), (0.3, 0.3), (0.3, 0.36), (0.2, 0.36), (0.2, 0.45), (0.1, 0.45)), 0.008)
    with pytest.raises(ParameterError, match='inner corner'):
        build(SCENES['plain'], replace(CELL, discs=(CELL.discs[0], ell), tip_radius=0.005))
