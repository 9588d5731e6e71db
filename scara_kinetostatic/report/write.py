"""The three files of a result, put in place all or nothing."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.errors import OutputError
from scara_kinetostatic.pipeline import Outcome
from scara_kinetostatic.report import html, json_file, parameter_file
from scara_kinetostatic.report.document import as_document


class WrittenFiles(NamedTuple):
    """Where the results are.

    Attributes:
        folder: that holds them.
        parameters: the ROS parameter file.
        document: the JSON.
        report: the page.
    """

    folder: Path
    parameters: Path
    document: Path
    report: Path


def write_results(outcome: Outcome, folder: str | Path) -> WrittenFiles:
    """Write `calibration.yaml`, `calibration.json` and `report.html` into a folder.

    Everything is drafted first, in a hidden folder inside; then each file takes its
    place in one step. If anything goes wrong, Ctrl-C included, all is as before.

    Args:
        outcome: the result.
        folder: made if it is not there; files of an earlier result in it are replaced.

    Raises:
        OutputError: the folder cannot be written.
    """
    folder = Path(folder)
    document = as_document(outcome)
    texts = {
        parameter_file.NAME: parameter_file.parameter_text(outcome),
        json_file.NAME: json_file.json_text(document),
        html.NAME: html.html_text(outcome),
    }
    write_texts(folder, texts)
    return WrittenFiles(folder, *(folder / name for name in texts))


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
