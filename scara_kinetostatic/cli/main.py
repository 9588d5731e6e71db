"""`scara-kinetostatic VERB …`: runs a verb and turns exceptions into exit statuses, here alone.

A verb is one file: its help as docstring, a table of its `ARGUMENTS`, and `run`, which imports what it needs.
`arguments` has what verbs share.
"""

from __future__ import annotations

import argparse
import errno
import gc
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import NoReturn

from scara_kinetostatic import __version__, cli
from scara_kinetostatic.cli.shared_arguments import EXIT_STATUSES, Parser, add_verb
from scara_kinetostatic.errors import ScaraKinetostaticError, UnsupportedDataError, naming_missing_libraries
from scara_kinetostatic.threads import process_of_one_thread

VERBS = {
    'calibration': ('cell', 'calibrate', 'recalibrate', 'inspect', 'verify', 'compare', 'history'),
    'use of a calibration': ('compensate', 'locate', 'export', 'contour'),
    'planning': ('simulate', 'design', 'next', 'demo'),
    'studies': ('paper', 'dial-gauge', 'hysteresis', 'mujoco'),
}
"""In the groups and the order of the help; each is a module of this package."""


_SIGNALLED = 128
"""The exit status of a process that a signal ends is this and the signal's number."""


class _TerminatedError(BaseException):
    """The process received SIGTERM."""


def command() -> int:
    """Runs the command as a process of its own.

    Linear algebra gets one thread (`threads`). Garbage is collected rarely, and not at the end: modules and figures are
    needed to the end of the process and freed with it.

    Returns:
        Exit status; see `main`.
    """
    process_of_one_thread()
    gc.set_threshold(100_000)
    status = main()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is written
    gc.freeze()
    return status


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command's verb.

    Args:
        argv: the arguments; None: those of the process.

    Returns:
        0 done; 2 the command or an input is wrong; 3 the data cannot support a calibration;
        130 interrupted by Ctrl-C; 143 by SIGTERM; 141 stdout was closed by its reader; 1 a bug.
    """
    _prepare_streams()
    debug, received = False, list[int]()
    try:
        try:
            with _termination(received), naming_missing_libraries():
                given = sys.argv[1:] if argv is None else argv
                parser = build_parser(next((text for text in given if text != '--debug'), ''))
                args = parser.parse_args(given)
                if args.verb is None:  # after unknown options, which are named first
                    parser.error('expected a VERB')
                debug = args.debug
                args.run(args)
                status = 0
        except SystemExit as end:  # from argparse: --help, --version, a wrong option
            status = end.code if isinstance(end.code, int) else 2
        except ScaraKinetostaticError as error:
            status = _say(error, 3 if isinstance(error, UnsupportedDataError) else 2, debug)
        except KeyboardInterrupt:
            status = _say('interrupted', _SIGNALLED + signal.SIGINT)
        except _TerminatedError:
            status = _say('terminated', _SIGNALLED + signal.SIGTERM)
        except BrokenPipeError:
            raise
        except Exception as error:
            no_room = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
            if isinstance(error, OSError) and error.filename is None and error.errno in no_room:
                raise
            if received and not debug:  # what was interrupted may fail in its own way when it is closed
                status = _say('terminated', _SIGNALLED + signal.SIGTERM)
            else:
                remedy = 'please report it with what scara-kinetostatic --debug … prints'
                status = _say(f'internal error, {type(error).__name__}: {error}; {remedy}', 1, debug)
        sys.stdout.flush()
    except BrokenPipeError:  # as in `… | head`
        _forget_stdout()
        return _SIGNALLED + signal.SIGPIPE
    except OSError as error:  # as in `… > /dev/full`
        _forget_stdout()
        return _say(f'stdout cannot be written: {error.strerror}; the result files are complete', 2)
    return status


def build_parser(verb: str = '') -> argparse.ArgumentParser:
    """The parser of one verb, which is faster, or of the whole command."""
    description, _, example = (cli.__doc__ or '').partition('\nExample:\n')
    parser: argparse.ArgumentParser = Parser(
        prog='scara-kinetostatic',
        epilog=f'{example}\n{EXIT_STATUSES}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'scara-kinetostatic {__version__}')
    parser.add_argument('--debug', action='store_true', help='show the traceback of an error')
    verb_help = 'one of these; VERB --help describes it'
    subparsers = parser.add_subparsers(dest='verb', metavar='VERB', help=verb_help)
    only = (verb,) if verb in chain(*VERBS.values()) else ()
    for group, verbs in VERBS.items():
        description += f'\n{group}:\n'
        for name in verbs:
            if name in (only or verbs):
                description += add_verb(subparsers, import_module(f'scara_kinetostatic.cli.{name.replace("-", "_")}'))
    parser.description = description
    return parser


@contextmanager
def _termination(received: list[int]) -> Iterator[None]:
    """Makes SIGTERM unwind the stack, as Ctrl-C does, so that no half-written file is left; `received` notes it."""

    def terminate(number: int, _: object) -> NoReturn:
        received.append(number)
        raise _TerminatedError

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, former or signal.SIG_DFL)


def _prepare_streams() -> None:
    """Discards what is written to a closed stream; writes ``?`` for a character that the terminal does not have."""
    for name in ('stdout', 'stderr'):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open('w', encoding='utf-8'))  # noqa: SIM115  to the end of the process
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, 'reconfigure'):
            stream.reconfigure(errors='replace')


def _say(what: object, status: int, debug: bool = False) -> int:
    """One line on stderr, after the traceback where that is wanted; gives the status."""
    if debug:
        traceback.print_exc()
    line = ' '.join(str(what).split())
    with suppress(OSError):  # a full disk behind stderr must not change the status
        print(f'scara-kinetostatic: {line}', file=sys.stderr, flush=True)
    return status


def _forget_stdout() -> None:
    """Discards what would be flushed at exit."""
    with suppress(OSError):  # it may not be a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == '__main__':
    sys.exit(command())
