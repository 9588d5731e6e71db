"""What verbs write and print: progress on stderr, results as files and on stdout."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scara_kinetostatic.render.json_file import Document

Progress = Callable[[str, float], None]
"""Called with what is being done and which part of all is done, 0 to 1."""


@contextmanager
def progress() -> Iterator[Progress]:
    """A callback that shows what is being done in one line on stderr; it shows nothing if stderr is no terminal."""
    if not sys.stderr.isatty():
        yield _silent
        return
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status('starting') as status:
        yield lambda what, part: status.update(f'{escape(what)} …')


def _silent(what: str, part: float) -> None:
    pass


def print_result(text: str, document: Document, as_json: bool, folder: Path | None, files: Mapping[str, str]) -> None:
    """Write the files of a result and print it.

    Args:
        text: of the result, for people.
        document: the same as plain JSON values.
        as_json: whether to print the document instead of the text.
        folder: of the files; None to write none.
        files: text by name.

    Raises:
        OutputError: the folder cannot be written.
    """
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.render.json_file import json_text

    if folder:
        write_texts(folder, files)
    print(json_text(document).rstrip() if as_json else text)
    if folder and not as_json:
        print(f'\nwritten: {", ".join(str(folder / name) for name in files)}')
