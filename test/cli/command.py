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


def refused(result: Result, status: int, *words: str) -> None:
    """Check the exit status, and that one line on stderr says all words."""
    assert (result.status, result.out, result.err.count('\n')) == (status, '', 1), result
    assert result.err.startswith('scara-kinetostatic')
    for word in words:
        assert word in result.err, result.err
