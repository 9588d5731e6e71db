"""Finds out how many messages were lost, by the numbers that their publishers give them."""

from __future__ import annotations

from collections.abc import Callable


class SequenceMonitor:
    """Follows the sequence numbers of one topic.

    Every publisher numbers its messages without gaps. Which publisher a message is from is not told along with it,
    so a number is taken to continue the sequence that it fits best. This also sees what no event of the middleware
    reports: messages that came, but gave way to newer ones before the node took them.

    Args:
        publishers: tells how many publishers the topic has now.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self._publishers = publishers
        self._last: list[int] = []
        """Last number of each sequence, the one heard from most recently at the end."""

    def missed(self, number: int | None) -> int:
        """How many messages are missing before this one; 0 for the first of a publisher.

        Args:
            number: of the message; None or 0 where the middleware does not tell.
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
