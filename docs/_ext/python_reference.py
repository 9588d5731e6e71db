"""The Python interface, made from the public names of the package and their docstrings."""

from __future__ import annotations

import inspect
from typing import Any

from common import MarkdownDirective, code, table
from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.ext.napoleon import Config, GoogleDocstring
from sphinx.util.inspect import TypeAliasForwardRef
from sphinx.util.nodes import make_refnode

import scara_kinetostatic

PACKAGE = scara_kinetostatic.__name__
STYLE = Config(napoleon_use_ivar=True, napoleon_use_rtype=False)


def public() -> list[tuple[str, Any]]:
    """The public names and what they are, but for the version."""
    names = (name for name in scara_kinetostatic.__all__ if not name.startswith('__'))
    return [(name, getattr(scara_kinetostatic, name)) for name in names]


def kind_of(thing: Any) -> str:
    """The group in which a name is listed."""
    if inspect.isclass(thing):
        return 'Exceptions' if issubclass(thing, Exception) else 'Classes'
    return 'Functions' if callable(thing) else 'Constants'


KINDS = {'Functions': 'function', 'Classes': 'class', 'Exceptions': 'exception', 'Constants': 'constant'}
"""Headings and kinds, in the order of the page."""
DIRECTIVES = {'Functions': 'autofunction', 'Classes': 'autoclass', 'Exceptions': 'autoexception'}


class PythonTable(MarkdownDirective):
    """A row for each public name."""

    def markdown(self) -> str:
        rows = []
        for group, kind in KINDS.items():
            for name, thing in public():
                if kind_of(thing) == group:
                    place = f'{PACKAGE}.{name}' if group in DIRECTIVES else 'constants'
                    first = (inspect.getdoc(thing) or '').split('\n')[0] if group in DIRECTIVES else ''
                    rows.append((f'[{code(name)}](#{place})', kind, first))
        return table(('name', 'kind', 'purpose'), rows)


class PythonReference(MarkdownDirective):
    """A section for each kind of names."""

    def markdown(self) -> str:
        parts = []
        for group in KINDS:
            members = [(name, thing) for name, thing in public() if kind_of(thing) == group]
            if members:
                parts.append(f'## {group}')
                if group == 'Constants':
                    parts.append(table(('name', 'value'), ((code(name), code(repr(thing))) for name, thing in members)))
                else:
                    lines = '\n'.join(directive(DIRECTIVES[group], name) for name, _ in members)
                    parts.append(f'```{{eval-rst}}\n{lines}\n```')
        return '\n\n'.join(parts)


def directive(kind: str, name: str) -> str:
    """A directive of autodoc for a name, with its public members."""
    options = '   :members:\n   :inherited-members: tuple, Exception, ABC\n' if kind == 'autoclass' else ''
    return f'.. {kind}:: {PACKAGE}.{name}\n{options}'


def docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """From Google style to reStructuredText; what describes a property is never read as "type: meaning"."""
    as_what = 'method' if what in ('property', 'attribute') else what
    lines[:] = GoogleDocstring(lines, STYLE, None, as_what, name, thing, options).lines()


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.Element) -> nodes.Node | None:
    """Links the full name of a public class to its place here; other libraries and internals stay plain text."""
    target = str(node.get('reftarget', ''))
    if node.get('refdomain') != 'py':
        return None
    last = target.rpartition('.')[2]
    found = env.get_domain('py').objects.get(f'{PACKAGE}.{last}')  # type: ignore[attr-defined]
    if found is not None:
        place = node['refdoc']
        return make_refnode(app.builder, place, found.docname, found.node_id, content, target)
    return content


def _name_of_alias(alias: TypeAliasForwardRef) -> str:
    """A type alias as part of a larger type is printed by its name."""
    return alias.name


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directives and what autodoc asks for."""
    app.setup_extension('sphinx.ext.autodoc')
    app.add_directive('python-table', PythonTable)
    app.add_directive('python-reference', PythonReference)
    app.connect('autodoc-process-docstring', docstring)
    TypeAliasForwardRef.__repr__ = _name_of_alias  # type: ignore[method-assign]
    app.connect('missing-reference', resolve)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
