"""Figures outside a page."""

from __future__ import annotations

from xml.etree import ElementTree

from scara_kinetostatic.report.figure import SERIES, as_svg, light_colours, new_figure, style, svg_file


def test_a_file_has_the_colours_written_in() -> None:
    with style():
        figure, (axes,) = new_figure(300, 200)
        axes.plot([1, 2], color=SERIES[1])
        text = svg_file(as_svg(figure, 'one', 'a line'))
    assert 'var(--' not in text
    assert light_colours()[SERIES[1]] in text
    assert ElementTree.fromstring(text).get('width') == '300'
