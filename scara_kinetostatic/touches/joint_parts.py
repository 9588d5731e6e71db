"""Joint states that come in parts, joined: messages with some of the joints each, from several publishers.

As soon as q1 and q2 both have news there is a sample, at the earlier of their latest stamps: one of them was measured
there, the other is interpolated between its neighbours. So each sample has something new of both, there are as many as
of the slower joint, and none bridges the silence of one. Other joints, as of a lift, count as they were last heard,
for one second. A message with both angles stays as it came.

The messages of a recording and those that a node hears go through this one code, in the order of arrival.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import isnan, nan

from scara_kinetostatic.touches.clock import SECOND, TOLERANCE

_MOST = 5000
"""Readings of a joint that wait for the other: 5 s at 1 kHz."""


class UnjoinedError(Exception):
    """A message that does not fit those of the other joints; the text says why."""


class JointParts:
    """Joins the joint states of one topic.

    Args:
        names: of q1, q2 and the other joints.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._waiting = tuple(deque[tuple[int, float]](maxlen=_MOST) for _ in range(2))
        self._others = [(0, nan)] * (len(names) - 2)  # when it was received, ns, and the position
        self._heard, self._lag, self._is_new = list[int](), [0, 0], [False, False]
        self._stamped = list[bool]()

    @property
    def awaited(self) -> str:
        """Name of q1 or q2, whichever was heard of longer ago."""
        return self._names[int(self._heard[1] < self._heard[0])]

    def add(self, stamp: int, received: int, values: Sequence[float]) -> tuple[int, int, list[float]] | None:
        """One message.

        Args:
            stamp: of its header, ns; where it is 0 the time of reception counts.
            received: when it came, ns.
            values: q1, q2, rad, and the other joints; NaN where the message has none.

        Returns:
            Stamp of a sample, when it was received, ns, and its values; None where one of the two angles is still to
            come. Without stamps, it was received when the earlier of the two was.

        Raises:
            UnjoinedError: the stamps of a joint do not increase, one is silent, their clocks differ, or only one has
                stamps.
        """
        news = zip(self._others, values[2:], strict=True)
        self._others = [old if isnan(new) else (received, new) for old, new in news]
        others = [nan if received - heard > SECOND else position for heard, position in self._others]
        self._heard = self._heard or [received, received]
        time, here = stamp or received, [k for k in (0, 1) if not isnan(values[k])]
        for k in here:
            self._heard[k], self._lag[k] = received, time - received
        if len(here) != 1:
            return (stamp, received, [*values[:2], *others]) if here else None
        this, (k,) = self._waiting[here[0]], here
        self._stamped = self._stamped or [stamp > 0] * 2
        self._stamped[k] = stamp > 0
        if sum(self._stamped) == 1:
            without = self._stamped.index(False)
            raise UnjoinedError(f'{self._names[without]} is not stamped, {self._names[1 - without]} is')
        self._is_new[k] = not this or time > this[-1][0]
        if not self._is_new[k]:
            this.clear()  # a clock that was set back begins anew
        this.append((time, values[k]))
        if not self._is_new[k]:
            raise UnjoinedError(f'the stamps of {self._names[k]} do not increase')
        if received - self._heard[1 - k] > SECOND:
            raise UnjoinedError(f'{self.awaited} is silent')
        if all(self._waiting) and (apart := abs(self._lag[0] - self._lag[1])) > TOLERANCE:
            differ = f'{" and ".join(self._names[:2])} differ by {apart / SECOND:.1g} s'
            raise UnjoinedError(f'the clocks of {differ}, or one comes late')
        common = min(each[-1][0] if each else time for each in self._waiting)
        if not all(self._is_new) or any(each[0][0] > common for each in self._waiting):
            return None
        self._is_new = [False, False]
        times = (common, received) if stamp else (0, common)
        return *times, [*(_reading(each, common) for each in self._waiting), *others]


def _reading(waiting: deque[tuple[int, float]], time: int) -> float:
    """The angle at a time between the first and the last of them, rad; what is older is dropped."""
    while len(waiting) > 1 and waiting[1][0] <= time:
        waiting.popleft()
    (before, angle), (after, other) = waiting[0], waiting[min(1, len(waiting) - 1)]
    return angle + (other - angle) * (time - before) / max(after - before, 1)
