"""`scara-kinetostatic VERB …`: runs a verb and turns exceptions into exit statuses."""

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
from pathlib import Path
from types import FrameType
from typing import NoReturn

from scara_kinetostatic import __version__
from scara_kinetostatic.cli.arguments import EXIT_STATUSES, Parser
from scara_kinetostatic.errors import ScaraKinetostaticError, UnsupportedDataError

_PROGRAM = 'scara-kinetostatic'
VERBS = (
    'calibrate',
    'inspect',
    'compensate',
    'locate',
    'contour',
    'simulate',
    'mujoco',
    'demo',
    'dial_gauge',
    'hysteresis',
    'design',
    'paper',
    'export',
    'verify',
    'compare',
    'history',
    'recalibrate',
)
"""Modules of this package, one per verb, in the order of the help."""
_DONE, _INTERNAL, _WRONG_INPUT, _UNSUPPORTED, _INTERRUPTED, _BROKEN_PIPE, _TERMINATED = 0, 1, 2, 3, 130, 141, 143
_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
DEBUG = 'SCARA_KINETOSTATIC_DEBUG'

DESCRIPTION = """\
Kinetostatic calibration of a SCARA robot by touch: the robot presses against
discs of known position while joint angles and forces are recorded; from the
recording its link lengths, offsets, compliances and backlashes are estimated,
each with its uncertainty. Model errors are detected, identified and corrected.
"""
EXAMPLE = """\
try it without a robot:
  scara-kinetostatic simulate --out recording
  scara-kinetostatic inspect recording
  scara-kinetostatic calibrate recording --out result
with an effect that the base model lacks:
  scara-kinetostatic simulate --effect 'object_radius[disc_2]:radius=6e-5' --out larger
  scara-kinetostatic calibrate larger --out result

"""


_AFTER_FINALIZER = 0.02
"""A signal that struck in a finalizer strikes again after so long, s."""


class _TerminatedError(BaseException):
    """The process received SIGTERM."""


def command() -> int:
    """Runs the command as a process of its own.

    OpenBLAS gets one thread, unless the user says otherwise: for matrices of some hundred rows and 13 columns, a
    second thread makes a fit several times slower. At the end garbage is not collected; it is freed with the process.

    Returns:
        Exit status; see `main`.
    """
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')  # read when NumPy is imported
    status = main()
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
    debug = bool(os.environ.get(DEBUG))
    try:
        with _Termination(), _rare_collections():
            parser = build_parser()
            args = parser.parse_args(argv)
            if args.verb is None:  # after unknown options, which are named first
                parser.error('expected a VERB')
            debug = debug or args.debug
            status = int(args.run(args))
            sys.stdout.flush()
            return status
    except SystemExit as end:  # from argparse: --help, --version, a wrong option
        return _flushed(end.code if isinstance(end.code, int) else _WRONG_INPUT)
    except UnsupportedDataError as error:
        return _complain(error, _UNSUPPORTED, debug)
    except ScaraKinetostaticError as error:
        return _complain(error, _WRONG_INPUT, debug)
    except KeyboardInterrupt:
        return _say('interrupted', _INTERRUPTED)
    except _TerminatedError:
        return _say('terminated', _TERMINATED)
    except BrokenPipeError:
        return _reader_gone()
    except OSError as error:
        if error.filename is None and error.errno in _NO_ROOM:  # as in `… > /dev/full`; an error of a file has its name
            return _unwritable(error)
        return _complain_of_bug(error, debug)
    except Exception as error:
        return _complain_of_bug(error, debug)


def build_parser() -> argparse.ArgumentParser:
    """The parser of the whole command."""
    parser = Parser(
        prog=_PROGRAM,
        description=DESCRIPTION,
        epilog=EXAMPLE + EXIT_STATUSES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action='version', version=f'{_PROGRAM} {__version__}')
    parser.add_argument('--debug', action='store_true', help='show the traceback of an error')
    subparsers = parser.add_subparsers(dest='verb', metavar='VERB')
    for verb in VERBS:
        import_module(f'scara_kinetostatic.cli.{verb}').add_parser(subparsers)
    return parser


@contextmanager
def _rare_collections() -> Iterator[None]:
    """Makes Python collect garbage rarely: the modules and figures of a command are needed to its end."""
    before = gc.get_threshold()
    gc.set_threshold(100_000, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


class _Termination:
    """Makes SIGTERM unwind the stack, as Ctrl-C does, so that no half-written file is left. A context manager.

    Python drops an exception of a finalizer: where either signal strikes in one, it strikes again a little later.
    """

    def __init__(self) -> None:
        self._dropped: type[BaseException] | None = None

    def __enter__(self) -> None:
        self._is_main = threading.current_thread() is threading.main_thread()
        if self._is_main:
            self._former = [(each, signal.getsignal(each)) for each in (signal.SIGTERM, signal.SIGALRM)]
            signal.signal(signal.SIGTERM, _terminate)
            signal.signal(signal.SIGALRM, self._strike)
            self._hook, sys.unraisablehook = sys.unraisablehook, self._note

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if not self._is_main:
            return
        signal.setitimer(signal.ITIMER_REAL, 0)
        sys.unraisablehook = self._hook
        for number, handler in self._former:
            signal.signal(number, handler or signal.SIG_DFL)
        if self._dropped is not None and kind is None:
            raise self._dropped

    def _note(self, dropped: sys.UnraisableHookArgs) -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt | _TerminatedError):
            self._dropped = dropped.exc_type
            signal.setitimer(signal.ITIMER_REAL, _AFTER_FINALIZER)
        else:
            self._hook(dropped)

    def _strike(self, number: int, frame: FrameType | None) -> None:
        dropped, self._dropped = self._dropped, None
        if dropped is not None:
            raise dropped


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    raise _TerminatedError


def _prepare_streams() -> None:
    """Discards what is written to a closed stream; writes ``?`` for a character that the terminal does not have."""
    for name in ('stdout', 'stderr'):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open('w', encoding='utf-8'))  # noqa: SIM115  to the end of the process
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, 'reconfigure'):
            stream.reconfigure(errors='replace')


def _complain(error: object, status: int, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    return _say(error, status)


def _complain_of_bug(error: Exception, debug: bool) -> int:
    remedy = f'please report it with what {_PROGRAM} --debug … prints'
    return _complain(f'internal error, {type(error).__name__}: {error}; {remedy}', _INTERNAL, debug)


def _say(what: object, status: int) -> int:
    line = ' '.join(str(what).split())
    with suppress(OSError):  # a full disk behind stderr must not change the status
        print(f'{_PROGRAM}: {line}', file=sys.stderr, flush=True)
    return status


def _flushed(status: int) -> int:
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        return _reader_gone()
    except OSError as error:
        return _unwritable(error)
    return status


def _reader_gone() -> int:
    """As in `… | head`."""
    _forget_stdout()
    return _BROKEN_PIPE


def _unwritable(error: OSError) -> int:
    """As in `… > /dev/full`."""
    _forget_stdout()
    return _say(f'stdout cannot be written: {error.strerror}; the result files are complete', _WRONG_INPUT)


def _forget_stdout() -> None:
    """Discards what would be flushed at exit."""
    with suppress(OSError):  # it may not be a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == '__main__':
    sys.exit(command())
