"""How the calibrations of a robot changed, one after the other, and slowly over many of them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import NamedTuple

from scara_kinetostatic.monitoring.comparison import Change, compare
from scara_kinetostatic.monitoring.history import Entry


class Trend(NamedTuple):
    """The calibrations of one robot.

    Attributes:
        robot: its name.
        entries: in the order in which they were measured.
        changes: of each since the one before; None for the first.
        since: number of the calibration after the last change, from which `slow` counts.
        slow: from that one to the last: steps too small to be seen by themselves add up; None where `changes` says it.
    """

    robot: str
    entries: tuple[Entry, ...]
    changes: tuple[Change | None, ...]
    since: int
    slow: Change | None

    @property
    def changed(self) -> list[Change]:
        """Those beyond the uncertainty, from one calibration to the next."""
        return [change for change in self.changes if change is not None and change.has_changed]

    @property
    def has_crept(self) -> bool:
        """Whether many small steps make a change beyond the uncertainty."""
        return self.slow is not None and self.slow.has_changed


def trends_of(entries: Sequence[Entry]) -> list[Trend]:
    """The trend of each robot, of entries in the order of robot and time."""
    return [_trend(robot, tuple(its)) for robot, its in groupby(entries, key=lambda entry: entry.robot)]


def _trend(robot: str, entries: tuple[Entry, ...]) -> Trend:
    changes = [compare(one.record, other.record) for one, other in pairwise(entries)]
    start = max((k for k, change in enumerate(changes, 1) if change.has_changed), default=0)
    first, last = entries[start], entries[-1]
    slow = compare(first.record, last.record) if len(entries) - start > 2 else None
    return Trend(robot, entries, (None, *changes), first.number, slow)
