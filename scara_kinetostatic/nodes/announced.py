"""The recordings that the collector has announced, and which of them belong together."""

from __future__ import annotations

SESSION, LAST, ALL = 'session', 'last', 'all'
CHOICES = {
    SESSION: 'the last one, with those before a restart of the collector',
    LAST: 'the last one',
    ALL: 'all since this node has started',
}


class Announced:
    """Recordings in the order in which they were announced.

    A collector that was started anew, after a crash say, goes on with the same session in another recording. One that
    was told to stop begins another session when it is told to start, also by another process, the next day say. The
    middleware tells which process: every publisher numbers its messages from 1.
    """

    def __init__(self) -> None:
        self._all: list[str] = []
        self._session: list[str] = []
        self._stopped = ''

    def note(self, path: str, number: int | None) -> bool:
        """Notes an announcement.

        Args:
            path: of the recording.
            number: of the message among those of its publisher; None or 0 where the middleware does not state it.

        Returns:
            Whether the collector was started anew, so that the recording belongs to those before it.
        """
        if not path or self._session[-1:] == [path]:
            return False
        continued = number == 1 and bool(self._session) and self._session[-1] != self._stopped
        self._session = [*(item for item in self._session if continued and item != path), path]
        self._all = [*(item for item in self._all if item != path), path]
        return continued

    def stop(self, path: str) -> None:
        """Notes that the collector was told to stop a recording."""
        self._stopped = path

    def chosen(self, which: str) -> list[str]:
        """The recordings to calibrate together.

        Args:
            which: one of `CHOICES`.
        """
        return list({SESSION: self._session, LAST: self._session[-1:], ALL: self._all}[which])
