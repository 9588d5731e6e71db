"""What is assumed of touches where effects of a calibration depend on what nobody recorded; one clause each."""

from __future__ import annotations

from scara_kinetostatic.compensation.predictions import Predictor
from scara_kinetostatic.monitoring.record import CalibrationRecord


def of_stored_touches(record: CalibrationRecord) -> tuple[str, ...]:
    """Of the touches in the file of a calibration."""
    rows, predictor, found = record.document['touches']['fitted'], Predictor(record.arm), []
    for key, taken in (('approach', 'no direction of approach'), ('history', 'no load before each touch')):
        if (effects := predictor.effects_of(key)) and not all(key in row for row in rows):
            found.append(f'{", ".join(effects)}: {record.source} has no {key} of its touches; {taken} is assumed')
    return tuple(found)


def of_new_touches(record: CalibrationRecord, *, with_time: bool, with_history: bool) -> tuple[str, ...]:
    """Of touches that the calibration has not seen.

    Args:
        record: the calibration.
        with_time: whether their time counts from the start of their recording; else the end of the calibration counts.
        with_history: whether the load before each is known.
    """
    predictor, found = Predictor(record.arm), []
    if effects := predictor.effects_of('time'):
        taken = 'from the start of the recording, as in the calibration' if with_time else 'as at its end'
        found.append(f'{", ".join(effects)}: {taken}')
    if not with_history and (effects := predictor.effects_of('history')):
        found.append(f'{", ".join(effects)}: no load before')
    return tuple(found)
