"""A history of calibrations in one SQLite file.

    calibration(id, robot, created, source, grade, verdict, reasons, covariance, document, checksum)
    parameter(calibration, name, value, std, std_noise, unit, status)

`covariance` is JSON, {names, matrix} of the estimated parameters; `document` is the whole `calibration.json`; `created`
is UTC, so that text sorts by time. A calibration is added once: its checksum is that of its document.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.errors import InputError
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.monitoring.comparison import Change, compare
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.same_robot import check_same_robot
from scara_kinetostatic.render.json_file import json_text

APPLICATION = 0x5C4A2A01
"""`application_id` of the file."""
VERSION = 1
UNNAMED = 'robot'
"""Of a robot whose cell description does not identify it, and for which no name is given."""
_TABLES = """
CREATE TABLE calibration (
    id INTEGER PRIMARY KEY, robot TEXT NOT NULL, created TEXT NOT NULL, source TEXT NOT NULL, grade TEXT NOT NULL,
    verdict TEXT NOT NULL, reasons TEXT NOT NULL, covariance TEXT NOT NULL, document TEXT NOT NULL,
    checksum TEXT NOT NULL UNIQUE);
CREATE TABLE parameter (
    calibration INTEGER NOT NULL REFERENCES calibration(id) ON DELETE CASCADE, name TEXT NOT NULL, value REAL NOT NULL,
    std REAL, std_noise REAL, unit TEXT NOT NULL, status TEXT NOT NULL, PRIMARY KEY (calibration, name));
CREATE INDEX by_robot ON calibration (robot, created);
"""


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
    def worst_tip(self) -> float | None:
        """Largest expanded uncertainty of the tip in the workspace, m."""
        worst = self.record.document.get('tip_uncertainty', {}).get('worst')
        return None if worst is None else float(worst)


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
        with self._open() as connection:
            tables = connection.execute('SELECT count(*) FROM sqlite_master').fetchone()[0]
            application, version = (
                connection.execute(f'PRAGMA {name}').fetchone()[0] for name in ('application_id', 'user_version')
            )
            if tables and application != APPLICATION:
                raise InputError(path, 'is a database of another program', 'give another file')
            if tables and version != VERSION:
                raise InputError(path, f'expected a history of version {VERSION}, got {version}')
            if not tables:
                connection.executescript(
                    f'BEGIN; PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION}; {_TABLES} COMMIT;'
                )

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        """A connection whose changes are made together or not at all.

        Raises:
            InputError: the file is no database, or cannot be read or written.
        """
        try:
            with closing(sqlite3.connect(self.path)) as connection, connection:
                connection.execute('PRAGMA foreign_keys = ON')
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
            InputError: one is of another robot than those of the same name, or the file cannot be written.
        """
        added = []
        last: dict[str, CalibrationRecord] = {}
        for record in records:
            name = robot or record.robot or UNNAMED
            if name not in last and (known := self.entries(name)):
                last[name] = known[-1].record
            if name in last:
                check_same_robot(last[name], record)
            last[name] = record
        with self._open() as connection:
            for record in records:
                added.append(_insert(connection, record, robot or record.robot or UNNAMED))
        return added

    def robots(self) -> list[str]:
        """Names of all robots."""
        with self._open() as connection:
            return [row[0] for row in connection.execute('SELECT DISTINCT robot FROM calibration ORDER BY robot')]

    def entries(self, robot: str = '') -> list[Entry]:
        """Calibrations in the order of time, of one robot or of all."""
        with self._open() as connection:
            rows = connection.execute(
                "SELECT id, robot, source, grade, verdict, document FROM calibration WHERE ? IN (robot, '') "
                'ORDER BY robot, created, id',
                (robot,),
            ).fetchall()
        return [
            Entry(number, name, CalibrationRecord.of_document(json.loads(text), source), grade, verdict)
            for number, name, source, grade, verdict, text in rows
        ]


def _insert(connection: sqlite3.Connection, record: CalibrationRecord, robot: str) -> bool:
    document = dict(record.document)
    text = json_text(document)
    assessment = document.get('assessment', {})
    row = (
        robot,
        record.created,
        record.source,
        str(assessment.get('grade', '')),
        record.arm.verdict,
        json.dumps(assessment.get('reasons', [])),
        json.dumps(document.get('covariance', {})),
        text,
        hashlib.sha256(text.encode()).hexdigest(),
    )
    cursor = connection.execute(
        'INSERT OR IGNORE INTO calibration (robot, created, source, grade, verdict, reasons, covariance, document, '
        'checksum) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)',
        row,
    )
    if not cursor.rowcount:
        return False
    keys = ('value', 'std', 'std_noise', 'unit', 'status')
    rows = [(cursor.lastrowid, name, *(document['parameters'][name][key] for key in keys)) for name in NAMES]
    connection.executemany('INSERT INTO parameter VALUES (?, ?, ?, ?, ?, ?, ?)', rows)
    return True


def changes_of(entries: Sequence[Entry]) -> list[Change | None]:
    """For each calibration what changed since the one before of the same robot; None for its first."""
    found: list[Change | None] = []
    for k, entry in enumerate(entries):
        before = entries[k - 1] if k and entries[k - 1].robot == entry.robot else None
        found.append(None if before is None else compare(before.record, entry.record))
    return found
