"""Writes the files of a result, all or none; an earlier result in the same folder is kept under dated names."""

from __future__ import annotations

from datetime import datetime, timezone
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scara_kinetostatic.assessment.outcome import Outcome
from scara_kinetostatic.errors import ParameterError, UnsupportedDataError, expect
from scara_kinetostatic.files.atomic import write_texts, writing
from scara_kinetostatic.files.calibration_file import is_readable
from scara_kinetostatic.files.tables import csv_cell, csv_lines
from scara_kinetostatic.report.json_file import json_text, utc
from scara_kinetostatic.results import calibration_json, calibration_yaml
from scara_kinetostatic.results import report as page

RESIDUALS = 'residuals.csv'
RESULTS = (calibration_yaml.NAME, calibration_json.NAME, page.NAME, RESIDUALS)
"""The files of a result."""


class WrittenFiles(NamedTuple):
    """Where the results are.

    Attributes:
        folder: that holds them.
        parameters: the ROS parameter file.
        document: the JSON.
        report: the page; it is not there where it was not wanted.
        residuals: the table of touches.
        kept: the files of an earlier result under their new names; empty if there was none.
    """

    folder: Path
    parameters: Path
    document: Path
    report: Path
    residuals: Path
    kept: tuple[Path, ...] = ()

    @property
    def paths(self) -> tuple[Path, ...]:
        """The files of this result, the page last."""
        page = (self.report,) if self.report.is_file() else ()
        return (self.parameters, self.document, self.residuals, *page)

    @property
    def note(self) -> str:
        """What was kept, one sentence; empty if nothing."""
        names = [path.name for path in self.kept]
        return f'the earlier result in {self.folder} is kept as {", ".join(names)}' if names else ''


def write_results(outcome: Outcome, folder: str | Path, *, report: bool = True) -> WrittenFiles:
    """Write `calibration.yaml`, `calibration.json`, `report.html` and `residuals.csv` into a folder.

    All files are written to a hidden folder inside first and then renamed. If writing fails, by Ctrl-C for one, the
    folder is as before; Ctrl-C waits while they are renamed.

    Args:
        outcome: the result.
        folder: made if it is not there; files of an earlier result in it are kept under the date at which they were
            written, `calibration_2026-11-21T14-03-22Z.json`.
        report: whether to draw the page, which takes several times as long as the calibration.

    Raises:
        OutputError: the folder cannot be written.
        UnsupportedDataError: there are too many touches for a `calibration.json`.
        ParameterError: `outcome` is none, or `folder` no path.

    Example:
        >>> import scara_kinetostatic as sk
        >>> cell = sk.load_cell('cell.yaml')
        >>> files = sk.write_results(sk.diagnose('touches.csv', cell), 'result')
        >>> files.document.name, files.report.name
        ('calibration.json', 'report.html')
    """
    expect(outcome, Outcome, 'outcome', 'give what diagnose returns')
    if not isinstance(folder, (str, Path)):
        raise ParameterError('folder', f'expected a path, got {type(folder).__name__}')
    folder = Path(folder)
    document = json_text(calibration_json.as_document(outcome))
    if not is_readable(document):
        problem = f'{len(outcome.final.touches)} touches make a {calibration_json.NAME} too large to be read again'
        raise UnsupportedDataError(problem, 'leave some out')
    contents = {
        calibration_yaml.NAME: calibration_yaml.parameter_text(outcome),
        calibration_json.NAME: document,
        **({page.NAME: page.html_text(outcome)} if report else {}),
        RESIDUALS: residual_table(outcome),
    }
    with writing(folder):
        kept = dated_names(folder)
    write_texts(folder, contents, kept)
    parameters, written, drawn, table = (folder / name for name in RESULTS)
    return WrittenFiles(folder, parameters, written, drawn, table, tuple(folder / name for name in kept.values()))


def dated_names(folder: Path) -> dict[str, str]:
    """The names under which the result in a folder is kept, by their present names; empty if there is none.

    Raises:
        OSError: the folder cannot be read.
    """
    present = [folder / name for name in RESULTS if (folder / name).is_file()]
    if not present:
        return {}
    newest = datetime.fromtimestamp(max(path.stat().st_mtime for path in present), timezone.utc)
    date = utc(newest).replace(':', '-')
    endings = chain([date], (f'{date}_{number}' for number in count(2)))
    tried = ({path.name: f'{path.stem}_{ending}{path.suffix}' for path in present} for ending in endings)
    return next(names for names in tried if not any((folder / name).exists() for name in names.values()))


def residual_table(outcome: Outcome) -> str:
    """The touches with what the models predict: one row per touch, CSV.

    Both models stand beside each other: ``calibrated`` is the base model, ``extended`` has the effects found as well;
    where nothing was found they are the same. Forces are those on the object in the base frame, as the base model
    has them (a sensor in the tool frame turns with the estimated angles). Touches that were rejected before the fit
    have index, reason and nothing else. The columns of joints and forces are named as those of a touch table.
    """
    base, t = outcome.calibration, outcome.calibration.touches
    assert np.array_equal(outcome.final.touches.index, t.index)  # both models have the same touches
    names = [csv_cell(disc.name) for disc in base.cell.discs]
    columns: dict[str, Any] = {
        'object': [names[disc] for disc in t.disc],
        'posture': ['left' if side > 0 else 'right' for side in t.posture],
        'time_s': t.time,
    }
    columns |= zip(('q1_rad', 'q2_rad'), base.cell.readings(t.joints).T, strict=True)
    columns |= zip(('fx_N', 'fy_N'), base.force.T, strict=True)
    for model, fit in (('calibrated', base), ('extended', outcome.final)):
        columns |= zip((f'fx_{model}_N', f'fy_{model}_N'), (fit.force - fit.residual).T, strict=True)
        columns |= zip((f'residual_x_{model}_N', f'residual_y_{model}_N'), fit.residual.T, strict=True)
        columns |= {f'standardized_distance_{model}': fit.standardized, f'used_{model}': fit.used.astype(int)}
    texts = [[_text(value) for value in np.asarray(values).tolist()] for values in columns.values()]
    rows = dict(zip(t.index.tolist(), zip(*texts, strict=True), strict=True))
    reasons = {item.index: csv_cell(item.reason) for item in outcome.rejected}
    index = sorted({*rows, *reasons})
    table = [
        (str(number), *rows.get(number, [''] * len(columns)), str(int(number not in reasons)), reasons.get(number, ''))
        for number in index
    ]
    return csv_lines(dict(zip(('index', *columns, 'used', 'reason'), zip(*table, strict=True), strict=True)))


def _text(value: object) -> str:
    """Numbers in the shortest form that gives them back; empty where there is none."""
    if isinstance(value, float):
        return repr(value) if np.isfinite(value) else ''
    return str(value)
