"""Outlines are split into the lines and arcs that they are made of, each within its uncertainty."""

from __future__ import annotations

import numpy as np
import pytest
from contour.slides import SQUARE, arm, traced

from scara_kinetostatic.contour.fits import divided, fit_pieces, fit_shape
from scara_kinetostatic.contour.report import fit_sections
from scara_kinetostatic.contour.result import Outline
from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.simulation.slides import polygon


@pytest.fixture(scope='module')
def square():
    return traced((0, 1.03), outline=SQUARE, speed=0.03)


def test_a_rounded_square(square):
    fits = fit_pieces(square, arm())
    assert [fit.shape for fit in fits] == ['line', 'arc'] * 4
    assert [fit.piece for fit in fits] == list(range(8))
    for fit in fits:
        assert fit.fits
        assert fit.rms < 1e-5
    for line in fits[::2]:
        angle = line.value('normal_angle')
        true = round(angle.value / (np.pi / 2)) * np.pi / 2
        assert abs(angle.value - true) < 3 * angle.std < 2e-3
        normal = np.array([np.cos(true), np.sin(true)])
        middle = np.array([line.value('x').value, line.value('y').value])
        assert abs((middle - (0.15, 0.35)) @ normal - 0.05) < 3 * line.value('x').std < 4e-5
        assert line.value('length').value == pytest.approx(0.08, abs=2e-3)
    for arc in fits[1::2]:
        radius = arc.value('radius')
        assert abs(radius.value - 0.01) < 3 * radius.std < 2e-4
        for name, middle in (('center_x', 0.15), ('center_y', 0.35)):
            item = arc.value(name)
            assert abs(abs(item.value - middle) - 0.04) < 3 * item.std
        assert arc.value('end').value - arc.value('begin').value == pytest.approx(np.pi / 2, abs=0.2)


def test_points_belong_to_one_piece_at_most(square):
    fits = fit_pieces(square, arm())
    assert np.sum([fit.points for fit in fits], axis=0).max() == 1
    lines, arcs = fit_sections(fits)
    assert (lines.title, arcs.title) == ('Outline 1: line', 'Outline 1: arc')
    assert [row[0] for row in lines.blocks[0].rows] == ['piece 1', 'piece 3', 'piece 5', 'piece 7']


def test_one_shape_alone():
    disc = traced((0, 1.03), speed=0.03)
    (fit,) = fit_pieces(disc, arm())
    assert fit.shape == 'circle'
    assert fit.value('radius').value == pytest.approx(fit_shape(disc, arm(), 'circle').value('radius').value, abs=1e-6)
    line = polygon([[0.1, 0.35], [0.25, 0.3]], closed=False)
    (edge,) = fit_pieces(traced((0, 1), outline=line, speed=0.03), arm())
    assert edge.shape == 'line'
    assert edge.value('length').value == pytest.approx(np.hypot(0.15, 0.05), abs=2e-3)


def test_sharp_edges():
    corner = polygon([[0.10, 0.30], [0.20, 0.30], [0.20, 0.40]], closed=False)
    lines = fit_pieces(traced((0, 1), outline=corner, speed=0.03), arm())
    assert [fit.shape for fit in lines] == ['line', 'line']
    normals = [(np.cos(a), np.sin(a)) for a in (fit.value('normal_angle').value for fit in lines)]
    offsets = [np.dot(n, [fit.value('x').value, fit.value('y').value]) for n, fit in zip(normals, lines, strict=True)]
    np.testing.assert_allclose(np.linalg.solve(normals, offsets), (0.2, 0.3), atol=3e-5)


def test_the_division_is_that_of_least_cost():
    """Nodes of two lines under an angle: the break is theirs, whatever node a closed outline begins with."""
    side = np.linspace(0, 0.02, 40, endpoint=False)
    zero = np.zeros(40)
    ring = np.concatenate([
        np.column_stack([side, zero]), np.column_stack([zero + 0.02, side]),
        np.column_stack([0.02 - side, zero + 0.02]), np.column_stack([zero, 0.02 - side]),
    ])  # fmt: skip
    for shift in (0, 17):
        outline = Outline(np.roll(ring, shift, axis=0), np.ones((160, 2)), np.full(160, 5e-6), closed=True)
        pieces = divided(outline)
        assert not any(is_arc for _, is_arc in pieces)
        assert all(39 <= len(nodes) <= 41 for nodes, _ in pieces)
        assert sorted(np.concatenate([nodes for nodes, _ in pieces])) == list(range(160))
        coarse = divided(outline, 40)
        assert len(coarse) == 4
        assert sorted(np.concatenate([nodes for nodes, _ in coarse])) == list(range(160))
    bent = ring[:80] + 0.0
    bent[40:] = np.column_stack([side + 0.02, 0.0015 * side])
    whole = Outline(bent, np.ones((80, 2)), np.full(80, 1.0), closed=False)
    assert len(divided(whole)) == 1, 'within the uncertainty of the nodes'


def test_what_there_is_not(square):
    for number in (3, -1):
        with pytest.raises(ParameterError, match=f'expected 0 to 0, got {number}'):
            fit_pieces(square, arm(), number)
    with pytest.raises(ParameterError, match='expected circle, arc, line'):
        fit_shape(square, arm(), 'square')
