"""The argument parser of the command, and what several verbs share: options, checks of paths, what they print."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from scara_kinetostatic.errors import OutputError, UnsupportedDataError

if TYPE_CHECKING:
    from scara_kinetostatic.assessment.grade import Assessment
    from scara_kinetostatic.model.cell import Cell
    from scara_kinetostatic.report.page import Document, Report

Option = tuple[Any, ...]
"""A row of a table of arguments (`_add_options`)."""
EXIT_STATUSES = """\
exit status:
  0  done
  2  the command or an input is wrong; one line on stderr names the file, topic or key, and the remedy
  3  the data cannot support the result (no contact, too few touches, ...)
"""


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line each."""

    def error(self, message: str) -> NoReturn:
        """Ends with exit status 2, the message on stderr."""
        self.exit(2, f'{self.prog}: {" ".join(message.split())}; see {self.prog} --help\n')


def add_verb(subparsers: argparse._SubParsersAction[argparse.ArgumentParser], module: ModuleType) -> str:
    """Adds the verb of a module: its table `ARGUMENTS`, its `run`, and its docstring as the help.

    The first line of the docstring is for the list of verbs, what follows describes the verb, up to ``Example:``.

    Returns:
        The line of the list of verbs.
    """
    summary, _, rest = (module.__doc__ or '').partition('\n')
    description, _, example = rest.partition('\nExample:\n')
    name = module.__name__.rpartition('.')[2].replace('_', '-')
    parser = subparsers.add_parser(
        name,
        description=description.strip(),
        epilog=f'example:\n{example}\n{EXIT_STATUSES}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_options(parser, module.ARGUMENTS)
    parser.set_defaults(run=module.run)
    return f'  {name:12}{summary[:1].lower()}{summary[1:].rstrip(".")}\n'


def real(
    lowest: float = float('-inf'), most: float = sys.float_info.max, *, above: bool = False, kind: type = float
) -> Callable[[str], Any]:
    """A type for `add_argument`: a finite number from `lowest`, with `above` from above it, to `most`."""

    def convert(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            wanted = 'a whole number' if kind is int else 'a number'
            raise argparse.ArgumentTypeError(f'expected {wanted}, got {text!r}') from None
        if value > most < sys.float_info.max:
            raise argparse.ArgumentTypeError(f'expected at most {most:g}, in SI units, got {text}')
        if not lowest <= value < float('inf') or (above and value == lowest):
            wanted = 'a finite number' if lowest == float('-inf') else f'{"above" if above else "at least"} {lowest:g}'
            raise argparse.ArgumentTypeError(f'expected {wanted}, got {text}')
        return value

    return convert


def whole(lowest: int) -> Callable[[str], Any]:
    """A type for `add_argument`: a whole number of `lowest` or more."""
    return real(lowest, kind=int)


def _add_options(parser: argparse.ArgumentParser, rows: Sequence[str | Option | tuple[Option, ...]]) -> None:
    """Adds arguments by a table.

    Each row is name, metavar, kind and help: a kind is a type, a tuple of choices, or `bool` for a switch. What
    `add_argument` needs besides, such as a default or the number of values, follows as a dict. A title begins a group;
    of several rows in one exactly one has to be given.
    """
    group: argparse._ActionsContainer = parser
    for row in rows:
        if isinstance(row, str):
            group = parser.add_argument_group(row)
            continue
        is_one_of = isinstance(row[0], tuple)
        place = parser.add_mutually_exclusive_group(required=True) if is_one_of else group
        for name, metavar, kind, meaning, *more in row if is_one_of else (row,):
            given: dict[str, Any] = {'type': kind, 'metavar': metavar}
            if kind is bool or isinstance(kind, tuple):
                given = {'action': 'store_true'} if kind is bool else {'choices': kind}
            place.add_argument(name, help=meaning, **given, **dict(*more))


def cell_option(default: str = "the paper's cell") -> Option:
    """``--cell``; `default` says what is taken without it."""
    return '--cell', 'FILE', Path, f'cell description (default: {default})'


def out_option(default: str = '', files: str = '', *, required: bool = False) -> Option:
    """``--out`` for a folder.

    Args:
        default: folder; empty: nothing is written without the option.
        files: that are written, for the help.
        required: whether the folder has to be named.
    """
    meaning = f'results (default: {default})' if default else f'folder for {files or "the results"}'
    return '--out', 'DIR', _folder, meaning, {'default': Path(default) if default else None, 'required': required}


def _max_bytes(text: str) -> int:
    """Holds for child processes as well."""
    from scara_kinetostatic.bags.decoding import MAX_BYTES as VARIABLE

    os.environ[VARIABLE] = str(value := whole(1)(text))
    return value


def _folder(text: str) -> Path:
    """A folder for results."""
    if os.path.isfile(text):  # noqa: PTH113  that of Path raises where a folder above may not be entered
        raise argparse.ArgumentTypeError(f'{text} cannot be written: it is a file, expected a folder')
    return Path(text)


SEVERAL = {'action': 'append', 'default': []}
_FREE = 'with --from, what may have changed since: tool, zeros, base, or a NAME; repeatable'
FREE: Option = ('--free', 'WHAT', str, _FREE, SEVERAL)
"""Of an option that may be given several times."""
MAX_BYTES: Option = (
    *('--max-bytes', 'N', _max_bytes),
    'a recording may unpack to so many bytes (default: 256 MiB or, if more, 200 times its size)',
)
SEED: Option = '--seed', 'N', whole(0), 'seed of the noise (default: 0)', {'default': 0}
JSON: Option = '--json', '', bool, 'print JSON instead of text'


def cell_or_paper(path: Path | None) -> Cell:
    """The cell description of ``--cell``; without it the paper's cell.

    Raises:
        CellError: the file cannot be read or is invalid.
    """
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.model.cell import PAPER_CELL

    return load_cell(path) if path else PAPER_CELL


def check_file(path: Path, inputs: Sequence[Path], option: str = '--out', suffix: str = '') -> None:
    """Check, before anything is computed, that a file may be written.

    Args:
        path: of the file.
        inputs: files and folders that it may not replace, nor be in.
        option: that names the file.
        suffix: that its name must have; empty: any.

    Raises:
        OutputError: it may not.
    """
    remedy = f'choose another file for {option}'
    if path.is_dir():
        raise OutputError(path, 'is a folder where a file is to be written', remedy)
    if not path.name.lower().endswith(suffix):
        raise OutputError(path, f'expected a file name that ends in {suffix}, got {path.name!r}', remedy)
    for given in inputs:
        if path.resolve() == given.resolve():
            raise OutputError(path, 'is an input and would be replaced', remedy)
        if given.resolve() in path.resolve().parents:
            raise OutputError(path, f'is inside the input {given}', remedy)


@contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """A function that shows in one line on stderr what is being done, and for how long; nothing if it is no terminal.

    It is called with what is done and the part of the work that is done, 0 to 1.
    """
    if not sys.stderr.isatty():
        yield lambda what, part: None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    parts = SpinnerColumn(), TextColumn('{task.description}'), TimeElapsedColumn()
    with Progress(*parts, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task('starting')
        yield lambda what, part: shown.update(task, description=f'{escape(what)} …')


def note(text: str) -> None:
    """One line on stderr."""
    print(f'note: {text}', file=sys.stderr)


def print_result(text: str, folder: Path, files: Mapping[str, str], document: Document | None = None) -> None:
    """Write the files of a result and print it.

    Args:
        text: of the result, for people.
        folder: of the files.
        files: text by name; empty to write none.
        document: the same as plain JSON values, to be printed instead of the text; None to print that.

    Raises:
        OutputError: the folder cannot be written.
    """
    from scara_kinetostatic.files.atomic import write_texts
    from scara_kinetostatic.report.page import json_text

    if files:
        write_texts(folder, files)
    print(json_text(document).rstrip() if document else text)
    if files and not document:
        print(f'\nwritten: {", ".join(str(folder / name) for name in files)}')


def check_strict(args: argparse.Namespace, assessment: Assessment) -> None:
    """Where ``--strict`` is given, raises `UnsupportedDataError` for a result that is unfit; it is in ``--out``."""
    if args.strict and assessment.grade.value == 'unfit':
        raise UnsupportedDataError(assessment.headline, f'the results are written to {args.out} all the same')


def print_report(
    args: argparse.Namespace, name: str, report: Report, document: Document, more: Mapping[str, str] | None = None
) -> None:
    """Write NAME.json, NAME.html and more files into the folder of ``--out``, where there is one; print the result.

    Raises:
        OutputError: the folder cannot be written.
    """
    from scara_kinetostatic.report.page import as_page, as_text, json_text

    files: dict[str, str] = {}
    if args.out:
        files = {**(more or {}), f'{name}.json': json_text(document), f'{name}.html': as_page(report)}
    print_result(as_text(report), args.out, files, document if args.json else None)
