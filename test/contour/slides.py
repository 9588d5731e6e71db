"""Simulated slides along objects that no calibration knows, and a calibrated arm."""

from __future__ import annotations

from functools import cache

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.model.arm import CalibratedArm
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.slides import circle, ellipse, polygon
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3), tip_radius=0.005)
DISC = circle((0.2, 0.3), 0.06)
ELLIPSE = ellipse((-0.1, 0.42), (0.08, 0.05), 0.3)
SQUARE = polygon([[0.10, 0.30], [0.20, 0.30], [0.20, 0.40], [0.10, 0.40]], 0.01)
OBJECTS = {'disc': DISC, 'ellipse': ELLIPSE, 'rounded square': SQUARE}


@cache
def arm(seed: int = 0) -> CalibratedArm:
    """A calibration from simulated touches of the paper's discs."""
    return CalibratedArm.of(calibrate(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL), seed=seed), CELL))
