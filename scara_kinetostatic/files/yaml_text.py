"""Safe YAML: the one parser of all YAML files.

Both functions refuse tags, anchors and aliases (no file here needs them, and nested aliases grow without bound), and
limit the depth of nesting. `parse_yaml`, for files that a user writes, is also stricter than `yaml.safe_load`:

- a key given twice is an error (`yaml.safe_load` keeps the last one);
- numbers follow the core schema of YAML 1.2: `1e-5` is a number (YAML 1.1 requires `1.0e-5`), `010` is ten (not
  eight), `1:30` is a string (not ninety), and so are `on`, `off`, `yes`, `no`;
- the size is limited.

`parse_strings`, for files that programs write, leaves every scalar as text.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from scara_kinetostatic.errors import InputError

_MAX_BYTES = 256 * 1024
"""Largest file that a user writes, bytes."""
_MAX_DEPTH = 32
"""Deepest nesting; a cell description has 4 levels, the metadata of a recording 8."""
_StringLoader = getattr(yaml, 'CBaseLoader', yaml.BaseLoader)
"""Leaves scalars as text; in C where PyYAML has been built with it."""

_Problem = type[InputError]


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


def read_text(path: str | Path, problem: _Problem) -> str:
    """The text of a small file a user wrote.

    Args:
        path: the file.
        problem: error class to raise.

    Raises:
        problem: no such file, no regular file, unreadable, over `_MAX_BYTES` or not UTF-8.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise problem(path, 'there is no such file', 'check the path')
        if not path.is_file():
            raise problem(path, 'expected a file, got ' + ('a folder' if path.is_dir() else 'something else'))
        size = path.stat().st_size
        if size > _MAX_BYTES:
            raise problem(path, f'expected at most {_MAX_BYTES // 1024} KiB of YAML, got {size} bytes')
        return path.read_bytes().decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise problem(path, f'not UTF-8 text (byte {error.start})', 'save it as UTF-8') from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise problem(path, f'cannot be read: {reason}') from error


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
        raise problem(where, f'expected at most {_MAX_BYTES // 1024} KiB of YAML, got {len(text)} characters')
    loader = None
    try:
        _check_events(text, yaml.BaseLoader)
        loader = _Loader(text)
        return loader.get_single_data()
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise problem(where, f'not valid YAML: {_reason(error)}') from error
    finally:
        if loader is not None:
            loader.dispose()


def parse_strings(text: str) -> Any:
    """The one document in a YAML text, as dicts, lists and strings.

    Args:
        text: the YAML.

    Raises:
        ValueError: the text is not valid, with the line.
    """
    try:
        _check_events(text, _StringLoader)
        return yaml.load(text, Loader=_StringLoader)
    except yaml.YAMLError as error:
        raise ValueError(_reason(error)) from error


def _check_events(text: str, loader: Any) -> None:
    """Refuses tags, anchors, aliases and deep nesting before anything is built: the loaders recurse at every level.

    Raises:
        yaml.YAMLError: one of these is there, or the text is not valid.
    """
    depth = 0
    for event in yaml.parse(text, Loader=loader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        problem, tag = '', getattr(event, 'tag', None)
        if isinstance(event, yaml.AliasEvent) or getattr(event, 'anchor', None) is not None:
            problem = 'anchors and aliases are not allowed'
        elif tag is not None:
            problem = f'the tag {tag!r} is not allowed'
        elif depth > _MAX_DEPTH:
            problem = f'nested deeper than {_MAX_DEPTH}'
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
