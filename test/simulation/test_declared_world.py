"""Worlds drawn from the declared uncertainties of a cell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import scara_kinetostatic as sk
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.observations import DeclaredErrors
from scara_kinetostatic.model.cell import PAPER_CELL, PAPER_DISCS, Cell, Noise, Plate, Uncertainty
from scara_kinetostatic.model.kinematics import rotate
from scara_kinetostatic.model.parameters import NAMES, PAPER_ACTUAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches
from scara_kinetostatic.simulation.truth import World

FIRST, *OTHERS = PAPER_CELL.discs
CELL = replace(
    PAPER_CELL,
    discs=(
        FIRST._replace(center_std=1.5e-5, radius_std=5e-6),
        *(disc._replace(center_std=3e-6, plate='a') for disc in OTHERS),
    ),
    plates=(Plate('a', 0.0, 0.3, 5e-5, 2e-4),),
    uncertainty=Uncertainty(5e-6, 0.005, 1e-3, {'l1': 2e-4, 'p1': 1e-6}),
)
"""Discs on a plate and beside it, a tip of uncertain radius, sensor and data sheet."""
EXACT = Noise(0.0, 0.0)


def declared(cell: Cell) -> DeclaredErrors:
    found = DeclaredErrors.of(cell)
    assert found is not None
    return found


def test_a_world_is_spread_as_declared() -> None:
    random = np.random.default_rng(1)
    worlds = [World.draw(CELL, random) for _ in range(1200)]
    centers = np.array([world.cell.centers for world in worlds]) - CELL.centers
    assert centers[:, 0].std(axis=0) == pytest.approx([1.5e-5, 1.5e-5], rel=0.07)
    arm = np.abs(CELL.centers[1] - (0.0, 0.3))[::-1]
    assert centers[:, 1].std(axis=0) == pytest.approx(np.sqrt(5e-5**2 + (2e-4 * arm) ** 2 + 3e-6**2), rel=0.07)
    radii = np.array([world.cell.radii for world in worlds]) - CELL.radii
    assert radii.std(axis=0) == pytest.approx([np.hypot(5e-6, 5e-6), 5e-6, 5e-6], rel=0.07)
    assert np.std([world.nominal_errors['l1'] for world in worlds]) == pytest.approx(2e-4, rel=0.07)


def test_the_sensor_reports_with_gain_and_rotation() -> None:
    errors = np.zeros(declared(CELL).count)
    errors[declared(CELL).places['force_gain']], errors[declared(CELL).places['force_rotation']] = 2.0, 1.0
    touches = sk.simulate(PAPER_CELL, PAPER_ACTUAL)
    reported = World.of(CELL, errors).reported(touches)
    wanted = 1.01 * rotate(touches.force, np.full(len(touches), 1e-3))
    assert reported.force == pytest.approx(wanted, rel=1e-9)


def test_an_exact_cell_is_as_described() -> None:
    exact = replace(PAPER_CELL, discs=PAPER_DISCS)
    assert World.draw(exact, np.random.default_rng(0)).cell == exact
    plain, drawn = (sk.simulate(exact, PAPER_ACTUAL, drawn=drawn) for drawn in (None, 3))
    assert np.array_equal(plain.force, drawn.force)


def test_what_is_drawn_is_trusted_unless_it_is_given() -> None:
    first, second = (sk.simulate(CELL, {'l1': 0.3302}, drawn=seed) for seed in (1, 2))
    assert not np.allclose(first.force, second.force, rtol=1e-3)
    again = sk.simulate(CELL, {'l1': 0.3302}, drawn=1)
    assert np.array_equal(again.joints, first.joints)


@pytest.mark.parametrize('label', [source.label for source in declared(CELL).prior.sources])
def test_a_source_moves_the_estimate_by_its_contribution(label: str) -> None:
    truth = World.of(CELL, None).robot(PAPER_ACTUAL).replace(l1=CELL.nominal.l1, p1=CELL.nominal.p1)
    own = declared(CELL)
    moved = []
    for place in own.places.get(label, [None]):
        errors = np.zeros(own.count)
        named = {}
        if place is None:
            named = {label[len('nominal[') : -1]: dict(CELL.uncertainty.nominal)[label[len('nominal[') : -1]]}
        else:
            errors[place] = 1.0
        world = World.of(CELL, errors, named)
        robot = truth.replace(**{name: getattr(CELL.nominal, name) + error for name, error in named.items()})
        touches = simulate_touches(world.cell, robot, default_plan(CELL, preload=0.3), EXACT)
        c = calibrate(world.reported(touches), CELL)
        moved.append(c.parameters.as_array() - robot.as_array())
    (part,) = [part for part in c.contributions if part.label == label]
    expected, found = np.sqrt(np.diag(part.covariance)), np.sqrt(np.sum(np.square(moved), axis=0))
    counts = expected > 0.01 * c.std
    assert found[counts] == pytest.approx(expected[counts], rel=0.05), [NAMES[k] for k in np.flatnonzero(counts)]
