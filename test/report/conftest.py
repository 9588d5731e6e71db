"""Outcomes to report on, of simulated touches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Noise
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.model.touch import Rejection
from scara_kinetostatic.pipeline import Outcome
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
NASTY = ('<script>alert(1)</script>', '_x "q\' & $\\frac$', '日本')
"""Names that must come out as they are, in HTML, in SVG, past matplotlib's mathematics."""

Make = Callable[..., Outcome]


@pytest.fixture(scope='session')
def make() -> Make:
    """Makes outcomes of 36 touches, one of them detected as bad, one spoilt."""

    def outcome(levels: tuple[float, ...] = (10.0, 25.0, 40.0), names: tuple[str, ...] = (), **fixed: float) -> Outcome:
        discs = tuple(disc._replace(name=name) for disc, name in zip(PAPER_DISCS, names or NAMES, strict=True))
        cell = replace(CELL, discs=discs)
        touches = simulate_touches(cell, PAPER_ACTUAL, default_plan(cell, 6, levels), seed=1)
        joints = touches.joints.copy()
        joints[7] += 1e-3
        calibration = calibrate(touches.replace(joints=joints, index=touches.index + 1), cell, fixed=fixed)
        rejected = (Rejection(0, f'never settles near {discs[0].name}'), *calibration.rejected)
        return Outcome(
            calibration=calibration,
            held_out=held_out_force_error(calibration),
            diagnosis=diagnose(calibration),
            found=len(touches) + 1,
            rejected=rejected,
            sources=(f'{discs[1].name}.bag',),
            warnings=('the zero of the force sensor changes by 1.5 N',),
        )

    return outcome


NAMES = tuple(disc.name for disc in PAPER_DISCS)


@pytest.fixture(scope='session')
def plain(make: Make) -> Outcome:
    """Nothing special."""
    return make()


@pytest.fixture(scope='session')
def confounded(make: Make) -> Outcome:
    """One force level, l1 fixed."""
    return make(levels=(40.0,), l1=0.3302)


@pytest.fixture(scope='session')
def nasty(make: Make) -> Outcome:
    """Names with markup in them."""
    return make(names=NASTY)
