"""What a run of the command gives."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple


class Result(NamedTuple):
    """Exit status, and what was printed."""

    status: int
    out: str
    err: str


Run = Callable[..., Result]
