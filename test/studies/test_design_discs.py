"""Places for discs: the even spread in batch, one more disc, the search."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.model.cell import PAPER_DISCS, Cell, Disc, Noise
from scara_kinetostatic.model.parameters import PAPER_NOMINAL
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.studies.design.layouts import (
    INFEASIBLE,
    TouchPattern,
    evaluate_layouts,
    even_touches,
    map_additional_disc,
    overlap,
    place_discs,
)
from scara_kinetostatic.studies.design.prediction import Region, Robot, exact_plan, free_tip, make_workspace

ROBOT = Robot.of(Cell(PAPER_NOMINAL, PAPER_DISCS, noise=Noise(1e-5, 0.3)))
TIP = free_tip(ROBOT, make_workspace(ROBOT, radii=3, angles=12))
LAYOUT = np.array([disc[1:4] for disc in PAPER_DISCS])


def values(layout):
    return evaluate_layouts(ROBOT, np.array(layout)[None], TIP, TouchPattern(), 36, Region())[0]


def test_touches_left_out_are_those_a_plan_leaves_out():
    others = np.stack([np.delete(LAYOUT, i, axis=0) for i in range(3)])
    spread = even_touches(ROBOT, LAYOUT, others, TouchPattern(points=12, levels=(40.0,)))
    plan = default_plan(ROBOT.cell, levels=(40.0,))
    kept = plan.disc[(exact_plan(ROBOT, plan).arms >= 0.02).all(axis=1)]
    np.testing.assert_allclose(spread.share, np.bincount(kept) / 24)


def test_turning_a_layout_about_the_base_changes_nothing():
    turned = LAYOUT.copy()
    turned[:, :2] = LAYOUT[:, :2] @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert values(turned) == pytest.approx(values(LAYOUT), rel=1e-6)


def test_layouts_that_cannot_be():
    assert values([[0.0, 0.4, 0.1], [0.1, 0.4, 0.1]]) > INFEASIBLE
    assert values([[0.0, 0.1, 0.1], [0.0, 0.5, 0.05]]) > INFEASIBLE
    assert overlap(ROBOT, np.array([[[0.0, 0.4, 0.1], [0.3, 0.4, 0.1]]]))[0] == 0
    outside = evaluate_layouts(ROBOT, LAYOUT[None], TIP, TouchPattern(), 36, Region(x_min=0.0))
    assert outside[0] > INFEASIBLE


def test_discs_placed_anew_are_better_and_repeat():
    first, again = (
        place_discs(ROBOT, 2, (0.05, 0.15), TIP, pattern=TouchPattern(points=12), generations=25) for _ in range(2)
    )
    assert first == again
    assert first is not None
    assert first.largest < 0.6 * values(LAYOUT)
    assert overlap(ROBOT, np.array([[disc[1:4] for disc in first.discs]]))[0] < 2e-3
    assert all(isinstance(disc, Disc) and 0.05 <= disc.radius <= 0.15 for disc in first.discs)


def test_map_of_one_more_disc():
    found = map_additional_disc(ROBOT, TIP, pattern=TouchPattern(points=12), radius=0.05, grid=15)
    assert np.nanmin(found.largest) < 0.7 * found.without
    taken = np.hypot(found.x[None] + 0.25, found.y[:, None] - 0.30) < 0.15
    assert np.isnan(found.largest[taken]).all()
