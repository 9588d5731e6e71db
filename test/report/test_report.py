"""Numbers with their units and digits; tables on a terminal and on a page; figures on a page and as files."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest

from benchmark.svg import light_colours, svg_file
from scara_kinetostatic.model.quantities import shown
from scara_kinetostatic.report.figure import SERIES, as_svg, new_figure, style
from scara_kinetostatic.report.page import Report, Section, Table, Verdict, as_page


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


@pytest.mark.parametrize(
    ('value', 'std', 'unit', 'expected'),
    [
        (5.19e-5, 1.07e-6, 'm', '51.9 ± 1.1 µm'),
        (17.3061, 0.0246, '1/turn', '17.306 ± 0.025 1/turn'),
        (9.82e-5, 1.6e-6, '1', '98.2 ± 1.6 ppm'),
        (0.0322, 0.0023, '1', '0.0322 ± 0.0023'),
        (-3e-8, 1e-9, 'rad/(Nm)^3', '-30.0 ± 1.0 nrad/(Nm)^3'),
        (2e-7, float('nan'), '1/s', '0.2 ppm/s'),
        (0.0, 0.0, 'm', '0 m'),
        (2.5, 0.31, 'Nm', '2.50 ± 0.31 Nm'),
        (-1e-8, 1e-6, 'm', '0.0 ± 1.0 µm'),
        (-0.0, 0.0, 'm', '0 m'),
        (2e-4, 1e-19, 'm', '200 µm'),
        (float('nan'), float('nan'), 'm', 'not determined'),
    ],
)
def test_values_of_any_unit(value: float, std: float, unit: str, expected: str) -> None:
    assert shown(value, std, unit).text == expected


TABLE = Table(
    ('part', 'compliance', 'rows', 'verdict'),
    ('', 'µm/N', '', ''),
    (
        ('gripper', '17.31 ± 0.25', '120', 'ok'),
        ('joint 1', '8.4 ± 1.1', '8', 'few rows'),
        ('joint 2', '(9.6)', '–', ''),
        ('link', 'not measured, since the gauge was seated on the wrong side'),
    ),
)


def test_text_to_the_left_numbers_to_the_right_uncertainties_at_the_sign() -> None:
    assert TABLE.lines() == [
        'part     compliance         rows  verdict',
        '               µm/N',
        'gripper       17.31 ± 0.25   120  ok',
        'joint 1         8.4 ± 1.1      8  few rows',
        'joint 2       (9.6)            –',
        'link     not measured, since the gauge was seated on the wrong side',
    ]


def test_what_counts_as_a_number() -> None:
    numbers = ('3', '-1.5e-07', '−2', '+4.2', '98.2 ± 1.6', 'below 1e-12', '12 + 34', '5 %', '–', 'not determined')
    words = ('2024_loop.csv', '10 N', 'x0', '1/2 turn', 'left')
    for cell in (*numbers, *words):
        assert Table(('a',), ('',), ((cell,),)).is_number(0) == (cell in numbers), cell
    assert not Table(('a',), ('',), (('',),)).is_number(0)


def test_a_page_escapes_and_spans() -> None:
    table = TABLE._replace(rows=(*TABLE.rows, ('<b>', '-1', '2', '')), levels=('', 'bad', '', '', ''))
    html = as_page(Report('<i>', Verdict('found'), (Section('Parts', (table,)),)))
    assert '<th class="n">compliance [µm/N]</th><th class="n">rows</th><th>verdict</th>' in html
    assert '<td class="n">17.31 ± 0.25</td>' in html
    assert '<td class="n">−1</td>' in html
    assert '<tr class="bad"><td>joint 1</td>' in html
    assert '<td>&lt;b&gt;</td>' in html
    assert 'colspan="3">not measured' in html
    assert '<h1>&lt;i&gt;</h1>' in html
