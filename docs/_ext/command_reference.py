"""The command reference, made from the argument parsers."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from textwrap import dedent
from typing import Any

from common import MarkdownDirective, code, table
from sphinx.application import Sphinx

from scara_kinetostatic.cli.main import build_parser

WIDTH = 100
"""Characters in a line of the usage."""


class CommandReference(MarkdownDirective):
    """A section for each verb: what it does, usage, arguments, example."""

    made_from = 'cli'

    def markdown(self) -> str:
        return '\n\n'.join(section(name, parser, summary) for name, parser, summary in verbs())


class CommandTable(MarkdownDirective):
    """A row for each verb."""

    made_from = 'cli'

    def markdown(self) -> str:
        return table(('verb', 'purpose'), ((f'[{code(name)}](#{name})', summary) for name, _, summary in verbs()))


def verbs() -> Iterator[tuple[str, argparse.ArgumentParser, str]]:
    """Name, parser and summary of each verb, in the order of the help."""
    (chooser,) = (action for action in build_parser()._actions if isinstance(action, argparse._SubParsersAction))
    for choice in chooser._choices_actions:
        yield choice.dest, chooser.choices[choice.dest], choice.help or ''


def section(name: str, parser: argparse.ArgumentParser, summary: str) -> str:
    """One verb as Markdown."""
    parts = [f'({name})=\n## {name}', f'{summary[:1].upper()}{summary[1:]}.']
    parts += [prose(parser.description or ''), f'```text\n{usage(parser)}\n```']
    for group in parser._action_groups:
        rows = [row(action) for action in group._group_actions if action.help is not argparse.SUPPRESS]
        if rows:
            title = (group.title or '').capitalize()
            parts += [f'### {title}\n' if title not in ('Options', 'Positional arguments') else '']
            parts += [group.description or '', table(('argument', 'meaning'), rows)]
    example = re.split(r'^exit status:', parser.epilog or '', flags=re.MULTILINE)[0]
    commands = [line.strip() for line in example.splitlines() if line.strip().startswith('scara-kinetostatic')]
    if commands:
        parts.append('```bash\n' + '\n'.join(commands) + '\n```')
    return '\n\n'.join(part for part in parts if part)


def usage(parser: argparse.ArgumentParser) -> str:
    """The usage line as argparse prints it."""
    formatter = argparse.HelpFormatter(prog=parser.prog, width=WIDTH)
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups, prefix='')
    return formatter.format_help().strip()


def row(action: argparse.Action) -> tuple[str, str]:
    """Names and meaning of an argument."""
    formatter = argparse.HelpFormatter(prog='')
    if not action.option_strings:
        names = code(formatter._metavar_formatter(action, action.dest)(1)[0])
    elif action.nargs == 0:
        names = ', '.join(map(code, action.option_strings))
    else:
        value = formatter._format_args(action, formatter._get_default_metavar_for_optional(action))
        names = ', '.join(code(f'{option} {value}') for option in action.option_strings)
    return names, escape(formatter._expand_help(action)) if action.help else ''


def prose(text: str) -> str:
    """The text of a help as Markdown: indented lines stay as they are."""
    paragraphs = re.split(r'\n\s*\n', dedent(text).strip('\n'))
    return '\n\n'.join(_paragraph(paragraph) for paragraph in paragraphs if paragraph.strip())


def _paragraph(text: str) -> str:
    if re.search(r'^  +\S', text, flags=re.MULTILINE):
        return f'```text\n{dedent(text)}\n```'
    return escape(text)


def escape(text: str) -> str:
    """Text in which Markdown has nothing to find."""
    return re.sub(r'([\\*_`<>\[\]#$~])', r'\\\1', text)


def setup(app: Sphinx) -> dict[str, Any]:
    """Registers the directives."""
    app.add_directive('command-table', CommandTable)
    app.add_directive('command-reference', CommandReference)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
