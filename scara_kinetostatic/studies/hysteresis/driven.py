"""What drives a record: its motion, and the force is predicted, or its load, and the response is predicted.

Driven by its motion is a record of full loops: six sweeps or more between the reversals of the response, of comparable
extent. Driven by its load is one whose load is at rest at first, comes on and goes off again, once or a few times. Full
loops after a rest are those of a load put on again and again where the load keeps to one side of its rest; a motion
back and forth meets it on both.
"""

from __future__ import annotations

import numpy as np

from scara_kinetostatic.errors import ParameterError, UnsupportedDataError
from scara_kinetostatic.model.arrays import Floats
from scara_kinetostatic.studies.hysteresis.load_driven.record import (
    CHECK_LOAD,
    CONSTANT_LOAD,
    FEWEST_SAMPLES,
    is_at_rest_first,
    is_constant,
)
from scara_kinetostatic.studies.hysteresis.motion import FEWEST_ROWS, FEWEST_SWEEPS, reversals
from scara_kinetostatic.studies.hysteresis.record_table import RecordTable

LOAD, MOTION = 'load', 'motion'
DRIVEN = (LOAD, MOTION)

_COMPARABLE = 0.4
"""Median extent of the sweeps of full loops, as a share of the range; 0.5 where the amplitude grows evenly."""
_ONE_SIDE = 0.25
"""Share of its largest up to which a load on one side of its rest reaches to the other side."""
_RANGE = (2, 98)
"""Percentiles that stand for the range of the load: impacts are left out."""


def what_drives(tables: list[RecordTable], driven: str | None = None) -> str:
    """What drives the records.

    Args:
        tables: the records of one call.
        driven: `LOAD` or `MOTION` if it is known; None to see it in the records.

    Returns:
        `LOAD` or `MOTION`.

    Raises:
        ParameterError: the records are of both kinds.
        UnsupportedDataError: a load is constant.
    """
    if driven is not None:
        return driven
    kinds = [_drives(table) for table in tables]
    for table, kind in zip(tables[1:], kinds[1:], strict=True):
        if kind != kinds[0]:
            problem = f'driven by its {kind}, but {tables[0].source} by its {kinds[0]}'
            raise ParameterError(table.source, problem, 'give records of one kind, or say which by --driven')
    return kinds[0]


def _drives(table: RecordTable) -> str:
    at_rest_first = is_at_rest_first(table.load)
    if _has_full_loops(table.response):
        return LOAD if at_rest_first and _keeps_to_one_side(table.load) else MOTION
    if len(table.load) >= FEWEST_SAMPLES and is_constant(table.load):
        raise UnsupportedDataError(f'{table.source}: {CONSTANT_LOAD}', CHECK_LOAD)
    return LOAD if at_rest_first else MOTION


def _has_full_loops(response: Floats) -> bool:
    edges = np.array([0, *reversals(response).tolist(), len(response) - 1])
    sweeps = len(edges) - 1
    if sweeps < FEWEST_SWEEPS or len(response) < FEWEST_ROWS * sweeps:
        return False
    return bool(np.median(np.abs(np.diff(response[edges]))) >= _COMPARABLE * np.ptp(response))


def _keeps_to_one_side(load: Floats) -> bool:
    lowest, highest = np.percentile(load - load[0], _RANGE)
    return bool(min(-lowest, highest) < _ONE_SIDE * max(-lowest, highest))
