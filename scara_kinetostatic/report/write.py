"""Writes the three files of a result, all or none."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.files.atomic import write_texts
from scara_kinetostatic.render.json_file import json_text
from scara_kinetostatic.report import document as json_file
from scara_kinetostatic.report import page, parameter_file

RESULTS = (parameter_file.NAME, json_file.NAME, page.NAME)
"""The files of a result."""


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

    All files are written to a hidden folder inside first and then renamed. If anything fails, Ctrl-C included, the
    folder is as before.

    Args:
        outcome: the result.
        folder: made if it is not there; files of an earlier result in it are replaced.

    Raises:
        OutputError: the folder cannot be written.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> files = sk.write_results(sk.diagnose('touches.csv', cell), 'result')
        >>> files.document.name, files.report.name
        ('calibration.json', 'report.html')
    """
    folder = Path(folder)
    contents = (
        parameter_file.parameter_text(outcome),
        json_text(json_file.as_document(outcome)),
        page.html_text(outcome),
    )
    texts = dict(zip(RESULTS, contents, strict=True))
    write_texts(folder, texts)
    return WrittenFiles(folder, *(folder / name for name in texts))
