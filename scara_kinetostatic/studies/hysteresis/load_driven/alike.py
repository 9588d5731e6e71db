"""Checks that records driven by their load go together: units, and the sense in which the response follows the load."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from scara_kinetostatic.errors import RecordingError, UnsupportedDataError
from scara_kinetostatic.studies.hysteresis.load_driven.load_path import LoadPath
from scara_kinetostatic.studies.hysteresis.load_driven.record import LoadRecord

_OPPOSITE = 0.9
"""Correlation of response and load from which on a record has a sense of its own; opposite ones do not go together."""


def check_units(records: Sequence[LoadRecord]) -> None:
    """Checks that records go together.

    Raises:
        UnsupportedDataError: the units differ.
    """
    for record in records[1:]:
        if record.load_unit != records[0].load_unit:
            pairs = [f'{each.name} is in {each.response_unit} and {each.load_unit}' for each in (records[0], record)]
            raise UnsupportedDataError(', '.join(pairs), 'give records of one joint')


def check_sense(records: Sequence[LoadRecord], direction: float | None = None) -> None:
    """Checks that, until the unloading, the response follows the load in one sense.

    Args:
        records: with the same units.
        direction: +1 or -1, the sense that is right; None for that of most of the records.

    Raises:
        RecordingError: a record follows in the opposite sense.
    """
    follows = [_correlation(LoadPath.in_blocks(record)) for record in records]
    along, against = ([sense * each > _OPPOSITE for each in follows] for sense in (1.0, -1.0))
    if direction is None:
        direction = 1.0 if sum(along) >= sum(against) else -1.0
        if not (any(along) and any(against)):
            return
    opposite = against if direction > 0 else along
    if any(opposite):
        problem = 'its response follows the load in the opposite sense of the other records'
        raise RecordingError(
            records[opposite.index(True)].source, problem, 'give records of one joint, or reverse a sign'
        )


def _correlation(path: LoadPath) -> float:
    """Of the response with the load until the unloading; 0 where the response is constant."""
    load, response = path.load[path.known], path.response[path.known]
    return float(np.corrcoef(load, response)[0, 1]) if np.ptp(response) > 0 and np.ptp(load) > 0 else 0.0
