"""Results as JSON text."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime, timezone
from enum import Enum
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

Document = dict[str, Any]
"""Values by key: whatever `plain` takes."""
_WIDTH = 160
"""Of a line, characters."""
_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def json_text(document: Document) -> str:
    """The document as JSON that every reader accepts (`plain`), short lists and objects on one line.

    Raises:
        TypeError: a value in it has no form in JSON.
    """
    return _forms(plain(document), '')[1] + '\n'


def plain(value: Any) -> Any:
    """Plain JSON values: dataclasses and named tuples become objects, arrays lists, enums their values, times UTC.

    A number that is not finite becomes None.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Enum):
        return plain(value.value)
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, tuple) and hasattr(value, '_fields'):
        return {name: plain(item) for name, item in zip(value._fields, value, strict=True)}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, datetime):
        return utc(value)
    raise TypeError(f'{type(value).__name__} has no form in JSON')


def utc(time: datetime) -> str:
    """A date and time in UTC: ``2026-11-21T14:03:22Z``."""
    return time.astimezone(timezone.utc).strftime('%Y-%m-%dT%H:%M:%SZ')


def _forms(value: Any, indent: str) -> tuple[str, str]:
    """A value on one line, and as it is written: on one line what fits there, and every list of numbers."""
    if not isinstance(value, (dict, list)) or not value:
        return (flat := _ENCODER.encode(value)), flat
    if isinstance(value, list) and all(isinstance(item, (int, float)) for item in value):
        return (flat := _ENCODER.encode(value)), flat
    opening, closing = '{}' if isinstance(value, dict) else '[]'
    keys = [f'{_ENCODER.encode(key)}: ' for key in value] if isinstance(value, dict) else [''] * len(value)
    deeper, items = indent + '  ', value.values() if isinstance(value, dict) else value
    flats, written = zip(*(_forms(item, deeper) for item in items), strict=True)
    flat = opening + ', '.join(map(add, keys, flats)) + closing
    if indent and len(indent) + len(flat) <= _WIDTH:
        return flat, flat
    return flat, f'{opening}\n{deeper}' + f',\n{deeper}'.join(map(add, keys, written)) + f'\n{indent}{closing}'
