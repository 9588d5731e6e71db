"""Equations as MathML, which browsers draw by themselves: no script, no web font, no LaTeX."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.domains.math import MathDomain
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator


class PageEquations(MathDomain):
    """Numbers equations by page, such as M1 on the page `model`; numbers without a letter are those of the paper."""

    def note_equation(self, docname: str, labelid: str, location: Any = None) -> None:
        """Gives the next equation of a page its number."""
        super().note_equation(docname, labelid, location)
        _, count = self.equations[labelid]
        number: Any = f'{PurePosixPath(docname).name[0].upper()}{count}'
        self.equations[labelid] = (docname, number)


def visit_inline(self: HTML5Translator, node: nodes.math) -> None:
    """An equation in a line of text."""
    self.body.append(_mathml(node.astext(), 'inline'))
    raise nodes.SkipNode


def visit_block(self: HTML5Translator, node: nodes.math_block) -> None:
    """An equation on a line of its own, with its number if it has a label."""
    self.body.append(self.starttag(node, 'div', CLASS='equation'))
    self.body.append(_mathml(node.astext(), 'block'))
    if node['number']:
        number = get_node_equation_number(self, node)
        self.body.append(f'<span class="eqno">({number})')
        self.add_permalink_ref(node, 'Link to this equation')
        self.body.append('</span>')
    self.body.append('</div>')
    raise nodes.SkipNode


def _mathml(latex: str, display: str) -> str:
    for name in ('aligned', 'split'):  # which the converter does not know
        latex = latex.replace(f'{{{name}}}', '{align*}')
    return str(convert(latex, display=display))


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the renderer with the HTML builders, and the numbers of equations."""
    app.add_domain(PageEquations, override=True)
    app.add_html_math_renderer('mathml', (visit_inline, None), (visit_block, None))  # type: ignore[arg-type]
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
