"""How long the disk will hold a recording: said before it is full."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path
from time import monotonic

MIB = 1 << 20
LEAST_ROOM = 1 << 30
"""Less free space than this is reported, bytes,"""
LEAST_TIME = 3600.0
"""and so is space for less than this at the present rate, s."""


class DiskRoom:
    """Watches the disk of one recording.

    Args:
        folder: the recording.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._since = monotonic()
        self._written = 0

    def add(self, size: int) -> None:
        """Notes that so many bytes are recorded."""
        self._written += size

    def free(self) -> int:
        """Free space, bytes; -1 where it is unknown."""
        with suppress(OSError):
            return shutil.disk_usage(self._folder).free
        return -1

    def complaint(self) -> str:
        """That the disk will be full soon; empty if it will not."""
        free = self.free()
        rate = self._written / max(monotonic() - self._since, 1.0)
        lasting = free / rate if rate else float('inf')
        if free < 0 or (free >= LEAST_ROOM and lasting >= LEAST_TIME):
            return ''
        time = f', at {rate / MIB:.1g} MiB/s for {_duration(lasting)}' if rate else ''
        return f'the disk of {self._folder.parent} has {free // MIB} MiB left{time}: make room'


def _duration(seconds: float) -> str:
    """Roughly, so that the text does not change each second."""
    if seconds < 120:
        return 'less than 2 min'
    minutes = int(seconds // 60)
    return f'about {minutes // 10 * 10 or minutes} min' if minutes < 300 else f'about {minutes // 60} h'
