"""What gauge experiments give: runs, parts of the robot, all of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from scara_kinetostatic.errors import ParameterError
from scara_kinetostatic.studies.dial_gauge.checks import Check
from scara_kinetostatic.studies.dial_gauge.directions import DirectionMap
from scara_kinetostatic.studies.dial_gauge.line_fit import Estimate
from scara_kinetostatic.studies.dial_gauge.lines import RunFit
from scara_kinetostatic.studies.dial_gauge.readings import GRIPPER, DialGaugeReadings


class Run(NamedTuple):
    """One run and what it says of its part.

    Attributes:
        part: one of `PARTS`.
        seat: where the gauge was.
        source: name of its file.
        direction: rad, NaN if none is given.
        lever: m, NaN for the gripper.
        readings: its rows.
        fit: slope and gap as the gauge saw them, m/N and m.
        compliance: of the part, m/N or rad/Nm.
        gap: of the part, m or rad.
        alarms: the checks that fail.
        outliers: rows far off their line.
        note: what was subtracted, or should have been.
    """

    part: str
    seat: str
    source: str
    direction: float
    lever: float
    readings: DialGaugeReadings
    fit: RunFit
    compliance: Estimate
    gap: Estimate
    alarms: tuple[Check, ...] = ()
    outliers: tuple[int, ...] = ()
    note: str = ''

    @property
    def name(self) -> str:
        """What to call it in a message."""
        return called(self.part, self.direction)

    @property
    def half_gap(self) -> Estimate:
        """The g of (6) and (7)."""
        return Estimate(self.gap.value / 2, self.gap.std / 2)


class Part(NamedTuple):
    """What all runs of a part say.

    Attributes:
        name: one of `PARTS`.
        runs: in the order of the readings.
        compliance: m/N or rad/Nm; over the directions their mean.
        gap: m or rad; over the directions their mean.
        compliance_map: over the direction, for a gripper with two directions or more.
        gap_map: likewise.
    """

    name: str
    runs: tuple[Run, ...]
    compliance: Estimate
    gap: Estimate
    compliance_map: DirectionMap | None
    gap_map: DirectionMap | None

    @property
    def half_gap(self) -> Estimate:
        """The g of (6) and (7)."""
        return Estimate(self.gap.value / 2, self.gap.std / 2)

    @property
    def units(self) -> tuple[str, str]:
        """Units of compliance and gap."""
        return ('m/N', 'm') if self.name == GRIPPER else ('rad/Nm', 'rad')


class DialGaugeAnalysis(NamedTuple):
    """All of it.

    Attributes:
        parts: those measured, in the order of `PARTS`.
        warnings: what a reader should know, one sentence each.
        sources: names of the files.
    """

    parts: tuple[Part, ...]
    warnings: tuple[str, ...]
    sources: tuple[str, ...]

    def part(self, name: str) -> Part:
        """One of the parts.

        Raises:
            ParameterError: it was not measured.
        """
        for part in self.parts:
            if part.name == name:
                return part
        raise ParameterError(name, 'was not measured', f'there is {", ".join(part.name for part in self.parts)}')


def called(part: str, direction: float) -> str:
    """What to call a part, and the direction (rad, NaN for none) in which it was loaded."""
    return part if np.isnan(direction) else f'{part} at {np.degrees(direction):g} deg'
