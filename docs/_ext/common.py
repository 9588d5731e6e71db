"""What the generators of reference pages share: Markdown made from code, parsed as part of the page."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

import scara_kinetostatic

PACKAGE = Path(scara_kinetostatic.__file__).parent


class MarkdownDirective(SphinxDirective):
    """A directive without options whose content is Markdown that `markdown` returns."""

    has_content = False
    optional_arguments = 1
    final_argument_whitespace = True
    made_from: ClassVar[str] = '.'
    """Folder of the package whose modules the content depends on."""

    def markdown(self) -> str:
        """The content."""
        raise NotImplementedError

    def note_sources(self) -> None:
        """The page is made anew when the generator or a module of the packages `made_from` changes."""
        self.env.note_dependency(inspect.getfile(type(self)))
        for path in sorted((PACKAGE / self.made_from).glob('*.py')):
            self.env.note_dependency(str(path))

    def run(self) -> list[nodes.Node]:
        """Parses the content at the level of the surrounding section."""
        self.note_sources()
        lines = StringList(self.markdown().splitlines(), source=f'<{self.name}>')
        container = nodes.container()
        self.state.nested_parse(lines, self.content_offset, container, match_titles=True)
        return container.children


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join('| ' + ' | '.join(cell.replace('|', '\\|') for cell in line) + ' |' for line in lines)


def code(text: str) -> str:
    """A word in the type of code; nothing for nothing."""
    return f'`{text}`' if text else ''
