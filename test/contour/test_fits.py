"""Fits give back shape and pieces of an outline; files hold the contour to the letter."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from contour.slides import SQUARE, arm, slides, traced

from scara_kinetostatic.contour.fits import divided, fit_pieces, fit_shape
from scara_kinetostatic.contour.report import contour_report, fit_sections
from scara_kinetostatic.contour.result import COLUMNS, Polyline, csv_text, dxf_text, svg_text
from scara_kinetostatic.contour.trace import trace_contour
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import rms
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import PAPER_ACTUAL
from scara_kinetostatic.report.page import as_text
from scara_kinetostatic.simulation.motion import SlideTiming
from scara_kinetostatic.simulation.plan import polygon


@pytest.fixture(scope='module')
def contour():
    return traced((0, 1.05))


def test_circle_and_a_shape_that_does_not_fit(contour):
    fit, line = (fit_shape(contour, arm(), shape) for shape in ('circle', 'line'))
    for name, true in (('center_x', 0.2), ('center_y', 0.3), ('radius', 0.06)):
        assert abs(fit.value(name).value - true) < 4 * fit.value(name).std < 4e-5
    assert fit.fits and fit.rms < 1e-5 and len(fit.residual) == len(contour)
    assert not line.fits and line.misfit > 1000
    assert 'Remark: the outline is no line' in as_text(contour_report(contour, [line], ''))
    assert 'Remark' not in as_text(contour_report(contour, [fit], ''))


def test_arc_and_line():
    fit = fit_shape(traced((0.1, 0.4)), arm(), 'circle')
    assert abs(fit.value('radius').value - 0.06) < 4 * fit.value('radius').std
    edge = polygon([[0.1, 0.35], [0.25, 0.3]], closed=False)
    straight = traced((0, 1), outline=edge)
    fit = fit_shape(straight, arm(), 'line')
    true = np.arctan2(-0.15, -0.05)
    assert abs(fit.value('normal_angle').value - true) < 4 * fit.value('normal_angle').std < 4e-4
    offset = np.array([fit.value('x').value, fit.value('y').value]) - (0.1, 0.35)
    assert abs(offset @ (np.cos(true), np.sin(true))) < 4e-5
    along = np.linspace(0, 0.1, len(straight))
    with pytest.raises(UnsupportedDataError, match='on no circle'):
        fit_shape(replace(straight, surface=np.column_stack([along, 0 * along])), arm(), 'circle')


@pytest.mark.parametrize('variation_time', [0.5, 1e3])
def test_noise_that_does_not_change_along_the_slide_is_covered(variation_time):
    exact = replace(arm(), model=ExtendedModel(PAPER_ACTUAL), covariance=np.zeros_like(arm().covariance))
    timing = SlideTiming(variation_time=variation_time)
    deviations = []
    for seed in range(3):
        streams = slides((0, 1.05), timing=timing, seed=seed)
        fit = fit_shape(trace_contour(streams, exact), exact, 'circle')
        truth = (('center_x', 0.2), ('center_y', 0.3), ('radius', 0.06))
        deviations += [(fit.value(name).value - true) / fit.value(name).std for name, true in truth]
    assert 0.5 < rms(np.array(deviations)) < 1.5


def test_what_the_calibration_does_not_determine_has_no_uncertainty(contour):
    fit = fit_shape(contour, replace(arm(), undetermined=np.eye(12)[:, :1] * 1e-3), 'circle')
    assert np.isnan(fit.value('center_x').std)
    assert np.isfinite(fit.value('radius').std)


def test_csv(contour):
    rows = list(csv.DictReader(io.StringIO(csv_text(contour))))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == len(contour)
    values = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    np.testing.assert_allclose(np.column_stack([values['x_m'], values['y_m']]), contour.surface, atol=1e-9)
    np.testing.assert_allclose(values['std_normal_m'], contour.std_normal, rtol=1e-3)
    np.testing.assert_allclose(values['force_N'], np.hypot(*contour.force.T), atol=1e-4)
    assert np.all(np.diff(values['time_s']) > 0)


def test_drawings_are_closed_and_in_millimetres(contour):
    pairs = dxf_text(contour.outlines).splitlines()
    codes, values = [int(code) for code in pairs[::2]], pairs[1::2]
    assert values[-1] == 'EOF'
    start = values.index('POLYLINE')
    assert (70, '1') in zip(codes[start : start + 4], values[start : start + 4], strict=True)
    vertices = [k for k, value in enumerate(values) if value == 'VERTEX']
    points = np.array([[float(values[k + 2]), float(values[k + 3])] for k in vertices])
    np.testing.assert_allclose(points, 1e3 * contour.outlines[0].points, atol=1e-6)
    root = ElementTree.fromstring(svg_text(contour.outlines))
    assert root.attrib['width'].endswith('mm')
    (path,) = root.iter('{http://www.w3.org/2000/svg}path')
    assert path.attrib['d'].endswith('Z')
    numbers = [float(word) for word in path.attrib['d'].replace('M', ' ').replace('L', ' ').replace('Z', ' ').split()]
    drawn = np.array(numbers).reshape(-1, 2)
    assert np.ptp(drawn, axis=0) == pytest.approx([120.0, 120.0], abs=0.1)


@pytest.fixture(scope='module')
def square():
    return traced((0, 1.03), outline=SQUARE, speed=0.03)


def test_a_rounded_square(square):
    fits = fit_pieces(square, arm())
    assert np.sum([fit.points for fit in fits], axis=0).max() == 1
    sections = fit_sections(fits)
    assert [section.title for section in sections] == ['Outline 1: line', 'Outline 1: circle']
    assert [row[0] for row in sections[0].blocks[0].rows] == ['piece 1', 'piece 3', 'piece 5', 'piece 7']
    assert [fit.shape for fit in fits] == ['line', 'circle'] * 4
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
    for arc in fits[1::2]:
        radius = arc.value('radius')
        assert abs(radius.value - 0.01) < 3 * radius.std < 2e-4
        for name, middle in (('center_x', 0.15), ('center_y', 0.35)):
            item = arc.value(name)
            assert abs(abs(item.value - middle) - 0.04) < 3 * item.std


def test_one_shape_alone():
    disc = traced((0, 1.03), speed=0.03)
    (fit,) = fit_pieces(disc, arm())
    assert fit.shape == 'circle'
    assert fit.value('radius').value == pytest.approx(fit_shape(disc, arm(), 'circle').value('radius').value, abs=1e-6)
    line = polygon([[0.1, 0.35], [0.25, 0.3]], closed=False)
    (edge,) = fit_pieces(traced((0, 1), outline=line, speed=0.03), arm())
    assert edge.shape == 'line'


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
        outline = Polyline(np.roll(ring, shift, axis=0), np.ones((160, 2)), np.full(160, 5e-6), closed=True)
        pieces = divided(outline)
        assert not any(is_arc for _, is_arc in pieces)
        assert all(39 <= len(nodes) <= 41 for nodes, _ in pieces)
        assert sorted(np.concatenate([nodes for nodes, _ in pieces])) == list(range(160))
        assert sorted(np.concatenate([nodes for nodes, _ in divided(outline, 40)])) == list(range(160))
    bent = ring[:80] + 0.0
    bent[40:] = np.column_stack([side + 0.02, 0.0015 * side])
    whole = Polyline(bent, np.ones((80, 2)), np.full(80, 1.0), closed=False)
    assert len(divided(whole)) == 1, 'within the uncertainty of the nodes'


def test_what_there_is_not(square):
    for number in (3, -1):
        with pytest.raises(ParameterError, match=f'expected 0 to 0, got {number}'):
            fit_pieces(square, arm(), number)
    with pytest.raises(ParameterError, match='expected circle, line'):
        fit_shape(square, arm(), 'square')
