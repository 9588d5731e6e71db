"""From recordings to the outcome: what the command and the calibrator node both run."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scara_kinetostatic.bags.reader import read_streams
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import USUAL_NOISE
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.solver import Termination
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.outcome import Outcome
from scara_kinetostatic.errors import CellError, UnsupportedDataError
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.touch import TouchSet
from scara_kinetostatic.touches.detection import Detection, find_touches

HOPELESS = 0.5
"""Force error, as a part of the force, beyond which a fit is none, settled or not."""
Progress = Callable[[str, float], None]
"""Called with what is being done and how much of all is done, 0 to 1."""


def gather_touches(paths: Sequence[str | Path], cell: Cell, progress: Progress | None = None) -> Detection:
    """The touches of several recordings, numbered on from one to the next.

    Raises:
        RecordingError: a recording cannot be read.
    """
    parts: list[Detection] = []
    found = 0
    for number, path in enumerate(paths):
        _tell(progress, f'reading {path}', number / len(paths))
        streams = read_streams(path, cell)
        part = _renumbered(find_touches(streams, cell), found)
        said = (*streams.warnings, *part.warnings)
        parts.append(replace(part, warnings=tuple(_with_source(path, text, paths) for text in said)))
        found += part.found
    _tell(progress, f'{found} touches found', 1.0)
    return Detection(
        touches=TouchSet.concatenate([part.touches for part in parts]),
        rejected=tuple(item for part in parts for item in part.rejected),
        found=found,
        warnings=tuple(text for part in parts for text in part.warnings),
        episodes=tuple(item for part in parts for item in part.episodes),
        start=parts[0].start,
        contradiction=next((part.contradiction for part in parts if part.contradiction), ''),
    )


def _renumbered(part: Detection, first: int) -> Detection:
    return replace(
        part,
        touches=part.touches.replace(index=part.touches.index + first),
        rejected=tuple(replace(item, index=item.index + first) for item in part.rejected),
        episodes=tuple(replace(item, index=item.index + first) for item in part.episodes),
    )


def _with_source(path: str | Path, text: str, paths: Sequence[str | Path]) -> str:
    return text if len(paths) == 1 or text.startswith(str(path)) else f'{path}: {text}'


def calibrate_recordings(
    paths: Sequence[str | Path],
    cell: Cell,
    *,
    fixed: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Outcome:
    """Read recordings, find their touches, calibrate, diagnose.

    Args:
        paths: the recordings.
        cell: the cell.
        fixed: parameters to hold, by name.
        progress: told what is being done.

    Raises:
        RecordingError: a recording cannot be read.
        CellError: the forces contradict the cell's sensor sign or frame.
        UnsupportedDataError: no touches, too few, or a fit that does not settle.
        ParameterError: `fixed` names no parameter.
    """
    detection = gather_touches(paths, cell, progress)
    if detection.contradiction:
        raise CellError('sensor.frame, sensor.sign', detection.contradiction, 'correct the cell description')
    if not len(detection.touches):
        raise UnsupportedDataError(_no_touches(paths, detection), 'see what `inspect` says about the recording')
    _tell(progress, f'fitting {len(detection.touches)} touches', 0.0)
    calibration = _calibrated(paths, detection, cell, fixed)
    _tell(progress, 'looking for what the model lacks', 0.3)
    diagnosis = diagnose(calibration)
    _tell(progress, 'predicting held-out touches', 0.8)
    final = _converged(diagnosis.extended or calibration, paths)
    held_out = held_out_force_error(replace(calibration, used=final.used))
    extended_held_out = held_out if final is calibration else held_out_force_error(final)
    _tell(progress, 'done', 1.0)
    rejected = sorted((*detection.rejected, *final.rejected), key=lambda item: item.index)
    return Outcome(
        calibration=calibration,
        held_out=held_out,
        diagnosis=diagnosis,
        extended_held_out=extended_held_out,
        found=detection.found,
        rejected=tuple(rejected),
        sources=tuple(str(path) for path in paths),
        warnings=detection.warnings,
    )


def _calibrated(
    paths: Sequence[str | Path], detection: Detection, cell: Cell, fixed: Mapping[str, float] | None
) -> Calibration:
    """The calibration of the twelve; what is wrong with the data is told with their name.

    Where nothing can be said with the noise estimated, the fit is that at the usual noise, if it leads to a missing
    effect: its own sigmas say how badly it fits.
    """
    names = ', '.join(str(path) for path in paths)
    try:
        return calibrate(detection.touches, cell, fixed=fixed)
    except UnsupportedDataError as error:
        trouble = UnsupportedDataError(f'{names}: {error.problem}{_lost(detection)}', error.remedy)
        if cell.noise is not None:
            raise trouble from error
    try:  # an effect so large that, taken for noise, it hides everything
        usual = calibrate(detection.touches, replace(cell, noise=USUAL_NOISE), fixed=fixed)
    except UnsupportedDataError:
        raise trouble from None
    calibration = replace(usual, cell=replace(usual.cell, noise=None))
    if diagnose(calibration).verdict != 'explained':
        raise trouble
    return calibration


def _lost(detection: Detection) -> str:
    """What became of the other touches, where most of those found cannot be used."""
    if len(detection.rejected) <= len(detection.touches):
        return ''
    first, lost = detection.rejected[0], len(detection.rejected)
    return f'; {lost} of {detection.found} found were rejected, the first, touch {first.index}: {first.reason}'


def _converged(found: Calibration, paths: Sequence[str | Path]) -> Calibration:
    """The calibration of the final model, if it is one."""
    size = float(np.hypot(found.force[:, 0], found.force[:, 1]).mean())
    if found.termination is not Termination.CONVERGED or found.force_error > HOPELESS * size:
        names = ', '.join(str(path) for path in paths)
        raise UnsupportedDataError(
            f'{names}: the fit does not settle, at a force error of {found.force_error:.3g} N',
            'check the places of the discs, the names and units of the joints, frame, sign and axes of the sensor',
        )
    return found


def _no_touches(paths: Sequence[str | Path], detection: Detection) -> str:
    names = ', '.join(str(path) for path in paths)
    if not detection.found:
        return f'{names}: no contact anywhere in the recording'
    return f'{names}: none of {detection.found} touches can be used: {detection.rejected[0].reason}'


def _tell(progress: Progress | None, what: str, part: float) -> None:
    if progress is not None:
        progress(what, part)
