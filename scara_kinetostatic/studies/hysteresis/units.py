"""Words and units of a record driven by its motion: a force over a displacement, or a torque over an angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from scara_kinetostatic.report.quantities import Scale


class Units(NamedTuple):
    """What is shown of a record; `LINEAR` is what tables, figures and documents are written for.

    Attributes:
        load: 'force' or 'torque'.
        response: 'displacement' or 'angle'.
        others: units, and factors to them, that take the place of those of `LINEAR`.
        si: SI units that do so.
    """

    load: str
    response: str
    others: Mapping[str, Scale]
    si: Mapping[str, str]

    def unit(self, linear: str) -> str:
        """The displayed unit in place of one of `LINEAR`."""
        return self.others[linear].unit if linear in self.others else linear

    def factor(self, linear: str, per_si: float) -> float:
        """Displayed units per SI unit, in place of that of `LINEAR`."""
        return per_si * self.others[linear].per_si if linear in self.others else per_si

    def si_unit(self, linear: str) -> str:
        """The SI unit in place of one of `LINEAR`."""
        return self.si.get(linear, linear)


LINEAR = Units('force', 'displacement', {}, {})
ROTARY = Units(
    'torque',
    'angle',
    {
        'N': Scale('Nm', 1.0),
        'kN': Scale('Nm', 1e3),
        'mm': Scale('mrad', 1.0),
        'nm/N': Scale('µrad/Nm', 1e-3),
        'Ns/mm': Scale('Nm·s/mrad', 1.0),
        'N/mm': Scale('Nm/mrad', 1.0),
    },
    {'N': 'Nm', 'm': 'rad', 'm/N': 'rad/Nm', 'Ns/m': 'Nm·s/rad', 'N s/m': 'Nm·s/rad', 'N/m': 'Nm/rad'},
)
BY_LOAD = {'N': LINEAR, 'Nm': ROTARY}
"""By the SI unit of the load."""
