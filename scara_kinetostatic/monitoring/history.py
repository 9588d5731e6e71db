"""A history of calibrations in one SQLite file.

    calibration(id, robot, measured, created, source, grade, verdict, reasons, covariance, document, checksum)
    parameter(calibration, name, value, std, std_noise, unit, status)

`measured` is when the last recording of the calibration began, `created` when it was calculated, both UTC as text that
sorts by time; a calibration of unknown recordings counts as measured when it was calculated. `covariance` is JSON,
{names, matrix} of the estimated parameters; `document` is the whole `calibration.json`. A calibration is added once:
its checksum is that of its document. One that was calculated again from the same recordings replaces the earlier one
in lists, which stays in the file.

Several processes may use the file at a time; what is written is written whole or not at all.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.errors import CalibrationFileError, InputError
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.monitoring.comparison import Change, compare
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_robot
from scara_kinetostatic.report.json_file import json_text

APPLICATION = 0x5C4A2A01
"""`application_id` of the file."""
VERSION = 2
_TABLES = (
    """CREATE TABLE calibration (
    id INTEGER PRIMARY KEY, robot TEXT NOT NULL, measured TEXT NOT NULL, created TEXT NOT NULL, source TEXT NOT NULL,
    grade TEXT NOT NULL, verdict TEXT NOT NULL, reasons TEXT NOT NULL, covariance TEXT NOT NULL, document TEXT NOT NULL,
    checksum TEXT NOT NULL UNIQUE)""",
    """CREATE TABLE parameter (
    calibration INTEGER NOT NULL REFERENCES calibration(id) ON DELETE CASCADE, name TEXT NOT NULL, value REAL NOT NULL,
    std REAL, std_noise REAL, unit TEXT NOT NULL, status TEXT NOT NULL, PRIMARY KEY (calibration, name))""",
    'CREATE INDEX by_robot ON calibration (robot, measured)',
)


class Entry(NamedTuple):
    """A calibration of the history.

    Attributes:
        number: its id.
        robot: name of the robot.
        record: the calibration.
        grade: ``fit``, ``caution`` or ``unfit``.
        verdict: of the diagnosis.
    """

    number: int
    robot: str
    record: CalibrationRecord
    grade: str
    verdict: str

    @property
    def created(self) -> str:
        """When it was calculated, UTC."""
        return self.record.created

    @property
    def measured(self) -> str:
        """When its last recording began, UTC."""
        return self.record.measured

    @property
    def worst_tip(self) -> float | None:
        """Largest expanded uncertainty of the tip in the workspace, m."""
        stated = self.record.document.get('tip_uncertainty')
        worst = stated.get('worst') if isinstance(stated, Mapping) else None
        return float(worst) if isinstance(worst, (int, float)) else None


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
                for statement in (
                    *_TABLES,
                    f'PRAGMA application_id = {APPLICATION}',
                    f'PRAGMA user_version = {VERSION}',
                ):
                    connection.execute(statement)
            application, version = (
                connection.execute(f'PRAGMA {name}').fetchone()[0] for name in ('application_id', 'user_version')
            )
        if application != APPLICATION:
            raise InputError(self.path, 'is no history of calibrations', 'give another file; `history add` makes one')
        if version != VERSION:
            problem = f'expected a history of version {VERSION}, got {version}'
            raise InputError(self.path, problem, 'use the version of this package that wrote it, or add the files anew')

    @contextmanager
    def _open(self, *, write: bool = False) -> Iterator[sqlite3.Connection]:
        """A connection whose changes are made together or not at all; one that writes has the file to itself.

        Raises:
            InputError: the file is no database, or cannot be read or written.
        """
        try:
            with closing(sqlite3.connect(self.path, timeout=30.0, isolation_level=None)) as connection:
                connection.execute('PRAGMA foreign_keys = ON')
                connection.execute('BEGIN IMMEDIATE' if write else 'BEGIN')
                with connection:
                    yield connection
        except sqlite3.Error as error:
            raise InputError(self.path, f'cannot be used as a history: {error}', 'check the file') from error

    def add(self, records: Sequence[CalibrationRecord], robot: str = '') -> list[bool]:
        """Adds calibrations, all or none.

        Args:
            records: the calibrations.
            robot: its name; empty: as the cell description identifies it.

        Returns:
            Whether each was new.

        Raises:
            InputError: one is of another robot than those of the same name or has no touches, or the file cannot be
                written.
        """
        added = []
        for record in records:
            record.check_touches()
        with self._open(write=True) as connection:
            for record in records:
                name = robot or record.robot or 'robot'
                if (last := self._last(connection, name)) is not None:
                    _check_same(last, record, name)
                added.append(_insert(connection, record, name))
        return added

    def _last(self, connection: sqlite3.Connection, robot: str) -> CalibrationRecord | None:
        """The last calibration of a robot."""
        columns = 'SELECT id, source, document FROM calibration WHERE robot = ?'
        row = connection.execute(f'{columns} ORDER BY measured DESC, id DESC LIMIT 1', (robot,)).fetchone()
        return None if row is None else self._record(*row)

    def _record(self, number: int, source: str, document: str) -> CalibrationRecord:
        """A calibration of the file.

        Raises:
            InputError: it is damaged, or needs what is not installed here.
        """
        try:
            record = CalibrationRecord.of_document(json.loads(document), source)
            record.check_touches()
            return record
        except (ValueError, TypeError, RecursionError, InputError) as error:
            remedy = f'`history remove {self.path} {number}` takes it out'
            raise InputError(self.path, f'calibration {number} cannot be read: {error}', remedy) from error

    def entries(self, robot: str = '', *, replaced: bool = False) -> list[Entry]:
        """Calibrations in the order in which they were measured, of one robot or of all.

        Args:
            robot: its name; empty for all.
            replaced: whether to give also those that were calculated again from the same recordings.
        """
        with self._open() as connection:
            rows = connection.execute(
                "SELECT id, robot, source, grade, verdict, document FROM calibration WHERE ? IN (robot, '') "
                'ORDER BY robot, measured, created, id',
                (robot,),
            ).fetchall()
        found = [
            Entry(number, name, self._record(number, source, text), grade, verdict)
            for number, name, source, grade, verdict, text in rows
        ]
        return found if replaced else _latest(found)

    def document(self, number: int) -> str:
        """The `calibration.json` of one calibration.

        Raises:
            InputError: there is none of that number.
        """
        with self._open() as connection:
            row = connection.execute('SELECT document FROM calibration WHERE id = ?', (number,)).fetchone()
        if row is None:
            raise InputError(self.path, f'holds no calibration {number}', '`history list` shows the numbers')
        return str(row[0])

    def remove(self, numbers: Sequence[int]) -> None:
        """Takes calibrations out, all or none.

        Raises:
            InputError: there is none of a number, or the file cannot be written.
        """
        with self._open(write=True) as connection:
            for number in numbers:
                if not connection.execute('DELETE FROM calibration WHERE id = ?', (number,)).rowcount:
                    raise InputError(self.path, f'holds no calibration {number}', '`history list` shows the numbers')


def _check_same(last: CalibrationRecord, record: CalibrationRecord, robot: str) -> None:
    try:
        check_same_robot(last, record)
    except InputError as error:
        remedy = f'it would be added to the calibrations of {robot!r}: give its own name by --robot'
        raise InputError(error.where, error.problem, remedy) from error


def _latest(entries: Sequence[Entry]) -> list[Entry]:
    """Of those of a robot that were calculated from the same recordings, only the one that was calculated last."""
    last: dict[tuple[str, object], int] = {}
    for entry in sorted(entries, key=lambda entry: (entry.created, entry.number)):
        last[entry.robot, entry.record.checksums or entry.number] = entry.number
    kept = set(last.values())
    return [entry for entry in entries if entry.number in kept]


def _insert(connection: sqlite3.Connection, record: CalibrationRecord, robot: str) -> bool:
    document = dict(record.document)
    text = json_text(document)
    row = {
        'robot': robot,
        'measured': record.measured,
        'created': record.created,
        'source': record.source,
        'grade': record.arm.grade,
        'verdict': record.arm.verdict,
        'reasons': json.dumps(document['assessment'].get('reasons', [])),
        'covariance': json.dumps(document.get('covariance', {})),
        'document': text,
        'checksum': hashlib.sha256(text.encode()).hexdigest(),
    }
    columns, marks = ', '.join(row), ', '.join('?' * len(row))
    cursor = connection.execute(f'INSERT OR IGNORE INTO calibration ({columns}) VALUES ({marks})', tuple(row.values()))
    if not cursor.rowcount:
        return False
    keys = ('value', 'std', 'std_noise', 'unit', 'status')
    try:
        rows = [(cursor.lastrowid, name, *(document['parameters'][name][key] for key in keys)) for name in NAMES]
    except (KeyError, TypeError) as error:
        raise CalibrationFileError(record.source, f'is damaged: {error!r} among the parameters') from error
    connection.executemany('INSERT INTO parameter VALUES (?, ?, ?, ?, ?, ?, ?)', rows)
    return True


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
