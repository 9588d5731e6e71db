"""YAML as data and nothing else: the one loader for every file a user writes.

Stricter than `yaml.safe_load`, so that a slip is an error and not a surprise:

- a key given twice is an error (YAML silently keeps the last one);
- tags, anchors and aliases are refused (nothing here needs them, and nested
  aliases grow without bound);
- numbers as everybody writes them: `1e-5` is a number (YAML 1.1 wants
  `1.0e-5`), `010` is ten (not eight), `1:30` is a string (not ninety), and
  `on`, `off`, `yes`, `no` are strings;
- size and depth are limited.
"""

from __future__ import annotations

import re
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import yaml

from scara_kinetostatic.errors import InputError

MAX_BYTES = 256 * 1024
MAX_DEPTH = 16

Problem = type[InputError]


class _Loader(yaml.SafeLoader):
    """Safe loader with the core schema of YAML 1.2 and no tags, anchors, aliases or repeated keys."""

    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent) or getattr(event, 'anchor', None) is not None:
            raise yaml.MarkedYAMLError(problem='anchors and aliases are not allowed', problem_mark=event.start_mark)
        if getattr(event, 'tag', None) is not None:
            raise yaml.MarkedYAMLError(problem=f'the tag {event.tag!r} is not allowed', problem_mark=event.start_mark)
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise yaml.MarkedYAMLError(problem=f'nested deeper than {MAX_DEPTH}', problem_mark=event.start_mark)
        node: yaml.Node | None = super().compose_node(parent, index)
        self.depth -= 1
        return node

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


def read_text(path: str | Path, problem: Problem) -> str:
    """The text of a small file a user wrote.

    Args:
        path: the file.
        problem: error class to raise.

    Raises:
        problem: no such file, no regular file, unreadable, over `MAX_BYTES` or not UTF-8.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise problem(path, 'there is no such file', 'check the path')
        if not path.is_file():
            raise problem(path, 'expected a file, got ' + ('a folder' if path.is_dir() else 'something else'))
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise problem(path, f'expected at most {MAX_BYTES // 1024} KiB of YAML, got {size} bytes')
        return path.read_bytes().decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise problem(path, f'not UTF-8 text (byte {error.start})', 'save it as UTF-8') from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise problem(path, f'cannot be read: {reason}') from error


def parse_yaml(text: str, where: str | Path, problem: Problem) -> Any:
    """The one document in a YAML text, as dicts (with string keys), lists, strings, numbers, bools and None.

    Args:
        text: the YAML.
        where: its file, for messages.
        problem: error class to raise.

    Raises:
        problem: the text is not valid, with the line.
    """
    if len(text) > MAX_BYTES:
        raise problem(where, f'expected at most {MAX_BYTES // 1024} KiB of YAML, got {len(text)} characters')
    loader = None
    try:
        loader = _Loader(text)
        return loader.get_single_data()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f'line {mark.line + 1}: ' if mark else ''
        raise problem(where, f'not valid YAML: {line}{error.problem or error.context}') from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise problem(where, f'not valid YAML: {error}') from error
    finally:
        if loader is not None:
            loader.dispose()
