"""Quantities of records driven by their load, as shown: units, errors of a record, what stays after the load."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.model.arrays import Floats, Mask, rms
from scara_kinetostatic.report.quantities import Scale
from scara_kinetostatic.studies.hysteresis.load_driven.analysis import LoadAnalysis, earlier_half
from scara_kinetostatic.studies.hysteresis.load_driven.fit import Prediction
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord

_PREFIXES = (('m', 1e3), ('µ', 1e6), ('n', 1e9))
_LEAST = 0.01
"""The smallest quantity shown in a unit; for a smaller one the next prefix is taken."""


class RecordErrors(NamedTuple):
    """Rms errors of the response of one record, held out, m or rad; `after` is NaN where no law is selected."""

    before: float
    after: float


def error_scale(analysis: LoadAnalysis) -> Scale:
    """The unit in which errors of the response are shown."""
    return _scale(analysis.before.held_out_rms, analysis.records[0].response_unit)


def response_scale(analysis: LoadAnalysis) -> Scale:
    """The unit in which responses are shown."""
    return _scale(max(abs(deflection(record)) for record in analysis.records), analysis.records[0].response_unit)


def _scale(size: float, unit: str) -> Scale:
    prefix, per_si = next(((p, f) for p, f in _PREFIXES if size * f >= _LEAST), _PREFIXES[-1])
    return Scale(prefix + unit, per_si)


def explained_share(analysis: LoadAnalysis) -> float:
    """Share of the square of the response, less its mean in each record, that law (6) explains."""
    total = sum(float(np.var(path.response) * len(path.time)) for path in map(LoadPath.in_blocks, analysis.records))
    return 1.0 - analysis.before.whole.square / total if total > 0 else 0.0


def judged(analysis: LoadAnalysis, record: LoadRecord) -> Mask:
    """The samples for the errors, (n,): after unloading, or the later half of a single record."""
    if len(analysis.records) == 1:
        return ~earlier_half(LoadPath(record))
    return np.arange(len(record)) >= record.unloaded


def record_errors(analysis: LoadAnalysis, number: int) -> RecordErrors:
    """Errors of a record predicted from the others, or of the later half of a single one from the earlier."""
    rows = judged(analysis, analysis.records[number])
    before = rms(analysis.before.held_out[number].residual[rows])
    if analysis.selected is None:
        return RecordErrors(before, float('nan'))
    return RecordErrors(before, rms(analysis.selected.held_out[number].residual[rows]))


def response_change(record: LoadRecord) -> Floats:
    """Response less its mean at rest, (n,), m or rad."""
    return np.asarray(record.response - record.response[record.rest].mean())


def remaining(record: LoadRecord) -> float:
    """Response that stays after the load has gone: mean of the last half of what follows, m or rad."""
    after = (record.unloaded + len(record)) // 2
    return float(response_change(record)[after:].mean())


def largest_load(record: LoadRecord) -> float:
    """Largest load, averaged as friction sees it, with its sign, N or Nm."""
    smooth = LoadPath(record).smooth
    return float(smooth[int(np.abs(smooth).argmax())])


def deflection(record: LoadRecord) -> float:
    """Largest mean response to the load, with its sign, m or rad."""
    change = LoadPath.in_blocks(record).response - record.response[record.rest].mean()
    return float(change[int(np.abs(change).argmax())])


def predicted_response(record: LoadRecord, prediction: Prediction) -> Floats:
    """Response by a law, counted from rest, (n,), m or rad."""
    return np.asarray(response_change(record) - prediction.residual)
