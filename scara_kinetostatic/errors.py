"""Every error this package raises on purpose, under one root; each carries its data.

The command line turns them into exit statuses in one place (`cli.main`), the
nodes into a failed service answer; nothing else catches the root.

- `InputError` and its kin (exit status 2): a file, a key, an option is wrong;
  the message names it and says what to do.
- `UnsupportedDataError` (exit status 3): the inputs are well-formed, but the
  data cannot support a calibration.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

PYPI = ('rosbags', 'mcap', 'lz4', 'zstandard', 'threadpoolctl')
"""What reads and writes recordings, and `threads`, by the names of pip; apt does not have all of them."""
_PIP = {'yaml': 'pyyaml', 'mujoco': "'mujoco>=3.13'", 'control_msgs': ''}
_PIP |= {'distributed': "'scara_kinetostatic[cluster]'"}
_APT = dict.fromkeys((*PYPI, 'mujoco', 'distributed'), '')
"""Names by which pip and apt install a module, empty for not at all; else its own, and that after `python3-`."""


def one_line(text: str) -> str:
    """The text on one line, with a mark for everything that would disturb a terminal; damaged files hold anything."""
    return ''.join(letter if letter.isprintable() else '\ufffd' for letter in ' '.join(text.split()))


def some_of(names: Sequence[str], most: int = 8) -> str:
    """The first of some names, and how many there are besides."""
    return ', '.join(names[:most]) + f' and {len(names) - most} more' * (len(names) > most)


def did_you_mean(name: object, names: Iterable[str], otherwise: str = 'the names are') -> str:
    """The remedy for an unknown name: the one among `names` that resembles it, or all of them."""
    listed = list(dict.fromkeys(names))
    lower = {known.lower(): known for known in listed}
    close = difflib.get_close_matches(str(name).lower(), lower, 1)
    return f'did you mean {lower[close[0]]!r}?' if close else f'{otherwise} {" ".join(listed)}'


class ScaraKinetostaticError(Exception):
    """Root of all errors of this package."""

    def __reduce__(self) -> tuple[object, ...]:
        """As an error comes from another process: with its data, not made anew from its message."""
        return type(self).__new__, (type(self), *self.args), vars(self)


class InputError(ScaraKinetostaticError):
    """An input is wrong. The message is one line: where, what, and what to do.

    Args:
        where: the file, topic, option or parameter at fault.
        problem: what is wrong with it ("expected X, got Y").
        remedy: what the user can do about it.

    Example:
        >>> import scara_kinetostatic as sk
        >>> try:
        ...     sk.load_cell('no_such_cell.yaml')
        ... except sk.InputError as error:
        ...     print(error.where)
        no_such_cell.yaml
    """

    def __init__(self, where: str | Path, problem: str, remedy: str = '') -> None:
        self.where = str(where)
        self.problem = problem
        self.remedy = remedy
        super().__init__(one_line(f'{where}: {problem}' + (f'; {remedy}' if remedy else '')))


class CellError(InputError):
    """A cell description that cannot be read or makes no sense."""


class RecordingError(InputError):
    """A recording that cannot be read, or lacks what is needed."""


class CalibrationFileError(InputError):
    """A file of a calibration that cannot be read, or is none."""


class OutputError(InputError):
    """A place that cannot be written to."""


class ParameterError(InputError):
    """A parameter name or value that makes no sense."""


class MissingLibraryError(InputError, ImportError):
    """A library that cannot be imported; the message says what installs it."""


@contextmanager
def naming_missing_libraries() -> Iterator[None]:
    """Of a library that cannot be imported within, the error says what installs it.

    Raises:
        MissingLibraryError: in place of the `ImportError` of a library; one of this package or of Python is a bug.
    """
    try:
        yield
    except ImportError as error:
        name = str(error.name).partition('.')[0]
        if isinstance(error, MissingLibraryError) or name in (__package__, 'None', *sys.stdlib_module_names):
            raise
        names = [one for one in PYPI if name in PYPI and find_spec(one) is None] or [name]
        apt, pip = _APT.get(name, f'python3-{name}'), ' '.join(_PIP.get(one, one) for one in names)
        if name == 'rclpy' or name.endswith(('_msgs', '_interfaces')):
            apt, pip = f'ros-jazzy-{name.replace("_", "-")}', pip and "'scara_kinetostatic[ros]'"
        ways = ['source /opt/ros/jazzy/setup.bash'] if 'ros]' in pip else []
        ways += [f'{tool} install {what}' for tool, what in (('pip', pip), ('apt', apt)) if what]
        problem = 'not installed' if isinstance(error, ModuleNotFoundError) else f'cannot be imported: {error}'
        raise MissingLibraryError(' '.join(names), problem, ', or '.join(ways)) from error


def expect(value: object, kind: type, name: str, remedy: str = '') -> None:
    """Check the type of an argument.

    Raises:
        ParameterError: it has another one.
    """
    if not isinstance(value, kind):
        raise ParameterError(name, f'expected {kind.__name__}, got {type(value).__name__}', remedy)


class UnsupportedDataError(ScaraKinetostaticError):
    """The data cannot support a calibration (too few touches, no contact, …).

    Args:
        problem: what is lacking.
        remedy: which data would do.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> touches = sk.make_touches([0.8355, 2.1317], [-9.8, -0.1], cell)
        >>> try:
        ...     sk.calibrate(touches, cell)
        ... except sk.UnsupportedDataError as error:
        ...     print('too few' in error.problem)
        True
    """

    def __init__(self, problem: str, remedy: str = '') -> None:
        self.problem = problem
        self.remedy = remedy
        super().__init__(one_line(problem + (f'; {remedy}' if remedy else '')))
