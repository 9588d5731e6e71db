"""Calibrations and touches of simulated robots."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmark.common import record_of as as_record
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.interface import simulate
from scara_kinetostatic.model.cell import PAPER_CELL, PAPER_DISCS, Cell, Uncertainty
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, Parameters
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.monitoring.record import CalibrationRecord

CELL = replace(PAPER_CELL, discs=PAPER_DISCS)
DECLARED = replace(
    CELL,
    discs=tuple(disc._replace(center_std=1.5e-5, radius_std=5e-6) for disc in CELL.discs),
    uncertainty=Uncertainty(radius=5e-6, force_gain=0.005, force_rotation=1e-3, nominal={'l1': 1e-3}),
)
TRUTH = PAPER_ACTUAL


def moved(**changes: float) -> Parameters:
    """The robot with other values."""
    return TRUTH.replace(**{name: getattr(TRUTH, name) + change for name, change in changes.items()})


def touches_of(
    cell: Cell, seed: int, truth: Any = TRUTH, effects: tuple[str, ...] = (), world: int | None = 0, count: int = 12
) -> TouchSet:
    """Touches in a random order, in the world whose errors have the seed `world`."""
    made = simulate(cell, truth, seed=seed, drawn=world, effects=effects, per_disc=count)
    return made.select(np.random.default_rng(seed).permutation(len(made)))


def record_of(cell: Cell, *which: Any, **more: Any) -> CalibrationRecord:
    """The calibration by such touches."""
    return as_record(calibrate(touches_of(cell, *which, **more), cell))


def std_of(record: CalibrationRecord, name: str) -> float:
    """Standard uncertainty of a value of the model or an error of the cell."""
    return float(np.sqrt(record.covariance[record.place(name), record.place(name)]))
