"""The argument parser of the command, and what several verbs share."""

from __future__ import annotations

import argparse
import difflib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from scara_kinetostatic.model.cell import Cell

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

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Names the verbs without their former names, and the one that resembles an unknown one."""
        if not isinstance(action, argparse._SubParsersAction) or value in action.choices:
            super()._check_value(action, value)
            return
        verbs = [choice.dest for choice in action._choices_actions]
        close = difflib.get_close_matches(value, verbs, 1)
        remedy = f'did you mean {close[0]!r}?' if close else f'the verbs are {", ".join(verbs)}'
        raise argparse.ArgumentError(None, f'there is no verb {value!r}; {remedy}')


Subparsers = argparse._SubParsersAction  # what `add_subparsers` returns; argparse has no public name for it


def add_verb(
    subparsers: Subparsers[argparse.ArgumentParser],
    name: str,
    summary: str,
    description: str,
    example: str,
    run: Callable[[argparse.Namespace], int],
    aliases: Sequence[str] = (),
    unsupported: str = '',
) -> argparse.ArgumentParser:
    """A verb with its help: what it does, an example, the exit statuses.

    Args:
        subparsers: of the command.
        name: of the verb.
        summary: for the list of verbs.
        description: for the verb's own help.
        example: one or more command lines.
        run: from the parsed arguments to the exit status.
        aliases: former names of the verb, which the help does not list.
        unsupported: when else the exit status is 3, a clause; empty for never.
    """
    parser = subparsers.add_parser(
        name,
        help=summary,
        description=description,
        epilog=f'example:\n{example}\n{EXIT_STATUSES}{f"     {unsupported}" if unsupported else ""}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    subparsers.choices.update(dict.fromkeys(aliases, parser))
    return parser


def real(lowest: float = float('-inf'), *, above: bool = False) -> Callable[[str], float]:
    """A type for `add_argument`: a finite number of `lowest` or more, or, with `above`, above it."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f'expected a number, got {text!r}') from None
        if not lowest <= value < float('inf') or (above and value == lowest):
            wanted = 'a finite number' if lowest == float('-inf') else f'{"above" if above else "at least"} {lowest:g}'
            raise argparse.ArgumentTypeError(f'expected {wanted}, got {text}')
        return value

    return convert


def whole(lowest: int) -> Callable[[str], int]:
    """A type for `add_argument`: a whole number of `lowest` or more."""

    def convert(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f'expected a whole number, got {text!r}') from None
        if value < lowest:
            raise argparse.ArgumentTypeError(f'expected {lowest} or more, got {text}')
        return value

    return convert


def add_cell(parser: argparse.ArgumentParser, *, recorded: bool = False) -> None:
    """Adds ``--cell``.

    Args:
        parser: of the verb.
        recorded: whether the default is the cell description in the recordings, rather than the paper's cell.
    """
    default = 'the one in the recording' if recorded else "the paper's cell"
    parser.add_argument('--cell', type=Path, metavar='FILE', help=f'cell description (default: {default})')


def cell_or_paper(path: Path | None) -> Cell:
    """The cell description of ``--cell``; without it the paper's cell.

    Raises:
        CellError: the file cannot be read or is invalid.
    """
    from scara_kinetostatic.files.cell_file import load_cell
    from scara_kinetostatic.model.cell import PAPER_CELL

    return load_cell(path) if path else PAPER_CELL


def cell_or_recorded(path: Path | None, bags: Sequence[Path]) -> Cell:
    """The cell description of ``--cell``; without it the one in the recordings.

    Raises:
        CellError: it cannot be read or is invalid.
        RecordingError: `path` is None, and a recording has no cell description or another one than the first.
    """
    from scara_kinetostatic.bags.inputs import recorded_cell
    from scara_kinetostatic.files.cell_file import load_cell

    return recorded_cell(bags, '--cell') if path is None else load_cell(path)
