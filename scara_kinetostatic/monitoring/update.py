"""A calibration brought up to date by a few touches: the earlier result, with its whole covariance, is the prior.

The values of the model and the errors of the cell have the joint covariance of the earlier calibration, as `verify` has
it (`change`). What is freed, such as a tool that was changed, is known as the data sheet knows it instead: nominal value,
and its declared standard uncertainty or plausible range, independent of all others. The touches are then fitted as any
others, with these rows beside theirs.

Touches that contradict the prior are not averaged with it unsaid: at the fit, touches and prior together leave a
chi-square of two degrees of freedom per touch, and what may have changed besides is ranked as for two calibrations.

What undetected effects of objects and sensor have done to the earlier values they do to the new touches alike, so that
it is no part of the prior, and stays in the covariance of the result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from scara_kinetostatic.assessment.evidence import Earlier
from scara_kinetostatic.assessment.outcome import Outcome
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
from scara_kinetostatic.errors import InputError, ParameterError, did_you_mean
from scara_kinetostatic.files.atomic import recording_checksum
from scara_kinetostatic.gaussian.information import Gaussian
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.model.cell import Cell, Noise
from scara_kinetostatic.model.extended_model import ExtendedModel
from scara_kinetostatic.model.touch import LATER
from scara_kinetostatic.monitoring.change import CalibratedState
from scara_kinetostatic.monitoring.record import CalibrationRecord
from scara_kinetostatic.monitoring.verification import LEVEL, Verification, verify
from scara_kinetostatic.pipeline import recordings_of
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
    """
    own = [name for name in record.arm.model.names if not name.startswith(UNDETECTED)]
    named = set(chain.from_iterable(GROUPS.get(text, (text,)) for text in texts))
    for name in sorted(named - set(own)):
        remedy = did_you_mean(name, (*GROUPS, *own))
        raise ParameterError(f'{where} {name}', 'expected tool, zeros, base or the name of a parameter', remedy)
    return tuple(name for name in own if name in named)


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
) -> Outcome:
    """Bring a calibration up to date by touches.

    Args:
        detection: the touches, of `cell`.
        record: the earlier calibration.
        cell: in which the touches were made; the nominal values of what is freed are those of the new part.
        freed: names of values of the model that may have changed.
        sources: the files that the touches come from.

    Raises:
        InputError: the cell has another robot, or touches were part of the earlier calibration.
        UnsupportedDataError: too few touches, or the fit diverges.
    """
    record = record.in_cell(cell)
    state = prior_state(record, cell, freed)
    c = _fit(detection, record, cell, state, freed)
    checked = _checked(detection, record, state, c)
    if checked.repeated:
        problem = f'{checked.repeated} of {checked.touches} touches were part of the earlier calibration'
        raise InputError(record.source, problem, 'give touches made since')
    held_out = held_out_force_error(c)
    before_fit = [item for item in c.rejected if item.index not in c.touches.index]
    rejected = {item.index: item for item in (*detection.rejected, *before_fit, *c.rejected)}
    return Outcome(
        calibration=c,
        held_out=held_out,
        diagnosis=_diagnosis(record, c, checked.p_value),
        extended_held_out=held_out,
        found=detection.found,
        rejected=tuple(rejected[index] for index in sorted(rejected)),
        warnings=detection.warnings,
        first_touches=detection.first_touches,
        sequence_known=detection.sequence_known,
        sources=tuple(map(str, sources)),
        recordings=recordings_of(detection, sources),
        earlier=_earlier(record, freed, checked),
    )


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
    (q1, q2), (fx, fy), by_force = (
        np.sqrt(factor) * np.array(part) for part in (noise.joint_levels, noise.force_levels, noise.growth)
    )
    grows = None if noise.force_relative is None else float(by_force)
    return noise._replace(joint=(q1, q2), force=(fx, fy), force_relative=grows)


def _stays(record: CalibrationRecord) -> list[Contribution]:
    """What the earlier covariance has besides the prior: undetected effects of objects and sensor, by name, what is
    assumed of undeclared places, and a large effect that the touches did not exclude.
    """
    values, undetected = len(record.arm.model.names), record.undetected
    parts, rest = dict[str, Floats](), record.arm.covariance - record.covariance[:values, :values]
    moved = undetected.of_all(len(record.names))[:values]
    for text, of_robot, column in zip(undetected.columns, undetected.of_robot, moved.T, strict=True):
        if not of_robot:
            label = f'{UNDETECTED}[{text.partition("[")[0].partition(".")[0]}]'
            part = np.outer(column, column)
            parts[label] = parts.get(label, 0.0) + part
            rest = rest - part
    label = ASSUMED_PLACES if record.arm.cell.undeclared_places else LARGE_EFFECT
    return [Contribution(name, None, '', part) for name, part in (*parts.items(), (label, rest))]


def _checked(detection: Detection, record: CalibrationRecord, state: CalibratedState, c: Calibration) -> Verification:
    """The touches, all of them, held against the prior, linearised at the fit."""
    declared = DeclaredErrors.of(c.cell)
    moved = np.zeros(len(state.names))
    moved[: len(c.model.names)] = c.model.as_array() - record.arm.model.as_array()
    if declared is not None:
        at = [len(c.model.names) + state.names[len(c.model.names) :].index(name) for name in declared.names]
        moved[at] = declared.units * c.errors - state.errors[np.array(at) - len(c.model.names)]
    known = Gaussian(state.known.mean - moved / state.scale, state.known.covariance)
    errors = state.errors + moved[len(c.model.names) :]
    fitted = replace(record, arm=replace(record.arm, model=c.model, cell=c.cell))
    return verify(detection, fitted, c.cell, state=state._replace(known=known, errors=errors))


def _diagnosis(record: CalibrationRecord, c: Calibration, p_value: float) -> Diagnosis:
    """The verdict of the earlier calibration, with its effects at their values now."""
    found = list[Found]()
    for effect in record.arm.effects:
        rows = zip(effect.parameters, c.effects[effect.label].values(), strict=True)
        values = tuple(Value(p.name, e.value, e.std, e.unit, p.meaning) for p, e in rows)
        found.append(Found(effect, values, in_every_model=True))
    return Diagnosis(record.arm.verdict, p_value, tuple(found))


def _earlier(record: CalibrationRecord, freed: Sequence[str], checked: Verification) -> Earlier:
    """Which calibration was brought up to date, and whether the touches contradict it."""
    reason, action = '', ''
    if checked.others.p_value < LEVEL:
        reason = f'the touches contradict the earlier calibration: {checked.causes.title(LEVEL)}'
        action = 'find out what changed, and free it by --free, or calibrate again from nothing'
    sha256 = recording_checksum(record.source)
    return Earlier(record.source, sha256, tuple(freed), checked.p_value, reason, action)
