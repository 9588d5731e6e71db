"""New folders and files that appear whole or not at all, and never over another."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from scara_kinetostatic.errors import OutputError, ScaraKinetostaticError


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """What goes wrong inside leaves as an `OutputError`.

    Raises:
        OutputError: the place cannot be written.
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
    """A hidden folder beside `path`; what is put into it under the name of `path` appears there at the end.

    Args:
        path: the file or folder to be made; must not exist.

    Yields:
        The hidden folder. It is gone afterwards, in any case.

    Raises:
        OutputError: `path` exists, or cannot be written.
    """
    with writing(path):
        if path.exists() or path.is_symlink():
            raise OutputError(path, 'exists already and is never overwritten', 'choose another name')
        if not path.name:
            raise OutputError(path, 'has no name', 'give the name of something new')
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError) as error:
            raise OutputError(path, f'{error.filename} is not a folder', 'choose another place') from error
        workshop = path.parent / f'.{path.name}.{os.getpid()}.{time.monotonic_ns()}.new'
        try:
            workshop.mkdir()
            yield workshop
            _appear(workshop / path.name, path)
            sync_folder(path.parent)
        finally:
            shutil.rmtree(workshop, ignore_errors=True)


def _appear(made: Path, path: Path) -> None:
    """Put something new in its place, in one step, unless something is there by now."""
    try:
        if made.is_dir():
            if path.exists():  # an empty folder would be replaced silently
                raise FileExistsError
            made.rename(path)
        else:
            os.link(made, path)
    except OSError as error:
        if not path.exists():
            raise
        raise OutputError(path, 'exists already and is never overwritten', 'choose another name') from error


def fresh_folder(parent: str | Path, stem: str) -> Path:
    """A name for a new folder that nothing has yet, `<stem>_<date>-<time>` as `ros2 bag record` does it.

    Args:
        parent: where it is to be.
        stem: first part of the name.
    """
    base = Path(parent) / time.strftime(f'{stem}_%Y_%m_%d-%H_%M_%S')
    number, path = 1, base
    while path.exists():
        number += 1
        path = base.with_name(f'{base.name}_{number}')
    return path


def replace_text(path: Path, text: str) -> None:
    """Put a new text in place of a file in one step; a reader sees the old one or the new one.

    Raises:
        OSError: it cannot be written; the old one stays.
    """
    draft = path.with_name(f'.{path.name}.new')
    with draft.open('w', encoding='utf-8') as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())
    draft.replace(path)
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """See the names in a folder to the disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_texts(folder: str | Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder, all or nothing.

    Args:
        folder: made if it is not there.
        texts: what goes into each file, by name; former files of these names are replaced.

    Raises:
        OutputError: the folder cannot be written.
    """
    folder = Path(folder)
    with _writing(folder):
        if folder.is_file():
            raise OutputError(folder, 'cannot be written: it is a file, not a folder', 'choose another folder')
    with _writing(folder), _made(folder), _workshop(folder) as workshop:
        for name, text in texts.items():
            _write(workshop / name, text)
        _exchange(workshop, folder, list(texts))


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        place = error.filename2 or error.filename or folder
        reason = error.strerror or type(error).__name__
        raise OutputError(place, f'cannot be written: {reason}', 'choose another folder, or make room there') from error


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Makes the folder and those above it; takes back what it made if something goes wrong inside."""
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for place in missing:
            if place.is_dir() and not any(place.iterdir()):
                place.rmdir()
        raise


@contextmanager
def _workshop(folder: Path) -> Iterator[Path]:
    workshop = folder / f'.results.{os.getpid()}.{time.monotonic_ns()}.new'
    try:
        workshop.mkdir()
        yield workshop
    finally:
        shutil.rmtree(workshop, ignore_errors=True)


def _write(path: Path, text: str) -> None:
    with path.open('w', encoding='utf-8', errors='backslashreplace') as stream:
        stream.write(text)
        stream.flush()
        os.fsync(stream.fileno())


def _exchange(workshop: Path, folder: Path, names: list[str]) -> None:
    """Put the drafts in place; if one of them does not get there, all former files come back."""
    former = workshop / 'former'
    former.mkdir()
    for name in names:
        if (folder / name).is_dir():
            raise OutputError(folder / name, 'is a folder where a file is to be written', 'move it, or choose another')
        if (folder / name).exists():
            shutil.copy2(folder / name, former / name)
    try:
        for name in names:
            (workshop / name).replace(folder / name)
    except BaseException:
        for name in names:
            if (former / name).exists():
                (former / name).replace(folder / name)
            elif not (workshop / name).exists():
                (folder / name).unlink(missing_ok=True)
        raise
