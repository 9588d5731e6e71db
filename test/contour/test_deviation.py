"""A traced contour is compared with the object of the cell along which the tip slid, as it stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from contour.slides import CELL, SQUARE, traced

from scara_kinetostatic.contour.fits import deviations, of_all_points
from scara_kinetostatic.contour.report import contour_document, contour_report
from scara_kinetostatic.model.cell import Disc
from scara_kinetostatic.model.outline import Outline
from scara_kinetostatic.report import as_text
from scara_kinetostatic.simulation.slides import polygon

BLOCK = Outline('block', ((0.10, 0.30), (0.20, 0.30), (0.20, 0.40), (0.10, 0.40)), 0.01)
WITH_BLOCK = replace(CELL, discs=(Disc('far', -0.25, 0.30, 0.15), BLOCK))


def test_a_side_that_stands_50_um_elsewhere():
    square = polygon([[0.10, 0.30], [0.20005, 0.30], [0.20005, 0.40], [0.10, 0.40]], 0.01)
    contour = traced((0, 1.03), outline=square, speed=0.03)
    (found,) = deviations(contour, WITH_BLOCK)
    assert (found.outline, found.object, len(found.points)) == (0, 'block', len(contour))
    x, y = contour.surface[found.points].T
    moved = (x > 0.199) & (np.abs(y - 0.35) < 0.039)
    kept = (x < 0.189) & ((np.abs(y - 0.35) > 0.049) | (x < 0.101))
    for side, true in ((moved, 5e-5), (kept, 0.0)):
        assert side.sum() > 100
        assert np.mean(np.abs(found.distance[side] - true) < 1.96 * found.std[side]) > 0.9
    k = found.largest
    assert contour.surface[found.points[k], 0] > 0.19
    assert 5e-5 - 2 * found.std[k] < found.distance[k] < 5e-5 + 4 * found.std[k]
    assert found.rms == pytest.approx(2.6e-5, abs=5e-6)
    assert found.misfit > 3
    text = as_text(contour_report(contour, [], [found], ''))
    assert 'Outline 1 lies along block of the cell description: at most' in text and 'outside of it' in text
    (stored,) = contour_document(contour, [], [found])['deviations']
    assert stored['largest']['value'] == found.distance[k] and stored['object'] == 'block'


def test_a_disc_and_another_tip():
    contour = traced((0, 0.4), speed=0.03)
    for tip, radius in ((0.005, 0.065), (0.004, 0.064)):  # the radius of a disc contains that of the tip
        cell = replace(CELL, tip_radius=tip, discs=(Disc('left', -0.25, 0.30, 0.15), Disc('disc', 0.2, 0.3, radius)))
        (found,) = deviations(contour, cell)
        assert found.object == 'disc'
        assert np.mean(np.abs(found.distance) < 1.96 * found.std) > 0.9
        assert 0.5 < found.misfit < 1.3
    smaller = replace(CELL, discs=(Disc('disc', 0.2, 0.3, 0.0649),))
    assert np.median(deviations(contour, smaller)[0].distance) == pytest.approx(1e-4, abs=1e-5)


def test_what_is_not_an_object_of_the_cell_is_not_compared():
    contour = traced((0, 0.3), outline=SQUARE, speed=0.03)
    elsewhere = replace(CELL, discs=(BLOCK.moved((0.02, 0.02)),))
    assert deviations(contour, elsewhere) == ()
    assert np.isnan(of_all_points(contour, ())).all()


def test_beyond_an_open_end_nothing_is_compared():
    contour = traced((0, 1), outline=polygon([[0.10, 0.30], [0.20, 0.30]], closed=False), speed=0.03)
    edge = Outline('edge', ((0.10, 0.30), (0.18, 0.30)), is_open=True)
    (found,) = deviations(contour, replace(CELL, discs=(edge,)))
    assert 0.17 < contour.surface[found.points, 0].max() < 0.1801
    assert np.abs(found.distance).max() < 4 * found.std.max()
    deviation = of_all_points(contour, [found])
    assert np.isnan(deviation).sum() == len(contour) - len(found.points) > 0
