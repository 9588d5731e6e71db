"""Every promise of `docs/project/promises.md` has tests that exist, every verb the options that are promised."""

from __future__ import annotations

import argparse
import ast
import re
from functools import cache

from docs.examples import DOCS, ROOT

from scara_kinetostatic.cli.main import build_parser

PAGE = (DOCS / 'project/promises.md').read_text(encoding='utf-8')
PROMISES, OPTIONS = PAGE.split('## Options of the verbs')


def rows(text: str) -> list[tuple[str, list[str]]]:
    """First cell, and what stands in backquotes in the second."""
    found = re.findall(r'^\| (.+?) \| (.*) \|$', text, re.MULTILINE)
    return [(first, re.findall('`([^`]+)`', second)) for first, second in found if first not in ('promise', 'verb')]


@cache
def functions(path: str) -> set[str]:
    tree = ast.parse((ROOT / path).read_text(encoding='utf-8'))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_every_promise_has_tests_that_exist() -> None:
    assert len(rows(PROMISES)) > 40
    for promise, tests in rows(PROMISES):
        assert tests, f'no test holds: {promise}'
        for test in tests:
            path, _, name = test.partition('::')
            assert name in functions(path), f'{test} of: {promise}'


def test_options_are_there() -> None:
    (verbs,) = (item for item in build_parser()._actions if isinstance(item, argparse._SubParsersAction))
    promised = {verb.strip('`'): set(options) for verb, options in rows(OPTIONS)}
    assert promised.keys() == verbs.choices.keys()
    for verb, options in promised.items():
        assert options <= verbs.choices[verb]._option_string_actions.keys(), verb
