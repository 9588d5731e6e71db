"""Small files made to hurt: what each costs, and that it is read or refused in one line.

    python -m benchmark.faults.hostile [--only WORD...] [--json FILE]

Each file is made, given to the command in a process of its own, and the time and the peak memory of that process are
measured. Exit status 1 if one needs more than 5 s of processor time or 500 MB, ends in a traceback or an internal
error, or is refused in more than one line.
"""

from __future__ import annotations

import bz2
import json
import os
import resource
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from rosbags import rosbag2
from rosbags.typesys import Stores, get_typestore

from benchmark.common import CELL, parser, peak_memory, save
from scara_kinetostatic.bags.decoding import (
    JOINT_STATE,
    TF_MESSAGE,
    WRENCH_STAMPED,
    joint_state_messages,
    wrench_messages,
)
from scara_kinetostatic.files.cell_file import dump_cell
from scara_kinetostatic.monitoring.history import APPLICATION, VERSION

SECONDS, MEGABYTES = 5.0, 500.0
KILLED = 60.0
BAG = Path(__file__).parents[2] / 'bags' / 'undeclared_a.mcap'
MAGIC = b'\x89MCAP0\r\n'
COMMAND = (sys.executable, '-m', 'scara_kinetostatic.cli.main')
STAMP = np.array([1_700_000_000_000_000_000])
JOINT, WRENCH = (
    joint_state_messages(STAMP, np.zeros((1, 2)), CELL.joint_names)[0],
    wrench_messages(STAMP, np.zeros((1, 2)), 'base')[0],
)
Case = Callable[[Path], list[str]]
CASES: dict[str, Case] = {}


class Cost(NamedTuple):
    """What the command needed: exit status, processor time, s, MB, and what it wrote on stderr."""

    status: int
    seconds: float
    megabytes: float
    message: str

    @property
    def problem(self) -> str:
        """What must not be; empty where all is well."""
        lines = [line for line in self.message.splitlines() if not line.startswith(('note:', 'warning:'))]
        if self.status not in (0, 2, 3) or 'Traceback' in self.message or 'internal error' in self.message:
            return f'exit status {self.status}'
        if len(lines) > 1:
            return f'{len(lines)} lines'
        over = (self.seconds > SECONDS) * f'{self.seconds:.1f} s', (self.megabytes > MEGABYTES) * 'memory'
        return ', '.join(filter(None, over))


def cost_of(arguments: list[str], folder: Path) -> Cost:
    """Runs the command, and measures it."""
    began, peak, before = time.monotonic(), 0.0, resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = os.environ | {'OPENBLAS_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1'}
    with (folder / 'stderr').open('wb') as errors:
        process = subprocess.Popen(
            [*COMMAND, *arguments], stdout=subprocess.DEVNULL, stderr=errors, cwd=folder, env=environment
        )
        while True:
            if process.poll() is not None:
                break
            if time.monotonic() - began > KILLED:
                process.kill()
            with suppress(StopIteration):  # it has just ended
                peak = max(peak, peak_memory(process.pid) / 1e6)  # what `wait4` states includes that of its parent
            time.sleep(0.01)
    message = (folder / 'stderr').read_text(errors='replace').strip()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(process.returncode, seconds, peak, message)


def case(make: Case) -> Case:
    """Registers a case: a function that makes the file in a folder and gives the arguments of the command."""
    CASES[make.__name__.strip('_')] = make
    return make


def _inspect(path: Path) -> list[str]:
    (path.parent / 'cell.yaml').write_text(dump_cell(CELL))
    return ['inspect', str(path), '--cell', str(path.parent / 'cell.yaml')]


# --- MCAP ---


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack('<BQ', opcode, len(content)) + content


def _text(text: str) -> bytes:
    return struct.pack('<I', len(text)) + text.encode()


def _schema(number: int, name: str) -> bytes:
    return _record(Opcode.SCHEMA, struct.pack('<H', number) + _text(name) + _text('ros2msg') + struct.pack('<I', 0))


def _channel(number: int, topic: str) -> bytes:
    return _record(Opcode.CHANNEL, struct.pack('<HH', number, number) + _text(topic) + _text('cdr') + _text(''))


def _message(channel: int, payload: bytes) -> bytes:
    return _record(Opcode.MESSAGE, struct.pack('<HIQQ', channel, 0, int(STAMP[0]), int(STAMP[0])) + payload)


def _chunk(data: bytes, size: int, compression: str = 'zstd') -> bytes:
    head = struct.pack('<QQQI', 0, 0, size, 0) + _text(compression) + struct.pack('<Q', len(data))
    return _record(Opcode.CHUNK, head + data)


def _zeros(size: int) -> bytes:
    """So many zeros, zstd; made in pieces."""
    piece = bytes(1 << 24)
    packer = zstandard.ZstdCompressor(level=1).compressobj(size=size)
    parts = [packer.compress(piece[: min(len(piece), size - at)]) for at in range(0, size, len(piece))]
    return b''.join(parts) + packer.flush()


def _mcap(path: Path, *records: bytes) -> Path:
    known = ((1, JOINT_STATE, '/joint_states'), (2, WRENCH_STAMPED, '/wrench'), (3, TF_MESSAGE, '/tf_static'))
    definitions = [_schema(number, kind) + _channel(number, topic) for number, kind, topic in known]
    header = _record(Opcode.HEADER, _text('ros2') + _text(''))
    path.write_bytes(MAGIC + header + b''.join(definitions) + b''.join(records))
    return path


def _packed(data: bytes, size: int = 0) -> bytes:
    return _chunk(zstandard.compress(data), size or len(data))


@case
def mcap_zstd_stated_giant(folder: Path) -> list[str]:
    """A chunk of zeros, 3.5 GB when unpacked, in a file that is compressed as a whole."""
    path = _mcap(folder / 'a.mcap', _chunk(_zeros(3_500_000_000), 3_500_000_000))
    (folder / 'b.mcap.zstd').write_bytes(zstandard.compress(path.read_bytes()))
    return _inspect(folder / 'b.mcap.zstd')


@case
def mcap_zstd_giant_record(folder: Path) -> list[str]:
    """A file compressed as a whole whose one record has 3.5 GB."""
    head = MAGIC + struct.pack('<BQ', Opcode.CHUNK, 3_500_000_000)
    (folder / 'b.mcap.zstd').write_bytes(zstandard.compress(head) + _zeros(3_500_000_000))
    return _inspect(folder / 'b.mcap.zstd')


@case
def mcap_length_beyond_the_file(folder: Path) -> list[str]:
    """A chunk that states 3.5 GB of data and has none."""
    head = struct.pack('<QQQI', 0, 0, 100, 0) + _text('zstd') + struct.pack('<Q', 3_500_000_000)
    return _inspect(_mcap(folder / 'a.mcap', _record(Opcode.CHUNK, head)))


@case
def mcap_stated_small(folder: Path) -> list[str]:
    """A chunk of zeros that states 100 bytes and has 3.5 GB."""
    return _inspect(_mcap(folder / 'a.mcap', _chunk(_zeros(3_500_000_000), 100)))


@case
def mcap_lz4(folder: Path) -> list[str]:
    """The same with LZ4, 1 GB."""
    data = lz4.frame.compress(bytes(1_000_000_000), compression_level=0)
    return _inspect(_mcap(folder / 'a.mcap', _chunk(data, 100, 'lz4'), _chunk(data, 1_000_000_000, 'lz4')))


@case
def mcap_repeated_schemas(folder: Path) -> list[str]:
    """A chunk that repeats one schema."""
    return _inspect(_mcap(folder / 'a.mcap', _packed(_schema(1, JOINT_STATE) * 4_000_000)))


@case
def mcap_different_schemas(folder: Path) -> list[str]:
    """Chunks of schemas that are all different."""
    chunks = [_packed(b''.join(_schema(k, f'{part}/{k}') for k in range(65_000))) for part in range(10)]
    return _inspect(_mcap(folder / 'a.mcap', *chunks))


@case
def mcap_thirty_chunks(folder: Path) -> list[str]:
    """Thirty chunks of 256 MB."""
    size = (1 << 28) - 9
    data = zstandard.ZstdCompressor(level=1).compress(struct.pack('<BQ', 0x80, size) + bytes(size))
    return _inspect(_mcap(folder / 'a.mcap', *[_chunk(data, size + 9)] * 30))


@case
def mcap_chunks_of_64_mib(folder: Path) -> list[str]:
    """Thirty chunks of the largest size, of messages that are all the same."""
    data = _message(1, JOINT) * (((1 << 26) - 1) // len(_message(1, JOINT)))
    return _inspect(_mcap(folder / 'a.mcap', *[_packed(data)] * 30))


@case
def mcap_giant_definition(folder: Path) -> list[str]:
    """Chunks of a channel whose map has 60 MiB of zeros."""
    content = struct.pack('<HH', 4, 1) + _text('/x') + _text('cdr') + struct.pack('<I', 60 << 20) + bytes(60 << 20)
    return _inspect(_mcap(folder / 'a.mcap', *[_packed(_record(Opcode.CHANNEL, content))] * 4))


@case
def mcap_empty_records(folder: Path) -> list[str]:
    """A chunk of records without content."""
    return _inspect(_mcap(folder / 'a.mcap', _packed(struct.pack('<BQ', 0x80, 0) * 7_000_000)))


@case
def mcap_many_layouts(folder: Path) -> list[str]:
    """Each message has a frame of its own, so that none has the layout of another."""
    frames = (wrench_messages(STAMP, np.zeros((1, 2)), f'{number:08d}')[0] for number in range(200_000))
    return _inspect(_mcap(folder / 'a.mcap', _packed(b''.join(_message(2, payload) for payload in frames))))


@case
def mcap_many_joints(folder: Path) -> list[str]:
    """Messages of 200 000 joints without a name."""
    data = bytes([0, 1, 0, 0]) + bytes(8) + struct.pack('<I', 1) + b'\0' * 4 + struct.pack('<I', 200_000)
    messages = [_message(1, data + struct.pack('<I', 0) * 200_000 + struct.pack('<I', k)) for k in range(60)]
    return _inspect(_mcap(folder / 'a.mcap', _packed(b''.join(messages))))


@case
def mcap_transforms(folder: Path) -> list[str]:
    """A flood of fixed transforms."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](0, 0), 'a')
    vector, turn = types['geometry_msgs/msg/Vector3'](0, 0, 0), types['geometry_msgs/msg/Quaternion'](0, 0, 0, 1)
    one = types['geometry_msgs/msg/TransformStamped'](header, 'b', types['geometry_msgs/msg/Transform'](vector, turn))
    payload = bytes(store.serialize_cdr(types[TF_MESSAGE]([one] * 5000), TF_MESSAGE))
    return _inspect(_mcap(folder / 'a.mcap', _packed(_message(3, payload) * 100)))


def _indexed(path: Path, chunk: bytes, entries: int) -> Path:
    """A file whose index has one chunk many times."""
    head = MAGIC + _record(Opcode.HEADER, _text('ros2') + _text(''))
    definitions = _schema(1, JOINT_STATE) + _channel(1, '/joint_states')
    index = struct.pack('<QQQQI', 0, 0, len(head), len(chunk), 0) + struct.pack('<Q', 0) + _text('zstd')
    index = _record(Opcode.CHUNK_INDEX, index + struct.pack('<QQ', 0, 0))
    counts = struct.pack('<QHIIIIQQI', 1, 1, 1, 0, 0, entries, 0, 0, 0)
    end = _record(Opcode.DATA_END, bytes(4))
    start = len(head) + len(chunk) + len(end)
    summary = definitions + index * entries + _record(Opcode.STATISTICS, counts)
    path.write_bytes(head + chunk + end + summary + _record(Opcode.FOOTER, struct.pack('<QQI', start, 0, 0)) + MAGIC)
    return path


@case
def mcap_index_repeats_a_chunk(folder: Path) -> list[str]:
    """The index names one chunk of 60 MiB five thousand times."""
    data = _message(1, JOINT) * ((60 << 20) // len(_message(1, JOINT)))
    return _inspect(_indexed(folder / 'a.mcap', _packed(data), 5000))


@case
def mcap_zstd_giant_index(folder: Path) -> list[str]:
    """An index of three million entries, in a file that is compressed as a whole."""
    path = _indexed(folder / 'a.mcap', _packed(_message(1, JOINT)), 3_000_000)
    (folder / 'b.mcap.zstd').write_bytes(zstandard.compress(path.read_bytes()))
    return _inspect(folder / 'b.mcap.zstd')


@case
def mcap_zstd_message_index(folder: Path) -> list[str]:
    """Twelve million entries of message indices."""
    index = _record(Opcode.MESSAGE_INDEX, struct.pack('<HI', 1, 16_000_000) + bytes(16_000_000))
    path = _mcap(folder / 'a.mcap', *[index] * 12)
    (folder / 'b.mcap.zstd').write_bytes(zstandard.compress(path.read_bytes()))
    return _inspect(folder / 'b.mcap.zstd')


# --- ROS 1 ---


def _number(value: int) -> bytes:
    return struct.pack('<I', value)


def _field(**values: bytes) -> bytes:
    fields = [key.encode() + b'=' + value for key, value in values.items()]
    return b''.join(_number(len(text)) + text for text in fields)


def _ros1_record(header: bytes, data: bytes) -> bytes:
    return struct.pack('<I', len(header)) + header + struct.pack('<I', len(data)) + data


def _ros1(path: Path, data: bytes, size: int, compression: str, offsets: list[int], infos: int = 1) -> Path:
    """A bag of one connection and one chunk, whose index names these offsets; the chunk may be listed many times."""
    chunk = _ros1_record(_field(op=b'\5', compression=compression.encode(), size=struct.pack('<I', size)), data)
    entry = b''.join(struct.pack('<III', 1, 0, offset) for offset in offsets)
    index = _field(op=b'\4', ver=_number(1), conn=_number(0), count=_number(len(offsets)))
    begin = 13 + 8 + 4096 - 8
    place = begin + len(chunk) + len(_ros1_record(index, entry))
    header = _field(op=b'\3', index_pos=struct.pack('<Q', place), conn_count=_number(1), chunk_count=_number(infos))
    header = struct.pack('<I', len(header)) + header
    padding = b' ' * (begin - 13 - len(header) - 4)
    about = _field(topic=b'/joint_states', type=b'sensor_msgs/JointState', md5sum=b'*', message_definition=b' ')
    connection = _ros1_record(_field(op=b'\7', conn=_number(0), topic=b'/joint_states'), about)
    times = {'start_time': struct.pack('<II', 1, 0), 'end_time': struct.pack('<II', 1, 0)}
    info = _field(op=b'\6', ver=_number(1), chunk_pos=struct.pack('<Q', begin), count=_number(1), **times)
    info = _ros1_record(info, struct.pack('<II', 0, len(offsets)))
    start = b'#ROSBAG V2.0\n' + header + struct.pack('<I', len(padding)) + padding
    path.write_bytes(start + chunk + _ros1_record(index, entry) + connection + info * infos)
    return path


def _ros1_message(payload: bytes) -> bytes:
    return _ros1_record(_field(op=b'\2', conn=_number(0), time=struct.pack('<II', 1, 0)), payload)


@case
def ros1_bz2(folder: Path) -> list[str]:
    """A bz2 chunk that unpacks to 3 GB."""
    data = bz2.compress(bytes(1 << 27)) * 24
    return _inspect(_ros1(folder / 'a.bag', data, 3_221_225_472, 'bz2', [0]))


@case
def ros1_lz4(folder: Path) -> list[str]:
    """An LZ4 chunk that unpacks to 1 GB."""
    return _inspect(_ros1(folder / 'a.bag', lz4.frame.compress(bytes(1 << 30)), 1 << 30, 'lz4', [0]))


@case
def ros1_repeated_index(folder: Path) -> list[str]:
    """One chunk listed ten thousand times, each time with a thousand messages."""
    return _inspect(_ros1(folder / 'a.bag', _ros1_message(bytes(40)), 100, 'none', [0] * 1000, 10_000))


@case
def ros1_repeated_message(folder: Path) -> list[str]:
    """A hundred thousand entries of the index name one message of 1 MB."""
    data = bz2.compress(_ros1_message(bytes(1_000_000)))
    return _inspect(_ros1(folder / 'a.bag', data, 1_000_100, 'bz2', [0] * 100_000))


@case
def ros1_giant_header(folder: Path) -> list[str]:
    """Entries of the index name a message whose header has 100 000 fields."""
    head = _field(op=b'\2', conn=_number(0), time=struct.pack('<II', 1, 0)) + _field(a=b'') * 100_000
    data = bz2.compress(_ros1_record(head, bytes(40)))
    return _inspect(_ros1(folder / 'a.bag', data, 1_000_100, 'bz2', [0] * 10_000))


# --- SQLite ---


def _varint(value: int) -> bytes:
    parts = [value & 0x7F]
    while value := value >> 7:
        parts.append(value & 0x7F | 0x80)
    return bytes(reversed(parts))


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    while True:
        value = value << 7 | data[at] & 0x7F
        at += 1
        if not data[at - 1] & 0x80:
            return value, at


def _database(path: Path, payload: bytes, topic: str = '/joint_states') -> int:
    """A bag with one message; returns the root page of its table."""
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path, isolation_level=None)
    database.execute('PRAGMA page_size = 4096')
    database.execute('CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)')
    columns = 'id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB'
    database.execute(f'CREATE TABLE messages ({columns})')
    database.execute("INSERT INTO topics VALUES (1, ?, 'sensor_msgs/msg/JointState', 'cdr')", (topic,))
    database.execute('INSERT INTO messages VALUES (1, 1, 5, ?)', (payload,))
    (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    database.close()
    return int(root)


def _with_pages(path: Path, root: int, pages: list[bytes]) -> None:
    """Replaces the root page and appends the others; the first page states how many there are."""
    data = bytearray(path.read_bytes())
    data[(root - 1) * 4096 : root * 4096] = pages[0]
    data += b''.join(pages[1:])
    data[28:32] = (len(data) // 4096).to_bytes(4, 'big')
    path.write_bytes(data)


def _leaf(cells: list[bytes]) -> bytes:
    return _page(b'\x0d', cells)


def _interior(children: list[tuple[int, int]], last: int) -> bytes:
    return _page(b'\x05', [struct.pack('>I', page) + _varint(key) for page, key in children], struct.pack('>I', last))


def _page(kind: bytes, cells: list[bytes], last: bytes = b'') -> bytes:
    places, content = [], b''
    for cell in cells:
        content = cell + content
        places.append(4096 - len(content))
    head = kind + struct.pack('>HHHB', 0, len(cells), 4096 - len(content), 0) + last
    head += b''.join(struct.pack('>H', place) for place in places)
    return head + bytes(4096 - len(head) - len(content)) + content


@case
def sqlite_overflow_chain(folder: Path) -> list[str]:
    """Two thousand rows state the same overflow pages as their message of 1 MB."""
    path = folder / 'a.db3'
    size = 489 + 4092 * 255  # leaves as few bytes in the row as possible
    root = _database(path, bytes(size - 14))
    page = path.read_bytes()[(root - 1) * 4096 : root * 4096]
    at = int.from_bytes(page[8:10], 'big')
    payload, after = _read_varint(page, at)
    _, begin = _read_varint(page, after)
    end = begin + 489 + (payload - 489) % 4092 if 489 + (payload - 489) % 4092 <= 4061 else begin + 489
    cell, first = page[begin : end + 4], path.stat().st_size // 4096 + 1
    each = 4000 // (len(cell) + 10)
    rows = [list(range(k, k + each)) for k in range(1, 2000, each)]
    leaves = [_leaf([_varint(payload) + _varint(row) + cell for row in some]) for some in rows]
    children = [(first + k, some[-1]) for k, some in enumerate(rows)]
    _with_pages(path, root, [_interior(children[:-1], children[-1][0]), *leaves])
    return _inspect(path)


@case
def sqlite_endless_tree(folder: Path) -> list[str]:
    """Pages of the tree that all name the next one: 300 to the power of 10 rows, none of a wanted topic."""
    path = folder / 'a.db3'
    root = _database(path, JOINT)
    first = path.stat().st_size // 4096 + 1
    leaf = _leaf([_varint(5) + _varint(1) + bytes([5, 0, 8, 8, 12])])
    pages = [_interior([(first + level, 1)] * 300, first + level) for level in range(10)]
    _with_pages(path, root, [*pages, leaf])
    return _inspect(path)


@case
def sqlite_zstd_zeros(folder: Path) -> list[str]:
    """A database compressed as a whole, 3.5 GB of zeros behind its head."""
    _database(folder / 'a.db3', JOINT)
    (folder / 'b.db3.zstd').write_bytes(zstandard.compress((folder / 'a.db3').read_bytes()) + _zeros(3_500_000_000))
    return _inspect(folder / 'b.db3.zstd')


@case
def sqlite_compressed_messages(folder: Path) -> list[str]:
    """A thousand messages, each 3.5 GB of zeros."""
    writer = rosbag2.Writer(folder / 'bag', version=8, storage_plugin=rosbag2.StoragePlugin.SQLITE3)
    store, payload = get_typestore(Stores.ROS2_JAZZY), _zeros(3_500_000_000)
    with writer:
        connection = writer.add_connection('/joint_states', JOINT_STATE, typestore=store)
        for number in range(20):
            writer.write(connection, number + 1, payload)
    return _inspect(folder / 'bag')


@case
def sqlite_generated_column(folder: Path) -> list[str]:
    """Messages that are calculated from the schema, 800 MB each."""
    _database(folder / 'a.db3', b'')
    with sqlite3.connect(folder / 'a.db3') as database:
        database.execute('DROP TABLE messages')
        database.execute('CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER)')
        database.executemany('INSERT INTO messages VALUES (?, 1, 5)', [(k,) for k in range(100)])
        database.execute('ALTER TABLE messages ADD COLUMN data BLOB AS (hex(zeroblob(400000000)))')
    return _inspect(folder / 'a.db3')


# --- text ---


@case
def metadata_dense(folder: Path) -> list[str]:
    """The metadata of a folder: 15 MB of one-letter values."""
    (folder / 'bag').mkdir()
    (folder / 'bag' / 'metadata.yaml').write_text('a: [' + 'a,' * 7_500_000 + 'a]')
    _mcap(folder / 'bag' / 'bag_0.mcap', _message(1, JOINT))
    return _inspect(folder / 'bag')


def _table(heading: str, folder: Path) -> list[str]:
    (folder / 'a.csv').write_text(heading + ',q2_rad,fx_N,fy_N\n' + '0.1,0.2,3,4\n' * 12)
    (folder / 'cell.yaml').write_text(dump_cell(CELL))
    return ['calibrate', str(folder / 'a.csv'), '--cell', str(folder / 'cell.yaml'), '--out', str(folder / 'out')]


@case
def heading_of_spaces(folder: Path) -> list[str]:
    """A heading of `q1`, 400 spaces and `)x`."""
    return _table('q1' + ' ' * 400 + ')x', folder)


@case
def heading_of_98_characters(folder: Path) -> list[str]:
    """The same within the limit of a heading."""
    return _table('q1' + ' ' * 94 + ')x', folder)


@case
def table_of_many_rows(folder: Path) -> list[str]:
    """A table of 64 MB of rows with one digit."""
    arguments = _table('q1_rad', folder)
    with (folder / 'a.csv').open('a') as stream:
        stream.write('1\n' * 33_000_000)
    return arguments


@case
def many_columns(folder: Path) -> list[str]:
    """A hundred thousand columns."""
    return _table('q1_rad,' + 'a,' * 100_000 + 'b', folder)


def _cell(text: str, folder: Path) -> list[str]:
    (folder / 'cell.yaml').write_text(dump_cell(CELL) + text)
    return ['calibrate', str(BAG), '--cell', str(folder / 'cell.yaml'), '--out', str(folder / 'out')]


def _plates(number: int) -> str:
    row = '  - {{name: p{}, origin: [0.0, 0.3], uncertainty: {{center: 1.0e-3, angle: 2.0e-3}}}}\n'
    return 'plates:\n' + ''.join(row.format(k) for k in range(number))


@case
def plates_400(folder: Path) -> list[str]:
    """400 plates without discs."""
    return _cell(_plates(400), folder)


@case
def plates_3000(folder: Path) -> list[str]:
    """3000 plates without discs."""
    return _cell(_plates(3000), folder)


@case
def discs_3000(folder: Path) -> list[str]:
    """3000 discs."""
    text = dump_cell(CELL).replace(
        'objects:\n',
        'objects:\n'
        + ''.join(f'  - {{name: d{k}, center: [{0.3 + k * 1e-9}, 0.3], radius: 0.01}}\n' for k in range(3000)),
    )
    (folder / 'cell.yaml').write_text(text)
    return ['calibrate', str(BAG), '--cell', str(folder / 'cell.yaml'), '--out', str(folder / 'out')]


@case
def yaml_dense(folder: Path) -> list[str]:
    """A cell description of 256 KB of one-digit values."""
    return _cell('region: [' + '1,' * 120_000 + '1]\n', folder)


@case
def formula_as_name(folder: Path) -> list[str]:
    """A disc whose name is a formula to a spreadsheet."""
    text = dump_cell(CELL).replace('disc_1', '\'=HYPERLINK("http://x")\'')
    (folder / 'cell.yaml').write_text(text)
    return ['calibrate', str(BAG), '--cell', str(folder / 'cell.yaml'), '--out', str(folder / 'out')]


# --- results ---


def _calibration(folder: Path) -> Path:
    """A calibration, made once."""
    out = Path(tempfile.gettempdir()) / f'hostile_calibration_{os.getpid()}'
    if not (out / 'calibration.json').exists():
        subprocess.run([*COMMAND, 'calibrate', str(BAG), '--out', str(out)], check=True, capture_output=True)
    path = folder / 'calibration.json'
    path.write_text((out / 'calibration.json').read_text())
    return path


def _changed(folder: Path, change: Callable[[dict], object]) -> list[str]:  # type: ignore[type-arg]
    path = _calibration(folder)
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return ['export', str(path), '--format', 'urdf', '--out', str(folder / 'arm.urdf')]


@case
def covariance_not_semidefinite(folder: Path) -> list[str]:
    """Three parameters whose correlations exclude each other."""

    def change(document: dict) -> None:  # type: ignore[type-arg]
        rows = document['model']['covariance']
        size = [rows[k][k] ** 0.5 for k in range(3)]
        for i, j, sign in ((0, 1, 0.9), (0, 2, 0.9), (1, 2, -0.9)):
            rows[i][j] = rows[j][i] = sign * size[i] * size[j]

    return _changed(folder, change)


@case
def json_of_lists(folder: Path) -> list[str]:
    """A calibration of 100 MB of empty lists."""
    (folder / 'calibration.json').write_text('[' + '[],' * 33_000_000 + '[]]')
    return ['export', str(folder / 'calibration.json'), '--format', 'urdf', '--out', str(folder / 'arm.urdf')]


@case
def json_of_lists_within_the_limit(folder: Path) -> list[str]:
    """The same of 12 MB."""
    (folder / 'calibration.json').write_text('[' + '[],' * 4_100_000 + '[]]')
    return ['export', str(folder / 'calibration.json'), '--format', 'urdf', '--out', str(folder / 'arm.urdf')]


def _history(folder: Path, *statements: str) -> list[str]:
    subprocess.run(
        [*COMMAND, 'history', 'add', str(folder / 'a.sqlite'), str(_calibration(folder))],
        check=True,
        capture_output=True,
    )
    with sqlite3.connect(folder / 'a.sqlite') as database:
        for statement in statements:
            database.execute(statement)
    return ['history', 'list', str(folder / 'a.sqlite')]


@case
def history_view(folder: Path) -> list[str]:
    """A history whose table is a view that never ends."""
    columns = "'1' AS robot, '' AS measured, '' AS created, '' AS source, '' AS document, '' AS checksum"
    view = f'WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) SELECT id, {columns} FROM n'
    with sqlite3.connect(folder / 'a.sqlite') as database:
        for statement in (f'PRAGMA application_id = {APPLICATION}', f'PRAGMA user_version = {VERSION}'):
            database.execute(statement)
        database.execute(f'CREATE VIEW calibration AS {view}')
    return ['history', 'list', str(folder / 'a.sqlite')]


@case
def history_trigger(folder: Path) -> list[str]:
    """A history with a trigger that deletes what is added."""
    trigger = 'CREATE TRIGGER t AFTER INSERT ON calibration BEGIN DELETE FROM calibration; END'
    _history(folder, trigger)
    return ['history', 'add', str(folder / 'a.sqlite'), str(folder / 'calibration.json')]


@case
def history_damaged(folder: Path) -> list[str]:
    """A history in which values have other types."""
    return _history(folder, "UPDATE calibration SET document = x'ff00', robot = x'ff'")


@case
def history_of_a_list(folder: Path) -> list[str]:
    """A history whose document is JSON, and no calibration."""
    return _history(folder, "UPDATE calibration SET document = '[1]'")


@case
def history_of_many_values(folder: Path) -> list[str]:
    """A history whose document has millions of empty lists."""
    return _history(
        folder, "UPDATE calibration SET document = '[' || replace(hex(zeroblob(4000000)), '00', '[],') || '1]'"
    )


def main() -> int:
    """Makes the files, runs the command, prints."""
    options_of = parser(__doc__)
    options_of.add_argument('--only', nargs='*', default=[], metavar='WORD', help='cases whose names contain one')
    options = options_of.parse_args()
    costs: dict[str, dict[str, object]] = {}
    for name, make in CASES.items():
        if options.only and not any(word in name for word in options.only):
            continue
        with tempfile.TemporaryDirectory(prefix='hostile_') as text:
            folder = Path(text)
            arguments = make(folder)
            size = sum(file.stat().st_size for file in folder.rglob('*') if str(file).startswith(arguments[1]))
            cost = cost_of(arguments, folder)
        costs[name] = cost._asdict() | {'problem': cost.problem, 'bytes': size}
        last = cost.message.splitlines()[-1] if cost.message else ''
        verdict = f'FAILED ({cost.problem})' if cost.problem else 'read' if cost.status == 0 else 'refused'
        print(f'{name}: {verdict}, {cost.seconds:.1f} s, {cost.megabytes:.0f} MB; {last[:250]}', flush=True)
    failed = sum(bool(cost['problem']) for cost in costs.values())
    print(f'{len(costs)} files, {failed} failures')
    save(options.json, costs)
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
