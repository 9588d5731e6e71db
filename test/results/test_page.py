"""The page: complete, self-contained, and immune to what names hold."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import datetime, timezone
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from scara_kinetostatic.assessment.outcome import Outcome, Recording
from scara_kinetostatic.model.cell import Identification
from scara_kinetostatic.model.quantities import micrometres
from scara_kinetostatic.results.figures import _smooth
from scara_kinetostatic.results.report import html_text, numbers

VOID = {'meta', 'br', 'img', 'hr', 'input', 'link'}


class Reader(HTMLParser):
    """Notes tags, attributes and text, and whether everything that opens closes."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.metadata: set[str] = set()
        self.identifiers: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.metadata.add(tag)
        self.attributes += attrs
        self.identifiers += [value for name, value in attrs if name == 'id' and value]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def parse(page: str) -> Reader:
    reader = Reader()
    reader.feed(page)
    reader.close()
    assert reader.open == []
    return reader


@pytest.fixture(scope='module')
def page(nasty: Outcome) -> str:
    """Of a robot and of recordings that are identified."""
    known = Identification(robot='TS60 <b>', serial_number='0047', operator='Ä. Sato', customer='ACME')
    cell = replace(nasty.calibration.cell, identification=known)
    start = datetime(2026, 11, 21, 14, 3, 22, tzinfo=timezone.utc)
    recordings = Recording('a/monday', '0' * 64, start), Recording('touches.csv', '1' * 64, None)
    calibration = replace(nasty.calibration, cell=cell)
    return html_text(replace(nasty, calibration=calibration, recordings=recordings, created=start))


@pytest.fixture(scope='module')
def extended_page(grown: Outcome) -> str:
    return html_text(grown)


def words_of(page: str) -> str:
    return ' '.join(''.join(parse(page).text).split())


def test_names_come_out_as_text(page: str, nasty: Outcome) -> None:
    text = ''.join(parse(page).text)
    for disc in nasty.calibration.cell.discs:
        assert text.count(disc.name) >= 2  # in the pictures and their legend


def test_every_page_is_whole_and_needs_nothing_from_outside(page: str, extended_page: str) -> None:
    for each in (page, extended_page):
        reader = parse(each)
        for svg in re.findall(r'<svg.*?</svg>', each, re.DOTALL):
            ElementTree.fromstring(svg.replace('xlink:href', 'href'))
        assert not {'script', 'link', 'img', 'iframe', 'object', 'embed'} & reader.metadata
        for name, value in reader.attributes:
            if name in ('src', 'href', 'xlink:href', 'action', 'data'):
                assert value is not None and value.startswith('#'), f'{name}={value}'
        assert not re.search(r'@import|url\((?!#)', each)
        without_namespaces = re.sub(r'xmlns(:\w+)?="[^"]*"', '', each)
        assert '//' not in re.sub(r'<!--.*?-->', '', without_namespaces, flags=re.DOTALL)
        assert len(reader.identifiers) == len(set(reader.identifiers))
        assert set(re.findall(r'(?:href="|url\()#([\w-]+)', each)) <= set(reader.identifiers)
        assert 'nan' not in words_of(each).lower().split()
        cells = re.findall(r'<td[^>]*>([^<]*)</td>', each)
        assert not [cell for cell in cells if re.fullmatch(r'[-−+]0(\.0*)?( .*)?', cell)], 'no zero has a sign'


def test_a_wide_table_scrolls_within_itself_and_shows_that_it_continues(page: str) -> None:
    assert page.count('<table') == page.count('<div class="wide">\n<table')
    assert '.wide, figure { overflow-x: auto; }' in page
    assert 'background-attachment: local, local, scroll, scroll;' in page


def test_everything_is_said(page: str, nasty: Outcome) -> None:
    text = words_of(page)
    c = nasty.calibration
    assert 'The base model explains these touches. No model error detected (p = ' in text
    assert 'bending of link 2 is always part of p2' in text
    nominal = np.hypot(*c.nominal_residual[c.used].T).mean()
    assert f'{c.force_error:.3g} N in the fit, {nominal:.3g} N with nominal parameters' in text
    assert '2 of 37 touches were not used' in text
    assert 'disagrees with the other touches' in text
    assert nasty.warnings[0] in text
    assert page.count('<svg') == 2 + 2


def test_an_effect_is_shown_with_all_about_it(extended_page: str, grown: Outcome) -> None:
    page, text = extended_page, words_of(extended_page)
    (item,) = grown.diagnosis.found
    assert f'{item.effect.title} {item.effect.label}' in text
    compared = grown.comparison
    for side in (compared.base, compared.extended):
        cells = (f'{side.force_error:.3g}', f'{side.held_out:.3g}', micrometres(side.tip.fitted))
        assert ''.join(f'<td class="n">{cell}</td>' for cell in cells) in page
    assert f'{1e6 * item.values[0].value:.1f} ± {1e6 * item.values[0].std:.1f} µm' in text
    assert page.count('<svg') == 2 + 1 + 2
    assert 'Ignoring it would bias l2 by ' in text


def test_maps_have_no_steps(plain: Outcome) -> None:
    for places in plain.tip_uncertainty.maps:
        fine = _smooth(places.expanded)
        assert np.nanmin(places.expanded) <= fine.min() <= fine.max() <= np.nanmax(places.expanded)
        steps = [np.nanmax(np.abs(np.diff(each, axis=0))) for each in (fine, places.expanded)]
        assert steps[0] < 0.5 * steps[1]


def test_what_is_folded_is_open_on_paper(page: str) -> None:
    """By a hidden checkbox: no style opens <details> on paper in every browser."""
    assert re.search(r'\.folded \{ display: block', page.rpartition('@media print {')[2])
    for name in ('Effects that these touches cannot identify', 'Identifiability and noise', 'Residuals', 'Touches:'):
        (number,) = re.findall(f'<label for="([^"]*)">{name}', page)
        assert f'<input type="checkbox" id="{number}">' in page


def test_the_answer_comes_first_and_the_appendix_last(page: str) -> None:
    parts = ['class="head"', 'class="verdict', 'class="facts"', '>Parameters<', '>Uncertainty of the tip<']
    parts += ['>Diagnosis<', '>Appendix<', '>Identifiability', '>Touches: ']
    places = [page.index(part) for part in parts]
    assert places == sorted(places)


def test_head_says_what_was_calibrated_by_whom_and_from_what(page: str) -> None:
    text = words_of(page)
    assert 'Date 2026-11-21 14:03 UTC Robot TS60 <b> Serial number 0047 Operator Ä. Sato Customer ACME' in text
    assert f'a/monday, 2026-11-21 14:03 UTC, SHA-256 {"0" * 64} Recording touches.csv, SHA-256 {"1" * 64}' in text


def test_the_tolerance_is_beside_the_uncertainty(plain: Outcome) -> None:
    worst, cell = plain.tip_uncertainty.worst, plain.calibration.cell
    for factor, words in ((1.2, 'conformity shown'), (0.5, 'conformity excluded')):
        known = replace(plain.calibration, cell=replace(cell, tolerance=factor * worst))
        fact = numbers(replace(plain, calibration=known))[1]
        assert (fact.value, fact.unit) == (f'{1e6 * worst:.3g} of {1e6 * factor * worst:.3g}', 'µm')
        assert words in fact.remark
