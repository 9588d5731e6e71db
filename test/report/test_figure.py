"""Figures on a page, and as files of their own."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from benchmark.svg import light_colours, svg_file
from scara_kinetostatic.report.figure import SERIES, as_svg, new_figure, style


def test_a_file_has_the_colours_written_in_and_no_identifiers_that_repeat() -> None:
    with style():
        figure, (axes,) = new_figure(300, 200)
        axes.plot([1, 2], color=SERIES[1], label='a line')
        axes.scatter([1, 2], [1, 2])
        axes.quiver([1], [1], [1], [1])
        axes.legend()
        svg = as_svg(figure, 'one', 'a line')
    assert not re.search('id="(?:figure|axes|line2d|text|legend|PathCollection|Quiver)', svg)
    assert 'var(--c2)' in svg
    text = svg_file(svg)
    assert 'var(--' not in text
    assert light_colours()[SERIES[1]] in text
    assert ElementTree.fromstring(text).get('width') == '300'
