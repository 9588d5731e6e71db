"""The picture of the page *Architecture*: which package imports which, read from the code."""

from __future__ import annotations

from typing import Any

from common import MarkdownDirective
from docutils import nodes
from imports import MODULES, between_packages, floors
from sphinx.application import Sphinx

CELL, LABEL = 22, 150
"""Width of a square, and of the names beside the squares, pixels."""


class PackageMatrix(MarkdownDirective):
    """A matrix: a row for each package, a square for each other that it imports, the darker the more often."""

    def note_sources(self) -> None:
        super().note_sources()
        for path in MODULES:
            self.env.note_dependency(str(path))

    def run(self) -> list[nodes.Node]:
        self.note_sources()
        return [nodes.raw('', matrix(), format='html')]


def matrix() -> str:
    """The matrix as SVG, in the colour of the text around it."""
    graph, floor = between_packages(), floors()
    order = list(floor)
    side = CELL * len(order)
    parts = []
    for row, package in enumerate(order):
        y = CELL * row
        middle = y + 0.7 * CELL
        parts.append(f'<text x="{LABEL - 8}" y="{middle}" text-anchor="end">{package}</text>')
        at = LABEL + y + 0.5 * CELL
        parts.append(f'<text x="{at}" y="{middle}" text-anchor="middle" opacity="0.6">{floor[package]}</text>')
        if row and floor[package] != floor[order[row - 1]]:
            parts.append(f'<path d="M{LABEL} {y}h{side}" stroke="currentColor" opacity="0.25"/>')
        for other, times in graph[package].items():
            x, shade = LABEL + CELL * order.index(other), min(1.0, 0.25 + times / 40)
            title = f'<title>{package} imports {other}: {times} times</title>'
            square = f'<rect x="{x + 2}" y="{y + 2}" width="{CELL - 4}" height="{CELL - 4}" opacity="{shade:.2f}">'
            parts.append(f'{square}{title}</rect>')
    box = f'viewBox="0 0 {LABEL + side} {side}" style="max-width: {LABEL + side}px"'
    head = f'<svg {box} role="img" aria-label="imports between packages" fill="currentColor" font-size="13">'
    return head + ''.join(parts) + '</svg>'


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directive."""
    app.add_directive('package-matrix', PackageMatrix)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
