"""A calibration brought up to date by a few touches: the earlier result, with its whole covariance, is the prior.

The values of the model and the errors of the cell have the joint covariance of the earlier calibration, as `verify` has
it (`change`). What is freed, such as a tool that was changed, is known as the data sheet knows it instead: its nominal
value, with the declared standard uncertainty or the plausible range, independent of all others. The touches are then
fitted as any others, with these rows beside theirs.

Touches that contradict the prior are not averaged with it unsaid: at the fit, touches and prior together leave a
chi-square of two degrees of freedom per touch, and what may have changed besides is ranked as for two calibrations. A
single change is tested by itself, too: one direction hides among the degrees of freedom of many touches.

What undetected effects of objects and sensor have done to the earlier values they do to the new touches alike, so that
it is no part of the prior, and stays in the covariance of the result.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from scara_kinetostatic.assessment.evidence import Earlier, likely
from scara_kinetostatic.assessment.grade import SLIP_SHOWN, Limits
from scara_kinetostatic.assessment.outcome import Outcome, Recording
from scara_kinetostatic.bags.reader import other_descriptions
from scara_kinetostatic.calibration.calibrate import calibrate
from scara_kinetostatic.calibration.estimate import WarmStart
from scara_kinetostatic.calibration.held_out import held_out_force_error
from scara_kinetostatic.calibration.identifiability import scales_of
from scara_kinetostatic.calibration.observations import (
    ASSUMED_PLACES,
    LARGE_EFFECT,
    UNDETECTED,
    DeclaredErrors,
    JointPrior,
)
from scara_kinetostatic.calibration.result import Calibration, Contribution
from scara_kinetostatic.diagnosis.result import Diagnosis, Found, Value
from scara_kinetostatic.effects.base import Effect
from scara_kinetostatic.errors import InputError, ParameterError, UnsupportedDataError, did_you_mean
from scara_kinetostatic.files.atomic import check_different, recording_checksum
from scara_kinetostatic.files.cell_file import load_cell
from scara_kinetostatic.files.tables import is_touch_table
from scara_kinetostatic.gaussian.information import Gaussian
from scara_kinetostatic.gaussian.p_values import p_values
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.parameters import NAMES
from scara_kinetostatic.model.touch import LATER
from scara_kinetostatic.monitoring.change import CalibratedState, Causes, PredictionTest, hypotheses_of, measure, ranked
from scara_kinetostatic.monitoring.record import CalibrationRecord, check_same_arm, check_same_recorded
from scara_kinetostatic.monitoring.report import causes_document
from scara_kinetostatic.monitoring.verification import LEVEL, count_repeated
from scara_kinetostatic.pipeline import Progress, all_rejected, detect, parse_left_out, recordings_of, unreported
from scara_kinetostatic.touches.detection import Detection

GROUPS: Mapping[str, tuple[str, ...]] = {
    'tool': ('theta2', 'l2', 'p_ee', 'g_ee'),
    'zeros': ('theta1', 'theta2'),
    'base': ('x0', 'y0', 'theta1'),
}
"""What is freed by a word."""


def freed_names(texts: Sequence[str], record: CalibrationRecord, where: str = '--free') -> tuple[str, ...]:
    """The values of the model that are freed, in their order.

    Raises:
        ParameterError: one is none of the calibration.
        UnsupportedDataError: the arm stands upright.
    """
    if texts and record.arm.cell.nominal.has_gravity:
        problem = 'under gravity a few touches do not tell on which flank of its backlash a freed joint rests'
        raise UnsupportedDataError(f'{where}: {problem}', 'calibrate from nothing')
    own = [name for name in record.arm.model.names if not name.startswith(UNDETECTED)]
    of_effects = {label: [name for name in own if name.startswith(f'{label}.')] for label in record.arm.model.values}
    named = set(chain.from_iterable(GROUPS.get(text) or of_effects.get(text) or (text,) for text in texts))
    for name in sorted(named - set(own)):
        remedy = did_you_mean(name, (*GROUPS, *own))
        raise ParameterError(f'{where} {name}', 'expected tool, zeros, base or the name of a parameter', remedy)
    return tuple(name for name in own if name in named)


def same_arm(record: CalibrationRecord, cell: Cell, freed: Sequence[str], first: str, second: str) -> None:
    """Check that a cell has the robot of a calibration, but for what is freed; `first` and `second` are their files.

    Raises:
        InputError: it has not.
    """
    before = record.arm.cell.nominal.as_dict()
    same = cell.nominal.replace(**{name: before[name] for name in freed if name in before})
    check_same_arm(record.arm.cell, replace(cell, nominal=same), first, second)


def prior_state(record: CalibrationRecord, cell: Cell, freed: Sequence[str]) -> CalibratedState:
    """What is known of the state before the touches, at the values of the calibration: of what is freed, as the data
    sheet has it.

    Args:
        record: the calibration, in the numbers of `cell`.
        cell: in which the touches are made.
        freed: names of values of the model.
    """
    state, model, plausible = CalibratedState.of(record, cell), record.arm.model, scales_of(record.arm.model)
    (mean, covariance), nominal = (np.array(part) for part in state.known), cell.nominal.as_dict()
    for name in freed:
        place = model.names.index(name)
        covariance[place], covariance[:, place] = 0.0, 0.0
        std = cell.uncertainty.nominal.get(name, plausible[place])
        covariance[place, place] = (std / state.scale[place]) ** 2
        mean[place] = (nominal.get(name, 0.0) - record.values[place]) / state.scale[place]
    return state._replace(known=Gaussian(mean, covariance))


def update(
    detection: Detection,
    record: CalibrationRecord,
    cell: Cell,
    freed: Sequence[str] = (),
    sources: Sequence[str | Path] = (),
    differing: Sequence[str] = (),
) -> Outcome:
    """Bring a calibration up to date by touches.

    Args:
        detection: the touches, of `cell`.
        record: the earlier calibration.
        cell: in which the touches were made; the nominal values of what is freed are those of the new part.
        freed: names of values of the model that may have changed.
        sources: the files that the touches come from.
        differing: which of these contain another cell description, one sentence each.

    Raises:
        InputError: the cell has another robot, or the touches were part of the earlier calibration.
        UnsupportedDataError: too few touches, or none of them near any fit.
    """
    same_arm(record, cell, freed, record.source, 'the cell description')
    recordings = recordings_of(detection, sources)
    if seen := _seen(detection, record, recordings):
        raise InputError(record.source, f'{seen}: part of the earlier calibration', 'give touches made since')
    record = record.in_cell(cell)
    state = prior_state(record, cell, freed)
    c = _fit(detection, record, cell, state, freed)
    checked = _checked(record, state, c, freed)
    if not c.is_near:
        problem = f'the touches do not fit with the earlier calibration: {_what_changed(checked.causes)}'
        raise UnsupportedDataError(problem, 'free what changed by --free, or calibrate from nothing')
    held_out = held_out_force_error(c)
    return Outcome(
        calibration=c,
        held_out=held_out,
        diagnosis=_diagnosis(record, c, checked.p_value),
        extended_held_out=held_out,
        found=detection.found,
        rejected=all_rejected(detection, c, c),
        warnings=detection.warnings,
        first_touches=detection.first_touches,
        sequence_known=detection.sequence_known,
        sources=tuple(map(str, sources)),
        recordings=recordings,
        earlier=_earlier(record, freed, checked, differing),
    )


def _seen(detection: Detection, record: CalibrationRecord, recordings: Sequence[Recording]) -> str:
    """Which recordings, or how many touches, the earlier calibration is made of, or one before it; empty for none."""
    paths = [item.path for item in recordings if item.sha256 in record.checksums]
    repeated = count_repeated(detection.touches, record)
    return ', '.join(paths) or (f'{repeated} touches' if 2 * repeated > len(detection.touches) else '')


def _fit(
    detection: Detection, record: CalibrationRecord, cell: Cell, state: CalibratedState, freed: Sequence[str]
) -> Calibration:
    """The fit to touches and prior, with what the earlier covariance has besides."""
    model, (mean, covariance) = record.arm.model, state.known
    declared, values = DeclaredErrors.of(cell), len(record.arm.model.names)
    errors = [values + state.names[values:].index(name) for name in declared.names] if declared else []
    places = [*range(values), *errors]
    unit = np.concatenate([np.ones(values), declared.units if declared else []])
    at = np.concatenate([model.as_array(), state.errors])
    si = state.scale[places] / unit
    known = JointPrior.of(
        at[places] / unit + si * mean[places], covariance[np.ix_(places, places)] * np.outer(si, si), si, len(errors)
    )
    free = np.diag(covariance)[:values] > 0
    fixed = {
        name: value
        for name, value, moves in zip(model.names, model.as_array().tolist(), free, strict=True)
        if not moves
    }
    begin = model.with_array(known.mean[:values])
    touches = detection.touches.replace(order=np.full(len(detection.touches), LATER))
    noise = _enlarged(record.arm.noise, record.enlargement)
    near = WarmStart(begin, noise, np.ones(len(touches), dtype=bool), known.mean[values:])
    start = ExtendedModel(cell.nominal, model.effects, model.effect_values)
    cell = replace(cell, noise=noise)
    c = calibrate(touches, cell, model.effects, start=start, fixed=fixed, warm_start=near, known=known)
    return c.changed(added=tuple(_stays(record)))


def _enlarged(noise: Noise, factor: float) -> Noise:
    """Noise of so many times the variance."""
    if factor == 1:
        return noise
    q1, q2, fx, fy = (np.sqrt(factor) * np.array([*noise.joint_levels, *noise.force_levels])).tolist()
    grows = None if noise.force_relative is None else float(np.sqrt(factor)) * noise.force_relative
    return Noise((q1, q2), (fx, fy), grows)


def _stays(record: CalibrationRecord) -> list[Contribution]:
    """What the earlier covariance has besides the prior: undetected effects of objects and sensor, by name, what is
    assumed of undeclared places, and a large effect that the touches did not exclude.
    """
    values, undetected = len(record.arm.model.names), record.undetected
    parts, rest = dict[str, Floats](), record.arm.covariance - record.covariance[:values, :values]
    moved = undetected.of_all(len(record.names))[:values]
    for text, of_robot, column in zip(undetected.columns, undetected.of_robot, moved.T, strict=True):
        if not of_robot:
            name, *_ = re.split(r'[\[|]', text)
            label = f'{UNDETECTED}[{name}]'
            part = np.outer(column, column)
            parts[label] = parts.get(label, 0.0) + part
            rest = rest - part
    label = ASSUMED_PLACES if record.arm.cell.undeclared_places else LARGE_EFFECT
    return [Contribution(name, None, '', part) for name, part in (*parts.items(), (label, rest))]


class _Checked(NamedTuple):
    """The touches held against the prior.

    Attributes:
        p_value: of all touches but the few that the fit rejects, or of a single change if that is less.
        causes: what may have changed; empty where nothing contradicts.
        detectable: as that of `Earlier`.
    """

    p_value: float
    causes: Causes
    detectable: dict[str, float]


def _checked(record: CalibrationRecord, state: CalibratedState, c: Calibration, freed: Sequence[str]) -> _Checked:
    """The touches of a fit held against the prior, linearised there."""
    declared, values = DeclaredErrors.of(c.cell), len(c.model.names)
    moved = np.zeros(len(state.names))
    moved[:values] = c.model.as_array() - record.arm.model.as_array()
    if declared is not None:
        at = np.array([state.names[values:].index(name) for name in declared.names])
        moved[values + at] = declared.units * c.errors - state.errors[at]
    known = Gaussian(state.known.mean - moved / state.scale, state.known.covariance)
    state = state._replace(known=known, errors=state.errors + moved[values:], model=c.model.as_array())
    fitted = replace(record, arm=replace(record.arm, model=c.model, cell=c.cell))
    few = (~c.used).sum() <= max(1, Limits.most_rejected * len(c.used))  # more are no outliers
    touches, noise = c.touches.select(c.used) if few else c.touches, record.noise_freedoms
    measured = measure(touches, fitted, state)
    test, evidence = PredictionTest.of(measured, known, noise), known.change(measured.information())
    ranking = ranked(hypotheses_of(state, np.unique(touches.disc).tolist()), evidence, state)
    # one change in a direction of its own shows where all touches together are still as likely as others
    single = min(float(p_values(item.statistic, len(item.places), noise)) for item in ranking) * len(ranking)
    p_value = min(test.p_value, single)
    causes = Causes.of(ranking, (test.chi_square, test.freedoms, noise))
    detectable = {}
    for name in ('theta1', 'theta2'):
        place = NAMES.index(name)
        if name not in freed:
            std = float(evidence.ratio([place]).std[0] * state.scale[place])
            detectable[name] = SLIP_SHOWN * std if np.isfinite(std) else np.inf
    return _Checked(p_value, causes if p_value < LEVEL or not c.is_near else Causes(), detectable)


def _diagnosis(record: CalibrationRecord, c: Calibration, p_value: float) -> Diagnosis:
    """The verdict of the earlier calibration, with its effects at their values now."""
    found = list[Found]()
    for effect in record.arm.effects:
        rows = zip(effect.parameters, c.effects[effect.label].values(), strict=True)
        values = tuple(Value(p.name, e.value, e.std, e.unit, p.meaning) for p, e in rows)
        found.append(Found(cast('Effect', effect), values, in_every_model=True))
    return Diagnosis(record.arm.verdict, p_value, tuple(found))


def _what_changed(causes: Causes) -> str:
    """The likeliest change in words, and where others are about as likely, which."""
    others = f'; odds: {likely(causes.odds)}' if causes.rivals and not causes.is_open(LEVEL) else ''
    return causes.title(LEVEL) + others


def _earlier(record: CalibrationRecord, freed: Sequence[str], checked: _Checked, differing: Sequence[str]) -> Earlier:
    """Which calibration was brought up to date, and whether the touches contradict it."""
    is_file = Path(record.source).is_file()
    return Earlier(
        path=record.source,
        sha256=recording_checksum(record.source) if is_file else '',
        freed=tuple(freed),
        p_value=checked.p_value,
        grade=record.arm.grade,
        used=record.arm.used,
        detectable=checked.detectable,
        contradiction=_what_changed(checked.causes) if checked.causes.ranking else '',
        causes=causes_document(checked.causes),
        recordings=tuple(sorted(record.checksums)),
        undetected=record.undetected.of_cell(),
        differing=tuple(differing),
    )


def update_files(
    paths: Sequence[Path],
    earlier: Path,
    freed: Sequence[str] = (),
    cell_file: Path | None = None,
    left_out: Sequence[str] = (),
    progress: Progress = unreported,
) -> Outcome:
    """Bring a calibration up to date as a user states it, in texts.

    Args:
        paths: recordings and touch tables of the new touches.
        earlier: the `calibration.json`.
        freed: what may have changed: ``tool``, ``zeros``, ``base``, or names.
        cell_file: the cell description; None for that of the calibration.
        left_out: touches and recordings to leave out, such as ``10-14``.
        progress: called at each step.

    Raises:
        InputError: a file is wrong, or of another robot; the earlier calibration is unfit.
        ParameterError: `freed` or `left_out` names nothing.
        UnsupportedDataError: too few touches.
    """
    check_different(list(paths))
    record = CalibrationRecord.load(earlier)
    if record.arm.grade == 'unfit':
        raise InputError(earlier, 'is unfit for use: its values are no prior', 'calibrate from nothing')
    cell, names = load_cell(cell_file) if cell_file else record.arm.cell, freed_names(freed, record)
    recordings, differing = [path for path in paths if not is_touch_table(path)], list[str]()
    if not cell_file:
        for path in recordings:
            check_same_recorded(cell, path, str(earlier))
        differing = other_descriptions(cell, recordings, 'the calibration', ('noise', 'tolerance'))
    detection, cell = detect(paths, cell, parse_left_out(left_out, '--leave-out'), progress)
    progress(f'fitting {len(detection.touches)} touches', 0.3)
    return update(detection, record, cell, names, paths, differing)
