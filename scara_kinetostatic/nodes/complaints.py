"""What is wrong for longer than a moment is logged, once."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

PERSISTENT = 3
"""Consecutive reports of the same problem after which it is logged."""


class PersistentComplaints:
    """Follows problems from report to report; those that differ in numbers alone are the same.

    Args:
        log: called with the text of a problem when it has lasted.
    """

    def __init__(self, log: Callable[[str], object]) -> None:
        self._log = log
        self._lasted: dict[str, int] = {}

    def note(self, complaints: Sequence[str]) -> list[str]:
        """Notes the problems of one report, once a second; empty texts are none.

        Returns:
            The problems.
        """
        present = {re.sub(r'[0-9.]+', '#', text): text for text in complaints if text}
        self._lasted = {kind: self._lasted.get(kind, 0) + 1 for kind in present}
        for kind, text in present.items():
            if self._lasted[kind] == PERSISTENT:
                self._log(text)
        return list(present.values())
