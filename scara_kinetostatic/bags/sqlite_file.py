"""A `.db3` file: rosbag2's SQLite storage."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import closing

from scara_kinetostatic.bags.decoding import LARGEST_MESSAGE, PORTION, Batches, Storage, Topic, batched
from scara_kinetostatic.errors import RecordingError
from scara_kinetostatic.files.atomic import KIB, MIB

_STEPS, _STEPS_PER_RECORD = 1_000_000, 100
"""Steps of SQLite after which they are charged, and how many cost a record; a row that is skipped needs 8."""


class SqliteFile(Storage):
    """Reads the two tables that every version of the storage has.

    Of a database that is damaged in the middle, the messages before the damage are read, with a warning.
    """

    def batches(self, wanted: Collection[str]) -> Batches:
        """The messages of the wanted topics, in the order of their arrival."""
        with closing(self._connect()) as database:
            self._read_topics(database)
            for key, topic in self._topics.items():
                if topic.name in wanted:
                    yield from batched(topic, self._portions(database, key, topic), self._budget)
            if not self.warnings:
                self._check_rows(database)

    def _check_rows(self, database: sqlite3.Connection) -> None:
        """Warns where the structure is damaged or a message has no topic; the format has no checksums."""
        without_topic = 'SELECT count(*) FROM messages WHERE topic_id NOT IN (SELECT id FROM topics)'
        try:
            # larger ones contain camera images or the like
            checked = self.path.stat().st_size < KIB * MIB
            (problem,) = database.execute('PRAGMA quick_check(1)').fetchone() if checked else ('ok',)
            (lost,) = database.execute(without_topic).fetchone()
        except sqlite3.DatabaseError as error:
            self.warnings.append(f'{self.path.name} is damaged ({error})')
            return
        if problem != 'ok':
            self.warnings.append(f'{self.path.name} is damaged ({problem}): messages may be missing')
        elif lost:
            self.warnings.append(f'{self.path.name} is damaged: {lost} messages belong to no topic')

    def _connect(self) -> sqlite3.Connection:
        """Opens the file read-only; includes what a killed writer left in the write-ahead log, where possible."""
        uri = self.path.resolve().as_uri()
        logs = [self.path.with_name(self.path.name + suffix) for suffix in ('-wal', '-journal')]
        modes = ['mode=ro'] if any(log.exists() and log.stat().st_size for log in logs) else []
        for mode in [*modes, 'mode=ro&immutable=1']:
            database = sqlite3.connect(f'{uri}?{mode}', uri=True)
            database.text_factory = lambda text: text.decode('utf-8', 'replace')
            database.set_progress_handler(self._charge_steps, _STEPS)
            try:
                database.execute('PRAGMA trusted_schema = OFF')  # expressions in a schema call no functions
                database.execute('PRAGMA ignore_check_constraints = ON')  # they may cost anything
                database.execute('SELECT count(*) FROM sqlite_master').fetchone()
            except sqlite3.Error as error:
                database.close()
                last = error
            else:
                return database
        raise RecordingError(self.path, f'the database cannot be opened: {last}', 'record it again') from last

    def _read_topics(self, database: sqlite3.Connection) -> None:
        tables = "sqlite_master AS made WHERE rootpage AND type = 'table' AND name IN ('topics', 'messages')"
        calculated = '(SELECT total(hidden) FROM pragma_table_xinfo(made.name))'
        if database.execute(f'SELECT count(*), sum({calculated}) FROM {tables}').fetchone() != (2, 0):
            raise RecordingError(self.path, 'this database is not a recording', 'expected the plain tables of rosbag2')
        texts = ', '.join(f'substr({name}, 1, 1000)' for name in ('name', 'type', 'serialization_format'))
        for key, name, msgtype, encoding in database.execute(f'SELECT id, {texts} FROM topics ORDER BY id'):
            self._budget.charge(0, 10)
            self._topics[key] = Topic.of(str(name), str(msgtype), str(encoding))

    def _charge_steps(self) -> bool:
        """Charges what SQLite has done without a row; ends it where nothing is left."""
        self._budget.records -= _STEPS // _STEPS_PER_RECORD
        return self._budget.records < 0

    def _portions(
        self, database: sqlite3.Connection, key: int, topic: Topic
    ) -> Iterator[tuple[list[int], list[bytes]]]:
        """The times and payloads of a topic's messages, some at a time."""
        data = f'CASE WHEN length(data) <= {LARGEST_MESSAGE} THEN data END'
        query = f'SELECT timestamp, {data} FROM messages WHERE topic_id = ? ORDER BY id'
        cursor: sqlite3.Cursor | None = None
        while True:
            try:
                cursor = cursor or database.execute(query, (key,))
                rows = cursor.fetchmany(PORTION)
            except sqlite3.DatabaseError as error:
                self._budget.charge(0)
                self.warnings.append(f'{self.path.name} is damaged ({error}): messages of {topic.name} may be missing')
                return
            if not rows:
                return
            times = [time if isinstance(time, int) else 0 for time, _ in rows]
            yield times, [data if isinstance(data, bytes) else b'' for _, data in rows]
