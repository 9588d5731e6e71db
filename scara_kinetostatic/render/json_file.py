"""Documents as JSON text."""

from __future__ import annotations

import json
from typing import Any

_WIDTH = 160
Document = dict[str, Any]
"""Plain JSON values by key."""
_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def json_text(document: Document) -> str:
    """The document as JSON that every reader accepts, short lists and objects on one line.

    Raises:
        ValueError: a number in it is not finite.
    """
    return _text(document, '') + '\n'


def _text(value: Any, indent: str) -> str:
    flat = _ENCODER.encode(value)
    if not isinstance(value, (dict, list)) or _is_short(value, flat, indent):
        return flat
    deeper = indent + '  '
    if isinstance(value, dict):
        parts = [f'{_ENCODER.encode(key)}: {_text(item, deeper)}' for key, item in value.items()]
        return '{\n' + ',\n'.join(deeper + part for part in parts) + f'\n{indent}}}'
    return '[\n' + ',\n'.join(deeper + _text(item, deeper) for item in value) + f'\n{indent}]'


def _is_short(value: dict[str, Any] | list[Any], flat: str, indent: str) -> bool:
    """Whether it goes on one line: what fits there, and every list of numbers."""
    numbers = isinstance(value, list) and all(isinstance(item, (int, float)) for item in value)
    return not value or numbers or (bool(indent) and len(indent) + len(flat) <= _WIDTH)
