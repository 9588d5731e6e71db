"""A small plan, and every scene played once."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from scara_kinetostatic.model.cell import MEASURED_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.simulation.motion import Timing
from scara_kinetostatic.simulation.mujoco import SimulatedMotion, TouchController, preload_plan
from scara_kinetostatic.simulation.mujoco.engine import scene_named
from scara_kinetostatic.simulation.plan import Plan

CELL = Cell(nominal=PAPER_NOMINAL, discs=MEASURED_DISCS, noise=Noise(joint=1e-5, force=0.3))
BRISK = Timing(travel=0.2, pause=0.02, approach=0.1, hold=0.15, release=0.05, retract=0.05, speed=6.0)


@pytest.fixture(scope='session')
def plan() -> Plan:
    """18 touches, or some less where the arm does not reach."""
    return preload_plan(CELL, per_disc=3)


@pytest.fixture(scope='session')
def few() -> Plan:
    """Three touches: both postures, all discs and forces, one with preload."""
    return preload_plan(CELL, per_disc=4).select(np.array([0, 10, 15]))


@pytest.fixture(scope='session')
def half(plan: Plan) -> Plan:
    """Every other one of them."""
    return plan.select(np.arange(0, len(plan), 2))


@pytest.fixture(scope='session')
def motion(plan: Plan) -> Callable[[str], SimulatedMotion]:
    """What the engine makes of the plan in a scene."""
    return cache(lambda name: TouchController(scene_named(name), CELL, plan, BRISK).run())


@pytest.fixture(scope='session')
def played_few(few: Plan) -> Callable[[str], SimulatedMotion]:
    """The same of three touches."""
    return cache(lambda name: TouchController(scene_named(name), CELL, few, BRISK).run())
