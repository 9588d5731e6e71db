"""The examples of a Markdown page: commands and programs, with the output that the page shows.

- ``console``: lines that begin with ``$`` are run, what follows is their output;
- ``python``: run, all of a page in one namespace; a ``text`` block straight after it is what it prints;
- any block whose first line is ``# file: NAME`` is that file;
- other blocks are not run.

In shown output ``…`` stands for anything; figures may differ by `WITHIN` and by one in the last decimal place.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
WITHIN = 0.02
"""Part by which a figure may differ on another machine, with another NumPy."""
_BLOCK = re.compile(r'^(?P<indent> *)```(?P<language>\w+)\n(?P<text>.*?)^ *```$', flags=re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r'(?<![\w\]])[-+]?\d+(?:\.\d+)?(?:e-?\d+)?')
_FILE = re.compile(r'# file: (\S+)\n')


class Block(NamedTuple):
    """A fenced block: its language, its text, and whether it follows straight on the one before."""

    language: str
    text: str
    follows: bool


def pages() -> list[Path]:
    """The Markdown pages of the documentation."""
    return sorted(path for path in DOCS.rglob('*.md') if '_build' not in path.parts)


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = page.read_text(encoding='utf-8')
    found, end = [], 0
    for match in _BLOCK.finditer(text):
        indent = len(match['indent'])
        lines = (line[indent:] for line in match['text'].splitlines(keepends=True))
        found.append(Block(match['language'], ''.join(lines), not text[end : match.start()].strip()))
        end = match.end()
    return found


def is_run(page: Path) -> bool:
    """Whether a page has something to run."""
    return any(block.language in ('console', 'python') for block in blocks(page))


def commands(text: str) -> Iterator[tuple[list[str], str]]:
    """The words of each command of a console block, and the output shown."""
    for part in re.split(r'^\$ ', text, flags=re.MULTILINE)[1:]:
        command, _, shown = part.partition('\n')
        yield shlex.split(command), shown


def run_page(page: Path, folder: Path, run: Callable[[list[str]], str], execute: Callable[[str], str]) -> None:
    """Runs what a page shows, and compares what is printed.

    Args:
        page: the page.
        folder: the current folder.
        run: from the words of a command to what it prints.
        execute: from a program to what it prints.
    """
    printed = ''
    for block in blocks(page):
        file = _FILE.match(block.text)
        if file:
            (folder / file[1]).write_text(block.text[file.end() :], encoding='utf-8')
        elif block.language == 'console':
            for words, shown in commands(block.text):
                compare(shown, run(words), shlex.join(words))
        elif block.language == 'python':
            printed = execute(block.text)
            continue
        elif block.language == 'text' and block.follows and printed:
            compare(block.text, printed, 'the program before')
        printed = ''


def compare(shown: str, printed: str, source: str) -> None:
    """Raises AssertionError unless the parts that are shown are printed, in this order."""
    words, found = _words(printed), figures(printed)
    place = 0
    for part in shown.split('…'):
        wanted, numbers = _words(part), figures(part)
        at = words.find(wanted, place)
        assert at >= 0, f'{source} does not print {wanted!r}, but\n{printed}'
        before = words[:at].count('#')
        for one, other in zip(numbers, found[before : before + len(numbers)], strict=True):
            near = abs(float(one) - float(other)) <= WITHIN * abs(float(other)) + _last_place(one)
            assert near, f'{source} prints {other}, not {one}, in {wanted!r}'
        place = at + len(wanted)


def figures(text: str) -> list[str]:
    """The figures of a text, as they are written."""
    return NUMBER.findall(text.replace('−', '-'))


def _last_place(figure: str) -> float:
    """The unit of the last decimal place, by which rounding may differ; zero for a whole number."""
    mantissa, _, exponent = figure.partition('e')
    places = len(mantissa.partition('.')[2])
    return 10.0 ** (int(exponent or 0) - places) if places else 0.0


def _words(text: str) -> str:
    return ' '.join(NUMBER.sub('#', text.replace('−', '-')).split())
