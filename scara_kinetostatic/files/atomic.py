"""Files on the disk: read within a limit, written completely or not at all, made from templates, told by checksums.

**Atomic writing.** A new file or folder, or a replaced file, appears completely or not at all.

Everything is written into a hidden folder beside its place first, seen to the disk (fsync) and then renamed, which the
file system does in one step. New things never replace anything: `all_or_nothing`. Files that may exist are replaced by
`replace_text`, one, and `write_texts`, several together.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import chain, count
from pathlib import Path
from typing import Any

from scara_kinetostatic.errors import InputError, OutputError, ScaraKinetostaticError

KIB, MIB = 1 << 10, 1 << 20
"""Bytes."""


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """Turns what goes wrong inside into an `OutputError`.

    Args:
        path: what is being written, for the message.

    Raises:
        OutputError: it cannot be written.
    """
    try:
        yield
    except ScaraKinetostaticError:
        raise
    except (OSError, ValueError) as error:
        reason = (error.strerror if isinstance(error, OSError) else str(error)) or type(error).__name__
        raise OutputError(path, f'cannot be written: {reason}', 'choose another place, or make room there') from error


@contextmanager
def all_or_nothing(path: Path) -> Iterator[Path]:
    """Makes a new file or folder that appears in one step when the block ends.

    Args:
        path: the file or folder, which must not exist; the folders above it are made.

    Yields:
        A hidden folder beside `path`, removed afterwards. The block makes the file or folder in it, under the name
        of `path`.

    Raises:
        OutputError: `path` exists, or cannot be written; nothing of it is left.
    """
    with writing(path):
        if path.exists() or path.is_symlink():
            raise _exists(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        with _hidden_folder(path.parent, path.name) as hidden:
            yield hidden
            _appear(hidden / path.name, path)
            sync_folder(path.parent)


def fresh_folder(parent: str | Path, stem: str) -> Path:
    """A path for a new folder that does not exist, `<stem>_<date>-<time>` as `ros2 bag record` names it.

    Args:
        parent: the folder in which it is to be.
        stem: first part of its name.
    """
    base = Path(parent) / time.strftime(f'{stem}_%Y_%m_%d-%H_%M_%S')
    paths = chain([base], (base.with_name(f'{base.name}_{number}') for number in count(2)))
    return next(path for path in paths if not path.exists())


def replace_text(path: Path, text: str) -> None:
    """Writes a file, new or in place of a former one, in one step; a reader sees either the old text or the new one.

    Raises:
        OSError: it cannot be written; the former file stays.
    """
    draft = path.with_name(f'.{path.name}.new')
    _write(draft, text)
    draft.replace(path)
    sync_folder(path.parent)


def write_texts(folder: str | Path, texts: Mapping[str, str | bytes], kept: Mapping[str, str] | None = None) -> None:
    """Writes files into a folder. All are on the disk before the first takes its place; each does so in one step.

    Args:
        folder: the folder, made if it does not exist.
        texts: the content of each file by its name; former files of these names are replaced.
        kept: new names of former files that are kept, by their names.

    Raises:
        OutputError: the folder cannot be written; no file in it has changed, unless a file that was writable before
            cannot be replaced.
    """
    folder, kept = Path(folder), kept or {}
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        for place in (folder / name for name in texts):
            if place.is_dir():
                raise OutputError(place, 'is a folder where a file is to be written', 'move it, or choose another')
            if place.exists() and not place.is_file():
                raise OutputError(place, 'is a device or pipe, and would be replaced by a file', 'choose another')
        with _hidden_folder(folder, 'results') as hidden:
            for name, text in texts.items():
                _write(hidden / name, text)
            for name, second in kept.items():
                try:
                    os.link(folder / name, hidden / second)
                except OSError:  # not on every disk
                    shutil.copy2(folder / name, hidden / second)

            def put() -> None:
                for name in (*kept.values(), *texts):
                    (hidden / name).replace(folder / name)
                for name in kept.keys() - texts.keys():
                    (folder / name).unlink()

            with ThreadPoolExecutor(1) as thread:  # Ctrl-C comes to the main thread alone, which waits for this one
                thread.submit(put).result()
            sync_folder(folder)


def sync_folder(folder: Path) -> None:
    """Waits until the names in a folder are on the disk.

    Raises:
        OSError: the folder cannot be read, or the disk fails.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _write(path: Path, text: str | bytes) -> None:
    with path.open('wb') as stream:
        stream.write(text if isinstance(text, bytes) else text.encode('utf-8', 'backslashreplace'))
        stream.flush()
        os.fsync(stream.fileno())


@contextmanager
def _hidden_folder(parent: Path, name: str) -> Iterator[Path]:
    """A hidden folder for drafts, removed with all that is left in it."""
    hidden = parent / f'.{name}.{os.getpid()}.{time.monotonic_ns()}.new'
    try:
        hidden.mkdir()
        yield hidden
    finally:
        shutil.rmtree(hidden, ignore_errors=True)


def _appear(made: Path, path: Path) -> None:
    """Moves something new to its place in one step, unless another program has put something there meanwhile."""
    try:
        if made.is_dir():
            if path.exists():  # `rename` would silently replace an empty folder
                raise FileExistsError
            made.rename(path)
        else:
            os.link(made, path)
    except OSError as error:
        if not path.exists():
            raise
        raise _exists(path) from error


def _exists(path: Path) -> OutputError:
    return OutputError(path, 'exists already and is never overwritten', 'choose another name')


def read_file(path: str | Path, problem: type[InputError], most: int, what: str) -> bytes:
    """The content of a file that a user names.

    Args:
        path: the file.
        problem: error class to raise.
        most: largest size, bytes.
        what: it is expected to hold, for the message.

    Raises:
        problem: no such file, no regular file, too large, or unreadable.
    """
    path = Path(path)
    try:
        if not path.exists():
            raise problem(path, 'there is no such file', 'check the path')
        if not path.is_file():
            kind = 'a folder' if path.is_dir() else 'something else'
            raise problem(path, f'expected a file of {what}, got {kind}', 'name the file itself')
        if (size := path.stat().st_size) > most:
            raise problem(path, f'expected at most {most // KIB} KiB of {what}, got {size} bytes', 'check the path')
        return path.read_bytes()
    except (OSError, ValueError) as error:  # a ValueError: a path with a null character
        reason = error.strerror if isinstance(error, OSError) else error
        raise problem(path, f'cannot be read: {reason}', 'check the path') from error


def recording_checksum(path: str | Path) -> str:
    r"""SHA-256 of a recording, hexadecimal, to tell later from which data a result was calculated.

    Of a file it is that of its bytes, as `sha256sum FILE` prints it. Of a rosbag2 folder it is that of the list that
    `sha256sum` prints of its files, sorted by name; others, such as notes or results, do not count:

        cd FOLDER
        find . -maxdepth 1 -type f \( -name metadata.yaml -o -name '*.mcap' -o -name '*.db3' -o -name '*.zstd' \
          -o -name '*.part' \) -exec sha256sum {} + | LC_ALL=C sort -k2 | sha256sum

    Raises:
        OSError: a file cannot be read.
    """
    path = Path(path)
    if not path.is_dir():
        return _file_checksum(path)
    stored = re.compile(r'metadata\.yaml|.+\.(mcap|db3|zstd|part)', re.DOTALL)
    files = [file for file in path.iterdir() if stored.fullmatch(file.name) and file.is_file()]
    files.sort(key=lambda file: file.name.encode())
    listing = ''.join(f'{_file_checksum(file)}  ./{file.name}\n' for file in files)
    return hashlib.sha256(listing.encode('utf-8', 'surrogateescape')).hexdigest()


def _file_checksum(file: Path) -> str:
    digest = hashlib.sha256()
    with file.open('rb') as stream:
        while piece := stream.read(MIB):
            digest.update(piece)
    return digest.hexdigest()


def render(path: Path, *, escape: bool = True, **values: Any) -> str:
    """The text of a Jinja template with its values; one that is missing is an error.

    Args:
        path: the template; it may include others of its folder.
        escape: whether values are escaped as HTML and XML need it.
        values: by name.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(path.parent),
        autoescape=escape,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(path.name).render(**values)


def check_different(paths: Sequence[Path]) -> None:
    """Check that no input is given twice: counted twice, its data would make the result look better than it is.

    Raises:
        InputError: two paths are the same file or folder.
    """
    places = [path.resolve() for path in paths]
    for k, path in enumerate(paths):
        if places[k] in places[:k]:
            raise InputError(path, 'is given twice', 'give each input once')
