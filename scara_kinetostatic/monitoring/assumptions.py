"""What is assumed of touches where effects of a calibration depend on what nobody recorded; one clause each."""

from __future__ import annotations

from scara_kinetostatic.model.arm import Predictor
from scara_kinetostatic.monitoring.record import CalibrationRecord


def of_stored_touches(record: CalibrationRecord) -> tuple[str, ...]:
    """Of the touches in the file of a calibration."""
    rows, predictor, found = record.document['touches']['fitted'], Predictor(record.arm), []
    for key, taken in (('approach', 'no direction of approach'), ('history', 'no load before each touch')):
        if (effects := predictor.effects_of(key)) and not all(key in row for row in rows):
            found.append(f'{", ".join(effects)}: {record.source} has no {key} of its touches; {taken} is assumed')
    return tuple(found)


def of_new_recordings(record: CalibrationRecord) -> tuple[str, ...]:
    """Of touches in recordings that the calibration has not seen."""
    effects = Predictor(record.arm).effects_of('time')
    taken = 'time counts from the start of each recording, as in the calibration'
    return (f'{", ".join(effects)}: {taken}',) if effects else ()
