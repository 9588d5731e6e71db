"""The page: complete, self-contained, and immune to what names hold."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest

from scara_kinetostatic.pipeline import Outcome
from scara_kinetostatic.report.html import html_text

VOID = {'meta', 'br', 'img', 'hr', 'input', 'link'}


class Reader(HTMLParser):
    """Notes tags, attributes and text, and whether everything that opens closes."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.identifiers: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
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
    return html_text(nasty)


def test_names_come_out_as_text(page: str, nasty: Outcome) -> None:
    reader = parse(page)
    assert 'script' not in reader.tags
    text = ''.join(reader.text)
    for disc in nasty.calibration.cell.discs:
        assert text.count(disc.name) >= 2  # in the pictures' legend and in the tables
    for svg in re.findall(r'<svg.*?</svg>', page, re.DOTALL):
        ElementTree.fromstring(svg.replace('xlink:href', 'href'))


def test_nothing_comes_from_outside(page: str) -> None:
    reader = parse(page)
    assert not {'link', 'img', 'iframe', 'object', 'embed'} & reader.tags
    for name, value in reader.attributes:
        if name in ('src', 'href', 'xlink:href', 'action', 'data'):
            assert value is not None
            assert value.startswith('#'), f'{name}={value}'
    assert not re.search(r'@import|url\((?!#)', page)
    without_namespaces = re.sub(r'xmlns(:\w+)?="[^"]*"', '', page)
    assert '//' not in re.sub(r'<!--.*?-->', '', without_namespaces, flags=re.DOTALL)


def test_identifiers_are_unique_and_found(page: str) -> None:
    identifiers = parse(page).identifiers
    assert len(identifiers) == len(set(identifiers))
    used = set(re.findall(r'(?:href="|url\()#([\w-]+)', page))
    assert used <= set(identifiers)


def test_everything_is_said(page: str, nasty: Outcome) -> None:
    text = ' '.join(''.join(parse(page).text).split())
    c = nasty.calibration
    assert 'The twelve-parameter model explains these touches' in text
    assert f'{c.force_error_nominal:.3g} → {c.force_error:.3g} N' in text
    assert '2 of 37 touches were not used' in text
    assert 'disagrees with the other touches' in text
    assert nasty.warnings[0] in text
    assert page.count('<svg') == 5
    assert len(re.findall(r'<tr[^>]*><td class="n">', page)) == 2 + len(c.touches)
    assert 'nan' not in text.lower().split()


def test_what_is_not_determined_is_marked(confounded: Outcome) -> None:
    page = html_text(confounded)
    text = ' '.join(''.join(parse(page).text).split())
    assert 'these data do not determine every parameter' in text
    assert 'Determined all the same: g_ee + ' in text
    assert page.count('class="confounded') == 2
    assert page.count('class="fixed') == 1


def test_the_same_outcome_gives_the_same_page(page: str, nasty: Outcome) -> None:
    assert html_text(nasty) == page
