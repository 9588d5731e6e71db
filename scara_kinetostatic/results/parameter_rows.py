"""The twelve parameters of a calibration, ready to print: digits that fit the uncertainty, status, rank."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from scara_kinetostatic.calibration.result import Calibration
from scara_kinetostatic.model.parameters import DESCRIPTIONS, NAMES
from scara_kinetostatic.report.quantities import SCALES, Scale, decimals, unsigned_zero

STATUS = {'estimated': '', 'fixed': 'fixed', 'confounded': 'not determined by these data'}
"""Notes on the status of a parameter."""


class Row(NamedTuple):
    """One parameter, ready to print.

    Attributes:
        name: as everywhere.
        nominal: where the calibration started.
        value: the estimate, with the digits its uncertainty allows; in brackets where the data do not determine it.
        std: one standard deviation, two digits; empty where there is none.
        unit: of all three.
        status: ``estimated``, ``fixed`` or ``confounded``.
        description: what it is.
    """

    name: str
    nominal: str
    value: str
    std: str
    unit: str
    status: str
    description: str


def parameter_rows(c: Calibration, scales: Mapping[str, Scale] = SCALES) -> list[Row]:
    """The twelve parameters in their order, in units by name."""
    nominal, values = c.cell.nominal.as_dict(), c.parameters.as_dict()
    return [_row(name, nominal[name], values[name], c.std_of(name), c.status[name], scales[name]) for name in NAMES]


def _row(name: str, nominal: float, value: float, std: float, status: str, scale: Scale) -> Row:
    unit, per_si = scale
    digits = decimals(std * per_si)
    undetermined = f'({_short(value * per_si)})' if status == 'confounded' else f'{value * per_si:.6g}'
    return Row(
        name=name,
        nominal=unsigned_zero(f'{nominal * per_si:.6g}'),
        value=unsigned_zero(f'{value * per_si:.{digits}f}' if digits is not None else undetermined),
        std=f'{std * per_si:.{digits}f}' if digits is not None else '',
        unit=unit,
        status=status,
        description=DESCRIPTIONS[name],
    )


def _short(value: float) -> str:
    """Three digits, without a power of ten where the number is of a usual size."""
    return f'{value:.0f}' if 100 <= abs(value) < 1e6 else f'{value:.3g}'


def base_rank(c: Calibration) -> int:
    """How many of the twelve parameters, or of their combinations, the data determine.

    Each confounded group is one unidentifiable direction; groups of effects' parameters alone do not count.
    """
    free = sum(status != 'fixed' for status in c.status.values())
    return free - sum(bool(set(group) & set(NAMES)) for group in c.identifiability.confounded)
