"""Passes in any order, direction and number give one outline, which lies on the surface."""

from __future__ import annotations

import numpy as np
import pytest

from scara_kinetostatic.contour.result import Polyline, Stretch, join_passes

RADIUS, STEP, NOISE = 0.06, 2.5e-4, 5e-6
TURN = 2 * np.pi * RADIUS


def stretch(begin: float, end: float, seed: int = 0, radius: float = RADIUS) -> Stretch:
    """A pass along a disc, from one part of a turn to another."""
    count = round(abs(end - begin) * 2 * np.pi * radius / STEP)
    angle = 2 * np.pi * np.linspace(begin, end, count)
    normal = np.column_stack([np.cos(angle), np.sin(angle)])
    away = radius + np.random.default_rng([seed, count]).normal(0, NOISE, count)
    return Stretch(away[:, None] * normal, normal, np.full(count, 2 * NOISE), np.full(count, NOISE))


def check(outlines: tuple[Polyline, ...], closed: bool, turns: float) -> None:
    (outline,) = outlines
    assert outline.closed is closed
    assert outline.length == pytest.approx(turns * TURN, rel=2e-3)
    assert np.abs(np.hypot(*outline.points.T) - RADIUS).max() < 4 * NOISE
    assert len(outline.points) < outline.length / 4e-4


@pytest.mark.parametrize('turns', [0.95, 1.05, 2.05])
def test_a_pin_that_is_thinner_than_a_gap_is_closed(turns: float) -> None:
    (outline,) = join_passes([stretch(0.0, turns, radius=0.002)])
    assert outline.closed
    assert outline.length == pytest.approx(2 * np.pi * 0.002, rel=0.02)


@pytest.mark.parametrize(
    'parts',
    [
        [(0, 0.6), (0.55, 1.02)],
        [(0, 0.6), (1.02, 0.55)],
        [(0, 0.4), (0.35, 0.7), (0.65, 1.05)],
        [(0, 0.3), (0.25, 1.5)],
        [(0, 2.03)],
        [(0, 1.02), (1.0, 0.0), (0, 1.02)],
    ],
)
def test_closed_by_what_overlaps_at_both_ends(parts: list[tuple[float, float]]) -> None:
    check(join_passes([stretch(*part) for part in parts]), closed=True, turns=1.0)


def test_a_pass_that_bridges_two_outlines() -> None:
    outlines = join_passes([stretch(*part) for part in ((0, 0.4), (0.5, 0.9), (0.38, 0.52))])
    check(outlines, closed=False, turns=0.9)
    assert outlines[0].passes == (0, 1, 2)


def test_any_order_and_direction() -> None:
    random = np.random.default_rng(1)
    for seed in range(8):
        begins = np.sort(random.uniform(0, 1, 5))
        ends = np.append(begins[1:], begins[0] + 1) + random.uniform(0.01, 0.1, 5)
        parts = [(a, b) if random.random() < 0.5 else (b, a) for a, b in zip(begins, ends, strict=True)]
        shuffled = [parts[k] for k in random.permutation(5)]
        check(join_passes([stretch(*part, seed) for part in shuffled]), closed=True, turns=1.0)


def test_a_place_of_unknown_uncertainty_stays_unknown() -> None:
    known, unknown = stretch(0, 0.3), stretch(0.2, 0.5)
    outlines = join_passes([known, unknown._replace(std=np.full_like(unknown.std, np.nan))])
    (outline,) = outlines
    assert np.isnan(outline.std).mean() == pytest.approx(0.6, abs=0.03)
    check(outlines, closed=False, turns=0.5)


def test_passes_that_do_not_overlap_stay_apart() -> None:
    assert [outline.closed for outline in join_passes([stretch(0, 0.3), stretch(0.6, 0.303)])] == [False, False]
    check(join_passes([stretch(0, 0.3), stretch(0.6, 0.295)]), closed=False, turns=0.6)


def test_passes_of_one_node_stay_apart() -> None:
    """Passes that are shorter than the distance of nodes."""
    normals, std = np.array([[0.0, 1.0]] * 2), np.full(2, 1e-5)
    passes = [Stretch(np.array([[x, 0.0], [x + 1e-4, 0.0]]), normals, std, std) for x in (0.0, 0.05)]
    assert len(join_passes(passes)) == 2
