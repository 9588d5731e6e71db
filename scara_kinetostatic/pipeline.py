"""From recordings or touches to the outcome: the one path of command, calibrator node and Python interface.

Touches and recordings may be left out: ``5`` and ``10-14``, or both as ``5,10-14``, are touches by their numbers in the
result, ``touches_1`` is a recording by the name of its file or folder. Of recordings with the same name in several
folders, ``monday/touches_1`` is one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path

import numpy as np

from scara_kinetostatic.assessment.evidence import Discrimination, Evidence
from scara_kinetostatic.assessment.mistakes import FEWEST_TOUCHES, Origin, check_touches, wrong_unit
from scara_kinetostatic.assessment.outcome import Outcome, Recording
from scara_kinetostatic.bags.decoding import reading
from scara_kinetostatic.bags.reader import other_descriptions, read_streams, recorded_cell
from scara_kinetostatic.calibration.calibrate import calibrate, check_units, fixed_effects, fixed_values, parse_fixed
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.noise import USUAL_NOISE
from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.calibration.tip_uncertainty import LEAST_WITHIN
from scara_kinetostatic.diagnosis.diagnose import diagnose
from scara_kinetostatic.diagnosis.result import Diagnosis
from scara_kinetostatic.errors import CellError, InputError, ParameterError, UnsupportedDataError
from scara_kinetostatic.files.atomic import check_different, recording_checksum
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.tables import is_touch_table, load_touch_table
from scara_kinetostatic.model.cell import Cell
from scara_kinetostatic.model.touch import Rejection, TouchSet
from scara_kinetostatic.touches.clock import SECOND
from scara_kinetostatic.touches.detection import Detection, cell_of_files, find_touches, order_in_time, touches_of_table

Progress = Callable[[str, float], None]
"""Called with the step that begins and the part of the work that is done, 0 to 1."""


def unreported(step: str, part: float) -> None:
    """Nobody wants to know."""


REASON = 'left out on request'
_WHERE = 'touches left out'
LeftOut = str | range
"""The name of a recording, or touches by their numbers in the result."""


def calibrate_files(
    recordings: Sequence[str | Path],
    cell_file: Path | None,
    fixed: Sequence[str] = (),
    left_out: Sequence[str] = (),
    *,
    options: tuple[str, str, str] = ('--cell', '--fix', '--leave-out'),
    progress: Progress = unreported,
) -> Outcome:
    """Calibrate as a user states it, in texts.

    Args:
        recordings: as for `calibrate_recordings`.
        cell_file: the cell description; None for the one in the recordings.
        fixed: parameters to hold, such as ``l1=0.33``.
        left_out: touches and recordings to leave out, such as ``10-14``.
        options: how the user names cell, fixed parameters and what is left out; messages say it.
        progress: called at each step.

    Raises:
        ScaraKinetostaticError: as `calibrate_recordings`, or a text or file is not valid.
    """
    cell_option, fixed_option, left_out_option = options
    check_different(list(map(Path, recordings)))
    for text in fixed:
        parse_fixed(text, fixed_option)
    entries = parse_left_out(left_out, left_out_option)
    paths = list(map(Path, kept_recordings(recordings, entries)))
    cell = load_cell(cell_file) if cell_file else recorded_cell(paths, cell_option)
    values = fixed_values(fixed, cell.nominal, fixed_option)
    try:
        detection, read_as = detect(paths, cell, entries, progress)
        outcome = calibrate_touches(detection, read_as, fixed=values, sources=paths, progress=progress)
    except CellError as error:
        where = cell_file or f'the cell description in {paths[0]}'
        raise CellError(f'{where}: {error.where}', error.problem, error.remedy) from error
    others = other_descriptions(cell, paths, cell_option) if cell_file else []
    return replace(outcome, warnings=(*outcome.warnings, *others))


def calibrate_recordings(
    paths: Sequence[str | Path],
    cell: Cell,
    *,
    fixed: Mapping[str, float] | None = None,
    left_out: Sequence[LeftOut] = (),
    progress: Progress = unreported,
) -> Outcome:
    """Read recordings and touch tables, find their touches, calibrate, diagnose.

    Args:
        paths: the recordings, and tables of touches (`.csv`).
        cell: the cell.
        fixed: parameters to hold, by name.
        left_out: touches and recordings to leave out.
        progress: called at each step.

    Raises:
        RecordingError: a recording or table cannot be read.
        InputError: tables together with recordings of a sensor in the tool frame; a mistake in the touches.
        CellError: a mistake in the cell description.
        UnsupportedDataError: no touches, too few, or a fit that does not converge.
        ParameterError: `fixed` names no parameter, or `left_out` no touch or recording.
    """
    paths = kept_recordings(paths, left_out)
    detection, cell = detect(paths, cell, left_out, progress)
    return calibrate_touches(detection, cell, fixed=fixed, sources=paths, progress=progress)


def detect(
    paths: Sequence[str | Path], cell: Cell, left_out: Sequence[LeftOut], progress: Progress
) -> tuple[Detection, Cell]:
    """The touches of recordings and tables without those left out, and the cell as these files are to be read."""
    cell = cell_of_files(cell, paths)
    detection = leave_out(gather_touches(paths, cell, progress), left_out)
    if len(detection.held) < FEWEST_TOUCHES:
        _check_units([path for path in paths if not is_touch_table(path)], cell)
    return detection, cell


def gather_touches(paths: Sequence[str | Path], cell: Cell, progress: Progress = unreported) -> Detection:
    """The touches of several recordings and tables, numbered on from one to the next.

    Their order in time is that of the recordings where it is known, else the one given.

    Raises:
        RecordingError: a recording cannot be read.
    """
    parts: list[Detection] = []
    for number, path in enumerate(paths):
        progress(f'reading {path}', number / len(paths))
        if is_touch_table(path):
            part = touches_of_table(load_touch_table(path), cell)
        else:
            streams = read_streams(path, cell)
            part = find_touches(streams, cell)
            part = replace(part, warnings=(*streams.warnings, *part.warnings), turned=(streams.turned,))
        source = f'{path}: ' if len(paths) > 1 else ''
        warnings = (text if text.startswith(str(path)) else source + text for text in part.warnings)
        parts.append(replace(part, warnings=tuple(warnings)))
    found, sequence = np.array([part.found for part in parts]), order_in_time(parts)
    first_touches = (np.cumsum(found) - found).tolist()
    in_time = np.array(first_touches)
    if sequence is not None:
        in_time[sequence] = np.cumsum(found[sequence]) - found[sequence]
    parts = [part.renumbered(range(part.found), first_touches[k], int(in_time[k]), k) for k, part in enumerate(parts)]
    progress(f'{found.sum()} touches found', 1.0)
    return Detection(
        held=TouchSet.concatenate([part.held for part in parts]),
        episodes=tuple(item for part in parts for item in part.episodes),
        warnings=tuple(text for part in parts for text in part.warnings),
        start=parts[0].start,
        starts=tuple(part.start for part in parts),
        first_touches=tuple(first_touches),
        turned=tuple(text for part in parts for text in part.turned or ('',)),
        sequence_known=sequence is not None,
    )


def calibrate_touches(
    touches: Detection | TouchSet,
    cell: Cell,
    *,
    fixed: Mapping[str, float] | None = None,
    sources: Sequence[str | Path] = (),
    progress: Progress = unreported,
) -> Outcome:
    """Calibrate touches, diagnose, predict held-out touches.

    Args:
        touches: as detected in recordings, or as they come from elsewhere.
        cell: the cell.
        fixed: parameters to hold, by name.
        sources: the files that the touches come from; messages name them.
        progress: called at each step.

    Raises:
        InputError: a mistake in the touches.
        CellError: a mistake in the cell description.
        UnsupportedDataError: no touches, too few, or a fit that does not converge.
        ParameterError: `fixed` names no parameter.
        RecordingError: a source can no longer be read.
    """
    detection = Detection.of(touches) if isinstance(touches, TouchSet) else touches
    names = ', '.join(map(str, sources)) or 'these touches'
    if fixed:
        check_units(fixed, cell.nominal)
    check = check_touches(detection.held, cell, fixed=fixed, origin=_origin(sources))
    mistake = check.mistake()
    if mistake is not None and mistake.is_gross:
        raise mistake.error(names)
    recordings = recordings_of(detection, sources)  # as they were read: they may change while the fit runs
    try:
        _check_usable(detection, cell, names)
        progress(f'fitting {len(detection.touches)} touches', 0.0)
        calibration, unsupported = _base_fit(detection, cell, fixed, names)
        progress('diagnosing the model', 0.3)
        diagnosis = diagnose(calibration)
        if unsupported is not None and diagnosis.verdict != 'explained':
            raise unsupported
        calibration = diagnosis.refitted or calibration
        progress('predicting held-out touches', 0.8)
        final = diagnosis.extended or calibration
        _check_converged(final, detection, names)
        held_out = held_out_force_error(calibration.changed(used=final.used))
        extended_held_out = held_out if final is calibration else held_out_force_error(final)
    except ParameterError:
        raise
    except (UnsupportedDataError, InputError) as error:
        if (mistake := mistake or check.displaced()) is None:
            raise
        raise mistake.error(names) from error
    progress('done', 1.0)
    return Outcome(
        calibration=calibration,
        held_out=held_out,
        diagnosis=diagnosis,
        extended_held_out=extended_held_out,
        found=detection.found,
        rejected=all_rejected(detection, calibration, final),
        warnings=(*detection.warnings, *_unknown_sequence(detection, diagnosis)),
        first_touches=detection.first_touches,
        sequence_known=detection.sequence_known,
        check=check,
        discriminate=_discrimination,
        sources=tuple(map(str, sources)),
        recordings=recordings,
    )


def all_rejected(detection: Detection, base: Calibration, final: Calibration) -> tuple[Rejection, ...]:
    """The touches that are not used, by number: rejected by the detection, before the fit of the base model, by the
    final fit.
    """
    before_fit = [item for item in base.rejected if item.index not in base.touches.index]
    rejected = {item.index: item for item in (*detection.rejected, *before_fit, *final.rejected)}
    return tuple(rejected[index] for index in sorted(rejected))


def recordings_of(detection: Detection, sources: Sequence[str | Path]) -> tuple[Recording, ...]:
    """The recordings of touches that were gathered from these, with their checksums; none of other touches.

    Raises:
        RecordingError: one cannot be read.
    """
    found = []
    for path, start, turned in zip(sources, detection.starts, detection.turned, strict=False):
        with reading(path):
            begun = datetime.fromtimestamp(start // SECOND, timezone.utc) if start > 0 else None
            found.append(Recording(str(path), recording_checksum(path), begun, turned))
    return tuple(found)


def _discrimination(evidence: Evidence) -> Discrimination | None:
    from scara_kinetostatic.planning.next_touches import discrimination_of  # most results have nothing to decide

    return discrimination_of(evidence)


def usable_touches(detection: Detection, cell: Cell, sources: Sequence[str | Path]) -> TouchSet:
    """The touches of a detection.

    Raises:
        InputError: a mistake with which they have hardly anything to do with the cell.
        CellError: the limits of the joints exclude all of them, or nearly all.
        UnsupportedDataError: there is none.
    """
    names, mistake = ', '.join(map(str, sources)), check_touches(detection.held, cell, origin=_origin(sources)).found
    if mistake is not None and mistake.is_gross:
        raise mistake.error(names)
    _check_usable(detection, cell, names)
    return detection.touches


def _check_usable(detection: Detection, cell: Cell, names: str) -> None:
    """Check that there are touches, and that the limits of the joints do not exclude all of them, or nearly all.

    Raises:
        CellError: the limits do.
        UnsupportedDataError: there is none; `names` of its files.
    """
    touches = detection.touches
    if not len(touches):
        problem = 'no contact found'
        if detection.found:
            problem = f'none of {detection.found} touches can be used: {detection.rejected[0].reason}'
        kinds = {rejection.kind for rejection in detection.rejected}
        remedy = 'keep some' if kinds == {'request'} else 'see what `inspect` says about the recording'
        if kinds <= {'gap', 'unsteady'}:
            remedy += ', and whether the topics have one clock (`sensor.time_offset`)'
        raise UnsupportedDataError(f'{names}: {problem}', remedy)
    beyond = int((~cell.can_take(touches.joints)).sum())
    if beyond <= (1 - LEAST_WITHIN) * len(touches):
        return
    pairs = zip(cell.joint_names, cell.in_sense(touches.joints).T, strict=True)
    angles = ', '.join(f'{name} from {at.min():.3g} to {at.max():.3g}' for name, at in pairs)
    number = 'all' if beyond == len(touches) else f'{beyond} of'
    problem = f'they exclude {number} {len(touches)} touches, {angles} rad'
    less = ', readings less the coupling' if cell.coupling else ''
    raise CellError('robot.limits', problem, f'correct them: of the joint angles{less}, in rad')


def _origin(sources: Sequence[str | Path]) -> Origin:
    if not sources:
        return Origin.ARRAYS
    return Origin.TABLE if all(map(is_touch_table, sources)) else Origin.RECORDING


def _unknown_sequence(detection: Detection, diagnosis: Diagnosis) -> list[str]:
    """A warning where something shifted and the order in time of the recordings is not known."""
    if detection.sequence_known or not any(item.effect.is_stepwise for item in diagnosis.found):
        return []
    order = "the recordings' order in time is not known, that of the command is taken"
    return [f'{order}: after a shift the result is that of the last']


def _check_units(recordings: Sequence[str | Path], cell: Cell) -> None:
    """Check that recordings in which hardly a touch is found are in rad and N.

    Raises:
        InputError: one is not.
    """
    for path in recordings:
        streams = read_streams(path, cell)
        force = np.linalg.norm(streams.wrench.force - np.median(streams.wrench.force, axis=0), axis=1)
        largest = float(force.max(initial=0.0))
        mistake = wrong_unit(streams.joints.position, largest)
        if mistake is not None and mistake.where == 'force' and largest < 1.0:
            statement = f'{mistake.statement}, or nothing was touched'
            mistake = replace(mistake, statement=statement, action=f'{mistake.action}, or touch the objects')
        if mistake is not None:
            raise mistake.error(str(path))


def _base_fit(
    detection: Detection, cell: Cell, fixed: Mapping[str, float] | None, names: str
) -> tuple[Calibration, UnsupportedDataError | None]:
    """The base model's fit; and the error that it is unless the diagnosis explains it.

    An effect so large that, taken for noise, it hides everything leaves no fit where the noise is to be estimated. Then
    the base model is fitted with the usual noise.
    """
    effects = fixed_effects(fixed or {}, cell)
    try:
        return calibrate(detection.touches, cell, effects, fixed=fixed), None
    except UnsupportedDataError as error:
        unsupported = _with_rejections(error, detection, names)
        if cell.noise is not None:
            raise unsupported from error
    try:
        usual = calibrate(detection.touches, replace(cell, noise=USUAL_NOISE), effects, fixed=fixed)
    except UnsupportedDataError:
        raise unsupported from None
    return replace(usual, cell=replace(usual.cell, noise=None)), unsupported


def _with_rejections(error: UnsupportedDataError, detection: Detection, names: str) -> UnsupportedDataError:
    """The error with the touches that were rejected before, where they are more than the others."""
    problem = f'{names}: {error.problem}'
    if len(detection.rejected) > len(detection.touches):
        first = detection.rejected[0]
        problem += f'; {len(detection.rejected)} of {detection.found} touches found were rejected, the first, '
        problem += f'touch {first.index}: {first.reason}'
    return UnsupportedDataError(problem, error.remedy)


def _check_converged(final: Calibration, detection: Detection, names: str) -> None:
    """Check that the final model is a result.

    Raises:
        UnsupportedDataError: its fit did not converge, or the force error is as large as the forces.
    """
    if not final.is_result:
        error = UnsupportedDataError(
            f'the fit does not converge; its force error is {final.force_error:.3g} N',
            'check the places of the discs, the names and units of the joints, frame, sign and axes of the sensor; '
            'an upright arm needs `gravity`, and touches with several forces',
        )
        raise _with_rejections(error, detection, names)


def parse_left_out(texts: Sequence[str], where: str) -> tuple[LeftOut, ...]:
    """The entries of a list.

    Args:
        texts: one for each entry.
        where: the option or parameter, for messages.

    Raises:
        ParameterError: a range of touches ends before it begins.
    """
    entries = list[LeftOut]()
    for text in (text.strip() for text in texts):
        matches = [re.fullmatch(r'\s*(\d{1,9})(?:-(\d{1,9}))?\s*', part) for part in text.split(',')]
        found = [range(int(match[1]), int(match[2] or match[1]) + 1) for match in matches if match]
        if not all(found):
            raise ParameterError(where, f'{text}: expected a range of touches such as 10-14', 'write the smaller first')
        entries += found if all(matches) else [text]
    return tuple(entries)


def kept_recordings(paths: Sequence[str | Path], entries: Sequence[LeftOut]) -> list[str | Path]:
    """The recordings that are not left out.

    Raises:
        ParameterError: an entry names none of the recordings, or several; none of them is kept; or touches are left
            out, too: their numbers are those with the recording.
    """
    kept = list(paths)
    for name in (entry for entry in entries if isinstance(entry, str)):
        named = [path for path in paths if _names(name, Path(path))]
        if len(named) != 1:
            problem = f'{name!r} is {"the name of several" if named else "none"} of the recordings '
            remedy = 'write a recording with its folder, and touches as 5 or 10-14'
            raise ParameterError(_WHERE, problem + ', '.join(map(str, named or paths)), remedy)
        kept = [path for path in kept if path != named[0]]
    if not kept:
        raise ParameterError(_WHERE, 'every recording is', 'keep one')
    if len(kept) < len(paths) and any(isinstance(entry, range) for entry in entries):
        problem = 'without a recording the touches have other numbers'
        raise ParameterError(_WHERE, problem, 'leave the recording out first, and take them from that result')
    return kept


def _names(name: str, path: Path) -> bool:
    """Whether a name is that of a recording."""
    parts = Path(name).parts
    return parts == path.parts[-len(parts) :] or name == path.stem


def leave_out(detection: Detection, entries: Sequence[LeftOut]) -> Detection:
    """The detection with the touches of the entries among the rejected ones.

    Raises:
        ParameterError: there is no touch of such a number.
    """
    numbers = set[int]()
    for entry in (entry for entry in entries if isinstance(entry, range)):
        if entry[-1] >= detection.found:
            problem = f'there is no touch {entry[-1]} among {detection.found}, which are numbered from 0'
            raise ParameterError(_WHERE, problem, 'take the numbers from the report')
        numbers.update(entry)
    return detection.without(numbers, REASON) if numbers else detection
