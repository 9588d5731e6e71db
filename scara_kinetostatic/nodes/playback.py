"""The two streams of a simulated recording as one sequence in time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from scara_kinetostatic.nodes.conversion import Sample
from scara_kinetostatic.touches.streams import Streams


class Due(NamedTuple):
    """A message that is due.

    Attributes:
        is_wrench: a wrench, else joint angles.
        sample: its numbers and its stamp.
    """

    is_wrench: bool
    sample: Sample


class Playback:
    """Both streams in the order of their stamps.

    Args:
        streams: stamped from 0, ns.
        start: added to every stamp, ns.

    Attributes:
        start: as given; may be changed before the first message is returned.
    """

    def __init__(self, streams: Streams, start: int) -> None:
        stamps = np.concatenate([streams.joints.stamp, streams.wrench.stamp])
        order = np.argsort(stamps, kind='stable')
        self._stamp = stamps[order]
        self._values = np.concatenate([streams.joints.position, streams.wrench.force])[order]
        self._is_wrench = order >= len(streams.joints.stamp)
        self._next = 0
        self.start = start

    @property
    def finished(self) -> bool:
        """Whether every message has been returned."""
        return self._next == len(self._stamp)

    @property
    def end(self) -> int:
        """Stamp of the last message, ns."""
        return self.start + int(self._stamp[-1])

    def advance(self, elapsed: float) -> Iterator[Due]:
        """The messages that became due since the last call.

        Args:
            elapsed: simulated time since the start, s.
        """
        first = self._next
        self._next = max(first, int(np.searchsorted(self._stamp, round(1e9 * elapsed), side='right')))
        for row in range(first, self._next):
            stamp = self.start + int(self._stamp[row])
            yield Due(bool(self._is_wrench[row]), Sample(stamp, *self._values[row].tolist()))
