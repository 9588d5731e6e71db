"""Tables of text, on a terminal and on a page."""

from __future__ import annotations

from scara_kinetostatic.report import Report, Section, Table, Verdict, as_page

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
    assert '<td class="n">17.31 ±\u00a00.25</td>' in html
    assert '<td class="n">−1</td>' in html
    assert '<tr class="bad"><td>joint 1</td>' in html
    assert '<td>&lt;b&gt;</td>' in html
    assert 'colspan="3">not measured' in html
    assert '<h1>&lt;i&gt;</h1>' in html
