"""Results as JSON text."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime, timezone
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

Document = dict[str, Any]
"""Values by key: whatever `plain` takes."""
_ENCODER = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def json_text(document: Document) -> str:
    """The document as JSON that every reader accepts (`plain`), short lists and objects on one line.

    Raises:
        TypeError: a value in it has no form in JSON.
    """
    return _text(plain(document), '') + '\n'


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


def _text(value: Any, indent: str) -> str:
    """On one line: what fits there, and every list of numbers."""
    flat = _ENCODER.encode(value)
    if not isinstance(value, (dict, list)) or not value or (indent and len(indent) + len(flat) <= 160):
        return flat
    if isinstance(value, list) and all(isinstance(item, (int, float)) for item in value):
        return flat
    deeper = indent + '  '
    if isinstance(value, dict):
        parts = [f'{_ENCODER.encode(key)}: {_text(item, deeper)}' for key, item in value.items()]
        return '{\n' + ',\n'.join(deeper + part for part in parts) + f'\n{indent}}}'
    return '[\n' + ',\n'.join(deeper + _text(item, deeper) for item in value) + f'\n{indent}]'
