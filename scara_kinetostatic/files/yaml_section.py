"""One mapping of a YAML file with its place in the file, so that every error names the key."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from typing import Any, TypeVar

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.parameters import implausible_size

_LONGEST_WORD = 200
_LONGEST_SHOWN = 60
_E = TypeVar('_E', bound=Enum)


class Section:
    """A mapping with known keys.

    Args:
        problem: error class to raise.
        where: the file, for messages.
        key: place in the file, such as `robot.nominal`; empty at the top.
        data: what the file has there.
        required: keys that must be there.
        optional: keys that may be there.

    Attributes:
        data: the values by key.

    Raises:
        problem: `data` is not a mapping, or has an unknown key, or lacks one. All methods that give a value raise it
            for a wrong value, with the key.
    """

    def __init__(
        self,
        problem: type[InputError],
        where: str,
        key: str,
        data: Any,
        required: Iterable[str] = (),
        optional: Iterable[str] = (),
    ) -> None:
        self._problem, self._where, self._key = problem, where, key
        required, known = tuple(required), (*required, *optional)
        if data is None and not required:
            data = {}
        if not isinstance(data, Mapping):
            raise self.error('', f'expected a mapping with {", ".join(known)}, got {shown(data)}')
        self.data = data
        for name in data:
            if name not in known:
                close = difflib.get_close_matches(name, known, 1)
                remedy = f'did you mean {close[0]!r}?' if close else f'the keys here are {", ".join(known)}'
                raise self.error('', f'unknown key {name!r}', remedy)
        for name in required:
            if data.get(name) is None:
                raise self.error('', f'the key {name!r} is missing', 'add it')

    def error(self, name: str, problem: str, remedy: str = '') -> InputError:
        """An error that names the key `name` of this section, or the section itself where it is empty."""
        key = self._path(name)
        return self._problem(f'{self._where}: {key}' if key else self._where, problem, remedy)

    def section(self, name: str, required: Iterable[str] = (), optional: Iterable[str] = ()) -> Section:
        """The mapping under a key; an empty one where it is missing and nothing in it is required."""
        return self._inside(self._path(name), self.data.get(name), required, optional)

    def items(self, name: str, what: str, required: Iterable[str] = (), optional: Iterable[str] = ()) -> list[Section]:
        """The mappings in the list under a key, at least one; `what` names them in the message."""
        items = self.data[name]
        if not isinstance(items, list) or not items:
            raise self.error(name, f'expected a list of {what}, got {shown(items)}', 'give at least one')
        path = self._path(name)
        return [self._inside(f'{path}[{number}]', item, required, optional) for number, item in enumerate(items)]

    def number(self, name: str, unit: str = '') -> float:
        """A finite number of a plausible size (`implausible_size`)."""
        value = self.data[name]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(name, f'expected a number, got {shown(value)}')
        if not math.isfinite(value):
            raise self.error(name, f'expected a finite number, got {value}')
        implausible = implausible_size(value, unit)
        if implausible:
            raise self.error(name, *implausible)
        return float(value)

    def positive(self, name: str, unit: str = '') -> float:
        """A number above 0."""
        value = self.number(name, unit)
        if value <= 0:
            raise self.error(name, f'expected a number above 0, got {value:g}')
        return value

    def not_negative(self, name: str, unit: str = '') -> float:
        """A number of 0 or more."""
        value = self.number(name, unit)
        if value < 0:
            raise self.error(name, f'expected 0 or more, got {value:g}')
        return value

    def vector(self, name: str, labels: Sequence[str], unit: str = '') -> tuple[float, ...]:
        """A list of as many numbers as there are labels, which name them in messages: `[x, y]`."""
        values = self.data[name]
        if not isinstance(values, list) or len(values) != len(labels):
            raise self.error(name, f'expected [{", ".join(labels)}], got {shown(values)}')
        entries = self.entries(name, dict(zip(labels, values, strict=True)))
        return tuple(entries.number(label, unit) for label in labels)

    def entries(self, name: str, values: Mapping[str, Any]) -> Section:
        """The entries of a list under a key as a section, by labels that name them in messages."""
        return self._inside(self._path(name), values, (), values)

    def word(self, name: str, default: str = '') -> str:
        """A string that can serve as a name."""
        value = self.data.get(name, default)
        if not isinstance(value, str):
            raise self.error(name, f'expected a string, got {shown(value)}', 'put it in quotes')
        if not value.strip() or value != value.strip() or not value.isprintable():
            raise self.error(name, f'expected a name, got {shown(value)}')
        if len(value) > _LONGEST_WORD:
            raise self.error(name, f'expected at most {_LONGEST_WORD} characters, got {len(value)}')
        return value

    def choice(self, name: str, default: _E) -> _E:
        """A value of the enumeration that `default` belongs to."""
        value = self.word(name, str(default.value))
        choices = [str(item.value) for item in type(default)]
        if value not in choices:
            raise self.error(name, f'expected {" or ".join(choices)}, got {shown(value)}')
        return type(default)(value)

    def _inside(self, key: str, data: Any, required: Iterable[str], optional: Iterable[str]) -> Section:
        return Section(self._problem, self._where, key, data, required, optional)

    def _path(self, name: str) -> str:
        return '.'.join(part for part in (self._key, name) if part)


def shown(value: Any) -> str:
    """A value for a message, shortened."""
    text = repr(value)
    return text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + '...'
