"""Outcomes to report on, of simulated touches."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.model.cell import MEASURED_DISCS, PAPER_DISCS, Cell, Disc, Noise
from scara_kinetostatic.model.kinematics import forward, jacobian
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.model.touch import Rejection, TouchSet
from scara_kinetostatic.results import report
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # started in the background of a script; children inherit that
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Two processes, where pytest-xdist is installed and nothing else is asked for."""
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # as the command does; the processes inherit it
    is_worker = 'PYTEST_XDIST_WORKER' in os.environ
    if not is_worker and getattr(config.option, 'numprocesses', 0) is None and not config.option.usepdb:
        config.option.numprocesses, config.option.dist = 2, 'worksteal'


CELL = Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(joint=1e-5, force=0.3))
NASTY = ('<script>alert(1)</script>', '_x "q\' & $\\frac$', '日本')
"""Names that must come out as they are, in HTML, in SVG, past matplotlib's mathematics."""
NAMES = tuple(disc.name for disc in PAPER_DISCS)
GROWN = 1e-4
"""By which the radius of the second disc is larger than the cell says, m."""
TURN = 0.015
"""By which the forces are turned, rad."""

Make = Callable[..., Outcome]


def conclude_outcome(touches: TouchSet, cell: Cell, warnings: tuple[str, ...] = (), **fixed: float) -> Outcome:
    """The outcome of touches, one more of which was detected as bad."""
    calibration = calibrate(touches.replace(index=touches.index + 1), cell, fixed=fixed)
    diagnosis = diagnose(calibration)
    final = diagnosis.extended or calibration
    return Outcome(
        calibration=calibration,
        held_out=held_out_force_error(replace(calibration, used=final.used)),
        diagnosis=diagnosis,
        extended_held_out=held_out_force_error(final),
        found=len(touches) + 1,
        rejected=(Rejection(0, f'never settles near {cell.discs[0].name}'), *final.rejected),
        sources=(f'{cell.discs[1].name}.bag',),
        warnings=warnings,
    )


def spoilt(touches: TouchSet) -> TouchSet:
    """The same with one touch gone wrong."""
    joints = touches.joints.copy()
    joints[7] += 1e-3
    return touches.replace(joints=joints)


def slid_one_way(touches: TouchSet) -> TouchSet:
    """Forces turned, and every touch slid in the same sense: a turned sensor, or friction."""
    c, s = np.cos(TURN), np.sin(TURN)
    inward = CELL.centers[touches.disc] - forward(PAPER_NOMINAL, touches.joints)
    aside = np.stack([-inward[:, 1], inward[:, 0]], axis=-1)
    press = 0.05 * np.linalg.solve(jacobian(PAPER_NOMINAL, touches.joints), aside[..., None])[..., 0]
    return touches.replace(force=touches.force @ np.array([[c, s], [-s, c]]), press=press)


def leaking(touches: TouchSet) -> TouchSet:
    """Joint 2 leaks into joint 1: nothing on the list does that."""
    joints = touches.joints.copy()
    joints[:, 0] += 1.5e-4 * np.sin(2 * joints[:, 1])
    return touches.replace(joints=joints)


@contextmanager
def page_left_out() -> Iterator[None]:
    """The page of a calibration, which takes most of the time, is not drawn."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(report, 'html_text', lambda _: 'page')
        yield


@pytest.fixture
def without_page() -> Iterator[None]:
    with page_left_out():
        yield


@pytest.fixture(scope='session')
def make() -> Make:
    """Makes outcomes of 36 touches of a robot without effects, one of them detected as bad, one spoilt."""

    def outcome(
        levels: tuple[float, ...] = (10.0, 25.0, 40.0),
        names: tuple[str, ...] = (),
        discs: tuple[Disc, ...] = PAPER_DISCS,
        **fixed: float,
    ) -> Outcome:
        discs = tuple(disc._replace(name=name) for disc, name in zip(discs, names or NAMES, strict=True))
        cell = replace(CELL, discs=discs)
        touches = simulate_touches(cell, PAPER_ACTUAL, default_plan(cell, 6, levels), seed=2)
        return conclude_outcome(spoilt(touches), cell, ('the zero of the force sensor changes by 1.5 N',), **fixed)

    return outcome


@pytest.fixture(scope='session')
def plain(make: Make) -> Outcome:
    """Nothing special."""
    return make()


@pytest.fixture(scope='session')
def confounded(make: Make) -> Outcome:
    """One force level, measured discs, l1 fixed."""
    return make(levels=(40.0,), discs=MEASURED_DISCS, l1=0.3302)


@pytest.fixture(scope='session')
def nasty(make: Make) -> Outcome:
    """Names with markup in them."""
    return make(names=NASTY)


@pytest.fixture(scope='session')
def grown() -> Outcome:
    """The disc with the nastiest name is larger than the cell says: one effect, which is found."""
    true, discs = (
        replace(CELL, discs=tuple(d._replace(name=name) for d, name in zip(discs, NASTY, strict=True)))
        for discs in (
            (PAPER_DISCS[0], PAPER_DISCS[1]._replace(radius=PAPER_DISCS[1].radius + GROWN), PAPER_DISCS[2]),
            PAPER_DISCS,
        )
    )
    return conclude_outcome(simulate_touches(true, PAPER_ACTUAL, default_plan(CELL, 12), seed=1), discs)


@pytest.fixture(scope='session')
def ambiguous() -> Outcome:
    """Friction or a turned sensor: these touches cannot tell."""
    return conclude_outcome(slid_one_way(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL, 12), seed=1)), CELL)


@pytest.fixture(scope='session')
def unnamed() -> Outcome:
    """An effect that nobody listed."""
    return conclude_outcome(leaking(simulate_touches(CELL, PAPER_ACTUAL, default_plan(CELL, 12), seed=1)), CELL)
