"""Markers are where the things are."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.model.cell import PAPER_CELL
from scara_kinetostatic.model.kinematics import forward
from scara_kinetostatic.model.parameters import PAPER_ACTUAL, PAPER_NOMINAL
from scara_kinetostatic.pipeline import calibrate_touches
from scara_kinetostatic.report.json_file import json_text
from scara_kinetostatic.report.markers import (
    UNUSED,
    Primitive,
    Scales,
    SeenTouch,
    Shape,
    arm_markers,
    object_markers,
    result_markers,
    touch_markers,
)
from scara_kinetostatic.results.calibration_json import as_document
from scara_kinetostatic.simulation.plan import default_plan
from scara_kinetostatic.simulation.streams import simulate_touches

DISCS = PAPER_CELL.discs
SCALES = Scales()
SEEN = {'q1_rad': '0.8', 'q2_rad': '2.1', 'fx_N': '-9.8', 'fy_N': '0.1', 'object': 'disc_2', 'accepted': 'true'}


def of(group: str, scene: list[Primitive], shape: Shape | None = None) -> list[Primitive]:
    return [item for item in scene if item.group == group and shape in (None, item.shape)]


def test_objects_are_where_the_cell_says() -> None:
    scene = object_markers(DISCS)
    for disc, marker in zip(DISCS, of('objects', scene, 'cylinder'), strict=True):
        assert marker.points[0][:2] == (disc.x, disc.y) and marker.size == 2 * disc.radius
    assert [item.text for item in of('objects', scene, 'text')] == [disc.name for disc in DISCS]


def test_the_arm_ends_at_the_tip() -> None:
    (links,) = of('nominal', arm_markers('nominal', PAPER_NOMINAL, (0.3, 0.9), UNUSED), 'strip')
    np.testing.assert_allclose(links.points[-1][:2], forward(PAPER_NOMINAL, (0.3, 0.9)), atol=1e-12)
    lengths = np.linalg.norm(np.diff(links.points, axis=0), axis=1)
    np.testing.assert_allclose(lengths, [PAPER_NOMINAL.l1, PAPER_NOMINAL.l2])


def test_a_force_ends_at_the_tip_and_is_as_long_as_it_is_large() -> None:
    touch = SeenTouch.from_values(SEEN | {'frame': 'base'}, PAPER_NOMINAL)
    assert touch is not None
    (arrow,) = of('forces', touch_markers([touch], PAPER_NOMINAL, DISCS, SCALES))
    tail, head = np.array(arrow.points)[:, :2]
    np.testing.assert_allclose(head, forward(PAPER_NOMINAL, (0.8, 2.1)))
    np.testing.assert_allclose(head - tail, SCALES.force * np.array([-9.8, 0.1]))
    (dot,) = touch_markers([touch._replace(accepted=False)], PAPER_NOMINAL, DISCS, SCALES)
    assert (dot.group, dot.shape, dot.colour) == ('rejected', 'dot', UNUSED)


def test_a_force_in_the_frame_of_the_tool_is_turned() -> None:
    nominal = PAPER_NOMINAL.replace(theta1=0.2, theta2=-0.1)
    touch = SeenTouch.from_values(SEEN | {'frame': 'tool'}, nominal)
    assert touch is not None
    c, s = np.cos(3.0), np.sin(3.0)
    np.testing.assert_allclose(touch.force, [-9.8 * c - 0.1 * s, -9.8 * s + 0.1 * c])
    for wrong in ({'q1_rad': ''}, {'fx_N': 'nan'}, {'q2_rad': 'x'}):  # a touch without a place is not drawn
        assert SeenTouch.from_values(SEEN | wrong, nominal) is None


MOVED = (8e-5, -1.2e-4)


@pytest.fixture(scope='module')
def displaced() -> dict[str, Any]:
    """disc_2 is not where the cell description says."""
    second = DISCS[1]
    true = replace(
        PAPER_CELL, discs=(DISCS[0], second._replace(x=second.x + MOVED[0], y=second.y + MOVED[1]), DISCS[2])
    )
    touches = simulate_touches(true, PAPER_ACTUAL, default_plan(PAPER_CELL), seed=1)
    return as_document(calibrate_touches(touches, PAPER_CELL))


def test_a_displaced_object_is_drawn_where_it_is(displaced: dict[str, Any]) -> None:
    scene = of('found', result_markers(displaced, DISCS, SCALES))
    (disc,), (arrow,) = (of('found', scene, shape) for shape in ('cylinder', 'arrow'))
    stated = np.array([DISCS[1].x, DISCS[1].y])
    np.testing.assert_allclose(np.array(disc.points[0][:2]) - stated, MOVED, atol=2e-5)
    assert disc.size == 2 * DISCS[1].radius
    tail, head = np.array(arrow.points)[:, :2]
    np.testing.assert_allclose(tail, stated)
    np.testing.assert_allclose(head - tail, SCALES.error * np.array(MOVED), atol=SCALES.error * 2e-5)


def test_another_radius_is_drawn(grown: Outcome) -> None:
    document, discs = as_document(grown), grown.final.cell.discs
    scene = of('found', result_markers(document, discs, SCALES))
    (disc,) = of('found', scene, 'cylinder')
    assert not of('found', scene, 'arrow')
    (effect,) = document['diagnosis']['effects']
    assert disc.size == 2 * (discs[1].radius + effect['parameters']['radius']['value'])


def test_residuals_start_at_the_tip_of_used_touches_and_words_say_what_was_found(displaced: dict[str, Any]) -> None:
    scene = result_markers(displaced, DISCS, SCALES)
    used = [one for one in displaced['touches']['fitted'] if one['used']]
    for one, line in zip(used, of('residuals', scene), strict=True):
        start, end = np.array(line.points)[:, :2]
        np.testing.assert_allclose(end - start, SCALES.residual * np.array(one['residual']), atol=1e-12)
    first, second, *_ = (item.text for item in of('summary', scene))
    assert first == f'{displaced["assessment"]["grade"]}; model: explained'
    assert second.startswith('object_position[disc_2]: x ')
    touches = {key: displaced['touches'][key] for key in ('found', 'used', 'rejected')}
    scene = result_markers(displaced | {'touches': touches}, DISCS, SCALES)
    assert not of('residuals', scene) and of('summary', scene)


@pytest.mark.parametrize('which', ['confounded', 'unnamed'])
def test_every_kind_of_result_can_be_shown(which: str, request: pytest.FixtureRequest) -> None:
    outcome: Outcome = request.getfixturevalue(which)
    document = json.loads(json_text(as_document(outcome)))
    scene = result_markers(document, outcome.final.cell.discs, SCALES)
    assert of('summary', scene)
    assert all(np.isfinite(item.points).all() and item.size >= 0 for item in scene)
