"""Simulated touches for the tests of the calibration."""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

NOISE = Noise(joint=1e-5, force=0.3)
EXACT = Noise(joint=0.0, force=0.0)
CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=NOISE)


def touches(truth, seed=0, *, noise=NOISE, cell=CELL, **plan):
    return simulate_touches(cell, truth, default_plan(cell, **plan), noise, seed)


def z_scores(truth, seeds, *, cell=CELL, **plan):
    """(k, 12) errors in units of the stated standard deviations, and the calibrations."""
    found = [calibrate(touches(truth, seed, cell=cell, **plan), cell) for seed in seeds]
    return np.array([(c.parameters.as_array() - truth.as_array()) / c.std for c in found]), found
