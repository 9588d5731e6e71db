"""Safe YAML: the one parser of all YAML files, and the one reader of typed keys with their places, `MappingReader`.

Both parsers refuse tags, anchors and aliases (no file here needs them, and nested aliases grow without bound), and
limit the depth of nesting. `parse_yaml`, for files that a user writes, is also stricter than `yaml.safe_load`:

- a key given twice is an error (`yaml.safe_load` keeps the last one);
- numbers follow the core schema of YAML 1.2: `1e-5` is a number (YAML 1.1 requires `1.0e-5`), `010` is ten (not
  eight), `1:30` is a string (not ninety), and so are `on`, `off`, `yes`, `no`;
- the size is limited.

`parse_strings`, for files that programs write, leaves every scalar as text.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import yaml

from scara_kinetostatic.errors import InputError, ParameterError
from scara_kinetostatic.files.atomic import KIB, read_file
from scara_kinetostatic.files.tables import FORMULA
from scara_kinetostatic.model.quantities import implausible_size

_MAX_BYTES = 256 * KIB
"""Largest file that a user writes, bytes."""
_MOST_VALUES, _MOST_STRINGS = 40_000, 400_000
"""Most values and keys in one that a user writes, and in one of a program: the metadata of 10 000 files has 110 000."""
_SHOWN = 60
"""Characters of a value that a message shows."""
_MAX_DEPTH = 32
"""Deepest nesting; a cell description has 4 levels, the metadata of a recording 8."""
_StringLoader = getattr(yaml, 'CBaseLoader', yaml.BaseLoader)
"""Leaves scalars as text; in C where PyYAML has been built with it."""

_Problem = type[InputError]
_Keys = Iterable[str]


class _Loader(yaml.SafeLoader):
    """Safe loader with the core schema of YAML 1.2 and without repeated keys."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        mapping: dict[Hashable, Any] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.MarkedYAMLError(problem='a key must be a word', problem_mark=key_node.start_mark)
            key = str(key_node.value)
            if key in mapping:
                raise yaml.MarkedYAMLError(problem=f'the key {key!r} is given twice', problem_mark=key_node.start_mark)
            mapping[key] = self.construct_object(value_node, deep=True)
        return mapping

    def construct_core_int(self, node: yaml.ScalarNode) -> int | float:
        text = str(node.value)
        return int(text) if len(text) < 100 else float(text)

    def construct_core_float(self, node: yaml.ScalarNode) -> float:
        return float(str(node.value).replace('.inf', 'inf').replace('.nan', 'nan'))


_CORE_SCHEMA = (
    ('null', r'~|null|Null|NULL|', '~nN'),
    ('bool', r'true|True|TRUE|false|False|FALSE', 'tTfF'),
    ('int', r'[-+]?[0-9]+', '-+0123456789'),
    ('float', r'[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.inf|\.nan', '-+.0123456789'),
)
_Loader.yaml_implicit_resolvers = {}
for _name, _pattern, _first in _CORE_SCHEMA:
    _starts = [*_first, ''] if _name == 'null' else list(_first)
    _Loader.add_implicit_resolver(f'tag:yaml.org,2002:{_name}', re.compile(rf'(?:{_pattern})\Z'), _starts)
_Loader.add_constructor('tag:yaml.org,2002:map', _Loader.construct_mapping)
_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_core_int)
_Loader.add_constructor('tag:yaml.org,2002:float', _Loader.construct_core_float)


def read_text(path: str | Path, problem: _Problem, most: int = _MAX_BYTES, what: str = 'YAML') -> str:
    """The text of a file, usually of a small one that a user wrote.

    Args:
        path: the file.
        problem: error class to raise.
        most: largest size, bytes.
        what: it is expected to hold, for messages.

    Raises:
        problem: as `read_file`, or not UTF-8.
    """
    try:
        return read_file(path, problem, most, what).decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise problem(path, f'not UTF-8 text (byte {error.start})', 'save it as UTF-8') from error


def parse_yaml(text: str, where: str | Path, problem: _Problem) -> Any:
    """The one document in a YAML text, as dicts (with string keys), lists, strings, numbers, bools and None.

    Args:
        text: the YAML.
        where: its file, for messages.
        problem: error class to raise.

    Raises:
        problem: the text is not valid, with the line.
    """
    if len(text) > _MAX_BYTES:
        raise problem(where, f'expected at most {_MAX_BYTES // KIB} KiB of YAML, got {len(text)} characters')
    try:
        _check_events(text, yaml.BaseLoader, _MOST_VALUES)
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise problem(where, f'not valid YAML: {_reason(error)}') from error


class _Dumper(yaml.SafeDumper):
    """Puts what `parse_yaml` would read as a number in quotes: 1e3 and 08 are some, and strings for PyYAML."""


_, _number, _first = _CORE_SCHEMA[-1]
_Dumper.add_implicit_resolver('tag:yaml.org,2002:float', re.compile(rf'(?:{_number})\Z'), [*_first])


def dump_yaml(tree: Any, flow: bool = False) -> str:
    """Plain values as YAML, in braces and brackets on one line, without its end, if `flow`."""
    style: dict[str, Any] = {'default_flow_style': flow, 'width': math.inf, 'sort_keys': False, 'allow_unicode': True}
    text: str = yaml.dump(tree, Dumper=_Dumper, **style)
    return text.removesuffix('\n').removesuffix('\n...') if flow else text


def parse_strings(text: str) -> Any:
    """The one document in a YAML text, as dicts, lists and strings.

    Args:
        text: the YAML.

    Raises:
        ValueError: the text is not valid, with the line.
    """
    try:
        _check_events(text, _StringLoader, _MOST_STRINGS)
        return yaml.load(text, Loader=_StringLoader)
    except yaml.YAMLError as error:
        raise ValueError(_reason(error)) from error


def node_sections(path: str | Path) -> dict[str, re.Pattern[str]]:
    """The sections of a parameter file of ROS: the name of each, and what the full names match of the nodes it is for.

    Args:
        path: the file. `*` stands for one name, `**` for any number of them. One that cannot be parsed here counts as
            for all: rcl takes more than this parser, and says what is wrong.

    Raises:
        ParameterError: it cannot be read.
    """

    def walk(tree: Any, name: str) -> Iterator[str]:
        for key, value in tree.items() if isinstance(tree, dict) else ():
            yield from [name] if key == 'ros__parameters' else walk(value, f'{name}/{key.strip("/")}')

    text = read_text(path, ParameterError)
    with suppress(ValueError):
        names = {name: re.escape(name).replace(r'/\*\*', r'(/\w+)*') for name in walk(parse_strings(text), '')}
        return {name: re.compile(pattern.replace(r'/\*', r'/\w+') + r'\Z') for name, pattern in names.items()}
    return {'/**': re.compile('')}


def _check_events(text: str, loader: Any, most: int) -> None:
    """Refuses tags, anchors, aliases, deep nesting and more than so many values before anything is built: the loaders
    recurse at every level.

    Raises:
        yaml.YAMLError: one of these is there, or the text is not valid.
    """
    depth = 0
    for number, event in enumerate(yaml.parse(text, Loader=loader)):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        problem, tag = '', getattr(event, 'tag', None)
        if isinstance(event, yaml.AliasEvent) or getattr(event, 'anchor', None) is not None:
            problem = 'anchors and aliases are not allowed'
        elif tag is not None:
            problem = f'the tag {tag!r} is not allowed'
        elif depth > _MAX_DEPTH:
            problem = f'nested deeper than {_MAX_DEPTH}'
        elif number > most:
            problem = f'more than {most} values'
        if problem:
            mark: Any = event.start_mark
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


def _reason(error: Exception) -> str:
    """What is wrong, with the line where it is known."""
    if not isinstance(error, yaml.MarkedYAMLError):
        return str(error)
    mark = error.problem_mark or error.context_mark
    line = f'line {mark.line + 1}: ' if mark else ''
    return f'{line}{error.problem or error.context}'


_E = TypeVar('_E', bound=Enum)


@dataclass(frozen=True)
class Within:
    """The limits of a number, and what to do where it is beyond them; called, it reads such a number.

    Where there is no upper limit, that of its unit holds (`implausible_size`).
    """

    least: float = -math.inf
    most: float = math.inf
    remedy: str = ''
    positive: bool = False
    unit: str = ''

    @classmethod
    def size(cls, most: float, remedy: str = '', unit: str = '') -> Within:
        """Numbers of either sign up to a size."""
        return cls(-most, most, remedy, unit=unit)

    def __str__(self) -> str:
        if self.most == math.inf:
            return 'a number above 0' if self.positive else f'{self.least:g} or more'
        least = 'above 0, at most' if self.positive else f'{self.least:g} to'
        return f'{least} {self.most:g} {self.unit}'.rstrip()

    def __call__(self, section: MappingReader, name: str) -> float:
        """The number under a key of a section."""
        return section.number(name, self)


ANY = Within()
_DECIMAL_COMMA = re.compile(r'[-+]?\d+,\d+([eE][-+]?\d+)?')


class MappingReader:
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
        self, problem: _Problem, where: str, key: str, data: Any, required: _Keys = (), optional: _Keys = ()
    ) -> None:
        self._problem, self._where, self._key = problem, where, key
        required = tuple(required)
        known = tuple(dict.fromkeys((*required, *optional)))
        if data is None and not required:
            data = {}
        if not isinstance(data, Mapping):
            raise self.error('', f'expected a mapping with {", ".join(known)}, got {shown(data)}')
        self.data = data
        for before, name in pairwise([None, *data]):
            if name not in known:
                if before is not None and name.isdecimal() and data[name] is None:  # in braces: {l1: 0,25}
                    whole = f'{data[before]},{name}'
                    raise self.error(before, f'{whole} has a decimal comma', f'write {whole.replace(",", ".")}')
                close = difflib.get_close_matches(name, known, 1)
                remedy = f'did you mean {close[0]!r}?' if close else f'the keys here are {", ".join(known)}'
                raise self.error('', f'unknown key {name!r}', remedy)
        if missing := [repr(name) for name in required if data.get(name) is None]:
            one = len(missing) == 1
            text = f'the {"key" if one else "keys"} {", ".join(missing)} {"is" if one else "are"} missing'
            raise self.error('', text, 'add it' if one else 'add them')

    def error(self, name: str, problem: str, remedy: str = '') -> InputError:
        """An error that names the key `name` of this section, or the section itself where it is empty."""
        key = self._path(name)
        return self._problem(f'{self._where}: {key}' if key else self._where, problem, remedy)

    def read(self, readers: Mapping[str, Reader], stated: _Keys = ()) -> dict[str, Any]:
        """The values of the keys that are given, each by its reader: a function of the section and the key.

        A key with nothing behind it counts as left out, except those of `stated`.
        """
        given = {name for name, value in self.data.items() if value is not None or name in stated}
        return {name: reader(self, name) for name, reader in readers.items() if name in given}

    def record(
        self, name: str, readers: Mapping[str, Reader], required: _Keys = (), stated: _Keys = ()
    ) -> dict[str, Any]:
        """The values in the mapping under a key."""
        return self.section(name, required, readers).read(readers, stated)

    def section(self, name: str, required: _Keys = (), optional: _Keys = ()) -> MappingReader:
        """The mapping under a key; an empty one where it is missing and nothing in it is required."""
        return self._inside(self._path(name), self.data.get(name), required, optional)

    def items(
        self, name: str, what: str, required: _Keys, optional: _Keys, most: int = 64, other: tuple[_Keys, ...] = ()
    ) -> list[MappingReader]:
        """The mappings in the list under a key, from one to `most`; `what` names them in the message.

        Those that have the last of the required keys of `other` have its required and optional keys.
        """
        items = self.data[name]
        if not isinstance(items, list) or not items:
            raise self.error(name, f'expected a list of {what}, got {shown(items)}', 'give at least one')
        if len(items) > most:
            raise self.error(name, f'expected at most {most} {what}, got {len(items)}')
        found, last = [], [*other[0]][-1] if other else None
        for k, item in enumerate(items):
            keys = other if other and isinstance(item, Mapping) and last in item else (required, optional)
            found.append(self._inside(f'{self._path(name)}[{k}]', item, *keys))
        return found

    def number(self, name: str, within: Within = ANY) -> float:
        """A finite number within its limits."""
        value = self.data[name]
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            comma = _DECIMAL_COMMA.fullmatch(str(value))
            remedy = f'write {comma[0].replace(",", ".")}: decimals have a point, not a comma' if comma else ''
            raise self.error(name, f'expected a number, got {shown(value)}', remedy)
        if not math.isfinite(value):
            raise self.error(name, f'expected a finite number, got {value}')
        if within.most == math.inf and (implausible := implausible_size(value, within.unit)):
            raise self.error(name, *implausible)
        if not within.least <= value <= within.most or (within.positive and value <= 0):
            raise self.error(name, f'expected {within}, got {value:g}', within.remedy)
        return float(value)

    def optional(self, name: str, within: Within = ANY) -> float | None:
        """The same; None where the key is missing."""
        return None if self.data.get(name) is None else self.number(name, within)

    def vector(self, name: str, labels: Sequence[str], reader: Reader = ANY) -> tuple[Any, ...]:
        """A list with as many entries, numbers unless told, as there are labels, which name them in messages."""
        values = self.data[name]
        if not isinstance(values, list) or len(values) != len(labels):
            commas = isinstance(values, list) and len(values) > len(labels)
            remedy = 'decimals have a point, not a comma' if commas else ''
            raise self.error(name, f'expected [{", ".join(labels)}], got {shown(values)}', remedy)
        entries = self._inside(self._path(name), dict(zip(labels, values, strict=True)), (), labels)
        return tuple(reader(entries, label) for label in labels)

    def flag(self, name: str) -> bool:
        """True or false."""
        value = self.data[name]
        if not isinstance(value, bool):
            raise self.error(name, f'expected true or false, got {shown(value)}')
        return value

    def word(self, name: str) -> str:
        """A string that can serve as a name."""
        value = self.data[name]
        if not isinstance(value, str):
            raise self.error(name, f'expected a string, got {shown(value)}', 'put it in quotes')
        if not value.strip() or value != value.strip() or not value.isprintable():
            raise self.error(name, f'expected a name, got {shown(value)}')
        if len(value) > 200:
            raise self.error(name, f'expected at most 200 characters, got {len(value)}')
        if value.startswith(FORMULA):
            raise self.error(name, f'{shown(value)} is a formula to spreadsheets', 'begin it with a letter')
        return value

    def _inside(self, key: str, data: Any, required: _Keys, optional: _Keys) -> MappingReader:
        return MappingReader(self._problem, self._where, key, data, required, optional)

    def _path(self, name: str) -> str:
        return '.'.join(part for part in (self._key, name) if part)


Reader = Callable[[MappingReader, str], Any]


def choice(kind: type[_E]) -> Callable[[MappingReader, str], _E]:
    """Reads a value of an enumeration."""

    def read(section: MappingReader, name: str) -> _E:
        value, choices = section.word(name), [str(item.value) for item in kind]
        if value not in choices:
            raise section.error(name, f'expected {" or ".join(choices)}, got {shown(value)}')
        return kind(value)

    return read


def shown(value: Any) -> str:
    """A value for a message, shortened."""
    text = repr(value)
    return text if len(text) <= _SHOWN else text[: _SHOWN - 3] + '...'
