"""Reception of a topic: number and rate of messages, unusable, delayed and lost ones."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic

import numpy as np

from scara_kinetostatic.touches.streams import INTERLEAVED, is_interleaved

_MOST = 5000
"""Most samples between two reports in which two robots are looked for."""
CONSTANT_STAMP = 1.0
"""Longest time with the same stamp before it is reported, s."""


class StreamMonitor:
    """Counts the messages of one topic.

    Args:
        topic: its name.
        with_joints: whether it carries joint angles, in which two robots can be seen.

    Attributes:
        topic: its name.
        publishers: names of the nodes that publish it, one for each publisher.
        count: messages so far.
        unusable: messages so far that did not hold what is needed.
        lost: messages so far that were published but not received.
        problem: of the last unusable message; empty after a usable one. Where good and unusable ones
            alternate (several drivers publish joint states on one topic), there is none.
    """

    def __init__(self, topic: str, with_joints: bool = False) -> None:
        self.topic = topic
        self.publishers: list[str] = []
        self._with_joints = with_joints
        self._values: list[tuple[float, float]] = []
        self._interleaved = self._refused = self._others = False
        self.count = 0
        self.unusable = 0
        self.lost = 0
        self.problem = ''
        self._counted = 0
        self._reported = 0
        self._accepted = False
        self._since = self._stamped = monotonic()
        self._stamp = -1

    def accept(self, stamp: int, values: tuple[float, float] = (0.0, 0.0)) -> None:
        """Notes a usable message with its stamp, ns, and its numbers."""
        self.count += 1
        if self._with_joints and len(self._values) < _MOST:
            self._values.append(values)
        self._accepted = True
        now = monotonic()
        if stamp != self._stamp:
            self._stamp, self._stamped = stamp, now
        constant = now - self._stamped > CONSTANT_STAMP
        self.problem = 'the header stamps do not change: the times of reception are used' if constant else ''

    def refuse(self, problem: str) -> None:
        """Notes a message that cannot be used."""
        self.count += 1
        self.unusable += 1
        self._refused = True
        if not self._accepted:
            self.problem = problem

    def lose(self, number: int) -> None:
        """Notes messages that will never come."""
        self.lost += number

    def loss(self) -> str:
        """The losses since the last call as text; empty if none."""
        number, self._reported = self.lost - self._reported, self.lost
        if not number:
            return ''
        return f'{self.topic}: {number} messages lost on the way; this machine or the network is too busy'

    def rate(self) -> float:
        """Messages per second since the last call."""
        now = monotonic()
        rate = (self.count - self._counted) / max(now - self._since, 1e-9)
        self._counted, self._since, self._accepted = self.count, now, False
        self._interleaved = is_interleaved(np.array(self._values).reshape(-1, 2))
        self._others, self._refused = self._refused, False
        self._values.clear()
        return rate

    def details(self, rate: float) -> dict[str, str]:
        """The figures of the topic by name."""
        return {
            f'{self.topic}: publishers': ', '.join(self.publishers) or 'none',
            f'{self.topic}: rate [Hz]': f'{rate:.1f}',
            f'{self.topic}: messages': str(self.count),
            f'{self.topic}: unusable': str(self.unusable),
            f'{self.topic}: lost': str(self.lost),
        }

    def complaint(self, rate: float, expected: bool) -> str:
        """The problem of the topic; empty if there is none.

        Args:
            rate: messages per second.
            expected: whether there ought to be messages.
        """
        if self.problem:
            return f'{self.topic}: {self.problem}'
        return f'{self.topic}: no messages' if expected and not rate else ''

    def mixture(self) -> str:
        """That messages of several robots mix, by the publishers or by the numbers; empty if they do not.

        A publisher whose messages cannot be used, of other joints, is no trouble.
        """
        if self._interleaved:
            return f'{self.topic}: {INTERLEAVED}'
        if len(self.publishers) <= 1 + self._others:
            return ''
        names = ', '.join(sorted(self.publishers))
        return (
            f'{self.topic}: {len(self.publishers)} publishers ({names}), whose messages mix: give each cell a namespace'
        )


class SequenceMonitor:
    """Follows the sequence numbers of one topic.

    Every publisher numbers its messages without gaps. The publisher of a message is not known,
    so a number is taken to continue the sequence that it fits best. This also counts losses that no event of the
    middleware reports: messages that newer ones displaced from the queue.

    Args:
        publishers: returns the present number of publishers of the topic.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self._publishers = publishers
        self._last: list[int] = []
        """Last number of each sequence, the one heard from most recently at the end."""

    def missed(self, number: int | None) -> int:
        """How many messages are missing before this one; 0 for the first of a publisher.

        Args:
            number: of the message; None or 0 where the middleware does not state it.
        """
        if not number:
            return 0
        last = number - 1
        if last not in self._last:
            earlier = [known for known in self._last if known < number]
            publishers = max(1, self._publishers())
            if number == 1 or not earlier or len(self._last) < publishers:
                self._last = [*self._last[len(self._last) + 1 - publishers :], number][-publishers:]
                return 0
            last = max(earlier)
        self._last.remove(last)
        self._last.append(number)
        return number - last - 1
