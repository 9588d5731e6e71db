"""The argument parser of the command, and what several verbs share."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import NoReturn

EXIT_STATUSES = """\
exit status:
  0  done
  2  the command or an input is wrong; one line on stderr says which file, topic or key, and what to do
  3  the data cannot support a calibration (no contact, too few touches, ...)
"""


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and where to read on."""

    def error(self, message: str) -> NoReturn:
        """Ends with exit status 2."""
        self.exit(2, f'{self.prog}: {" ".join(message.split())}; see {self.prog} --help\n')


Subparsers = argparse._SubParsersAction  # what `add_subparsers` returns; argparse has no public name for it


def add_verb(
    subparsers: Subparsers[argparse.ArgumentParser],
    name: str,
    summary: str,
    description: str,
    example: str,
    run: Callable[[argparse.Namespace], int],
    aliases: Sequence[str] = (),
) -> argparse.ArgumentParser:
    """A verb with its help: what it does, an example, the exit statuses.

    Args:
        subparsers: of the command.
        name: of the verb.
        summary: for the list of verbs.
        description: for the verb's own help.
        example: one or more command lines.
        run: from the parsed arguments to the exit status.
        aliases: other names of the verb.
    """
    parser = subparsers.add_parser(
        name,
        aliases=aliases,
        help=summary,
        description=description,
        epilog=f'example:\n{example}\n{EXIT_STATUSES}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
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
