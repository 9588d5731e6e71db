"""What is being done, on stderr, where somebody watches it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str, float], None]


@contextmanager
def progress() -> Iterator[Progress]:
    """A callback that shows a line while work goes on; it says nothing if stderr is no terminal."""
    if not sys.stderr.isatty():
        yield _silent
        return
    from rich.console import Console

    with Console(stderr=True).status('starting') as status:
        yield lambda what, part: status.update(_markup_free(what))


def _silent(what: str, part: float) -> None:
    pass


def _markup_free(text: str) -> str:
    from rich.markup import escape

    return f'{escape(text)} …'
