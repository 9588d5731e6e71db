"""A history of calibrations in one SQLite file.

    calibration(id, robot, measured, created, source, document, checksum)

`measured` is when the last recording of the calibration began, `created` when it was calculated, both UTC as text that
sorts by time; a calibration of unknown recordings counts as measured when it was calculated. `document` is the whole
`calibration.json`, which `extract` gives back. A calibration is
added once: its checksum is that of its document. One that was calculated again from the same recordings replaces the
earlier one in lists, which stays in the file.

Several processes may use the file at a time; what is written is written whole or not at all.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.files.calibration_file import parse_document
from scara_kinetostatic.monitoring.comparison import Change, compare
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm
from scara_kinetostatic.report.page import json_text

APPLICATION = 0x5C4A2A01
"""`application_id` of the file."""
VERSION = 3
_TABLE = """CREATE TABLE calibration (
    id INTEGER PRIMARY KEY, robot TEXT NOT NULL, measured TEXT NOT NULL, created TEXT NOT NULL, source TEXT NOT NULL,
    document TEXT NOT NULL, checksum TEXT NOT NULL UNIQUE)"""
_SELECT = 'SELECT id, robot, source, document FROM calibration'


class Entry(NamedTuple):
    """A calibration of the history.

    Attributes:
        number: its id.
        robot: name of the robot.
        record: the calibration.
    """

    number: int
    robot: str
    record: CalibrationRecord


class History:
    """The file.

    Args:
        path: of the SQLite file.
        create: whether to make it where it does not exist.

    Raises:
        InputError: it does not exist, is no history, or cannot be opened.
    """

    def __init__(self, path: str | Path, *, create: bool = False) -> None:
        self.path = Path(path)
        if not create and not self.path.is_file():
            raise InputError(path, 'there is no such history', '`history add` makes one')
        with self._open(write=create) as connection:
            if create and not connection.execute('SELECT count(*) FROM sqlite_master').fetchone()[0]:
                for part in (_TABLE, f'PRAGMA application_id = {APPLICATION}', f'PRAGMA user_version = {VERSION}'):
                    connection.execute(part)
            own = "SELECT type, sql FROM sqlite_master WHERE name NOT LIKE 'sqlite^_stat%' ESCAPE '^'"  # of ANALYZE
            layout, pragmas = set(connection.execute(own)), ('application_id', 'user_version')
            application, version = (connection.execute(f'PRAGMA {name}').fetchone()[0] for name in pragmas)
        if application != APPLICATION:
            raise InputError(self.path, 'is no history of calibrations', 'give another file; `history add` makes one')
        if version != VERSION:
            problem = f'expected a history of version {VERSION}, got {version}'
            raise InputError(self.path, problem, 'use the version of this package that wrote it, or add the files anew')
        if layout != {('table', _TABLE), ('index', None)}:
            problem = 'has other tables, views or triggers than a history'
            raise InputError(self.path, problem, 'add the files to a new one')

    @contextmanager
    def _open(self, *, write: bool = False) -> Iterator[sqlite3.Connection]:
        """A connection whose changes are made together or not at all; one that writes has the file to itself.

        Raises:
            InputError: the file is no database, or cannot be read or written.
        """
        try:
            with closing(sqlite3.connect(self.path, timeout=30.0, isolation_level=None)) as connection:
                connection.execute('PRAGMA trusted_schema = OFF')  # expressions in a schema call no functions
                connection.execute('BEGIN IMMEDIATE' if write else 'BEGIN')
                with connection:
                    yield connection
        except (sqlite3.Error, UnicodeError) as error:
            raise InputError(self.path, f'cannot be used as a history: {error}', 'check the file') from error

    def add(self, records: Sequence[CalibrationRecord], robot: str = '') -> list[bool]:
        """Adds calibrations, all or none.

        Args:
            records: the calibrations.
            robot: its name; empty: as the cell description identifies it.

        Returns:
            Whether each was new.

        Raises:
            InputError: one is of another robot than those of the same name, or the file cannot be written.
        """
        added = []
        with self._open(write=True) as connection:
            for record in records:
                name, text = robot or record.robot or 'robot', json_text(dict(record.document))
                newest = f'{_SELECT} WHERE robot = ? ORDER BY measured DESC, id DESC LIMIT 1'
                last = connection.execute(newest, (name,)).fetchone()
                if last is not None:
                    known = self._entry(*last).record
                    check_same_arm(known.arm.cell, record.arm.cell, f'{known.source} of {name!r}', record.source)
                checksum = hashlib.sha256(text.encode()).hexdigest()
                row = (name, record.measured, record.created, record.source, text, checksum)
                cursor = connection.execute('INSERT OR IGNORE INTO calibration VALUES (NULL, ?, ?, ?, ?, ?, ?)', row)
                added.append(bool(cursor.rowcount))
        return added

    def _entry(self, number: int, robot: str, source: str, document: str) -> Entry:
        """A calibration of the file.

        Raises:
            InputError: it is damaged, or needs what is not installed here.
        """
        try:
            return Entry(number, robot, CalibrationRecord.of_document(parse_document(document, source), source))
        except (ValueError, TypeError, RecursionError, InputError) as error:
            remedy = f'take it out: scara-kinetostatic history remove {self.path} {number}'
            raise InputError(self.path, f'calibration {number} cannot be read: {error}', remedy) from error

    def extract(self, numbers: Sequence[int], *, remove: bool = False) -> list[str]:
        """The `calibration.json` of calibrations, which are taken out with `remove`, all or none.

        Raises:
            InputError: there is none of a number, or the file cannot be used.
        """
        documents = []
        with self._open(write=remove) as connection:
            for number in numbers:
                row = connection.execute('SELECT document FROM calibration WHERE id = ?', (number,)).fetchone()
                if row is None:
                    raise InputError(self.path, f'holds no calibration {number}', '`history list` shows the numbers')
                documents.append(str(row[0]))
                if remove:
                    connection.execute('DELETE FROM calibration WHERE id = ?', (number,))
        return documents

    def entries(self, robot: str = '') -> list[Entry]:
        """Calibrations in the order in which they were measured, of one robot or, without a name, of all; of several by
        the same recordings the one that was calculated last.
        """
        with self._open() as connection:
            query = f"{_SELECT} WHERE ? IN (robot, '') ORDER BY robot, measured, created, id"
            found = [self._entry(*row) for row in connection.execute(query, (robot,))]
        last = {}
        for entry in sorted(found, key=lambda entry: (entry.record.created, entry.number)):
            last[entry.robot, entry.record.checksums or entry.number] = entry.number
        return [entry for entry in found if entry.number in last.values()]


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
    trends = []
    for robot, its in groupby(entries, key=lambda entry: entry.robot):
        own = tuple(its)
        changes = [compare(one.record, other.record) for one, other in pairwise(own)]
        start = max((k for k, change in enumerate(changes, 1) if change.has_changed), default=0)
        slow = compare(own[start].record, own[-1].record) if len(own) - start > 2 else None
        trends.append(Trend(robot, own, (None, *changes), own[start].number, slow))
    return trends
